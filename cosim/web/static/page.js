// What every page has: a run on a floor, controls of its time, and a connection that may be lost.

import { Address } from "./address.js";
import { Maps } from "./beliefs/maps.js";
import { Scans } from "./beliefs/scans.js";
import { Connection } from "./connection.js";
import { Floor } from "./floor.js";
import { Layers } from "./layers.js";
import { Ranges } from "./ranges.js";
import { Run } from "./run.js";
import { Table } from "./table.js";
import { Tools } from "./tools.js";
import { Transport } from "./transport.js";

const FAULT_MS = 8000;
const DESCRIBE_MS = 1000; // interval of the descriptions, so that a screen reader gets to their end

/** The element with an id. */
export const find = (id) => document.getElementById(id);

/** What the pages share; each takes messages, and shows more, by functions of its own. */
export class Page {
  /**
   * @param {{take: (message: object) => void, show: (now: object) => void, lost?: (why: string) => void,
   *   bytes?: (buffer: ArrayBuffer) => void}} own
   *   take a message, show the latest moment, note that the connection is lost, take a binary message
   */
  constructor({ take, show, lost = () => {}, bytes = () => {} }) {
    this.show_own = show;
    this.lost_own = lost;
    this.run = new Run();
    this.address = new Address();
    this.floor = new Floor(find("floor"), this.run, (layer) => this.layers.has(layer), (address) => this.select(address));
    this.layers = new Layers(find("legend"), this.address, () => this.show_soon());
    this.tools = new Tools(this.floor, this.address);
    this.table = new Table(this.floor);
    this.connection = new Connection({
      message: (message) => this.take(message, take),
      bytes,
      opened: () => this.trouble(""),
      lost: (why) => this.lost(why),
    });
    this.ranges = new Ranges(this.floor, (message) => this.connection.send(message));
    this.scans = new Scans(this.floor, (message) => this.connection.send(message));
    this.maps = new Maps(this.floor, (message) => this.connection.send(message));
    this.asking = [this.ranges, this.maps, this.scans]; // what the server computes when it is asked for
    this.transport = new Transport(find("transport"), (message) => this.connection.send(message));
    this.fault_timer = 0;
    this.asked = false;
    this.described_ms = -Infinity;
    this.describing = 0;
    this.legend = []; // what else the page draws, in words
    this.sought = false; // whether it has gone to the time in its address
    globalThis.cosim = Object.freeze({ seen: () => this.seen() }); // for tests, and who is curious: it changes nothing
    find("reconnect").addEventListener("click", () => this.connection.connect());
  }

  /** Take a message, or pass it on to what this page has of its own. */
  take(message, own) {
    if (message.say === "again") this.connection.connect(); // another run has begun
    else if (!this.asking.some((each) => each.take(message))) own(message);
  }

  /** Take the scene: the connection is new, and perhaps the run. */
  begin(scene, about, legend = []) {
    find("name").textContent = scene.name;
    find("about").textContent = about.filter(Boolean).join(", ");
    this.transport.begin(scene);
    this.legend = legend;
    for (const each of this.asking) each.forget();
    const robot = this.address.number("robot");
    const there = robot !== null && (scene.radii_m[robot] !== undefined || this.run.stations.has(robot));
    this.floor.selected = there ? robot : null;
    this.tools.restore();
    this.floor.resize();
    this.seek_kept(scene);
    this.show_soon();
  }

  /** Go to the time that the address names, and stay there, in a recorded run. */
  seek_kept(scene) {
    const time_s = this.address.number("t");
    if (this.sought || scene.live || time_s === null) return;
    this.sought = true;
    this.connection.send({ say: "pause" });
    this.transport.seek(time_s);
  }

  /** Show everything again when the browser draws next. */
  show_soon() {
    this.floor.draw();
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.run.now) this.show(this.run.now);
    });
  }

  show(now) {
    if (this.connection.open) this.show_state(now); // else the last known state stays
    this.transport.show(now);
    this.layers.show(this.run, this.legend);
    this.keep_time(now);
    for (const each of this.asking) each.ask();
    this.show_own(now);
    if (this.describing) return;
    const wait_ms = Math.max(0, this.described_ms + DESCRIBE_MS - performance.now());
    this.describing = setTimeout(() => this.describe(), wait_ms);
  }

  /** Keep the time in the address while it stands still: who comes back comes to that moment. */
  keep_time({ state, time_s }) {
    if (this.run.scene.live) return;
    if (state === "playing") this.address.put("t", null);
    else if (state === "paused" || state === "ended") this.address.put("t", Number(time_s.toFixed(9)));
  }

  /** What the floor shows at the present time: frames as rows, links, the number of frames up to now, beliefs. */
  seen() {
    const { frames, links } = this.floor.painted;
    const { ways, estimates } = this.run.beliefs;
    const beliefs = { ways, estimates, map: this.maps.shown, scan: this.scans.shown };
    return structuredClone({ time_s: this.run.now?.time_s, frames, links, counts: this.run.counts, beliefs });
  }

  /** Describe what the floor shows, for screen readers. */
  describe() {
    this.describing = 0;
    this.described_ms = performance.now();
    const { now, places, stations } = this.run;
    if (!now) return;
    const told = places.map(([x, y], address) => `${stations.called(address)} at ${x.toFixed(1)}, ${y.toFixed(1)}`);
    find("floor").setAttribute("aria-label", `The floor at ${now.time_s.toFixed(1)} s: ${told.join("; ")}`);
    this.table.show(this.run, [this.maps, this.scans]);
  }

  show_state({ state, why }) {
    const pill = find("state");
    const words = state === "failed" ? `failed: ${why}` : state;
    pill.title = state === "busy" ? "The simulation computes, and the first time it compiles its kernels: wait for it." : "";
    if (pill.textContent !== words) pill.textContent = words;
    pill.classList.toggle("failed", state === "failed");
  }

  /** Select a robot, or a station, by its address; null: none. */
  select(address) {
    this.floor.selected = address;
    this.address.put("robot", address);
    this.show_soon();
  }

  /** Show what is wrong: a lost connection until it is there again, all else for a while. */
  trouble(why, gone = false) {
    const { open } = this.connection;
    clearTimeout(this.fault_timer);
    find("trouble").hidden = !why;
    find("trouble-text").textContent = why;
    find("reconnect").hidden = !gone && open;
    if (why && !gone && open) this.fault_timer = setTimeout(() => this.trouble(""), FAULT_MS);
  }

  lost(why) {
    this.trouble(why, true);
    this.show_state({ state: "not connected" });
    this.lost_own(why);
  }
}
