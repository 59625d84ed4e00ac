// The part of simulated time that the timeline shows. Times are integers of ns, which a number holds exactly for 104 days.

export const SLOT_NS = 625_000; // of Bluetooth
export const TICK_NS = 312_500;
export const DCF_SLOT_NS = 20_000; // of 802.11 DSSS
const LEAST_SPAN_NS = 20_000;
const LEAST_RUN_NS = 1e6;
const FOLLOW_NS = 10e9; // what a run under way shows at first
const AHEAD = 0.9; // share of the window that is before the time that is followed

/** A window on the time of a run, as wide as a canvas. */
export class Axis {
  /** @param {() => void} changed is called after each change of the window */
  constructor(changed) {
    this.changed = changed;
    this.width_px = 1;
    this.begin(0, LEAST_RUN_NS, false);
  }

  /** Show a run anew: all of it, or of one that is under way the beginning. */
  begin(first_ns, last_ns, live) {
    this.first_ns = first_ns;
    this.last_ns = Math.max(last_ns, first_ns + LEAST_RUN_NS);
    this.live = live;
    this.follow = true;
    this.from_ns = first_ns;
    this.span_ns = live ? FOLLOW_NS : this.whole_ns;
    this.changed();
  }

  /** Length of the run, as far as it is known. */
  get whole_ns() {
    return this.last_ns - this.first_ns;
  }

  get to_ns() {
    return this.from_ns + this.span_ns;
  }

  get middle_ns() {
    return this.from_ns + this.span_ns / 2;
  }

  get ns_per_px() {
    return this.span_ns / this.width_px;
  }

  /** Where a time is (px). */
  place(ns) {
    return ((ns - this.from_ns) * this.width_px) / this.span_ns;
  }

  /** Which time is at a place (px). */
  time(px) {
    return this.from_ns + (px * this.span_ns) / this.width_px;
  }

  /** Take more of a run under way. */
  extend(last_ns) {
    if (last_ns > this.last_ns) this.last_ns = last_ns;
  }

  /** Show from one time to another; *follow*: go on following the run's time. */
  show(from_ns, to_ns, follow = false) {
    const most_ns = Math.max(this.whole_ns, this.live ? FOLLOW_NS : 0);
    this.span_ns = Math.min(Math.max(to_ns - from_ns, LEAST_SPAN_NS), most_ns);
    const latest_ns = this.live ? this.last_ns : this.first_ns + most_ns - this.span_ns; // a run under way has a future
    this.from_ns = Math.max(this.first_ns, Math.min((from_ns + to_ns - this.span_ns) / 2, latest_ns));
    this.follow = follow;
    this.changed();
  }

  /** Show *factor* times less, and keep the time at a place where it is. */
  zoom(factor, at_px = this.width_px / 2) {
    const at_ns = this.time(at_px);
    const span_ns = this.span_ns / factor;
    const from_ns = at_ns - (at_px * span_ns) / this.width_px;
    this.show(from_ns, from_ns + span_ns, this.follow);
  }

  /** Move the window to later times by so many px. */
  pan(px) {
    const by_ns = px * this.ns_per_px;
    this.show(this.from_ns + by_ns, this.to_ns + by_ns);
  }

  /** Show the whole run. */
  all() {
    this.show(this.first_ns, this.last_ns, true);
  }

  /** Have a time in the window: where it is, if it is there, else in the middle of a window of the same width. */
  reach(ns, follow = false) {
    if (ns < this.from_ns || ns > this.to_ns) this.show(ns - this.span_ns / 2, ns + this.span_ns / 2, follow);
  }

  /** Keep up with a time that goes on; *by_page*: leaf over instead of sliding. */
  keep_up(now_ns, by_page) {
    if (!this.follow) return;
    const limit_ns = this.from_ns + this.span_ns * AHEAD;
    if (now_ns >= this.from_ns && now_ns <= limit_ns) return;
    if (now_ns > this.to_ns || now_ns < this.from_ns || by_page) {
      this.show(now_ns - this.span_ns * (1 - AHEAD), now_ns + this.span_ns * AHEAD, true);
    } else {
      this.show(this.from_ns + now_ns - limit_ns, this.to_ns + now_ns - limit_ns, true);
    }
  }
}

/** A time in seconds, exact to *digits* decimals. */
export function seconds(ns, digits = 6) {
  const unit = 10 ** (9 - digits);
  const rounded = Math.round(ns / unit);
  const whole = Math.floor(Math.abs(rounded) / 10 ** digits);
  const rest = String(Math.abs(rounded) % 10 ** digits).padStart(digits, "0");
  return `${rounded < 0 ? "−" : ""}${whole}${digits ? `.${rest}` : ""}`;
}

/** A length of time for people: 1.25 ms. */
export function length(ns) {
  const units = [["s", 1e9], ["ms", 1e6], ["µs", 1e3]];
  const [name, unit] = units.find(([, each]) => Math.abs(ns) >= each) ?? ["ns", 1];
  return `${Number((ns / unit).toFixed(4))} ${name}`;
}
