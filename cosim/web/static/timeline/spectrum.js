// What is behind and beside the rows of RF channels: which are left out or jammed, and the share of lost frames on each.

import { Asking } from "./asking.js";
import { seconds } from "./axis.js";
import { element, table } from "./dom.js";
import { hatched } from "./hatch.js";
import { CHANNELS } from "./rows.js";
import { sent } from "./wire.js";

const WIDE_PX = 64; // of the bars
const WORDS = { afh: "left out", jammer: "jammed" };

/** The areas and the bars of the view by channel. */
export class Spectrum {
  /** @param {import("./timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.canvas = element("canvas", { "aria-hidden": "true" });
    this.root = element("div", { className: "tl-shares", hidden: true, title: "Share of frames that are lost, by channel" },
      element("span", {}, "% lost"), this.canvas);
    this.asking = new Asking(timeline, () => this.want());
  }

  /** What the server has answered last. */
  get answer() {
    return this.asking.answer;
  }

  /** Ask for what is in the window. */
  want() {
    const { axis, rows, selected, begun } = this.timeline;
    if (!begun || !rows.by_channel) return;
    const window = { from_ns: sent(axis.from_ns), to_ns: sent(axis.to_ns) };
    this.asking.want(`${axis.from_ns} ${axis.to_ns} ${selected}`, { say: "channels", robot: selected, ...window });
  }

  take(message) {
    if (!this.asking.take(message)) return;
    for (const area of this.answer.areas) Object.assign(area, { start_ns: Number(area.start_ns), end_ns: Number(area.end_ns) });
    this.timeline.draw();
    this.timeline.settle();
    this.want();
  }

  /** Draw the areas, with a pen whose composition puts later things behind earlier ones. */
  paint_areas(pen, { axis, rows }, kinds) {
    const { answer } = this;
    const size = rows.channel_px;
    for (const { what, start_ns, end_ns, channels } of answer?.areas ?? []) {
      const [from, to] = [Math.max(-2, axis.place(start_ns)), Math.min(axis.width_px + 2, axis.place(end_ns))];
      if (to < 0 || from > axis.width_px) continue;
      for (const [first, last] of channels) {
        const [y, high] = [(CHANNELS - 1 - last) * size, (last - first + 1) * size];
        if (what === "jammer") {
          pen.strokeStyle = kinds.paint.bad;
          pen.lineWidth = 1;
          pen.strokeRect(from + 0.5, y + 0.5, Math.max(1, to - from - 1), Math.max(1, high - 1));
          pen.fillStyle = hatched(pen, kinds.paint.bad, 0.6);
          pen.globalAlpha = 0.6;
        } else {
          pen.fillStyle = kinds.paint.quiet;
          pen.globalAlpha = 0.4;
        }
        pen.fillRect(from, y, Math.max(1, to - from), high);
        pen.globalAlpha = 1;
      }
    }
  }

  /** Draw the bars beside the rows. */
  paint_bars() {
    const { rows, kinds, stage_px, scroll_px, ratio } = this.timeline;
    const { canvas, answer } = this;
    const size = [WIDE_PX, stage_px].map((px) => Math.round(px * ratio));
    canvas.style.width = `${WIDE_PX}px`;
    canvas.style.height = `${stage_px}px`;
    if (size[0] !== canvas.width || size[1] !== canvas.height) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, -scroll_px * ratio);
    pen.clearRect(0, scroll_px, WIDE_PX, stage_px);
    pen.fillStyle = kinds.paint.line;
    pen.fillRect(0, scroll_px, 1, stage_px);
    for (const [channel, frames, lost] of answer?.channels ?? []) {
      const y = (CHANNELS - 1 - channel) * rows.channel_px;
      const high = Math.max(1, rows.channel_px - 0.5);
      pen.fillStyle = kinds.paint.line;
      if (frames) pen.fillRect(1, y, 3, high); // there is something to have a share of
      pen.fillStyle = kinds.paint.bad;
      if (lost) pen.fillRect(1, y, Math.max(2, (lost / frames) * (WIDE_PX - 2)), high);
    }
  }

  /** The same as tables. */
  tables() {
    const { answer, timeline: { stations } } = this;
    if (!answer) return [];
    const areas = answer.areas.map(({ what, robot, start_ns, end_ns, channels }) => [
      robot < 0 ? WORDS[what] : `${WORDS[what]} by the piconet of ${stations.called(robot)}`,
      `${seconds(start_ns)} s`,
      `${seconds(end_ns)} s`,
      channels.map(([first, last]) => (first === last ? String(first) : `${first} to ${last}`)).join(", "),
    ]);
    const more = answer.more ? `; ${answer.more} more are not shown` : "";
    const rows = answer.channels.filter(([, frames]) => frames).map(([channel, frames, lost]) =>
      [String(channel), String(frames), String(lost), `${Math.round((100 * lost) / frames)} %`]);
    return [
      table(`Channels left out or jammed${more}`, ["what", "from", "to", "channels"], areas),
      table("Frames in the window by channel", ["channel", "frames", "lost", "share"], rows),
    ];
  }
}
