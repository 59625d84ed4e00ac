// The boxes on their canvas: rectangles while there are few, else a row of pixels a lane, in which what is lost wins.

import { paint_ground } from "./ground.js";
import { hatched } from "./hatch.js";
import { FRAME_LANES, HEARD } from "./kinds.js";
import { is_link, paint_common, paint_member } from "./piconets.js";

const MOST_RECTANGLES = 4000; // more of them take longer than a frame of the screen
const LETTER_PX = 6.4;
const LEAST_WORD_PX = 26;
const THIN_PX = 6; // frames without a payload
const INSET_PX = 3; // of what is not lost in a row of pixels
const CHANNEL_GAP_PX = 0.5;
const INSTANT_PX = 3; // what has no length
const MOST_JOINED = 600;
const JOIN_NS_PER_PX = 25_000; // hairlines only where frames have a visible length
const LOST_RANK = 1000;

/** Draws what the answers hold of the visible rows. */
export class Painter {
  constructor(kinds) {
    this.kinds = kinds;
    this.drawn = []; // [row of the layout, block, number in it, x, y, width, height] of each rectangle
    this.shades = new ImageDataRows();
  }

  /**
   * @param {CanvasRenderingContext2D} pen of a canvas that is as wide as the axis, in CSS pixels
   * @param {{axis: object, rows: object, layers: object[], top: number, height: number, origin_ns: number, lit: number | null}} seen
   */
  paint(pen, seen) {
    const { axis, rows, layers, top, height } = seen;
    this.drawn = [];
    pen.clearRect(0, 0, axis.width_px, height);
    pen.save();
    pen.translate(0, -top);
    const visible = rows.between(top, top + height);
    layers.forEach((answer, number) => this.paint_answer(pen, seen, visible, answer, number > 0));
    if (!rows.by_channel && axis.ns_per_px < JOIN_NS_PER_PX && this.drawn.length < MOST_JOINED) this.join(pen);
    if (!rows.by_channel) paint_common(pen, this.kinds, axis, this.drawn);
    pen.globalCompositeOperation = "destination-over"; // what is drawn first stays on top
    paint_ground(pen, this.kinds, seen, visible);
    pen.restore();
  }

  /** Draw one answer; *over*: in the place of a coarser one. */
  paint_answer(pen, { axis, top, height }, visible, answer, over) {
    const left = Math.max(0, axis.place(answer.begin_ns));
    const right = Math.min(axis.width_px, axis.place(answer.end_ns));
    if (right <= left) return;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, right - left, height);
    pen.clip();
    const there = visible.filter((row) => answer.blocks.has(row.lane.lane));
    const parts = there.map((row) => ({ row, block: answer.blocks.get(row.lane.lane) }));
    for (const part of parts) part.seen = part.block.boxes ? within(part.block, answer, axis, this.kinds.hidden) : [];
    const total = parts.reduce((sum, part) => sum + part.seen.length, 0);
    const most = total > MOST_RECTANGLES ? axis.width_px / 12 : axis.width_px;
    for (const part of parts) part.dense = !part.block.boxes || part.seen.length > most;
    if (over) for (const { row } of parts) pen.clearRect(left, row.y, right - left, row.height);
    this.paint_pixels(pen, axis, answer, parts.filter(({ dense }) => dense));
    for (const part of parts) if (!part.dense) this.paint_boxes(pen, axis, answer, part);
    pen.restore();
  }

  // ------------------------------------------------------------ rows of pixels

  paint_pixels(pen, axis, answer, parts) {
    if (!parts.length) return;
    const { shades } = this;
    shades.begin(Math.ceil(axis.width_px), parts.length);
    parts.forEach(({ block, seen }, number) => {
      if (block.boxes) this.shade_boxes(shades, number, axis, answer, block, seen);
      else this.shade_cells(shades, number, axis, answer, block);
    });
    shades.put();
    parts.forEach(({ row }, number) => shades.draw(pen, number, row));
  }

  shade_cells(shades, number, axis, answer, block) {
    const { hidden, words, bad_word } = this.kinds;
    const wide = answer.step_ns / axis.ns_per_px;
    const zero = axis.place(answer.from_ns);
    const end = Math.min(block.n, Math.ceil((shades.width - zero) / wide));
    for (let cell = Math.max(0, Math.floor(-zero / wide)); cell < end; cell += 1) {
      if (!block.counts[cell]) continue;
      const code = block.codes[cell];
      if (hidden.has(code)) continue;
      const from = zero + cell * wide;
      if (block.lost[cell]) shades.fill(number, from, from + wide, bad_word, LOST_RANK, 255, true);
      else shades.fill(number, from, from + wide, words.get(code) ?? 0, block.shares[cell] + 1, 70 + block.shares[cell] * 0.72);
    }
  }

  shade_boxes(shades, number, axis, answer, block, seen) {
    const { words, bad_word } = this.kinds;
    for (const at of seen) {
      const from = axis.place(answer.from_ns + block.starts[at]);
      const to = from + block.durations[at] / axis.ns_per_px;
      const code = block.codes[at];
      if (this.kinds.lost(block.outcomes[at])) shades.fill(number, from, to, bad_word, LOST_RANK, 255, true);
      else shades.fill(number, from, to, words.get(code) ?? 0, this.kinds.is_idle(code) ? 1 : 2, this.kinds.is_idle(code) ? 130 : 235);
    }
  }

  // ------------------------------------------------------------ rectangles

  paint_boxes(pen, axis, answer, { row, block, seen }) {
    const { kinds } = this;
    const state = !FRAME_LANES.has(row.lane.what);
    pen.font = "10.5px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.textAlign = "left";
    for (const at of seen) {
      const x = axis.place(answer.from_ns + block.starts[at]);
      const width = Math.max(block.durations[at] ? 1 : INSTANT_PX, block.durations[at] / axis.ns_per_px);
      const code = block.codes[at];
      const [y, height] = this.extent(row, block, at);
      this.drawn.push([row, answer, at, x, y, width, height]);
      pen.fillStyle = state ? kinds.state_colour(code, row.lane.robot, block.peers?.[at]) : kinds.colour(code);
      if (row.lane.what === "piconet") paint_member(pen, kinds, code, row.lane.stacked, [x, y, width, height]);
      else if (state) this.paint_state(pen, x, y, width, height);
      else pen.fillRect(x, y, width, height);
      if (kinds.lost(block.outcomes[at])) this.paint_loss(pen, axis, block, at, x, y, width, height);
      if (width >= LEAST_WORD_PX && height >= 9) {
        this.paint_word(pen, row, block, at, [x, y, width, height], axis.width_px, state);
      }
    }
  }

  /** Top and height of a box: frames without a payload are thin, and stand on the line between sent and received. */
  extent(row, block, at) {
    if (row.lane.what === "channel") return [row.y, Math.max(1, row.height - CHANNEL_GAP_PX)];
    const [y, height] = [row.y + 1, row.height - 2];
    const thin = this.kinds.is_idle(block.codes[at]) && !this.kinds.lost(block.outcomes[at]) && height > THIN_PX;
    if (!thin) return [y, height];
    return [row.lane.what === "received" ? y : y + height - THIN_PX, THIN_PX];
  }

  paint_state(pen, x, y, width, height) {
    pen.globalAlpha = 0.3;
    pen.fillRect(x, y, width, height);
    pen.globalAlpha = 1;
    pen.fillRect(x, y, Math.min(width, 2), height);
    if (height > 3) pen.fillRect(x, y + height - 1.5, width, 1.5);
  }

  /** Hatch the part of a frame that was lost, and cross it out. */
  paint_loss(pen, axis, block, at, x, y, width, height) {
    const { bad, paper } = this.kinds.paint;
    const [from_ns, to_ns] = this.kinds.lost_part(block.outcomes[at], block.durations[at]);
    const left = x + from_ns / axis.ns_per_px;
    const wide = Math.max(1.5, (to_ns - from_ns) / axis.ns_per_px);
    pen.fillStyle = bad;
    pen.fillRect(width < 5 ? x : left, y - 1, width < 5 ? Math.max(2, width) : wide, height + 2);
    if (width < 5) return;
    pen.fillStyle = hatched(pen, paper);
    pen.fillRect(left, y, wide, height);
    const [middle, centre, arm] = [x + width / 2, y + height / 2, Math.min(5, height / 2, width / 2)];
    for (const [colour, thick] of [[paper, 4], [bad, 2]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      pen.beginPath();
      pen.moveTo(middle - arm, centre - arm);
      pen.lineTo(middle + arm, centre + arm);
      pen.moveTo(middle - arm, centre + arm);
      pen.lineTo(middle + arm, centre - arm);
      pen.stroke();
    }
  }

  paint_word(pen, row, block, at, [x, y, width, height], right, state) {
    const kind = this.kinds.name(block.codes[at]);
    const member = row.lane.what === "piconet" ? row.lane.stacked : null;
    const absent = member !== null && !is_link(this.kinds, block.codes[at]); // and hatched, as what is lost
    const plain = kind.replaceAll("_", " ");
    const { stations } = this.kinds;
    const name = member === null ? plain : absent ? `${stations.short(member)} ${plain}` : stations.called(member);
    const peer = block.peers?.[at];
    const arrow = row.lane.what === "sent" && peer >= 0 ? ` → ${stations.short(peer)}` : "";
    const left = Math.max(x, 0) + 4;
    const room = Math.floor((Math.min(x + width, right) - left - 2) / LETTER_PX);
    if (room < 2) return;
    const text = name.length + arrow.length <= room ? name + arrow : name.slice(0, room);
    if (text.length < name.length && text.length < 3) return;
    const lost = this.kinds.lost(block.outcomes[at]);
    pen.fillStyle = state || lost ? this.kinds.paint.ink : this.kinds.paint.paper;
    if (lost || absent) { // on top of a hatch
      if (width < 90) return;
      pen.strokeStyle = this.kinds.paint.paper;
      pen.lineWidth = 3;
      pen.strokeText(text, left, y + height / 2 + 0.5);
    }
    pen.fillText(text, left, y + height / 2 + 0.5);
  }

  // ------------------------------------------------------------ around the boxes

  /** Join frames and their receptions by hairlines. */
  join(pen) {
    const sent = new Map();
    for (const each of this.drawn) if (each[0].lane.what === "sent") note(sent, frame_key(...each), each);
    pen.strokeStyle = this.kinds.paint.quiet;
    pen.lineWidth = 0.7;
    pen.globalAlpha = 0.7;
    pen.beginPath();
    for (const each of this.drawn) {
      const [row, , , x, y, , height] = each;
      const frame = HEARD.has(row.lane.what) && sent.get(frame_key(...each));
      if (!frame) continue;
      const [, , , , from_y, , from_height] = frame;
      pen.moveTo(x + 0.5, from_y < y ? from_y + from_height : from_y);
      pen.lineTo(x + 0.5, from_y < y ? y : y + height);
    }
    pen.stroke();
    pen.globalAlpha = 1;
  }
}

/** Numbers of the boxes of a block that are in the window, and of no hidden kind. */
function within(block, answer, axis, hidden) {
  const [from, to] = [axis.from_ns - answer.from_ns, axis.to_ns - answer.from_ns];
  const found = [];
  for (let at = 0; at < block.n && block.starts[at] < to; at += 1) {
    if (block.starts[at] + block.durations[at] >= from && !hidden.has(block.codes[at])) found.push(at);
  }
  return found;
}

/** What a frame and its receptions have in common: start, kind, radio and, where the server tells it, the sender. */
function frame_key({ lane }, answer, at) {
  const block = answer.blocks.get(lane.lane);
  const source = block.peers && (lane.what === "sent" ? lane.robot : block.peers[at]);
  return `${answer.from_ns + block.starts[at]} ${block.codes[at]} ${lane.radio} ${source}`;
}

/** Keep what has a key; what is not the only one with it, is not kept: nobody knows which is meant. */
const note = (map, key, value) => map.set(key, map.has(key) ? null : value);

/** Two rows of pixels for each lane, of what is lost and of the rest, which are stretched to the height of its row. */
class ImageDataRows {
  begin(width, count) {
    if (this.width !== width || !this.image || this.image.height < 2 * count) {
      this.width = width;
      this.image = new ImageData(width, 2 * count);
      this.words = new Uint32Array(this.image.data.buffer);
      this.ranks = new Uint16Array(width * 2 * count);
      this.canvas = new OffscreenCanvas(width, 2 * count);
      this.pen = this.canvas.getContext("2d");
    } else {
      this.words.fill(0);
      this.ranks.fill(0);
    }
  }

  /** Colour pixels; a higher rank wins. */
  fill(number, from, to, word, rank, alpha, lost = false) {
    const begin = (2 * number + Number(lost)) * this.width;
    const first = Math.max(0, Math.floor(from));
    const end = Math.min(this.width, Math.max(Math.floor(from) + 1, Math.floor(to)));
    const shade = ((word & 0xffffff) | (alpha << 24)) >>> 0;
    for (let x = first; x < end; x += 1) {
      if (this.ranks[begin + x] >= rank) continue;
      this.ranks[begin + x] = rank;
      this.words[begin + x] = shade;
    }
  }

  put() {
    this.pen.putImageData(this.image, 0, 0);
  }

  draw(pen, number, row) {
    const inset = row.height > 3 * INSET_PX ? INSET_PX : 0;
    pen.imageSmoothingEnabled = false;
    pen.drawImage(this.canvas, 0, 2 * number, this.width, 1, 0, row.y + inset, this.width, Math.max(1, row.height - 2 * inset));
    pen.drawImage(this.canvas, 0, 2 * number + 1, this.width, 1, 0, row.y, this.width, row.height);
  }
}
