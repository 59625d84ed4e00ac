// Lists beside the floor: the robots and the stations, what has happened, and in the end the metrics.

const SHOWN = 150;

/** The list of robots, and of stations after them; one of them may be selected. */
export class Robots {
  constructor(root, floor, picked) {
    this.root = root;
    this.floor = floor;
    this.picked = picked;
    this.rows = [];
  }

  show({ places, stations, doing }, selected) {
    while (this.rows.length < places.length) this.add(this.rows.length);
    while (this.rows.length > places.length) this.rows.pop().item.remove();
    places.forEach(([x, y, heading, down], robot) => {
      const { button, name, where, chip, state } = this.rows[robot];
      name.textContent = `${stations.called(robot)}${down ? " †" : ""}`;
      const turned = stations.has(robot) ? "" : `  ${Math.round((heading * 180) / Math.PI)}°`;
      where.textContent = `${x.toFixed(2)}, ${y.toFixed(2)} m${turned}`;
      chip.style.background = down ? "transparent" : this.floor.colour(robot);
      chip.style.boxShadow = down ? `inset 0 0 0 2px ${this.floor.colour(robot)}` : "";
      chip.className = `chip ${this.floor.shape(robot)}`;
      const words = standing(doing, robot, stations);
      if (state.textContent !== words) state.textContent = words;
      button.setAttribute("aria-pressed", String(robot === selected));
    });
  }

  add(robot) {
    const item = document.createElement("li");
    const button = document.createElement("button");
    const [chip, name, where, state] = ["chip", "name", "number", "state"].map((kind) => {
      const part = document.createElement("span");
      part.className = kind;
      return part;
    });
    button.type = "button";
    button.append(chip, name, where, state);
    button.addEventListener("click", () => this.picked(button.getAttribute("aria-pressed") === "true" ? null : robot));
    item.append(button);
    this.root.append(item);
    this.rows.push({ item, button, chip, name, where, state });
  }
}

/** What a robot, or one of the stations, is doing, in words: its links, and what else its radio is at. */
export function standing(doing, robot, stations) {
  const slaves = doing.links.filter(({ master }) => master === robot).map(({ slave }) => stations.short(slave));
  const masters = doing.links.filter(({ slave }) => slave === robot).map(({ master }) => stations.short(master));
  const words = [slaves.length && `master of ${slaves.join(", ")}`, masters.length && `slave of ${masters.join(", ")}`];
  return [...words, ...doing.of(robot)].filter(Boolean).join("; ");
}

/** The list of events, the newest first, filtered by their type, by robot and by a text in them. */
export class Events {
  /**
   * @param {HTMLElement} root an empty list
   * @param {{text: HTMLInputElement, kind: HTMLSelectElement, robot: HTMLSelectElement}} filters
   * @param {{floor: import("./floor.js").Floor, address: import("./address.js").Address, marks: import("./marks.js").Marks,
   *   select: (robot: number | null) => void}} about
   */
  constructor(root, filters, { floor, address, marks, select }) {
    Object.assign(this, { root, filters, floor, address, marks });
    this.seek = null; // (time in s), where one can go there
    this.key = "";
    this.counts = {};
    filters.text.value = address.get("find") ?? "";
    this.kind = address.get("kind") ?? "";
    filters.text.addEventListener("input", () => this.changed());
    filters.kind.addEventListener("change", () => {
      this.kind = filters.kind.value;
      this.changed();
    });
    filters.robot.addEventListener("change", () => select(filters.robot.value === "" ? null : Number(filters.robot.value)));
  }

  /** Take the scene: how many robots there are, and how many events of which types, where that is known. */
  begin({ radii_m, kinds = {} }) {
    this.counts = kinds;
    this.filters.robot.replaceChildren(new Option("all robots", ""), ...radii_m.map((_, robot) => new Option(`robot ${robot}`, robot)));
    this.filters.kind.replaceChildren(new Option("all kinds", ""));
    this.offer([this.kind, ...Object.keys(kinds)]);
  }

  /** Add types of events to those that can be chosen. */
  offer(names) {
    const select = this.filters.kind;
    const known = new Set([...select.options].map(({ value }) => value));
    const added = [...new Set(names)].filter((name) => name && !known.has(name));
    if (!added.length) return;
    for (const name of added) select.add(new Option(this.counts[name] ? `${name} (${this.counts[name]})` : name, name));
    const [all, ...others] = select.options;
    select.replaceChildren(all, ...others.sort((one, other) => (one.value < other.value ? -1 : 1)));
    select.value = this.kind;
  }

  changed() {
    this.address.put("kind", this.kind || null);
    this.address.put("find", this.filters.text.value.trim() || null);
    this.show(this.events ?? [], this.selected);
  }

  show(events, selected) {
    this.events = events;
    this.selected = selected;
    const text = this.filters.text.value.trim().toLowerCase();
    const last = events[events.length - 1];
    const key = `${events.length} ${events[0]?.number} ${last?.number} ${selected} ${this.kind} ${text}`;
    if (key === this.key) return;
    this.key = key;
    this.offer(events.map(({ name }) => name));
    this.filters.robot.value = selected === null ? "" : String(selected);
    this.marks.show(this.kind, selected);
    const chosen = [];
    for (let at = events.length - 1; at >= 0 && chosen.length < SHOWN; at -= 1) {
      const event = events[at];
      if (selected !== null && event.robot !== selected) continue;
      if (this.kind && event.name !== this.kind) continue;
      const words = `${event.name} ${described(event.fields)}`;
      if (!text || words.toLowerCase().includes(text)) chosen.push(this.row(event));
    }
    this.root.replaceChildren(...chosen);
  }

  row({ time_s, robot, name, fields }) {
    const item = document.createElement("li");
    const when = document.createElement("time");
    when.textContent = `${time_s.toFixed(2)} s `;
    const chip = document.createElement("span");
    chip.className = "chip";
    if (robot >= 0) chip.style.background = this.floor.colour(robot);
    const what = document.createElement(this.seek ? "button" : "b");
    what.textContent = name;
    if (this.seek) {
      what.type = "button";
      what.title = "Go there in time";
      what.addEventListener("click", () => this.seek(time_s));
    }
    const rest = document.createElement("span");
    rest.className = "fields";
    rest.textContent = ` ${described(fields)}`;
    item.append(when, chip, ` ${robot >= 0 ? robot : ""} `, ...this.marks.signs(name), what, rest);
    return item;
  }
}

/** Put the metrics of a run that has ended into a table. */
export function show_metrics(body, metrics) {
  body.replaceChildren(
    ...metrics.map(([name, value, unit, meaning]) => {
      const row = document.createElement("tr");
      row.title = meaning;
      for (const text of [name, value === null ? "–" : String(Number(value.toPrecision(6))), unit === "1" ? "" : unit]) {
        row.insertCell().textContent = text;
      }
      return row;
    }),
  );
}

function described(fields) {
  return Object.entries(fields)
    .map(([name, value]) => `${name} ${typeof value === "number" && !Number.isInteger(value) ? value.toFixed(2) : value}`)
    .join(", ");
}
