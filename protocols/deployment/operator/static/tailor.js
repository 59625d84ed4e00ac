// Tailoring: what is added to a called play before it is executed, checked by the planner at every change.

import { STRATEGIES } from "./form.js";
import { button, choice, duration, labelled, make, number, place_text } from "./parts.js";
import { Places } from "./places.js";
import { Tasks } from "./tasks.js";

const KINDS = [
  ["before", "before"], ["after", "after"], ["starts_with", "starts with"], ["ends_with", "ends with"],
  ["within", "takes at most"], ["deadline", "has ended by"],
];
const EDGES = [["start", "starts"], ["end", "ends"]];
// for the planner, to start with another is a case of after: no time between two starts
const TOGETHER = { kind: "after", edge: "start", of_edge: "start", at_least_s: 0, at_most_s: 0 };

/** The additions to one call, and the plan that the planner has made of it. */
export class Tailor {
  /**
   * @param {(id: string) => HTMLElement} find
   * @param {import("./places.js").Picker} picker
   * @param {(wanted: boolean) => void} changed is called when a plan is to be made again; wanted: something has been added
   */
  constructor(find, picker, changed) {
    this.find = find;
    this.picker = picker;
    this.changed = changed;
    this.tasks = new Tasks(find("draft"), () => {});
    this.named = {};
    this.reset([], 0);
    find("constraint-kind").replaceWith(this.kind());
    find("constraint").addEventListener("submit", (event) => {
      event.preventDefault();
      this.add_constraint();
    });
  }

  /** Begin to tailor another play: nothing is added yet. *roles*: to be cast; *size*: of the team. */
  reset(roles, size) {
    this.plan = null;
    this.size = size;
    this.constraints = [];
    this.via = {};
    this.roles = {};
    this.options = {};
    this.parts = [];
    this.fresh = { kind: "before" };
    this.find("draft-title").textContent = "";
    this.tasks.tree.show([]);
    this.show_roles(roles, size);
    this.show_options(size);
    this.show_additions();
  }

  /** The additions to the call. */
  additions() {
    const added = { expand: "all", ...this.options }; // stages can be seen, and constrained, only if they are expanded
    if (added.expand === "none") delete added.expand;
    if (this.constraints.length) added.constraints = this.constraints;
    if (Object.keys(this.via).length) added.via = this.via;
    if (Object.keys(this.roles).length) added.roles = this.roles;
    return added;
  }

  /** Take the additions of another call, with other constraints, roles or robots. */
  take({ constraints = [], roles = {}, robots = null }) {
    Object.assign(this, { constraints, roles });
    if (robots === null) delete this.options.robots;
    else this.options.robots = robots;
    this.show_options(this.size);
    this.show_roles(this.role_names ? this.role_names.split("|") : [], this.size);
    this.show_additions();
  }

  /** Show the plan that the additions lead to. */
  show_plan(answer) {
    this.plan = answer.plan;
    this.find("draft-title").textContent = `Plan ${answer.plan.number}: ${duration(answer)}`;
    const nodes = this.tasks.show(answer.plan, answer.windows, null);
    const top = answer.plan.root.name; // constraints and waypoints name tasks without it
    const parts = flat(nodes).map((node) => [node.id === top ? "" : node.id.slice(top.length + 1), node]);
    const text = parts.map(([label]) => label).join("|");
    if (text === this.parts.map(([label]) => label).join("|")) return;
    this.parts = parts;
    this.show_fields();
    this.show_waypoints();
  }

  /** Show that there is no plan for the call. */
  show_none() {
    this.plan = null;
    this.find("draft-title").textContent = "No plan";
  }

  // ------------------------------------------------------------ options and roles

  show_options(size) {
    const set = (name, value) => {
      if (value === null) delete this.options[name];
      else this.options[name] = value;
      this.changed(false);
    };
    const strategy = choice([["", "the play's own"], ...STRATEGIES], this.options.strategy ?? "", (value) => set("strategy", value || null), { id: "option-strategy" });
    const expand = choice([["all", "laid out by the planner"], ["none", "left to the executive"]], this.options.expand ?? "all", (value) => set("expand", value));
    const augmented = choice([["", "as the play says"], ["true", "yes"], ["false", "no"]], String(this.options.augmented ?? ""), (value) => set("augmented", value === "" ? null : value === "true"));
    const { robots } = this.options;
    const out = new Set(robots && Array.from({ length: size }, (_, robot) => robot).filter((robot) => !robots.includes(robot)));
    const team = make("span", { className: "team" });
    for (let robot = 0; robot < size; robot += 1) {
      team.append(button(String(robot), (made) => {
        if (!out.delete(robot)) out.add(robot);
        made.setAttribute("aria-pressed", String(!out.has(robot)));
        const all = Array.from({ length: size }, (_, each) => each);
        set("robots", out.size ? all.filter((each) => !out.has(each)) : null);
      }, { aria: { pressed: !out.has(robot), label: `robot ${robot} may take part` } }));
    }
    this.find("options").replaceChildren(
      labelled("strategy", strategy, "of all deployments"),
      labelled("stages", expand, "who makes stages of deployments"),
      labelled("keep apart", augmented, "offsets, staggered starts, stepping aside"),
      labelled("take part", team, "who may be chosen by the planner"),
    );
  }

  show_roles(roles, size) {
    const pairs = [["", "the planner chooses"], ...Array.from({ length: size }, (_, robot) => [String(robot), `robot ${robot}`])];
    this.role_names = roles.join("|");
    for (const name of Object.keys(this.roles)) if (!roles.includes(name)) delete this.roles[name];
    this.find("roles-part").hidden = !roles.length;
    this.find("roles").replaceChildren(...roles.map((role) => labelled(role, choice(pairs, String(this.roles[role] ?? ""), (value) => {
      if (value === "") delete this.roles[role];
      else this.roles[role] = Number(value);
      this.changed(false);
    }))));
  }

  /** Show the roles again if they have changed: there are more places, for example. */
  keep_roles(roles, size) {
    if (roles.join("|") !== this.role_names) this.show_roles(roles, size);
  }

  // ------------------------------------------------------------ constraints

  kind() {
    return choice(KINDS, "before", (kind) => {
      this.fresh = { kind };
      this.show_fields();
    }, { id: "constraint-kind", aria: { label: "kind of constraint" } });
  }

  show_fields() {
    const kind = this.find("constraint-kind").value;
    const named = this.parts.filter(([label]) => label !== "");
    const tasks = (field, whole) => {
      const pairs = (whole ? this.parts : named).map(([label]) => [label, label || "the whole play"]);
      this.fresh[field] = pairs.some(([label]) => label === this.fresh[field]) ? this.fresh[field] : pairs[0]?.[0] ?? "";
      return choice(pairs, this.fresh[field], (value) => { this.fresh[field] = value; }, { name: field, aria: { label: field } });
    };
    const edge = (field, value) => {
      this.fresh[field] ??= value;
      return choice(EDGES, this.fresh[field], (chosen) => { this.fresh[field] = chosen; }, { name: field, aria: { label: field } });
    };
    const amount = (field, label) => number(this.fresh[field], (value) => { this.fresh[field] = value; },
      { name: field, placeholder: "s", aria: { label } });
    const two = (first, then, arranged) => { // at first, two of which neither is part of the other
      const [one, other] = first_apart(named.map(([label]) => label));
      this.fresh[first] ??= one;
      this.fresh[then] ??= other;
      return arranged(tasks(first), tasks(then));
    };
    const fields = {
      before: () => two("first", "then", (first, then) => [first, "ends before", then, "starts, by at least", amount("at_least_s", "at least, seconds"), "s"]),
      after: () => two("task", "of", (task, of) => [task, edge("edge", "start"), amount("at_least_s", "at least, seconds"), "to",
        amount("at_most_s", "at most, seconds"), "s after", of, edge("of_edge", "end")]),
      starts_with: () => two("task", "of", (task, of) => [task, "starts when", of, "starts"]),
      ends_with: () => two("task", "of", (task, of) => [task, "is terminated when", of, "ends"]),
      within: () => [tasks("task", true), "takes at most", amount("seconds", "seconds"), "s"],
      deadline: () => [tasks("task", true), "has ended at most", amount("seconds", "seconds"), "s after the play begins"],
    };
    this.find("constraint-fields").replaceChildren(...fields[kind]());
  }

  add_constraint() {
    const { value: kind } = this.find("constraint-kind");
    const made = kind === "starts_with" ? { ...TOGETHER } : { kind };
    for (const field of this.find("constraint-fields").querySelectorAll("[name]")) {
      const value = field.type === "number" ? (field.value === "" ? null : Number(field.value)) : field.value;
      if (value !== null) made[field.name] = value;
    }
    if ((made.kind === "within" || made.kind === "deadline") && made.seconds === undefined) {
      this.find("constraint-fields").querySelector("[name=seconds]").focus();
      return;
    }
    this.constraints.push(made);
    this.show_additions();
    this.changed(true);
  }

  // ------------------------------------------------------------ waypoints

  show_waypoints() {
    const drives = this.parts.filter(([label, { task }]) => task?.act?.act === "go" || (task === null && /(^|\/)robot-\d+(-leg-\d+)?$/.test(label)));
    const of = choice(drives.map(([label]) => [label, label]), drives[0]?.[0], () => {}, { id: "drive", aria: { label: "drive" } });
    const places = new Places("waypoint", {
      single: false,
      picker: this.picker,
      named: this.named,
      changed: ([place]) => {
        if (place === undefined) return;
        places.places = [];
        places.show();
        this.via[of.value] = [...(this.via[of.value] ?? []), place];
        this.show_additions();
        this.changed(true);
      },
    });
    this.find("waypoints-part").hidden = !drives.length;
    this.find("waypoints").replaceChildren(of, places.element);
  }

  // ------------------------------------------------------------ what has been added

  show_additions() {
    const removable = (text, remove) => make("li", {
      children: [make("span", { textContent: text }), button("×", () => {
        remove();
        this.show_additions();
        this.changed(true);
      }, { className: "remove", aria: { label: `remove: ${text}` } })],
    });
    this.find("constraints").replaceChildren(
      ...this.constraints.map((each, at) => removable(constraint_text(each), () => this.constraints.splice(at, 1))),
      ...Object.entries(this.via).map(([label, places]) =>
        removable(`${label} drives over ${places.map(place_text).join(" and ")}`, () => delete this.via[label])),
    );
  }
}

/** A constraint in words. */
export function constraint_text(each) {
  const whole = each.task || "the whole play";
  switch (each.kind) {
    case "before":
      return `${each.first} ends ${each.at_least_s ? `at least ${each.at_least_s} s ` : ""}before ${each.then} starts`;
    case "after": {
      if (Object.entries(TOGETHER).every(([field, value]) => each[field] === value)) return `${each.task} starts when ${each.of} starts`;
      const most = each.at_most_s === undefined ? "" : ` at most ${each.at_most_s} s`;
      return `${each.task} ${each.edge}s at least ${each.at_least_s ?? 0} s${most} after ${each.of} ${each.of_edge}s`;
    }
    case "ends_with":
      return `${each.task} is terminated when ${each.of} ends`;
    case "within":
      return `${whole} takes at most ${each.seconds} s`;
    default:
      return `${whole} has ended at most ${each.seconds} s after the play begins`;
  }
}

/** The first two of the tasks of which neither is part of the other; none if there are none. */
function first_apart(labels) {
  for (const one of labels) {
    const other = labels.find((each) => !`${one}/`.startsWith(`${each}/`) && !`${each}/`.startsWith(`${one}/`));
    if (other !== undefined) return [one, other];
  }
  return [];
}

function flat(nodes) {
  return nodes.flatMap((node) => [node, ...flat(node.below)]);
}
