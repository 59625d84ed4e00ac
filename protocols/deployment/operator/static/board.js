// What is being played: the tree of its tasks and their states, a change of strategy, termination; and the two tabs.

import { STRATEGIES } from "./form.js";
import { duration, make, seconds } from "./parts.js";
import { Tasks } from "./tasks.js";

const TABS = ["played", "tailored"];

/** The right part of the page. */
export class Board {
  /**
   * @param {(id: string) => HTMLElement} find
   * @param {import("./played.js").Played} played
   * @param {{ask: (request: object) => Promise<object>, trouble: (why: string) => void}} told
   */
  constructor(find, played, told) {
    Object.assign(this, { find, played, told });
    this.tasks = new Tasks(find("tasks"), () => this.show_controls());
    for (const [value, text] of STRATEGIES) find("strategy").add(new Option(text, value));
    find("switch").addEventListener("click", () => this.command({ say: "switch", strategy: find("strategy").value }));
    find("terminate").addEventListener("click", () => this.command({ say: "terminate", task: this.tasks.selected ?? "" }));
    for (const name of TABS) {
      find(`tab-${name}`).addEventListener("click", () => this.show_tab(name));
      find(`tab-${name}`).addEventListener("keydown", (event) => this.key(event, name));
    }
  }

  show_tab(name) {
    for (const each of TABS) {
      const tab = this.find(`tab-${each}`);
      tab.setAttribute("aria-selected", String(each === name));
      tab.tabIndex = each === name ? 0 : -1;
      this.find(each).hidden = each !== name;
    }
  }

  key(event, name) {
    if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
    event.preventDefault();
    event.stopPropagation();
    const other = TABS.find((each) => each !== name);
    this.show_tab(other);
    this.find(`tab-${other}`).focus();
  }

  async command(request) {
    try {
      const answer = await this.told.ask(request);
      if (answer.say === "error") this.told.trouble(answer.why);
    } catch (error) {
      this.told.trouble(error.message);
    }
  }

  /** Show that a play has begun or ended, and choose the strategy of its plan. */
  begun() {
    const { current } = this.played;
    const broken = current?.breaches.length ? `; not kept: ${current.breaches.at(-1)}` : "";
    if (current) this.write("news", `plan ${current.number}, ${current.plan.play}: ${current.result || "is being played"}${broken}`);
    const first = current && deployments(current.plan.root).find(({ strategy }) => STRATEGIES.some(([value]) => value === strategy));
    if (first && document.activeElement !== this.find("strategy")) this.find("strategy").value = first.strategy;
  }

  /** Show the state of the play at *now_s*. */
  show(now_s) {
    const { current } = this.played;
    this.find("played-controls").hidden = !this.played.running;
    if (!current) {
      this.write("played-title", "Nothing is being played");
      this.write("played-state", "Choose a play, tell it what it wants to know, and execute it.");
      this.find("breaches").replaceChildren();
      this.tasks.tree.show([]);
      return;
    }
    this.write("played-title", `Plan ${current.number}: ${current.plan.play}`);
    this.write("played-state", standing(current, now_s));
    const breaches = current.breaches.map((why) => make("li", { textContent: `not kept: ${why}` }));
    if (this.find("breaches").childElementCount !== breaches.length) this.find("breaches").replaceChildren(...breaches);
    this.tasks.show(current.plan, current.windows, current.tasks);
    this.show_controls();
  }

  show_controls() {
    const task = this.tasks.selected;
    const { current } = this.played;
    if (!current) return;
    const whole = task === null || task === current.plan.root.name;
    this.write("terminate", whole ? "Terminate all" : `Terminate ${task.split("/").pop()}`);
    const none = deployments(current.plan.root).length === 0;
    this.find("switch").disabled = this.find("strategy").disabled = none;
  }

  write(id, text) {
    if (this.find(id).textContent !== text) this.find(id).textContent = text;
  }
}

function standing(current, now_s) {
  const { result, expected_s, since_s, ended_s } = current;
  const about = expected_s === undefined ? "" : `, ${expected_s === null ? "" : "expected "}${duration(current)}`;
  if (result) return `${result}${ended_s !== null && since_s !== null ? ` after ${seconds(ended_s - since_s)}` : ""}${about}`;
  return `running${since_s === null ? "" : ` for ${Math.floor(now_s - since_s)} s`}${about}`;
}

function deployments(task) {
  const own = task.act?.act === "deploy" ? [task.act] : [];
  return [...own, ...task.subtasks.flatMap(deployments)];
}
