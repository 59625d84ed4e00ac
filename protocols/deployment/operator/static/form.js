// The parameters of a play, as a form: robots, places, numbers, a strategy.

import { Places, points_of } from "./places.js";
import { choice, labelled, make, number } from "./parts.js";

export const STRATEGIES = [["group", "group"], ["wave", "wave"], ["leap_frog", "leap-frog"]];

/** The parameters of a play. The planner chooses values that are left out, unless the play has defaults. */
export class Form {
  /**
   * @param {HTMLElement} root
   * @param {import("./places.js").Picker} picker
   * @param {() => void} changed
   */
  constructor(root, picker, changed) {
    this.root = root;
    this.picker = picker;
    this.changed = changed;
    this.named = {};
    this.size = 0;
    this.values = {};
    this.parameters = {};
    this.path = "";
    this.rows = new Map(); // name -> its label and its controls
    this.lists = new Map(); // name -> places
    this.latest = null; // name of the list of places that the user is filling
    picker.unasked = (place) => this.offer(place);
    root.addEventListener("submit", (event) => event.preventDefault());
  }

  /** Show the parameters of the play at *path*. */
  show(path, parameters) {
    const same = JSON.stringify(parameters) === JSON.stringify(this.parameters);
    this.path = path;
    if (same) return; // the values stay: it is the same play at another level, or one with the same parameters
    this.picker.want(null);
    this.parameters = parameters;
    this.values = {};
    this.lists.clear();
    this.latest = null;
    this.rows = new Map(Object.entries(parameters).map(([name, parameter]) =>
      [name, labelled(title(name), this.field(name, parameter), parameter.about)]));
    for (const name of this.lists.keys()) this.rows.get(name).addEventListener("click", () => this.use(name));
    this.root.replaceChildren(...this.rows.values());
    this.show_next();
  }

  /** Make again what depends on the floor and the team. */
  know(named, size) {
    if (JSON.stringify([named, size]) === JSON.stringify([this.named, this.size])) return;
    Object.assign(this, { named, size });
    const { path, parameters } = this;
    this.parameters = {};
    this.show(path, parameters);
  }

  /** The given values, by their names, in the form that the planner takes. */
  given() {
    const given = Object.entries(this.values).filter(([, value]) => value !== null && value !== undefined && value !== "");
    return Object.fromEntries(given);
  }

  /** The parameters that have neither a value nor a default, and that the planner does not choose. */
  missing() {
    return Object.entries(this.parameters).filter(([name, parameter]) => {
      const open = this.values[name] === undefined || this.values[name] === null;
      return open && parameter.kind !== "robot" && parameter.default === undefined && !parameter.as_many_as;
    }).map(([name]) => name);
  }

  /** Mark the parameters *names*, and no others, as missing; *focused*: focus the first of them. */
  mark(names, focused = false) {
    for (const [name, row] of this.rows) {
      row.classList.toggle("missing", names.includes(name));
      row.querySelector("input, select").setAttribute("aria-invalid", String(names.includes(name)));
    }
    if (names.length && focused) this.rows.get(names[0]).querySelector("select, input").focus();
  }

  /** The parameters that are marked. */
  marked() {
    return [...this.rows.keys()].filter((name) => this.rows.get(name).classList.contains("missing"));
  }

  /**
   * Take a place that was clicked on without a request: it is for the list that was used last, or for the first that is
   * empty. Return whether there is one.
   */
  offer(place) {
    const list = this.lists.get(this.next());
    list?.add(place);
    return Boolean(list);
  }

  /** The list of places that such a click is for, by its name; undefined if there is none. */
  next() {
    return this.latest ?? [...this.lists.keys()].find((name) => !this.lists.get(name).places.length);
  }

  /** Let such clicks be for the list *name*; null: for the first that is empty. */
  use(name) {
    this.latest = name;
    this.show_next();
  }

  show_next() {
    for (const [name, row] of this.rows) row.classList.toggle("next", name === this.next());
  }

  /** The points on the floor that have been chosen, with what they are for. */
  points() {
    return Object.entries(this.values).flatMap(([name, value]) => {
      const { kind } = this.parameters[name];
      if (kind !== "place" && kind !== "places") return [];
      const points = points_of(kind === "place" && value !== null ? [value] : value ?? [], this.named);
      return points.map((point, at) => ({ point, name: points.length > 1 ? String(at + 1) : title(name) }));
    });
  }

  /** Number of robots that a parameter stands for; null if that is left open. */
  count(name) {
    const { kind, as_many_as, default: most } = this.parameters[name];
    const value = this.values[name];
    if (kind === "robot") return 1;
    if (Array.isArray(value)) return value.length;
    if (Number.isInteger(value)) return value;
    return as_many_as ? points_of(this.values[as_many_as] ?? [], this.named).length || null : most ?? null;
  }

  /** The roles that the planner casts: the parameters that are robots, numbered if there are several. */
  roles() {
    return Object.entries(this.parameters).flatMap(([name, { kind }]) => {
      if (kind === "robot") return [name];
      if (kind !== "robots") return [];
      return Array.from({ length: this.count(name) ?? 0 }, (_, at) => `${name}-${at + 1}`);
    });
  }

  set(name, value) {
    this.values[name] = value;
    const missing = this.missing();
    this.mark(this.marked().filter((each) => missing.includes(each)));
    this.changed();
  }

  places(name, single) {
    const told = (places) => {
      this.use(single && places.length ? null : name); // the next click is for another list, if this one takes a single place
      this.set(name, single ? places[0] ?? null : places.length ? [...places] : null);
    };
    const list = new Places(title(name), { single, picker: this.picker, named: this.named, changed: told });
    list.element.addEventListener("focusin", () => this.use(name));
    this.lists.set(name, list);
    return list.element;
  }

  field(name, parameter) {
    const set = (value) => this.set(name, value);
    const own = parameter.default;
    switch (parameter.kind) {
      case "place":
      case "places":
        return this.places(name, parameter.kind === "place");
      case "robots":
        return this.robots(name, parameter);
      case "robot":
        return choice([["", "the planner chooses"], ...this.team()], "", (value) => set(value === "" ? null : Number(value)));
      case "strategy": {
        const first = own ? [["", `${own.replace("_", "-")}, the play's own`]] : [["", "choose"]];
        return choice([...first, ...STRATEGIES], "", (value) => set(value || null));
      }
      default: {
        const limits = { min: parameter.least ?? "", max: parameter.most ?? "" };
        return number(null, set, { ...limits, placeholder: own ?? "" });
      }
    }
  }

  /** Several robots: how many, or which. */
  robots(name, { as_many_as, default: own }) {
    const chosen = new Set();
    const words = title(name);
    const open = as_many_as ? `as many as ${title(as_many_as)}` : own ? `${own}, the play's own` : "to be told";
    const count = number(null, (value) => {
      if (value !== null && chosen.size) {
        chosen.clear();
        for (const each of team.children) each.setAttribute("aria-pressed", "false");
      }
      this.set(name, value);
    }, { min: 1, max: this.size, step: 1, placeholder: as_many_as ? "auto" : own ?? "?", title: `how many; if left out: ${open}`,
      aria: { label: `${words}: how many (${open})` } });
    const team = make("span", { className: "team" });
    team.append(...this.team().map(([, text], robot) => {
      const each = make("button", { type: "button", textContent: String(robot), aria: { pressed: false, label: `${words}: ${text}` } });
      each.addEventListener("click", () => {
        if (!chosen.delete(robot)) chosen.add(robot);
        each.setAttribute("aria-pressed", String(chosen.has(robot)));
        count.value = "";
        this.set(name, chosen.size ? [...chosen] : null);
      });
      return each;
    }));
    return make("div", { className: "robots-field", children: [count, "or", team] });
  }

  team() {
    return Array.from({ length: this.size }, (_, robot) => [String(robot), `robot ${robot}`]);
  }
}

/** The name of a parameter in words. */
export function title(name) {
  return name.replaceAll("_", " ");
}
