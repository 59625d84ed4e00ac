// What a page knows of a run: the scene, the latest moment, and what has happened lately.

import { Doing } from "./doing.js";
import { Stations } from "./stations.js";

export const GLOW_S = 0.45; // for so long a frame is shown after its end, at the speed 1: as air.py has it
export const TALK_S = 2.5;
const MOST_EVENTS = 400;
const RARE = 20;
const MOST_POINTS = 6000;
const MARK_S = 60;

/** The state of a run by the messages of the server. */
export class Run {
  constructor() {
    this.scene = null;
    this.stations = new Stations();
    this.had = new Set(); // what this run has had, for the legend: links, lost frames, kinds of marks
    this.forget();
  }

  /** Forget everything but the scene, since time has jumped. */
  forget() {
    this.now = null;
    this.places = []; // where robots and stations are, by address
    this.trails = [];
    this.events = [];
    this.marks = new Map();
    this.doing = new Doing();
    this.beliefs = { maps: [], ways: [], estimates: [] };
    this.frames = [];
    this.talks = [];
    this.counts = { frames: 0, lost: 0, unshown: 0, left_out: 0 };
  }

  /**
   * Take a message of the server; return whether it was one about the run.
   * @param {object} message
   */
  take(message) {
    if (message.say === "scene") {
      this.scene = message;
      this.stations = new Stations(message);
      this.had = new Set();
      this.forget();
      return true;
    }
    if (message.say !== "now") return false;
    if (message.fresh) {
      this.forget();
      this.trails = message.robots.map((_, robot) => message.trails.map(([time_s, ...places]) => [time_s, ...places[robot]]));
    }
    this.now = message;
    this.places = [...message.robots, ...this.stations.places];
    this.take_air(message);
    if (message.doing) this.doing = new Doing(message.doing);
    Object.assign(this.beliefs, message.beliefs);
    for (const [kind, rows] of Object.entries(this.beliefs)) if (rows.length) this.had.add(kind);
    if (this.doing.links.length) this.had.add("links");
    for (const { state } of this.doing.intervals) this.had.add(state);
    this.counts.left_out += message.left_out;
    for (const event of message.events) this.note(event);
    if (!message.fresh) message.robots.forEach(([x, y], robot) => this.extend(robot, message.time_s, x, y));
    if (message.robots.some(([, , , down]) => down)) this.had.add("down");
    return true;
  }

  take_air({ frames, talks = [], frames_seen = 0, frames_lost = 0, frames_left_out = 0 }) {
    this.frames = frames.map(([start_s, end_s, source, destination, kind, outcome, length, channel, lt_addr, part, radio]) =>
      ({ start_s, end_s, source, destination, kind, outcome, length, channel, lt_addr, part, radio, good: outcome === "received" || outcome === "" })); // on the air: not known yet
    this.talks = talks;
    Object.assign(this.counts, { frames: frames_seen, lost: frames_lost, unshown: frames_left_out });
    if (frames_seen) this.had.add("frames");
    if (frames_lost) this.had.add("lost");
  }

  /** The frames that are in the air now. */
  get flying() {
    return this.frames.filter(({ end_s }) => end_s > this.now.time_s);
  }

  /** How much of a frame is still to be seen: 1 in the air, from then on less. */
  glow({ end_s }) {
    return Math.min(1, 1 - (this.now.time_s - end_s) / (GLOW_S * this.now.speed));
  }

  /** How much of a talk is still to be seen. */
  talk_glow([, , at_s]) {
    return Math.max(0, 1 - (this.now.time_s - at_s) / (TALK_S * this.now.speed));
  }

  extend(robot, time_s, x, y) {
    const trail = (this.trails[robot] ??= []);
    const last = trail[trail.length - 1];
    if (last && Math.hypot(last[1] - x, last[2] - y) < 0.02) return;
    trail.push([time_s, x, y]);
    if (trail.length > MOST_POINTS) this.trails[robot] = trail.filter((_, at) => at % 2 || at > MOST_POINTS / 2); // of long ago half will do
  }

  /** The trail of a robot in the last *span_s*. */
  trail(robot, span_s) {
    const trail = this.trails[robot] ?? [];
    const since_s = this.now.time_s - span_s;
    const first = trail.findIndex(([time_s]) => time_s >= since_s);
    return first < 0 ? [] : trail.slice(first);
  }

  note([number, time_s, robot, name, fields]) {
    const event = { number, time_s, robot, name, fields };
    this.events.push(event);
    if (this.events.length > MOST_EVENTS * 1.5) this.events = kept(this.events);
    for (const key of Object.keys(fields)) {
      const other = `${key.slice(0, -3)}y_m`;
      if (!key.endsWith("x_m") || typeof fields[key] !== "number" || typeof fields[other] !== "number") continue;
      const prefix = key.slice(0, -4);
      const kind = mark_kind(prefix, name);
      const place = kind === "goal" ? `goal ${robot}` : `${name} ${prefix} ${robot} ${number % 12}`;
      this.had.add(kind);
      this.marks.delete(place);
      this.marks.set(place, { x: fields[key], y: fields[other], robot, name, kind, time_s });
    }
    if (/(Ended|Reached|Arrived)$/.test(name)) this.marks.delete(`goal ${robot}`);
  }

  /** The marks that are still visible: goals until the next one, all others for a while. */
  seen_marks() {
    const now_s = this.now?.time_s ?? 0;
    for (const [place, mark] of this.marks) {
      if (mark.kind !== "goal" && mark.time_s < now_s - MARK_S) this.marks.delete(place);
    }
    return [...this.marks.values()];
  }
}

/** The latest events, and all of a kind that is rare. */
function kept(events) {
  const counts = new Map();
  for (const { name } of events) counts.set(name, (counts.get(name) ?? 0) + 1);
  const late = events.length - MOST_EVENTS;
  return events.filter(({ name }, at) => at >= late || counts.get(name) <= RARE);
}

function mark_kind(prefix, name) {
  const text = `${prefix} ${name}`.toLowerCase();
  if (/goal|target/.test(text)) return "goal";
  if (/ghost|lost/.test(text)) return "ghost";
  if (/frontier|path/.test(text)) return "frontier";
  return "mark";
}
