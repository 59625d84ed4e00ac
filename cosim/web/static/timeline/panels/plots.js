// Curves under the lanes, on the same axis: those that are chosen, of the robot that is selected or of the whole team.

import { read, write } from "../../address.js";
import { Asking } from "../asking.js";
import { seconds } from "../axis.js";
import { element, table } from "../dom.js";
import { sent } from "../wire.js";

const PART_PX = 2; // width of a part of the window in which things are counted
const MOST_PARTS = 2000; // that the server takes in a request, and some
const TALL_PX = 26; // of a curve
const MOST_CHOSEN = 8;
const MOST_ROWS = 100;
const FIRST = ["delivered", "lost"];
const GROUPS = { state: "States", event: "Events", metric: "Metrics of the run" };

/** The curves on their canvas, what they are at the run's time, as text and as a table, and the choice of them. */
export class Plots {
  /** @param {import("../timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.canvas = element("canvas", { "aria-hidden": "true" });
    this.words = element("div", { className: "tl-values", role: "group", "aria-label": "Curves at the run's time", tabIndex: 0 });
    this.root = element("div", { className: "tl-plots" }, this.words, this.canvas);
    this.choice = element("div", { className: "tl-curves" });
    this.listing = element("div", { className: "tl-listing", tabIndex: 0, role: "region", "aria-label": "Curves as a table" });
    this.listed = element("details", {}, element("summary", {}, "Curves as a table"), this.listing);
    this.chooser = element("details", {}, element("summary", {}, "Curves"), this.choice);
    this.listed.addEventListener("toggle", () => this.list());
    this.asking = new Asking(timeline, () => this.want());
    this.known = [];
    this.restore();
  }

  /** Take the curves that there are. */
  take_known(curves) {
    if (curves.length === this.known.length && curves.every(({ name }, at) => name === this.known[at].name)) return;
    this.known = curves;
    this.show_choice();
    this.want();
  }

  /** Take the choice from the address: names, or that none are to be seen; without it the first ones, if there is room. */
  restore() {
    const words = read("curves");
    this.hidden = words === "none";
    this.chosen = words === null || this.hidden ? null : words.split(",").slice(0, MOST_CHOSEN);
    this.show_choice();
  }

  get names() {
    const there = new Set(this.known.map(({ name }) => name));
    return (this.chosen ?? FIRST).filter((name) => there.has(name));
  }

  get shown() {
    return this.root.offsetParent !== null;
  }

  /** Show the curves even where there is little room, or hide them. */
  toggle() {
    const shown = this.shown;
    this.hidden = shown;
    if (!shown) this.chosen ??= [...this.names];
    this.chooser.open ||= !shown;
    this.changed();
  }

  /** Add a curve to those that are chosen, or take it out. */
  choose(name) {
    const names = this.hidden ? [] : this.names;
    const chosen = names.includes(name) ? names.filter((each) => each !== name) : [...names, name];
    if (chosen.length > MOST_CHOSEN) {
      this.timeline.say(`At most ${MOST_CHOSEN} curves are shown.`);
      return;
    }
    this.hidden = chosen.length === 0;
    this.chosen = chosen.length ? chosen : null;
    this.changed();
  }

  changed() {
    write({ curves: this.hidden ? "none" : (this.chosen?.join(",") ?? null) });
    this.show_choice();
    this.timeline.resize();
    this.timeline.controls.show();
    this.want();
  }

  show_choice() {
    this.root.classList.toggle("tl-none", this.hidden);
    this.root.classList.toggle("tl-always", this.chosen !== null);
    const names = this.hidden ? [] : this.names;
    if (this.choice.childElementCount === 0 || this.drawn_known !== this.known) {
      this.drawn_known = this.known;
      const groups = Map.groupBy(this.known, ({ name }) => GROUPS[name.split(":")[0]] ?? "Of frames and messages");
      this.choice.replaceChildren(...[...groups].flatMap(([title, members]) =>
        [element("h4", {}, title), element("ul", { className: "tl-kinds" }, ...members.map((curve) => this.switch(curve)))]));
    }
    for (const button of this.choice.querySelectorAll("button")) {
      button.setAttribute("aria-pressed", String(names.includes(button.value)));
    }
    this.paint();
  }

  switch({ name, title, unit, meaning }) {
    const about = `${meaning}${unit && unit !== "1" ? ` (${unit})` : ""}`;
    const button = element("button", { type: "button", value: name, title: about, "aria-pressed": "false" }, title);
    button.addEventListener("click", () => this.choose(name));
    return element("li", {}, button);
  }

  // ------------------------------------------------------------ messages

  /** What the server has answered last. */
  get answer() {
    return this.asking.answer;
  }

  /** Ask for what is in the window. */
  want() {
    const { timeline, names } = this;
    const { axis, selected } = timeline;
    if (!timeline.begun || !names.length || !(this.shown || this.listed.open)) return;
    const step_ns = Math.max(1, Math.ceil(Math.max(PART_PX * axis.ns_per_px, axis.span_ns / MOST_PARTS)));
    const from_ns = Math.floor(axis.from_ns / step_ns) * step_ns; // so that parts stay where they are when the window moves
    const to_ns = Math.max(from_ns + step_ns, Math.ceil(axis.to_ns));
    const window = { from_ns: sent(from_ns), to_ns: sent(to_ns), step_ns: sent(step_ns) };
    this.asking.want(`${from_ns} ${axis.to_ns} ${step_ns} ${selected} ${names}`, { say: "curves", names, robot: selected, ...window });
  }

  take(message) {
    if (!this.asking.take(message)) return;
    const curves = new Map(message.curves.map((curve) => [curve.name, curve]));
    Object.assign(this.answer, { curves, from_ns: Number(message.from_ns), step_ns: Number(message.step_ns) });
    this.paint();
    this.list();
    this.want();
  }

  // ------------------------------------------------------------ drawing

  paint() {
    const { answer, canvas, names } = this;
    const { axis, kinds } = this.timeline;
    const high = TALL_PX * Math.max(1, names.length);
    canvas.style.height = `${high}px`;
    canvas.style.width = `${axis.width_px}px`; // as wide as the lanes
    if (!answer || !this.shown) return;
    const ratio = window.devicePixelRatio || 1;
    const size = [axis.width_px, high].map((px) => Math.round(px * ratio));
    if (size[0] !== canvas.width || size[1] !== canvas.height) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, axis.width_px, high);
    names.forEach((name, row) => {
      const curve = answer.curves.get(name);
      if (curve) this.paint_curve(pen, curve, (row + 1) * TALL_PX, name === "lost" ? kinds.paint.bad : kinds.paint.accent);
      pen.fillStyle = kinds.paint.line;
      pen.fillRect(0, (row + 1) * TALL_PX - 1, axis.width_px, 1);
    });
    this.tell();
  }

  /** Draw a curve that stands on a height: an area, or where parts have least and greatest values, a band around it. */
  paint_curve(pen, { mean, least, most }, bottom, colour) {
    const { axis } = this.timeline;
    const { from_ns, step_ns } = this.answer;
    const [low, top] = extent(mean, least, most);
    const place = (value) => bottom - 1 - ((value - low) / (top - low || 1)) * (TALL_PX - 4);
    const wide = Math.max(1, step_ns / axis.ns_per_px);
    pen.fillStyle = colour;
    mean.forEach((value, at) => {
      const begin_ns = from_ns + at * step_ns;
      if (value === null || begin_ns > axis.last_ns) return;
      const x = axis.place(begin_ns);
      if (least === null) {
        pen.fillRect(x, place(value), wide, bottom - 1 - place(value));
        return;
      }
      pen.globalAlpha = 0.35;
      pen.fillRect(x, place(most[at]), wide, Math.max(1, place(least[at]) - place(most[at])));
      pen.globalAlpha = 1;
      pen.fillRect(x, place(value) - 0.75, Math.max(2, wide), 1.5);
    });
  }

  /** Tell what the curves are at the run's time, and between what they are in the window. */
  tell() {
    const { answer, names } = this;
    const { now_ns, axis } = this.timeline;
    const at = Math.floor((now_ns - answer.from_ns) / answer.step_ns);
    const lines = names.map((name) => {
      const curve = answer.curves.get(name);
      const { title, unit } = this.known.find((each) => each.name === name);
      const [low, top] = curve ? extent(curve.mean, curve.least, curve.most) : [0, 0];
      const here = now_ns <= axis.to_ns && now_ns >= axis.from_ns ? curve?.mean[at] : undefined;
      const measure = unit === "1" || unit === "1/s" ? "" : ` ${unit}`;
      return [`${title} ${number(here)}`, `${number(low)} to ${number(top)}${measure}`];
    });
    const text = lines.flat().join("\n") + this.of;
    if (this.told === text) return;
    this.told = text;
    this.words.replaceChildren(...lines.map(([first, second]) => element("div", { title: `${first}, ${second}` }, first, element("span", {}, second))));
    this.words.title = `Curves${this.of}`;
  }

  get of() {
    const { robot } = this.answer;
    return robot === null ? " of the whole team" : ` of ${this.timeline.stations.called(robot)}`;
  }

  /** Put the curves into a table, if it is open. */
  list() {
    const { answer, names } = this;
    if (!this.listed.open) return;
    if (!answer) {
      this.want();
      return;
    }
    const curves = names.map((name) => [this.known.find((each) => each.name === name), answer.curves.get(name)]);
    const count = Math.max(0, ...curves.map(([, curve]) => curve?.mean.length ?? 0));
    const every = Math.ceil(count / MOST_ROWS);
    const rows = [];
    for (let at = 0; at < count; at += every) {
      const cells = curves.map(([, curve]) => told(curve, at));
      rows.push([`${seconds(answer.from_ns + at * answer.step_ns)} s`, ...cells]);
    }
    const parts = `${every > 1 ? `each ${every}th of the ` : ""}parts of ${seconds(answer.step_ns)} s`;
    const heads = curves.map(([{ title, unit }]) => (unit && unit !== "1" && unit !== "1/s" ? `${title} (${unit})` : title));
    this.listing.replaceChildren(table(`Curves${this.of}: ${parts}`, ["from", ...heads], rows));
  }
}

/** What a curve is in a part, in words: its mean, and its least and greatest value where these differ. */
function told(curve, at) {
  const [mean, least, most] = [curve?.mean[at], curve?.least?.[at], curve?.most?.[at]];
  return typeof least === "number" && least !== most ? `${number(mean)} (${number(least)} to ${number(most)})` : number(mean);
}

/** The least and the greatest value of a curve; an area begins at 0. */
function extent(mean, least, most) {
  let [low, top] = least === null ? [0, 0] : [Infinity, -Infinity];
  const [below, above] = [least ?? mean, most ?? mean];
  for (let at = 0; at < mean.length; at += 1) {
    if (below[at] !== null && below[at] < low) low = below[at];
    if (above[at] !== null && above[at] > top) top = above[at];
  }
  return low <= top ? [low, top] : [undefined, undefined];
}

const number = (value) => (value === undefined || value === null ? "–" : String(Number(value.toPrecision(3))));
