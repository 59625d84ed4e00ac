// What robots and their radios are doing: the intervals that the present time is in, as links, routes, faults.

const MODES = new Set(["hold", "sniff", "park"]);
const UNSAID = new Set([...MODES, "route", "killed"]); // the floor shows these otherwise, and links
const INQUIRING = new Set(["inquiry", "scanning"]); // for whoever is there
const PAGING = new Set(["page", "initiating"]); // for one robot

/** The intervals of a message, by what they mean. */
export class Doing {
  /**
   * @param {[string, number, number, number, string, string, number][]} rows of state, robot, radio, since when, detail,
   *   and of links the robot's role and the robot at the other end, whatever the channel calls the state
   */
  constructor(rows = []) {
    this.intervals = rows.map(([state, robot, radio, since_s, detail, role = "", other = -1]) =>
      ({ state, robot, radio, since_s, detail, role, other, words: words_of(detail) }));
    this.links = links_of(this.intervals);
  }

  /** Those in one of some states. */
  in(...states) {
    return this.intervals.filter(({ state }) => states.includes(state));
  }

  /** Who looks for others: {state, robot, words, inquires}; *inquires*: for whoever is there, else for one robot. */
  get searches() {
    const found = this.intervals.filter(({ state }) => INQUIRING.has(state) || PAGING.has(state));
    return found.map(({ state, robot, words }) => ({ state, robot, words, inquires: INQUIRING.has(state) }));
  }

  /** What a robot is doing besides having links, in words. */
  of(robot) {
    const states = this.intervals.filter((each) => each.robot === robot && !each.role && !UNSAID.has(each.state));
    return [...new Set(states.map(({ state }) => state.replaceAll("_", " ")))];
  }

  /** The routes of a robot: {to, next, hops}. */
  routes(robot) {
    return this.in("route").filter((each) => each.robot === robot).map(({ words }) =>
      ({ to: Number(words.to), next: Number(words.next), hops: Number(words.hops) }));
  }

  /** The way of what a robot sends to another, by the routes of all: robots, as far as there is one. */
  way(robot, to) {
    const way = [robot];
    while (way.at(-1) !== to) {
      const next = this.routes(way.at(-1)).find((route) => route.to === to)?.next;
      if (next === undefined || way.includes(next)) break;
      way.push(next);
    }
    return way;
  }

  /** The masters of the piconets that a robot is in, itself included. */
  piconets(robot) {
    const own = this.links.filter(({ master, slave }) => master === robot || slave === robot);
    return [...new Set(own.map(({ master }) => master))];
  }
}

/**
 * The links, each once: {master, slave, radio, lt_addr, mode, ends}. *ends*: how many of the two know of it; one does
 * while the other has not noticed yet that it is gone, or not yet that it is there.
 */
function links_of(intervals) {
  const links = new Map();
  for (const { robot, radio, role, other, words } of intervals) {
    if (!role) continue;
    const [master, slave] = role === "slave" || (role === "peer" && other < robot) ? [other, robot] : [robot, other];
    const key = `${radio} ${master} ${slave}`;
    const known = links.get(key) ?? { master, slave, radio, lt_addr: "", mode: "", ends: 0 };
    links.set(key, { ...known, lt_addr: words.lt_addr ?? known.lt_addr, ends: known.ends + 1 });
  }
  for (const { state, robot, radio, words } of intervals) {
    if (!MODES.has(state)) continue;
    const link = links.get(words.slave === undefined ? `${radio} ${words.master} ${robot}` : `${radio} ${robot} ${words.slave}`);
    if (link) link.mode = state;
  }
  return [...links.values()];
}

function words_of(detail) {
  return Object.fromEntries(detail.split(" ").filter(Boolean).map((word) => {
    const at = word.indexOf("=");
    return at < 0 ? [word, ""] : [word.slice(0, at), word.slice(at + 1)];
  }));
}
