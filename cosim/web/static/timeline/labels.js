// The names of the lanes, beside them, so that they can be read, searched and chosen.

import { element } from "./dom.js";

const NAMED_CHANNELS = [0, 10, 20, 30, 40, 50, 60, 70, 78];

/** The list of names; one of them is in the tabulator's way, and arrows lead to the others. */
export class Labels {
  /** @param {import("./timeline.js").Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.root = element("ul", { className: "tl-labels", "aria-label": "Lanes" });
    this.root.addEventListener("keydown", (event) => this.key(event));
  }

  /** Show the names of the present rows. */
  show() {
    const { rows } = this.timeline;
    const held = this.root.contains(document.activeElement);
    this.root.style.height = `${rows.height}px`;
    this.root.replaceChildren(...(rows.by_channel ? this.channels() : rows.groups.map((group) => this.label(group))));
    if (held) this.root.querySelector("[tabindex='0']")?.focus();
  }

  label(group) {
    const { row, selected } = this.timeline;
    const own = group === row?.group;
    const button = element("button", { type: "button", tabIndex: own ? 0 : -1 }, group.name);
    button.setAttribute("aria-pressed", String(group.robot >= 0 && group.robot === selected));
    button.addEventListener("click", () => this.take(group));
    const item = element("li", own ? { className: "own" } : {}, button);
    item.style.top = `${group.y}px`;
    item.style.height = `${group.height}px`;
    return item;
  }

  /** Have keys be about a lane of a group, and select its robot, or no longer. */
  take(group) {
    const { page, selected } = this.timeline;
    this.timeline.choose(first(group));
    if (group.robot >= 0) page.select(group.robot === selected ? null : group.robot);
  }

  channels() {
    const { channel_px } = this.timeline.rows;
    return NAMED_CHANNELS.map((channel) => {
      const item = element("li", { className: "channel" }, `${channel}: ${2402 + channel} MHz`);
      item.style.top = `${(78.5 - channel) * channel_px - 7}px`;
      return item;
    });
  }

  key(event) {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const { groups, by_channel } = this.timeline.rows;
    if (!by || by_channel) return;
    event.preventDefault();
    event.stopPropagation();
    const at = groups.indexOf(this.timeline.row?.group) + by;
    this.timeline.choose(first(groups[Math.min(groups.length - 1, Math.max(0, at))]));
  }
}

/** The lane of a group that keys are about at first. */
const first = ({ rows }) => rows.find(({ lane }) => lane.what === "sent") ?? rows[0];
