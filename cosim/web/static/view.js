// The page that shows a run, recorded or under way: joins the connection, the floor, the lists and time.

import { Events, Robots, show_metrics } from "./lists.js";
import { Page, find } from "./page.js";
import { Lights } from "./timeline/lights.js";
import { Timeline } from "./timeline/timeline.js";

const framed = window.parent !== window; // beside another run, below their time
document.documentElement.classList.toggle("framed", framed);
const page = new Page({ take, show, bytes: (buffer) => timeline.take_bytes(buffer) });
const { run, floor } = page;
const robots = new Robots(find("robots"), floor, (address) => page.select(address));
const filters = { text: find("filter"), kind: find("kind"), robot: find("of-robot") };
const { marks } = page.transport;
const events = new Events(find("events"), filters, { floor, address: page.address, marks, select: (robot) => page.select(robot) });
const lights = new Lights(floor);
const timeline = new Timeline(find("timeline"), {
  send: (message) => page.connection.send(message),
  seek: (time_s) => page.transport.seek(time_s),
  select: (robot) => page.select(robot),
  light: (robots) => lights.show(robots),
  shown: (shown) => framed && window.parent.postMessage({ say: "window", ...shown }, location.origin),
});

document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") page.select(null);
});
window.addEventListener("message", ({ source, origin, data }) => {
  if (framed && source === window.parent && origin === location.origin && data.say === "window") timeline.take_window(data);
});
page.connection.connect();

function take(message) {
  if (message.say === "error") return page.trouble(message.why);
  if (message.say === "missed") return page.trouble(`This page was too slow: it has missed ${message.answers} answers.`);
  if (message.say === "ended") {
    find("result").hidden = false;
    show_metrics(find("metrics").tBodies[0], message.metrics);
  }
  if (timeline.take(message) || !run.take(message)) return undefined;
  if (message.say === "scene") begin(message);
  else page.show_soon();
  return undefined;
}

function begin(scene) {
  document.title = `${scene.name} – cosim`;
  find("result").hidden = true;
  timeline.begin({ ...scene, beside: framed });
  events.begin(scene);
  events.seek = scene.live ? null : (time_s) => page.transport.seek(time_s);
  const about = [scene.protocol, scene.channel && `channel: ${scene.channel}`, scene.seed !== null && `seed ${scene.seed}`];
  page.begin(scene, [...about, scene.live ? "live" : "recorded"]);
}

function show(now) {
  robots.show(run, floor.selected);
  timeline.now(now.time_s, floor.selected);
  events.show(run.events, floor.robot);
  const { frames, lost, unshown, left_out } = run.counts;
  const words = [`${frames} frames seen, ${lost} of them not received`];
  if (unshown) words.push(`${unshown} of late are not drawn`);
  if (left_out) words.push(`${left_out} events came too fast to be shown`);
  find("counts").textContent = words.join("; ");
}
