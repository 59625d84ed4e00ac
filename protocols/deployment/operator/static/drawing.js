// What the page draws on the floor besides the run: chosen places, final places of robots, a way.

import { final_places } from "./played.js";

/** Draw the places in the form, and the final places of the robots by the plan that is being played. */
export function paint_places(pen, floor, { chosen, current }) {
  pen.font = "11px system-ui, sans-serif";
  pen.textAlign = "center";
  const finals = current && current.result === "" ? final_places(current.plan.root) : [];
  for (const [robot, place] of finals) {
    ring(pen, floor, place, 13, floor.colour(robot), []);
    ring(pen, floor, place, 9, floor.colour(robot), []);
  }
  for (const { point, name } of chosen) {
    if (finals.some(([, [x, y]]) => x === point[0] && y === point[1])) continue;
    ring(pen, floor, point, 11, floor.colours.accent, [3, 3]);
    const [x, y] = floor.place(point);
    pen.fillStyle = floor.colours.accent;
    pen.fillText(name, x, y + 24);
  }
  pen.setLineDash([]);
}

/** Draw the way that was asked for. */
export function paint_way(pen, floor, way) {
  if (!way) return;
  pen.strokeStyle = floor.colour(way.robot);
  pen.lineWidth = 2;
  pen.setLineDash([7, 5]);
  pen.beginPath();
  for (const point of way.points) pen.lineTo(...floor.place(point));
  pen.stroke();
  pen.setLineDash([]);
}

function ring(pen, floor, point, radius, colour, dash) {
  const [x, y] = floor.place(point);
  pen.strokeStyle = colour;
  pen.lineWidth = 1.6;
  pen.setLineDash(dash);
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.stroke();
}
