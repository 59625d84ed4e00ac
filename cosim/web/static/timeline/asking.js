// A question about the window, asked again whenever its answer is not known: one at a time, and soon if the run goes on.

const ANEW_MS = 500; // how often a run under way is asked for what is new
const PATIENCE_MS = 5000; // after which an answer is not waited for any more

/** What is asked of the server, and its last answer. */
export class Asking {
  /**
   * @param {import("./timeline.js").Timeline} timeline
   * @param {() => void} again asks, if what is wanted is still wanted
   */
  constructor(timeline, again) {
    this.timeline = timeline;
    this.again = again;
    this.number = 0;
    this.later = 0;
    this.forget();
  }

  /** Forget what the server has answered: the run is another one, or the connection. */
  forget() {
    this.answer = null;
    this.waiting = null;
  }

  /** Ask, unless the answer to what has this *key* is known as far as the run is, or another one is waited for. */
  want(key, question) {
    const { answer, waiting } = this;
    const { axis, page } = this.timeline;
    const now_ms = performance.now();
    if (waiting && now_ms - waiting.asked_ms < PATIENCE_MS) return;
    if (answer?.key === key) {
      if (axis.last_ns <= answer.known_ns || answer.known_ns >= axis.to_ns) return;
      if (now_ms - answer.asked_ms < ANEW_MS) {
        this.later ||= setTimeout(() => {
          this.later = 0;
          this.again();
        }, ANEW_MS);
        return;
      }
    }
    this.number += 1;
    if (page.send({ ...question, number: this.number })) this.waiting = { key, known_ns: axis.last_ns, asked_ms: now_ms };
  }

  /** Take a message; return whether it is the answer that is waited for. */
  take(message) {
    if (message.number !== this.number || !this.waiting) return false;
    this.answer = { ...message, ...this.waiting };
    this.waiting = null;
    return true;
  }
}
