// What lies between the two cursors, of all robots or of the chosen one, as the server adds it up.

import { length, seconds } from "../axis.js";
import { element, table } from "../dom.js";
import { sent } from "../wire.js";

const SETTLED_MS = 150; // after which a cursor that is dragged stands
const ANEW_MS = 1000; // how often sums of a run under way are asked for anew
const TITLES = {
  states: "state", busy: "state", NAV: "state", sent: "sent", received: "to one", broadcasts: "to all", messages: "host", wakes: "host", events: "event",
};

/** The sums of a timeline, as tables. */
export class Region {
  /** @param {import("../timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.told = element("div", { className: "tl-region", tabIndex: 0, role: "region", "aria-label": "Between the cursors" });
    this.root = element("details", { open: true, hidden: true }, element("summary", {}, "Between the cursors"), this.told);
    this.number = 0;
  }

  /** Ask for the sums soon: a cursor is elsewhere, or another robot is chosen. */
  ask_soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.ask(), SETTLED_MS);
  }

  ask() {
    const { measure, page, selected } = this.timeline;
    const [one, two] = measure.times;
    this.root.hidden = one === null || two === null || one === two;
    if (this.root.hidden) return;
    this.number += 1;
    this.asked_ms = performance.now();
    const span = { from_ns: sent(Math.min(one, two)), to_ns: sent(Math.max(one, two)) };
    page.send({ say: "region", number: this.number, robot: selected, ...span });
  }

  /** Keep up with a run under way. */
  keep_up() {
    if (!this.root.hidden && performance.now() - this.asked_ms > ANEW_MS) this.ask();
  }

  /** Take the sums, and tell them. */
  take(message) {
    if (message.number !== this.number) return;
    const { kinds, stations } = this.timeline;
    const long_ns = Number(message.to_ns) - Number(message.from_ns);
    const rows = message.sums.map(({ what, kind, count, lost, time_ns }) => {
      const lasts = Number(time_ns);
      const share = lasts ? percent(lasts / long_ns) : "–";
      return [`${kinds.name(kind).replaceAll("_", " ")}, ${TITLES[what] ?? what}`, String(count), String(lost), lasts ? length(lasts) : "–", share];
    });
    const whose = message.robot === null ? "all robots" : stations.called(message.robot);
    const title = `Of ${whose}, ${seconds(Number(message.from_ns), 9)} s to ${seconds(Number(message.to_ns), 9)} s`;
    this.told.replaceChildren(
      table(title, null, this.totals(message, long_ns)),
      table("By kind: what begins there, and how long it lies there", ["kind", "number", "lost", "time", "share"], rows),
    );
  }

  totals({ sums, first, last, received_bytes }, long_ns) {
    const all = (what, name) => sums.filter((each) => each.what === what).reduce((sum, each) => sum + Number(each[name]), 0);
    const air_ns = all("sent", "time_ns");
    const heard = all("received", "count");
    const lost = all("received", "lost");
    const rows = [
      ["length", length(long_ns)],
      ["frames sent", String(all("sent", "count"))],
      ["air time", `${length(air_ns)}, ${percent(air_ns / long_ns)}`],
      ["lost on the way to one robot", heard ? `${lost} of ${heard}, ${percent(lost / heard)}` : "none sent"],
      ["payload received", `${Number(((received_bytes * 8 * 1e9) / long_ns).toPrecision(4))} bit/s, ${received_bytes} B`],
    ];
    if (first && last) {
      const [begins, ends] = [first, last].map((span) => span.map(Number));
      rows.push(["first to last frame: gap", length(ends[0] - begins[1])]); // below 0 if they overlap
      rows.push(["delta of their starts", length(ends[0] - begins[0])]);
      rows.push(["span", length(ends[1] - begins[0])]);
    }
    return rows;
  }
}

const percent = (share) => `${Number((100 * share).toPrecision(3))} %`;
