// A tree for the keyboard, by the authoring practices of the W3C: one tab stop, arrows inside.

/**
 * A tree of nodes {id, name, below: nodes, open}. `draw`, which fills a node's row, may use what else the node has. Rows
 * are made again only when the tree's shape changes, so that focus and what is open stay. A row is the item of the tree,
 * and what is below it is an element beside it: else all of that would be read aloud as the item's name.
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
    this.touched = new Set(); // what the user has opened or closed stays as it is
    this.selected = null;
    this.shape = "";
    root.addEventListener("keydown", (event) => this.key(event));
  }

  /** Show *nodes*. */
  show(nodes) {
    const shape = JSON.stringify(outline(nodes));
    if (shape !== this.shape) {
      const open = new Map([...this.items].map(([id, { item }]) => [id, is_open(item)]));
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

  /** Scroll the node *id* into view. */
  reveal(id) {
    this.items.get(id).item.scrollIntoView({ block: "nearest" });
  }

  /** Open or close the node *id*, unless the user has done so before. */
  unfold(id, open) {
    const found = this.items.get(id);
    if (found?.item.hasAttribute("aria-expanded") && !this.touched.has(id)) found.item.setAttribute("aria-expanded", String(open));
  }

  refresh(nodes) {
    for (const node of nodes) {
      const found = this.items.get(node.id);
      found.node = node;
      this.told.draw(found.content, node);
      this.refresh(node.below ?? []);
    }
  }

  made(nodes, level, open) {
    return nodes.map((node, at) => {
      const branch = document.createElement("li");
      const item = document.createElement("span");
      const twist = document.createElement("span");
      const content = document.createElement("span");
      branch.setAttribute("role", "none");
      item.setAttribute("role", "treeitem");
      item.setAttribute("aria-level", String(level));
      item.setAttribute("aria-posinset", String(at + 1));
      item.setAttribute("aria-setsize", String(nodes.length));
      item.setAttribute("aria-selected", String(node.id === this.selected));
      branch.dataset.id = item.dataset.id = node.id;
      item.tabIndex = -1;
      item.className = "row";
      twist.className = "twist";
      twist.setAttribute("aria-hidden", "true");
      content.className = "content";
      item.append(twist, content);
      branch.append(item);
      this.items.set(node.id, { item, content, node });
      if (node.below?.length) {
        const group = document.createElement("ul");
        group.setAttribute("role", "group");
        group.append(...this.made(node.below, level + 1, open));
        item.setAttribute("aria-expanded", String(open.get(node.id) ?? Boolean(node.open)));
        branch.append(group);
        twist.addEventListener("click", (event) => {
          event.stopPropagation();
          this.toggle(item);
        });
      }
      item.addEventListener("click", () => {
        this.select(node.id);
        item.focus({ preventScroll: true });
      });
      item.addEventListener("dblclick", () => (this.told.done ? this.told.done(this.items.get(node.id).node) : this.toggle(item)));
      return branch;
    });
  }

  toggle(item, open = !is_open(item)) {
    if (!item.hasAttribute("aria-expanded")) return;
    this.touched.add(item.dataset.id);
    item.setAttribute("aria-expanded", String(open));
  }

  /** Make the node *id* the one that the tab key reaches. */
  stop(id) {
    for (const [each, { item }] of this.items) item.tabIndex = each === id ? 0 : -1;
  }

  /** The visible items, from the top. */
  seen() {
    return [...this.items.values()].map(({ item }) => item).filter((item) => {
      for (let up = this.above(item); up; up = this.above(up)) if (!is_open(up)) return false;
      return true;
    });
  }

  /** The item that an item is below, if any. */
  above(item) {
    const branch = item.parentElement.parentElement.closest("li");
    return branch && this.root.contains(branch) ? branch.firstElementChild : null;
  }

  key(event) {
    const item = event.target.closest("[role=treeitem]");
    if (!item || event.ctrlKey || event.altKey || event.metaKey) return;
    const seen = this.seen();
    const at = seen.indexOf(item);
    const acts = {
      ArrowDown: () => seen[at + 1],
      ArrowUp: () => seen[at - 1],
      Home: () => seen[0],
      End: () => seen[seen.length - 1],
      ArrowRight: () => {
        if (is_open(item)) return seen[at + 1];
        this.toggle(item, true);
        return item;
      },
      ArrowLeft: () => {
        if (!is_open(item)) return this.above(item) ?? item;
        this.toggle(item, false);
        return item;
      },
      " ": () => item,
      Enter: () => item,
    };
    const act = acts[event.key] ?? (event.key.length === 1 ? () => this.typed(seen, at, event.key) : null);
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    const to = act() ?? item;
    this.stop(to.dataset.id);
    to.focus();
    if (event.key === " " || event.key === "Enter") this.select(to.dataset.id);
    if (event.key === "Enter") this.told.done?.(this.items.get(to.dataset.id).node);
  }

  /** The next item whose name begins with a letter. */
  typed(seen, at, letter) {
    const after = [...seen.slice(at + 1), ...seen.slice(0, at + 1)];
    return after.find((item) => this.items.get(item.dataset.id).node.name.toLowerCase().startsWith(letter.toLowerCase()));
  }
}

function is_open(item) {
  return item.getAttribute("aria-expanded") === "true";
}

function outline(nodes) {
  return nodes.map((node) => [node.id, node.name, outline(node.below ?? [])]);
}
