// Stations in the background, which are no robots: their addresses come after those of the team.

/** The stations of a run, and what everybody in it is called. */
export class Stations {
  /** @param {{radii_m?: number[], stations?: {place_m: [number, number], radio: number}[]}} scene */
  constructor({ radii_m = [], stations = [] } = {}) {
    this.robots = radii_m.length; // the first address of a station
    this.places = stations.map(({ place_m }) => place_m);
  }

  /** Whether an address is that of a station. */
  has(address) {
    return this.places[address - this.robots] !== undefined;
  }

  /** What people call who has an address: robot 2, or station 0. */
  called(address) {
    return this.has(address) ? `station ${address - this.robots}` : `robot ${address}`;
  }

  /** The same in few letters: 2, or s0. */
  short(address) {
    return this.has(address) ? `s${address - this.robots}` : String(address);
  }
}
