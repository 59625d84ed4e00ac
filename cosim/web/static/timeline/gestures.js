// Wheel, drags, two fingers and clicks on the lanes and on the ruler.

const DRAG_PX = 5; // a shorter movement is a click
const WHEEL = 1 / 400;
const LINE_PX = 33; // of a wheel that turns by lines
const GRIP_PX = 9; // a drag on the ruler as near to a cursor as this moves it

/** The pointers on a canvas of the timeline. */
export class Gestures {
  /**
   * @param {HTMLElement} element what the pointers are on
   * @param {import("./timeline.js").Timeline} timeline
   * @param {boolean} ruler whether a click goes to a time, and a drag moves a cursor, instead of a box
   */
  constructor(element, timeline, ruler) {
    this.timeline = timeline;
    this.ruler = ruler;
    this.pointers = new Map();
    this.began = null;
    this.dragged = false;
    this.cursor = null; // number of that which is dragged
    element.style.touchAction = ruler ? "none" : "pan-y";
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    element.addEventListener("pointerdown", (event) => this.down(event));
    element.addEventListener("pointermove", (event) => this.move(event));
    element.addEventListener("pointerup", (event) => this.up(event, true));
    element.addEventListener("pointercancel", (event) => this.up(event, false));
    element.addEventListener("pointerleave", () => timeline.finder.point(null, null));
  }

  wheel(event) {
    event.preventDefault();
    const { axis } = this.timeline;
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? LINE_PX : 1;
    const [across, along] = [event.deltaX * unit, event.deltaY * unit];
    if (event.shiftKey) axis.pan(along || across);
    else if (Math.abs(across) > Math.abs(along)) axis.pan(across);
    else axis.zoom(Math.exp(-along * (event.ctrlKey ? 4 : 1) * WHEEL), this.at(event)[0]);
  }

  at(event) {
    return this.timeline.at(event);
  }

  down(event) {
    if (event.button !== 0) return;
    if (!this.pointers.size) {
      this.began = this.at(event);
      this.dragged = false;
      this.cursor = this.ruler ? this.grip(this.began[0]) : null;
    }
    this.pointers.set(event.pointerId, this.at(event));
  }

  /** The number of the cursor that is near a place. */
  grip(x) {
    const { axis, measure } = this.timeline;
    const far = measure.times.map((ns) => (ns === null ? Infinity : Math.abs(axis.place(ns) - x)));
    const number = far.indexOf(Math.min(...far));
    return far[number] <= GRIP_PX ? number : null;
  }

  move(event) {
    const here = this.at(event);
    if (!this.pointers.has(event.pointerId)) {
      if (event.pointerType !== "touch") this.timeline.finder.point(...here);
      return;
    }
    const before = [...this.pointers.values()];
    this.pointers.set(event.pointerId, here);
    const after = [...this.pointers.values()];
    if (!this.dragged) {
      if (after.length === 1 && Math.hypot(here[0] - this.began[0], here[1] - this.began[1]) < DRAG_PX) return;
      this.dragged = true;
      event.target.setPointerCapture(event.pointerId);
      this.timeline.finder.leave();
    }
    const { axis } = this.timeline;
    if (this.cursor !== null) {
      this.timeline.measure.put(this.cursor, axis.time(here[0]), !event.altKey);
      return;
    }
    const [from, to] = [middle(before), middle(after)];
    if (after.length > 1) axis.zoom(spread(after) / spread(before), from[0]);
    if (to[0] !== from[0]) axis.pan(from[0] - to[0]);
    if (event.pointerType === "mouse") this.timeline.scroll_by(from[1] - to[1]);
  }

  up(event, done) {
    const here = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!here || !done || this.dragged) return;
    if (this.ruler) this.timeline.seek(this.timeline.axis.time(here[0]));
    else this.timeline.finder.pick(...here);
  }
}

function middle(points) {
  return [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
}

/** How far apart the first two of some points are. */
function spread([[x, y], [other_x, other_y]]) {
  return Math.max(8, Math.hypot(x - other_x, y - other_y));
}
