// The floor itself as it is painted: its extent, what is solid, walls, the base, and the places that have names.

const MOST_POINTS = 40; // of a name, that are dotted
const LONG_PX = 44; // as long is a wall that its loss is written beside
const LOSS_DB = 0.5; // a wall that takes less is not told of

/** Paint the floor, which everything else stands on. */
export function paint_ground(pen, floor) {
  const { scene } = floor.run;
  const [x_min, y_min, x_max, y_max] = scene.bounds_m;
  const [left, top] = floor.place([x_min, y_max]);
  pen.fillStyle = floor.colours.floor;
  pen.fillRect(left, top, (x_max - x_min) * floor.scale, (y_max - y_min) * floor.scale);
  pen.fillStyle = floor.colours.solid;
  for (const polygon of scene.polygons_m) {
    pen.beginPath();
    for (const point of polygon) pen.lineTo(...floor.place(point));
    pen.closePath();
    pen.fill();
  }
}

/** Paint the walls, and what each costs a signal if that is asked for. */
export function paint_walls(pen, floor, losses) {
  const { scene } = floor.run;
  pen.strokeStyle = floor.colours.wall;
  pen.lineWidth = 2;
  pen.beginPath();
  for (const [x1, y1, x2, y2] of scene.walls_m) {
    pen.moveTo(...floor.place([x1, y1]));
    pen.lineTo(...floor.place([x2, y2]));
  }
  pen.stroke();
  if (losses) paint_losses(pen, floor, scene);
  if (scene.base_m) triangle(pen, floor.place(scene.base_m), 10, floor.colours.base);
}

function paint_losses(pen, floor, { walls_m, wall_losses_db = [] }) {
  pen.font = "10px system-ui, sans-serif";
  pen.textAlign = "center";
  const taken = [];
  walls_m.forEach(([x1, y1, x2, y2], wall) => {
    const loss_db = wall_losses_db[wall] ?? 0;
    const upright = Math.abs(y2 - y1) > Math.abs(x2 - x1);
    const [middle_x, middle_y] = floor.place([(x1 + x2) / 2, (y1 + y2) / 2]);
    const [x, y] = upright ? [middle_x + 22, middle_y + 3] : [middle_x, middle_y - 5]; // beside the wall
    if (loss_db < LOSS_DB || Math.hypot(x2 - x1, y2 - y1) * floor.scale < LONG_PX) return;
    if (taken.some(([other_x, other_y]) => Math.abs(other_x - x) < 60 && Math.abs(other_y - y) < 30)) return;
    taken.push([x, y]);
    floor.text(pen, `${Number(loss_db.toFixed(1))} dB`, [x, y], floor.colours.quiet, floor.colours.floor);
  });
}

/** Paint the places that have names, and the names. */
export function paint_places(pen, floor) {
  pen.globalAlpha = 1;
  pen.fillStyle = floor.colours.quiet;
  pen.font = "11px system-ui, sans-serif";
  pen.textAlign = "center";
  const names = new Map(); // by point: one may have several names
  for (const [name, points] of Object.entries(floor.run.scene.places_m)) {
    for (const point of points.slice(0, MOST_POINTS)) {
      const [x, y] = floor.place(point);
      pen.fillRect(x - 1, y - 1, 2, 2);
    }
    const at = String(points[0]);
    if (points.length === 1) names.set(at, { point: points[0], text: names.has(at) ? `${names.get(at).text}, ${name}` : name });
  }
  for (const { point, text } of names.values()) {
    const [x, y] = floor.place(point);
    floor.text(pen, text, [x, y - floor.letter_px(point)], floor.colours.quiet, floor.colours.floor);
  }
}

function triangle(pen, [x, y], size, colour) {
  pen.fillStyle = colour;
  pen.beginPath();
  pen.moveTo(x, y - size);
  pen.lineTo(x + size * 0.9, y + size * 0.7);
  pen.lineTo(x - size * 0.9, y + size * 0.7);
  pen.closePath();
  pen.fill();
}
