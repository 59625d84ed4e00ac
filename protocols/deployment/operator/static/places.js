// Choosing places: by clicking on the floor, by name, or by typing coordinates.

import { button, choice, make, place_text, short } from "./parts.js";

/** Takes the clicks on the floor while a place is wanted, or what is typed instead. */
export class Picker {
  /**
   * @param {import("/static/floor.js").Floor} floor
   * @param {HTMLElement} hint describes what a click will do, and has a field for users without a mouse
   */
  constructor(floor, hint) {
    this.floor = floor;
    this.hint = hint;
    this.typed = hint.querySelector("input");
    this.wanted = null;
    this.unasked = () => false; // (place) -> whether a named place is taken that was clicked on without a request
    this.from = null; // what had focus before the field
    this.typed.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault(); // else Enter would press what has focus afterwards
      this.type();
    });
    floor.canvas.addEventListener("click", (event) => this.click(event), { capture: true });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.want(null);
    });
  }

  /**
   * Send the next clicks to *wanted*: {title, take: (place, point) => boolean (whether more are wanted; a named place is
   * given by its name), over: () => void, typed?: true if the field here is the only one, and is focused therefore}.
   */
  want(wanted) {
    const before = this.wanted;
    this.wanted = wanted;
    if (before && before !== wanted) before.over();
    if (!wanted && document.activeElement === this.typed) this.from.focus();
    this.hint.hidden = !wanted;
    this.hint.querySelector("span").textContent = wanted ? `Click on the floor: ${wanted.title}. Escape ends it.` : "";
    this.floor.canvas.classList.toggle("picking", Boolean(wanted));
    this.typed.value = "";
    this.typed.setAttribute("aria-invalid", "false");
    if (wanted) this.floor.canvas.parentElement.scrollIntoView({ block: "nearest" });
    if (wanted?.typed) this.focus();
  }

  focus() {
    if (document.activeElement !== this.typed) this.from = document.activeElement;
    this.typed.focus();
  }

  click(event) {
    const named = this.floor.named_at(event);
    if (this.wanted) {
      event.stopImmediatePropagation();
      if (named) this.give(named.place, named.point);
      else this.offer(this.floor.point(event));
    } else if (named && this.floor.address_at(event, 0) === null && this.unasked(named.place)) {
      event.stopImmediatePropagation();
    }
  }

  type() {
    const place = read(this.typed);
    if (!place) return;
    if (this.offer(place)) this.typed.value = "";
    else this.typed.setAttribute("aria-invalid", "true");
  }

  /** Take a place, if it is on the floor; return whether it is. */
  offer([x, y]) {
    const [x_min, y_min, x_max, y_max] = this.floor.bounds_m;
    if (x < x_min || x > x_max || y < y_min || y > y_max) return false;
    const point = [Number(x.toFixed(2)), Number(y.toFixed(2))];
    this.give(point, point);
    return true;
  }

  give(place, point) {
    if (!this.wanted.take(place, point)) this.want(null);
  }
}

/** A list of places that can be added to. */
export class Places {
  /**
   * @param {string} title
   * @param {{single: boolean, picker: Picker, named: Record<string, number[][]>, changed: (places: (string | number[])[]) => void}} about
   */
  constructor(title, { single, picker, named, changed }) {
    this.title = title;
    this.single = single;
    this.picker = picker;
    this.changed = changed;
    this.places = [];
    this.chips = make("span", { className: "chips" });
    this.pick = button("Pick", () => this.toggle(), {
      className: "pick",
      title: "by clicking on the floor",
      aria: { pressed: false, label: `Pick ${title} on the floor` },
    });
    this.typed = make("input", { placeholder: "x, y", size: 7, aria: { label: `${title}: coordinates in metres` } });
    this.typed.addEventListener("change", () => this.type());
    this.typed.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      this.type();
    });
    const names = choice([["", "name…"], ...namings(named, single)], "", (value) => {
      if (value) this.add(JSON.parse(value));
      names.value = "";
    }, { aria: { label: `${title}: places with names` } });
    this.element = make("div", { className: "places", children: [this.chips, this.pick, names, this.typed] });
  }

  /** Add a place; return whether more are wanted. */
  add(place) {
    if (this.single) this.places = [];
    this.places.push(place);
    this.show();
    this.changed(this.places);
    return !this.single;
  }

  /** Let clicks on the floor be places of this list, or end that. */
  toggle(on = this.pick.getAttribute("aria-pressed") !== "true") {
    if (!on) {
      this.picker.want(null);
      return;
    }
    const over = () => this.pick.setAttribute("aria-pressed", "false");
    this.picker.want({ title: this.title, take: (place) => this.add(place), over });
    this.pick.setAttribute("aria-pressed", "true");
  }

  type() {
    const place = read(this.typed);
    if (!place) return;
    this.typed.value = "";
    this.add(place);
  }

  show() {
    this.chips.replaceChildren(
      ...this.places.map((place, at) =>
        button(`${place_text(place)} ×`, () => {
          this.places.splice(at, 1);
          this.show();
          this.changed(this.places);
          this.pick.focus();
        }, { className: "chip-button", aria: { label: `${place_text(place)} ×: remove` } })),
    );
  }
}

/** The coordinates that were typed into a *field*, which reports others; null then, or if it is empty. */
function read(field) {
  const found = /^\s*(-?\d+(?:\.\d+)?)\s*[,;\s]\s*(-?\d+(?:\.\d+)?)\s*$/.exec(field.value);
  field.setAttribute("aria-invalid", String(!found && field.value.trim() !== ""));
  return found && [Number(found[1]), Number(found[2])];
}

/** The choices among the named places of the floor: their values as JSON, and their words. */
function namings(named, single) {
  return Object.entries(named).flatMap(([name, points]) => {
    const each = points.map((point, at) => [
      JSON.stringify(points.length === 1 ? name : point),
      points.length === 1 ? name : `${name} ${at + 1}: ${short(point[0])}, ${short(point[1])}`,
    ]);
    return points.length > 1 && !single ? [[JSON.stringify(name), `${name}, all ${points.length}`], ...each] : each;
  });
}

/** The points that a list of places and names stands for. */
export function points_of(places, named) {
  return places.flatMap((place) => (typeof place === "string" ? named[place] ?? [] : [place]));
}
