// The WebSocket to the server that this page came from: it reports when it is lost, and connects again by itself.

const WAIT_MS = 1000; // from a loss to the first attempt; each vain one doubles it
const LONGEST_WAIT_MS = 30000;

/** A connection that is opened again when it is lost; messages are objects with a `say`, or bytes. */
export class Connection {
  /**
   * @param {{message: (message: object) => void, bytes?: (buffer: ArrayBuffer) => void, opened: () => void, lost: (why: string) => void}} told
   *   take a message, take a binary one, note that the server talks, note that it does not, or not any more
   */
  constructor(told) {
    this.told = told;
    this.socket = null;
    this.wait_ms = WAIT_MS;
    this.attempt = 0; // timer of the next attempt
    window.addEventListener("pagehide", () => this.leave());
    window.addEventListener("pageshow", (event) => {
      if (event.persisted) this.connect(); // it is back from the browser's history: nobody there is to be told
    });
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.attempt) this.connect(false); // timers of a page out of sight are slow
    });
  }

  /** True if something that is sent now may arrive. */
  get open() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Close the connection, which is not reported, and connect no more. */
  leave() {
    clearTimeout(this.attempt);
    this.attempt = 0;
    this.socket?.close();
    this.socket = null;
  }

  /** Connect, and close an older connection, which is not reported. An attempt in vain is, if somebody asked for it. */
  connect(asked = true) {
    this.leave();
    if (asked) this.wait_ms = WAIT_MS;
    const address = new URL(`socket${location.search}`, location.href); // of a page in a frame: beside it
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    const begun_ms = performance.now();
    let talks = false;
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.addEventListener("message", (event) => {
      if (socket !== this.socket) return;
      if (!talks) this.told.opened();
      talks = true;
      if (event.data instanceof ArrayBuffer) this.told.bytes?.(event.data);
      else this.told.message(JSON.parse(event.data));
    });
    socket.addEventListener("close", (event) => {
      if (socket !== this.socket) return;
      this.socket = null;
      if (talks && performance.now() - begun_ms > LONGEST_WAIT_MS) this.wait_ms = WAIT_MS; // else it fails again and again
      this.attempt = setTimeout(() => this.connect(false), this.wait_ms);
      this.wait_ms = Math.min(2 * this.wait_ms, LONGEST_WAIT_MS);
      if (asked || talks) this.told.lost(reason(event, talks));
    });
  }

  /** Send a message; return false, and do nothing, without a connection. */
  send(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}

function reason({ code, reason }, talked) {
  if (code === 1013) return "Too many pages are open.";
  if (code === 1009) return "The server found a message too long.";
  if (code === 1012) return "The server has been ended.";
  if (!talked) return "The server does not answer, or does not want to talk to this page.";
  if (code === 1006) return "The server is gone."; // nobody has said why
  return `The server has ended the connection: ${reason || code}.`;
}
