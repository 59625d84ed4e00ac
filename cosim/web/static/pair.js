// The page that has recorded runs side by side: the page of each in a frame, and one clock, which the server keeps for all.

import { Address } from "./address.js";
import { Connection } from "./connection.js";
import { Transport } from "./transport.js";

const FAULT_MS = 8000;

const find = (id) => document.getElementById(id);
const address = new Address();
const connection = new Connection({ message: take, opened: () => trouble(""), lost: (why) => trouble(why, true) });
const transport = new Transport(find("transport"), (message) => connection.send(message));
let fault_timer = 0;
let tied = true; // whether timelines are zoomed and moved together
let sought = false; // whether the page has gone to the time in its address

find("reconnect").addEventListener("click", () => {
  connection.connect();
  for (const frame of document.querySelectorAll("iframe")) frame.contentWindow.location.reload();
});
tie(address.get("tied") !== "no");
find("tied").addEventListener("click", () => tie(!tied));
window.addEventListener("message", ({ source, origin, data }) => {
  if (!tied || origin !== location.origin || data.say !== "window") return;
  for (const { contentWindow } of document.querySelectorAll("iframe")) {
    if (contentWindow !== source) contentWindow.postMessage(data, location.origin);
  }
});
connection.connect();

/** Have all timelines show the same part of the runs, or each its own. */
function tie(together) {
  tied = together;
  find("tied").setAttribute("aria-pressed", String(tied));
  address.put("tied", tied ? null : "no");
}

function take(message) {
  if (message.say === "scene") begin(message);
  else if (message.say === "now") show(message);
  else if (message.say === "error") trouble(message.why);
}

function begin(scene) {
  document.title = `${scene.name} – cosim`;
  find("name").textContent = scene.name;
  transport.begin(scene);
  if (!find("runs").childElementCount) find("runs").append(...scene.runs.map(run_part));
  const time_s = address.number("t");
  if (sought || time_s === null) return;
  sought = true;
  connection.send({ say: "pause" });
  transport.seek(time_s);
}

/** What shows a run: its name, and its page in a frame. */
function run_part({ folder, name, protocol, channel, seed, duration_s }, number) {
  const part = document.createElement("section");
  const title = document.createElement("h2");
  const frame = document.createElement("iframe");
  part.className = "run";
  title.id = `run-${number}`;
  part.setAttribute("aria-labelledby", title.id);
  const about = [name, protocol, channel && `channel: ${channel}`, seed !== null && `seed ${seed}`, `${duration_s.toFixed(1)} s`];
  title.textContent = `${folder}: ${about.filter(Boolean).join(", ")}`;
  frame.title = `The run ${folder}`;
  frame.src = `/runs/${number}/${location.search}`;
  part.append(title, frame);
  return part;
}

function show(now) {
  const { state, time_s } = now;
  if (find("state").textContent !== state) find("state").textContent = state;
  transport.show(now);
  address.put("t", state === "playing" ? null : Number(time_s.toFixed(9)));
}

/** Show what is wrong: a lost connection until it is there again, all else for a while. */
function trouble(why, gone = false) {
  clearTimeout(fault_timer);
  find("trouble").hidden = !why;
  find("trouble-text").textContent = why;
  find("reconnect").hidden = !gone;
  if (gone) find("state").textContent = "not connected";
  else if (why) fault_timer = setTimeout(() => trouble(""), FAULT_MS);
}
