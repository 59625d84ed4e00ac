// Hatches, so that colour is not all that tells.

const TILE_PX = 6;
const made = new Map();

/** A pattern of slanting lines of a colour. */
export function hatched(pen, colour, width = 1.4) {
  const key = `${colour} ${width}`;
  if (!made.has(key)) made.set(key, pattern(pen, colour, width));
  return made.get(key);
}

function pattern(pen, colour, width) {
  const tile = new OffscreenCanvas(TILE_PX, TILE_PX);
  const lines = tile.getContext("2d");
  lines.strokeStyle = colour;
  lines.lineWidth = width;
  for (const shift of [-TILE_PX, 0, TILE_PX]) {
    lines.moveTo(shift, TILE_PX);
    lines.lineTo(shift + TILE_PX, 0);
  }
  lines.stroke();
  return pen.createPattern(tile, "repeat");
}
