// What of the page's state is in its address, after the #, so that a link shows the same: names and values.

const WAIT_MS = 250; // browsers refuse to change the address too often

const pending = new Map();
let timer = 0;

/** The value of a name in the address; null if it is not there. */
export function read(name) {
  return new URLSearchParams(location.hash.slice(1)).get(name);
}

/** Change values in the address, soon; null takes a name out. Names that are not named stay as they are. */
export function write(changes) {
  for (const [name, value] of Object.entries(changes)) {
    const text = value === null || value === undefined ? null : String(value);
    if (read(name) === text) pending.delete(name);
    else pending.set(name, text);
  }
  if (!pending.size) return;
  timer ||= setTimeout(put, WAIT_MS);
}

function put() {
  timer = 0;
  const values = new URLSearchParams(location.hash.slice(1));
  for (const [name, value] of pending) {
    if (value === null) values.delete(name);
    else values.set(name, value);
  }
  pending.clear();
  const hash = values.toString().replaceAll("%2C", ",");
  history.replaceState(null, "", `${location.pathname}${location.search}${hash ? `#${hash}` : ""}`);
}

/** The same for a part of the page that keeps several values. */
export class Address {
  /** The value of a name, or null. */
  get(name) {
    return read(name);
  }

  /** The value of a name as a number, or null if it is none. */
  number(name) {
    const value = Number(read(name) || NaN);
    return Number.isFinite(value) ? value : null;
  }

  /** Keep a value; null: none. */
  put(name, value) {
    write({ [name]: value });
  }
}
