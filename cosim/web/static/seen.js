// What robots have had in sight so far, as far as their range scanners reach, and what they scan now.
// Both follow from where they have been and from the walls: no scanner's errors are in it, and no map that a robot keeps.

const BEAMS = 180; // of a look at the floor around a place
const LOOKS = 60; // places that are looked at for one picture; the others come with the next
const MOST_CELLS = 600; // along the longer side of a floor
const LEAST_CELL_M = 0.1;

/** Keeps what has been seen, and paints it and the scans of this moment. */
export class Seen {
  /** @param {import("./floor.js").Floor} floor */
  constructor(floor) {
    this.floor = floor;
    this.trails = null; // the trails that it is of: others mean that time has jumped
    this.chosen = null; // whose it is; null: the whole team's
    this.until_s = []; // up to when each robot's trail is in it
    this.waits = false; // whether there are places that nobody has looked around from yet
    floor.below.push((pen) => this.paint(pen));
  }

  /** Forget what has been seen: it was in another run, at another time, or by others. */
  begin() {
    const { run, selected } = this.floor;
    const { walls_m, polygons_m, bounds_m: [x_min, y_min, x_max, y_max] } = run.scene;
    this.trails = run.trails;
    this.chosen = selected;
    this.until_s = [];
    this.sides = [...walls_m, ...polygons_m.flatMap((points) => points.map((point, at) => [...point, ...points[(at + 1) % points.length]]))];
    this.cell_m = Math.max(LEAST_CELL_M, (x_max - x_min) / MOST_CELLS, (y_max - y_min) / MOST_CELLS);
    const canvas = document.createElement("canvas");
    canvas.width = Math.max(1, Math.ceil((x_max - x_min) / this.cell_m));
    canvas.height = Math.max(1, Math.ceil((y_max - y_min) / this.cell_m));
    this.pen = canvas.getContext("2d", { willReadFrequently: true });
    this.pen.setTransform(1 / this.cell_m, 0, 0, -1 / this.cell_m, -x_min / this.cell_m, y_max / this.cell_m);
  }

  /** Look around from places of the trails that are new, *most* at a time. */
  look(most = LOOKS) {
    const { run, selected } = this.floor;
    if (this.trails !== run.trails || this.chosen !== selected) this.begin();
    this.pen.fillStyle = this.floor.colours.accent;
    let left = most;
    for (const [robot, trail] of run.trails.entries()) {
      if (!trail || (this.chosen !== null && robot !== this.chosen)) continue;
      let at = trail.length;
      while (at > 0 && trail[at - 1][0] > (this.until_s[robot] ?? -1)) at -= 1;
      for (; at < trail.length && left > 0; at += 1, left -= 1) {
        const [time_s, x, y] = trail[at];
        this.until_s[robot] = time_s;
        outline(this.pen, fan([x, y], 0, BEAMS, run.scene.scanner.range_m, this.sides));
        this.pen.fill();
      }
    }
    this.waits = left === 0;
  }

  /** How much of the floor has been seen, m²; null if nobody looks. */
  get area_m2() {
    if (!this.floor.run.scene?.scanner || !this.floor.visible("seen")) return null;
    this.look(Infinity);
    const { width, height } = this.pen.canvas;
    const { data } = this.pen.getImageData(0, 0, width, height);
    let cells = 0;
    for (let at = 3; at < data.length; at += 4) cells += data[at] > 127;
    return cells * this.cell_m ** 2;
  }

  paint(pen) {
    const { floor } = this;
    const { run } = floor;
    if (!run.now || !run.scene.scanner) return;
    if (floor.visible("seen")) {
      this.look();
      const [x_min, , , y_max] = floor.bounds_m;
      const { canvas } = this.pen;
      const a_cell = this.cell_m * floor.scale;
      pen.globalAlpha = 0.22;
      pen.imageSmoothingEnabled = false;
      pen.drawImage(canvas, ...floor.place([x_min, y_max]), canvas.width * a_cell, canvas.height * a_cell);
      pen.globalAlpha = 1;
      if (this.waits) floor.draw();
    }
    if (floor.visible("scans")) this.paint_scans(pen);
  }

  /** Paint what robots scan now: the chosen one, or all. */
  paint_scans(pen) {
    const { floor } = this;
    const { scene, now, trails } = floor.run;
    const { range_m, beams } = scene.scanner;
    if (this.trails !== trails) this.begin();
    now.robots.forEach(([x, y, heading, down], robot) => {
      if (down || (floor.selected !== null && robot !== floor.selected)) return;
      const others = now.robots.flatMap((other, number) => (number === robot ? [] : [[other[0], other[1], scene.radii_m[number]]]));
      const ends = fan([x, y], heading, beams, range_m, this.sides, others);
      pen.fillStyle = pen.strokeStyle = floor.colour(robot);
      pen.lineWidth = 1;
      outline(pen, ends.map((end) => floor.place(end)));
      pen.globalAlpha = 0.12;
      pen.fill();
      pen.globalAlpha = 0.8;
      pen.stroke();
      for (const end of ends) {
        const [right, below] = floor.place(end);
        if (Math.hypot(end[0] - x, end[1] - y) < range_m - 1e-9) pen.fillRect(right - 1.5, below - 1.5, 3, 3); // it has met something
      }
    });
    pen.globalAlpha = 1;
  }
}

/**
 * Where the beams from a place end: at a wall, at a disc (x, y, radius), or at their range.
 * The first goes in the direction *heading*, the others follow counter-clockwise.
 */
export function fan([x, y], heading, beams, range_m, sides, discs = []) {
  const near = sides.filter(([x1, y1, x2, y2]) => far_m(x, y, x1, y1, x2, y2) <= range_m);
  const close = discs.filter(([x1, y1, radius_m]) => Math.hypot(x1 - x, y1 - y) <= range_m + radius_m);
  return Array.from({ length: beams }, (_, beam) => {
    const angle = heading + (2 * Math.PI * beam) / beams;
    const [across, up] = [Math.cos(angle), Math.sin(angle)];
    let length = range_m;
    for (const [x1, y1, x2, y2] of near) {
      const cross = across * (y2 - y1) - up * (x2 - x1);
      if (cross === 0) continue;
      const along = ((x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1)) / cross;
      const part = ((x1 - x) * up - (y1 - y) * across) / cross;
      if (along >= 0 && along < length && part >= 0 && part <= 1) length = along;
    }
    for (const [x1, y1, radius_m] of close) {
      const middle = (x1 - x) * across + (y1 - y) * up;
      const half2 = radius_m ** 2 - ((x1 - x) * up - (y1 - y) * across) ** 2;
      if (half2 >= 0 && middle > 0) length = Math.min(length, Math.max(0, middle - Math.sqrt(half2)));
    }
    return [x + across * length, y + up * length];
  });
}

/** How far a point is from a line's piece. */
function far_m(x, y, x1, y1, x2, y2) {
  const long2 = (x2 - x1) ** 2 + (y2 - y1) ** 2;
  const part = long2 ? Math.max(0, Math.min(1, ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / long2)) : 0;
  return Math.hypot(x1 + part * (x2 - x1) - x, y1 + part * (y2 - y1) - y);
}

function outline(pen, points) {
  pen.beginPath();
  for (const point of points) pen.lineTo(...point);
  pen.closePath();
}
