// The box that the pointer is at, the one that is pinned, and how one gets from it to the next.

import { length } from "../axis.js";
import { box_at, ends, mates } from "../boxes.js";
import { element } from "../dom.js";
import { show_box } from "./inspector.js";
import { sentence } from "../kinds.js";
import { owner } from "../rows.js";
import { sent, told } from "../wire.js";

const NEAR_PX = 5; // the pointer, as near to a box as this, is at the box
const LEAST_FOUND_PX = 14; // what is found is shown at least as wide
const FOUND_SHARE = 1 / 40; // and if it is not, in a window of which it is this share
const LEAST_FOUND_NS = 2e6;

/** What is pinned and found on a timeline. */
export class Finder {
  /** @param {import("../timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.hovered = this.pinned = null; // boxes; pinned has all that the server tells of it as detail
    this.pointer = null; // where it is on the lanes (px), until a key has led elsewhere
    this.only = false; // find only what is of the robot of the lane
    this.sought = "box";
    this.panel = element("section", { className: "tl-pin", "aria-label": "Pinned", tabIndex: 0 });
    this.tip = element("div", { className: "tl-tip", "aria-hidden": "true", hidden: true });
    this.show_pinned();
  }

  /** Forget what was pinned: the run is another one. */
  forget() {
    this.point(null, null);
    this.pinned = null;
    this.show_pinned();
  }

  // ------------------------------------------------------------ pointer

  /** Note where the pointer is on the lanes; null: on none. */
  point(x, y) {
    const { timeline } = this;
    this.pointer = x === null ? null : [x, y];
    const box = x === null ? null : box_at(timeline, timeline.rows.at(y), x, NEAR_PX);
    if (box?.lane === this.hovered?.lane && box?.row === this.hovered?.row) return;
    this.hovered = box;
    this.light(box);
    this.show_tip(box, x, y);
    timeline.overlay.style.cursor = box ? "pointer" : "";
    timeline.draw_over();
  }

  /** Forget where the pointer was: what was there is elsewhere now. */
  leave() {
    if (this.hovered) this.point(null, null);
  }

  /** Show on the floor which robots a box is about. */
  light(box) {
    const { rows, kinds, page } = this.timeline;
    const robots = new Set();
    for (const { lane } of box ? [box, ...mates(this.timeline, box)] : []) robots.add(rows.by_lane.get(lane)?.lane.robot);
    if (box && kinds.is_frame(box.code)) robots.add(box.peer);
    page.light([...robots].filter((robot) => robot !== null && robot >= 0));
  }

  show_tip(box, x, y) {
    const { tip, timeline } = this;
    tip.hidden = !box;
    if (!box) return;
    const { lane } = timeline.rows.by_lane.get(box.lane);
    const { name = "", part = "", lost = false } = timeline.kinds.outcomes.get(box.outcome) ?? {};
    const own = { kind: timeline.kinds.name(box.code), what: lane.what, robot: owner(lane), channel: lane.channel ?? -1 };
    tip.textContent = `${sentence({ ...box, ...ends(timeline, box, lane), ...own, outcome: name, part, lost }, timeline.stations)}; ${length(box.end_ns - box.start_ns)}`;
    const below = y - timeline.scroll_px + 16;
    tip.style.left = `${Math.max(0, Math.min(x + 12, timeline.axis.width_px - tip.offsetWidth - 4))}px`;
    tip.style.top = `${below + 30 > timeline.stage_px ? below - 46 : below}px`;
  }

  // ------------------------------------------------------------ pin

  /** Pin the box at a place; where there is none: unpin. */
  pick(x, y) {
    const row = this.timeline.rows.at(y);
    if (row) this.timeline.choose(row);
    const box = box_at(this.timeline, row, x, 2 * NEAR_PX);
    if (box) this.pin(box);
    else this.unpin();
  }

  /** Pin the box that the pointer is at, or the next one of the lane; if there is a pin, go and read it. */
  enter() {
    if (this.hovered) this.pin(this.hovered);
    else if (!this.pinned) this.find({ here: true });
    else this.panel.focus();
  }

  pin(box) {
    this.pinned = box;
    this.timeline.page.send({ say: "box", lane: box.lane, row: box.row });
    this.timeline.draw();
  }

  unpin() {
    this.pinned = null;
    this.show_pinned();
    this.timeline.draw();
  }

  /** Take what the server tells of a box. */
  take_box(message) {
    const { rows, kinds } = this.timeline;
    if (message.lane !== this.pinned?.lane || message.row !== this.pinned.row) return;
    const lane = rows.lanes.find((each) => each.lane === message.lane);
    this.pinned.detail = told(message, lane, (outcome) => kinds.loses(outcome));
    this.timeline.say(sentence(this.pinned.detail, this.timeline.stations));
    this.show_pinned();
    this.timeline.draw();
  }

  show_pinned() {
    const held = this.panel.contains(document.activeElement) && document.activeElement !== this.panel;
    show_box(this.panel, this.pinned?.detail, this.timeline.stations, { unpin: () => this.unpin(), go: () => this.timeline.go() });
    if (held) this.panel.focus(); // the button that was pressed is gone
  }

  // ------------------------------------------------------------ finding

  /** Find the next box, or the one *back*: what was *lost*, what is *alike*, or any of the lane *here*. */
  find({ lost = false, alike = false, here = false, back = false }) {
    const { axis, kinds, row, page } = this.timeline;
    const from = this.pinned;
    const kind = alike && from ? from.code : null;
    const lanes = this.searched(here || (alike && !from), alike && from);
    const robot = this.only && !here ? (row?.lane.robot ?? null) : null;
    const at = from
      ? { from_ns: sent(from.start_ns), lane: from.lane, row: from.row }
      : { from_ns: sent(back ? axis.to_ns : axis.from_ns) };
    this.sought = lost ? "lost frame" : kind === null ? "box" : kinds.name(kind);
    page.send({ say: "find", kind, robot, lanes, lost, back, ...at });
  }

  /**
   * Numbers of the lanes to search: the one *here*, those like the lane of a box, or all of frames that are sent, where a
   * loss counts once, and not once for each that should have heard it; and for one robot those that it received.
   */
  searched(here, like) {
    const { rows, row } = this.timeline;
    if (here) return row ? [row.lane.lane] : [];
    const own = like && rows.lanes.find(({ lane }) => lane === like.lane);
    const whats = own ? [own.what] : rows.by_channel ? ["channel"] : this.only ? ["sent", "received"] : ["sent"];
    return rows.lanes.filter(({ what }) => whats.includes(what)).map(({ lane }) => lane);
  }

  /** Take what the server has found: pin it, or say that there is none. */
  take_found({ lane, row, start_ns, end_ns, kind, outcome }) {
    if (lane === null) {
      const whose = this.only ? ` of ${this.whose}` : "";
      this.timeline.say(`No further ${this.sought.replaceAll("_", " ")}${whose}.`);
      return;
    }
    const box = { lane, row, start_ns: Number(start_ns), end_ns: Number(end_ns), code: kind, outcome, peer: null };
    this.point(null, null);
    this.show(box);
    this.pin(box);
  }

  /** Have a box in the window, wide enough to be seen. */
  show({ lane, start_ns, end_ns }) {
    const { axis, rows } = this.timeline;
    const long_ns = end_ns - start_ns;
    const middle_ns = (start_ns + end_ns) / 2;
    if (long_ns / axis.ns_per_px >= LEAST_FOUND_PX && long_ns < axis.span_ns) axis.reach(middle_ns);
    else {
      const span_ns = Math.max(LEAST_FOUND_NS, long_ns / FOUND_SHARE);
      axis.show(middle_ns - span_ns / 2, middle_ns + span_ns / 2);
    }
    const row = rows.by_lane.get(lane);
    if (row) this.timeline.choose(row);
  }

  /** Find only what is of the robot of the lane, or of any. */
  restrict() {
    this.only = !this.only;
    this.timeline.say(this.only ? `Finding only what is of ${this.whose}` : "Finding what is of any robot");
    this.timeline.controls.show();
  }

  /** What the robot, or station, of the lane is called. */
  get whose() {
    const { row, stations } = this.timeline;
    return stations.called(row?.lane.robot);
  }
}
