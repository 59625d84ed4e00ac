// What is being played, as all pages receive it: plans that were made, the one that is executed, states of its tasks.

const SAME_M = 0.05; // a point this near to a place is that place

/** Follows the host's console. */
export class Played {
  /** @param {() => void} unknown is called when something is being played of which no plan was received */
  constructor(unknown) {
    this.unknown = unknown;
    this.forget();
  }

  forget() {
    this.plans = new Map();
    this.current = null;
  }

  /** True if something is being played now. */
  get running() {
    return this.current !== null && this.current.result === "";
  }

  /** Take what the host has sent at *time_s*; return whether anything has changed. */
  take(message, time_s) {
    switch (message.say) {
      case "plan":
        this.plans.set(message.plan.number, message);
        if (message.executed) this.begin(message, time_s);
        return Boolean(message.executed);
      case "executing":
        if (!this.plans.has(message.plan)) return this.miss();
        this.begin(this.plans.get(message.plan), time_s);
        return true;
      case "state":
        return this.stands(message);
      case "task":
        if (message.plan !== this.current?.number) return this.miss();
        this.current.tasks.set(message.task, { state: message.state, robot: message.robot, why: message.why });
        return true;
      case "breach":
        if (message.plan !== this.current?.number) return false;
        this.current.breaches.push(message.why);
        return true;
      case "ended":
        if (message.plan !== this.current?.number) return false;
        Object.assign(this.current, { result: message.result, ended_s: time_s });
        return true;
      default:
        return false;
    }
  }

  begin({ plan, expected_s, windows }, time_s) {
    check(plan.root);
    this.current = {
      number: plan.number,
      plan,
      expected_s,
      windows: windows ?? {},
      tasks: new Map(),
      breaches: [],
      result: "",
      since_s: time_s,
      ended_s: null,
    };
  }

  /** Take an answer with the whole state: for a page that was opened late, or after a change of host. */
  stands({ plan, tasks }) {
    if (plan === null) return false;
    const known = this.plans.get(plan.number);
    if (this.current?.number !== plan.number) this.begin({ ...known, plan }, null);
    for (const [task, state] of Object.entries(tasks)) {
      if (this.current.tasks.get(task)?.state !== state) this.current.tasks.set(task, { state, robot: null, why: "" });
    }
    const root = tasks[plan.root.name];
    if (["done", "failed", "terminated"].includes(root) && this.current.result === "") this.current.result = root;
    return true;
  }

  miss() {
    this.unknown();
    return false;
  }
}

/** Throw a TypeError unless this is a task. */
function check(task) {
  if (typeof task?.name !== "string" || !Array.isArray(task.subtasks)) throw new TypeError("this is no task");
  task.subtasks.forEach(check);
}

/**
 * The tasks of a plan as nodes of a tree. What the executive expands a deployment into is not in the plan: only windows
 * and states have the *names* of these tasks, which say where in the tree they are. `deploy~2` is the expansion of deploy
 * after robots were lost or the strategy was switched: it is below deploy, and what was expanded before is `past`.
 */
export function task_nodes(root, names) {
  const nodes = new Map();
  const top = task_node(root, nodes, 0);
  for (const name of names) {
    if (nodes.has(name) || !name.startsWith(`${root.name}/`)) continue;
    const parts = name.split("/");
    for (let count = root.name.split("/").length + 1; count <= parts.length; count += 1) {
      add_node(nodes, parts.slice(0, count).join("/"));
    }
  }
  return [top];
}

function add_node(nodes, id) {
  if (nodes.has(id)) return;
  const [first, ...others] = id.split("~");
  const again = others.length > 0 && !others.at(-1).includes("/");
  const above = nodes.get(again ? first : id.slice(0, id.lastIndexOf("/")));
  if (!above) return;
  const name = again ? `made anew (${others.at(-1)})` : id.slice(id.lastIndexOf("/") + 1);
  if (again) above.below.forEach(leave);
  const node = { id, name, label: name, task: null, below: [], open: again, past: false };
  nodes.set(id, node);
  above.below.push(node);
}

function leave(node) {
  node.past = true;
  node.open = false;
  node.below.forEach(leave);
}

function task_node(task, nodes, depth) {
  const label = task.label || task.name.split("/").pop();
  const node = { id: task.name, name: label, label, task, below: [], open: depth < 2, past: false };
  nodes.set(task.name, node);
  node.below = task.subtasks.map((inner) => task_node(inner, nodes, depth + 1));
  return node;
}

/** What a task does, in words; none for one that only has parts. *named*: the named places. */
export function act_text(act, named = {}) {
  const place_text = (point) => name_of(point, named) ?? point_text(point);
  switch (act?.act) {
    case "go": {
      const via = act.via_m.length ? `, over ${act.via_m.map(place_text).join(" and ")}` : "";
      return `robot ${act.robot} to ${place_text(act.place_m)}${via}`;
    }
    case "photo":
      return `robot ${act.robot} takes a picture`;
    case "wait":
      return `${act.seconds} s`;
    case "explore":
      return `robots ${act.robots.join(", ")}`;
    case "deploy":
      return `${act.strategy.replace("_", "-")}: ${act.robots.map((robot, at) => `${robot} to ${place_text(act.places_m[at])}`).join("; ")}`;
    default:
      return act?.robot === undefined ? "" : `robot ${act.robot}: ${act.act}`;
  }
}

/** The final places of robots by a plan: [robot, [x, y]]. */
export function final_places(task) {
  const own = task.act?.act === "deploy" ? task.act.robots.map((robot, at) => [robot, task.act.places_m[at]]) : [];
  const go = task.act?.act === "go" && task.act.final ? [[task.act.robot, task.act.place_m]] : [];
  const below = own.length ? [] : task.subtasks.flatMap(final_places);
  return [...own, ...go, ...below];
}

function point_text([x, y]) {
  return `${Number(x.toFixed(1))}, ${Number(y.toFixed(1))}`;
}

/** The name of a point of the floor, if it has one of its own. */
function name_of([x, y], named) {
  const found = Object.entries(named).find(([, points]) => points.length === 1 && Math.hypot(points[0][0] - x, points[0][1] - y) < SAME_M);
  return found?.[0] ?? null;
}
