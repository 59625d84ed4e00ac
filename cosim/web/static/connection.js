// The WebSocket to the server that this page came from: it reports when it is lost, and reconnects on request.

/** A connection that can be opened again; messages are objects with a `say`, or bytes. */
export class Connection {
  /**
   * @param {{message: (message: object) => void, bytes?: (buffer: ArrayBuffer) => void, opened: () => void, lost: (why: string) => void}} told
   */
  constructor(told) {
    this.told = told;
    this.socket = null;
    window.addEventListener("pagehide", () => this.socket?.close());
  }

  /** True if something that is sent now may arrive. */
  get open() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Connect; an older connection is closed without a report. */
  connect() {
    this.socket?.close();
    const address = new URL(`socket${location.search}`, location.href); // of a page in a frame: beside it
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    let was_open = false;
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => {
      was_open = true;
      if (socket === this.socket) this.told.opened();
    });
    socket.addEventListener("message", (event) => {
      if (socket !== this.socket) return;
      if (event.data instanceof ArrayBuffer) this.told.bytes?.(event.data);
      else this.told.message(JSON.parse(event.data));
    });
    socket.addEventListener("close", (event) => {
      if (socket !== this.socket) return;
      this.socket = null;
      this.told.lost(reason(event, was_open));
    });
  }

  /** Send a message; return false, and do nothing, without a connection. */
  send(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}

function reason(event, was_open) {
  if (event.code === 1013) return "Too many pages are open.";
  if (event.code === 1009) return "The server found a message too long.";
  if (event.code === 1012) return "The server has been ended.";
  return was_open ? "The server is gone." : "The server does not answer, or does not want to talk to this page.";
}
