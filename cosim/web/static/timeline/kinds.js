// Kinds of boxes: their colours, what they are called, and the sentence that tells of one.

import { Stations } from "../stations.js";
import { seconds } from "./axis.js";

// numbers of the colours --kind-N; kinds that are not named here have the others by turns
const COLOURS = {
  DM1: 0, DM3: 0, DM5: 0, DH1: 1, DH3: 1, DH5: 1, AUX1: 1, FHS: 2, ID: 3, HV1: 4, HV2: 4, HV3: 4, DV: 4,
  POLL: 9, NULL: 9, DATA: 0, RTS: 2, CTS: 4, ACK: 3, IDEAL: 0, OPTICAL: 0, message: 5, wake: 9,
  ADV_IND: 3, ADV_EXT_IND: 3, ADV_NONCONN_IND: 4, AUX_ADV_IND: 4, AUX_CHAIN_IND: 4, CONNECT_IND: 2, CONTROL: 2,
  SCAN_REQ: 2, SCAN_RSP: 3, EMPTY: 9,
  central: 0, peripheral: 1, scanning: 3, initiating: 2,
  inquiry: 3, inquiry_scan: 3, inquiry_backoff: 8, inquiry_response: 8, page: 2, page_scan: 2, page_response: 4,
  master: 0, slave: 1, link: 0, hold: 5, sniff: 7, park: 6, away: 9, part_time: 7, afh: 5,
  backoff: 5, difs: 9, eifs: 6, awaits_ack: 2, awaits_cts: 4, route: 8, busy: 9, deferred: 9, NAV: 7, off: 9, occluded: 6,
  camera_off: 7, clock_stepped: 7, crashed: 6, frozen: 6, killed: 6, jammer: 4, wall: 9,
};
const ROBOTS = 8; // that have colours of their own
const OTHERS = 9;
/** What lanes are of that hold frames. */
export const FRAME_LANES = new Set(["sent", "received", "broadcasts", "channel"]);
/** What those are of that hold receptions. */
export const HEARD = new Set(["received", "broadcasts"]);
const IDLE = new Set(["POLL", "NULL", "EMPTY"]);

/** The kinds and outcomes that the server has named, with the colours of the page. */
export class Kinds {
  constructor() {
    this.stations = new Stations(); // of the run
    this.take([], []);
    this.hidden = new Set(); // codes that the legend has switched off
  }

  /** Take what the server has named. */
  take(kinds, outcomes) {
    this.fresh = kinds.length !== this.by_code?.size; // others than before
    this.by_code = new Map(kinds.map((kind) => [kind.code, kind]));
    this.outcomes = new Map(outcomes.map((outcome) => [outcome.code, outcome]));
    this.losses = new Set(outcomes.filter(({ lost }) => lost).map(({ name }) => name));
    this.recolour();
  }

  /** Take the colours of the present scheme from the page's style. */
  recolour() {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(`--${name}`).trim();
    this.paint = Object.fromEntries(
      ["paper", "raised", "ink", "quiet", "line", "accent", "bad", "floor"].map((name) => [name, read(name)]),
    );
    const palette = Array.from({ length: 10 }, (_, number) => read(`kind-${number}`));
    this.robots = Array.from({ length: ROBOTS }, (_, robot) => read(`robot-${robot}`));
    this.colours = new Map();
    this.words = new Map(); // colours as pixels
    let other = 0;
    for (const { code, name } of this.by_code.values()) {
      const number = COLOURS[name] ?? (other++ * 2 + 5) % OTHERS;
      this.colours.set(code, palette[number]);
      this.words.set(code, pixel(palette[number]));
    }
    this.bad_word = pixel(this.paint.bad);
  }

  name(code) {
    return this.by_code.get(code)?.name ?? `kind ${code}`;
  }

  colour(code) {
    return this.colours.get(code) ?? this.paint.quiet;
  }

  /** What a robot is in the link that it has while in this state, by the server: master or slave, or nothing. */
  role(code) {
    return this.by_code.get(code)?.role ?? "";
  }

  /** The colour of a state of a robot: a link of a piconet has that of its master. */
  state_colour(code, robot, peer) {
    const master = { master: robot, slave: peer ?? -1 }[this.role(code)] ?? -1;
    return master >= 0 ? this.whose(master) : this.colour(code);
  }

  /** The colour of a robot, or that of stations. */
  whose(address) {
    return this.stations.has(address) ? this.paint.quiet : this.robots[address % ROBOTS];
  }

  /** Whether a kind is of frames, not of states. */
  is_frame(code) {
    return this.by_code.get(code)?.group === "frame";
  }

  /** Whether frames of this kind carry nothing, and are drawn thin. */
  is_idle(code) {
    return IDLE.has(this.name(code));
  }

  lost(outcome) {
    return Boolean(this.outcomes.get(outcome)?.lost);
  }

  /** Whether an outcome, by its name, is a loss. */
  loses(name) {
    return this.losses.has(name);
  }

  /** The lost part of a frame of *duration_ns*: from when to when (ns since its start), as the server tells. */
  lost_part(outcome, duration_ns) {
    const [from_ns, to_ns] = this.outcomes.get(outcome)?.lost_ns ?? [0, null];
    return [Math.min(from_ns, duration_ns), Math.min(to_ns ?? duration_ns, duration_ns)];
  }
}

/** What became of a box, in words. */
export function fate({ outcome, part, lost }) {
  const plain = (text) => String(text ?? "").replaceAll("_", " ");
  return lost ? `lost: ${plain(part || outcome)}` : plain(outcome);
}

/**
 * A sentence about a box: {kind, what, robot, source, peer, start_ns, end_ns, channel, outcome, part, lost, detail}, of a
 * run with these stations.
 */
export function sentence(box, stations) {
  const { kind, what, robot, source, peer, channel, start_ns, end_ns } = box;
  if (FRAME_LANES.has(what)) {
    return [kind, ended(source, peer, stations), `${seconds(start_ns)} s`, channel >= 0 ? `channel ${channel}` : "", fate(box)].filter(Boolean).join(", ");
  }
  const who = robot >= 0 ? stations.called(robot) : "jammer";
  const when = end_ns > start_ns ? `${seconds(start_ns)} to ${seconds(end_ns)} s` : `${seconds(start_ns)} s`;
  return [kind.replaceAll("_", " "), who, when, box.detail].filter(Boolean).join(", ");
}

/** The ends of a frame in words; null for one that is not known. */
function ended(source, peer, stations) {
  const to = peer === null ? "" : ` to ${peer < 0 ? "all" : stations.has(peer) ? stations.called(peer) : peer}`;
  if (source === null) return to && `a frame${to}`;
  return `${stations.called(source)}${to}`;
}

/** A colour of CSS as the pixel of an ImageData. */
function pixel(colour) {
  const probe = new OffscreenCanvas(1, 1).getContext("2d");
  probe.fillStyle = colour || "#888";
  probe.fillRect(0, 0, 1, 1);
  return new Uint32Array(probe.getImageData(0, 0, 1, 1).data.buffer)[0];
}
