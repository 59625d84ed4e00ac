// Robots and stations as they are painted: where they have been, what they have marked, where they are, and what they do.

const LEAST_RADIUS_PX = 6;
const STATION_PX = 5; // half of its side
const PIECE = 40; // points of a trail that are equally faint
const HINDERED = { crashed: "crashed", frozen: "frozen", off: "radio off", camera_off: "camera off" };

/** Paint the trails of the last *span_s*. */
export function paint_trails(pen, floor, span_s) {
  pen.lineWidth = 1.5;
  pen.lineCap = "butt"; // the pieces must not overlap
  floor.run.now.robots.forEach(([own_x, own_y], robot) => {
    const trail = floor.run.trail(robot, span_s);
    if (!trail.length) return;
    const points = [...trail.map(([, x, y]) => [x, y]), [own_x, own_y]];
    pen.strokeStyle = floor.colour(robot);
    for (let from = 0; from < points.length - 1; from += PIECE) {
      pen.globalAlpha = 0.12 + (0.4 * from) / points.length;
      pen.beginPath();
      for (const point of points.slice(from, from + PIECE + 1)) pen.lineTo(...floor.place(point));
      pen.stroke();
    }
  });
  pen.lineCap = "round";
  pen.globalAlpha = 1;
}

/** Paint what an event has marked. */
export function paint_mark(pen, floor, mark) {
  const [x, y] = floor.place([mark.x, mark.y]);
  pen.strokeStyle = floor.colour(mark.robot);
  pen.lineWidth = 2;
  pen.globalAlpha = 0.85;
  pen.beginPath();
  if (mark.kind === "goal") pen.arc(x, y, 9, 0, 2 * Math.PI);
  else if (mark.kind === "frontier") pen.rect(x - 5, y - 5, 10, 10);
  else if (mark.kind === "ghost") {
    pen.setLineDash([3, 3]);
    pen.arc(x, y, 8, 0, 2 * Math.PI);
  } else {
    pen.moveTo(x - 4, y - 4);
    pen.lineTo(x + 4, y + 4);
    pen.moveTo(x - 4, y + 4);
    pen.lineTo(x + 4, y - 4);
  }
  pen.stroke();
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}

/** Radius of a painted robot, or station, px. */
export function radius_px(floor, address) {
  if (floor.run.stations.has(address)) return STATION_PX;
  return Math.max(LEAST_RADIUS_PX, (floor.run.scene.radii_m[address] ?? 0.2) * floor.scale);
}

/** Paint a robot: its shape and colour say which, an empty one does nothing any more. */
export function paint_robot(pen, floor, robot, [x_m, y_m, heading, down]) {
  const [x, y] = floor.place([x_m, y_m]);
  const radius = radius_px(floor, robot);
  pen.globalAlpha = 1;
  pen.fillStyle = down ? floor.colours.paper : floor.colour(robot);
  pen.strokeStyle = down ? floor.colours.quiet : floor.colours.paper;
  pen.lineWidth = 1.5;
  outline(pen, floor.shape(robot), [x, y], radius);
  pen.fill();
  pen.stroke();
  floor.line(pen, [x, y], [x + radius * Math.cos(heading), y - radius * Math.sin(heading)]);
  if (robot === floor.selected) {
    pen.strokeStyle = floor.colours.ink;
    outline(pen, floor.shape(robot), [x, y], radius + 4);
    pen.stroke();
  }
}

/** Paint a station in the background: a small square that has nothing of a robot. */
export function paint_station(pen, floor, address, place) {
  const [x, y] = floor.place(place);
  pen.globalAlpha = 1;
  pen.fillStyle = floor.colour(address);
  pen.strokeStyle = floor.colours.paper;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.rect(x - STATION_PX, y - STATION_PX, 2 * STATION_PX, 2 * STATION_PX);
  pen.fill();
  pen.stroke();
  if (address !== floor.selected) return;
  pen.strokeStyle = floor.colours.ink;
  outline(pen, "square", [x, y], STATION_PX + 4);
  pen.stroke();
}

/** Lay the outline of a shape around a point. */
export function outline(pen, shape, [x, y], radius) {
  pen.beginPath();
  if (shape === "circle") {
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    return;
  }
  const corners = { square: [45, 135, 225, 315], diamond: [0, 90, 180, 270], triangle: [90, 210, 330] }[shape];
  const far = radius * (shape === "square" ? 1.25 : 1.35);
  for (const degrees of corners) {
    const angle = (degrees * Math.PI) / 180;
    pen.lineTo(x + far * Math.cos(angle), y - far * Math.sin(angle));
  }
  pen.closePath();
}

/** Paint the number of a robot, or station, beside it. */
export function paint_label(pen, floor, address) {
  pen.font = "600 12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  floor.text(pen, floor.label(address), floor.labels[address], floor.colours.ink, floor.colours.paper);
  pen.textBaseline = "alphabetic";
}

/** Paint a band above each robot, or station, that a fault hinders, with the word for it. */
export function paint_hindrances(pen, floor) {
  pen.font = "600 10px system-ui, sans-serif";
  pen.textAlign = "center";
  const { run } = floor;
  for (const { robot, state } of run.doing.in(...Object.keys(HINDERED))) {
    const place = run.places[robot];
    if (!place || (place[3] && state !== "crashed")) continue; // the radio of a dead one is off
    const [x, y] = floor.place(place);
    const words = HINDERED[state];
    const wide = pen.measureText(words).width + 8;
    const top = y - radius_px(floor, robot) - 19;
    pen.fillStyle = floor.colours.bad;
    pen.fillRect(x - wide / 2, top, wide, 13);
    pen.fillStyle = floor.colours.paper;
    pen.fillText(words, x, top + 10);
  }
}
