// What a page shows, as kept in its address after the #: another visit, or another person, sees the same.

const WRITE_MS = 300; // browsers refuse to change an address more often than a few times a second

/** Names and values after the # of the address; each part of a page has names of its own. */
export class Address {
  constructor() {
    this.values = new Map(new URLSearchParams(location.hash.slice(1)));
    this.timer = 0;
  }

  /** The value of a name, or null. */
  get(name) {
    return this.values.get(name) ?? null;
  }

  /** The value of a name as a number, or null if it is none. */
  number(name) {
    const value = Number(this.values.get(name) || NaN);
    return Number.isFinite(value) ? value : null;
  }

  /** Keep a value; null: none. */
  put(name, value) {
    const text = value === null ? undefined : String(value);
    if (this.values.get(name) === text) return;
    if (text === undefined) this.values.delete(name);
    else this.values.set(name, text);
    this.timer ||= setTimeout(() => this.write(), WRITE_MS);
  }

  write() {
    this.timer = 0;
    const words = [...this.values].map(([name, value]) => `${name}=${encodeURIComponent(value).replaceAll("%2C", ",")}`);
    history.replaceState(null, "", words.length ? `#${words.join("&")}` : location.pathname + location.search);
  }
}
