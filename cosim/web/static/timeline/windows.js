// What the server has answered about parts of the run: what fits is drawn, and what does not is stretched until it does.

import { decoded, sent } from "./wire.js";

const MARGIN = 0.35; // of the window, that is asked for on either side
const MOST_CELLS = 8000; // that the server takes in a request, and some
const MOST_KEPT = 16;
const OVERVIEW_CELLS = 2048;
const ANEW_MS = 200; // how often a run under way is asked for what is new
const PATIENCE_MS = 5000; // after which an answer is not waited for any more

/** The answers to requests for parts of the run, one of which is under way at a time. */
export class Windows {
  /**
   * @param {(message: object) => boolean} send
   * @param {() => void} arrived is called when there is more to draw
   */
  constructor(send, arrived) {
    this.send = send;
    this.arrived = arrived;
    this.number = 0;
    this.peers = false; // whether the server tells who is at the other end of a frame
    this.forget();
  }

  /** Forget all answers: the run is another one, or the connection. */
  forget() {
    this.kept = [];
    this.overview = null; // of the whole run
    this.wish = null;
    this.waiting = null;
    clearTimeout(this.timer);
    this.timer = 0;
  }

  /**
   * Ask for a part of the run, unless an answer fits, as soon as the last request is answered.
   * @param {{lanes: number[], from_ns: number, to_ns: number, ns_per_px: number, run: [number, number]}} wish
   */
  want(wish) {
    this.wish = wish;
    this.ask();
  }

  /** Whether an answer that fits is there for what is wanted. */
  get complete() {
    return this.wish === null || this.fitting(this.wish) !== null;
  }

  /** Take a binary message; return whether it was an answer. */
  take(buffer) {
    const answer = decoded(buffer, this.peers);
    if (!answer || answer.number !== this.waiting?.number) return false;
    const { from_ns, to_ns, known_ns, overview, asked_ms } = this.waiting;
    this.waiting = null;
    const made = { ...answer, begin_ns: from_ns, end_ns: to_ns, known_ns, asked_ms };
    if (overview) this.overview = made;
    else this.kept = [...this.kept, made].slice(-MOST_KEPT);
    this.arrived();
    this.ask();
    return true;
  }

  /** The answer that shows what is wanted as finely as it can be seen; null if there is none. */
  fitting(wish) {
    const to_ns = Math.min(wish.to_ns, wish.run[1]);
    for (let at = this.kept.length - 1; at >= 0; at -= 1) {
      const answer = this.kept[at];
      if (answer.begin_ns > wish.from_ns || answer.end_ns < to_ns) continue;
      const anew = answer.known_ns < to_ns && performance.now() - answer.asked_ms > ANEW_MS;
      if (!anew && wish.lanes.every((lane) => fine(answer, lane, step_of(wish)))) return answer;
    }
    return null;
  }

  /** The answers to draw for what is wanted, one over the other. */
  layers(wish) {
    const best = this.fitting(wish);
    if (best) return [best];
    const near = this.kept.filter((answer) => answer.begin_ns < wish.to_ns && answer.end_ns > wish.from_ns);
    near.sort((one, other) => other.step_ns - one.step_ns || one.asked_ms - other.asked_ms);
    return [...(this.overview ? [this.overview] : []), ...near.slice(-3)];
  }

  ask() {
    const now_ms = performance.now();
    if (this.waiting && now_ms - this.waiting.asked_ms < PATIENCE_MS) return;
    const { wish } = this;
    if (!wish || !wish.lanes.length) return;
    if (!this.fitting(wish)) this.request(wish, now_ms);
    else if (this.overview_is_old(wish, now_ms)) this.request_overview(wish, now_ms);
    else if (wish.run[1] > this.kept.at(-1).known_ns && wish.to_ns > this.kept.at(-1).known_ns) this.ask_later();
  }

  /** Ask again soon: a run under way has got on since. */
  ask_later() {
    if (this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = 0;
      this.ask();
    }, ANEW_MS);
  }

  request(wish, now_ms) {
    const { lanes, from_ns, to_ns, run } = wish;
    const step_ns = step_of(wish);
    const spare = (MOST_CELLS * step_ns) / (to_ns - from_ns) - 1; // for both margins
    const margin_ns = (to_ns - from_ns) * Math.min(MARGIN, spare / 2);
    const begin_ns = Math.floor(Math.max(run[0], from_ns - margin_ns) / step_ns) * step_ns;
    const end_ns = Math.ceil(Math.min(run[1], to_ns + margin_ns) / step_ns) * step_ns;
    this.submit({ lanes, from_ns: begin_ns, to_ns: Math.max(end_ns, begin_ns + step_ns), step_ns, run, now_ms });
  }

  request_overview({ all, run }, now_ms) {
    const step_ns = 2 ** Math.max(0, Math.ceil(Math.log2((run[1] - run[0]) / OVERVIEW_CELLS)));
    const begin_ns = Math.floor(run[0] / step_ns) * step_ns;
    this.submit({ lanes: all, from_ns: begin_ns, to_ns: run[1], step_ns, run, now_ms, overview: true });
  }

  submit({ lanes, from_ns, to_ns, step_ns, run, now_ms, overview = false }) {
    const number = (this.number += 1);
    const words = { from_ns: sent(from_ns), to_ns: sent(to_ns), step_ns: sent(step_ns) };
    if (!this.send({ say: "window", number, lanes, ...words })) return;
    this.waiting = { number, from_ns, to_ns, known_ns: run[1], overview, asked_ms: now_ms };
  }

  overview_is_old({ run, all }, now_ms) {
    if (!this.overview || all.some((lane) => !this.overview.blocks.has(lane))) return true;
    return run[1] > this.overview.known_ns && now_ms - this.overview.asked_ms > 5 * ANEW_MS;
  }
}

/** The width of the cells for what is wanted: a power of two, of at most a pixel, unless there are too many pixels. */
function step_of({ from_ns, to_ns, ns_per_px }) {
  const step_ns = 2 ** Math.max(0, Math.floor(Math.log2(ns_per_px)));
  return (to_ns - from_ns) / step_ns > MOST_CELLS ? 2 * step_ns : step_ns;
}

/** Whether an answer shows a lane by cells of at most a width. */
function fine(answer, lane, step_ns) {
  const block = answer.blocks.get(lane);
  return block !== undefined && (block.boxes || answer.step_ns <= step_ns);
}
