// The floor on a canvas: walls, base, goals, trails, robots, and frames as they fly. x to the right, y up, in metres.

import { Lens } from "./lens.js";

export const FLIGHT_MS = 450;
export const LINK_MS = 2500;
const ROBOT_COLOURS = 8;
const LEAST_RADIUS_PX = 6;
const MARGIN_PX = 22;
const LABEL_PX = 16;
const DIGIT_PX = 7;
const NEAR_PX = 14; // a click as near to something as this is a click on it
const ALONE_PX = 40; // robots farther away than this hardly move a robot's label

/** Draws a run on a canvas; requests no frame of the browser while nothing changes. */
export class Floor {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./run.js").Run} run
   * @param {(robot: number | null) => void} picked is called with the robot that has been clicked on
   */
  constructor(canvas, run, picked = () => {}) {
    this.canvas = canvas;
    this.run = run;
    this.picked = picked;
    this.selected = null;
    this.extras = []; // functions (pen, floor) that draw on top: routes of a plan, for example
    this.labels = []; // places of the robots' labels (px)
    this.asked = false;
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    new ResizeObserver(() => this.resize()).observe(canvas);
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.recolour());
    this.colours = {};
    this.lens = new Lens(this);
    this.lens.show();
    canvas.addEventListener("click", (event) => this.picked(this.robot_at(event)));
    this.recolour();
  }

  /** Draw at the next opportunity. */
  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.paint(now);
    });
  }

  /** The colour of a robot. */
  colour(robot) {
    return this.colours[`robot-${((robot % ROBOT_COLOURS) + ROBOT_COLOURS) % ROBOT_COLOURS}`];
  }

  /** Where a point of the floor (m) is on the canvas (px). */
  place([x, y]) {
    return [this.left + x * this.scale, this.top - y * this.scale];
  }

  /** Which point of the floor (m) an event of the mouse is at. */
  point(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left - this.left) / this.scale, (this.top - (event.clientY - box.top)) / this.scale];
  }

  /** The point of the floor (m) in the middle of the canvas. */
  middle() {
    const { clientWidth, clientHeight } = this.canvas;
    return [(clientWidth / 2 - this.left) / this.scale, (this.top - clientHeight / 2) / this.scale];
  }

  /** The extent of the floor (m): least x and y, greatest x and y. */
  get bounds_m() {
    return this.run.scene?.bounds_m ?? [0, 0, 1, 1];
  }

  /** The point of the floor next to a point (m), which may be off it. */
  on_floor([x, y]) {
    const [x_min, y_min, x_max, y_max] = this.bounds_m;
    return [Math.min(x_max, Math.max(x_min, x)), Math.min(y_max, Math.max(y_min, y))];
  }

  /** The robot that an event of the mouse is at, at most some px from what is drawn of it; null if there is none. */
  robot_at(event, reach_px = NEAR_PX) {
    const robots = (this.run.now?.robots ?? []).map((place, robot) => ({ robot, far_px: this.far_px(event, place) }));
    const near = robots.filter(({ robot, far_px }) => far_px < Math.max(reach_px, this.radius(robot)));
    return nearest(near)?.robot ?? null;
  }

  /**
   * The named place of the floor that an event of the mouse is at, or null: {place, point}, its name (its coordinates,
   * if others have the same name) and where it is (m).
   */
  named_at(event) {
    const { places_m = {}, base_m = null } = this.run.scene ?? {};
    const named = Object.entries(places_m).flatMap(([name, points]) =>
      points.map((point) => ({ place: points.length === 1 ? name : point, point })));
    if (base_m && !places_m.base) named.push({ place: "base", point: base_m });
    const far = named.map(({ place, point: [x, y] }) => {
      const letter_m = (this.letter_px([x, y]) + 4) / this.scale;
      const far_px = Math.min(this.far_px(event, [x, y]), this.far_px(event, [x, y + letter_m]));
      return { place, point: [x, y], far_px };
    });
    return nearest(far.filter(({ far_px }) => far_px < NEAR_PX));
  }

  /** How far an event of the mouse is from a point of the floor, px. */
  far_px(event, [x, y]) {
    const [own_x, own_y] = this.point(event);
    return Math.hypot(x - own_x, y - own_y) * this.scale;
  }

  recolour() {
    const style = getComputedStyle(document.documentElement);
    const names = ["paper", "ink", "quiet", "line", "accent", "bad", "wall", "solid", "floor", "base"];
    for (let robot = 0; robot < ROBOT_COLOURS; robot += 1) names.push(`robot-${robot}`);
    for (const name of names) this.colours[name] = style.getPropertyValue(`--${name}`).trim();
    this.draw();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    this.canvas.width = Math.max(1, Math.round(clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(clientHeight * ratio));
    this.ratio = ratio;
    const [x_min, y_min, x_max, y_max] = this.bounds_m;
    const width_m = Math.max(x_max - x_min, 0.1);
    const height_m = Math.max(y_max - y_min, 0.1);
    const wide = (clientWidth - 2 * MARGIN_PX) / width_m;
    const high = (clientHeight - 2 * MARGIN_PX) / height_m;
    this.scale = Math.max(1e-3, Math.min(wide, high)) * this.lens.zoom;
    const [x, y] = this.lens.centre ?? [(x_min + x_max) / 2, (y_min + y_max) / 2];
    this.left = clientWidth / 2 - x * this.scale;
    this.top = clientHeight / 2 + y * this.scale;
    this.draw();
  }

  paint(wall_ms) {
    const { run, canvas } = this;
    const pen = canvas.getContext("2d");
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (!run.scene) return;
    pen.lineCap = pen.lineJoin = "round";
    this.labels = (run.now?.robots ?? []).map((_, robot) => this.label_at(robot));
    this.paint_floor(pen);
    this.paint_trails(pen);
    const moving = run.fade(wall_ms, FLIGHT_MS, LINK_MS);
    this.paint_links(pen, wall_ms);
    for (const mark of run.seen_marks()) this.paint_mark(pen, mark);
    for (const extra of this.extras) extra(pen, this);
    for (const flight of run.flights) this.paint_flight(pen, flight, (wall_ms - flight.wall_ms) / FLIGHT_MS);
    this.paint_places(pen, run.scene);
    run.now?.robots.forEach((robot, number) => this.paint_robot(pen, number, robot));
    run.now?.robots.forEach((_, number) => this.paint_label(pen, number)); // after all robots, so that none hides the label of another
    pen.globalAlpha = 1;
    if (moving) this.draw();
  }

  paint_floor(pen) {
    const { scene } = this.run;
    const [x_min, y_min, x_max, y_max] = scene.bounds_m;
    const [left, top] = this.place([x_min, y_max]);
    pen.fillStyle = this.colours.floor;
    pen.fillRect(left, top, (x_max - x_min) * this.scale, (y_max - y_min) * this.scale);
    pen.fillStyle = this.colours.solid;
    for (const polygon of scene.polygons_m) {
      pen.beginPath();
      for (const point of polygon) pen.lineTo(...this.place(point));
      pen.closePath();
      pen.fill();
    }
    pen.strokeStyle = this.colours.wall;
    pen.lineWidth = 1.6;
    pen.beginPath();
    for (const [x1, y1, x2, y2] of scene.walls_m) {
      pen.moveTo(...this.place([x1, y1]));
      pen.lineTo(...this.place([x2, y2]));
    }
    pen.stroke();
    if (scene.base_m) this.triangle(pen, this.place(scene.base_m), 10, this.colours.base);
  }

  paint_places(pen, scene) {
    pen.globalAlpha = 1;
    pen.fillStyle = this.colours.quiet;
    pen.strokeStyle = this.colours.floor;
    pen.lineWidth = 3;
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    const names = new Map(); // by point: one may have several names
    for (const [name, points] of Object.entries(scene.places_m)) {
      for (const point of points.slice(0, 40)) {
        const [x, y] = this.place(point);
        pen.fillRect(x - 1, y - 1, 2, 2);
      }
      const at = String(points[0]);
      if (points.length === 1) names.set(at, { point: points[0], text: names.has(at) ? `${names.get(at).text}, ${name}` : name });
    }
    for (const { point, text } of names.values()) {
      const [x, y] = this.place(point);
      const above = this.letter_px(point);
      pen.strokeText(text, x, y - above);
      pen.fillText(text, x, y - above);
    }
  }

  /** Distance of a place's name above it (px): above what may be drawn around it, and the label of a robot there. */
  letter_px(point) {
    const [x, y] = this.place(point);
    const taken = this.labels.some(([label_x, label_y]) =>
      Math.abs(label_x - x) < LABEL_PX && Math.abs(label_y - y + LABEL_PX + 4) < LABEL_PX - 2);
    return taken ? 2 * LABEL_PX : LABEL_PX;
  }

  paint_trails(pen) {
    pen.lineWidth = 1.5;
    pen.lineCap = "butt"; // the pieces must not overlap
    this.run.trails.forEach((trail, robot) => {
      pen.strokeStyle = this.colour(robot);
      for (let from = 0; from < trail.length - 1; from += 40) { // in pieces, of which older ones are fainter
        pen.globalAlpha = 0.12 + (0.4 * from) / trail.length;
        pen.beginPath();
        for (const [, x, y] of trail.slice(from, from + 41)) pen.lineTo(...this.place([x, y]));
        pen.stroke();
      }
    });
    pen.lineCap = "round";
    pen.globalAlpha = 1;
  }

  paint_links(pen, wall_ms) {
    const robots = this.run.now?.robots ?? [];
    pen.strokeStyle = this.colours.accent;
    pen.lineWidth = 2;
    for (const [pair, at_ms] of this.run.links) {
      const [one, two] = pair.split(" ").map(Number);
      if (!robots[one] || !robots[two]) continue;
      pen.globalAlpha = 0.45 * (1 - (wall_ms - at_ms) / LINK_MS);
      this.line(pen, this.place(robots[one]), this.place(robots[two]));
    }
    pen.globalAlpha = 1;
  }

  paint_flight(pen, { source, destination, good }, part) {
    const robots = this.run.now?.robots ?? [];
    if (!robots[source] || part < 0) return;
    const [x, y] = this.place(robots[source]);
    pen.globalAlpha = Math.max(0, 1 - part) * 0.9;
    pen.strokeStyle = pen.fillStyle = good ? this.colours.accent : this.colours.bad;
    pen.lineWidth = 1.4;
    if (!robots[destination]) {
      pen.beginPath();
      pen.arc(x, y, 8 + 40 * (this.still.matches ? 1 : part), 0, 2 * Math.PI);
      pen.stroke();
      return;
    }
    const [to_x, to_y] = this.place(robots[destination]);
    pen.setLineDash(good ? [] : [4, 4]);
    this.line(pen, [x, y], [to_x, to_y]);
    pen.setLineDash([]);
    if (this.still.matches) return;
    pen.beginPath();
    pen.arc(x + (to_x - x) * part, y + (to_y - y) * part, 3, 0, 2 * Math.PI);
    pen.fill();
  }

  paint_mark(pen, mark) {
    const [x, y] = this.place([mark.x, mark.y]);
    pen.strokeStyle = this.colour(mark.robot);
    pen.lineWidth = 2;
    pen.globalAlpha = 0.85;
    pen.beginPath();
    if (mark.kind === "goal") pen.arc(x, y, 9, 0, 2 * Math.PI);
    else if (mark.kind === "frontier") pen.rect(x - 5, y - 5, 10, 10);
    else if (mark.kind === "ghost") {
      pen.setLineDash([3, 3]);
      pen.arc(x, y, 8, 0, 2 * Math.PI);
    } else {
      pen.moveTo(x - 4, y - 4);
      pen.lineTo(x + 4, y + 4);
      pen.moveTo(x - 4, y + 4);
      pen.lineTo(x + 4, y - 4);
    }
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  paint_robot(pen, robot, [x_m, y_m, heading, down]) {
    const [x, y] = this.place([x_m, y_m]);
    const radius = this.radius(robot);
    pen.globalAlpha = 1;
    pen.fillStyle = down ? this.colours.paper : this.colour(robot);
    pen.strokeStyle = down ? this.colours.quiet : this.colours.paper;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.fill();
    pen.stroke();
    this.line(pen, [x, y], [x + radius * Math.cos(heading), y - radius * Math.sin(heading)]);
    if (robot === this.selected) {
      pen.strokeStyle = this.colours.ink;
      pen.beginPath();
      pen.arc(x, y, radius + 4, 0, 2 * Math.PI);
      pen.stroke();
    }
  }

  paint_label(pen, robot) {
    const text = this.label(robot);
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.strokeStyle = this.colours.paper;
    pen.fillStyle = this.colours.ink;
    pen.lineWidth = 3;
    const at = this.labels[robot];
    pen.strokeText(text, ...at);
    pen.fillText(text, ...at);
    pen.textBaseline = "alphabetic";
  }

  label(robot) {
    return `${robot}${this.run.now.robots[robot][3] ? " †" : ""}`;
  }

  /** Where on the canvas (px) the middle of a robot's label is. */
  label_at(robot) {
    const [right, below] = this.free_side(robot);
    const [x, y] = this.place(this.run.now.robots[robot]);
    const radius = this.radius(robot);
    return [x + right * (radius + 4 + DIGIT_PX * this.label(robot).length / 2), y + below * (radius + 9)];
  }

  /** Radius of a drawn robot, px. */
  radius(robot) {
    return Math.max(LEAST_RADIUS_PX, (this.run.scene.radii_m[robot] ?? 0.2) * this.scale);
  }

  /** The direction, of length 1, in which a robot has no others near it; down to the right, if there are none at all. */
  free_side(robot) {
    const { robots } = this.run.now;
    const [own_x, own_y] = robots[robot];
    let [right, down] = [1 / ALONE_PX, 1 / ALONE_PX]; // names of places are above
    for (const [x, y] of robots) {
      const [away_x, away_y] = [(own_x - x) * this.scale, (y - own_y) * this.scale];
      const far = Math.max(1, Math.hypot(away_x, away_y));
      right += away_x / far ** 2; // near robots count more
      down += away_y / far ** 2;
    }
    const length = Math.hypot(right, down) || 1;
    return [right / length, down / length];
  }

  triangle(pen, [x, y], size, colour) {
    pen.fillStyle = colour;
    pen.beginPath();
    pen.moveTo(x, y - size);
    pen.lineTo(x + size * 0.9, y + size * 0.7);
    pen.lineTo(x - size * 0.9, y + size * 0.7);
    pen.closePath();
    pen.fill();
  }

  line(pen, from, to) {
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...to);
    pen.stroke();
  }
}

/** The nearest of some things by their `far_px`. */
function nearest(things) {
  return things.reduce((best, each) => (best && best.far_px <= each.far_px ? best : each), null);
}
