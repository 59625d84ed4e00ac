// The robots as the host knows them: the list, the state of the selected one, its way, a picture of its camera.

import { button, make, seconds } from "./parts.js";

const STALE_S = 5;

/** The lower left part of the page. */
export class RobotPart {
  /**
   * @param {(id: string) => HTMLElement} find
   * @param {{floor: object, picker: object, select: (robot: number | null) => void, ask: (request: object) => Promise<object>}} about
   */
  constructor(find, { floor, picker, select, ask }) {
    Object.assign(this, { find, floor, picker, select, ask });
    this.rows = new Map();
    this.bodies = [];
    this.selected = null;
    this.way = null;
    this.buttons = [];
    find("way").addEventListener("click", () => this.ask_way());
    find("way-to").addEventListener("click", () => this.pick_way());
    find("look").addEventListener("click", () => this.look());
    find("picture-close").addEventListener("click", () => { find("picture").hidden = true; });
  }

  /** Take the team of the host's map. */
  know(bodies) {
    this.bodies = bodies;
  }

  forget() {
    this.rows.clear();
    this.way = null;
    this.find("picture").hidden = true;
  }

  /** Take the positions that the host sends. */
  take({ robots }, time_s) {
    for (const [robot, x, y, heading, task, moving, heard_s, goal] of robots) {
      if (![x, y, heading, heard_s].every(Number.isFinite)) throw new TypeError("this is no position");
      this.rows.set(robot, { x, y, heading, task, moving, heard_s, goal, time_s });
    }
  }

  /** Show the team, and which robot is selected. */
  show(size, selected, now_s, lost, host) {
    if (selected !== this.selected) {
      this.selected = selected;
      this.way = null;
      this.find("picture").hidden = true;
    }
    while (this.buttons.length < size) this.add(this.buttons.length);
    while (this.buttons.length > size) this.buttons.pop().remove();
    this.buttons.forEach((each, robot) => {
      each.setAttribute("aria-pressed", String(robot === selected));
      each.classList.toggle("lost", lost.includes(robot));
      each.title = [robot === host && "host", lost.includes(robot) && "taken for lost"].filter(Boolean).join(", ");
      each.firstChild.style.background = this.floor.colour(robot);
    });
    this.find("robot-state").replaceChildren(...this.facts(selected, now_s, lost, host));
    const body = this.bodies[selected];
    const row = this.rows.get(selected);
    this.find("way").disabled = !row?.goal;
    this.find("way-to").disabled = selected === null;
    this.find("look").disabled = selected === null || body?.camera === false;
    this.find("look").title = body?.camera === false ? "it has no camera" : "";
  }

  facts(robot, now_s, lost, host) {
    if (robot === null) return [fact("", "Select a robot, here or on the floor.")];
    const row = this.rows.get(robot);
    const body = this.bodies[robot];
    const about = body ? `${body.radius_m} m, ${body.speed_mps} m/s, ${body.sensor}, ${body.camera ? "camera" : "no camera"}` : "";
    const moving = row && !lost.includes(robot) && (row.moving === null ? "not heard lately" : row.moving ? "moving" : "standing");
    const kind = [`robot ${robot}`, robot === host && "the host", lost.includes(robot) && "taken for lost", moving].filter(Boolean).join(", ");
    if (!row) return [fact("", kind), fact("body", about), fact("heard", "not yet")];
    const heard_s = row.heard_s + Math.max(0, now_s - row.time_s);
    const degrees = Math.round((row.heading * 180) / Math.PI);
    return [
      fact("", kind),
      fact("task", row.task || "none"),
      fact("place", `${row.x.toFixed(2)}, ${row.y.toFixed(2)} m, ${degrees}°`),
      fact("goal", row.goal ? `${row.goal[0].toFixed(2)}, ${row.goal[1].toFixed(2)} m` : "none"),
      fact("heard", robot === host ? "by cable" : `${seconds(heard_s)} ago`, heard_s > STALE_S),
      fact("body", about),
    ];
  }

  add(robot) {
    const made = button("", () => this.select(this.selected === robot ? null : robot), { aria: { label: `robot ${robot}`, pressed: false } });
    made.append(make("span", { className: "chip" }), ` ${robot}`);
    this.find("team").append(made);
    this.buttons.push(made);
  }

  // ------------------------------------------------------------ on demand

  async ask_way() {
    const goal = this.rows.get(this.selected)?.goal;
    if (goal) await this.show_way(this.selected, goal);
  }

  pick_way() {
    const robot = this.selected;
    const take = (_, point) => { this.show_way(robot, point); };
    this.picker.want({ title: `where robot ${robot} would go`, take, over: () => {}, typed: true });
  }

  async show_way(robot, to) {
    const said = this.find("robot-said");
    const answer = await this.ask({ say: "route", robot, to }).catch((error) => ({ say: "error", why: error.message }));
    if (answer.say !== "route") said.textContent = answer.why;
    else if (!answer.way) said.textContent = `There is no way for robot ${robot}.`;
    else {
      this.way = { robot, points: answer.way };
      said.textContent = answer.length_m === null ? "" : `The way is ${answer.length_m.toFixed(1)} m.`;
    }
    this.floor.draw();
  }

  async look() {
    const robot = this.selected;
    const said = this.find("robot-said");
    said.textContent = `Waiting for a picture of robot ${robot} …`;
    const answer = await this.ask({ say: "picture", robot }).catch((error) => ({ say: "error", why: error.message }));
    if (answer.say !== "picture") {
      said.textContent = answer.why;
      return;
    }
    said.textContent = "";
    if (robot !== this.selected) return;
    const degrees = Math.round((answer.heading_rad * 180) / Math.PI);
    const from = `${answer.at_m[0].toFixed(1)}, ${answer.at_m[1].toFixed(1)} m, looking to ${degrees}°`;
    const nearest = Math.min(...answer.columns_m.filter((each) => each !== null));
    const words = `Robot ${robot} at ${from}${Number.isFinite(nearest) ? `; nearest: ${nearest.toFixed(1)} m` : ""}`;
    this.find("picture").hidden = false;
    this.find("picture").scrollIntoView({ block: "nearest" });
    this.find("picture-text").textContent = words;
    this.find("picture-canvas").setAttribute("aria-label", words);
    paint_picture(this.find("picture-canvas"), answer.columns_m, answer.view_rad);
  }
}

function fact(name, text, bad = false) {
  return make("div", { children: [make("dt", { textContent: name }), make("dd", { textContent: text, className: bad ? "bad" : "" })] });
}

/** Draw what a camera sees: walls as columns, near ones higher and lighter; sky above and floor below. */
export function paint_picture(canvas, columns_m, view_rad) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  const sky = pen.createLinearGradient(0, 0, 0, height);
  sky.addColorStop(0, "#2a3a4a");
  sky.addColorStop(0.5, "#0d141b");
  sky.addColorStop(0.5, "#1c1813");
  sky.addColorStop(1, "#57493a");
  pen.fillStyle = sky;
  pen.fillRect(0, 0, width, height);
  const wide = width / columns_m.length;
  const focal = width / 2 / Math.tan(Math.min(view_rad, 3) / 2);
  columns_m.forEach((range_m, at) => {
    if (range_m === null) return;
    const angle = ((at + 0.5) / columns_m.length - 0.5) * view_rad;
    const deep_m = Math.max(0.05, range_m * Math.cos(angle));
    const tall = Math.min(height, (focal * 1.6) / deep_m); // walls of 1.6 m, eyes at half of that
    const light = Math.round(210 / (1 + 0.12 * deep_m * deep_m)) + 35;
    pen.fillStyle = `rgb(${light}, ${light}, ${Math.round(light * 0.94)})`;
    pen.fillRect(Math.floor(at * wide), (height - tall) / 2, Math.ceil(wide), tall);
  });
}
