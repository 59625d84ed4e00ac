// The controls of time: play, pause, step, speed and, in a recorded run, the way back.

import { Marks } from "./marks.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100];
const SEEK_MS = 60;

/** The row of buttons below the floor, and their keys. */
export class Transport {
  /**
   * @param {HTMLElement} root an empty element
   * @param {(message: object) => boolean} send
   */
  constructor(root, send) {
    this.send = send;
    this.state = "paused";
    this.live = true;
    this.tick_s = 0.1;
    this.wanted_s = null;
    this.waiting = 0;
    this.since = null;
    this.start = button("start", "To the beginning", "Home");
    this.back = button("back", "A step back", "ArrowLeft");
    this.play = button("play", "Play", "Space");
    this.step = button("step", "A step on", "ArrowRight");
    this.unit = units();
    this.end = button("end", "To the end", "End");
    this.slider = document.createElement("input");
    Object.assign(this.slider, { type: "range", id: "scrub", min: 0, max: 1, step: "any", value: 0 });
    this.slider.setAttribute("aria-label", "Time");
    this.marks = new Marks(this.slider);
    this.clock = document.createElement("output");
    this.clock.id = "time";
    this.clock.className = "number";
    this.speeds = SPEEDS;
    this.speed = speeds();
    root.replaceChildren(this.start, this.back, this.play, this.step, this.end, this.unit, this.marks.root, this.clock, this.speed);
    this.start.addEventListener("click", () => this.seek(0));
    this.end.addEventListener("click", () => this.seek(this.duration_s));
    this.back.addEventListener("click", () => this.go(-1));
    this.step.addEventListener("click", () => this.go(1));
    this.play.addEventListener("click", () => this.toggle());
    this.speed.addEventListener("change", () => this.send({ say: "speed", speed: Number(this.speed.value) }));
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.unit.addEventListener("change", () => this.shown && this.show(this.shown));
    document.addEventListener("keydown", (event) => this.key(event));
  }

  /** Take the scene: how long the run is, and whether one can go back. */
  begin(scene) {
    this.live = scene.live;
    this.duration_s = scene.duration_s;
    this.again = Boolean(scene.again);
    this.endless = Boolean(scene.attended); // it lasts as long as its operator wants
    this.slider.hidden = this.marks.root.hidden = this.endless;
    this.slider.max = scene.duration_s;
    this.marks.begin(scene);
    const slot_us = (scene.slot_ns ?? 0) / 1000;
    const slot = [...this.unit.options].find(({ value }) => value === "slot");
    slot.hidden = slot.disabled = !scene.slot_ns;
    slot.textContent = slot_us ? `slot (${slot_us} µs)` : "slot";
    if (slot.hidden && this.unit.value === "slot") this.unit.value = "tick";
    this.slider.disabled = this.start.disabled = this.end.disabled = this.back.disabled = scene.live;
    this.start.hidden = this.end.hidden = this.back.hidden = scene.live;
  }

  /** Show where the run is. */
  show(now) {
    this.shown = now;
    if (now.state !== "busy") this.state = now.state; // else the next state follows when it is no longer busy
    const playing = this.state === "playing";
    const over = this.live && (now.state === "ended" || now.state === "failed");
    this.over = over && this.again;
    draw_sign(this.play, playing ? "pause" : this.over ? "again" : "play");
    const words = playing ? "Pause" : this.over ? "Begin anew" : "Play";
    this.play.setAttribute("aria-label", words);
    this.play.title = `${words} (Space)`;
    this.play.disabled = over && !this.again;
    this.step.disabled = over;
    if (this.wanted_s === null) this.slider.value = now.time_s;
    const text = `${now.time_s.toFixed(this.decimals())} s`;
    const whole = this.endless ? "" : ` of ${this.duration_s.toFixed(1)} s`;
    this.clock.textContent = `${text}${whole}${this.reached(now)}`;
    this.slider.setAttribute("aria-valuetext", text);
    this.offer(now.speed);
    if (document.activeElement !== this.speed) this.speed.value = String(now.speed);
  }

  /** Decimals of the time: steps that are shorter than a tick need more of them. */
  decimals() {
    return this.unit.value === "tick" ? 2 : 6;
  }

  /** Add the speed of the run to those that can be chosen: it may have begun with another one. */
  offer(speed) {
    if (this.speeds.includes(speed)) return;
    this.speeds = [...SPEEDS, speed].sort((one, other) => one - other);
    const { value } = this.speed;
    this.speed.replaceChildren(...this.speeds.map((each) => option(each)));
    this.speed.value = value;
  }

  /** Show how fast time really passes, if the computer is too slow for the chosen speed. */
  reached(now) {
    const wall_s = performance.now() / 1000;
    if (now.state !== "playing" || now.speed !== this.since?.speed || now.time_s < this.since.time_s) {
      this.since = { wall_s, time_s: now.time_s, speed: now.speed, text: "" };
    } else if (wall_s - this.since.wall_s > 1) {
      const speed = (now.time_s - this.since.time_s) / (wall_s - this.since.wall_s);
      this.since = { wall_s, time_s: now.time_s, speed: now.speed, text: "" };
      if (speed < 0.8 * now.speed) this.since.text = ` (at ${speed.toPrecision(2)} ×)`;
    }
    return this.since.text;
  }

  /** Go on by some steps of the chosen kind, or back. */
  go(count) {
    this.send({ say: "step", by: this.unit.value, count });
  }

  toggle() {
    this.send({ say: this.over ? "again" : this.state === "playing" ? "pause" : "play" });
  }

  /** Seek another time, but not more often than SEEK_MS. */
  seek(time_s) {
    if (this.live) return;
    this.wanted_s = time_s;
    if (this.waiting) return;
    const ask = () => {
      this.send({ say: "seek", time_s: this.wanted_s });
      const asked_s = this.wanted_s;
      this.waiting = setTimeout(() => {
        this.waiting = 0;
        if (this.wanted_s !== asked_s) return ask();
        this.wanted_s = null;
        if (this.shown) this.slider.value = this.shown.time_s; // which may have come meanwhile, and nothing since
        return undefined;
      }, SEEK_MS);
    };
    ask();
  }

  faster(by) {
    const at = Math.min(this.speeds.length - 1, Math.max(0, this.speeds.indexOf(Number(this.speed.value)) + by));
    this.speed.value = String(this.speeds[at]);
    this.send({ say: "speed", speed: this.speeds[at] });
  }

  key(event) {
    const field = event.target.closest?.("input, select, textarea, dialog");
    const idle = field === this.slider && event.key === " "; // which does nothing on a slider
    if (event.ctrlKey || event.altKey || event.metaKey || (field && !idle)) return;
    if (event.key === " " && event.target.closest?.("button")) return;
    const acts = {
      " ": () => this.play.click(),
      ArrowRight: () => this.step.click(),
      ArrowLeft: () => this.back.click(),
      Home: () => this.start.click(),
      End: () => this.end.click(),
      "+": () => this.faster(1),
      "-": () => this.faster(-1),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}

// The symbols of the buttons, as paths in a square of 16, since not every font has them.
const SIGNS = {
  start: "M3 3h2v10H3z M13 3v10L6 8z",
  back: "M11 3v10L4 8z M12.5 3H14v10h-1.5z",
  play: "M4 2.5v11L13 8z",
  pause: "M4 3h3v10H4z M9 3h3v10H9z",
  again: "M8 2.5a5.5 5.5 0 1 0 5.5 5.5h-2A3.5 3.5 0 1 1 8 4.5V7l4.5-3.5L8 0z",
  step: "M5 3v10l7-5z M2 3h1.5v10H2z",
  end: "M11 3h2v10h-2z M3 3v10l7-5z",
};

function draw_sign(made, name) {
  if (made.dataset.sign === name) return;
  made.dataset.sign = name;
  const space = "http://www.w3.org/2000/svg";
  const picture = document.createElementNS(space, "svg");
  const path = document.createElementNS(space, "path");
  picture.setAttribute("viewBox", "0 0 16 16");
  picture.setAttribute("aria-hidden", "true");
  path.setAttribute("d", SIGNS[name]);
  picture.append(path);
  made.replaceChildren(picture);
}

function button(name, title, key) {
  const made = document.createElement("button");
  made.type = "button";
  made.id = name;
  made.title = `${title} (${key})`;
  made.setAttribute("aria-label", title);
  made.setAttribute("aria-keyshortcuts", key);
  draw_sign(made, name);
  return made;
}

function units() {
  const made = document.createElement("select");
  made.id = "step-by";
  made.title = "What a step is";
  made.setAttribute("aria-label", "Step by");
  for (const unit of ["tick", "slot", "frame", "event"]) made.add(new Option(unit, unit));
  return made;
}

function speeds() {
  const made = document.createElement("select");
  made.id = "speed";
  made.title = "Speed (+ and −)";
  made.setAttribute("aria-label", "Speed");
  for (const speed of SPEEDS) made.add(option(speed));
  return made;
}

function option(speed) {
  return new Option(`${Number(speed.toPrecision(3))} ×`, String(speed), speed === 1, speed === 1);
}
