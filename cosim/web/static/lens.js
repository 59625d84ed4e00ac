// The visible part of a floor: all of it, or what the user has magnified by wheel, pinch or keys, and drags about.

const MOST_ZOOM = 40;
const DRAG_PX = 6; // a shorter movement is a click
export const KEY_ZOOM = 1.4;
const FOLLOWED_ZOOM = 3;
const KEY_PX = 60;

/** The zoom of a floor and the point in its middle, as the user chooses them. */
export class Lens {
  /**
   * @param {import("./floor.js").Floor} floor
   * @param {() => void} moved is called when the user has changed it
   */
  constructor(floor, moved = () => {}) {
    this.floor = floor;
    this.moved = moved;
    this.following = false; // the robot that is selected stays in the middle
    this.zoom = 1;
    this.centre = null; // (m); null: that of the whole floor
    this.pointers = new Map();
    this.began = null; // where the first pointer went down
    this.dragged = false;
    const { canvas } = floor;
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.fit());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => this.up(event));
    canvas.addEventListener("click", (event) => this.click(event), { capture: true }); // before all others that take clicks
  }

  /** Show the whole floor. */
  fit() {
    this.zoom = 1;
    this.centre = null;
    this.following = false;
    this.show();
  }

  /** The zoom next to another that there can be. */
  bounded(zoom) {
    return Math.min(MOST_ZOOM, Math.max(1, zoom));
  }

  /** Magnify by *factor* about the middle of what is visible. */
  magnify_middle(factor) {
    const box = this.floor.canvas.getBoundingClientRect();
    this.magnify(factor, box.left + box.width / 2, box.top + box.height / 2);
  }

  /** Keep the selected robot in the middle, or leave it; a floor that is visible as a whole is magnified for it. */
  follow(on) {
    this.following = on;
    if (on && this.zoom === 1) this.zoom = FOLLOWED_ZOOM;
    this.show();
  }

  /** Whether a robot is followed; if so, it is brought to the middle. */
  follows() {
    const place = this.following ? this.floor.run.places[this.floor.selected] : undefined;
    if (!place) return false;
    const [x, y] = place;
    if (this.centre && this.centre[0] === x && this.centre[1] === y) return false; // it is there
    this.centre = [x, y];
    return true;
  }

  /** Magnify by *factor*, and keep the point of the floor at (x, y) of the window where it is. */
  magnify(factor, clientX, clientY) {
    const [x, y] = this.floor.point({ clientX, clientY });
    const [middle_x, middle_y] = this.floor.middle();
    const zoom = this.bounded(this.zoom * factor);
    const change = this.zoom / zoom;
    this.centre = [x + (middle_x - x) * change, y + (middle_y - y) * change];
    this.zoom = zoom;
    if (zoom === 1) this.centre = null;
    this.show();
  }

  /** Move the visible part by some pixels; a floor that is visible as a whole stays. */
  pan(right, down) {
    if (this.zoom === 1) return;
    const [x, y] = this.floor.middle();
    const { scale } = this.floor;
    this.centre = this.floor.on_floor([x - right / scale, y + down / scale]);
    this.following = false;
    this.show();
  }

  show() {
    const { canvas } = this.floor;
    canvas.style.touchAction = this.zoom === 1 ? "pan-y" : "none"; // a page that is longer than the window scrolls
    canvas.classList.toggle("magnified", this.zoom > 1);
    this.floor.resize();
    this.moved();
  }

  wheel(event) {
    event.preventDefault();
    this.magnify(Math.exp(-event.deltaY / 500), event.clientX, event.clientY);
  }

  // ------------------------------------------------------------ pointers

  down(event) {
    if (event.button !== 0) return;
    if (!this.pointers.size) {
      this.began = [event.clientX, event.clientY];
      this.dragged = false;
    }
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  move(event) {
    if (!this.pointers.has(event.pointerId)) return;
    const before = [...this.pointers.values()];
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const after = [...this.pointers.values()];
    const [x, y] = midpoint(after);
    if (!this.dragged) {
      const far = Math.hypot(x - this.began[0], y - this.began[1]) > DRAG_PX;
      if (after.length === 1 && (!far || this.zoom === 1)) return;
      this.dragged = true;
      this.floor.canvas.setPointerCapture(event.pointerId);
    }
    const [before_x, before_y] = midpoint(before);
    if (after.length > 1) this.magnify(spread(after) / Math.max(1, spread(before)), before_x, before_y);
    this.pan(x - before_x, y - before_y);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
  }

  /** Keep the click that ends a drag from being one. */
  click(event) {
    if (this.dragged) event.stopImmediatePropagation();
    this.dragged = false;
  }

  // ------------------------------------------------------------ keys

  /** Take the keys that the transport does not: page up and down, arrows with shift, 0, f. */
  key(event) {
    const acts = {
      PageUp: () => this.magnify_middle(KEY_ZOOM),
      PageDown: () => this.magnify_middle(1 / KEY_ZOOM),
      "Shift ArrowLeft": () => this.pan(KEY_PX, 0),
      "Shift ArrowRight": () => this.pan(-KEY_PX, 0),
      "Shift ArrowUp": () => this.pan(0, KEY_PX),
      "Shift ArrowDown": () => this.pan(0, -KEY_PX),
      0: () => this.fit(),
      f: () => this.follow(!this.following),
    };
    const act = acts[`${event.shiftKey ? "Shift " : ""}${event.key}`];
    if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  }
}

function midpoint(points) {
  return [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
}

/** Distance between the first two of some points. */
function spread([[x, y], [other_x, other_y]]) {
  return Math.hypot(x - other_x, y - other_y);
}
