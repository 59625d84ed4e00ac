// All about the box that is pinned: its fields, what it carries, and who heard it.

import { length, seconds } from "../axis.js";
import { element, table } from "../dom.js";
import { fate, sentence } from "../kinds.js";

/** Show a box, as the server tells of it, in an element; *stations*: those of the run. */
export function show_box(root, box, stations, { unpin, go }) {
  if (!box) {
    root.replaceChildren(element("p", { className: "quiet" }, "Click on a box, or find one, and it is told here."));
    return;
  }
  const duration_ns = box.end_ns - box.start_ns;
  const parts = [
    element("h3", {}, box.kind.replaceAll("_", " ")),
    element("p", {}, `${sentence(box, stations)}.`),
    element("p", { className: "tl-acts" }, button("tl-unpin", "unpin", unpin), button("tl-go-there", "go there", go)),
  ];
  if (box.receptions?.length) parts.push(heard(box.receptions, box.peer, stations));
  const fields = box.fields.filter(([name]) => name !== "body" && name !== "payload"); // which are told as bytes
  const times = [["begins", `${seconds(box.start_ns, 9)} s`], ["lasts", length(duration_ns)]];
  parts.push(table("All fields", null, [...times, ...fields.map(([name, value]) => [name, worded(value)])]));
  if (box.decoded !== null) {
    const said = typeof box.decoded === "string" ? box.decoded : JSON.stringify(box.decoded, null, 1);
    parts.push(element("h4", {}, "Decoded"), scrolled(said));
  }
  if (box.bytes) parts.push(element("h4", {}, "Bytes"), scrolled(dump(box.bytes)));
  root.replaceChildren(...parts);
}

function heard(receptions, peer, stations) {
  const number = (value, unit) => (value === null || value === undefined ? "–" : `${Number(value).toFixed(1)} ${unit}`);
  const rows = receptions.map((each) =>
    [`${stations.called(each.robot)}${peer >= 0 && each.robot !== peer ? ", by chance" : ""}`, fate(each), number(each.sinr_db, "dB"), number(each.power_dbm, "dBm")]);
  return table("Who heard it", ["robot", "outcome", "SINR", "power"], rows);
}

const worded = (value) => (value === null || value === undefined || value === "" ? "–" : String(value));

const scrolled = (text) => element("pre", { tabIndex: 0 }, text);

function button(id, text, act) {
  const made = element("button", { type: "button", id }, text);
  made.addEventListener("click", act);
  return made;
}

/** Bytes in hexadecimal as lines of 16, with their places and what letters they are. */
export function dump(hex) {
  const lines = [];
  for (let at = 0; at < hex.length; at += 32) {
    const pairs = hex.slice(at, at + 32).match(/../g) ?? [];
    const letters = pairs.map((pair) => {
      const code = Number.parseInt(pair, 16);
      return code >= 32 && code < 127 ? String.fromCharCode(code) : "·";
    });
    lines.push(`${(at / 2).toString(16).padStart(4, "0")}  ${pairs.join(" ").padEnd(47)}  ${letters.join("")}`);
  }
  return lines.join("\n");
}
