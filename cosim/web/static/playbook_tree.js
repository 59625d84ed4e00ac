// A tree that one can walk with the keyboard, as the authoring practices of the W3C have it: one tab stop, arrows inside.

/**
 * A tree of nodes {id, name, words, below: nodes, open}; `words` are read aloud instead of the name. What else a node has
 * is for `draw`, which fills its row; rows are made anew only when the tree's shape changes, so that focus and what is
 * open stay.
 */
export class Tree {
  /**
   * @param {HTMLElement} root an element of role tree
   * @param {{draw: (row: HTMLElement, node: object) => void, picked?: (node: object) => void, done?: (node: object) => void}} told
   *   picked: the node is selected; done: it was double-clicked, or Enter was pressed on it
   */
  constructor(root, told) {
    this.root = root;
    this.told = told;
    this.items = new Map();
    this.touched = new Set(); // what somebody has opened or closed stays as it is
    this.selected = null;
    this.shape = "";
    root.addEventListener("keydown", (event) => this.key(event));
  }

  /** Show *nodes*. */
  show(nodes) {
    const shape = JSON.stringify(outline(nodes));
    if (shape !== this.shape) {
      const open = new Map([...this.items].map(([id, { item }]) => [id, item.getAttribute("aria-expanded") === "true"]));
      const focused = this.root.contains(document.activeElement) ? document.activeElement.dataset.id : null;
      if (nodes[0]?.id !== this.root.firstElementChild?.dataset.id) this.touched.clear();
      this.shape = shape;
      this.items.clear();
      this.root.replaceChildren(...this.made(nodes, 1, open));
      if (!this.items.has(this.selected)) this.selected = null;
      this.stop(this.items.has(focused) ? focused : this.selected ?? this.root.firstElementChild?.dataset.id);
      if (this.items.has(focused)) this.items.get(focused).item.focus();
    }
    this.refresh(nodes);
  }

  /** Select the node *id* as if it had been clicked on. */
  select(id) {
    const found = this.items.get(id);
    if (!found) return;
    this.selected = id;
    for (const [each, { item }] of this.items) item.setAttribute("aria-selected", String(each === id));
    this.stop(id);
    this.told.picked?.(found.node);
  }

  /** Open or close the node *id*, unless somebody has done so before. */
  unfold(id, open) {
    const found = this.items.get(id);
    if (found?.item.hasAttribute("aria-expanded") && !this.touched.has(id)) found.item.setAttribute("aria-expanded", String(open));
  }

  refresh(nodes) {
    for (const node of nodes) {
      const found = this.items.get(node.id);
      found.node = node;
      found.item.setAttribute("aria-label", node.words ?? node.name);
      this.told.draw(found.row, node);
      this.refresh(node.below ?? []);
    }
  }

  made(nodes, level, open) {
    return nodes.map((node, at) => {
      const item = document.createElement("li");
      const row = document.createElement("span");
      const twist = document.createElement("span");
      const content = document.createElement("span");
      item.setAttribute("role", "treeitem");
      item.setAttribute("aria-level", String(level));
      item.setAttribute("aria-posinset", String(at + 1));
      item.setAttribute("aria-setsize", String(nodes.length));
      item.setAttribute("aria-selected", String(node.id === this.selected));
      item.dataset.id = node.id;
      item.tabIndex = -1;
      row.className = "row";
      twist.className = "twist";
      twist.setAttribute("aria-hidden", "true");
      content.className = "content";
      row.append(twist, content);
      item.append(row);
      this.items.set(node.id, { item, row: content, node });
      if (node.below?.length) {
        const group = document.createElement("ul");
        group.setAttribute("role", "group");
        group.append(...this.made(node.below, level + 1, open));
        item.setAttribute("aria-expanded", String(open.get(node.id) ?? Boolean(node.open)));
        item.append(group);
        twist.addEventListener("click", (event) => {
          event.stopPropagation();
          this.toggle(item);
        });
      }
      row.addEventListener("click", () => {
        this.select(node.id);
        item.focus({ preventScroll: true });
      });
      row.addEventListener("dblclick", () => (this.told.done ? this.told.done(this.items.get(node.id).node) : this.toggle(item)));
      return item;
    });
  }

  toggle(item, open = item.getAttribute("aria-expanded") !== "true") {
    if (!item.hasAttribute("aria-expanded")) return;
    this.touched.add(item.dataset.id);
    item.setAttribute("aria-expanded", String(open));
  }

  /** Make the node *id* the one that the tab key comes to. */
  stop(id) {
    for (const [each, { item }] of this.items) item.tabIndex = each === id ? 0 : -1;
  }

  /** The items that can be seen, from the top. */
  seen() {
    return [...this.items.values()].map(({ item }) => item).filter((item) => {
      for (let up = item.parentElement.closest("li"); up && this.root.contains(up); up = up.parentElement.closest("li")) {
        if (up.getAttribute("aria-expanded") !== "true") return false;
      }
      return true;
    });
  }

  key(event) {
    const item = event.target.closest("li");
    if (!item || event.ctrlKey || event.altKey || event.metaKey) return;
    const seen = this.seen();
    const at = seen.indexOf(item);
    const open = item.getAttribute("aria-expanded");
    const acts = {
      ArrowDown: () => seen[at + 1],
      ArrowUp: () => seen[at - 1],
      Home: () => seen[0],
      End: () => seen[seen.length - 1],
      ArrowRight: () => {
        if (open === "true") return seen[at + 1];
        this.toggle(item, true);
        return item;
      },
      ArrowLeft: () => {
        if (open !== "true") return item.parentElement.closest("li") ?? item;
        this.toggle(item, false);
        return item;
      },
      " ": () => item,
      Enter: () => item,
    };
    const act = acts[event.key] ?? (event.key.length === 1 ? () => typed(seen, at, event.key) : null);
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    const to = act() ?? item;
    this.stop(to.dataset.id);
    to.focus();
    if (event.key === " " || event.key === "Enter") this.select(to.dataset.id);
    if (event.key === "Enter") this.told.done?.(this.items.get(to.dataset.id).node);
  }
}

/** The next item whose name begins with a letter. */
function typed(seen, at, letter) {
  const after = [...seen.slice(at + 1), ...seen.slice(0, at + 1)];
  return after.find((item) => item.getAttribute("aria-label").toLowerCase().startsWith(letter.toLowerCase()));
}

function outline(nodes) {
  return nodes.map((node) => [node.id, node.name, outline(node.below ?? [])]);
}
