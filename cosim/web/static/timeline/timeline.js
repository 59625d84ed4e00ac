// The timeline below the floor: a lane for each robot and radio, on the same clock, from the whole run down to slots.

import { read, write } from "../address.js";
import { Axis, SLOT_NS, DCF_SLOT_NS, length, seconds } from "./axis.js";
import { Controls, commands } from "./commands.js";
import { element } from "./dom.js";
import { Gestures } from "./gestures.js";
import { show_box } from "./inspector.js";
import { FRAME_LANES, Kinds, sentence } from "./kinds.js";
import { show_legend } from "./legend.js";
import { show_listing } from "./listing.js";
import { Navigator } from "./navigator.js";
import { paint_flags, paint_overlay } from "./overlay.js";
import { Painter } from "./paint.js";
import { Rows } from "./rows.js";
import { paint_ruler } from "./ruler.js";
import { Windows } from "./windows.js";
import { sent, told } from "./wire.js";

const RULER_PX = 30;
const STRIP_PX = 26;
const NEAR_PX = 5; // a click, or a cursor, as near to a box as this is at the box
const LEAST_FOUND_PX = 14; // what is found is shown at least as wide
const FOUND_SHARE = 1 / 40; // and if it is not, with a window of which it is this share
const LEAST_FOUND_NS = 2e6;
const MOST_LANES = 120; // beyond that only those are asked for that can be seen
const SETTLED_MS = 300;

/** The page's timeline. */
export class Timeline {
  /**
   * @param {HTMLElement} root an empty section
   * @param {{send: (message: object) => boolean, seek: (time_s: number) => void, select: (robot: number | null) => void,
   *   light: (robots: number[]) => void}} page what the timeline does to the page: light shows robots on the floor
   */
  constructor(root, page) {
    this.root = root;
    this.page = page;
    this.kinds = new Kinds();
    this.rows = new Rows();
    this.painter = new Painter(this.kinds);
    this.stage_px = 0;
    this.scroll_px = 0;
    this.cursors = [null, null]; // times (ns)
    this.now_ns = null;
    this.selected = null; // robot
    this.row = null; // the lane that keys are about
    this.only = false; // find only what is of its robot
    this.pointer = null; // where it is on the lanes (px)
    this.hovered = this.pinned = null; // {lane, row, start_ns, end_ns, code}; pinned has all its fields as detail
    this.dirty = new Set();
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.axis = new Axis(() => this.moved());
    this.windows = new Windows((message) => page.send(message), () => this.draw());
    this.build();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.kinds.recolour();
      this.show_legend();
      this.draw();
    });
    root.timeline = Object.freeze({ // for tests: what is shown, and nothing to change it by
      boxes: () => this.boxes(),
      complete: () => this.windows.complete && this.dirty.size === 0,
      window: () => ({ from_ns: this.axis.from_ns, to_ns: this.axis.to_ns, width_px: this.axis.width_px }),
      pinned: () => this.pinned,
      place: (box) => this.box_place(box),
    });
  }

  build() {
    const part = (tag, name, properties = {}) => (this[name] = element(tag, { className: `tl-${name}`, ...properties }));
    part("div", "bar", { role: "toolbar", "aria-label": "Timeline" });
    part("output", "span", { "aria-live": "off" });
    part("p", "status", { role: "status" });
    part("canvas", "strip", { "aria-hidden": "true", title: "The whole run: drag the bracket" });
    part("canvas", "ruler", { "aria-hidden": "true", title: "Click: have the run at this time" });
    part("canvas", "content", { "aria-hidden": "true" });
    part("canvas", "overlay", { tabIndex: 0, role: "application" });
    this.overlay.setAttribute("aria-label", "Lanes over time: arrows go from box to box, Enter pins, l finds what was lost");
    part("ul", "labels", { "aria-label": "Lanes" });
    part("div", "stage");
    part("div", "scroller");
    part("div", "tip", { "aria-hidden": "true", hidden: true });
    part("section", "pin", { "aria-label": "Pinned", tabIndex: 0 });
    part("div", "legend");
    part("div", "listing", { tabIndex: 0, role: "region", "aria-label": "Table of the window" });
    this.listed = element("details", {}, element("summary", {}, "Table of the window"), this.listing);
    const groups = commands(this);
    this.controls = new Controls(this.bar, this.overlay, [...groups, []]);
    this.controls.keys.set("Enter", () => this.pin_at_pointer()).set("Escape", () => this.unpin());
    this.bar.append(this.span);
    this.stage.append(this.content, this.overlay, this.tip);
    this.scroller.append(this.labels, this.stage);
    const keys = element("details", {}, element("summary", {}, "Keys, while the lanes have the focus"), key_list(groups));
    const legend = element("details", { open: true }, element("summary", {}, "Legend"), this.legend);
    const side = element("div", { className: "tl-side" }, this.pin, legend, this.listed, keys);
    const plot = element("div", { className: "tl-plot" }, this.strip, this.ruler, this.scroller);
    this.root.replaceChildren(this.bar, element("div", { className: "tl-body" }, plot, side), this.status);
    this.navigator = new Navigator(this.strip, this);
    new Gestures(this.overlay, this, false);
    new Gestures(this.ruler, this, true);
    new ResizeObserver(() => this.resize()).observe(this.scroller);
    this.scroller.addEventListener("scroll", () => this.moved());
    for (const kind of ["focus", "blur"]) this.overlay.addEventListener(kind, () => this.draw_over());
    this.listed.addEventListener("toggle", () => this.settle());
    this.labels.addEventListener("keydown", (event) => this.label_key(event));
    this.show_pinned();
  }

  // ------------------------------------------------------------ messages

  /** Take a scene: the connection is new, and perhaps the run. */
  begin(scene) {
    this.live = scene.live;
    this.begun = false;
    this.windows.forget();
    this.root.hidden = true; // until the server names lanes
  }

  /** Take a message of the server; return whether it was about the timeline. */
  take(message) {
    if (message.say === "lanes") this.take_lanes(message);
    else if (message.say === "box") this.take_box(message);
    else if (message.say === "found") this.take_found(message);
    else return false;
    return true;
  }

  /** Take a binary message. */
  take_bytes(buffer) {
    this.windows.take(buffer);
  }

  take_lanes({ lanes, kinds, outcomes, first_ns, last_ns, peers = false }) {
    this.windows.peers = peers;
    this.rows.lanes = lanes;
    this.kinds.take(kinds, outcomes);
    this.root.hidden = lanes.length === 0;
    const wifi = kinds.some(({ name }) => ["RTS", "CTS", "ACK", "DATA"].includes(name));
    this.wifi = wifi && !kinds.some(({ name }) => ["POLL", "NULL", "ID"].includes(name));
    this.show_legend();
    if (this.begun) this.axis.extend(Number(last_ns));
    else this.axis.begin(Number(first_ns), Number(last_ns), this.live);
    this.resize();
    this.lay(this.begun ? this.rows.by_channel : read("view") === "channels");
    if (!this.begun) this.restore();
    this.begun = true;
  }

  /** Take the time of the run, and the robot that is selected. */
  now(time_s, selected) {
    this.now_ns = Math.round(time_s * 1e9);
    if (selected !== this.selected) {
      this.selected = selected;
      this.show_labels();
      this.draw();
    }
    if (this.root.hidden) return;
    if (this.live) this.axis.extend(this.now_ns);
    this.axis.keep_up(this.now_ns, this.still.matches);
    if (this.live) this.want();
    this.draw_over();
  }

  // ------------------------------------------------------------ drawing

  /** Lay out the rows. */
  lay(by_channel) {
    this.rows.lay(by_channel && this.rows.has_channels, this.scroller.clientHeight);
    this.row = this.rows.by_lane.get(this.row?.lane.lane) ?? this.rows.rows.find(({ lane }) => lane.what === "sent") ?? null;
    this.labels.style.height = `${this.rows.height}px`;
    this.show_labels();
    this.controls.show();
    this.moved();
  }

  resize() {
    const { scroller } = this;
    this.axis.width_px = Math.max(1, this.stage.clientWidth);
    this.stage_px = scroller.clientHeight;
    this.stage.style.height = `${this.stage_px}px`;
    this.ratio = window.devicePixelRatio || 1;
    const sizes = [[this.content, this.stage_px], [this.overlay, this.stage_px], [this.ruler, RULER_PX], [this.strip, STRIP_PX]];
    for (const [canvas, height] of sizes) {
      canvas.style.width = `${this.axis.width_px}px`;
      canvas.style.height = `${height}px`;
      canvas.width = Math.round(this.axis.width_px * this.ratio);
      canvas.height = Math.round(height * this.ratio);
    }
    if (this.rows.by_channel) this.rows.lay(true, this.stage_px);
    this.moved();
  }

  /** Ask for what is to be seen, and draw: the window is another one. */
  moved() {
    if (!this.begun) return;
    this.scroll_px = this.scroller.scrollTop;
    this.want();
    this.draw();
    this.settle();
    this.hovered = null;
    this.span.textContent = this.axis.span_ns >= 1e9 ? `${seconds(this.axis.span_ns, 1)} s wide` : `${length(this.axis.span_ns)} wide`;
    this.controls.show();
  }

  want() {
    const { rows, axis } = this;
    const near = rows.rows.length > MOST_LANES ? rows.between(this.scroll_px - this.stage_px, this.scroll_px + 2 * this.stage_px) : rows.rows;
    const all = rows.lanes.filter(({ what }) => what === "sent").map(({ lane }) => lane); // what the navigator sums up
    const lanes = near.map(({ lane }) => lane.lane);
    const { from_ns, to_ns, ns_per_px, first_ns, last_ns } = axis;
    this.wish = { lanes, all: rows.by_channel ? all : [...new Set([...all, ...lanes])], from_ns, to_ns, ns_per_px, run: [first_ns, last_ns] };
    this.windows.want(this.wish);
  }

  /** Draw everything at the next opportunity. */
  draw() {
    this.request("content");
  }

  /** Draw what lies over the boxes at the next opportunity. */
  draw_over() {
    this.request("overlay");
  }

  request(what) {
    if (this.dirty.size === 0) requestAnimationFrame(() => this.paint());
    this.dirty.add(what);
  }

  paint() {
    const all = this.dirty.has("content");
    this.dirty.clear();
    if (this.root.hidden || !this.wish) return;
    const { axis, rows, kinds, origin_ns, wifi, selected } = this;
    this.focused = document.activeElement === this.overlay;
    if (all) {
      const seen = { axis, rows, layers: this.windows.layers(this.wish), top: this.scroll_px, height: this.stage_px };
      this.painter.paint(this.pen(this.content), { ...seen, origin_ns, wifi, lit: selected });
    }
    const ruler = this.pen(this.ruler);
    paint_ruler(ruler, { axis, kinds, height: RULER_PX, origin_ns, wifi });
    paint_flags(ruler, this, RULER_PX);
    this.navigator.paint(this.pen(this.strip), STRIP_PX);
    paint_overlay(this.pen(this.overlay), this);
  }

  pen(canvas) {
    const pen = canvas.getContext("2d");
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    return pen;
  }

  /** From where slots are counted: the start of the frame that is pinned, else that of the run. */
  get origin_ns() {
    return this.pinned && this.kinds.is_frame(this.pinned.code) ? this.pinned.start_ns : this.axis.first_ns;
  }

  /** Do what can wait until the window is no longer moved. */
  settle() {
    clearTimeout(this.settling);
    this.settling = setTimeout(() => {
      if (!this.begun) return;
      if (this.listed.open) show_listing(this.listing, this);
      const { axis, row, rows } = this;
      const all = axis.from_ns === axis.first_ns && axis.to_ns >= axis.last_ns;
      const window = axis.follow && (all || this.live) ? [null, null] : [seconds(axis.from_ns, 9), seconds(axis.span_ns, 9)];
      write({ from: window[0], span: window[1], lane: row?.lane.lane ?? null, view: rows.by_channel ? "channels" : null });
    }, SETTLED_MS);
  }

  /** Show what the address says. */
  restore() {
    const [from_ns, span_ns] = ["from", "span"].map((name) => Math.round(Number(read(name) ?? NaN) * 1e9));
    if (from_ns >= 0 && span_ns > 0) this.axis.show(from_ns, from_ns + span_ns);
    this.row = this.rows.by_lane.get(Number(read("lane") ?? NaN)) ?? this.row;
    this.show_labels();
  }

  // ------------------------------------------------------------ labels and legend

  show_labels() {
    const { groups, by_channel } = this.rows;
    const held = this.labels.contains(document.activeElement);
    this.labels.replaceChildren(...(by_channel ? this.channel_labels() : groups.map((group) => this.label(group))));
    if (held) this.labels.querySelector("[tabindex='0']")?.focus();
  }

  label(group) {
    const own = group === this.row?.group;
    const button = element("button", { type: "button", tabIndex: own ? 0 : -1 }, group.name);
    button.setAttribute("aria-pressed", String(group.robot === this.selected));
    button.addEventListener("click", () => {
      this.row = group.rows.find(({ lane }) => lane.what === "sent") ?? group.rows[0];
      if (group.robot >= 0) this.page.select(group.robot === this.selected ? null : group.robot);
      this.draw_over();
    });
    const item = element("li", own ? { className: "own" } : {}, button);
    item.style.top = `${group.y}px`;
    item.style.height = `${group.height}px`;
    return item;
  }

  channel_labels() {
    return [0, 10, 20, 30, 40, 50, 60, 70, 78].map((channel) => {
      const item = element("li", { className: "channel" }, `${channel}: ${2402 + channel} MHz`);
      item.style.top = `${(78.5 - channel) * this.rows.channel_px - 7}px`;
      return item;
    });
  }

  /** Walk through the labels by arrows. */
  label_key(event) {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!by || this.rows.by_channel) return;
    const { groups } = this.rows;
    const group = groups[Math.min(groups.length - 1, Math.max(0, groups.indexOf(this.row?.group) + by))];
    event.preventDefault();
    event.stopPropagation();
    this.row = group.rows.find(({ lane }) => lane.what === "sent") ?? group.rows[0];
    this.show_labels();
    this.scroll_to(this.row);
  }

  show_legend() {
    show_legend(this.legend, this.kinds, () => {
      this.draw();
      this.settle();
    });
  }

  // ------------------------------------------------------------ boxes

  /** Where an event is on the lanes (px): from the left, and from the top of all lanes. */
  at(event) {
    const box = this.overlay.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top + this.scroll_px];
  }

  /** The box of a row at a place, or the nearest one at most *reach_px* away: {lane, row, start_ns, end_ns, code}. */
  box_at(row, x, reach_px = NEAR_PX) {
    let best = null;
    let best_px = reach_px;
    const answer = this.wish && this.windows.fitting(this.wish);
    const block = row && answer?.blocks.get(row.lane.lane);
    if (!block?.boxes) return null;
    for (let at = 0; at < block.n; at += 1) {
      const from = this.axis.place(answer.from_ns + block.starts[at]);
      if (from > x + reach_px) break;
      const to = from + block.durations[at] / this.axis.ns_per_px;
      const far_px = Math.max(0, from - x, x - to);
      if (far_px > best_px || this.kinds.hidden.has(block.codes[at])) continue;
      best = boxed(answer, row.lane, at);
      best_px = far_px;
    }
    return best;
  }

  /** The frame and the receptions that belong to a box: {lane} of each. */
  mates(box) {
    const own = this.rows.lanes.find(({ lane }) => lane === box.lane);
    if (!own || !FRAME_LANES.has(own.what)) return [];
    if (box.detail) {
      const { source, receptions } = box.detail;
      const ends = new Set(receptions.map(({ robot }) => robot));
      return this.rows.rows.map(({ lane }) => lane).filter(({ lane, what, robot, radio }) => lane !== box.lane && radio === own.radio
        && (what === "sent" ? robot === source : FRAME_LANES.has(what) && ends.has(robot)));
    }
    const from = own.what === "sent" ? own.robot : box.peer;
    return this.painter.drawn.map(([row, answer, at]) => boxed(answer, row.lane, at)).filter((other) => {
      const { what, robot, radio } = this.rows.by_lane.get(other.lane)?.lane ?? {};
      if (other.start_ns !== box.start_ns || other.lane === box.lane || radio !== own.radio) return false;
      return what === "sent" ? robot === from : FRAME_LANES.has(what) && other.peer === from;
    });
  }

  /** Note where the pointer is on the lanes; null: on none. */
  point(x, y) {
    this.pointer = x === null ? null : [x, y];
    const box = x === null ? null : this.box_at(this.rows.at(y), x);
    if (box?.lane === this.hovered?.lane && box?.row === this.hovered?.row) return;
    this.hovered = box;
    const robots = new Set();
    for (const each of box ? [box, ...this.mates(box)] : []) robots.add(this.rows.by_lane.get(each.lane)?.lane.robot);
    if (box && this.kinds.is_frame(box.code) && box.peer >= 0) robots.add(box.peer);
    this.page.light([...robots].filter((robot) => robot >= 0));
    this.show_tip(box, x, y);
    this.overlay.style.cursor = box ? "pointer" : "";
    this.draw_over();
  }

  show_tip(box, x, y) {
    this.tip.hidden = !box;
    if (!box) return;
    const { lane } = this.rows.by_lane.get(box.lane);
    const { name = "", part = "", lost = false } = this.kinds.outcomes.get(box.outcome) ?? {};
    const kind = this.kinds.name(box.code);
    const ends = lane.what === "sent" ? { source: lane.robot, peer: box.peer } : { source: box.peer, peer: lane.robot };
    const words = sentence({ ...box, ...ends, kind, what: lane.what, robot: lane.robot, outcome: name, part, lost });
    this.tip.textContent = `${words}; ${length(box.end_ns - box.start_ns)}`;
    const left = Math.min(x + 12, this.axis.width_px - this.tip.offsetWidth - 4);
    this.tip.style.left = `${Math.max(0, left)}px`;
    const below = y - this.scroll_px + 16;
    this.tip.style.top = `${below + 30 > this.stage_px ? below - 46 : below}px`;
  }

  /** Pin the box at a place; nothing there: unpin. */
  pick(x, y) {
    const row = this.rows.at(y);
    if (row) this.choose(row);
    const box = this.box_at(row, x, 2 * NEAR_PX);
    if (box) this.pin_box(box);
    else this.unpin();
  }

  pin_box(box) {
    this.pinned = box;
    this.page.send({ say: "box", lane: box.lane, row: box.row });
    this.draw();
  }

  /** Pin the box that the pointer is at; without one, the next one of the lane. */
  pin_at_pointer() {
    if (this.hovered) this.pin_box(this.hovered);
    else if (!this.pinned) this.find({ here: true });
    else this.pin.focus();
  }

  unpin() {
    this.pinned = null;
    this.show_pinned();
    this.draw();
  }

  take_box(message) {
    if (message.lane !== this.pinned?.lane || message.row !== this.pinned.row) return;
    const lane = this.rows.lanes.find((each) => each.lane === message.lane);
    this.pinned.detail = told(message, lane, (outcome) => this.kinds.loses(outcome));
    this.say(sentence(this.pinned.detail));
    this.show_pinned();
    this.draw();
  }

  show_pinned() {
    const held = this.pin.contains(document.activeElement);
    show_box(this.pin, this.pinned?.detail, { unpin: () => this.unpin(), go: () => this.go() });
    if (held && !this.pin.contains(document.activeElement)) this.overlay.focus();
  }

  say(words) {
    this.status.textContent = words;
  }

  /** What is drawn as rectangles, for tests. */
  boxes() {
    const name = (code) => this.kinds.outcomes.get(code)?.name;
    return this.painter.drawn.map(([row, answer, at]) => {
      const box = boxed(answer, row.lane, at);
      return { ...box, what: row.lane.what, robot: row.lane.robot, kind: this.kinds.name(box.code), outcome: name(box.outcome) };
    });
  }

  /** Where in the window of the browser a box is drawn, for tests. */
  box_place({ lane, row }) {
    const found = this.painter.drawn.find(([each, answer, at]) => each.lane.lane === lane && boxed(answer, each.lane, at).row === row);
    if (!found) return null;
    const corner = this.overlay.getBoundingClientRect();
    const [, , , x, y, width, height] = found;
    return [corner.left + x + width / 2, corner.top + y + height / 2 - this.scroll_px];
  }

  // ------------------------------------------------------------ finding

  /** Find the next box, or the one *back*: what was *lost*, what is *alike*, or any box of the lane *here*. */
  find({ lost = false, alike = false, here = false, back = false }) {
    const from = this.pinned;
    const { axis } = this;
    const kind = alike && from ? from.code : null;
    const lanes = this.searched(here || (alike && !from), alike && from);
    const robot = this.only && !here ? (this.row?.lane.robot ?? null) : null;
    const at = from ? { from_ns: sent(from.start_ns), lane: from.lane, row: from.row } : { from_ns: sent(back ? axis.to_ns : axis.from_ns) };
    this.sought = lost ? "lost frame" : kind === null ? "box" : this.kinds.name(kind);
    this.page.send({ say: "find", kind, robot, lanes, lost, back, ...at });
  }

  /** Numbers of the lanes to search: the one *here*, those like the lane of a box, or all that hold frames. */
  searched(here, like) {
    if (here) return this.row ? [this.row.lane.lane] : [];
    const own = like && this.rows.lanes.find(({ lane }) => lane === like.lane);
    const fits = ({ what }) => (own ? what === own.what : FRAME_LANES.has(what) && (what === "channel") === this.rows.by_channel);
    return this.rows.lanes.filter(fits).map(({ lane }) => lane);
  }

  take_found({ lane, row, start_ns, end_ns, kind, outcome }) {
    if (lane === null || lane === undefined) {
      this.say(`No further ${this.sought ?? "box"}${this.only ? ` of robot ${this.row?.lane.robot}` : ""}.`);
      return;
    }
    const box = { lane, row, start_ns: Number(start_ns), end_ns: Number(end_ns), code: kind, outcome, peer: -1 };
    this.show(box);
    this.pin_box(box);
  }

  /** Have a box in the window, wide enough to be seen. */
  show({ lane, start_ns, end_ns }) {
    const { axis } = this;
    const long_ns = end_ns - start_ns;
    const span_ns = Math.max(LEAST_FOUND_NS, long_ns / FOUND_SHARE);
    const middle_ns = (start_ns + end_ns) / 2;
    if (long_ns / axis.ns_per_px >= LEAST_FOUND_PX && long_ns < axis.span_ns) axis.reach(middle_ns);
    else axis.show(middle_ns - span_ns / 2, middle_ns + span_ns / 2);
    const row = this.rows.by_lane.get(lane);
    if (row) this.choose(row);
  }

  /** Have keys be about a row, and see it. */
  choose(row) {
    const other = row.group !== this.row?.group;
    this.row = row;
    if (other) this.show_labels();
    this.scroll_to(row);
    this.settle();
    this.draw_over();
  }

  scroll_to({ group }) {
    if (group.y < this.scroll_px) this.scroller.scrollTop = group.y - 4;
    else if (group.y + group.height > this.scroll_px + this.stage_px) {
      this.scroller.scrollTop = group.y + group.height - this.stage_px + 4;
    }
  }

  scroll_by(px) {
    this.scroller.scrollTop += px;
  }

  /** Go to the lane above or below. */
  walk(by) {
    const { rows } = this.rows;
    const row = rows[Math.min(rows.length - 1, Math.max(0, rows.indexOf(this.row) + by))];
    if (!row) return;
    this.choose(row);
    this.say(row.lane.name);
  }

  restrict() {
    this.only = !this.only;
    this.say(this.only ? `Finding only what is of robot ${this.row?.lane.robot}` : "Finding what is of any robot");
    this.controls.show();
  }

  // ------------------------------------------------------------ times

  /** The time that a command is about: of the pointer, the pin, or the middle of the window. */
  get here_ns() {
    if (this.pointer) return this.snapped(this.axis.time(this.pointer[0]));
    return this.pinned?.start_ns ?? Math.round(this.axis.middle_ns);
  }

  /** The edge of a box next to a time, if it is near enough. */
  snapped(ns) {
    let best = Math.round(ns);
    let best_ns = NEAR_PX * this.axis.ns_per_px;
    for (const [row, answer, at] of this.painter.drawn) {
      const { start_ns, end_ns } = boxed(answer, row.lane, at);
      for (const edge_ns of [start_ns, end_ns]) {
        if (Math.abs(edge_ns - ns) < best_ns) [best, best_ns] = [edge_ns, Math.abs(edge_ns - ns)];
      }
    }
    return best;
  }

  measure_here(number) {
    this.measure(number, this.here_ns, false);
  }

  /** Put a cursor at a time; *snap*: at the edge of a box that is near. */
  measure(number, ns, snap) {
    this.cursors[number] = snap ? this.snapped(ns) : Math.round(ns);
    const [one, two] = this.cursors;
    if (one !== null && two !== null) {
      const slot_ns = this.wifi ? DCF_SLOT_NS : SLOT_NS;
      this.say(`2 − 1: ${seconds(two - one, 9)} s = ${Number(((two - one) / slot_ns).toFixed(4))} slots of ${length(slot_ns)}`);
    } else this.say(`cursor ${number + 1} at ${seconds(this.cursors[number], 9)} s`);
    this.draw_over();
  }

  measure_nothing() {
    this.cursors = [null, null];
    this.say("");
    this.draw_over();
  }

  /** Have the run at the time of the pin, or of the pointer. */
  go() {
    this.seek(this.pinned?.start_ns ?? this.here_ns);
  }

  seek(ns) {
    this.page.seek(Math.max(0, ns) / 1e9);
  }

  /** Fit the window to what is between the cursors, or else to the pin. */
  fit() {
    const [one, two] = this.cursors;
    if (one !== null && two !== null && one !== two) this.axis.show(Math.min(one, two), Math.max(one, two));
    else if (this.pinned) {
      const { start_ns, end_ns } = this.pinned;
      const margin_ns = Math.max(end_ns - start_ns, SLOT_NS) / 2;
      this.axis.show(start_ns - margin_ns, end_ns + margin_ns);
    }
  }

  follow() {
    this.axis.follow = !this.axis.follow;
    if (this.axis.follow && this.now_ns !== null) this.axis.reach(this.now_ns, true);
    this.controls.show();
  }

  show_channels() {
    if (!this.rows.has_channels) this.say("No frame of this run has an RF channel.");
    else this.lay(!this.rows.by_channel);
  }
}

function boxed(answer, lane, at) {
  const block = answer.blocks.get(lane.lane);
  const start_ns = answer.from_ns + block.starts[at];
  return {
    lane: lane.lane,
    row: block.rows[at],
    start_ns,
    end_ns: start_ns + block.durations[at],
    code: block.codes[at],
    outcome: block.outcomes[at],
    peer: block.peers?.[at] ?? -1,
  };
}

function key_list(groups) {
  const rows = groups.flat().map(([, , title, keys]) => element("li", {}, element("kbd", {}, keys.join(" ")), ` ${title}`));
  rows.push(element("li", {}, element("kbd", {}, "Enter"), " Pin what the pointer is at, or go to what is pinned"));
  rows.push(element("li", {}, element("kbd", {}, "Escape"), " Unpin"));
  return element("ul", { className: "tl-keys" }, ...rows);
}
