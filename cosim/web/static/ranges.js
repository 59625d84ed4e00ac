// How far the chosen robot, or station, is heard, as the server computes it on request: a disc, or a map of the received power.

const MOVED = 0.02; // share of the floor's size that a robot has moved before it is asked again
const WAIT_MS = 400;
const DEPTH_DB = 45; // above the faintest power, at which the map is darkest

/** Asks for the range of a robot, and paints it. */
export class Ranges {
  /**
   * @param {import("./floor.js").Floor} floor
   * @param {(message: object) => boolean} send
   */
  constructor(floor, send) {
    this.floor = floor;
    this.send = send;
    this.known = null; // the last answer
    this.picture = null; // of a map
    this.asked_ms = -Infinity;
    floor.below.push((pen) => this.paint(pen));
  }

  /** Forget what is known: it was about another run. */
  forget() {
    this.known = this.picture = null;
  }

  /** Ask for the range of the chosen robot, if it is wanted and not known. */
  ask() {
    const { floor } = this;
    const place = floor.run.places[floor.selected];
    if (!place || !floor.visible("ranges") || !floor.run.scene.radios?.length) return;
    const [x_min, y_min, x_max, y_max] = floor.bounds_m;
    const moved_m = MOVED * Math.max(x_max - x_min, y_max - y_min);
    const near = this.known?.robot === floor.selected && Math.hypot(this.known.place_m[0] - place[0], this.known.place_m[1] - place[1]) <= moved_m;
    if (near || performance.now() - this.asked_ms < WAIT_MS) return;
    this.asked_ms = performance.now();
    this.send({ say: "reach", robot: floor.selected, x_m: place[0], y_m: place[1] });
  }

  /** Take an answer; return whether the message was one. */
  take(message) {
    if (message.say !== "reach") return false;
    this.known = message;
    const mapped = message.radios.find(({ power_dbm }) => power_dbm);
    this.picture = mapped ? { ...mapped, canvas: this.drawn(mapped, message.robot) } : null;
    this.floor.draw();
    return true;
  }

  /** A small canvas with a pixel a cell, in the robot's colour, darker where it is louder. */
  drawn({ columns, rows, power_dbm, faintest_dbm }, robot) {
    const canvas = document.createElement("canvas");
    Object.assign(canvas, { width: columns, height: rows });
    const pen = canvas.getContext("2d");
    pen.fillStyle = this.floor.colour(robot);
    power_dbm.forEach((dbm, cell) => {
      if (dbm < faintest_dbm) return;
      pen.globalAlpha = 0.1 + 0.5 * Math.min(1, (dbm - faintest_dbm) / DEPTH_DB);
      pen.fillRect(cell % columns, rows - 1 - Math.floor(cell / columns), 1, 1);
    });
    return canvas;
  }

  paint(pen) {
    const { floor, known, picture } = this;
    if (!known || known.robot !== floor.selected || !floor.visible("ranges") || !floor.run.now) return;
    if (picture) {
      const { corner_m: [x, y], cell_m, columns, rows, canvas, faintest_dbm, kind } = picture;
      const [left, top] = floor.place([x, y + rows * cell_m]);
      pen.imageSmoothingEnabled = true;
      pen.drawImage(canvas, left, top, columns * cell_m * floor.scale, rows * cell_m * floor.scale);
      const words = kind === "vision" ? "" : `heard down to ${Number(faintest_dbm.toFixed(1))} dBm`;
      if (words) this.write(pen, words, [left + 8, top + 14]);
    }
    const at = floor.place(floor.run.places[known.robot]);
    for (const { radio, range_m, power_dbm } of known.radios) {
      if (range_m === null || power_dbm) continue;
      pen.strokeStyle = pen.fillStyle = floor.colour(known.robot);
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.arc(...at, range_m * floor.scale, 0, 2 * Math.PI);
      pen.globalAlpha = 0.08;
      if (range_m * floor.scale < floor.canvas.clientWidth) pen.fill();
      pen.globalAlpha = 1;
      pen.setLineDash([9, 5]);
      pen.stroke();
      pen.setLineDash([]);
      const words = known.radios.length > 1 ? `radio ${radio}: ${range_m} m` : `${range_m} m`;
      this.write(pen, words, [at[0] + 0.71 * range_m * floor.scale, at[1] - 0.71 * range_m * floor.scale]);
    }
    if (known.radios.every(({ range_m, power_dbm }) => range_m === null && !power_dbm)) this.write(pen, "heard everywhere", [at[0] + 12, at[1] - 22]);
  }

  write(pen, words, at) {
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "left";
    this.floor.text(pen, words, at, this.floor.colours.quiet, this.floor.colours.floor);
  }
}
