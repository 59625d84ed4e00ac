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
  for (const [name, value] of Object.entries(changes)) pending.set(name, value);
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
  const hash = values.toString();
  history.replaceState(null, "", `${location.pathname}${location.search}${hash ? `#${hash}` : ""}`);
}
