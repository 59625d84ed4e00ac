// Where lanes stand: rows one below the other, in groups of a robot's radio, or one for each RF channel.

import { Stations } from "../stations.js";

const HEIGHTS_PX = { states: 14, busy: 9, NAV: 9, sent: 17, received: 17, broadcasts: 14, messages: 11, wakes: 11, events: 11, piconet: 13 };
const FURTHER_PX = 12; // of a lane that holds what overlaps the boxes of another one
const GAP_PX = 6;
const LEAST_GROUP_PX = 26;
export const CHANNELS = 79;
const LEAST_CHANNEL_PX = 2;

/** The rows of the lanes that are shown. */
export class Rows {
  constructor() {
    this.stations = new Stations(); // of the run
    this.lanes = [];
    this.piconets = true; // whether the strips of piconets are shown
    this.lay(false, 0);
  }

  /** Lay out the lanes: by channel, or by robot and radio; *height_px* is what there is room for. */
  lay(by_channel, height_px) {
    this.by_channel = by_channel;
    this.groups = [];
    this.rows = [];
    if (by_channel) this.lay_channels(height_px);
    else this.lay_radios();
    this.by_lane = new Map(this.rows.map((row) => [row.lane.lane, row]));
  }

  lay_radios() {
    let y = GAP_PX / 2;
    let group = null;
    for (const lane of this.lanes) {
      const strip = lane.what === "piconet";
      if (lane.what === "channel" || (strip && !this.piconets)) continue;
      if (!group || group.robot !== lane.robot || group.radio !== lane.radio || group.strip !== strip) {
        if (group) y = this.end(group, y);
        group = { robot: lane.robot, radio: lane.radio, strip, y, rows: [] };
        this.groups.push(group);
      }
      const height = lane.stacked && !strip ? FURTHER_PX : (HEIGHTS_PX[lane.what] ?? FURTHER_PX);
      const row = { lane, y, height, group };
      group.rows.push(row);
      this.rows.push(row);
      y += height;
    }
    this.height = group ? this.end(group, y) : 0;
    const radios = new Set(this.groups.filter(({ radio }) => radio >= 0).map(({ radio }) => radio)).size;
    for (const each of this.groups) each.name = named(each, radios, this.stations);
  }

  end(group, y) {
    group.height = Math.max(LEAST_GROUP_PX, y - group.y);
    return group.y + group.height + GAP_PX;
  }

  /** A row for each channel, the highest on top; one that is wider than the others reaches over theirs. */
  lay_channels(height_px) {
    const lanes = this.lanes.filter(({ what }) => what === "channel");
    const size = Math.max(LEAST_CHANNEL_PX, height_px / CHANNELS);
    const group = { robot: null, radio: null, name: "RF channel", y: 0, height: size * CHANNELS, rows: [] };
    for (const lane of [...lanes].sort((one, other) => (other.width ?? 1) - (one.width ?? 1))) {
      const width = lane.width ?? 1;
      const y = (CHANNELS - 1 - lane.channel - (width - 1) / 2) * size;
      group.rows.push({ lane, y, height: width * size, group });
    }
    this.rows = group.rows;
    this.groups = [group];
    this.channel_px = size;
    this.height = group.height;
  }

  /** The row that a box is in; of a frame that is pinned in the other view, that of its channel or of its sender. */
  of(box) {
    const own = this.by_lane.get(box.lane);
    if (own || !box.detail) return own;
    const { channel, source } = box.detail;
    const fits = ({ lane }) => (this.by_channel ? lane.channel === channel : lane.what === "sent" && lane.robot === source);
    return this.rows.find(fits);
  }

  /** Whether there are piconets. */
  get has_piconets() {
    return this.lanes.some(({ what }) => what === "piconet");
  }

  /** Whether there are channels to be seen. */
  get has_channels() {
    return this.lanes.some(({ what }) => what === "channel");
  }

  /** The rows that are at least partly between two heights. */
  between(top, bottom) {
    return this.rows.filter(({ y, height }) => y + height >= top && y <= bottom);
  }

  /** The row at a height; the narrowest, if several are there. */
  at(y) {
    const there = this.rows.filter((row) => y >= row.y && y < row.y + row.height);
    return there.reduce((best, row) => (best && best.height <= row.height ? best : row), null);
  }
}

/** The robot that the boxes of a lane are about. */
export const owner = ({ what, robot, stacked }) => (what === "piconet" ? stacked : robot);

function named({ robot, radio, strip }, radios, stations) {
  if (strip) return `piconet of ${stations.short(robot)}`;
  const who = robot >= 0 ? stations.called(robot) : "jammers";
  if (radio === -1 && robot >= 0) return `${who} host`;
  return radios > 1 && !stations.has(robot) ? `${who} radio ${radio}` : who;
}
