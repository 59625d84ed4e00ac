// How much of the page is the timeline's: its upper edge can be dragged, or moved by arrows.

import { element } from "./dom.js";

const [LEAST, USUAL, TALL, MOST] = [22, 48, 80, 90]; // percent of the page's middle part
const STEP = 4;

/** The upper edge of the timeline. */
export class Split {
  /** @param {HTMLElement} whole what the timeline has a part of */
  constructor(whole) {
    this.whole = whole;
    this.grip = element("div", {
      className: "tl-grip", role: "separator", tabIndex: 0, "aria-label": "Height of the timeline", "aria-orientation": "horizontal",
      "aria-valuemin": LEAST, "aria-valuemax": MOST, title: "Drag: height of the timeline",
    });
    this.grip.addEventListener("pointerdown", (event) => this.grip.setPointerCapture(event.pointerId));
    this.grip.addEventListener("pointermove", (event) => this.drag(event));
    this.grip.addEventListener("keydown", (event) => this.key(event));
    this.show(USUAL);
  }

  /** Whether the timeline has most of the page. */
  get tall() {
    return this.percent >= TALL;
  }

  /** Give the timeline most of the page, or its usual part. */
  toggle() {
    this.show(this.tall ? USUAL : TALL);
  }

  show(percent) {
    this.percent = Math.round(Math.min(MOST, Math.max(LEAST, percent)));
    this.whole.style.setProperty("--timeline", `${this.percent}%`);
    this.grip.setAttribute("aria-valuenow", String(this.percent));
  }

  drag(event) {
    if (!this.grip.hasPointerCapture(event.pointerId)) return;
    const { bottom, height } = this.whole.getBoundingClientRect();
    this.show((100 * (bottom - event.clientY)) / height);
  }

  key(event) {
    const by = { ArrowUp: STEP, ArrowDown: -STEP }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    this.show(this.percent + by);
  }
}
