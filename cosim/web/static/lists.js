// Lists beside the floor: the robots, what has happened, and in the end the metrics.

const SHOWN = 150;

/** The list of robots; one of them may be selected. */
export class Robots {
  constructor(root, floor, picked) {
    this.root = root;
    this.floor = floor;
    this.picked = picked;
    this.rows = [];
  }

  show(robots, selected, doing) {
    while (this.rows.length < robots.length) this.add(this.rows.length);
    while (this.rows.length > robots.length) this.rows.pop().item.remove();
    robots.forEach(([x, y, heading, down], robot) => {
      const { button, name, where, chip, state } = this.rows[robot];
      name.textContent = `robot ${robot}${down ? " †" : ""}`;
      const degrees = Math.round((heading * 180) / Math.PI);
      where.textContent = `${x.toFixed(2)}, ${y.toFixed(2)} m  ${degrees}°`;
      chip.style.background = down ? "transparent" : this.floor.colour(robot);
      chip.style.boxShadow = down ? `inset 0 0 0 2px ${this.floor.colour(robot)}` : "";
      chip.className = `chip ${this.floor.shape(robot)}`;
      const words = standing(doing, robot);
      if (state.textContent !== words) state.textContent = words;
      button.setAttribute("aria-pressed", String(robot === selected));
    });
  }

  add(robot) {
    const item = document.createElement("li");
    const button = document.createElement("button");
    const [chip, name, where, state] = ["chip", "name", "number", "state"].map((kind) => {
      const part = document.createElement("span");
      part.className = kind;
      return part;
    });
    button.type = "button";
    button.append(chip, name, where, state);
    button.addEventListener("click", () => this.picked(button.getAttribute("aria-pressed") === "true" ? null : robot));
    item.append(button);
    this.root.append(item);
    this.rows.push({ item, button, chip, name, where, state });
  }
}

/** What a robot is doing, in words: its links, and what else its radio is at. */
export function standing(doing, robot) {
  const slaves = doing.links.filter(({ master }) => master === robot).map(({ slave }) => slave);
  const masters = doing.links.filter(({ slave }) => slave === robot).map(({ master }) => master);
  const words = [slaves.length && `master of ${slaves.join(", ")}`, masters.length && `slave of ${masters.join(", ")}`];
  return [...words, ...doing.of(robot)].filter(Boolean).join("; ");
}

/** The list of events, the newest first, filtered by a text in them. */
export class Events {
  constructor(root, filter, floor, seek) {
    this.root = root;
    this.filter = filter;
    this.floor = floor;
    this.seek = seek;
    this.key = "";
    filter.addEventListener("input", () => this.show(this.events ?? [], this.selected));
  }

  show(events, selected) {
    this.events = events;
    this.selected = selected;
    const text = this.filter.value.trim().toLowerCase();
    const last = events[events.length - 1];
    const key = `${events.length} ${events[0]?.number} ${last?.number} ${selected} ${text}`;
    if (key === this.key) return;
    this.key = key;
    const chosen = [];
    for (let at = events.length - 1; at >= 0 && chosen.length < SHOWN; at -= 1) {
      const event = events[at];
      if (selected !== null && event.robot !== selected) continue;
      const words = `${event.name} ${described(event.fields)}`;
      if (!text || words.toLowerCase().includes(text)) chosen.push(this.row(event));
    }
    this.root.replaceChildren(...chosen);
  }

  row({ time_s, robot, name, fields }) {
    const item = document.createElement("li");
    const when = document.createElement("time");
    when.textContent = `${time_s.toFixed(2)} s `;
    const chip = document.createElement("span");
    chip.className = "chip";
    if (robot >= 0) chip.style.background = this.floor.colour(robot);
    const what = document.createElement(this.seek ? "button" : "b");
    what.textContent = name;
    if (this.seek) {
      what.type = "button";
      what.title = "Go there in time";
      what.addEventListener("click", () => this.seek(time_s));
    }
    const rest = document.createElement("span");
    rest.className = "fields";
    rest.textContent = ` ${described(fields)}`;
    item.append(when, chip, ` ${robot >= 0 ? robot : ""} `, what, rest);
    return item;
  }
}

/** Put the metrics of a run that has ended into a table. */
export function show_metrics(body, metrics) {
  body.replaceChildren(
    ...metrics.map(([name, value, unit, meaning]) => {
      const row = document.createElement("tr");
      row.title = meaning;
      for (const text of [name, value === null ? "–" : String(Number(value.toPrecision(6))), unit === "1" ? "" : unit]) {
        row.insertCell().textContent = text;
      }
      return row;
    }),
  );
}

function described(fields) {
  return Object.entries(fields)
    .map(([name, value]) => `${name} ${typeof value === "number" && !Number.isInteger(value) ? value.toFixed(2) : value}`)
    .join(", ");
}
