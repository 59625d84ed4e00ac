// What the chosen robot knows of the floor, or else what any robot knows: the cells of its map, asked for as it grows.

const WAIT_MS = 150;
const TEAM = -1;
const UNKNOWN = 0.16; // how dark the unknown is
const OCCUPIED = 0.8;

/** Asks for maps, and paints the one that is known. */
export class Maps {
  /**
   * @param {import("../floor.js").Floor} floor
   * @param {(message: object) => boolean} send
   */
  constructor(floor, send) {
    this.floor = floor;
    this.send = send;
    this.forget();
    floor.below.push((pen) => this.paint(pen));
  }

  /** Forget what is known: it was about another run. */
  forget() {
    this.known = this.picture = null;
    this.asked_ms = -Infinity;
    this.waits = false;
  }

  /** Ask for the map of the chosen robot, if it is wanted and not known as it is now. */
  ask() {
    if (!this.floor.visible("maps") || this.current() || this.waits) return;
    const wait_ms = this.asked_ms + WAIT_MS - performance.now();
    this.waits = true;
    setTimeout(() => {
      this.waits = false;
      this.asked_ms = performance.now();
      this.send({ say: "map", robot: this.whose });
    }, Math.max(0, wait_ms));
  }

  /** Whose map is to be shown. */
  get whose() {
    return this.floor.robot ?? TEAM;
  }

  /** Whether the map that is known is that of the present moment. */
  current() {
    const { maps } = this.floor.run.beliefs;
    if (!maps.length) return true;
    if (this.known?.robot !== this.whose) return false;
    const changes = new Map(maps);
    return this.known.maps.every(([source, count]) => changes.get(source) === count) && this.known.maps.length === this.parts(maps);
  }

  /** Of how many maps the one that is shown is made. */
  parts(maps) {
    const common = maps.some(([source]) => source === TEAM);
    if (common || this.whose !== TEAM) return maps.some(([source]) => common || source === this.whose) ? 1 : 0;
    return maps.length;
  }

  /** Take an answer; return whether the message was one. */
  take(message) {
    if (message.say !== "map") return false;
    this.known = message;
    const { rows, columns } = message;
    this.known.cells = { empty: cells_of(message.empty), occupied: cells_of(message.occupied) };
    this.picture = columns ? this.drawn(rows, columns) : null;
    this.floor.draw();
    return true;
  }

  /** What is shown: whose map, of which changes, and the numbers of its cells; null if nothing is. */
  get shown() {
    if (!this.picture || !this.floor.visible("maps") || !this.floor.run.beliefs.maps.length) return null;
    const { robot, maps, cells: { empty, occupied } } = this.known;
    return { robot, maps, empty: empty.length, occupied: occupied.length };
  }

  /** What is shown, in words: [what, of whom, words]. */
  get words() {
    if (!this.shown) return [];
    const { robot, empty, occupied } = this.shown;
    const area = (cells) => `${(cells * this.known.cell_m ** 2).toFixed(1)} m²`;
    const who = robot === TEAM ? "the team" : `robot ${robot}`;
    return [["map", who, `${area(empty)} known as empty, ${area(occupied)} as occupied`]];
  }

  /** A small canvas with a pixel a cell: the unknown is grey, what is occupied dark. */
  drawn(rows, columns) {
    const canvas = document.createElement("canvas");
    Object.assign(canvas, { width: columns, height: rows });
    const pen = canvas.getContext("2d");
    const alpha = new Uint8Array(rows * columns).fill(Math.round(255 * UNKNOWN));
    for (const cell of this.known.cells.empty) alpha[cell] = 0;
    for (const cell of this.known.cells.occupied) alpha[cell] = Math.round(255 * OCCUPIED);
    const image = pen.createImageData(columns, rows);
    alpha.forEach((value, cell) => {
      image.data[4 * ((rows - 1 - Math.floor(cell / columns)) * columns + (cell % columns)) + 3] = value;
    });
    pen.putImageData(image, 0, 0);
    pen.globalCompositeOperation = "source-in"; // in the colour that is read on this floor
    pen.fillStyle = this.ink = this.floor.colours.ink;
    pen.fillRect(0, 0, columns, rows);
    return canvas;
  }

  paint(pen) {
    const { floor, known } = this;
    if (!this.shown || known.robot !== this.whose) return;
    if (this.ink !== floor.colours.ink) this.picture = this.drawn(known.rows, known.columns);
    const [left, low] = floor.place(known.corner_m);
    const size = known.cell_m * floor.scale;
    pen.save();
    pen.translate(left, low);
    pen.rotate(-known.turn_rad);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(this.picture, 0, -known.rows * size, known.columns * size, known.rows * size);
    pen.restore();
  }
}

/** The cells of ranges as in "3-7,9". */
function cells_of(ranges = "") {
  const cells = [];
  for (const range of ranges.split(",").filter(Boolean)) {
    const [first, last = first] = range.split("-").map(Number);
    for (let cell = first; cell <= last; cell += 1) cells.push(cell);
  }
  return cells;
}
