// Marks below the slider of time: when which events happen in a recorded run, by colour and shape of their kinds.

import { outline } from "./bodies.js";

const SHAPES = ["circle", "square", "diamond", "triangle"];
const COLOURS = 10; // --kind-0 to --kind-9
const THUMB_PX = 16; // of the slider, whose middle is at the time
const RADIUS_PX = 3.5;
const TALL_PX = 12;

/** The marks, for those who see them: the list of events says the same in words. */
export class Marks {
  /** @param {HTMLInputElement} slider is put into the root, above the marks */
  constructor(slider) {
    this.canvas = document.createElement("canvas");
    this.canvas.id = "marks";
    this.canvas.setAttribute("aria-hidden", "true");
    this.root = document.createElement("div");
    this.root.className = "track";
    this.root.append(slider, this.canvas);
    this.kinds = [];
    this.rows = [];
    this.ordered = [];
    this.duration_s = 1;
    this.kind = "";
    this.robot = null;
    new ResizeObserver(() => this.paint()).observe(this.root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
  }

  /** Take the scene: which events the run has, if that is known. */
  begin({ marks = { kinds: [], rows: [] }, duration_s }) {
    Object.assign(this, marks, { duration_s });
    const counts = this.kinds.map((_, kind) => this.rows.filter(([, , of]) => of === kind).length);
    this.ordered = [...this.rows].sort(([, , one], [, , other]) => counts[other] - counts[one]); // what is rare lies on top
    this.canvas.hidden = this.rows.length === 0;
    this.paint();
  }

  /** Show only the events of a kind ("": of all), and of a robot (null: of all). */
  show(kind, robot) {
    if (kind === this.kind && robot === this.robot) return;
    Object.assign(this, { kind, robot });
    this.paint();
  }

  /** The rows that are shown, as they are painted; one without a robot stands for events of any. */
  get shown() {
    const kind = this.kind ? this.kinds.indexOf(this.kind) : null;
    return this.ordered.filter(([, robot, of]) =>
      (kind === null || of === kind) && (this.robot === null || robot === null || robot === this.robot));
  }

  /** The sign of a kind, as an element; none if the run's kinds are not known. */
  signs(name) {
    const kind = this.kinds.indexOf(name);
    if (kind < 0) return [];
    const sign = document.createElement("span");
    sign.className = `chip sign ${shape(kind)}`;
    sign.style.background = `var(--kind-${kind % COLOURS})`;
    sign.setAttribute("aria-hidden", "true");
    return [sign];
  }

  paint() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = this.root.clientWidth;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(TALL_PX * ratio);
    const pen = canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    pen.scale(ratio, ratio);
    for (const [time_s, , kind] of this.shown) {
      const x = THUMB_PX / 2 + (time_s / this.duration_s) * (width - THUMB_PX);
      pen.fillStyle = style.getPropertyValue(`--kind-${kind % COLOURS}`);
      outline(pen, shape(kind), [x, TALL_PX / 2], RADIUS_PX);
      pen.fill();
    }
  }
}

function shape(kind) {
  return SHAPES[kind % SHAPES.length];
}
