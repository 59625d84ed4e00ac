// The strips of piconets: a row for each member, from when to when it belongs, and when it is not there all the time.

import { boxed } from "./boxes.js";
import { hatched } from "./hatch.js";

const PART_TIME = "part_time";
const BRIDGE_PX = 2.5;
const LEAST_PX = 1;

/** Whether a box of a strip is a link, not an absence from it. */
export const is_link = (kinds, code) => kinds.role(code) === "slave";

/** Draw a membership in the colour of the member, and its absences over it. */
export function paint_member(pen, kinds, code, member, [x, y, width, height]) {
  const { paint } = kinds;
  const colour = kinds.whose(member);
  const name = kinds.name(code);
  if (is_link(kinds, code)) {
    pen.fillStyle = colour;
    pen.globalAlpha = 0.45;
    pen.fillRect(x, y, width, height);
    pen.globalAlpha = 1;
    pen.fillRect(x, y, Math.min(width, 2), height);
    return;
  }
  pen.fillStyle = paint.floor;
  pen.globalAlpha = name === PART_TIME ? 0.35 : 0.85;
  pen.fillRect(x, y, width, height);
  pen.globalAlpha = 1;
  pen.fillStyle = hatched(pen, name === PART_TIME ? colour : paint.quiet, name === PART_TIME ? 2 : 1);
  pen.fillRect(x, y, width, height);
}

/** Draw what strips have in common: who is in two piconets at once, and where a link changes its roles. */
export function paint_common(pen, kinds, axis, drawn) {
  const links = drawn.filter(([{ lane }]) => lane.what === "piconet").map(([{ lane }, answer, at, , y, , height]) => {
    const { start_ns, end_ns, code } = boxed(answer, lane, at);
    return { start_ns, end_ns, y, height, master: lane.robot, member: lane.stacked, code };
  }).filter(({ code }) => is_link(kinds, code));
  const of = new Map(links.flatMap(({ master, member }) => [[master, []], [member, []]]));  // links by their robots
  for (const link of links) {
    of.get(link.master).push(link);
    of.get(link.member).push(link);
  }
  pen.fillStyle = kinds.paint.ink;
  for (const link of links) {
    for (const other of of.get(link.member)) {
      const both = link.master !== other.master && (other.member === link.member || other.master === link.member);
      const [from_ns, to_ns] = [Math.max(link.start_ns, other.start_ns), Math.min(link.end_ns, other.end_ns)];
      if (both && to_ns > from_ns) pen.fillRect(axis.place(from_ns), link.y, (to_ns - from_ns) / axis.ns_per_px, BRIDGE_PX);
      const turned = link.master === other.member && link.member === other.master && other.start_ns === link.end_ns;
      if (!turned) continue;
      const [top, bottom] = [Math.min(link.y, other.y), Math.max(link.y + link.height, other.y + other.height)];
      pen.fillRect(axis.place(link.end_ns) - LEAST_PX, top, 2 * LEAST_PX, bottom - top);
    }
  }
}
