// Boxes of an answer as objects: {lane, row, start_ns, end_ns, code, outcome, peer}, by which the page speaks of them.

import { FRAME_LANES } from "./kinds.js";

/** The box with a number in an answer's block of a lane. */
export function boxed(answer, lane, at) {
  const block = answer.blocks.get(lane.lane);
  const start_ns = answer.from_ns + block.starts[at];
  return {
    lane: lane.lane,
    row: block.rows[at],
    start_ns,
    end_ns: start_ns + block.durations[at],
    code: block.codes[at],
    outcome: block.outcomes[at],
    peer: block.peers?.[at] ?? -1,
  };
}

/** The box of a row at a place (px), or the nearest one at most *reach_px* away; null if there is none. */
export function box_at({ axis, kinds, windows, wish }, row, x, reach_px) {
  let best = null;
  let best_px = reach_px;
  const answer = wish && windows.fitting(wish);
  const block = row && answer?.blocks.get(row.lane.lane);
  if (!block?.boxes) return null;
  for (let at = 0; at < block.n; at += 1) {
    const from = axis.place(answer.from_ns + block.starts[at]);
    if (from > x + reach_px) break;
    const far_px = Math.max(0, from - x, x - from - block.durations[at] / axis.ns_per_px);
    if (far_px > best_px || kinds.hidden.has(block.codes[at])) continue;
    best = boxed(answer, row.lane, at);
    best_px = far_px;
  }
  return best;
}

/** The frame and the receptions that belong to a box, in other lanes: {lane} of each. */
export function mates({ rows, painter }, box) {
  const own = rows.by_lane.get(box.lane)?.lane;
  if (!own || !FRAME_LANES.has(own.what)) return [];
  const others = ({ lane, radio, what }) => lane !== box.lane && radio === own.radio && FRAME_LANES.has(what);
  if (box.detail) {
    const ends = new Set(box.detail.receptions.map(({ robot }) => robot));
    const { source } = box.detail;
    const lanes = rows.rows.map(({ lane }) => lane).filter(others);
    return lanes.filter(({ what, robot }) => (what === "sent" ? robot === source : ends.has(robot)));
  }
  const from = own.what === "sent" ? own.robot : box.peer;
  return painter.drawn
    .filter(([{ lane }]) => others(lane))
    .map(([{ lane }, answer, at]) => ({ ...boxed(answer, lane, at), what: lane.what, robot: lane.robot }))
    .filter(({ start_ns, what, robot, peer }) => start_ns === box.start_ns && (what === "sent" ? robot : peer) === from);
}

/** The start or end of a drawn box next to a time, if it is near enough; else the time. */
export function snapped(painter, ns, reach_ns) {
  let best = Math.round(ns);
  let best_ns = reach_ns;
  for (const [row, answer, at] of painter.drawn) {
    const { start_ns, end_ns } = boxed(answer, row.lane, at);
    for (const edge_ns of [start_ns, end_ns]) {
      if (Math.abs(edge_ns - ns) < best_ns) [best, best_ns] = [edge_ns, Math.abs(edge_ns - ns)];
    }
  }
  return best;
}
