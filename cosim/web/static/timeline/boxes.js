// Boxes of an answer as objects, by which the page speaks of them: {lane, row, start_ns, end_ns, code, outcome, peer}, where
// peer is the robot at the other end, -1 for all, and null where the server does not tell.

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
    peer: block.peers?.[at] ?? null,
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
  const from = own.what === "sent" ? own.robot : box.peer; // null: whoever sent something at that time
  return painter.drawn
    .filter(([{ lane }]) => others(lane))
    .map(([{ lane }, answer, at]) => ({ ...boxed(answer, lane, at), what: lane.what, robot: lane.robot }))
    .filter(({ start_ns, code }) => start_ns === box.start_ns && code === box.code)
    .filter(({ what, robot, peer }) => [null, from].includes(what === "sent" && from !== null ? robot : peer));
}

/** The ends of a frame, as far as they are known from what is drawn: {source, peer}. */
export function ends(timeline, box, lane) {
  const others = box.peer === null ? mates(timeline, box) : [];
  const robots = (sent) => [...new Set(others.filter(({ what }) => (what === "sent") === sent).map(({ robot }) => robot))];
  const other = (sent) => box.peer ?? (robots(sent).length === 1 ? robots(sent)[0] : null);
  return lane.what === "sent" ? { source: lane.robot, peer: other(false) } : { source: other(true), peer: lane.robot };
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
