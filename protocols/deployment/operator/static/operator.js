// What is sent to and from the console of the host robot: requests with numbers, answers to them, and status messages.
//
// The messages are those of console.py and messages.py, one folder above.

const PATIENCE_MS = 4000;
const PATIENCE_S = 1; // of the run: while it hardly advances, a late answer means a busy computer
const PATIENCE_STEPS = 5; // messages of the run in which time advances: it takes a request some of them late, and simulates in large steps
const PROBE_MS = 1500;
const OF_THE_HOST = new Set(["call", "execute", "switch", "terminate", "plays", "map", "route", "picture"]);
const OVER_THE_AIR = new Set(["picture"]); // answered when that robot has answered by radio, or is given up

/** Asks the host, looks for its successor when it falls silent, and passes on answers to other pages. */
export class Operator {
  /**
   * @param {(message: object) => boolean} send to the server
   * @param {{heard: (message: object, robot: number, mine: boolean) => void, host: (robot: number, why: string) => void}} told
   */
  constructor(send, told) {
    this.send = send;
    this.told = told;
    this.waiting = new Map();
    this.begin({ page: 0, radii_m: [] });
    setInterval(() => this.look(performance.now()), 500);
  }

  /** Forget everything, since this is another run, or the connection is new. */
  begin(scene) {
    this.lost("the connection was lost");
    this.first = scene.page * 2 ** 32; // no other page has these numbers: all pages receive all answers
    this.next = this.first;
    this.size = scene.radii_m.length;
    this.host = 0;
    this.silent = false;
    this.answered = false;
    this.probed = { since_ms: -Infinity, since_s: -Infinity, steps: Infinity };
    this.time_s = 0;
    this.playing = false;
    this.down = new Set();
  }

  /** Reject all requests that wait, for the reason *why*: they will not be answered any more. */
  lost(why) {
    for (const each of this.waiting.values()) each.reject(new Error(why));
    this.waiting.clear();
  }

  /** Reject the request, if it is one, that the server has not passed on. */
  refuse({ data, why }) {
    this.waiting.get(data?.request)?.reject(new Error(why));
    this.waiting.delete(data?.request);
  }

  /** Note the state of the run: robots answer only while time passes, and only if they are not down. */
  moment(now) {
    if (now.time_s > this.time_s) for (const asked of [...this.waiting.values(), this.probed]) asked.steps += 1;
    this.time_s = now.time_s;
    const playing = now.state === "playing" || now.state === "busy";
    if (playing && !this.playing) for (const asked of this.waiting.values()) Object.assign(asked, this.moments());
    this.playing = playing;
    this.down = new Set(now.robots.flatMap((robot, number) => (robot[3] ? [number] : [])));
  }

  /** Ask the host something; the promise is of its answer. An answer `error` or `refusal` is an answer too. */
  ask(request) {
    return new Promise((resolve, reject) => {
      const number = this.next;
      this.next += 1;
      const data = { request: number, ...request };
      this.waiting.set(number, { data, robot: this.host, ...this.moments(), resolve, reject });
      if (!this.say(this.host, data)) {
        this.waiting.delete(number);
        reject(new Error("the server is gone"));
      }
    });
  }

  /** Send something to a robot. */
  say(robot, data) {
    return this.send({ say: "operator", robot, data });
  }

  /** Take what a robot sends to its operator. */
  take({ robot, data }) {
    if (data === null || typeof data !== "object") return;
    this.answered = true;
    const { answer } = data;
    const asked = this.waiting.get(answer);
    if (data.say === "state") this.stands(robot, data, answer);
    if (!asked) {
      this.told.heard(data, robot, false);
      return;
    }
    if (data.say === "error" && Number.isInteger(data.host) && data.host !== robot && data.host < this.size) {
      this.follow(data.host, data.why);
      this.again(answer, asked);
      return;
    }
    this.waiting.delete(answer);
    this.told.heard(data, robot, true);
    asked.resolve(data);
  }

  /** Take the answer to a probe, which names the host; what that robot was asked before and has not answered is lost. */
  stands(robot, { host }, answer) {
    if (!(answer >= this.first && answer < this.next)) return;
    if (host === robot && (this.silent || robot !== this.host)) {
      this.follow(robot, robot === this.host ? "" : `robot ${robot} is host now`);
    }
    for (const [number, asked] of this.waiting) {
      if (number >= answer || asked.robot === robot && OVER_THE_AIR.has(asked.data.say)) continue;
      if (asked.robot === robot) {
        this.waiting.delete(number);
        asked.reject(new Error(`robot ${robot} has not answered: ask again`));
      } else if (host === robot && OF_THE_HOST.has(asked.data.say)) {
        this.again(number, asked);
      }
    }
  }

  follow(robot, why) {
    this.host = robot;
    this.silent = false;
    this.told.host(robot, why);
  }

  again(number, asked) {
    Object.assign(asked, { robot: this.host, ...this.moments() });
    this.say(this.host, asked.data);
  }

  /** The time of a request: by the wall clock, by that of the run, and in messages of the run since then. */
  moments() {
    return { since_ms: performance.now(), since_s: this.time_s, steps: 0 };
  }

  /** True if a request has waited for long, by the wall clock and by that of the run. */
  late({ since_ms, since_s, steps }, wall_ms, patience_ms) {
    return wall_ms - since_ms > patience_ms && this.time_s - since_s > PATIENCE_S && steps >= PATIENCE_STEPS;
  }

  /** Look for the present host, if the one that was asked has not answered for long. */
  look(wall_ms) {
    if (!this.playing) return;
    const unheard = [...this.waiting.values()].some(
      (asked) => !OVER_THE_AIR.has(asked.data.say) && this.late(asked, wall_ms, PATIENCE_MS),
    );
    if ((unheard || this.down.has(this.host)) && !this.silent) {
      this.silent = true;
      const what = this.answered ? ", the host, does not answer: waiting for its successor" : " does not answer: it may have no console";
      this.told.host(this.host, `robot ${this.host}${what}`);
    }
    if (this.silent && this.late(this.probed, wall_ms, PROBE_MS)) this.probe();
  }

  /** Ask every robot which one is its host. */
  probe() {
    this.probed = this.moments();
    for (let robot = 0; robot < this.size; robot += 1) {
      this.say(robot, { request: this.next, say: "state" });
      this.next += 1;
    }
  }
}
