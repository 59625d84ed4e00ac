// What robots and their radios are doing: the intervals that the present time is in, as links, routes, faults.

const STATES_OF_LINKS = new Set(["master", "slave", "peer", "link"]);
const MODES = new Set(["hold", "sniff", "park"]);
const UNSAID = new Set([...STATES_OF_LINKS, ...MODES, "route", "killed"]); // the floor shows these otherwise

/** The intervals of a message, by what they mean. */
export class Doing {
  /** @param {[string, number, number, number, string][]} rows of state, robot, radio, since when, detail */
  constructor(rows = []) {
    this.intervals = rows.map(([state, robot, radio, since_s, detail]) =>
      ({ state, robot, radio, since_s, detail, words: words_of(detail) }));
    this.links = links_of(this.intervals);
  }

  /** Those in one of some states. */
  in(...states) {
    return this.intervals.filter(({ state }) => states.includes(state));
  }

  /** What a robot is doing besides having links, in words. */
  of(robot) {
    const states = this.intervals.filter((each) => each.robot === robot && !UNSAID.has(each.state));
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
  for (const { state, robot, radio, words } of intervals) {
    if (!STATES_OF_LINKS.has(state)) continue;
    const peer = Number(words.slave ?? words.master ?? words.peer);
    const role = state === "link" ? words.role : state;
    const [master, slave] = role === "slave" || (role === "peer" && peer < robot) ? [peer, robot] : [robot, peer];
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
