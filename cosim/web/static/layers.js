// What the floor shows of a run, as layers that can be switched off; the legend names those that this run has.

const ALL = ["trails", "links", "frames", "ranges", "routes", "marks", "jammers", "names", "maps", "scans", "ways", "estimates"];
const ON_REQUEST = new Set(["ranges", "scans"]); // computed for the chosen robot
const AT_FIRST = new Set(ALL.filter((layer) => !ON_REQUEST.has(layer)));
const MARKS = { goal: "○ goals", ghost: "◌ ghosts", frontier: "□ frontiers", mark: "× events" };

/** The layers of a floor, which are on or off, and the legend with a button for each. */
export class Layers {
  /**
   * @param {HTMLElement} legend an empty list
   * @param {import("./address.js").Address} address keeps which are on
   * @param {() => void} changed
   */
  constructor(legend, address, changed) {
    this.legend = legend;
    this.address = address;
    this.changed = changed;
    this.words = [];
    this.shown = "";
    const kept = address.get("layers");
    this.on = kept === null ? new Set(AT_FIRST) : new Set(kept.split(",").filter((layer) => ALL.includes(layer)));
  }

  /** Whether a layer is on. */
  has(layer) {
    return this.on.has(layer);
  }

  /** Switch a layer on or off. */
  set(layer, on) {
    if (on) this.on.add(layer);
    else this.on.delete(layer);
    const usual = this.on.size === AT_FIRST.size && [...AT_FIRST].every((each) => this.on.has(each));
    this.address.put("layers", usual ? null : ALL.filter((each) => this.on.has(each)).join(","));
    this.shown = "";
    this.changed();
  }

  /** Show the legend of what *run* has; *extra*: words for what else the page draws. */
  show(run, extra = []) {
    const entries = entries_of(run, extra);
    const key = JSON.stringify(entries);
    if (key === this.shown) return;
    const focused = document.activeElement?.dataset.layer;
    this.shown = key;
    this.legend.replaceChildren(...entries.map((entry) => this.item(entry)));
    if (focused) this.legend.querySelector(`[data-layer="${focused}"]`)?.focus();
  }

  item([layer, text, about]) {
    const item = document.createElement("li");
    if (!layer) {
      item.textContent = text;
      return item;
    }
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: text, title: about });
    button.dataset.layer = layer;
    button.setAttribute("aria-pressed", String(this.has(layer)));
    button.addEventListener("click", () => this.set(layer, !this.has(layer)));
    item.append(button);
    return item;
  }
}

/** Entries of the legend: [layer or "", words, more words]. */
function entries_of({ scene, had }, extra) {
  const marks = Object.entries(MARKS).filter(([kind]) => had.has(kind)).map(([, words]) => words);
  const frames = had.has("lost") ? "— frames, red if not received" : "— frames";
  const faults = [had.has("jammer") && "✸ jammers", had.has("wall") && "▒ walls of loss"].filter(Boolean);
  return [
    scene.base_m && ["", "▲ base"],
    ["", had.has("down") ? "● robots, empty if dead" : "● robots"],
    scene.stations?.length && ["", "■ stations"],
    ...extra.map((words) => ["", words]),
    ["names", "A names", "names of robots and places"],
    ["trails", "⌇ trails", "where robots have been"],
    had.has("links") && ["links", "━ links", "links as long as they last, in the colour of the piconet's master"],
    had.has("frames") && ["frames", frames, "frames in the air, and for a while those that were"],
    had.has("route") && ["routes", "⇢ routes", "routes of the chosen robot"],
    marks.length && ["marks", marks.join(" "), "places that events name"],
    faults.length && ["jammers", faults.join(" "), "what faults have put on the floor"],
    scene.radios?.length && ["ranges", "◍ range", "how far the chosen robot is heard, and what walls cost"],
    had.has("maps") && ["maps", "▦ map", "what the chosen robot knows of the floor, or else what any robot knows"],
    scene.scanner && ["scans", "✳ scan", "what the chosen robot's range scanner reads"],
    had.has("ways") && ["ways", "⤳ ways, ⚑ goals", "paths that robots follow, and where they want to get to"],
    had.has("estimates") && ["estimates", "◌ estimates", "where robots take themselves to be, with ellipses that hold 95 %"],
  ].filter(Boolean);
}
