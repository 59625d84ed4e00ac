// The radio as it is painted on the floor: piconets as stars, routes, frames in the air, jammers, inquiry and paging.

import { radius_px } from "./bodies.js";

const MOST_WORDS = 8; // frames whose types are written beside them
const NEAR_PX = 40;
const HALO_PX = 5;

/** Paint the links as stars around masters, in the masters' colours, and return those that are painted. */
export function paint_links(pen, floor) {
  const { places, doing } = floor.run;
  const painted = doing.links.filter(({ master, slave }) => places[master] && places[slave]);
  for (const { master, slave, lt_addr, mode, ends } of painted) {
    const [from, to] = [floor.place(places[master]), floor.place(places[slave])];
    pen.strokeStyle = floor.colour(master);
    pen.lineWidth = 6; // frames fly on it
    pen.globalAlpha = mode ? 0.2 : 0.4;
    pen.setLineDash(ends < 2 ? [2, 6] : mode ? [8, 5] : []);
    floor.line(pen, from, to);
    pen.setLineDash([]);
    pen.globalAlpha = 1;
    const words = [lt_addr, mode].filter(Boolean).join(" ");
    if (words && Math.hypot(to[0] - from[0], to[1] - from[1]) > 70) {
      pen.font = "10px system-ui, sans-serif";
      pen.textAlign = "center";
      floor.text(pen, words, [0.3 * from[0] + 0.7 * to[0], 0.3 * from[1] + 0.7 * to[1] + 3], floor.colours.quiet, floor.colours.floor);
    }
  }
  places.forEach((place, address) => paint_halo(pen, floor, address, place));
  return painted;
}

/** Paint a ring around a master in its colour, and around a bridge in those of all its piconets. */
function paint_halo(pen, floor, robot, place) {
  const masters = floor.run.doing.piconets(robot);
  if (!masters.includes(robot) && masters.length < 2) return;
  const radius = radius_px(floor, robot) + HALO_PX + 2;
  pen.lineWidth = HALO_PX - 1;
  pen.globalAlpha = 0.75;
  pen.lineCap = "butt";
  const share = masters.length > 1 ? 0.94 : 1;
  masters.forEach((master, at) => {
    pen.strokeStyle = floor.colour(master);
    pen.beginPath();
    pen.arc(...floor.place(place), radius, (2 * Math.PI * at) / masters.length, (2 * Math.PI * (at + share)) / masters.length);
    pen.stroke();
  });
  pen.lineCap = "round";
  pen.globalAlpha = 1;
}

/** Paint who has heard whom lately. */
export function paint_talks(pen, floor) {
  const { run } = floor;
  const linked = new Set(run.doing.links.map(({ master, slave }) => pair_of(master, slave)));
  pen.strokeStyle = floor.colours.accent;
  pen.lineWidth = 2;
  for (const talk of run.talks) {
    const [one, two] = talk;
    if (!run.places[one] || !run.places[two] || linked.has(pair_of(one, two))) continue;
    pen.globalAlpha = 0.45 * run.talk_glow(talk);
    floor.line(pen, floor.place(run.places[one]), floor.place(run.places[two]));
  }
  pen.globalAlpha = 1;
}

function pair_of(one, two) {
  return `${Math.min(one, two)} ${Math.max(one, two)}`;
}

/** Paint the frames: those in the air, and fainter and fainter those that were; return those that are painted. */
export function paint_frames(pen, floor) {
  const { run } = floor;
  const painted = run.frames.filter((frame) => run.places[frame.source] && run.glow(frame) > 0);
  for (const frame of painted) paint_frame(pen, floor, frame);
  const flying = painted.filter(({ end_s }) => end_s > run.now.time_s);
  pen.font = "600 10px system-ui, sans-serif";
  pen.textAlign = "center";
  const written = new Set();
  for (const frame of flying.length ? flying.slice(-MOST_WORDS) : painted.slice(-1)) paint_kind(pen, floor, frame, written);
  pen.globalAlpha = 1;
  return painted;
}

function paint_frame(pen, floor, frame) {
  const { run } = floor;
  const { source, destination, good, start_s, end_s } = frame;
  const glow = run.glow(frame);
  const flying = end_s > run.now.time_s;
  const part = flying ? (run.now.time_s - start_s) / (end_s - start_s) : 1 - glow;
  const [x, y] = floor.place(run.places[source]);
  pen.globalAlpha = 0.9 * glow;
  pen.strokeStyle = pen.fillStyle = good ? floor.colours.accent : floor.colours.bad;
  pen.lineWidth = flying ? 2.6 : 1.4;
  pen.setLineDash(good ? [] : [4, 4]);
  if (!run.places[destination]) {
    pen.beginPath();
    pen.arc(x, y, 8 + 40 * (floor.still.matches ? 1 : part), 0, 2 * Math.PI);
    pen.stroke();
  } else {
    const [to_x, to_y] = floor.place(run.places[destination]);
    floor.line(pen, [x, y], [to_x, to_y]);
    const along = floor.still.matches ? 1 : part;
    pen.beginPath();
    pen.arc(x + (to_x - x) * along, y + (to_y - y) * along, flying ? 4 : 3, 0, 2 * Math.PI);
    pen.fill();
  }
  pen.setLineDash([]);
}

/** Write the type of a frame, and its channel, where it flies; what one transmission is to several is written once. */
function paint_kind(pen, floor, { source, destination, kind, channel, start_s, good }, written) {
  const { places } = floor.run;
  const key = `${source} ${start_s} ${kind}`;
  if (written.has(key)) return;
  written.add(key);
  const [x, y] = floor.place(places[source]);
  const [to_x, to_y] = places[destination] ? floor.place(places[destination]) : [x, y - 60];
  if (places[destination] && Math.hypot(to_x - x, to_y - y) < NEAR_PX) return; // there is no room
  const words = channel >= 0 ? `${kind} k${channel}` : kind;
  pen.globalAlpha = 1;
  floor.text(pen, words, [(x + to_x) / 2, (y + to_y) / 2 - 5], good ? floor.colours.accent : floor.colours.bad, floor.colours.floor);
}

/** Paint the routes of a robot: the way to each destination, hop by hop. */
export function paint_routes(pen, floor, robot) {
  const { places, doing } = floor.run;
  if (robot === null || !places[robot]) return;
  pen.strokeStyle = pen.fillStyle = floor.colour(robot);
  pen.lineWidth = 2;
  const hops = new Set(doing.routes(robot).flatMap(({ to }) => {
    const way = doing.way(robot, to);
    return way.slice(1).map((next, at) => `${way[at]} ${next}`);
  }));
  for (const hop of hops) {
    const [from, to] = hop.split(" ").map(Number);
    if (places[from] && places[to]) arrow(pen, floor, from, to);
  }
}

function arrow(pen, floor, from, to) {
  const { places } = floor.run;
  const [[x, y], [to_x, to_y]] = [floor.place(places[from]), floor.place(places[to])];
  const angle = Math.atan2(to_y - y, to_x - x);
  const [side_x, side_y] = [4 * Math.sin(angle), -4 * Math.cos(angle)]; // beside the link, and the way back on the other side
  const short = radius_px(floor, to) + 4;
  const tip = [to_x - short * Math.cos(angle) + side_x, to_y - short * Math.sin(angle) + side_y];
  pen.setLineDash([6, 4]);
  floor.line(pen, [x + side_x, y + side_y], tip);
  pen.setLineDash([]);
  pen.beginPath();
  pen.moveTo(...tip);
  for (const turn of [2.7, -2.7]) pen.lineTo(tip[0] + 9 * Math.cos(angle + turn), tip[1] + 9 * Math.sin(angle + turn));
  pen.closePath();
  pen.fill();
}

/** Paint who inquires or scans, as a ring, and who pages or initiates whom, as a dotted line. */
export function paint_searches(pen, floor) {
  const { places, doing } = floor.run;
  pen.font = "600 10px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const { state, robot, words, inquires } of doing.searches) {
    if (!places[robot]) continue;
    const at = floor.place(places[robot]);
    const radius = radius_px(floor, robot) + (inquires ? 16 : 12);
    pen.strokeStyle = floor.colours.accent;
    pen.lineWidth = 1.6;
    pen.setLineDash(inquires ? [7, 4] : [2, 4]);
    pen.beginPath();
    pen.arc(...at, radius, 0, 2 * Math.PI);
    pen.stroke();
    const peer = places[Number(words.peer)];
    if (peer) floor.line(pen, at, floor.place(peer));
    pen.setLineDash([]);
    const text = words.train ? `${state} ${words.train}` : state;
    floor.text(pen, text, [at[0], at[1] - radius - 4], floor.colours.accent, floor.colours.floor);
  }
}

/** Paint the jammers that are on, and walls of loss that stand. */
export function paint_jammers(pen, floor) {
  pen.font = "600 10px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const { words } of floor.run.doing.in("jammer")) {
    const [x, y] = floor.place([Number(words.x_m), Number(words.y_m)]);
    pen.strokeStyle = floor.colours.bad;
    pen.lineWidth = 2;
    for (let ray = 0; ray < 8; ray += 1) {
      const angle = (ray * Math.PI) / 4;
      const [across, up] = [Math.cos(angle), Math.sin(angle)];
      floor.line(pen, [x + 3 * across, y + 3 * up], [x + 10 * across, y + 10 * up]);
    }
    floor.text(pen, `jammer ${words.mode ?? ""}`.trim(), [x, y + 22], floor.colours.bad, floor.colours.floor);
  }
  for (const { words } of floor.run.doing.in("wall")) {
    const [from, to] = [[words.x1_m, words.y1_m], [words.x2_m, words.y2_m]].map((point) => floor.place(point.map(Number)));
    pen.strokeStyle = floor.colours.bad;
    pen.lineWidth = 4;
    pen.setLineDash([3, 3]);
    floor.line(pen, from, to);
    pen.setLineDash([]);
    floor.text(pen, `${words.loss_db} dB`, [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2 - 6], floor.colours.bad, floor.colours.floor);
  }
}
