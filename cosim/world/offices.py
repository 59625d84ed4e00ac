"""Generated office floors: a corridor from end to end, rooms on both sides, doors; the same for the same seed.

The corridor runs along x in the middle of the floor. The rooms of a side share its length in random parts, none smaller
than a door with a jamb on each side. The first room of a side has its door to the corridor; each further one has it
there too or, one time in four, to the room before it, so every room can be reached. Measures are between the middles
of walls: those that have a thickness stand half on each side of them. No wall moves, and no door is narrower.
"""

from itertools import pairwise
from typing import Final, Self, TypeAlias

import numpy as np
import shapely
from pydantic import Field, model_validator

from cosim.arrays import Floats
from cosim.randomness import Streams
from cosim.settings import Count, Metres, Seed, Settings, error_at

Segment: TypeAlias = tuple[float, float, float, float]
Ring: TypeAlias = tuple[tuple[float, float], ...]

JAMB_M: Final = 0.2
"""Least length of wall between a door and the next corner."""
INNER_DOOR_SHARE: Final = 0.25
"""Share of rooms that are entered through their neighbour."""


class OfficeSettings(Settings):
    """Measures of a generated office."""

    width_m: Metres = Field(default=20.0, gt=0, description="length along the corridor")
    depth_m: Metres = Field(default=12.0, gt=0, description="extent across the corridor")
    rooms: Count = Field(default=10, ge=1, description="number of rooms, shared out over the two sides")
    corridor_m: Metres = Field(default=2.0, gt=0, description="width of the corridor")
    door_m: Metres = Field(default=1.0, gt=0, description="width of every door")
    seed: Seed = Field(default=1, ge=0, description="decides where walls and doors stand")
    wall_m: Metres = Field(
        default=0.0, ge=0, lt=2 * JAMB_M, description="thickness of the inner walls, which stand where they do without"
    )

    @property
    def least_room_m(self) -> float:
        """Return the least length of a room along the corridor."""
        return self.door_m + 2 * JAMB_M

    @model_validator(mode="after")
    def _rooms_fit(self) -> Self:
        most = 2 * int(self.width_m / self.least_room_m + 1e-9)
        if self.rooms > most:
            raise error_at(
                ("rooms",), self.rooms, f"is too many: with doors of {self.door_m} m, {most} fit into width_m"
            )
        room_depth = (self.depth_m - self.corridor_m) / 2
        if room_depth < self.least_room_m:
            expected = f"leaves rooms a depth of {room_depth:g} m beside corridor_m, expected {self.least_room_m:g} m"
            raise error_at(("depth_m",), self.depth_m, expected)
        if not self.wall_m < self.corridor_m:
            raise error_at(("wall_m",), self.wall_m, f"is not < {self.corridor_m}, corridor_m")
        return self


def office_walls(settings: OfficeSettings) -> Floats:
    """Return the walls without thickness of an office whose lower left corner is (0, 0): segments (n, 4) in metres."""
    width, depth = settings.width_m, settings.depth_m
    outer: list[Segment] = [(0, 0, width, 0), (width, 0, width, depth), (width, depth, 0, depth), (0, depth, 0, 0)]
    return np.array(outer if settings.wall_m else [*outer, *_inner(settings)], dtype=np.float64)


def office_solids(settings: OfficeSettings) -> list[Ring]:
    """Return the walls that have a thickness, as polygons in metres."""
    return thick_walls(np.array(_inner(settings)), settings.wall_m) if settings.wall_m else []


def thick_walls(walls: Floats, wall_m: float) -> list[Ring]:
    """Return the outlines of *walls* (n, 4) of a thickness, as polygons that do not touch; *wall_m* > 0, metres.

    An end that no other wall meets stays where it is: a door keeps its width. Raise ValueError for walls that shut
    something in: no outline tells of what lies within.
    """
    lines = shapely.line_merge(shapely.MultiLineString(list(walls.reshape(-1, 2, 2))))
    solid = shapely.buffer(lines, wall_m / 2, cap_style="flat", join_style="mitre")
    parts = shapely.get_parts(shapely.normalize(shapely.simplify(solid, 0.0)))
    if shapely.get_num_interior_rings(parts).any():
        raise ValueError("walls shut something in, expected a door to everywhere")
    return [tuple((float(x), float(y)) for x, y in shapely.get_coordinates(part)[:-1]) for part in parts]


def _inner(settings: OfficeSettings) -> list[Segment]:
    """Return the walls of all rooms, without the outer ones."""
    depth, walls = settings.depth_m, list[Segment]()
    low, high = (depth - settings.corridor_m) / 2, (depth + settings.corridor_m) / 2
    upper = (settings.rooms + 1) // 2
    for side, rooms, front, back in (("upper", upper, high, depth), ("lower", settings.rooms - upper, low, 0.0)):
        if rooms:
            walls += _row(settings, side, rooms, front, back)
    return walls


def _row(settings: OfficeSettings, side: str, rooms: int, front: float, back: float) -> list[Segment]:
    """Return the inner walls of the rooms of one side, whose corridor wall lies at y = *front*."""
    draw = Streams(settings.seed)("office", side)
    spare = settings.width_m - rooms * settings.least_room_m
    cuts = np.cumsum(settings.least_room_m + spare * draw.dirichlet(np.full(rooms, 3.0)))
    edges = [0.0, *cuts[:-1].tolist(), settings.width_m]
    low, high = min(front, back), max(front, back)
    walls: list[Segment] = []
    for room, (left, right) in enumerate(pairwise(edges)):
        inner = room > 0 and draw.random() < INNER_DOOR_SHARE
        along = None if inner else _door(draw, left, right, settings.door_m)
        walls += [(a, front, b, front) for a, b in _around(left, right, along, settings.door_m)]
        if room:
            across = _door(draw, low, high, settings.door_m) if inner else None
            walls += [(left, a, left, b) for a, b in _around(low, high, across, settings.door_m)]
    return walls


def _door(draw: np.random.Generator, low: float, high: float, door_m: float) -> float:
    """Return where a door begins in the wall from *low* to *high*."""
    return float(draw.uniform(low + JAMB_M, max(high - JAMB_M - door_m, low + JAMB_M)))


def _around(low: float, high: float, door: float | None, door_m: float) -> list[tuple[float, float]]:
    """Return the pieces of the wall from *low* to *high* that a door beginning at *door* leaves."""
    return [(low, high)] if door is None else [(low, door), (door + door_m, high)]
