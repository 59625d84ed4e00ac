// The tasks of a plan as a tree: with their windows while it is tailored, with their states while it is played.

import { act_text, task_nodes } from "./played.js";
import { make, seconds } from "./parts.js";
import { Tree } from "./tree.js";

const SIGNS = { waiting: "○", running: "▶", done: "✓", failed: "✗", terminated: "■", "given up": "–" };

/** A tree of tasks. */
export class Tasks {
  /**
   * @param {HTMLElement} root
   * @param {(node: object) => void} picked
   */
  constructor(root, picked) {
    this.tree = new Tree(root, { draw: (row, node) => this.draw(row, node), picked });
    this.named = {}; // the places that the floor names
    this.windows = {};
    this.states = null;
  }

  /** The name of the task that is selected, or null. */
  get selected() {
    return this.tree.selected;
  }

  /** Show a plan: *windows* by task, and the states of tasks (a Map), or null if it is not being played. */
  show(plan, windows, states) {
    Object.assign(this, { windows: windows ?? {}, states });
    const nodes = task_nodes(plan.root, [...Object.keys(this.windows), ...(states?.keys() ?? [])]);
    this.tree.show(nodes);
    if (states) this.follow(nodes);
    return nodes;
  }

  /** Open what is running, and close it again when it is over; the first levels stay open. */
  follow(nodes) {
    for (const node of nodes) {
      if (!node.open) this.tree.unfold(node.id, this.stand(node).state === "running");
      this.follow(node.below);
    }
  }

  /** State of a task: as received, or that of its parts; a task that was expanded again before it was done is given up. */
  stand(node) {
    const told = this.states.get(node.id);
    if (node.past && told?.state !== "done") return { state: "given up", robot: null, why: "" };
    if (told) return told;
    const parts = node.below.filter((each) => !each.past).map((each) => this.stand(each).state);
    const over = parts.length > 0 && parts.every((state) => state !== "waiting" && state !== "running");
    const state = over ? parts.at(-1) : parts.every((each) => each === "waiting") ? "waiting" : "running";
    return { state, robot: null, why: "" };
  }

  draw(row, node) {
    const parts = [make("b", { textContent: node.label }), make("span", { className: "act", textContent: act_text(node.task?.act, this.named) })];
    if (this.states) {
      const { state, why } = this.stand(node);
      parts.unshift(make("span", { className: `sign ${state}`, textContent: SIGNS[state] ?? "?", title: state, aria: { hidden: true } }));
      parts.push(make("span", { className: "unseen", textContent: state }));
      if (why) parts.push(make("span", { className: "why", textContent: why }));
    } else if (this.windows[node.id]) {
      parts.push(make("span", { className: "window", textContent: window_text(this.windows[node.id]) }));
    }
    const text = parts.map((part) => part.textContent + part.className).join("|");
    if (row.dataset.text === text) return;
    row.dataset.text = text;
    row.replaceChildren(...parts.filter((part) => part.textContent));
  }
}

/** When a task may start and end, in words; *window*: earliest and latest start, earliest and latest end, s. */
export function window_text(window) {
  if (!window) return "";
  const [first, last, soonest, latest] = window;
  return `starts ${span(first, last)}, ends ${span(soonest, latest)}`;
}

function span(from, to) {
  if (to === null || to === undefined) return `from ${seconds(from ?? 0)} on`;
  if (from !== null && Math.abs(to - from) < 0.05) return `at ${seconds(to)}`;
  return `${seconds(from ?? 0).replace(" s", "")}–${seconds(to)}`;
}
