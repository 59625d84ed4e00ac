// What a page knows of a run: the scene, the latest moment, and what has happened lately.

const TRAIL_S = 120;
const MOST_EVENTS = 400;
const MOST_FRAMES = 400;
const MARK_S = 60;

/** The state of a run by the messages of the server. */
export class Run {
  constructor() {
    this.scene = null;
    this.forget();
  }

  /** Forget everything but the scene, since time has jumped. */
  forget() {
    this.now = null;
    this.trails = [];
    this.events = [];
    this.marks = new Map();
    this.flights = [];
    this.links = new Map();
    this.counts = { frames: 0, lost: 0, left_out: 0 };
  }

  /**
   * Take a message of the server; return whether it was one about the run.
   * @param {object} message
   * @param {number} wall_ms when it came, for what fades
   */
  take(message, wall_ms) {
    if (message.say === "scene") {
      this.scene = message;
      this.forget();
      return true;
    }
    if (message.say !== "now") return false;
    if (message.fresh) {
      this.forget();
      const step = Math.max(1, message.trails.length);
      const since = message.time_s - Math.min(TRAIL_S, message.time_s);
      this.trails = message.robots.map((_, robot) =>
        message.trails.map((tick, n) => [since + ((message.time_s - since) * n) / step, ...tick[robot]]));
    }
    this.now = message;
    this.counts.left_out += message.left_out;
    for (const event of message.events) this.note(event);
    if (!message.fresh) {
      message.robots.forEach(([x, y], robot) => this.extend(robot, message.time_s, x, y));
      for (const frame of message.frames) this.fly(frame, wall_ms);
    }
    return true;
  }

  extend(robot, time_s, x, y) {
    const trail = (this.trails[robot] ??= []);
    const last = trail[trail.length - 1];
    if (last && Math.hypot(last[1] - x, last[2] - y) < 0.02) return;
    trail.push([time_s, x, y]);
    let old = 0;
    while (old < trail.length && trail[old][0] < time_s - TRAIL_S) old += 1;
    if (old > 100) trail.splice(0, old);
  }

  note([number, time_s, robot, name, fields]) {
    const event = { number, time_s, robot, name, fields };
    this.events.push(event);
    if (this.events.length > MOST_EVENTS * 1.5) this.events.splice(0, this.events.length - MOST_EVENTS);
    for (const key of Object.keys(fields)) {
      const other = `${key.slice(0, -3)}y_m`;
      if (!key.endsWith("x_m") || typeof fields[key] !== "number" || typeof fields[other] !== "number") continue;
      const prefix = key.slice(0, -4);
      const kind = mark_kind(prefix, name);
      const place = kind === "goal" ? `goal ${robot}` : `${name} ${prefix} ${robot} ${number % 12}`;
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

  fly([, source, destination, kind, outcome], wall_ms) {
    const good = /^(received|delivered|ok)$/i.test(outcome);
    this.counts.frames += 1;
    this.counts.lost += good ? 0 : 1;
    if (this.flights.length < MOST_FRAMES) this.flights.push({ source, destination, kind, good, wall_ms });
    if (good && destination >= 0) {
      this.links.set(`${Math.min(source, destination)} ${Math.max(source, destination)}`, wall_ms);
    }
  }

  /** Drop frames and links that have faded at `wall_ms`; return whether any are left. */
  fade(wall_ms, flight_ms, link_ms) {
    this.flights = this.flights.filter((flight) => wall_ms - flight.wall_ms < flight_ms);
    for (const [pair, at_ms] of this.links) if (wall_ms - at_ms > link_ms) this.links.delete(pair);
    return this.flights.length > 0 || this.links.size > 0;
  }
}

function mark_kind(prefix, name) {
  const text = `${prefix} ${name}`.toLowerCase();
  if (/goal|target/.test(text)) return "goal";
  if (/ghost|lost/.test(text)) return "ghost";
  if (/frontier|path/.test(text)) return "frontier";
  return "mark";
}
