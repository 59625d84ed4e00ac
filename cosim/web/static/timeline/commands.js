// What one can do with the timeline: each has a button and a key.

import { element } from "./dom.js";

const ZOOM = 1.5;
const PAN = 0.2; // of the window

/** The commands of a timeline: [id, sign on its button, title, keys, action, whether it is on (of a switch)] in groups. */
export function commands(timeline) {
  const { axis, finder, markers, measure } = timeline;
  const width = () => axis.width_px;
  const at = () => finder.pointer?.[0] ?? width() / 2;
  return [
    [
      ["in", "+", "Zoom in", ["w", "+", "="], () => axis.zoom(ZOOM, at())],
      ["out", "−", "Zoom out", ["s", "-"], () => axis.zoom(1 / ZOOM, at())],
      ["left", "◀", "Earlier", ["a", "Shift ArrowLeft"], () => axis.pan(-PAN * width())],
      ["right", "▶", "Later", ["d", "Shift ArrowRight"], () => axis.pan(PAN * width())],
      ["all", "whole", "The whole run", ["0"], () => axis.all()],
      ["fit", "fit", "Fit what is pinned, or between the cursors", ["f"], () => measure.fit()],
      ["follow", "follow", "Follow the time of the run", ["o"], () => timeline.follow(), () => axis.follow],
    ],
    [
      ["lost-before", "‹ lost", "Lost frame before", ["Shift L"], () => finder.find({ lost: true, back: true })],
      ["lost-next", "lost ›", "Next lost frame", ["l"], () => finder.find({ lost: true })],
      ["kind-before", "‹ kind", "Before, of the same kind", ["p"], () => finder.find({ alike: true, back: true })],
      ["kind-next", "kind ›", "Next of the same kind", ["n"], () => finder.find({ alike: true })],
      ["box-before", "‹ box", "Box before in this lane", ["ArrowLeft"], () => finder.find({ here: true, back: true })],
      ["box-next", "box ›", "Next box in this lane", ["ArrowRight"], () => finder.find({ here: true })],
      ["lane-before", "▲", "Lane above", ["ArrowUp"], () => timeline.walk(-1)],
      ["lane-next", "▼", "Lane below", ["ArrowDown"], () => timeline.walk(1)],
      ["only", "this robot", "Find only what is of the robot of this lane", ["r"], () => finder.restrict(), () => finder.only],
    ],
    [
      ["cursor-1", "1", "Cursor 1 here", ["1"], () => measure.put_here(0)],
      ["cursor-2", "2", "Cursor 2 here", ["2"], () => measure.put_here(1)],
      ["cursors-off", "✕", "No cursors", ["x"], () => measure.clear()],
      ["mark", "mark", "Marker here, to be named", ["m"], () => markers.put_here()],
      ["mark-before", "‹ mark", "Marker before", ["["], () => markers.walk(-1)],
      ["mark-next", "mark ›", "Next marker", ["]"], () => markers.walk(1)],
      ["go", "go", "Have the run at this time", ["t"], () => timeline.go()],
      ["channels", "channels", "By RF channel", ["c"], () => timeline.show_channels(), () => timeline.rows.by_channel],
      ["piconets", "piconets", "Strips of the piconets", ["b"], () => timeline.show_piconets(), () => timeline.rows.piconets && timeline.rows.has_piconets],
      ["curves", "curves", "Curves under the lanes", ["v"], () => timeline.plots.toggle(), () => timeline.plots.shown],
      ["tall", "tall", "Most of the page for the timeline", ["g"], () => timeline.stretch(), () => timeline.split.tall],
    ],
  ];
}

/** The buttons of the commands, and their keys while the focus is on an element. */
export class Controls {
  /**
   * @param {HTMLElement} bar
   * @param {HTMLElement} focus
   * @param {ReturnType<typeof commands>} groups
   */
  constructor(bar, focus, groups) {
    this.switches = [];
    this.keys = new Map();
    for (const group of groups) {
      const buttons = group.map(([id, sign, title, keys, act, on]) => this.add(id, sign, title, keys, act, on));
      bar.append(element("span", { className: "tl-group" }, ...buttons));
    }
    this.buttons = [...bar.querySelectorAll("button")];
    this.buttons.forEach((button, number) => (button.tabIndex = number ? -1 : 0)); // the bar is one stop of the tabulator
    bar.addEventListener("keydown", (event) => this.walk(event));
    bar.addEventListener("focusin", (event) => this.enter(event.target));
    focus.addEventListener("keydown", (event) => this.key(event));
  }

  /** Go from button to button by arrows. */
  walk(event) {
    const shown = this.buttons.filter((button) => button.offsetParent); // a small screen lacks some
    const at = shown.indexOf(event.target);
    const last = shown.length - 1;
    const to = { ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: last }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const button = shown[Math.min(last, Math.max(0, to))];
    button.focus();
    button.scrollIntoView({ block: "nearest", inline: "nearest" }); // the focus leaves it cut off, if a part was seen
  }

  /** Have the tabulator come back to the button that has the focus. */
  enter(target) {
    for (const button of this.buttons) button.tabIndex = button === target ? 0 : -1;
  }

  add(id, sign, title, keys, act, on) {
    const names = keys.map((key) => key.replace(" ", "+"));
    const button = element("button", { type: "button", id: `tl-${id}`, title: `${title} (${names.join(", ")})` }, sign);
    // a name begins with what is written on it, if that is a word
    button.setAttribute("aria-label", /^[\w ]+$/.test(sign.replace(/[‹›]/g, "")) ? `${sign}: ${title}` : title);
    button.addEventListener("click", act);
    for (const key of keys) this.keys.set(key, act);
    if (on) this.switches.push([button, on]);
    return button;
  }

  /** Show which switches are on. */
  show() {
    for (const [button, on] of this.switches) {
      const pressed = String(Boolean(on()));
      if (button.getAttribute("aria-pressed") !== pressed) button.setAttribute("aria-pressed", pressed);
    }
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const shift = event.shiftKey && (event.key.length > 1 || event.key.toLowerCase() !== event.key) ? "Shift " : "";
    const act = this.keys.get(`${shift}${event.key}`) ?? this.keys.get(event.key);
    if (!act) return;
    event.preventDefault();
    event.stopPropagation(); // the controls of time have some of the same keys
    act(event);
  }
}
