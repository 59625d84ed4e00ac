// What the range scanner of the chosen robot reads, as the server computes it on request.

const WAIT_MS = 100;
const FAN = 0.1;
const POINT_PX = 2;

/** Asks for scans, and paints the last one. */
export class Scans {
  /**
   * @param {import("../floor.js").Floor} floor
   * @param {(message: object) => boolean} send
   */
  constructor(floor, send) {
    this.floor = floor;
    this.send = send;
    this.forget();
    floor.extras.push((pen) => this.paint(pen)); // on top of walls, which it ends at
  }

  /** Forget what is known: it was about another run. */
  forget() {
    this.known = null;
    this.asked_ms = -Infinity;
    this.waits = false;
  }

  /** Ask for the scan of the chosen robot, if it is wanted and not that of this tick. */
  ask() {
    if (!this.wanted || this.current || this.waits) return;
    const wait_ms = this.asked_ms + WAIT_MS - performance.now();
    this.waits = true;
    setTimeout(() => {
      this.waits = false;
      this.asked_ms = performance.now();
      if (this.wanted) this.send({ say: "scan", robot: this.floor.robot });
    }, Math.max(0, wait_ms));
  }

  /** Whether a scan is to be shown: of a chosen robot that has a scanner, once the run has begun. */
  get wanted() {
    const { floor } = this;
    const { scene, now } = floor.run;
    return floor.robot !== null && floor.visible("scans") && Boolean(scene?.scanner) && now && (!scene.live || now.time_s > 0);
  }

  /** Whether what is known is the scan of this tick. */
  get current() {
    const { scene, now } = this.floor.run;
    const tick_s = scene.tick_s;
    return this.known?.robot === this.floor.robot
      && Math.abs(this.known.time_s - Math.floor(now.time_s / tick_s + 1e-6) * tick_s) < tick_s / 2;
  }

  /** Take an answer; return whether the message was one. */
  take(message) {
    if (message.say !== "scan") return false;
    this.known = message;
    this.floor.draw();
    return true;
  }

  /** What is shown: the last answer; null if nothing is. */
  get shown() {
    return this.wanted && this.known?.robot === this.floor.robot ? this.known : null;
  }

  /** What is shown, in words: [what, of whom, words]. */
  get words() {
    if (!this.shown) return [];
    const { robot, ranges_m, turned_rad } = this.shown;
    const met = ranges_m.filter((far_m) => far_m !== null);
    const nearest_m = Math.min(...met);
    const angle = turned_rad + (2 * Math.PI * ranges_m.indexOf(nearest_m)) / ranges_m.length;
    const degrees = Math.round((((angle * 180) / Math.PI) % 360) + 360) % 360;
    const nearest = met.length ? `, the nearest ${nearest_m.toFixed(2)} m off at ${degrees}°` : "";
    return [["scan", `robot ${robot}`, `${met.length} of ${ranges_m.length} beams meet something${nearest}`]];
  }

  paint(pen) {
    const { floor, shown } = this;
    if (!shown) return;
    const { place_m: [x, y], turned_rad, range_m, ranges_m, robot } = shown;
    const ends = ranges_m.map((far_m, beam) => {
      const angle = turned_rad + (2 * Math.PI * beam) / ranges_m.length;
      const reach_m = far_m ?? range_m;
      return floor.place([x + reach_m * Math.cos(angle), y + reach_m * Math.sin(angle)]);
    });
    pen.fillStyle = floor.colour(robot);
    pen.globalAlpha = FAN;
    pen.beginPath();
    for (const end of ends) pen.lineTo(...end);
    pen.closePath();
    pen.fill();
    pen.globalAlpha = 1;
    ends.forEach(([end_x, end_y], beam) => {
      if (ranges_m[beam] !== null) pen.fillRect(end_x - POINT_PX, end_y - POINT_PX, 2 * POINT_PX, 2 * POINT_PX);
    });
  }
}
