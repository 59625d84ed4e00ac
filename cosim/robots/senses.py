"""What robots sense: where they are in their own frames, where they see each other, and how far the walls are.

A robot's frame F_i is odometry: it begins where the scenario has it and, with a drift, turns and stretches as the robot
drives. What a robot sees lies relative to its body, so it is told in F_i by way of where the robot takes itself to be.

The camera measures another robot's distance d and direction alpha with the errors of Sgorbissa and Arkin ("Local
navigation strategies for a team of robots", section 6.1, equations 1 and 2): d (1 + U[-e, e]), and alpha plus the angle
under which half of the other's body appears, times U[-b, b]. The paper has b = 1.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import cache
from itertools import chain, pairwise
from struct import Struct
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from pydantic import Field

from cosim.geometry.segments import PackedWalls, SegmentGrid, in_sight, scan_walls, unpacked
from cosim.jit import njit
from cosim.machine import Command, GoTo
from cosim.observation import Observation, Sighting
from cosim.randomness import Streams, philox_words
from cosim.robots.carry import Carry
from cosim.robots.motion import Fleet
from cosim.settings import Settings
from cosim.units import Time, to_seconds

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
Ints: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
Integers: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]
Frame: TypeAlias = tuple[float, float, float]
"""Origin (x, y, m) and direction (rad) in the world."""
Room: TypeAlias = tuple[Floats, Floats, Floats, Ints]
"""What all kernels look at: poses, limits, and the packed walls."""

WORLD_FRAME: Final[Frame] = (0.0, 0.0, 0.0)
_SIGHT_PURPOSE: Final = 1
_DRIFT_PURPOSE: Final = 2
_NO_PICTURE: Final = np.empty(0, np.int64)
_STALE: Final = [-1]  # the pairs of no picture
_POINTS: Final = 16
"""So many points fit at first."""
_FEW: Final = 2
"""So many points are passed as numbers."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster

# columns of the table of poses: the truth, what the robot knows of itself, its frame and its body
_X: Final = 0
_Y: Final = 1
_HEADING: Final = 2
_OWN_X: Final = 3
_OWN_Y: Final = 4
_OWN_HEADING: Final = 5
_SPEED: Final = 6
_ARRIVED: Final = 7
_BLOCKED: Final = 8
_FRAME_X: Final = 9
_FRAME_Y: Final = 10
_FRAME_TURN: Final = 11
_RADIUS: Final = 12
_BLIND: Final = 13
_COLUMNS: Final = 14

# columns of the table of what the sensors are like
_RANGE: Final = 0
_HALF_FIELD: Final = 1
_OCCLUDE: Final = 2
_DISTANCE_ERROR: Final = 3
_BEARING_ERROR: Final = 4
_BEAM_RANGE: Final = 5
_SLIP: Final = 6
_TURN: Final = 7
_KEY: Final = 8  # and 9: the key of the draws, two words of 32 bits


class SenseSettings(Settings):
    """Parameters of the robots' sensors and of what they know of their own place."""

    frames: Literal["world", "own"] = Field(
        default="world", description="whose frame a robot knows: the world's, or its own, begun at an unknown place"
    )
    odometry_slip: float = Field(
        default=0.0, ge=0, lt=1, description="share by which a metre of odometry is wrong: uniform, new every tick"
    )
    odometry_turn_rad: float = Field(
        default=0.0, ge=0, description="rad, by which a tick's way of one metre turns the heading wrongly, at most"
    )
    field_of_view_deg: float = Field(
        default=360.0, gt=0, le=360, description="degrees, the camera's field of view, about the heading"
    )
    camera_period_s: float | None = Field(
        default=None, gt=0, description="s from one picture to the next, in whole ticks; every tick if not given"
    )
    bodies_occlude: bool = Field(default=False, description="whether a robot hides what stands behind it")
    distance_error: float = Field(
        default=0.0, ge=0, lt=1, description="largest relative error of a seen robot's distance (paper 000, eq. 1)"
    )
    bearing_error: float = Field(
        default=0.0, ge=0, le=1, description="largest error of its direction, in halves of its apparent size (eq. 2)"
    )
    beams: int = Field(default=32, ge=4, le=720, description="number of beams of the range scanner")
    beam_range_m: float = Field(default=2.5, gt=0, description="m, how far they reach")


class Senses:
    """The sensors of all robots of a run; asked once a tick, after the robots have moved."""

    def __init__(
        self,
        settings: SenseSettings,
        walls: PackedWalls,
        radii_m: Sequence[float],
        frames: Sequence[Frame],
        sight_range_m: float,
        tick: Time,
        streams: Streams,
    ) -> None:
        count = len(radii_m)
        self._drifts = settings.odometry_slip > 0.0 or settings.odometry_turn_rad > 0.0
        self.aware = settings.frames == "world" and not self._drifts
        """Whether a robot knows where it is, also if it has been carried there: odometry would not notice."""
        self._poses = np.zeros((count, _COLUMNS))
        self._poses[:, _FRAME_X : _FRAME_TURN + 1] = frames
        self._poses[:, _RADIUS] = radii_m
        self._limits = np.array(
            [
                sight_range_m,
                math.radians(settings.field_of_view_deg) / 2.0,
                settings.bodies_occlude,
                settings.distance_error,
                settings.bearing_error,
                settings.beam_range_m,
                settings.odometry_slip,
                settings.odometry_turn_rad,
                *streams.draws("senses").key,
            ]
        )
        self._room = self._poses, self._limits, *walls
        self._pairs = np.empty(count * count, np.int64)
        """Who sees whom, as the observer's number times that of robots, plus the other's; and where."""
        self._places = np.empty((2, count * count))
        self._in_sight: list[int] = []
        """The pairs of the last picture; whom they are with, and which of them are each robot's."""
        self._others: list[int] = []
        self._shares: list[tuple[int, int]] = [(0, 0)] * count
        self._period = max(1, round((settings.camera_period_s or 0.0) / to_seconds(tick)))
        self._beams = settings.beams
        self._ticks = 0
        self._sightings: list[tuple[Sighting, ...]] = [()] * count
        self._visible: list[tuple[int, ...]] = [()] * count
        self._known: list[list[float]] = [[0.0] * (_BLOCKED + 1)] * count
        self._told = self._poses[:, : _BLOCKED + 1]
        self._views = [_View(self._room, robot, self._beams) for robot in range(count)]

    def observe(self, fleet: Fleet) -> list[Observation]:
        """Return what each robot senses now."""
        moved = self._drifts and self._ticks > 0
        picture = self._ticks % self._period == 0
        pairs = self._pairs if picture else _NO_PICTURE
        seen = _sense(*self._room, fleet.observed, self._ticks, moved, pairs, self._places)
        if picture and (seen or self._in_sight):
            self._picture(seen)
        self._ticks += 1
        self._known = self._told.tolist()
        return [
            _new(Observation, (x, y, heading, speed, arrived > 0.0, blocked > 0.0, visible, sightings, view))
            for (_, _, _, x, y, heading, speed, arrived, blocked), visible, sightings, view in zip(
                self._known, self._visible, self._sightings, self._views, strict=True
            )
        ]

    def _picture(self, seen: int) -> None:
        """Sort what the cameras have *seen* in all by who has seen it; mostly they see whom they saw before."""
        pairs, (xs, ys) = self._pairs[:seen].tolist(), self._places[:, :seen].tolist()
        if pairs != self._in_sight:
            self._in_sight = pairs
            self._sort_out(pairs)
        all_seen = [_new(Sighting, other_there) for other_there in zip(self._others, xs, ys, strict=True)]
        self._sightings = [tuple(all_seen[begin:end]) for begin, end in self._shares]

    def _sort_out(self, pairs: list[int]) -> None:
        """Note whose each of *pairs* is; they are in order."""
        count = len(self._views)
        self._others = [pair % count for pair in pairs]
        ends = [bisect_left(pairs, robot * count) for robot in range(count + 1)]
        self._shares = list(pairwise(ends))
        self._visible = [tuple(self._others[begin:end]) for begin, end in self._shares]

    def blind(self, robot: int, blind: bool) -> None:
        """Switch the camera of *robot* off, and forget its last picture; or on, to see from the next picture on."""
        self._poses[robot, _BLIND] = blind
        if blind:
            self._in_sight = _STALE
            self._sightings[robot] = self._visible[robot] = ()

    def carry(self, robot: int, carried: Carry) -> None:
        """Have *robot* carried away at this tick, before it senses: what an unaware one knows goes along."""
        if not self.aware:
            for row, first in ((self._poses[robot], _X), (self._poses[robot], _FRAME_X), (self._known[robot], _X)):
                row[first : first + 3] = carried.pose(*row[first : first + 3])

    def in_world(self, robot: int, command: Command) -> Command:
        """Return *command*, which is meant in the frame of *robot*, in the world's."""
        if not isinstance(command, GoTo):
            return command
        x, y, heading, own_x, own_y, own_heading, *_ = self._known[robot]
        cos, sin = math.cos(heading - own_heading), math.sin(heading - own_heading)
        dx, dy = command[0] - own_x, command[1] - own_y
        return _new(GoTo, (x + cos * dx - sin * dy, y + sin * dx + cos * dy))


class _View:
    """Where one robot looks from."""

    __slots__ = ("_beams", "_points", "_robot", "_room", "_seen")

    def __init__(self, room: Room, robot: int, beams: int) -> None:
        self._room = room
        self._robot = robot
        self._beams = beams
        self._points = np.empty(2 * _POINTS)
        self._seen = np.empty(_POINTS, np.bool_)

    def sees(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        count = len(points_m)
        if count > _FEW:
            return self._sees_many(points_m)
        if not count:
            return []
        # the usual question, for a goal and a ghost, without arrays: they would take half the time
        (x, y), (other_x, other_y) = points_m[0], points_m[-1]
        seen = _few_in_region(*self._room, self._robot, count, x, y, other_x, other_y)
        return [seen > 1] if count == 1 else [seen > 1, seen % 2 > 0]

    def _sees_many(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        count = len(points_m)
        if count > len(self._seen):
            self._points, self._seen = np.empty(4 * count), np.empty(2 * count, np.bool_)
        _layout(2 * count)(self._points.data, 0, *chain.from_iterable(points_m))  # half the time of np.array
        _in_region(*self._room, self._robot, self._points, self._seen, count)
        seen: list[bool] = self._seen[:count].tolist()
        return seen

    def ranges_m(self) -> Floats:
        ranges = np.empty(self._beams)
        _scan(*self._room, self._robot, ranges)
        return ranges


@cache
def _layout(count: int) -> Callable[..., None]:
    return Struct(f"{count}d").pack_into


@njit(cache=True)
def _uniform(limits: Floats, tick: int, link: int, purpose: int) -> tuple[float, float]:
    """Return two numbers in [-1, 1)."""
    words = philox_words(tick & 0xFFFFFFFF, tick >> 32, link, purpose, int(limits[_KEY]), int(limits[_KEY + 1]))
    return words[0] * 2.0**-31 - 1.0, words[1] * 2.0**-31 - 1.0


@njit(cache=True)
def _sense(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Ints,
    rows: Floats,
    tick: int,
    moved: bool,
    pairs: Integers,
    places: Floats,
) -> int:
    """Do :func:`_locate`, and :func:`_see` if there is room for a picture; return how many have been seen in all."""
    _locate(poses, limits, rows, tick, moved)
    if not pairs.shape[0]:
        return 0
    return _see(poses, limits, unpacked(numbers, members), tick, pairs, places)


@njit(cache=True)
def _locate(poses: Floats, limits: Floats, rows: Floats, tick: int, moved: bool) -> None:
    """Write where robots are, and where they take themselves to be: exactly, or, if *moved*, from how they moved."""
    for i in range(poses.shape[0]):
        x, y, heading = rows[i, 0], rows[i, 1], rows[i, 2]
        pose = poses[i]
        if moved:
            dx, dy = x - pose[_X], y - pose[_Y]
            way = math.sqrt(dx * dx + dy * dy)
            slip, turn = _uniform(limits, tick, i, _DRIFT_PURPOSE)
            # with the root, what adds up over a metre has the same spread whatever the ticks
            error = limits[_TURN] * turn * math.sqrt(way)
            angle = pose[_OWN_HEADING] - pose[_HEADING] + error
            cos, sin = math.cos(angle), math.sin(angle)
            stretch = 1.0 + limits[_SLIP] * slip
            pose[_OWN_X] += stretch * (cos * dx - sin * dy)
            pose[_OWN_Y] += stretch * (sin * dx + cos * dy)
            pose[_OWN_HEADING] = _wrapped(heading + angle)
        else:
            cos, sin = math.cos(pose[_FRAME_TURN]), math.sin(pose[_FRAME_TURN])
            dx, dy = x - pose[_FRAME_X], y - pose[_FRAME_Y]
            pose[_OWN_X], pose[_OWN_Y] = cos * dx + sin * dy, cos * dy - sin * dx
            pose[_OWN_HEADING] = _wrapped(heading - pose[_FRAME_TURN])
        pose[_X], pose[_Y], pose[_HEADING] = x, y, heading
        pose[_SPEED], pose[_ARRIVED], pose[_BLOCKED] = rows[i, 3], rows[i, 4], rows[i, 5]


@njit(cache=True)
def _wrapped(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def _to_world(pose: Floats, x: float, y: float) -> tuple[float, float]:
    angle = pose[_HEADING] - pose[_OWN_HEADING]
    cos, sin = math.cos(angle), math.sin(angle)
    dx, dy = x - pose[_OWN_X], y - pose[_OWN_Y]
    return pose[_X] + cos * dx - sin * dy, pose[_Y] + sin * dx + cos * dy


@njit(cache=True)
def _hidden(poses: Floats, i: int, j: int, x: float, y: float) -> bool:
    """Return whether another body than those of *i* and *j* stands between robot *i* and a point."""
    ax, ay = poses[i, _X], poses[i, _Y]
    dx, dy = x - ax, y - ay
    square = dx * dx + dy * dy
    for k in range(poses.shape[0]):
        if k in (i, j) or square == 0.0:
            continue
        cx, cy = poses[k, _X] - ax, poses[k, _Y] - ay
        part = min(1.0, max(0.0, (cx * dx + cy * dy) / square))
        ex, ey = cx - part * dx, cy - part * dy
        if ex * ex + ey * ey < poses[k, _RADIUS] * poses[k, _RADIUS]:
            return True
    return False


@njit(cache=True)
def _looks_at(poses: Floats, limits: Floats, grid: SegmentGrid, i: int, j: int, x: float, y: float) -> bool:
    """Return whether robot *i* sees a point of the world, which is robot *j* (or nobody, -1)."""
    if poses[i, _BLIND] > 0.0:
        return False
    dx, dy = x - poses[i, _X], y - poses[i, _Y]
    if dx * dx + dy * dy > limits[_RANGE] * limits[_RANGE]:
        return False
    half_field = limits[_HALF_FIELD]
    if half_field < math.pi and abs(_wrapped(math.atan2(dy, dx) - poses[i, _HEADING])) > half_field:
        return False
    if limits[_OCCLUDE] > 0.0 and _hidden(poses, i, j, x, y):
        return False
    return in_sight(grid, poses[i, _X], poses[i, _Y], x, y)


@njit(cache=True)
def _see(poses: Floats, limits: Floats, grid: SegmentGrid, tick: int, pairs: Integers, places: Floats) -> int:
    """Write whom each robot sees, and where, in its own frame: robot by robot; return how many that are."""
    at = 0
    errors = limits[_DISTANCE_ERROR] > 0.0 or limits[_BEARING_ERROR] > 0.0
    for i in range(poses.shape[0]):
        own_turn = poses[i, _OWN_HEADING] - poses[i, _HEADING]
        cos, sin = math.cos(own_turn), math.sin(own_turn)
        for j in range(poses.shape[0]):
            x, y = poses[j, _X], poses[j, _Y]
            if i == j or not _looks_at(poses, limits, grid, i, j, x, y):
                continue
            dx, dy = x - poses[i, _X], y - poses[i, _Y]
            if errors:
                far, aside = _uniform(limits, tick, i << 16 | j, _SIGHT_PURPOSE)
                stretch = 1.0 + limits[_DISTANCE_ERROR] * far
                half = math.atan2(poses[j, _RADIUS], math.sqrt(dx * dx + dy * dy))
                turn = own_turn + half * limits[_BEARING_ERROR] * aside
                cos, sin = stretch * math.cos(turn), stretch * math.sin(turn)
            pairs[at] = i * poses.shape[0] + j
            places[0, at] = poses[i, _OWN_X] + cos * dx - sin * dy
            places[1, at] = poses[i, _OWN_Y] + sin * dx + cos * dy
            at += 1
    return at


@njit(cache=True)
def _in_region(
    poses: Floats, limits: Floats, numbers: Floats, members: Ints, i: int, points: Floats, seen: Bools, count: int
) -> None:
    """Write which of the first *count* points (x, y, x, y...) of the frame of robot *i* it sees."""
    grid = unpacked(numbers, members)
    for k in range(count):
        x, y = _to_world(poses[i], points[2 * k], points[2 * k + 1])
        seen[k] = _looks_at(poses, limits, grid, i, -1, x, y)


@njit(cache=True)
def _few_in_region(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Ints,
    i: int,
    count: int,
    x: float,
    y: float,
    other_x: float,
    other_y: float,
) -> int:
    """Return 2 if robot *i* sees (x, y) of its frame, and 1 more if *count* is 2 and it sees the other point."""
    grid = unpacked(numbers, members)
    x, y = _to_world(poses[i], x, y)
    seen = 2 if _looks_at(poses, limits, grid, i, -1, x, y) else 0
    if count > 1:
        x, y = _to_world(poses[i], other_x, other_y)
        seen += 1 if _looks_at(poses, limits, grid, i, -1, x, y) else 0
    return seen


@njit(cache=True)
def _scan(poses: Floats, limits: Floats, numbers: Floats, members: Ints, i: int, ranges: Floats) -> None:
    """Write how far each beam of robot *i*, in turn of its own frame, meets a wall or a body; inf if it meets none."""
    limit = limits[_BEAM_RANGE]
    count = ranges.shape[0]
    angle, apart = poses[i, _HEADING] - poses[i, _OWN_HEADING], 2.0 * math.pi / count
    ways = np.empty((count, 2))
    for k in range(count):
        ways[k, 0], ways[k, 1] = limit * math.cos(angle + k * apart), limit * math.sin(angle + k * apart)
    scan_walls(unpacked(numbers, members), poses[i, _X], poses[i, _Y], ways, limit, ranges)
    _scan_bodies(poses, i, ways, limit, ranges)
    for k in range(count):
        ranges[k] *= limit


@njit(cache=True)
def _scan_bodies(poses: Floats, i: int, ways: Floats, limit: float, first: Floats) -> None:
    """Lower the fractions at which the *ways* from robot *i* meet something where they meet a body before."""
    for j in range(poses.shape[0]):
        cx, cy, radius = poses[j, _X] - poses[i, _X], poses[j, _Y] - poses[i, _Y], poses[j, _RADIUS]
        outside = cx * cx + cy * cy - radius * radius
        if j == i or outside > limit * (limit + 2.0 * radius):
            continue
        for k in range(ways.shape[0]):
            along = cx * ways[k, 0] + cy * ways[k, 1]
            rest = along * along - limit * limit * outside
            if along > 0.0 and rest >= 0.0:
                part = max(0.0, (along - math.sqrt(rest)) / (limit * limit))
                if part <= 1.0 and part < first[k]:
                    first[k] = part
