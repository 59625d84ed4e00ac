// The page that commands a team as in a playbook: call a play, tailor it, execute it, watch it.

import { Page, find } from "/static/page.js";
import { Operator } from "./operator.js";
import { Board } from "./board.js";
import { Calling } from "./calling.js";
import { Played } from "./played.js";
import { paint_places, paint_way } from "./drawing.js";
import { Picker } from "./places.js";
import { RobotPart } from "./robot.js";

const page = new Page({ take, show, lost: (why) => operator.lost(why) });
const { run, floor } = page;
const trouble = (why) => page.trouble(why);
const picker = new Picker(floor, find("hint"));
const operator = new Operator((message) => page.connection.send(message), { heard, host });
const played = new Played(ask_state);
const ask = (request) => operator.ask(request);
const board = new Board(find, played, { ask, trouble });
const calling = new Calling(find, { picker, ask, executed: () => board.show_tab("played"), tailored: () => board.show_tab("tailored"), trouble, changed: () => floor.draw() });
const robots = new RobotPart(find, { floor, picker, select: (robot) => page.select(robot), ask });
let host_timer = 0;
let host_robot = 0;
let asking = false;
let lost_robots = [];
let operator_time_s = 0; // of the message that is being taken

floor.extras.push((pen) => paint_places(pen, floor, { chosen: calling.points(), current: played.current }));
floor.extras.push((pen) => paint_way(pen, floor, robots.way));
const all_marks = run.seen_marks.bind(run);
run.seen_marks = () => all_marks().filter(({ kind, name }) => kind !== "mark" || name === "PictureTaken"); // the tree of tasks shows where tasks began
page.connection.connect();

function take(message) {
  if (message.say === "error") {
    operator.refuse(message);
    return trouble(message.why);
  }
  if (message.say === "missed") return ask_state();
  if (message.say === "operator") {
    operator_time_s = message.time_s;
    try {
      operator.take(message);
    } catch (error) {
      if (!(error instanceof TypeError)) throw error; // it lacks what this page looks for: another protocol's console?
      trouble(`what robot ${message.robot} has said is not understood`);
    }
    return page.show_soon();
  }
  if (!run.take(message)) return undefined;
  if (message.say === "scene") begin(message);
  else {
    operator.moment(message);
    page.show_soon();
  }
  return undefined;
}

function begin(scene) {
  document.title = `${scene.name} – playbook`;
  operator.begin(scene);
  played.forget();
  robots.forget();
  lost_robots = [];
  host_robot = 0;
  host(0, "");
  page.begin(scene, [`channel: ${scene.channel}`, scene.seed !== null && `seed ${scene.seed}`], ["◎ where they end up"]);
  operator.ask({ say: "plays" }).then(({ tree }) => calling.know_plays(tree ?? []), () => {});
  operator.ask({ say: "map" }).then((map) => know(scene, map), () => {});
  ask_state();
}

function know(scene, map) {
  if (map.say !== "map") return trouble(map.why);
  if (!scene.base_m && map.base) scene.base_m = map.base;
  const named = { ...(map.base ? { base: [map.base] } : {}), ...map.places };
  board.tasks.named = named;
  calling.know_floor(named, scene.radii_m.length);
  robots.know([...map.robots].sort((one, other) => one.robot - other.robot));
  return page.show_soon();
}

/** Ask for the state of everything: messages were missed, or sent before this page was open. */
function ask_state() {
  if (asking) return;
  asking = true;
  operator.ask({ say: "state" }).catch(() => {}).finally(() => { asking = false; });
}

/** Take what a robot has sent from its console, to this page or to another. */
function heard(message, robot) {
  if (message.say === "state") lost_robots = message.lost ?? [];
  if (message.say === "positions" && robot === operator.host) robots.take(message, operator_time_s);
  if (message.say === "state" && message.host !== robot) return;
  if (played.take(message, operator_time_s) && message.say !== "task") board.begun();
}

/** Show that *robot* is the host, and *why*, for a while if it is a new one. */
function host(robot, why) {
  clearTimeout(host_timer);
  find("host").textContent = why;
  if (robot === host_robot) return;
  host_robot = robot;
  host_timer = setTimeout(() => host(robot, ""), 15000);
  ask_state();
}

function show(now) {
  const busy = now.state === "busy" ? "Waiting for the host: the first time kernels are compiled, which may take a minute …" : "Waiting for the host …";
  if (find("plays-wait").textContent !== busy) find("plays-wait").textContent = busy;
  robots.show(now.robots.length, floor.robot, now.time_s, lost_robots, operator.host);
  board.show(now.time_s);
}
