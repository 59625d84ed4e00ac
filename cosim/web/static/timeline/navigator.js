// The strip of the whole run: where the window is, which a drag moves, and what happened elsewhere.

const HANDLE_PX = 7;
const LEAST_BRACKET_PX = 4;
const LOST = 2;

/** The navigator on its canvas. */
export class Navigator {
  constructor(canvas, timeline) {
    this.canvas = canvas;
    this.timeline = timeline;
    this.drag = null;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, () => (this.drag = null));
  }

  place(ns) {
    const { axis } = this.timeline;
    return ((ns - axis.first_ns) / axis.whole_ns) * axis.width_px;
  }

  time(px) {
    const { axis } = this.timeline;
    return axis.first_ns + (px / axis.width_px) * axis.whole_ns;
  }

  paint(pen, height) {
    const { axis, kinds, windows, now_ns } = this.timeline;
    const { paint } = kinds;
    pen.clearRect(0, 0, axis.width_px, height);
    if (windows.overview) this.paint_overview(pen, windows.overview, height);
    const from = this.place(axis.from_ns);
    const wide = Math.max(LEAST_BRACKET_PX, this.place(axis.to_ns) - from);
    pen.fillStyle = paint.ink;
    pen.globalAlpha = 0.12;
    pen.fillRect(0, 0, from, height);
    pen.fillRect(from + wide, 0, axis.width_px, height);
    pen.globalAlpha = 1;
    pen.strokeStyle = paint.accent;
    pen.lineWidth = 2;
    pen.strokeRect(from + 1, 1, wide - 2, height - 2);
    pen.fillStyle = paint.ink;
    if (now_ns !== null) pen.fillRect(this.place(now_ns) - 0.5, 0, 1.5, height);
  }

  /** A column for each pixel: how much of the air was used, and below, as a mark of its own, where something was lost. */
  paint_overview(pen, overview, height) {
    const { axis, kinds, rows } = this.timeline;
    const width = Math.ceil(axis.width_px);
    if (this.seen?.overview !== overview || this.seen.width !== width || this.seen.whole_ns !== axis.whole_ns) {
      this.seen = { overview, width, whole_ns: axis.whole_ns, ...this.sums(overview, rows, width) };
    }
    const { sums, lost } = this.seen;
    for (let x = 0; x < width; x += 1) {
      const tall = Math.min(1, sums[x]) * (height - 8);
      pen.fillStyle = kinds.paint.quiet;
      if (tall > 0) pen.fillRect(x, height - 5 - Math.max(1.5, tall), 1, Math.max(1.5, tall));
      pen.fillStyle = kinds.paint.bad;
      if (lost[x]) pen.fillRect(x - 0.5, height - 5, 2, 5);
    }
  }

  sums(overview, rows, width) {
    const sums = new Float32Array(width);
    const lost = new Uint8Array(width);
    const { kinds } = this.timeline;
    for (const { lane, what } of rows.lanes) {
      const block = overview.blocks.get(lane);
      if (what !== "sent" || !block) continue;
      for (let at = 0; at < block.n; at += 1) {
        if (!block.boxes && !block.counts[at]) continue;
        const start = overview.from_ns + (block.boxes ? block.starts[at] : at * overview.step_ns);
        const long = block.boxes ? block.durations[at] : overview.step_ns;
        const share = block.boxes ? (long / this.timeline.axis.whole_ns) * width : block.shares[at] / 255;
        const from = Math.max(0, Math.floor(this.place(start)));
        const to = Math.min(width, Math.max(from + 1, Math.ceil(this.place(start + long))));
        const bad = block.boxes ? kinds.lost(block.outcomes[at]) : block.lost[at];
        for (let x = from; x < to; x += 1) {
          sums[x] += share;
          if (bad) lost[x] = LOST;
        }
      }
    }
    return { sums, lost };
  }

  // ------------------------------------------------------------ pointers

  down(event) {
    const { axis } = this.timeline;
    const x = event.offsetX;
    const [from, to] = [this.place(axis.from_ns), this.place(axis.to_ns)];
    const edge = [Math.abs(x - from), Math.abs(x - to)];
    const held = to - from > 3 * HANDLE_PX && Math.min(...edge) < HANDLE_PX;
    if (!held && (x < from || x > to)) {
      const ns = this.time(x);
      axis.show(ns - axis.span_ns / 2, ns + axis.span_ns / 2);
    }
    this.drag = { part: held ? (edge[0] < edge[1] ? "from" : "to") : "both", from_ns: axis.from_ns, to_ns: axis.to_ns, x };
    this.canvas.setPointerCapture(event.pointerId);
    event.preventDefault();
  }

  move(event) {
    const { axis } = this.timeline;
    if (!this.drag) return;
    const by_ns = this.time(event.offsetX) - this.time(this.drag.x);
    const { part, from_ns, to_ns } = this.drag;
    axis.show(from_ns + (part === "to" ? 0 : by_ns), to_ns + (part === "from" ? 0 : by_ns));
  }
}
