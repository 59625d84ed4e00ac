"""What robots have had in sight so far, as far as their scanners reach: how much of the floor is explored."""

from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from cosim.arrays import Bools, Floats
from cosim.export.recording import Recording
from cosim.units import S, Time

CELL_M: Final = 0.1
BEAMS: Final = 240
STEP: Final = S // 2
"""How often robots look about."""


def seen_floor(recording: Recording, now: Time, range_m: float) -> Bools:
    """Return which cells of CELL_M (rows from the lowest, columns) were within *range_m* and in sight of any robot.

    Robots look about every half second up to *now*, from where they truly were; walls and polygons stop their sight.
    """
    x0, y0, x1, y1 = recording.scene["bounds_m"]
    size = int(np.ceil((x1 - x0) / CELL_M)), int(np.ceil((y1 - y0) / CELL_M))
    picture = Image.new("1", size)
    pen = ImageDraw.Draw(picture)
    walls = _walls(recording)
    times, poses = recording.poses()
    ticks = np.unique(np.searchsorted(times, np.arange(0, now + 1, STEP), side="right") - 1)
    for places in poses[ticks[ticks >= 0]]:
        for place in places[:, :2]:
            fan = (_ends(place, walls, range_m) - (x0, y0)) / CELL_M
            pen.polygon([tuple(point) for point in fan.tolist()], fill=1)
    return np.asarray(picture, dtype=bool)


def _walls(recording: Recording) -> Floats:
    """Return walls and the sides of polygons (n, 4)."""
    sides = [
        (*one, *two)
        for polygon in recording.scene["polygons_m"]
        for one, two in zip(polygon, [*polygon[1:], polygon[0]], strict=True)
    ]
    return np.array([*recording.scene["walls_m"], *sides], dtype=float).reshape(-1, 4)


def _ends(place: Floats, walls: Floats, range_m: float) -> Floats:
    """Return where the beams from *place* end (BEAMS, 2): at a wall, or at *range_m*."""
    turns = np.arange(BEAMS) * (2 * np.pi / BEAMS)
    along = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    start, side = walls[:, :2] - place, walls[:, 2:] - walls[:, :2]
    cross = along[:, :1] * side[:, 1] - along[:, 1:] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        beam = (start[:, 0] * side[:, 1] - start[:, 1] * side[:, 0]) / cross
        wall = (start[:, 0] * along[:, 1:] - start[:, 1] * along[:, :1]) / cross
    hit = (cross != 0) & (beam >= 0) & (wall >= 0) & (wall <= 1)
    lengths = np.minimum(np.where(hit, beam, np.inf).min(axis=1, initial=np.inf), range_m)
    found: Floats = place + along * lengths[:, None]
    return found
