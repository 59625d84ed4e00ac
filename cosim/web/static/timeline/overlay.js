// What lies over the boxes and changes often: the time of the run, two cursors, and what the pointer or a pin is at.

import { mates } from "./boxes.js";

const RING_PX = 2;

/** Whether there is anything to draw. */
export function has_overlay({ axis, finder, markers, measure, now_ns, row, focused }) {
  const now = now_ns !== null && now_ns >= axis.from_ns && now_ns <= axis.to_ns;
  return Boolean(now || markers.all.length || finder.hovered || finder.pinned || (row && focused) || measure.times.some((ns) => ns !== null));
}

/** Draw on a pen in CSS pixels, of a canvas that lies over the painter's. */
export function paint_overlay(pen, timeline) {
  const { axis, kinds, scroll_px, stage_px, now_ns } = timeline;
  const { hovered, pinned } = timeline.finder;
  const { times } = timeline.measure;
  const { paint } = kinds;
  pen.clearRect(0, 0, axis.width_px, stage_px);
  pen.save();
  pen.translate(0, -scroll_px);
  if (timeline.row && timeline.focused) frame_row(pen, timeline.row, axis.width_px, paint.accent);
  for (const box of [pinned, hovered]) if (box) paint_box(pen, timeline, box, box === pinned ? paint.accent : paint.ink);
  pen.restore();
  if (now_ns !== null) line(pen, axis.place(now_ns), stage_px, paint.ink, []);
  for (const { ns } of timeline.markers.all) line(pen, axis.place(ns), stage_px, paint.quiet, [8, 2, 2, 2]);
  times.forEach((ns, number) => {
    if (ns === null) return;
    line(pen, axis.place(ns), stage_px, paint.accent, number ? [6, 3] : [2, 3]);
  });
  const [one, two] = times;
  if (one !== null && two !== null) {
    pen.fillStyle = paint.accent;
    pen.globalAlpha = 0.09;
    pen.fillRect(axis.place(Math.min(one, two)), 0, Math.abs(two - one) / axis.ns_per_px, stage_px);
    pen.globalAlpha = 1;
  }
}

/** Draw the flags of the cursors, and of the time of the run, on the ruler. */
export function paint_flags(pen, { axis, kinds, now_ns, measure }, height) {
  const { paint } = kinds;
  pen.font = "600 11px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  if (now_ns !== null) {
    const x = axis.place(now_ns);
    pen.fillStyle = paint.ink;
    pen.beginPath();
    pen.moveTo(x - 5, height - 8);
    pen.lineTo(x + 5, height - 8);
    pen.lineTo(x, height);
    pen.fill();
  }
  measure.times.forEach((ns, number) => {
    if (ns === null) return;
    const x = axis.place(ns);
    pen.fillStyle = paint.accent;
    pen.fillRect(x - 7, height - 15, 14, 15);
    pen.fillStyle = paint.paper;
    pen.fillText(String(number + 1), x, height - 7);
  });
}

function paint_box(pen, timeline, box, colour) {
  const { axis, rows } = timeline;
  const x = axis.place(box.start_ns);
  const width = Math.max(3, (box.end_ns - box.start_ns) / axis.ns_per_px);
  const others = mates(timeline, box);
  pen.strokeStyle = colour;
  pen.lineWidth = 1;
  pen.setLineDash([]);
  const own = rows.of(box);
  if (own) {
    for (const mate of others) {
      const row = rows.by_lane.get(mate.lane);
      if (!row || row === own) continue;
      pen.beginPath();
      pen.moveTo(x, own.y < row.y ? own.y + own.height : own.y);
      pen.lineTo(x, own.y < row.y ? row.y : row.y + row.height);
      pen.stroke();
      pen.strokeRect(x - 0.5, row.y, width + 1, row.height);
    }
    pen.lineWidth = RING_PX;
    pen.strokeRect(x - RING_PX / 2, own.y - 1, width + RING_PX, own.height + 2);
  }
}

function frame_row(pen, { y, height }, width, colour) {
  pen.strokeStyle = colour;
  pen.setLineDash([3, 3]);
  pen.lineWidth = 1;
  pen.strokeRect(0.5, y - 0.5, width - 1, height + 1);
  pen.setLineDash([]);
}

function line(pen, x, height, colour, dash) {
  pen.strokeStyle = colour;
  pen.lineWidth = 1.3;
  pen.setLineDash(dash);
  pen.beginPath();
  pen.moveTo(x, 0);
  pen.lineTo(x, height);
  pen.stroke();
  pen.setLineDash([]);
}
