// Tables of what the floor shows, for those who do not see its canvas: robots, frames in the air, what robots believe.

import { words_of_beliefs } from "./beliefs/ways.js";
import { standing } from "./lists.js";

const MOST_FRAMES = 20;

/** The table behind a floor. */
export class Table {
  /** @param {import("./floor.js").Floor} floor */
  constructor(floor) {
    this.robots = table("floor-robots", "Robots on the floor", ["robot", "x, m", "y, m", "heading, °", "state"]);
    this.frames = table("floor-frames", "Frames in the air", ["type", "from", "to", "RF channel", "outcome"]);
    const root = document.createElement("div");
    root.className = "unseen";
    this.beliefs = table("floor-beliefs", "What robots believe and scan", ["what", "of", "in words"]);
    root.append(this.robots, this.frames, this.beliefs);
    floor.canvas.after(root);
    floor.canvas.setAttribute("aria-details", "floor-robots");
  }

  /** Show the present moment of a run; *told* have more about it in their `words`. */
  show(run, told) {
    const { stations } = run;
    fill(this.robots, run.places.map(([x, y, heading, down], robot) => [
      stations.short(robot), x.toFixed(2), y.toFixed(2), stations.has(robot) ? "" : Math.round((heading * 180) / Math.PI),
      [down && "does nothing any more", standing(run.doing, robot, stations)].filter(Boolean).join("; "),
    ]));
    fill(this.frames, run.flying.slice(0, MOST_FRAMES).map(({ kind, source, destination, channel, outcome }) =>
      [kind, stations.short(source), destination < 0 ? "all" : stations.short(destination), channel < 0 ? "" : channel, outcome || "on the air"]));
    fill(this.beliefs, [...told.flatMap(({ words }) => words), ...words_of_beliefs(run)]);
  }
}

function table(id, caption, columns) {
  const made = document.createElement("table");
  made.id = id;
  made.createCaption().textContent = caption;
  const head = made.createTHead().insertRow();
  for (const column of columns) {
    const cell = document.createElement("th");
    cell.scope = "col";
    cell.textContent = column;
    head.append(cell);
  }
  made.createTBody();
  return made;
}

function fill(made, rows) {
  const body = made.tBodies[0];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((cells, at) => {
    const row = body.rows[at] ?? body.insertRow();
    cells.forEach((text, column) => {
      const cell = row.cells[column] ?? row.insertCell();
      if (cell.textContent !== String(text)) cell.textContent = String(text);
    });
  });
}
