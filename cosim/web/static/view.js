// The page that shows a run, recorded or under way: joins the connection, the floor, the lists and time.

import { Connection } from "./connection.js";
import { Floor } from "./floor.js";
import { Events, Robots, show_metrics } from "./lists.js";
import { Run } from "./run.js";
import { Transport } from "./transport.js";

const find = (id) => document.getElementById(id);
const run = new Run();
const floor = new Floor(find("floor"), run, select);
const robots = new Robots(find("robots"), floor, select);
const events = new Events(find("events"), find("filter"), floor, null);
const transport = new Transport(find("transport"), (message) => connection.send(message));
const connection = new Connection({ message: take, opened: () => trouble(""), lost });
let fault_timer = 0;
let asked = false;

find("reconnect").addEventListener("click", () => connection.connect());
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") select(null);
});
connection.connect();

function take(message) {
  if (message.say === "error") return trouble(message.why, false);
  if (message.say === "missed") return trouble(`This page was too slow: it has missed ${message.answers} answers.`, false);
  if (message.say === "ended") {
    find("result").hidden = false;
    show_metrics(find("metrics").tBodies[0], message.metrics);
  }
  if (!run.take(message, performance.now())) return;
  if (message.say === "scene") begin(message);
  else show_soon();
}

function begin(scene) {
  document.title = `${scene.name} – cosim`;
  find("name").textContent = scene.name;
  const parts = [scene.protocol, scene.channel && `over ${scene.channel}`, scene.seed !== null && `seed ${scene.seed}`];
  find("about").textContent = [...parts, scene.live ? "live" : "recorded"].filter(Boolean).join(", ");
  find("result").hidden = true;
  events.seek = scene.live ? null : (time_s) => transport.seek(time_s);
  transport.begin(scene);
  floor.fit();
  legend(scene);
}

function legend(scene) {
  const words = ["● robots", "○ goals", "– – ghosts", "□ frontiers", "× events", "— frames and links, red if not received"];
  if (scene.base_m) words.unshift("▲ base");
  find("legend").replaceChildren(
    ...words.map((word) => Object.assign(document.createElement("li"), { textContent: word })),
  );
}

function show_soon() {
  floor.draw();
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    show();
  });
}

function show() {
  const { now } = run;
  if (!now) return;
  const state = find("state");
  const words = now.state === "failed" ? `failed: ${now.why}` : now.state;
  if (state.textContent !== words) state.textContent = words;
  state.classList.toggle("failed", now.state === "failed");
  transport.show(now);
  robots.show(now.robots, floor.selected);
  events.show(run.events, floor.selected);
  const { frames, lost, left_out } = run.counts;
  const missed = left_out ? `; ${left_out} events came too fast to be shown` : "";
  find("counts").textContent = `${frames} frames seen, ${lost} of them not received${missed}`;
  const places = now.robots.map(([x, y], robot) => `robot ${robot} at ${x.toFixed(1)}, ${y.toFixed(1)}`);
  find("floor").setAttribute("aria-label", `The floor at ${now.time_s.toFixed(1)} s: ${places.join("; ")}`);
}

function select(robot) {
  floor.selected = robot;
  show_soon();
}

/** Say what is wrong; what is about the connection stays until it is there again, all else for a while. */
function trouble(why, gone = false) {
  clearTimeout(fault_timer);
  find("trouble").hidden = !why;
  find("trouble-text").textContent = why;
  find("reconnect").hidden = !gone;
  if (why && !gone) fault_timer = setTimeout(() => trouble(""), 6000);
}

function lost(why) {
  trouble(why, true);
  find("state").textContent = "not connected";
}
