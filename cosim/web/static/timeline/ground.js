// What lies behind the boxes: slots, the lines of the lanes, faults as bands, and the robot that is selected.

import { SLOT_NS, TICK_NS } from "./axis.js";
import { hatched } from "./hatch.js";
import { CHANNELS } from "./rows.js";

const LEAST_SLOT_PX = 7;
const LEAST_TICK_PX = 60; // a slot as wide shows its halves
const BANDS = new Set(["crashed", "killed", "frozen", "jammer"]);

/** Draw it with a pen whose composition puts later things behind earlier ones. */
export function paint_ground(pen, kinds, seen, visible) {
  const { axis, rows, top, height, origin_ns, lit, slot_ns } = seen;
  const { paint } = kinds;
  pen.fillStyle = paint.line;
  if (rows.by_channel) {
    seen.spectrum.paint_areas(pen, seen, kinds);
    pen.fillStyle = paint.line;
    for (let channel = 9; channel < CHANNELS; channel += 10) {
      pen.fillRect(0, (CHANNELS - channel - 1) * rows.channel_px - 0.5, axis.width_px, 0.5);
    }
  } else {
    for (const row of visible) if (row.lane.what === "received") pen.fillRect(0, row.y - 0.5, axis.width_px, 1);
    paint_bands(pen, kinds, seen);
  }
  paint_slots(pen, axis, paint.ink, slot_ns, origin_ns, top, height);
  pen.fillStyle = paint.raised;
  for (const group of rows.groups) {
    if (group.robot !== null && group.robot === lit) pen.fillRect(0, group.y - 2, axis.width_px, group.height + 4);
  }
}

/** Hatch all lanes of a robot while a fault keeps it from acting, and all lanes while a jammer is on the air. */
function paint_bands(pen, kinds, { axis, rows, layers }) {
  const answer = layers.at(-1);
  if (!answer) return;
  pen.fillStyle = hatched(pen, kinds.paint.line, 1);
  for (const { lane } of rows.rows) {
    const block = lane.what === "states" && lane.radio < 0 ? answer.blocks.get(lane.lane) : null;
    for (let at = 0; block?.boxes && at < block.n; at += 1) {
      if (!BANDS.has(kinds.name(block.codes[at])) || kinds.hidden.has(block.codes[at])) continue;
      const x = axis.place(answer.from_ns + block.starts[at]);
      const width = block.durations[at] / axis.ns_per_px;
      for (const group of rows.groups) {
        if (lane.robot < 0 || group.robot === lane.robot) pen.fillRect(x, group.y - 2, width, group.height + 4);
      }
    }
  }
}

function paint_slots(pen, axis, colour, slot_ns, origin_ns, top, height) {
  const wide = slot_ns / axis.ns_per_px;
  if (wide < LEAST_SLOT_PX) return;
  pen.fillStyle = colour;
  for (let slot = Math.floor((axis.from_ns - origin_ns) / slot_ns); origin_ns + slot * slot_ns < axis.to_ns; slot += 1) {
    const begin_ns = origin_ns + slot * slot_ns;
    pen.globalAlpha = 0.16;
    if (slot_ns === SLOT_NS && wide > LEAST_TICK_PX) pen.fillRect(axis.place(begin_ns + TICK_NS), top, 0.5, height);
    pen.globalAlpha = 0.055;
    if (slot % 2) pen.fillRect(axis.place(begin_ns), top, wide, height);
  }
  pen.globalAlpha = 1;
}
