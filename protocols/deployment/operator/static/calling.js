// Calling a play: the tree of plays, the parameters of the chosen one, Execute and Tailor, and what the planner answers.

import { Form, title } from "./form.js";
import { button, make } from "./parts.js";
import { Tailor } from "./tailor.js";
import { Tree } from "./tree.js";

const CHECK_MS = 350;

/** The upper left part of the page, and the tailoring at the right. */
export class Calling {
  /**
   * @param {(id: string) => HTMLElement} find
   * @param {{picker: object, ask: (request: object) => Promise<object>, executed: () => void, tailored: () => void,
   *   trouble: (why: string) => void, changed: () => void}} told
   */
  constructor(find, told) {
    this.find = find;
    this.told = told;
    this.size = 0;
    this.chosen = null;
    this.tailoring = null; // path of the play that is being tailored
    this.parameters = {}; // of that play: the form may be that of another one by now
    this.timer = 0;
    this.asked = 0;
    this.tree = new Tree(find("plays"), { draw: draw_play, picked: (node) => this.choose(node) });
    this.form = new Form(find("form"), told.picker, () => this.filled());
    this.tailor = new Tailor(find, told.picker, (wanted) => (wanted ? this.check(true) : this.check_soon()));
    new ResizeObserver(() => this.chosen && this.tree.reveal(this.chosen.id)).observe(find("plays")); // other parts take space from it
    find("execute").addEventListener("click", () => this.execute());
    find("tailor").addEventListener("click", () => this.begin());
    find("execute-tailored").addEventListener("click", () => this.execute_tailored());
    find("check").addEventListener("click", () => this.check(true));
    find("refusal-close").addEventListener("click", () => this.hide_refusal());
  }

  /** Take the tree of plays. */
  know_plays(tree) {
    this.find("plays-wait").hidden = true;
    if (!this.chosen) this.find("calling-about").textContent = "Choose one above, at any level of the tree.";
    this.tree.show(tree.map((branch) => play_node(branch, null)));
  }

  /** Take the named places of the floor, and the number of robots. */
  know_floor(named, size) {
    this.size = size;
    this.tailor.named = this.tailor.tasks.named = named;
    this.form.know(named, size);
  }

  /** The points on the floor that have been chosen. */
  points() {
    return this.form.points();
  }

  choose(node) {
    this.chosen = node;
    this.find("calling-title").textContent = node.id;
    this.find("calling-about").textContent = this.find("calling-about").title = node.about;
    this.form.show(node.id, node.parameters);
    this.form.mark([]);
    this.say_missing([]);
    this.hide_refusal();
    this.tree.reveal(node.id);
    this.find("execute").disabled = this.find("tailor").disabled = false;
    this.told.changed();
  }

  /** Show what a changed field affects: the places on the floor, and the plan that is being tailored. */
  filled() {
    this.told.changed();
    this.hide_refusal(); // it was about the values before
    this.say_missing(this.form.marked());
    if (this.tailoring === null || this.tailoring !== this.chosen?.id) return;
    this.parameters = this.form.given();
    this.tailor.keep_roles(this.form.roles(), this.size);
    this.check_soon();
  }

  // ------------------------------------------------------------ calling

  async execute() {
    const answer = await this.call({ play: this.chosen.id, parameters: this.form.given() }, true);
    if (answer?.say === "plan") this.done();
  }

  /** Begin to tailor the chosen play. */
  begin() {
    this.tailoring = this.chosen.id;
    this.parameters = this.form.given();
    this.tailor.reset(this.form.roles(), this.size);
    this.find("tailor-none").hidden = true;
    this.find("tailor-part").hidden = false;
    this.find("tailor-title").textContent = `Tailoring ${this.tailoring}`;
    this.told.tailored();
    this.check(true);
  }

  check_soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.check(false), CHECK_MS);
  }

  /** Have the planner make a plan of what is asked for so far; *wanted*: its answer gets focus, since the user asked for it. */
  async check(wanted) {
    clearTimeout(this.timer);
    if (this.tailoring === null) return null;
    this.asked += 1;
    const number = this.asked;
    const answer = await this.call(this.tailored(), false, wanted);
    if (number !== this.asked || answer === null) return null; // something else has been asked for since
    if (answer.say === "plan") {
      this.hide_refusal();
      this.tailor.show_plan(answer);
    } else {
      this.tailor.show_none();
    }
    return answer;
  }

  tailored() {
    return { play: this.tailoring, parameters: this.parameters, ...this.tailor.additions() };
  }

  async execute_tailored() {
    const answer = await this.call(this.tailored(), true);
    if (answer?.say === "plan") this.done();
    else this.tailor.show_none();
  }

  done() {
    this.hide_refusal();
    this.told.picker.want(null);
    this.told.executed();
  }

  /** Ask for a plan; return the answer, null if there is none. A refusal is shown, with focus if the user asked for it. */
  async call(call, execute, wanted = true) {
    const buttons = ["execute", "tailor", "execute-tailored"].map(this.find);
    const before = document.activeElement;
    if (execute) for (const each of buttons) each.disabled = true;
    try {
      const answer = await this.told.ask({ say: "call", call, execute });
      const { conflicts = [answer.why], mend = [], calls = {}, missing = [] } = answer;
      if (answer.say !== "plan" && !this.ask_for_missing(call.play, missing, wanted)) this.show_refusal(call.play, { conflicts, mend, calls }, wanted);
      return answer;
    } catch (error) {
      this.told.trouble(error.message);
      return null;
    } finally {
      for (const each of buttons) each.disabled = false;
      if (execute && document.activeElement === document.body && buttons.includes(before)) before.focus();
    }
  }

  // ------------------------------------------------------------ refusals

  /** Point at the parameters *missing* of *play* in its form; return whether there are any. */
  ask_for_missing(play, missing, focused) {
    const names = missing.filter((name) => this.form.parameters[name]);
    if (play !== this.chosen?.id || !names.length) return false;
    this.hide_refusal();
    this.say_missing(names);
    this.form.mark(names, focused);
    return true;
  }

  say_missing(names) {
    const wants = (kind) => names.some((name) => this.form.parameters[name].kind.startsWith(kind));
    const click = names.includes(this.form.next()) ? "Click letters on the floor" : "Press Pick there"; // a click still goes elsewhere
    const how = wants("place") ? ` ${click}, or choose names.` : wants("robots") ? " Say how many, or which." : "";
    this.find("missing").textContent = names.length ? `Still to be filled in: ${names.map(title).join(", ")}.${how}` : "";
  }

  /** Show why *play* is refused, and what would mend it: with a button, if another call does. */
  show_refusal(play, { conflicts, mend, calls }, focused) {
    const items = (texts) => texts.map((text) => make("li", { children: [text, ...this.doing(calls[text])] }));
    this.find("refusal-title").textContent = `${play} cannot be played like this`;
    this.find("conflicts").replaceChildren(...items(conflicts));
    this.find("mend").replaceChildren(...items(mend));
    this.find("mend-part").hidden = !mend.length;
    this.find("refusal").hidden = false;
    if (!focused) return;
    this.find("refusal").focus();
    this.find("refusal").scrollIntoView({ block: "nearest" });
  }

  /** The button that has a call tailored as a mend says. */
  doing(call) {
    if (!call || this.tailoring !== call.play) return [];
    return [" ", button("Do that", () => {
      this.tailor.take(call);
      this.check(true);
      this.find("check").focus();
    })];
  }

  hide_refusal() {
    this.find("refusal").hidden = true;
  }
}

/** A play, a folder of plays, or a task of a play as a node of the tree; tasks have the parameters of their play. */
function play_node(branch, play) {
  const below = branch.plays ?? branch.tasks ?? [];
  const task = play !== null;
  const own = { path: branch.path, parameters: branch.parameters ?? {}, about: branch.about ?? "" };
  const nodes = below.map((each) => play_node(each, branch.plays ? null : play ?? own));
  const parameters = branch.plays ? shared(nodes) : (play ?? own).parameters;
  const about = task ? `A task of ${play.path}: ${branch.kind}.` : own.about;
  return { id: branch.path, name: branch.name, about, parameters, below: nodes, open: Boolean(branch.plays), task, kind: branch.kind };
}

/** The parameters that all plays of a folder have. */
function shared(nodes) {
  const [first, ...others] = nodes.map((node) => node.parameters);
  const names = Object.keys(first ?? {}).filter((name) => others.every((each) => each[name]?.kind === first[name].kind));
  return Object.fromEntries(names.map((name) => [name, first[name]]));
}

function draw_play(row, node) {
  if (row.dataset.text === node.id) return;
  row.dataset.text = node.id;
  row.title = node.about;
  row.replaceChildren(make(node.task ? "span" : "b", { className: node.task ? "task" : "", textContent: node.name }));
}
