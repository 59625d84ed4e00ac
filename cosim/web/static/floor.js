// The floor on a canvas: walls, base, goals, trails, robots, and frames as they fly. x to the right, y up, in metres.

import { paint_hindrances, paint_label, paint_mark, paint_robot, paint_station, paint_trails, radius_px } from "./bodies.js";
import { paint_estimates, paint_ways } from "./beliefs/ways.js";
import { paint_ground, paint_places, paint_walls } from "./ground.js";
import { Lens } from "./lens.js";
import { paint_frames, paint_jammers, paint_links, paint_routes, paint_searches, paint_talks } from "./radio.js";

const ROBOT_COLOURS = 10;
const SHAPES = ["circle", "square", "diamond", "triangle"]; // the first ten robots are circles, and so on
const MARGIN_PX = 22;
const TOP_PX = 44; // of it above, where the buttons are
const LABEL_PX = 16;
const DIGIT_PX = 7;
const NEAR_PX = 14; // a click as near to something as this is a click on it
const ALONE_PX = 40; // robots farther away than this hardly move a robot's label

/** Draws a run on a canvas; requests no frame of the browser while nothing changes. */
export class Floor {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./run.js").Run} run
   * @param {(layer: string) => boolean} visible whether a layer is on
   * @param {(address: number | null) => void} picked is called with the robot, or station, that has been clicked on
   */
  constructor(canvas, run, visible = () => true, picked = () => {}) {
    this.canvas = canvas;
    this.run = run;
    this.visible = visible;
    this.picked = picked;
    this.selected = null; // the address of a robot, or of a station
    this.trail_s = 120;
    this.below = []; // functions (pen, floor) that draw on the ground, below all else: a range, for example
    this.extras = []; // functions (pen, floor) that draw on top: routes of a plan, for example
    this.labels = []; // places of the labels of robots and stations (px)
    this.painted = { frames: [], links: [] }; // what the floor shows of these now
    this.asked = false;
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    new ResizeObserver(() => this.resize()).observe(canvas);
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.recolour());
    this.colours = {};
    this.lens = new Lens(this);
    this.lens.show();
    canvas.addEventListener("click", (event) => this.picked(this.address_at(event)));
    this.recolour();
  }

  /** Draw at the next opportunity. */
  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.paint();
    });
  }

  /** The robot that is selected; null if none is, but perhaps a station. */
  get robot() {
    return this.run.stations.has(this.selected) ? null : this.selected;
  }

  /** The colour of a robot, or that of stations. */
  colour(robot) {
    if (this.run.stations.has(robot)) return this.colours.quiet;
    return this.colours[`robot-${((robot % ROBOT_COLOURS) + ROBOT_COLOURS) % ROBOT_COLOURS}`];
  }

  /** The shape of a robot, which differs where colours do not, or that of stations. */
  shape(robot) {
    if (this.run.stations.has(robot)) return "square";
    return SHAPES[Math.floor(Math.max(0, robot) / ROBOT_COLOURS) % SHAPES.length];
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

  /** The robot or station that an event of the mouse is at, at most some px from what is drawn of it; null: none is there. */
  address_at(event, reach_px = NEAR_PX) {
    const all = this.run.places.map((place, address) => ({ address, far_px: this.far_px(event, place) }));
    const near = all.filter(({ address, far_px }) => far_px < Math.max(reach_px, radius_px(this, address)));
    return nearest(near)?.address ?? null;
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
    const high = (clientHeight - MARGIN_PX - TOP_PX) / height_m;
    this.scale = Math.max(1e-3, Math.min(wide, high)) * this.lens.zoom;
    const [x, y] = this.lens.centre ?? [(x_min + x_max) / 2, (y_min + y_max) / 2];
    this.left = clientWidth / 2 - x * this.scale;
    this.top = clientHeight / 2 + y * this.scale + (this.lens.centre ? 0 : (TOP_PX - MARGIN_PX) / 2);
    this.draw();
  }

  paint() {
    const { run, canvas } = this;
    const pen = canvas.getContext("2d");
    if (this.lens.follows()) this.resize();
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (!run.scene) return;
    pen.lineCap = pen.lineJoin = "round";
    this.labels = run.places.map((_, address) => this.label_at(address));
    paint_ground(pen, this);
    for (const each of this.below) each(pen, this);
    paint_walls(pen, this, this.visible("ranges"));
    if (run.now) this.paint_run(pen, run);
    for (const extra of this.extras) extra(pen, this);
    if (this.visible("names")) paint_places(pen, this);
    run.places.forEach((place, address) => {
      if (run.stations.has(address)) paint_station(pen, this, address, place);
      else paint_robot(pen, this, address, place);
    });
    if (run.now && this.visible("jammers")) paint_hindrances(pen, this);
    if (this.visible("names")) run.places.forEach((_, address) => paint_label(pen, this, address)); // after all robots, so that none hides the label of another
    pen.globalAlpha = 1;
  }

  /** Paint what happens between robots. */
  paint_run(pen, run) {
    if (this.visible("trails")) paint_trails(pen, this, this.trail_s);
    if (this.visible("frames")) paint_talks(pen, this);
    this.painted.links = this.visible("links") ? paint_links(pen, this) : [];
    if (this.visible("links")) paint_searches(pen, this);
    if (this.visible("routes")) paint_routes(pen, this, this.selected);
    if (this.visible("ways")) paint_ways(pen, this);
    if (this.visible("estimates")) paint_estimates(pen, this);
    if (this.visible("marks")) for (const mark of run.seen_marks()) paint_mark(pen, this, mark);
    this.painted.frames = this.visible("frames") ? paint_frames(pen, this) : [];
    if (this.visible("jammers")) paint_jammers(pen, this);
  }

  /** Write some words around a point, so that they can be read on anything. */
  text(pen, words, at, colour, around) {
    pen.strokeStyle = around;
    pen.fillStyle = colour;
    pen.lineWidth = 3;
    pen.strokeText(words, ...at);
    pen.fillText(words, ...at);
  }

  /** Distance of a place's name above it (px): above what may be drawn around it, and the label of a robot there. */
  letter_px(point) {
    const [x, y] = this.place(point);
    const taken = this.labels.some(([label_x, label_y]) =>
      Math.abs(label_x - x) < LABEL_PX && Math.abs(label_y - y + LABEL_PX + 4) < LABEL_PX - 2);
    return taken ? 2 * LABEL_PX : LABEL_PX;
  }

  label(address) {
    const { stations, places } = this.run;
    return `${stations.short(address)}${places[address][3] ? " †" : ""}`;
  }

  /** Where on the canvas (px) the middle of the label of a robot, or station, is. */
  label_at(address) {
    const [right, below] = this.free_side(address);
    const [x, y] = this.place(this.run.places[address]);
    const radius = radius_px(this, address);
    return [x + right * (radius + 4 + DIGIT_PX * this.label(address).length / 2), y + below * (radius + 9)];
  }

  /** The direction, of length 1, in which a robot has no others near it; down to the right, if there are none at all. */
  free_side(address) {
    const { places } = this.run;
    const [own_x, own_y] = places[address];
    let [right, down] = [1 / ALONE_PX, 1 / ALONE_PX]; // names of places are above
    for (const [x, y] of places) {
      const [away_x, away_y] = [(own_x - x) * this.scale, (y - own_y) * this.scale];
      const far = Math.max(1, Math.hypot(away_x, away_y));
      right += away_x / far ** 2; // near robots count more
      down += away_y / far ** 2;
    }
    const length = Math.hypot(right, down) || 1;
    return [right / length, down / length];
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
