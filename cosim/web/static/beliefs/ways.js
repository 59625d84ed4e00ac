// Where robots mean to go, and where they take themselves to be.

import { outline, radius_px } from "../bodies.js";

const SIGMAS = Math.sqrt(5.991); // the ellipse that holds 95 % of a normal distribution of places
const FLAG_PX = 12;
const LEAST_PX = 1.5; // an estimate that is nearer to the truth than this is hidden by the robot anyway

/**
 * Paint the path of each robot, and a flag at its goal; to that a thin line, if no path leads there. A path begins where
 * the robot takes itself to be: all of it is what the robot believes.
 */
export function paint_ways(pen, floor) {
  for (const [robot, points, goal] of floor.run.beliefs.ways) {
    const place = believed(floor.run, robot);
    if (!place) continue;
    pen.strokeStyle = pen.fillStyle = floor.colour(robot);
    const path = [place, ...points].map((point) => floor.place(point));
    pen.globalAlpha = 0.75;
    pen.lineWidth = 2;
    pen.setLineDash([7, 4]);
    trace(pen, path);
    if (goal) {
      const end = floor.place(goal);
      pen.lineWidth = 1;
      pen.setLineDash([1, 5]);
      trace(pen, [path.at(-1), end]);
      pen.setLineDash([]);
      flag(pen, end);
    }
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }
}

/** Paint where robots take themselves to be: an empty shape, how sure that is, and a line from where they truly are. */
export function paint_estimates(pen, floor) {
  for (const [robot, origin, x_m, y_m, heading, xx, xy, yy] of floor.run.beliefs.estimates) {
    const place = floor.run.now.robots[robot];
    if (!place) continue;
    const [x, y] = floor.place([x_m, y_m]);
    const [true_x, true_y] = floor.place(place);
    pen.strokeStyle = pen.fillStyle = floor.colour(robot);
    pen.lineWidth = 1.5;
    if (xx !== null) ellipse(pen, [x, y], ellipse_of(xx, xy, yy), floor.scale);
    if (Math.hypot(x - true_x, y - true_y) < LEAST_PX) continue;
    const radius = radius_px(floor, robot);
    floor.line(pen, [true_x, true_y], [x, y]);
    if (origin === "odometry") pen.setLineDash([3, 3]);
    outline(pen, floor.shape(robot), [x, y], radius);
    pen.stroke();
    pen.setLineDash([]);
    floor.line(pen, [x, y], [x + radius * Math.cos(heading), y - radius * Math.sin(heading)]);
  }
}

/** Where a robot takes itself to be, by its filter if it has one, or else by odometry; or where it is, if it knows. */
function believed({ beliefs: { estimates }, now }, robot) {
  const own = estimates.filter(([whose]) => whose === robot);
  const [, , x, y] = own.find(([, origin]) => origin === "machine") ?? own[0] ?? [];
  return x === undefined ? now.robots[robot] : [x, y];
}

/** Half axes (m) and the direction of the greater one of the ellipse that holds 95 % by a covariance (m²). */
export function ellipse_of(xx, xy, yy) {
  const middle = (xx + yy) / 2;
  const apart = Math.hypot((xx - yy) / 2, xy);
  const half = (variance) => SIGMAS * Math.sqrt(Math.max(0, variance));
  return { long_m: half(middle + apart), short_m: half(middle - apart), angle_rad: Math.atan2(2 * xy, xx - yy) / 2 };
}

/** What is shown of these, in words: rows of [what, of whom, words]. */
export function words_of_beliefs(run) {
  const { beliefs: { ways, estimates }, now } = run;
  const at = ([x, y]) => `${x.toFixed(2)}, ${y.toFixed(2)}`;
  const long_m = (points) => points.slice(1).reduce((sum, [x, y], before) => sum + Math.hypot(x - points[before][0], y - points[before][1]), 0);
  return [
    ...ways.map(([robot, points, goal]) => {
      const path = points.length ? `a path of ${long_m([believed(run, robot), ...points]).toFixed(1)} m` : "no path";
      return ["way", `robot ${robot}`, [path, goal && `the goal is at ${at(goal)}`].filter(Boolean).join(", ")];
    }),
    ...estimates.map(([robot, origin, x, y, , xx, xy, yy]) => {
      const off_m = Math.hypot(x - now.robots[robot][0], y - now.robots[robot][1]).toFixed(2);
      const sure = xx === null ? "" : `, with 95 % within ${ellipse_of(xx, xy, yy).long_m.toFixed(2)} m`;
      return [`estimate by ${origin}`, `robot ${robot}`, `at ${at([x, y])}, ${off_m} m off${sure}`];
    }),
  ];
}

function ellipse(pen, [x, y], { long_m, short_m, angle_rad }, scale) {
  pen.beginPath();
  pen.ellipse(x, y, long_m * scale, short_m * scale, -angle_rad, 0, 2 * Math.PI);
  pen.globalAlpha = 0.15;
  pen.fill();
  pen.globalAlpha = 1;
  pen.stroke();
}

function trace(pen, points) {
  pen.beginPath();
  for (const point of points) pen.lineTo(...point);
  pen.stroke();
}

function flag(pen, [x, y]) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x, y - FLAG_PX);
  pen.lineTo(x + FLAG_PX * 0.75, y - FLAG_PX * 0.7);
  pen.lineTo(x, y - FLAG_PX * 0.4);
  pen.fill();
  pen.lineWidth = 1.5;
  pen.stroke();
}
