// Curves under the lanes, on the same axis: payloads delivered, and frames lost, per second.

import { element } from "./dom.js";
import { sent } from "./wire.js";

const PART_PX = 6; // width of a part of the window in which things are counted
const TALL_PX = 48;
const ROWS = [["delivered", "delivered/s", "accent"], ["lost", "lost/s", "bad"]];

/** The curves on their canvas, and what they are at the run's time, as text. */
export class Plots {
  constructor(timeline) {
    this.timeline = timeline;
    this.canvas = element("canvas", { "aria-hidden": "true" });
    this.words = element("output", { "aria-live": "off", "aria-label": "At the run's time" });
    this.root = element("div", { className: "tl-plots" }, this.words, this.canvas);
    this.number = 0;
    this.answer = null;
  }

  /** Ask for what is in the window. */
  ask() {
    const { axis, page } = this.timeline;
    const step_ns = Math.max(1, Math.ceil(PART_PX * axis.ns_per_px));
    this.number += 1;
    const parts = { from_ns: sent(axis.from_ns), to_ns: sent(axis.to_ns), step_ns: sent(step_ns) };
    page.send({ say: "rates", number: this.number, ...parts });
  }

  take(message) {
    if (message.number !== this.number) return;
    this.answer = { ...message, from_ns: Number(message.from_ns), step_ns: Number(message.step_ns) };
    this.paint();
  }

  paint() {
    const { axis, kinds, now_ns } = this.timeline;
    const { canvas, answer } = this;
    if (!answer) return;
    const ratio = window.devicePixelRatio || 1;
    const size = [axis.width_px, TALL_PX].map((px) => Math.round(px * ratio));
    if (size[0] !== canvas.width || size[1] !== canvas.height) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, axis.width_px, TALL_PX);
    const high = TALL_PX / ROWS.length;
    const words = ROWS.map(([name, title, colour], row) => {
      const values = answer[name];
      const most = Math.max(1, ...values);
      const wide = answer.step_ns / axis.ns_per_px;
      pen.fillStyle = kinds.paint[colour];
      values.forEach((value, at) => {
        const tall = (value / most) * (high - 3);
        pen.fillRect(axis.place(answer.from_ns + at * answer.step_ns), (row + 1) * high - tall, Math.max(1, wide - 0.5), tall);
      });
      const rate = (value) => Number(((value * 1e9) / answer.step_ns).toPrecision(3));
      const here = values[Math.floor((now_ns - answer.from_ns) / answer.step_ns)];
      return `${title} ${here === undefined ? "–" : rate(here)}\nat most ${rate(Math.max(0, ...values))}`;
    });
    const text = words.join("\n");
    if (this.words.textContent !== text) this.words.textContent = text;
  }
}
