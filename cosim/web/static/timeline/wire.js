// Messages about the timeline: binary answers as typed arrays on the bytes as they came, requests as JSON.

import { owner } from "./rows.js";

const WINDOW = 1;
const BOXES = 0;
const HEADER_BYTES = 32;
const BLOCK_BYTES = 16;

// columns of a block, in their order; each begins at a multiple of 8 bytes
const COLUMNS = [
  [
    ["starts", Float64Array], // ns since from_ns of the answer
    ["durations", Float64Array], // ns
    ["rows", Uint32Array], // of the lane, by which a box is asked for
    ["codes", Uint16Array], // kinds
    ["outcomes", Uint8Array],
    ["peers", Int16Array], // the robot at the other end; -1: all, or none
  ],
  [
    ["codes", Uint16Array], // the kind with the greatest share of the cell, or one that is lost
    ["shares", Uint8Array], // of 255
    ["lost", Uint8Array],
    ["counts", Uint32Array],
  ],
];

/**
 * Read a binary message, of a server that tells of *peers* or not: {number, from_ns, step_ns, blocks}, where blocks has for each lane {boxes, n, and columns}.
 * Null for a message of another kind.
 */
export function decoded(buffer, peers) {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEADER_BYTES || view.getUint32(0, true) !== WINDOW) return null;
  const answer = {
    number: view.getUint32(4, true),
    from_ns: Number(view.getBigInt64(16, true)),
    step_ns: Number(view.getBigInt64(24, true)),
    blocks: new Map(),
  };
  let at = HEADER_BYTES;
  for (let left = view.getUint32(8, true); left > 0; left -= 1) {
    const form = view.getUint32(at + 4, true);
    const block = { boxes: form === BOXES, n: view.getUint32(at + 8, true) };
    answer.blocks.set(view.getUint32(at, true), block);
    at += BLOCK_BYTES;
    for (const [name, type] of COLUMNS[form]) {
      if (name === "peers" && !peers) continue;
      block[name] = new type(buffer, at, block.n);
      at += Math.ceil((block.n * type.BYTES_PER_ELEMENT) / 8) * 8;
    }
  }
  return answer;
}

/**
 * What the server tells of a box in the words of the page: {kind, what, robot, source, peer, start_ns, end_ns, channel, outcome,
 * part, lost, detail, receptions, fields, bytes, decoded}; *lane* is the one that it is in, *lost* tells of an outcome if it is a loss.
 */
export function told(message, lane, lost) {
  const { fields, transmission, receptions, bytes, decoded: said } = message;
  const row = { ...transmission, ...fields };
  const start_ns = Number(row.start_ns ?? row.time_ns);
  const end_ns = row.end_ns === undefined ? start_ns + Number(row.duration_ns ?? 0) : Number(row.end_ns);
  const heard = receptions.map((each) => ({ ...each, robot: each.receiver, lost: lost(each.outcome) }));
  const worst = heard.find((each) => each.lost && meant(each, row));
  const { outcome, part = "" } = row.outcome === undefined ? (worst ?? heard.find((each) => meant(each, row)) ?? {}) : row;
  return {
    kind: String(row.kind ?? row.state ?? row.event ?? lane.what),
    what: lane.what,
    robot: owner(lane),
    source: row.source,
    peer: row.destination ?? row.sender ?? -1,
    start_ns,
    end_ns,
    channel: row.channel ?? -1,
    outcome: outcome ?? "",
    part,
    lost: outcome !== undefined && lost(outcome),
    detail: row.detail ?? "",
    receptions: heard,
    fields: Object.entries(row),
    bytes,
    decoded: said,
  };
}

/** Whether a reception was meant: its robot is the destination, or all are. */
const meant = ({ robot }, { destination }) => destination === undefined || destination < 0 || robot === destination;

/** A time as it is sent: a string, since JSON's numbers are not exact everywhere. */
export const sent = (ns) => BigInt(Math.round(ns)).toString();
