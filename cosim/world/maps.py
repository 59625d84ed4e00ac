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
"""

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, Self, TypeAlias

import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field, model_validator

from cosim.documents import read_bytes, read_text, read_yaml, validated
from cosim.errors import UserError
from cosim.geometry.occupancy import outline
from cosim.settings import Angle, Metres, Settings, error_at

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
Percents: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]

UNKNOWN: Final = -1
_PASSABLE: Final = frozenset(".GS")
_BLOCKED: Final = frozenset("@OTW")


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

    def walls_m(self, solid: Bools) -> Floats:
        """Return the outline of the cells *solid*, and of the map, as wall segments (n, 4) in the world frame."""
        ends = outline(solid).reshape(-1, 2)
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
        ix = np.floor((math.cos(yaw) * dx + math.sin(yaw) * dy) / self.cell_m)
        iy = np.floor((math.cos(yaw) * dy - math.sin(yaw) * dx) / self.cell_m)
        ny, nx = cells.shape
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        value = np.full(len(points_m), outside)
        value[inside] = cells[iy[inside].astype(np.intp), ix[inside].astype(np.intp)]
        return value

    def _to_world(self, corners: Floats) -> Floats:
        """Turn corners in cells, shape (n, 2), into metres in the world frame."""
        x, y, yaw = self.origin
        along, up = corners[:, 0] * self.cell_m, corners[:, 1] * self.cell_m
        cos, sin = math.cos(yaw), math.sin(yaw)
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

    @model_validator(mode="after")
    def _thresholds_in_order(self) -> Self:
        if self.free_thresh >= self.occupied_thresh:
            raise error_at(("free_thresh",), self.free_thresh, f"is not < {self.occupied_thresh}, occupied_thresh")
        return self


def read_ros_map(path: Path) -> OccupancyMap:
    """Read a ROS map from its YAML file; the image is looked for beside it. Raise UserError for what is wrong."""
    settings = validated(RosMapSettings, read_yaml(path), str(path))
    image = path.parent / settings.image
    if not image.is_file():
        raise UserError(f"{path}: image: {settings.image!r}: there is no such file beside the map")
    percent = occupancy_percent(read_image(image), settings)[::-1]
    occupied, free = percent == 100, percent == 0
    if settings.mode == "raw":
        occupied = percent > 100 * settings.occupied_thresh
        free = (percent != UNKNOWN) & (percent < 100 * settings.free_thresh)
    return OccupancyMap(occupied, ~occupied & ~free, settings.resolution, settings.origin)


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


def read_image(path: Path) -> Floats:
    """Return the pixels of a PGM (P2, P5), PNG or other image, 0 to 1, shape (ny, nx, channels), row 0 at the top.

    Raise UserError if the file is not an image.
    """
    content = read_bytes(path)
    if content[:2] in (b"P2", b"P5"):
        return _pgm(content, path)[:, :, np.newaxis]
    try:
        with Image.open(io.BytesIO(content)) as image:
            if image.mode.startswith("I;16"):
                return np.asarray(image, np.float64)[:, :, np.newaxis] / 65535
            clear = "A" in image.getbands() or "transparency" in image.info
            plain = image.convert("RGBA" if clear else "RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:  # Pillow's ways to say no
        reason = "unknown format" if isinstance(error, UnidentifiedImageError) else str(error)
        raise UserError(f"{path}: not an image, expected PGM or PNG: {reason}") from None
    return np.asarray(plain, np.float64) / 255


def _pgm(content: bytes, path: Path) -> Floats:
    """Decode a plain (P2) or raw (P5) portable graymap with comments; more than one byte a sample if maxval > 255."""
    numbers: list[int] = []
    at = 2
    while len(numbers) < 3:
        token, at = _token(content, at)
        if not token.isdigit() or int(token) < 1:
            raise UserError(f"{path}: header: {token[:20]!r} is not a whole number > 0, expected width, height, maxval")
        numbers.append(int(token))
    width, height, largest = numbers
    if largest > 65535:
        raise UserError(f"{path}: header: maxval {largest} is not <= 65535")
    if content[:2] == b"P5":
        kind = np.dtype(">u2" if largest > 255 else "u1")
        body = content[at + 1 : at + 1 + width * height * kind.itemsize]
        samples = np.frombuffer(body[: len(body) // kind.itemsize * kind.itemsize], kind).astype(np.float64)
    else:
        words = b" ".join(line.split(b"#")[0] for line in content[at:].splitlines()).split()[: width * height]
        if not all(word.isdigit() for word in words):
            raise UserError(f"{path}: pixels: not all of them are whole numbers")
        samples = np.array([int(word) for word in words], np.float64)
    if len(samples) < width * height:
        raise UserError(f"{path}: pixels: {len(samples)} found, expected {width} x {height}")
    if samples.max() > largest:
        raise UserError(f"{path}: pixels: {samples.max():.0f} is not <= maxval {largest}")
    return samples.reshape(height, width) / largest


def _token(content: bytes, at: int) -> tuple[bytes, int]:
    """Return the next word of a PGM header from *at* on, past spaces and comments, and where it ends."""
    while at < len(content) and (content[at : at + 1].isspace() or content[at : at + 1] == b"#"):
        if content[at : at + 1] == b"#":
            line_end = content.find(b"\n", at)
            at = line_end if line_end >= 0 else len(content)
        else:
            at += 1
    start = at
    while at < len(content) and not content[at : at + 1].isspace() and content[at : at + 1] != b"#":
        at += 1
    return content[start:at], at


def read_movingai_map(path: Path, cell_m: float) -> OccupancyMap:
    """Read a MovingAI benchmark map of type octile, its cells *cell_m* metres wide; row 0 of the file is the top.

    ``.``, ``G`` and ``S`` (swamp) can be driven on; ``@``, ``O``, ``T`` (trees) and ``W`` (water) cannot. Raise
    UserError for what is wrong.
    """
    lines = read_text(path).splitlines()
    if "map" not in lines[:8]:
        raise UserError(f"{path}: header: no line 'map' found, expected type, height, width, map")
    start = lines.index("map") + 1
    header = dict(line.split(maxsplit=1) for line in lines[: start - 1] if len(line.split(maxsplit=1)) == 2)
    if header.get("type", "").strip() != "octile":
        raise UserError(f"{path}: type: {header.get('type')!r} is not 'octile'")
    for key in ("height", "width"):
        if not header.get(key, "").strip().isdigit() or int(header[key]) < 1:
            raise UserError(f"{path}: {key}: {header.get(key)!r} is not a whole number > 0")
    rows = lines[start : start + int(header["height"])]
    if len(rows) < int(header["height"]):
        raise UserError(f"{path}: map: {len(rows)} rows found, expected {header['height'].strip()}")
    for number, row in enumerate(rows, start=start + 1):
        _check_row(row, int(header["width"]), f"{path}: line {number}")
    occupied = np.array([[letter in _BLOCKED for letter in row] for row in rows])[::-1]
    return OccupancyMap(occupied, np.zeros_like(occupied), cell_m)


def _check_row(row: str, width: int, place: str) -> None:
    if len(row) != width:
        raise UserError(f"{place}: {len(row)} cells found, expected {width}")
    strange = sorted(set(row) - _PASSABLE - _BLOCKED)
    if strange:
        raise UserError(f"{place}: {strange[0]!r} is not one of . G S @ O T W")
