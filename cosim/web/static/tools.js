// Buttons on the floor for what wheel, fingers and keys do too: zoom, follow a robot; and the length of trails.

import { KEY_ZOOM } from "./lens.js";

const TRAILS = [[10, "10 s"], [30, "30 s"], [120, "2 min"], [600, "10 min"], [Infinity, "all"]];
const USUAL_S = 120;

/** The buttons in a corner of a floor; what they change is kept in the address. */
export class Tools {
  /**
   * @param {import("./floor.js").Floor} floor
   * @param {import("./address.js").Address} address
   */
  constructor(floor, address) {
    this.floor = floor;
    this.address = address;
    this.follow = button("follow", "Follow", "Keep the chosen robot in the middle (f)", () => floor.lens.follow(!floor.lens.following));
    const zooms = [
      button("zoom-in", "+", "Magnify (PageUp)", () => floor.lens.magnify_middle(KEY_ZOOM)),
      button("zoom-out", "−", "Show more (PageDown)", () => floor.lens.magnify_middle(1 / KEY_ZOOM)),
      button("zoom-all", "Fit", "Show all (0)", () => floor.lens.fit()),
    ];
    this.trails = document.createElement("select");
    Object.assign(this.trails, { id: "trail", title: "Length of trails" });
    this.trails.setAttribute("aria-label", "Length of trails");
    for (const [span_s, words] of TRAILS) this.trails.add(new Option(words, String(span_s)));
    this.trails.addEventListener("change", () => this.choose(Number(this.trails.value)));
    const root = document.createElement("div");
    root.className = "tools";
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", "View of the floor");
    root.append(...zooms, this.follow, this.trails);
    floor.canvas.after(root);
    floor.lens.moved = () => this.moved();
    this.restored = false;
  }

  choose(span_s) {
    this.floor.trail_s = span_s;
    this.trails.value = String(span_s);
    this.address.put("trail", span_s === USUAL_S ? null : span_s);
    this.floor.draw();
  }

  /** Show what the address says; once, as from then on it says what is shown. */
  restore() {
    if (this.restored) return;
    this.restored = true;
    const { lens } = this.floor;
    const [x, y] = (this.address.get("at") ?? "").split(",").map(Number);
    const span = this.address.get("trail");
    this.choose(TRAILS.some(([span_s]) => String(span_s) === span) ? Number(span) : USUAL_S);
    lens.zoom = lens.bounded(this.address.number("zoom") ?? 1);
    lens.centre = lens.zoom > 1 && Number.isFinite(x) && Number.isFinite(y) ? this.floor.on_floor([x, y]) : null;
    lens.following = this.address.get("follow") === "1";
    lens.show();
  }

  /** Keep in the address, and show, what the lens has come to. */
  moved() {
    const { zoom, centre, following } = this.floor.lens;
    this.address.put("zoom", zoom === 1 ? null : Number(zoom.toFixed(3)));
    this.address.put("at", zoom > 1 && centre && !following ? centre.map((each) => Number(each.toFixed(2))).join(",") : null);
    this.address.put("follow", following ? 1 : null);
    this.follow.setAttribute("aria-pressed", String(following));
  }
}

function button(id, words, title, act) {
  const made = document.createElement("button");
  Object.assign(made, { type: "button", id, textContent: words, title });
  if (words.length < 2) made.setAttribute("aria-label", title.replace(/ \(.*/, ""));
  made.addEventListener("click", act);
  return made;
}
