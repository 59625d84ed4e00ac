"""Occupancy maps from files: ROS ``map_server`` YAML with its image, and MovingAI ``.map``.

A ROS image becomes an occupancy in percent as Nav2's ``map_server`` makes it (nav2_map_server, map_io). The shade of a
pixel is the mean of its colour channels over the largest value; in mode ``trinary`` an alpha channel is averaged in as
one more colour. p = 1 - shade, or the shade itself if the map is negated. Then

    trinary   100 if p > occupied_thresh, 0 if p < free_thresh (both strict), else -1: unknown
    scale     -1 if the pixel is not opaque; 100 and 0 as above, else 100 (p - free) / (occupied - free), halves to even
    raw       round(255 shade), negated or not; above 100: -1

Row 0 of the image is the top of the map; the origin is the pose (x, y, yaw) of its lower left corner. For our purpose a
cell is occupied, free or unknown. In ``trinary`` and ``scale`` 100 is occupied and 0 free; in ``raw``, which is not
thresholded, more than 100 occupied_thresh is occupied and less than 100 free_thresh free. All else is unknown.

Maps are large: what is read takes a byte or two a cell beside the file, and arithmetic on shades is done for each shade
that there can be, or tile by tile.
"""

import io
import math
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, Self, TypeAlias

import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field, field_validator, model_validator

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s
from cosim.documents import read_bytes, read_yaml, validated
from cosim.errors import UserError
from cosim.settings import Angle, Metres, Settings, error_at

Percents: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]
Samples: TypeAlias = np.ndarray[Any, np.dtype[np.uint8 | np.uint16]]

UNKNOWN: Final = -1
MOST_CELLS: Final = 100_000_000
"""Size of the largest map that is read, in cells: 10 km2 of cells of 1 m, 25 ha of cells of 5 cm."""
MOST_BYTES: Final = 6 * MOST_CELLS
"""Size of the largest file of a map: a number of five digits and a space for each cell."""
FARTHEST_M: Final = 1e6
"""Largest extent of a map."""
SMALLEST_CELL_M: Final = 1e-3
"""Size of the smallest cells."""
MOST_SIDES: Final = 1_000_000
"""Largest number of sides of all solid cells of a map: walls take more room than cells."""
LARGEST_YAW_RAD: Final = 2 * math.pi
"""Largest turn of a map; more is no angle in radians that a user means."""
_TILE: Final = 128
"""Side of the tiles of an image whose shades are computed at once, in pixels."""
_BLOCK: Final = 1 << 20
"""Number of bytes of a plain graymap that are split into words at once."""
_BAND: Final = 1 << 22
"""Number of cells whose edges are searched at once for an outline: that takes many times their memory."""
_SPACE: Final = re.compile(rb"\s")
_LINE: Final = re.compile(rb"[\r\n]")
_COMMENT: Final = re.compile(rb"#[^\r\n]*")
_HEADER: Final = re.compile(rb"(?:\s|#[^\n]*)*+([^\s#]*)")
"""The next word of the header of a graymap, past spaces and comments."""
_PASSABLE: Final = frozenset(".GS")
_BLOCKED: Final = frozenset("@OTW")
_FREE, _SOLID, _LINE_END, _STRANGE = range(4)
_CODES: Final = bytes(
    {**dict.fromkeys(_PASSABLE, _FREE), **dict.fromkeys(_BLOCKED, _SOLID), "\n": _LINE_END}.get(chr(byte), _STRANGE)
    for byte in range(256)
)
"""Meaning of each byte in the rows of a MovingAI map."""


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """Cells of *cell_m* metres, row 0 at the bottom; the lower left corner of cell (0, 0) has the pose *origin*."""

    occupied: Bools
    """Shape (ny, nx)."""
    unknown: Bools
    """Shape (ny, nx); never where a cell is occupied."""
    cell_m: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x_m, y_m, yaw_rad."""

    def solid(self, unknown_is_occupied: bool) -> Bools:
        """Return which cells, shape (ny, nx), a robot must stay out of."""
        return self.occupied | self.unknown if unknown_is_occupied else self.occupied

    def solid_at(self, points_m: Floats, unknown_is_occupied: bool) -> Bools:
        """Return at which of *points_m* (n, 2) in the world frame a robot cannot be: also off the map."""
        solid = self.look_up(self.occupied, points_m, outside=True)
        return solid | self.look_up(self.unknown, points_m, outside=True) if unknown_is_occupied else solid

    def walls_m(self, solid: Bools) -> Floats:
        """Return the outline of the cells *solid*, and of the map, as wall segments (n, 4) in the world frame.

        Raise ValueError if there are more than MOST_SIDES of them.
        """
        ends = outline(solid, MOST_SIDES).reshape(-1, 2)
        return self._to_world(ends).reshape(-1, 4)

    def bounds_m(self) -> tuple[float, float, float, float]:
        """Return the extent x_min, y_min, x_max, y_max of the (perhaps turned) map in the world frame."""
        ny, nx = self.occupied.shape
        corners = self._to_world(np.array([(0.0, 0.0), (nx, 0.0), (nx, ny), (0.0, ny)]))
        (x_min, y_min), (x_max, y_max) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return x_min, y_min, x_max, y_max

    def look_up(self, cells: Bools, points_m: Floats, outside: bool) -> Bools:
        """Return the value of *cells* (ny, nx) at *points_m* (n, 2) in the world frame, *outside* off the map."""
        x, y, yaw = self.origin
        dx, dy = points_m[:, 0] - x, points_m[:, 1] - y
        ix = np.floor((elementary.cos(yaw) * dx + elementary.sin(yaw) * dy) / self.cell_m)
        iy = np.floor((elementary.cos(yaw) * dy - elementary.sin(yaw) * dx) / self.cell_m)
        ny, nx = cells.shape
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        value = np.full(len(points_m), outside)
        value[inside] = cells[iy[inside].astype(np.intp), ix[inside].astype(np.intp)]
        return value

    def _to_world(self, corners: Floats) -> Floats:
        """Turn corners in cells, shape (n, 2), into metres in the world frame."""
        x, y, yaw = self.origin
        along, up = corners[:, 0] * self.cell_m, corners[:, 1] * self.cell_m
        cos, sin = elementary.cos(yaw), elementary.sin(yaw)
        return np.stack((x + cos * along - sin * up, y + sin * along + cos * up), axis=1)


class RosMapSettings(Settings):
    """The keys of a ``map_server`` YAML file; others are ignored, as ``map_server`` does."""

    model_config = ConfigDict(extra="ignore")

    image: str = Field(min_length=1)
    resolution: Metres = Field(gt=0)
    origin: tuple[Metres, Metres, Angle]
    occupied_thresh: float = Field(ge=0, le=1)
    free_thresh: float = Field(ge=0, le=1)
    negate: bool = False
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    @field_validator("origin")
    @classmethod
    def _within_a_turn(cls, origin: tuple[float, float, float]) -> tuple[float, float, float]:
        if abs(origin[2]) > LARGEST_YAW_RAD:
            raise ValueError(f"is turned by {origin[2]:g} rad, expected -2 pi to 2 pi")
        return origin

    @model_validator(mode="after")
    def _thresholds_in_order(self) -> Self:
        if self.free_thresh >= self.occupied_thresh:
            raise error_at(("free_thresh",), self.free_thresh, f"is not < {self.occupied_thresh}, occupied_thresh")
        return self


def read_ros_map(path: Path) -> OccupancyMap:
    """Read a ROS map from its YAML file; the image is looked for beside it. Raise UserError for what is wrong."""
    settings = validated(RosMapSettings, read_yaml(path), str(path))
    image = path.parent / settings.image
    if not os.path.isfile(image):  # Path.is_file raises for a name that is too long
        raise UserError(f"{path}: image: {settings.image[:60]!r}: there is no such file beside the map")
    percent = read_percent(image, settings)[::-1]
    _check_extent(percent.shape, settings.resolution, f"{path}: resolution")
    occupied, free = percent == 100, percent == 0
    if settings.mode == "raw":
        occupied = percent > 100 * settings.occupied_thresh
        free = (percent != UNKNOWN) & (percent < 100 * settings.free_thresh)
    known = np.logical_or(occupied, free, out=free)
    return OccupancyMap(occupied, np.logical_not(known, out=known), settings.resolution, settings.origin)


def _check_extent(shape: tuple[int, ...], cell_m: float, place: str) -> None:
    """Raise UserError, naming *place*, for a size of cells that makes no floor of a map of *shape* (ny, nx)."""
    ny, nx = shape
    if not SMALLEST_CELL_M <= cell_m <= FARTHEST_M / max(nx, ny):
        raise UserError(
            f"{place}: {cell_m:g} m is no size of a cell of a map of {nx} x {ny}, "
            f"expected {SMALLEST_CELL_M:g} to {FARTHEST_M / max(nx, ny):g}"
        )


def occupancy_percent(pixels: Floats, settings: RosMapSettings) -> Percents:
    """Return the occupancy, shape (ny, nx), 0 to 100 or -1, of *pixels* (ny, nx, channels) of 0 to 1.

    One or three channels are colours, a second or fourth one is opacity. The rules stand at the top of the module.
    """
    colours = pixels.shape[2] - (pixels.shape[2] + 1) % 2
    opacity = pixels[:, :, colours:]
    # grey counts as three equal colours, so that alpha weighs a quarter
    grey = np.repeat(pixels[:, :, :colours], 3 // colours, axis=2)
    shade = np.concatenate((grey, opacity) if settings.mode == "trinary" else (grey,), axis=2).mean(axis=2)
    if settings.mode == "raw":
        raw = np.floor(255 * shade + 0.5)
        return np.where(raw <= 100, raw, UNKNOWN).astype(np.int8)
    p = shade if settings.negate else 1.0 - shade
    between = np.full(shade.shape, float(UNKNOWN))
    if settings.mode == "scale":
        between = np.rint(100 * (p - settings.free_thresh) / (settings.occupied_thresh - settings.free_thresh))
    percent = np.where(p > settings.occupied_thresh, 100.0, np.where(p < settings.free_thresh, 0.0, between))
    if settings.mode == "scale" and opacity.size:
        percent[opacity[:, :, 0] < 1.0] = UNKNOWN
    return percent.astype(np.int8)


def read_percent(path: Path, settings: RosMapSettings) -> Percents:
    """Return the occupancy, shape (ny, nx), row 0 at the top, of a PGM (P2, P5), PNG or other image.

    Raise UserError if the file is not an image, or one of more than MOST_CELLS pixels.
    """
    content = read_bytes(path, MOST_BYTES)
    if content[:2] in (b"P2", b"P5"):
        samples, largest = _pgm(content, path)
        return _of_shades(largest, settings)[samples]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is odd, but can be read; and our own limit of size is another
            with Image.open(io.BytesIO(content)) as image:
                _check_cells(*image.size, f"{path}: header")
                return _of_image(image, settings)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:  # Pillow's ways to say no
        reason = "unknown format" if isinstance(error, UnidentifiedImageError) else str(error)
        raise UserError(f"{path}: not an image, expected PGM or PNG: {reason}") from None


def _check_cells(width: int, height: int, place: str) -> None:
    if width * height > MOST_CELLS:
        raise UserError(f"{place}: {width} x {height} are {width * height} cells, expected at most {MOST_CELLS}")


def _of_image(image: Image.Image, settings: RosMapSettings) -> Percents:
    """Return the occupancy, shape (ny, nx), of *image*."""
    clear = "A" in image.getbands() or "transparency" in image.info
    deep = image.mode.startswith("I;16")
    table = _of_shades(65535 if deep else 255, settings) if deep or (image.mode in ("1", "L") and not clear) else None
    percent = np.empty(image.size[::-1], np.int8)
    for rows, columns in _tiles(*percent.shape):
        tile = image.crop((columns.start, rows.start, columns.stop, rows.stop))
        if table is not None:
            percent[rows, columns] = table[np.asarray(tile if deep else tile.convert("L"))]
        else:
            colours = np.asarray(tile.convert("RGBA" if clear else "RGB"), np.float64) / 255
            percent[rows, columns] = occupancy_percent(colours, settings)
    return percent


def _of_shades(largest: int, settings: RosMapSettings) -> Percents:
    """Return the occupancy of each grey from 0 to *largest*, which is white, shape (largest + 1,)."""
    shades = np.arange(largest + 1, dtype=np.float64) / largest
    return occupancy_percent(shades[:, np.newaxis, np.newaxis], settings)[:, 0]


def _tiles(ny: int, nx: int) -> Iterator[tuple[slice, slice]]:
    """Yield rows and columns of the tiles that cover an image."""
    for top in range(0, ny, _TILE):
        for left in range(0, nx, _TILE):
            yield slice(top, min(top + _TILE, ny)), slice(left, min(left + _TILE, nx))


def _pgm(content: bytes, path: Path) -> tuple[Samples, int]:
    """Decode a plain (P2) or raw (P5) portable graymap with comments; more than one byte a sample if maxval > 255.

    Return its samples, shape (ny, nx), and its maxval.
    """
    numbers: list[int] = []
    at = 2
    for name in ("width", "height", "maxval"):
        word = _HEADER.match(content, at)
        assert word is not None  # it matches nothing, too
        numbers.append(_whole(word[1].decode("latin-1"), f"{path}: header: {name}"))
        at = word.end()
    width, height, largest = numbers
    if largest > 65535:
        raise UserError(f"{path}: header: maxval {largest} is not <= 65535")
    _check_cells(width, height, f"{path}: header")
    if content[:2] == b"P5":
        kind = np.dtype(">u2" if largest > 255 else "u1")
        start = min(at + 1, len(content))
        samples = np.frombuffer(content, kind, min(width * height, (len(content) - start) // kind.itemsize), start)
    else:
        samples = _plain_samples(content, at, width * height, path)
    if len(samples) < width * height:
        raise UserError(f"{path}: pixels: {len(samples)} found, expected {width} x {height}")
    if samples.max() > largest:
        raise UserError(f"{path}: pixels: {samples.max()} is not <= maxval {largest}")
    return samples.reshape(height, width), largest


def _plain_samples(content: bytes, at: int, count: int, path: Path) -> Samples:
    """Return the first *count* numbers of a plain graymap from *at* on, or all if there are fewer, shape (n,)."""
    samples = np.empty(count, np.uint16)
    found = 0
    while found < count and at < len(content):
        end = _end_of(_SPACE, content, at + _BLOCK)
        comment = content.rfind(b"#", at, end)
        if comment >= 0:
            end = max(end, _end_of(_LINE, content, comment))
        words = _COMMENT.sub(b" ", content[at:end]).split()[: count - found]
        if not all(word.isdigit() for word in words):
            raise UserError(f"{path}: pixels: not all of them are whole numbers")
        numbers = np.fromstring(b" ".join(words), np.int64, sep=" ")
        if numbers.max(initial=0) > 65535:
            raise UserError(f"{path}: pixels: {numbers.max()} is not <= 65535")
        samples[found : found + len(words)] = numbers
        found, at = found + len(words), end
    return samples[:found]


def _end_of(pattern: re.Pattern[bytes], content: bytes, at: int) -> int:
    """Return where *pattern* is found first from *at* on; the end of *content* if it is not."""
    match = pattern.search(content, at)
    return match.start() if match else len(content)


def _whole(text: str, place: str) -> int:
    """Return the number that *text* in ASCII digits is; raise UserError, naming *place*, for 0 and what is none.

    So it is for one that is larger than any number in a map can be: Python takes no number of 5000 digits.
    """
    digits = text.lstrip("0")
    if not (digits.isascii() and digits.isdigit()):
        raise UserError(f"{place}: {text[:20]!r} is not a whole number > 0")
    if len(digits) > len(str(MOST_CELLS)):
        raise UserError(f"{place}: a number of {len(digits)} digits is not <= {MOST_CELLS}")
    return int(digits)


def read_movingai_map(path: Path, cell_m: float) -> OccupancyMap:
    """Read a MovingAI benchmark map of type octile, its cells *cell_m* metres wide; row 0 of the file is the top.

    ``.``, ``G`` and ``S`` (swamp) can be driven on; ``@``, ``O``, ``T`` (trees) and ``W`` (water) cannot. Raise
    UserError for what is wrong.
    """
    content = read_bytes(path, MOST_BYTES).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not content.endswith(b"\n"):
        content += b"\n"
    stream = io.BytesIO(content)
    lines: list[str] = []
    while len(lines) < 8 and "map" not in lines:
        lines.append(stream.readline().decode(errors="replace").removesuffix("\n"))
    if "map" not in lines:
        raise UserError(f"{path}: header: no line 'map' found, expected type, height, width, map")
    header = dict(line.split(maxsplit=1) for line in lines[:-1] if len(line.split(maxsplit=1)) == 2)
    if header.get("type", "").strip() != "octile":
        raise UserError(f"{path}: type: {header.get('type', '')[:20]!r} is not 'octile'")
    height, width = (_whole(header.get(key, "").strip(), f"{path}: {key}") for key in ("height", "width"))
    _check_cells(width, height, f"{path}: header")
    _check_extent((height, width), cell_m, "floorplan.resolution_m")
    occupied = _blocked(stream, content, (height, width), path)[::-1]
    return OccupancyMap(occupied, np.zeros(occupied.shape, np.bool_), cell_m)


def _blocked(stream: io.BytesIO, content: bytes, shape: tuple[int, int], path: Path) -> Bools:
    """Return which cells of a MovingAI map, whose rows begin where *stream* of its *content* stands, are blocked."""
    height, width = shape
    start = stream.tell()
    found = content.count(b"\n", start)
    if found < height:
        raise UserError(f"{path}: map: {found} rows found, expected {height}")
    whole = min(height, (len(content) - start) // (width + 1))  # there are fewer if rows are too short
    body = content[start : start + whole * (width + 1)].translate(_CODES)
    codes = np.frombuffer(body, np.uint8).reshape(whole, width + 1)
    wrong = np.flatnonzero((codes[:, :-1] > _SOLID).any(axis=1) | (codes[:, -1] != _LINE_END))
    row = int(wrong[0]) if len(wrong) else whole
    if row < height:
        stream.seek(start + row * (width + 1))
        lines = content.count(b"\n", 0, start)
        text = stream.readline().decode(errors="replace").removesuffix("\n")
        _check_row(text, width, f"{path}: line {lines + row + 1}")
    blocked: Bools = codes[:, :-1] == _SOLID
    return blocked


def _check_row(row: str, width: int, place: str) -> None:
    """Raise UserError, naming *place*, for a row of a MovingAI map."""
    if len(row) != width:
        raise UserError(f"{place}: {len(row)} cells found, expected {width}")
    strange = sorted(set(row) - _PASSABLE - _BLOCKED)
    if strange:
        raise UserError(f"{place}: {strange[0]!r} is not one of . G S @ O T W")


# ---------------------------------------------------------------- outlines


def outline(occupied: Bools, most: int | None = None) -> Floats:
    """Return the boundary between the cells that are *occupied*, shape (ny, nx), and those that are not.

    Cell (iy, ix) is the unit square from (ix, iy) to (ix + 1, iy + 1), row 0 at the bottom. The result, shape (n, 4),
    holds axis-aligned segments x1, y1, x2, y2 with whole coordinates; edges in a row are one segment. What lies beyond
    the grid counts as occupied, so that the outline of an open grid is closed. Raise ValueError if n > *most*.
    """
    cells = np.asarray(occupied, np.bool_)
    lying = _runs(cells, most)
    standing = _runs(cells.T, None if most is None else most - len(lying))
    segments = np.empty((len(lying) + len(standing), 4))
    segments[: len(lying)] = lying[:, (1, 0, 2, 0)]
    segments[len(lying) :] = standing[:, (0, 1, 0, 2)]
    return segments


def _runs(cells: Bools, most: int | None) -> Int32s:
    """Return (y, first x, x after the last) of every run of edges between a row of *cells* and the next, shape (n, 3).

    Edge y lies below row y.
    """
    ny, nx = cells.shape
    rows = max(1, _BAND // (nx + 1))
    found, count = [np.empty((0, 3), np.int32)], 0
    for first in range(0, ny + 1, rows):
        last = min(first + rows, ny + 1)
        band = np.ones((last - first + 1, nx), np.bool_)  # from the row below the first edge to that above the last
        band[max(0, 1 - first) : ny + 1 - first] = cells[max(0, first - 1) : last]
        edges = np.zeros((last - first, nx + 2), np.bool_)
        np.not_equal(band[1:], band[:-1], out=edges[:, 1:-1])
        ends = edges[:, 1:] != edges[:, :-1]  # a run begins, ends, and so on
        count += int(np.count_nonzero(ends)) // 2
        if most is not None and count > most:
            raise ValueError("the outline has more segments than it may have")
        y, x = np.nonzero(ends)
        found.append(np.stack((y[::2] + first, x[::2], x[1::2]), axis=1).astype(np.int32))
    return np.concatenate(found)
