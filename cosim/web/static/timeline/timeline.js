// The timeline below the floor: a lane for each robot and radio, on the same clock, from the whole run down to slots.

import { read, write } from "../address.js";
import { Stations } from "../stations.js";
import { Axis, DCF_SLOT_NS, SLOT_NS, length, seconds } from "./axis.js";
import { boxed } from "./boxes.js";
import { Controls, commands } from "./commands.js";
import { element } from "./dom.js";
import { Finder } from "./panels/finder.js";
import { Gestures } from "./gestures.js";
import { Kinds } from "./kinds.js";
import { Labels } from "./labels.js";
import { show_legend } from "./panels/legend.js";
import { show_listing } from "./panels/listing.js";
import { Markers, paint_markers } from "./panels/markers.js";
import { Measure } from "./measure.js";
import { Navigator } from "./navigator.js";
import { has_overlay, paint_flags, paint_overlay } from "./overlay.js";
import { Painter } from "./paint.js";
import { Plots } from "./panels/plots.js";
import { Region } from "./panels/region.js";
import { Rows } from "./rows.js";
import { paint_ruler } from "./ruler.js";
import { Spectrum } from "./spectrum.js";
import { Split } from "./split.js";
import { Windows } from "./windows.js";

const RULER_PX = 30;
const STRIP_PX = 26;
const MOST_LANES = 120; // beyond that only those are asked for that can be seen
const MOST_ASKED = 200; // what the server takes in a request
const SETTLED_MS = 300;

/** The page's timeline. */
export class Timeline {
  /**
   * @param {HTMLElement} root an empty section
   * @param {{send: (message: object) => boolean, seek: (time_s: number) => void, select: (robot: number | null) => void,
   *   light: (robots: number[]) => void, shown?: (window: {from_ns: number, to_ns: number, follow: boolean}) => void}} page
   *   what the timeline does to the page: light shows robots on the floor, shown is told which window is shown now
   */
  constructor(root, page) {
    this.root = root;
    this.page = page;
    this.stations = new Stations(); // of the run
    this.kinds = new Kinds();
    this.rows = new Rows();
    this.painter = new Painter(this.kinds);
    this.stage_px = 0;
    this.scroll_px = 0;
    this.now_ns = null;
    this.selected = null; // robot, or station
    this.row = null; // the lane that keys are about
    this.dirty = new Set();
    this.blank = 0; // pictures with a part of which nothing was known
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.taken = false; // whether the window is being set by a timeline beside
    this.axis = new Axis(() => {
      this.moved();
      if (this.begun && !this.taken) this.tell_window();
    });
    this.windows = new Windows((message) => page.send(message), () => this.draw());
    this.measure = new Measure(this);
    this.markers = new Markers(this);
    this.region = new Region(this);
    this.finder = new Finder(this);
    this.labels = new Labels(this);
    this.plots = new Plots(this);
    this.spectrum = new Spectrum(this);
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
      pinned: () => this.finder.pinned,
      blank: () => this.blank,
      place: (box) => this.box_place(box),
    });
  }

  /** What is drawn as rectangles. */
  boxes() {
    const name = (code) => this.kinds.outcomes.get(code)?.name;
    return this.painter.drawn.map(([{ lane }, answer, at]) => {
      const box = boxed(answer, lane, at);
      return { ...box, what: lane.what, robot: lane.robot, kind: this.kinds.name(box.code), outcome: name(box.outcome) };
    });
  }

  /** Where in the browser's window the middle of a box is drawn (px). */
  box_place({ lane, row }) {
    const found = this.painter.drawn.find(([each, answer, at]) => each.lane.lane === lane && boxed(answer, each.lane, at).row === row);
    if (!found) return null;
    const corner = this.overlay.getBoundingClientRect();
    const [, , , x, y, width, height] = found;
    return [corner.left + x + width / 2, corner.top + y + height / 2 - this.scroll_px];
  }

  /** Where an event is on the lanes (px): from the left, and from the top of all lanes. */
  at(event) {
    const box = this.overlay.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top + this.scroll_px];
  }

  show_legend() {
    show_legend(this.legend, this.kinds, () => {
      this.draw();
      this.settle();
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
    part("div", "stage");
    part("div", "scroller");
    part("div", "legend");
    part("div", "listing", { tabIndex: 0, role: "region", "aria-label": "Table of the window" });
    this.listed = element("details", {}, element("summary", {}, "Table of the window"), this.listing);
    this.split = new Split(this.root.parentElement);
    const groups = commands(this);
    this.controls = new Controls(this.bar, this.overlay, groups);
    this.controls.keys.set("Enter", () => this.finder.enter()).set("Escape", () => this.finder.unpin());
    this.stage.append(this.content, this.overlay, this.finder.tip);
    this.scroller.append(this.labels.root, this.stage, this.spectrum.root);
    const keys = element("details", {}, element("summary", {}, "Keys, while the lanes have the focus"), key_list(groups));
    const legend = element("details", { open: true }, element("summary", {}, "Legend"), this.legend);
    const { chooser, listed } = this.plots;
    const side = element("div", { className: "tl-side" }, this.markers.root, this.region.root, this.finder.panel, legend, chooser, this.listed, listed, keys);
    const plot = element("div", { className: "tl-plot" }, this.strip, this.ruler, this.scroller, this.plots.root);
    const foot = element("div", { className: "tl-foot" }, this.span, this.status);
    this.root.replaceChildren(this.split.grip, this.bar, element("div", { className: "tl-body" }, plot, side), foot);
    this.navigator = new Navigator(this.strip, this);
    new Gestures(this.overlay, this, false);
    new Gestures(this.ruler, this, true);
    new ResizeObserver(() => this.resize()).observe(this.scroller);
    this.scroller.addEventListener("scroll", () => this.moved());
    for (const kind of ["focus", "blur"]) this.overlay.addEventListener(kind, () => this.draw_over());
    window.addEventListener("hashchange", () => this.begun && this.restore());
    this.listed.addEventListener("toggle", () => this.settle());
  }

  // ------------------------------------------------------------ messages

  /** Take a scene: the connection is new, and perhaps the run. */
  begin(scene) {
    this.live = scene.live;
    this.stations = this.kinds.stations = this.rows.stations = new Stations(scene);
    this.least_ns = scene.beside ? Math.round(scene.duration_s * 1e9) : 0; // all runs beside each other have one axis
    this.begun = false;
    this.told_slot_ns = scene.radios ? (scene.slot_ns ?? 0) : null; // 0: its radios have none; null: nobody knows
    this.windows.forget();
    this.finder.forget();
    this.measure.forget();
    this.plots.asking.forget();
    this.region.ask();
    this.markers.forget();
    this.spectrum.asking.forget();
    this.root.hidden = true; // until the server names lanes
  }

  tell_window() {
    const { from_ns, to_ns, follow } = this.axis;
    this.page.shown?.({ from_ns, to_ns, follow });
  }

  /** Show the window that a timeline beside this one shows. */
  take_window({ from_ns, to_ns, follow }) {
    if (!this.begun) return;
    this.taken = true;
    this.axis.show(from_ns, to_ns, follow);
    this.taken = false;
  }

  /** Take a message of the server; return whether it was about the timeline. */
  take(message) {
    if (message.say === "lanes") this.take_lanes(message);
    else if (message.say === "box") this.finder.take_box(message);
    else if (message.say === "curves") this.plots.take(message);
    else if (message.say === "region") this.region.take(message);
    else if (message.say === "channels") this.spectrum.take(message);
    else if (message.say === "found") this.finder.take_found(message);
    else return false;
    return true;
  }

  /** Take a binary message. */
  take_bytes(buffer) {
    this.windows.take(buffer);
  }

  take_lanes({ lanes, kinds, outcomes, first_ns, last_ns, peers = false, curves = [] }) {
    this.windows.peers = peers;
    this.rows.lanes = lanes;
    this.kinds.take(kinds, outcomes);
    this.root.hidden = lanes.length === 0;
    this.slot_ns = this.told_slot_ns ?? slot_of(kinds);
    if (this.legend.childElementCount === 0 || this.kinds.fresh) this.show_legend();
    if (this.begun) this.axis.extend(Number(last_ns));
    else if (this.least_ns) this.axis.begin(0, Math.max(Number(last_ns), this.least_ns), false);
    else this.axis.begin(Number(first_ns), Number(last_ns), this.live);
    this.rows.piconets = read("piconets") !== "no";
    this.resize();
    this.lay(this.begun ? this.rows.by_channel : read("view") === "channels");
    if (!this.begun) this.restore();
    this.begun = true;
    this.plots.take_known(curves);
    this.plots.want();
  }

  /** Take the time of the run, and the robot that is selected. */
  now(time_s, selected) {
    this.now_ns = Math.round(time_s * 1e9);
    if (selected !== this.selected) {
      this.selected = selected;
      this.region.ask_soon();
      this.labels.show();
      this.draw();
      this.plots.want();
      this.spectrum.want();
    }
    if (this.root.hidden) return;
    if (this.live) this.axis.extend(this.now_ns);
    this.axis.keep_up(this.now_ns, this.still.matches);
    if (this.live) {
      this.want();
      this.plots.want();
      this.region.keep_up();
      this.spectrum.want();
    }
    this.draw_over();
  }

  // ------------------------------------------------------------ drawing

  /** Lay out the rows. */
  lay(by_channel) {
    this.rows.lay(by_channel && this.rows.has_channels, this.scroller.clientHeight);
    if (this.spectrum.root.hidden === this.rows.by_channel) {
      this.spectrum.root.hidden = !this.rows.by_channel;
      this.resize(); // the lanes have become narrower, or wider
    }
    this.row = this.rows.by_lane.get(this.row?.lane.lane) ?? this.rows.rows.find(({ lane }) => lane.what === "sent") ?? null;
    this.labels.show();
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
    this.over = true;
    if (this.rows.by_channel) {
      this.rows.lay(true, this.stage_px);
      this.labels.show();
    }
    this.moved();
  }

  /** Ask for what is to be seen, and draw: the window is another one. */
  moved() {
    if (!this.begun) return;
    this.scroll_px = this.scroller.scrollTop;
    this.want();
    this.plots.want();
    this.spectrum.want();
    this.draw();
    this.settle();
    this.finder.leave();
    const width = this.axis.span_ns >= 1e9 ? `${seconds(this.axis.span_ns, 1)} s wide` : `${length(this.axis.span_ns)} wide`;
    if (this.span.textContent !== width) this.span.textContent = width;
    this.controls.show();
  }

  want() {
    const { rows, axis } = this;
    const near = rows.rows.length > MOST_LANES ? rows.between(this.scroll_px - this.stage_px, this.scroll_px + 2 * this.stage_px) : rows.rows;
    const sums = rows.lanes.filter(({ what }) => what === "sent").map(({ lane }) => lane); // for the navigator
    const lanes = near.slice(0, MOST_ASKED).map(({ lane }) => lane.lane);
    const all = [...new Set([...lanes, ...sums])].slice(0, MOST_ASKED);
    const { from_ns, to_ns, ns_per_px, first_ns, last_ns } = axis;
    this.wish = { lanes, all, from_ns, to_ns, ns_per_px, run: [first_ns, last_ns] };
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
    const { axis, rows, kinds, origin_ns, slot_ns, selected } = this;
    this.focused = document.activeElement === this.overlay;
    if (all) {
      const layers = this.windows.layers(this.wish);
      this.blank += Number(!layers.some((each) => each.begin_ns <= axis.from_ns && each.end_ns >= Math.min(axis.to_ns, axis.last_ns)));
      const seen = { axis, rows, layers, spectrum: this.spectrum, top: this.scroll_px, height: this.stage_px };
      this.painter.paint(this.pen(this.content), { ...seen, origin_ns, slot_ns, lit: selected });
    }
    const ruler = this.pen(this.ruler);
    paint_ruler(ruler, { axis, kinds, height: RULER_PX, origin_ns, slot_ns });
    paint_markers(ruler, this, RULER_PX);
    paint_flags(ruler, this, RULER_PX);
    this.plots.paint();
    if (all && rows.by_channel) this.spectrum.paint_bars();
    this.navigator.paint(this.pen(this.strip), STRIP_PX);
    const over = has_overlay(this);
    if (over || this.over) paint_overlay(this.pen(this.overlay), this); // else it is as empty as it was: nothing costs
    this.over = over;
  }

  pen(canvas) {
    const pen = canvas.getContext("2d");
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    return pen;
  }

  /** From where slots are counted: the start of the frame that is pinned, else that of the run. */
  get origin_ns() {
    const { pinned } = this.finder;
    return pinned && this.kinds.is_frame(pinned.code) ? pinned.start_ns : this.axis.first_ns;
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
    this.plots.restore();
    this.markers.restore();
    this.labels.show();
    this.draw();
  }

  // ------------------------------------------------------------ commands

  say(words) {
    this.status.textContent = words;
  }

  /** Have keys be about a row, and see it. */
  choose(row) {
    const other = row.group !== this.row?.group;
    this.row = row;
    if (other) this.labels.show();
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

  /** Have the run at the time of the pin, or of the pointer. */
  go() {
    this.seek(this.finder.pinned?.start_ns ?? this.measure.here_ns);
  }

  seek(ns) {
    this.page.seek(Math.max(0, ns) / 1e9);
  }

  /** Follow the time of the run, or no longer. */
  follow() {
    this.axis.follow = !this.axis.follow;
    if (this.axis.follow && this.now_ns !== null) this.axis.reach(this.now_ns, true);
    this.controls.show();
  }

  /** Give the timeline most of the page, or its usual part. */
  stretch() {
    this.split.toggle();
    this.controls.show();
  }

  /** Show the strips of piconets, or hide them. */
  show_piconets() {
    const { rows } = this;
    if (!rows.has_piconets) {
      this.say("This run has no piconets.");
      return;
    }
    rows.piconets = !rows.piconets;
    write({ piconets: rows.piconets ? null : "no" });
    this.lay(rows.by_channel);
  }

  /** Show the lanes of RF channels, or again those of robots. */
  show_channels() {
    if (!this.rows.has_channels) this.say("No frame of this run has an RF channel.");
    else this.lay(!this.rows.by_channel);
  }
}

function key_list(groups) {
  const rows = groups.flat().map(([, , title, keys]) => element("li", {}, element("kbd", {}, keys.join(" ")), ` ${title}`));
  rows.push(element("li", {}, element("kbd", {}, "Enter"), " Pin what the pointer is at, or go to what is pinned"));
  rows.push(element("li", {}, element("kbd", {}, "Escape"), " Unpin"));
  return element("ul", { className: "tl-keys" }, ...rows);
}

/** How long a slot is of a run whose scene does not tell, by the kinds of its frames. */
function slot_of(kinds) {
  const has = (...names) => kinds.some(({ name }) => names.includes(name));
  return has("RTS", "CTS", "ACK", "DATA") && !has("POLL", "NULL", "ID") ? DCF_SLOT_NS : SLOT_NS;
}
