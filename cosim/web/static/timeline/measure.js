// Two cursors, and the time between them.

import { SLOT_NS, length, seconds } from "./axis.js";
import { snapped } from "./boxes.js";

const SNAP_PX = 5;

/** The cursors of a timeline. */
export class Measure {
  /** @param {import("./timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.forget();
  }

  /** Forget the cursors: the run is another one. */
  forget() {
    this.times = [null, null]; // ns
  }

  /** The time that a command is about: of the pointer, the pin, or the middle of the window. */
  get here_ns() {
    const { axis, finder } = this.timeline;
    if (finder.pointer) return this.snapped(axis.time(finder.pointer[0]));
    return finder.pinned?.start_ns ?? Math.round(axis.middle_ns);
  }

  snapped(ns) {
    const { axis, painter } = this.timeline;
    return snapped(painter, ns, SNAP_PX * axis.ns_per_px);
  }

  /** Put a cursor where a command is about. */
  put_here(number) {
    this.put(number, this.here_ns, false);
  }

  /** Put a cursor at a time; *snap*: at the edge of a box that is near. */
  put(number, ns, snap) {
    const { slot_ns } = this.timeline;
    this.times[number] = snap ? this.snapped(ns) : Math.round(ns);
    const [one, two] = this.times;
    if (one !== null && two !== null) {
      const slots = slot_ns ? `, ${Number(((two - one) / slot_ns).toFixed(4))} slots of ${length(slot_ns)}` : "";
      this.timeline.say(`from cursor 1 to 2: ${seconds(two - one, 9)} s${slots}`);
    } else this.timeline.say(`cursor ${number + 1} at ${seconds(this.times[number], 9)} s`);
    this.timeline.region.ask_soon();
    this.timeline.draw_over();
  }

  /** Take both cursors away. */
  clear() {
    this.forget();
    this.timeline.region.ask();
    this.timeline.say("");
    this.timeline.draw_over();
  }

  /** Fit the window to what is between the cursors, or else to the pin. */
  fit() {
    const { axis, finder } = this.timeline;
    const [one, two] = this.times;
    if (one !== null && two !== null && one !== two) axis.show(Math.min(one, two), Math.max(one, two));
    else if (finder.pinned) {
      const { start_ns, end_ns } = finder.pinned;
      const margin_ns = Math.max(end_ns - start_ns, SLOT_NS) / 2;
      axis.show(start_ns - margin_ns, end_ns + margin_ns);
    }
  }
}
