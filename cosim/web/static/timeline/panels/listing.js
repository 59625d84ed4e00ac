// What is in the window, as a table for those who do not see the canvas.

import { length, seconds } from "../axis.js";
import { table } from "../dom.js";

const MOST_ROWS = 200;

/** Put a table of the boxes in the window into *root*; of lanes that have too many, how many they have. */
export function show_listing(root, { axis, kinds, rows, windows, wish, spectrum }) {
  const answer = wish && windows.fitting(wish);
  if (!answer) return;
  const boxes = [];
  const sums = [];
  for (const { lane } of rows.rows) {
    const block = answer.blocks.get(lane.lane);
    if (!block) continue;
    if (block.boxes) boxes.push(...listed(answer, block, lane, axis, kinds));
    else sums.push(summed(answer, block, lane, axis));
  }
  boxes.sort((one, other) => one.start_ns - other.start_ns);
  const lines = boxes.slice(0, MOST_ROWS).map(({ start_ns, duration_ns, lane, kind, fate }) =>
    [`${seconds(start_ns)} s`, lane, kind, length(duration_ns), fate]);
  const title = `${Math.min(MOST_ROWS, boxes.length)} of ${boxes.length} boxes between ${seconds(axis.from_ns)} s and `
    + `${seconds(axis.to_ns)} s`;
  const parts = [table(title, ["begins", "lane", "kind", "lasts", "outcome"], lines)];
  if (sums.length) {
    const counts = sums.map(({ lane, count, lost }) => [lane, String(count), lost ? "some" : "none"]);
    parts.push(table("Lanes with too many boxes to be listed: zoom in", ["lane", "boxes", "lost ones"], counts));
  }
  if (rows.by_channel) parts.unshift(...spectrum.tables());
  root.replaceChildren(...parts);
}

function listed(answer, block, lane, axis, kinds) {
  const found = [];
  for (let at = 0; at < block.n; at += 1) {
    const start_ns = answer.from_ns + block.starts[at];
    if (start_ns >= axis.to_ns || start_ns + block.durations[at] < axis.from_ns) continue;
    if (kinds.hidden.has(block.codes[at])) continue;
    const { name = "", part = "" } = kinds.outcomes.get(block.outcomes[at]) ?? {};
    found.push({
      start_ns,
      duration_ns: block.durations[at],
      lane: lane.name,
      kind: kinds.name(block.codes[at]).replaceAll("_", " "),
      fate: `${name}${part ? `, ${part}` : ""}`.replaceAll("_", " "),
    });
  }
  return found;
}

function summed(answer, block, lane, axis) {
  let [count, lost] = [0, false];
  const first = Math.max(0, Math.floor((axis.from_ns - answer.from_ns) / answer.step_ns));
  const end = Math.min(block.n, Math.ceil((axis.to_ns - answer.from_ns) / answer.step_ns));
  for (let cell = first; cell < end; cell += 1) {
    count += block.counts[cell];
    lost ||= Boolean(block.lost[cell]);
  }
  return { lane: lane.name, count, lost };
}
