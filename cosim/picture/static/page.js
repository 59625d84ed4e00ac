"use strict";
const find = (id) => document.getElementById(id);
const LANE = 46, HIGH = 15, STRIP = 13, LEFT = 78, MOST = 3000, SPECTRUM = 150;
let run, view, now, chosen = null, playing = false, pending = false, looks, lost, groups;

// ---------------------------------------------------------------- reading

async function read() {
  const text = atob(find("data").textContent.trim()), packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  let at = 4 + size;
  const columns = head.columns.map(([count, width, differences, few]) => {
    const values = new Float64Array(count);  // exact up to 2^53 ns, which is 104 days
    for (let rank = 0, scale = 1; rank < width; rank++, scale *= 256, at += count)
      for (let row = 0; row < count; row++) values[row] += bytes[at + row] * scale;
    for (let row = 0, before = 0; row < count; row++)
      before = values[row] = (few.length > 1 ? few[values[row]] : values[row] + few[0]) + (differences ? before : 0);
    return values;
  });
  return [head, columns];
}

const NUMBERS = ["starts", "lengths", "kinds", "outcomes", "channels", "sizes", "sources", "peers"], TEXTS = ["part", "detail"];

function distribute(lanes, table, columns) {  // put what a table holds in order of time where it belongs: into its *lanes*
  const places = columns[table.lane], counts = lanes.map(() => 0);
  for (const number of places) counts[number]++;
  const rows = counts.map((count) => new Uint32Array(count)), filled = counts.map(() => 0);
  places.forEach((number, row) => { rows[number][filled[number]++] = row; });
  const pick = (column, mine) => { const found = new Float64Array(mine.length); mine.forEach((row, at) => { found[at] = column[row]; }); return found; };
  for (const name of NUMBERS) if (table[name] !== undefined)
    lanes.forEach((lane, number) => { if (counts[number]) lane[name] = pick(columns[table[name]], rows[number]); });
  for (const name of TEXTS) if (table[name] !== undefined) {
    const [sizes, ...words] = table[name].map((number) => columns[number]), next = words.map(() => 0);
    lanes.forEach((lane, number) => { if (counts[number]) lane[name] = words.map((column, place) =>
      Int32Array.from(rows[number], (row) => sizes[row] > place ? column[next[place]++] : -1)); });
  }
}

function unpack([head, columns]) {
  const lanes = head.lanes.map(([robot, radio, what]) => ({ robot, radio, what }));
  for (const table of head.tables) distribute(lanes, table, columns);
  for (const opened of lanes) {
    for (const name of [...NUMBERS, ...TEXTS]) opened[name] ??= null;
    const count = opened.starts.length;
    opened.busy = new Float64Array(count + 1);
    opened.gone = new Uint32Array(count + 1);
    opened.longest = 0;
    for (let row = 0; row < count; row++) {
      opened.busy[row + 1] = opened.busy[row] + opened.lengths[row];
      opened.gone[row + 1] = opened.gone[row] + (opened.what !== "states" && head.lost.includes(head.words[opened.outcomes[row]]));
      opened.longest = Math.max(opened.longest, opened.lengths[row]);
    }
  }
  const [times, robots, names, texts] = head.events.map((number) => columns[number]);
  return { ...head, lanes, from: Number(head.span[0]), to: Number(head.span[1]), ticks: columns[head.ticks],
    poses: head.poses.map((axes) => axes.map((number) => columns[number])), events: { times, robots, names, texts } };
}

function lower(values, wanted) {  // number of the first that is not less
  let low = 0, high = values.length;
  while (low < high) { const middle = (low + high) >> 1; if (values[middle] < wanted) low = middle + 1; else high = middle; }
  return low;
}

function firstSeen(lane, time) {  // number of the first box that may still be there; states of one lane never overlap
  return lane.what === "states" ? Math.max(0, lower(lane.starts, time) - 1) : lower(lane.starts, time - lane.longest);
}

// ---------------------------------------------------------------- where everything is

function place(robot, time) {
  const { ticks, poses, steps } = run;
  if (!ticks.length) return [0, 0, 0];
  const after = Math.min(lower(ticks, time), ticks.length - 1), before = Math.max(0, ticks[after] > time ? after - 1 : after);
  const gap = ticks[after] - ticks[before], part = gap ? (time - ticks[before]) / gap : 0;
  return poses[robot].map((axis, number) => (axis[before] + part * (axis[after] - axis[before])) * steps[number]);
}

function called(address) {  // stations have the addresses after those of the robots
  return address < run.robots.length ? `robot ${address}` : `station ${address - run.robots.length}`;
}

function short(address) { return address < run.robots.length ? address : `s${address - run.robots.length}`; }

function layOut() {
  // a group of lanes for each robot and radio: what it sends above its line, what it hears below, its states under that
  groups = [];
  let y = 8;
  for (const lane of run.lanes) {
    const radio = Math.max(0, lane.radio);
    let group = groups.find((each) => each.robot === lane.robot && each.radio === radio);
    if (!group) groups.push(group = { robot: lane.robot, radio, lanes: [], states: [] });
    (lane.what === "states" ? group.states : group.lanes).push(lane);
  }
  groups.sort((one, two) => (one.robot < 0) - (two.robot < 0) || one.robot - two.robot || one.radio - two.radio);
  const several = groups.some((group) => group.radio > 0);
  for (const group of groups) {
    group.line = y + HIGH + 2;
    group.name = group.robot < 0 ? "jammers" : called(group.robot) + (several && group.robot < run.robots.length ? `.${group.radio}` : "");
    for (const lane of group.lanes) { lane.y = lane.what === "sent" ? group.line - HIGH : group.line; lane.high = HIGH; }
    group.states.forEach((lane, number) => { lane.y = group.line + HIGH + 3 + number * STRIP; lane.high = STRIP - 2; });
    y += LANE - 8 + group.states.length * STRIP;
  }
  const spectrum = run.lanes.some((lane) => lane.what === "sent" && lane.channels && lane.channels.some((each) => each >= 0));
  return { axis: y, spectrum: spectrum ? y + 26 : 0, height: y + 26 + (spectrum ? SPECTRUM + 12 : 0) };
}

// ---------------------------------------------------------------- drawing

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const word = (number) => run.words[number];
const textOf = (words, row) => words.map((column) => column[row]).filter((number) => number >= 0).map(word).join(" ");
const isLost = (lane, row) => lane.gone[row + 1] > lane.gone[row];

function sized(canvas, height) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return [pen, width];
}

function draw() {
  pending = false;
  drawFloor();
  drawLanes();
  find("now").textContent = `${(now / 1e9).toFixed(6)} s`;
  find("time").value = Math.round((now - run.from) / (run.to - run.from) * 1e4);
  find("time").setAttribute("aria-valuetext", `${(now / 1e9).toFixed(3)} s`);
}

function redraw() { if (!pending) { pending = true; requestAnimationFrame(draw); } }

function drawFloor() {
  const canvas = find("floor"), height = canvas.clientHeight, [pen, width] = sized(canvas, height);
  const [x0, y0, x1, y1] = run.scene.bounds_m, scale = Math.min((width - 20) / (x1 - x0), (height - 20) / (y1 - y0));
  const left = (width - scale * (x1 - x0)) / 2, top = (height - scale * (y1 - y0)) / 2;
  const X = (x) => left + (x - x0) * scale, Y = (y) => top + (y1 - y) * scale;
  pen.fillStyle = style("--area");
  for (const polygon of run.scene.polygons_m) {
    pen.beginPath();
    polygon.forEach(([x, y]) => pen.lineTo(X(x), Y(y)));
    pen.fill();
  }
  pen.strokeStyle = style("--wall");
  pen.lineWidth = 2;
  pen.beginPath();
  for (const [a, b, c, d] of run.scene.walls_m) { pen.moveTo(X(a), Y(b)); pen.lineTo(X(c), Y(d)); }
  pen.stroke();
  for (const [x, y, begin, end] of run.jammers) {
    const on = begin <= now && now < end;
    pen.strokeStyle = on ? style("--cursor") : style("--line");
    for (const radius of on ? [5, 11, 17] : [5]) { pen.beginPath(); pen.arc(X(x), Y(y), radius, 0, 7); pen.stroke(); }
    pen.fillStyle = style("--text");
    pen.fillText(on ? "jammer" : "jammer, off", X(x) + 9, Y(y) + 16);
  }
  const places = [...run.robots.map((_, robot) => place(robot, now)), ...run.stations];  // by address
  pen.strokeStyle = style("--line");
  pen.lineWidth = 4;
  for (const [begin, end, master, slave] of run.links) if (begin <= now && now < end) {
    pen.beginPath();
    pen.moveTo(X(places[master][0]), Y(places[master][1]));
    pen.lineTo(X(places[slave][0]), Y(places[slave][1]));
    pen.stroke();
  }
  drawTrails(pen, X, Y);
  drawOnAir(pen, places, X, Y);
  run.stations.forEach(([x, y], number) => {
    pen.fillStyle = style("--quiet");
    pen.fillRect(X(x) - 5, Y(y) - 5, 10, 10);
    pen.fillStyle = style("--text");
    pen.fillText(short(run.robots.length + number), X(x) + 8, Y(y) - 6);
  });
  run.robots.forEach((colour, robot) => {
    const [x, y, heading] = places[robot], radius = Math.max(9, run.scene.radii_m[robot] * scale);
    pen.fillStyle = colour;
    pen.strokeStyle = style("--text");
    pen.lineWidth = 1.2;
    pen.beginPath();
    pen.arc(X(x), Y(y), radius, 0, 7);
    pen.fill();
    pen.moveTo(X(x), Y(y));
    pen.lineTo(X(x) + radius * Math.cos(heading) * 1.5, Y(y) - radius * Math.sin(heading) * 1.5);
    pen.stroke();
    pen.font = "bold 11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.lineWidth = 3;
    pen.strokeStyle = "#000";
    pen.strokeText(robot, X(x), Y(y) + 4);
    pen.fillStyle = "#fff";
    pen.fillText(robot, X(x), Y(y) + 4);
    pen.textAlign = "left";
    pen.font = "12px system-ui, sans-serif";
  });
}

function drawTrails(pen, X, Y) {
  const first = lower(run.ticks, now - 10e9), end = lower(run.ticks, now);
  pen.lineWidth = 1.5;
  run.robots.forEach((colour, robot) => {
    const [xs, ys] = run.poses[robot];
    pen.strokeStyle = colour;
    pen.beginPath();
    for (let tick = first; tick < end; tick++) pen.lineTo(X(xs[tick] * run.steps[0]), Y(ys[tick] * run.steps[1]));
    pen.stroke();
  });
}

function drawOnAir(pen, places, X, Y) {
  for (const lane of run.lanes) if (lane.what === "received") {
    for (let row = firstSeen(lane, now); row < lane.starts.length && lane.starts[row] <= now; row++) {
      if (lane.starts[row] + lane.lengths[row] <= now) continue;
      const [a, b] = places[lane.sources[row]], [c, d] = places[lane.robot];
      pen.strokeStyle = looks[word(lane.kinds[row])][0];
      pen.lineWidth = 3;
      pen.setLineDash(isLost(lane, row) ? [4, 4] : []);
      pen.beginPath();
      pen.moveTo(X(a), Y(b));
      pen.lineTo(X(c), Y(d));
      pen.stroke();
      pen.setLineDash([]);
      if (isLost(lane, row)) cross(pen, X(a + 0.6 * (c - a)), Y(b + 0.6 * (d - b)), 5);
    }
  }
}

function cross(pen, x, y, size) {
  pen.strokeStyle = style("--text");
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(x - size, y - size); pen.lineTo(x + size, y + size);
  pen.moveTo(x - size, y + size); pen.lineTo(x + size, y - size);
  pen.stroke();
}

let frame;
function drawLanes() {
  frame = layOut();
  const canvas = find("lanes");
  canvas.style.height = `${frame.height}px`;
  const [pen, width] = sized(canvas, frame.height), span = view.to - view.from;
  const X = (time) => LEFT + (time - view.from) / span * (width - LEFT - 8);
  frame.X = X;
  frame.time = (x) => view.from + (x - LEFT) / (width - LEFT - 8) * span;
  pen.font = "12px system-ui, sans-serif";
  drawAxis(pen, X, width);
  for (const group of groups) {
    pen.fillStyle = style("--text");
    pen.fillText(group.name, 4, group.line + 4);
    pen.fillStyle = style("--line");
    pen.fillRect(LEFT, group.line, width - LEFT - 8, 1);
  }
  pen.save();
  pen.beginPath();
  pen.rect(LEFT, 0, width - LEFT - 8, frame.height);
  pen.clip();
  let drawn = 0;
  for (const lane of run.lanes) drawn += drawLane(pen, lane, X, width, drawn);
  if (frame.spectrum) drawSpectrum(pen, X);
  pen.fillStyle = style("--cursor");
  pen.fillRect(X(now), 0, 1.5, frame.height);
  if (chosen) {
    const { lane, row } = chosen, x = X(lane.starts[row]);
    pen.strokeStyle = style("--cursor");
    pen.lineWidth = 2.5;
    pen.strokeRect(x - 1, lane.y - 1, Math.max(3, X(lane.starts[row] + lane.lengths[row]) - x) + 2, lane.high + 2);
  }
  pen.restore();
}

function drawAxis(pen, X, width) {
  const span = view.to - view.from, rough = span / Math.max(2, (width - LEFT) / 110);
  const steps = [1, 2, 5].flatMap((each) => [each, each * 10, each * 100]).map((each) => each * 10 ** Math.max(0, Math.floor(Math.log10(rough)) - 1));
  const step = Math.min(...steps.filter((each) => each >= rough)), digits = Math.max(0, 9 - Math.floor(Math.log10(step) + 1e-9));
  pen.textAlign = "center";
  for (let time = Math.ceil(view.from / step) * step; time <= view.to; time += step) {
    pen.fillStyle = style("--line");
    pen.globalAlpha = 0.35;
    pen.fillRect(X(time), 0, 1, frame.height);
    pen.globalAlpha = 1;
    pen.fillStyle = style("--text");
    if (X(time) < width - 30) pen.fillText(`${(time / 1e9).toFixed(digits)} s`, X(time), frame.axis + 10);
  }
  pen.textAlign = "left";
}

function drawLane(pen, lane, X, width) {
  const first = firstSeen(lane, view.from), end = lower(lane.starts, view.to);
  if (end - first > MOST) return drawShares(pen, lane, X, width);
  pen.font = "10px system-ui, sans-serif";
  for (let row = first; row < end; row++) {
    const x = X(lane.starts[row]), wide = Math.max(1, X(lane.starts[row] + lane.lengths[row]) - x);
    if (x + wide < LEFT) continue;
    const kind = word(lane.kinds[row]), [fill, ink] = looks[kind], gone = isLost(lane, row);
    pen.fillStyle = gone ? "#fff" : fill;
    pen.fillRect(x, lane.y, wide, lane.high);
    if (wide > 3) {
      pen.strokeStyle = lane.what === "states" ? style("--line") : "#000";
      pen.lineWidth = gone ? 1.2 : 0.6;
      pen.strokeRect(x + 0.3, lane.y + 0.3, wide - 0.6, lane.high - 0.6);
    }
    if (gone) hatch(pen, x, lane.y, wide, lane.high, fill);
    const left = Math.max(LEFT, x), room = Math.min(x + wide, width - 8) - left, text = pen.measureText(kind).width;
    if (wide > 14 && text < room - 3) {
      const at = left + (room - text) / 2;
      if (gone) { pen.fillStyle = "#fff"; pen.fillRect(at - 1, lane.y + 2, text + 2, lane.high - 4); }
      pen.fillStyle = gone ? "#000" : ink;
      pen.fillText(kind, at, lane.y + lane.high - 4);
    }
  }
  return end - first;
}

function hatch(pen, x, y, wide, high, colour) {
  pen.fillStyle = "#000";
  if (wide < 4) { pen.fillRect(x, y, wide, high); return; }
  pen.save();
  pen.beginPath();
  pen.rect(x, y, wide, high);
  pen.clip();
  pen.strokeStyle = "#000";
  pen.lineWidth = 1;
  pen.beginPath();
  for (let at = Math.max(x, LEFT) - high; at < Math.min(x + wide, 8000); at += 5) { pen.moveTo(at, y + high); pen.lineTo(at + high, y); }
  pen.stroke();
  pen.restore();
}

function drawShares(pen, lane, X, width) {
  // more boxes than can be seen: a pixel shows the first kind in it, as dark as it is busy, and whether any was lost
  const a_pixel = (view.to - view.from) / (width - LEFT - 8);
  let row = lower(lane.starts, view.from);
  for (let x = LEFT; x < width - 8; x++) {
    const next = row + lower(lane.starts.subarray(row), view.from + (x + 1 - LEFT) * a_pixel);
    if (next > row) {
      pen.globalAlpha = Math.min(1, 0.35 + 0.65 * (lane.busy[next] - lane.busy[row]) / a_pixel);
      pen.fillStyle = looks[word(lane.kinds[row])][0];
      pen.fillRect(x, lane.y, 1, lane.high);
      pen.globalAlpha = 1;
      if (lane.gone[next] > lane.gone[row]) {
        pen.fillStyle = style("--text");
        pen.fillRect(x, lane.y + (lane.what === "sent" ? 0 : lane.high - 5), 1, 5);
      }
    }
    row = next;
  }
  return 0;
}

function drawSpectrum(pen, X) {
  pen.strokeStyle = style("--line");
  pen.strokeRect(LEFT, frame.spectrum, 1e5, SPECTRUM);
  const a_row = SPECTRUM / 79;
  for (const lane of run.lanes) if (lane.what === "received" && lane.channels) {
    const first = firstSeen(lane, view.from), end = lower(lane.starts, view.to);
    const stride = Math.max(1, Math.ceil((end - first) / 8000));
    for (let row = first; row < end; row += stride) if (lane.channels[row] >= 0) {
      const x = X(lane.starts[row]), y = frame.spectrum + SPECTRUM - (lane.channels[row] + 1) * a_row;
      const gone = isLost(lane, row);
      pen.fillStyle = gone ? style("--text") : looks[word(lane.kinds[row])][0];
      pen.fillRect(x, y, Math.max(1.5, X(lane.starts[row] + lane.lengths[row]) - x), gone ? a_row + 2 : a_row);
    }
  }
  pen.clearRect(0, frame.spectrum, LEFT - 1, SPECTRUM);
}

// ---------------------------------------------------------------- what is chosen, and lists

function choose(lane, row, centre) {
  chosen = { lane, row };
  now = lane.starts[row];
  if (centre && (now < view.from || now + lane.lengths[row] > view.to)) show(now - (view.to - view.from) / 2, view.to - view.from);
  const [who, number] = called(lane.robot).split(" ");
  const fields = [["kind", word(lane.kinds[row])], [who, `${number}, ${lane.what}`],
    ["begins", `${(now / 1e9).toFixed(9)} s`], ["lasts", `${lane.lengths[row] / 1000} µs, ${(lane.lengths[row] / 625000).toFixed(3)} slots`]];
  if (lane.what !== "states") fields.push(["outcome", word(lane.outcomes[row])]);
  if (lane.sources && lane.what !== "sent") fields.push(["from", called(lane.sources[row])]);
  if (lane.peers && lane.what === "sent") fields.push(["to", lane.peers[row] < 0 ? "all" : called(lane.peers[row])]);
  if (lane.channels && lane.channels[row] >= 0) fields.push(["RF channel", `${lane.channels[row]}, ${2402 + lane.channels[row]} MHz`]);
  if (lane.sizes) fields.push(["payload", `${lane.sizes[row]} B`]);
  for (const name of ["part", "detail"]) if (lane[name] && textOf(lane[name], row)) fields.push([name === "part" ? "lost part" : name, textOf(lane[name], row)]);
  const source = lane.what === "sent" ? lane.robot : lane.sources ? lane.sources[row] : null;
  if (source !== null) for (const other of run.lanes) if (other.what === "received" && other.radio === lane.radio)
    for (let at = lower(other.starts, now); at < other.starts.length && other.starts[at] === now; at++)
      if (other.sources[at] === source) fields.push([`at ${called(other.robot)}`, word(other.outcomes[at])]);
  const list = document.createElement("dl");
  for (const [name, value] of fields) {
    list.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
  }
  find("chosen").replaceChildren(list);
  lists();
  redraw();
}

function step(direction, only) {
  // the next box, in time, of the chosen lane, or of any if only those that *only* accepts are wanted
  const lanes = only || !chosen ? run.lanes.filter((lane) => lane.what !== "states") : [chosen.lane];
  const after = chosen ? chosen.lane.starts[chosen.row] : now;
  let best = null;
  for (const lane of lanes) {
    let row = direction > 0 ? lower(lane.starts, after + 1) : lower(lane.starts, after) - 1;
    while (only && row >= 0 && row < lane.starts.length && !only(lane, row)) row += direction;
    if (row >= 0 && row < lane.starts.length && (!best || (lane.starts[row] - best.lane.starts[best.row]) * direction < 0)) best = { lane, row };
  }
  if (best) choose(best.lane, best.row, true);
  else find("chosen").replaceChildren(Object.assign(document.createElement("p"), { textContent: "There is none any more." }));
}

function at(x, y) {
  for (const lane of run.lanes) if (y >= lane.y && y < lane.y + lane.high) {
    const time = frame.time(x), slack = frame.time(x + 3) - time;
    for (let row = lower(lane.starts, time + slack) - 1; row >= 0 && row >= firstSeen(lane, time - slack); row--)
      if (lane.starts[row] + lane.lengths[row] >= time - slack) return { lane, row };
  }
  return null;
}

let listed = 0;
function lists() {
  const { times, robots, names, texts } = run.events, end = lower(times, now + 1), items = [];
  for (let row = end - 1; row >= Math.max(0, end - 40); row--) {
    const who = robots[row] < 0 ? "" : `robot ${robots[row]} `;
    items.push(Object.assign(document.createElement("li"), { textContent: `${(times[row] / 1e9).toFixed(3)} s ${who}${word(names[row])} ${word(texts[row])}` }));
  }
  find("events").replaceChildren(...items);
  if (!document.querySelector("details").open) return;
  const found = [];
  for (const lane of run.lanes) {
    const first = firstSeen(lane, view.from), last = lower(lane.starts, view.to);
    for (let row = first; row < Math.min(last, first + 300); row++)
      if (lane.starts[row] + lane.lengths[row] > view.from)
        found.push([lane.starts[row], short(lane.robot), lane.what, word(lane.kinds[row]), lane.channels ? lane.channels[row] : "", word(lane.outcomes[row])]);
  }
  found.sort((one, two) => one[0] - two[0]);
  find("rows").replaceChildren(...found.slice(0, 200).map((cells) => {
    const line = document.createElement("tr");
    line.append(...cells.map((cell, number) => Object.assign(document.createElement("td"), { textContent: number ? cell : (cell / 1e9).toFixed(9) })));
    return line;
  }));
}

// ---------------------------------------------------------------- time

function show(from, span) {
  const whole = run.to - run.from;
  span = Math.min(Math.max(span, 20e3), whole);
  from = Math.min(Math.max(from, run.from), run.to - span);
  view = { from, to: from + span };
  redraw();
}

function zoom(factor, about) { show(about - (about - view.from) * factor, (view.to - view.from) * factor); }

function go(time) {
  now = Math.min(Math.max(time, run.from), run.to);
  if (now < view.from || now > view.to) show(now - (view.to - view.from) * 0.1, view.to - view.from);
  redraw();
}

let last = 0;
function play(wall) {
  if (!playing) return;
  go(now + (last ? wall - last : 0) * 1e6 * Number(find("speed").value));
  last = wall;
  if (wall - listed > 500) { listed = wall; lists(); }
  if (now >= run.to) toggle();
  else requestAnimationFrame(play);
}

function toggle() {
  playing = !playing;
  last = 0;
  if (playing && now >= run.to) go(run.from);
  find("play").textContent = playing ? "Pause" : "Play";
  if (playing) requestAnimationFrame(play);
  else lists();
}

// ---------------------------------------------------------------- a person

function listen() {
  const lanes = find("lanes"), below = find("below"), fingers = new Map();
  let moved = 0;
  below.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) show(view.from + (event.deltaX || event.deltaY) / 1000 * (view.to - view.from), view.to - view.from);
    else zoom(Math.exp(event.deltaY / 400), frame.time(event.offsetX));
  }, { passive: false });
  lanes.addEventListener("pointerdown", (event) => { fingers.set(event.pointerId, event.offsetX); moved = 0; lanes.setPointerCapture(event.pointerId); });
  lanes.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = fingers.get(event.pointerId), others = [...fingers].filter(([id]) => id !== event.pointerId);
    moved += Math.abs(event.offsetX - before);
    if (others.length) {
      const other = others[0][1], was = Math.abs(before - other), is = Math.abs(event.offsetX - other);
      if (was > 5 && is > 5) zoom(was / is, frame.time(other));
    } else if (moved > 3) show(view.from - (frame.time(event.offsetX) - frame.time(before)), view.to - view.from);
    fingers.set(event.pointerId, event.offsetX);
  });
  lanes.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    if (moved > 3) return;
    const found = at(event.offsetX, event.offsetY);
    if (found) choose(found.lane, found.row, false);
    else if (event.offsetX > LEFT) { go(frame.time(event.offsetX)); lists(); }
  });
  lanes.addEventListener("pointercancel", (event) => fingers.delete(event.pointerId));
  const acts = { play: toggle, in: () => zoom(0.5, now), out: () => zoom(2, now), all: () => show(run.from, run.to - run.from),
    back: () => step(-1), next: () => step(1), lost: () => step(1, isLost) };
  for (const [id, act] of Object.entries(acts)) find(id).addEventListener("click", act);
  find("time").addEventListener("input", (event) => { go(run.from + event.target.value / 1e4 * (run.to - run.from)); lists(); });
  const keys = { " ": "play", "+": "in", "=": "in", "-": "out", "0": "all", p: "back", n: "next", l: "lost" };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || ["SELECT", "INPUT"].includes(event.target.tagName)) return;
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    const span = view.to - view.from, pan = { ArrowLeft: -0.1, ArrowRight: 0.1 }[event.key];
    if (pan && event.target.id !== "events") show(view.from + pan * span, span);
    else if (keys[event.key]) acts[keys[event.key]]();
    else return;
    event.preventDefault();
  });
  document.querySelector("details").addEventListener("toggle", lists);
  new ResizeObserver(redraw).observe(document.body);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

function legend() {
  const items = Object.entries(looks).map(([kind, [fill]]) => {
    const item = Object.assign(document.createElement("span"), { textContent: kind });
    item.style.setProperty("--fill", fill);
    return item;
  });
  if (run.lost.length) items.push(Object.assign(document.createElement("span"), { className: "lost", textContent: "lost" }));
  find("legend").replaceChildren(...items);
}

async function begin() {
  run = unpack(await read());
  looks = run.looks;
  now = run.from;
  view = { from: run.from, to: run.to };
  for (const speed of [1e-5, 1e-4, 1e-3, 0.01, 0.1, 1, 10, 100])
    find("speed").append(Object.assign(document.createElement("option"), { value: speed, textContent: `${speed}`, selected: speed === 1 }));
  const wanted = new URLSearchParams(location.hash.slice(1));  // #t=3.9&span=0.04: a moment, and how much around it
  if (wanted.has("t")) {
    now = Number(wanted.get("t")) * 1e9;
    show(now - (Number(wanted.get("span")) || 0.02) * 5e8, (Number(wanted.get("span")) || 0.02) * 1e9);
  }
  legend();
  listen();
  lists();
  draw();
  document.body.dataset.ready = "true";
}

begin().catch((error) => { find("now").textContent = `This page cannot be shown here: ${error.message}`; });
