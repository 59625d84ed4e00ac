// Named markers: times that one wants to find again. They are in the address, on the ruler, over the lanes, and listed as text.

import { read, write } from "../../address.js";
import { seconds } from "../axis.js";
import { element } from "../dom.js";

const MOST = 50;
const LONGEST = 40; // letters of a name
const BETWEEN = "|"; // two markers in the address: no name has it

/** The markers of a timeline, and the list of them. */
export class Markers {
  /** @param {import("../timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.list = element("ol", { className: "tl-markers" });
    this.root = element("details", { open: true, hidden: true }, element("summary", {}, "Markers"), this.list);
    this.forget();
  }

  /** Forget the markers: the run is another one. */
  forget() {
    this.all = []; // {ns, name} by time
    this.present = null; // that which was put or jumped to last
    this.show();
  }

  /** Put a marker where a command is about, and have its name typed. */
  put_here() {
    const { timeline } = this;
    if (this.all.length >= MOST) return timeline.say(`There are ${MOST} markers: remove one first.`);
    const ns = Math.max(0, timeline.measure.here_ns);
    const taken = new Set(this.all.map(({ name }) => name));
    const number = [...Array(MOST + 1).keys()].find((at) => !taken.has(`marker ${at + 1}`)) + 1;
    const marker = { ns, name: `marker ${number}` };
    this.all = [...this.all, marker].sort((one, other) => one.ns - other.ns);
    this.present = marker;
    this.changed();
    this.root.open = true;
    this.list.querySelectorAll("input")[this.all.indexOf(marker)].select();
    return timeline.say(`${marker.name} at ${seconds(ns, 9)} s`);
  }

  remove(marker) {
    const at = this.all.indexOf(marker);
    this.all = this.all.filter((each) => each !== marker);
    if (this.present === marker) this.present = null;
    this.changed();
    this.timeline.say(`${marker.name} is removed.`);
    const buttons = this.list.querySelectorAll(".tl-remove");
    (buttons[Math.min(at, buttons.length - 1)] ?? this.timeline.overlay).focus(); // the button that was pressed is gone
  }

  rename(marker, name) {
    marker.name = plain(name) || marker.name;
    this.keep();
    this.timeline.draw();
  }

  /** Have a marker in the middle of the window. */
  jump(marker) {
    const { axis } = this.timeline;
    this.present = marker;
    axis.show(marker.ns - axis.span_ns / 2, marker.ns + axis.span_ns / 2);
    this.timeline.say(`${marker.name} at ${seconds(marker.ns, 9)} s`);
  }

  /** Go to the marker that comes next, or that is before. */
  walk(by) {
    const here = this.present?.ns ?? this.timeline.axis.middle_ns;
    const further = this.all.filter((each) => each !== this.present && (each.ns - here) * by >= 0);
    const marker = by > 0 ? further[0] : further.at(-1);
    if (marker) this.jump(marker);
    else this.timeline.say(this.all.length ? "No further marker." : "There are no markers: m puts one.");
  }

  /** Take the markers that are in the address. */
  restore() {
    const words = (read("markers") ?? "").split(BETWEEN).filter(Boolean).slice(0, MOST);
    const found = words.map((each) => {
      const [time, ...name] = each.split(" ");
      return { ns: Math.round(Number(time || NaN) * 1e9), name: plain(name.join(" ")) || "marker" };
    });
    this.all = found.filter(({ ns }) => ns >= 0).sort((one, other) => one.ns - other.ns);
    this.present = null;
    this.show();
  }

  changed() {
    this.keep();
    this.show();
    this.timeline.draw();
  }

  keep() {
    write({ markers: this.all.map(({ ns, name }) => `${seconds(ns, 9)} ${name}`).join(BETWEEN) || null });
  }

  /** List the markers. */
  show() {
    this.root.hidden = this.all.length === 0;
    this.list.replaceChildren(...this.all.map((marker) => this.item(marker)));
  }

  item(marker) {
    const time = `${seconds(marker.ns, 9)} s`;
    const name = element("input", { type: "text", value: marker.name, maxLength: LONGEST, "aria-label": `Name of the marker at ${time}` });
    name.addEventListener("input", () => this.rename(marker, name.value));
    name.addEventListener("change", () => (name.value = marker.name));
    name.addEventListener("keydown", (event) => {
      event.stopPropagation(); // letters are a name here
      if (event.key === "Enter" || event.key === "Escape") this.timeline.overlay.focus();
    });
    const go = element("button", { type: "button", title: "Have it in the window" }, time);
    go.addEventListener("click", () => this.jump(marker));
    const remove = element("button", { type: "button", className: "tl-remove", "aria-label": `Remove the marker at ${time}` }, "✕");
    remove.addEventListener("click", () => this.remove(marker));
    return element("li", {}, name, go, remove);
  }
}

/** A name as it can be kept. */
const plain = (name) => name.replaceAll(BETWEEN, " ").trim().slice(0, LONGEST);

/** Draw the markers on the ruler: a flag, and the name where there is room up to the next one. */
export function paint_markers(pen, { axis, kinds, markers }, height) {
  const { paint } = kinds;
  pen.font = "600 10.5px system-ui, sans-serif";
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  const seen = markers.all.filter(({ ns }) => ns >= axis.from_ns && ns <= axis.to_ns);
  seen.forEach(({ ns, name }, at) => {
    const x = axis.place(ns);
    const room = (at + 1 < seen.length ? axis.place(seen[at + 1].ns) : axis.width_px) - x - 3;
    const width = Math.min(room, pen.measureText(name).width + 8);
    pen.fillStyle = paint.ink;
    pen.fillRect(x, height - 14, Math.max(5, width), 13);
    pen.fillRect(x - 0.75, height - 14, 1.5, 14);
    if (width < 14) return;
    pen.save();
    pen.beginPath();
    pen.rect(x, height - 14, width, 14);
    pen.clip();
    pen.fillStyle = paint.paper;
    pen.fillText(name, x + 4, height - 7);
    pen.restore();
  });
}
