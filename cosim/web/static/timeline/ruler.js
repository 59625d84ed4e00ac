// The ruler: seconds, milliseconds, microseconds, and slots where these can be told apart.

import { seconds } from "./axis.js";

const LEAST_TICK_PX = 84;
const LEAST_SLOT_PX = 34;
const LEAST_SHADE_PX = 7;

/** Distance of the ruler's numbers (ns): 1, 2 or 5 times a power of ten. */
export function tick_ns(ns_per_px) {
  const least = Math.max(1, LEAST_TICK_PX * ns_per_px);
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((times) => times * power).find((step) => step >= least);
}

/** What a number of the ruler says: whole seconds or milliseconds, and for finer ones the distance from these. */
export function tick_text(ns, step_ns) {
  if (step_ns >= 1e8) return { text: `${seconds(ns, step_ns >= 1e9 ? 0 : 1)} s`, main: true };
  const [base, unit, name] = step_ns >= 1e5 ? [1e9, 1e6, "ms"] : [1e6, 1e3, "µs"];
  const rest = ns % base;
  if (rest === 0) return { text: `${seconds(ns, base === 1e9 ? 0 : 3)} s`, main: true };
  return { text: `+${Number((rest / unit).toFixed(3))} ${name}`, main: false };
}

/** Draw the ruler on a pen in CSS pixels. */
export function paint_ruler(pen, { axis, kinds, height, origin_ns, slot_ns }) {
  const { paint } = kinds;
  pen.clearRect(0, 0, axis.width_px, height);
  pen.font = "11px system-ui, sans-serif";
  pen.textBaseline = "middle";
  pen.textAlign = "left";
  paint_slots(pen, axis, paint, height, origin_ns, slot_ns);
  const step = tick_ns(axis.ns_per_px);
  let main = false;
  for (let ns = Math.ceil(axis.from_ns / step) * step; ns <= axis.to_ns; ns += step) {
    const x = axis.place(ns);
    const tick = tick_text(ns, step);
    main ||= tick.main;
    pen.fillStyle = paint.quiet;
    pen.fillRect(x, height - (tick.main ? 14 : 9), 1, 14);
    pen.fillStyle = tick.main ? paint.ink : paint.quiet;
    pen.fillText(tick.text, x + 3, 8);
  }
  if (!main) { // from where the others count
    const base = step >= 1e5 ? 1e9 : 1e6;
    const text = `${seconds(Math.floor(axis.from_ns / base) * base, base === 1e9 ? 0 : 3)} s`;
    pen.fillStyle = paint.paper;
    pen.fillRect(0, 0, 7 * text.length + 6, 15);
    pen.fillStyle = paint.ink;
    pen.fillText(text, 2, 8);
  }
}

function paint_slots(pen, axis, paint, height, origin_ns, slot_ns) {
  const wide = slot_ns / axis.ns_per_px;
  if (wide < LEAST_SHADE_PX) return;
  pen.fillStyle = paint.ink;
  for (let slot = Math.floor((axis.from_ns - origin_ns) / slot_ns); origin_ns + slot * slot_ns < axis.to_ns; slot += 1) {
    const x = axis.place(origin_ns + slot * slot_ns);
    pen.globalAlpha = slot % 2 ? 0.28 : 0.1;
    pen.fillRect(x, height - 12, wide, 12);
    pen.globalAlpha = 1;
    if (wide >= LEAST_SLOT_PX) pen.fillText(String(slot), x + 4, height - 5);
  }
}
