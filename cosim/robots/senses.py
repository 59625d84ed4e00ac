"""What robots sense: where they are in their own frames, where they see each other, and how far the walls are.

A robot's frame F_i is odometry: it begins where the scenario has it and, with a drift, turns and stretches as the robot
drives. What a robot sees lies relative to its body, so it is told in F_i by way of where the robot takes itself to be.

The camera measures another robot's distance d and direction alpha with the errors of Sgorbissa and Arkin ("Local
navigation strategies for a team of robots", section 6.1, equations 1 and 2): d (1 + U[-e, e]), and alpha plus the angle
under which half of the other's body appears, times U[-b, b]. The paper has b = 1.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from pydantic import Field

from cosim.geometry.segments import PackedWalls, SegmentGrid, in_sight, range_along, unpacked
from cosim.jit import njit
from cosim.machine import Command, GoTo
from cosim.observation import Observation, Sighting
from cosim.randomness import Streams, philox_words
from cosim.robots.motion import Fleet
from cosim.settings import Settings
from cosim.units import Time, to_seconds

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
Integers: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]
Ints: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
Frame: TypeAlias = tuple[float, float, float]
"""Origin (x, y, m) and direction (rad) in the world."""

WORLD_FRAME: Final[Frame] = (0.0, 0.0, 0.0)
_SIGHT_PURPOSE: Final = 1
_DRIFT_PURPOSE: Final = 2
_NO_PLACES: Final = np.empty((0, 0, 2))
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster

# columns of the table of poses: the truth, then what the robot takes for it
_X: Final = 0
_Y: Final = 1
_HEADING: Final = 2
_OWN_X: Final = 3
_OWN_Y: Final = 4
_OWN_HEADING: Final = 5
_COLUMNS: Final = 6

# columns of the table of what the sensors are like
_RANGE: Final = 0
_HALF_FIELD: Final = 1
_OCCLUDE: Final = 2
_DISTANCE_ERROR: Final = 3
_BEARING_ERROR: Final = 4
_BEAM_RANGE: Final = 5
_SLIP: Final = 6
_TURN: Final = 7


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
        self._walls = walls
        self._radii = np.array(radii_m, dtype=np.float64)
        self._frames = np.array(frames, dtype=np.float64).reshape(count, 3)
        self._drifts = settings.odometry_slip > 0.0 or settings.odometry_turn_rad > 0.0
        self._poses = np.zeros((count, _COLUMNS))
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
            ]
        )
        self._key = np.array(streams.draws("senses").key, dtype=np.int64)
        self._places = np.empty((count, count, 2))
        self._period = max(1, round((settings.camera_period_s or 0.0) / to_seconds(tick)))
        self._beams = settings.beams
        self._ticks = 0
        self._sightings: list[tuple[Sighting, ...]] = [()] * count
        self._visible: list[tuple[int, ...]] = [()] * count
        self._views = [_View(self, robot) for robot in range(count)]

    def observe(self, fleet: Fleet) -> list[Observation]:
        """Return what each robot senses now."""
        rows = fleet.observed
        moved = self._drifts and self._ticks > 0
        picture = self._ticks % self._period == 0
        _sense(
            self._poses,
            rows,
            self._frames,
            self._radii,
            self._limits,
            *self._walls,
            self._key,
            self._ticks,
            moved,
            self._places if picture else _NO_PLACES,
        )
        if picture:
            self._sightings = [
                tuple([_new(Sighting, (j, x, y)) for j, (x, y) in enumerate(row) if x == x])
                for row in self._places.tolist()
            ]
            self._visible = [tuple([seen[0] for seen in row]) for row in self._sightings]
        self._ticks += 1
        return [
            _new(Observation, (x, y, heading, speed, arrived > 0.0, blocked > 0.0, visible, sightings, view))
            for (_, _, _, x, y, heading), (_, _, _, speed, arrived, blocked), visible, sightings, view in zip(
                self._poses.tolist(), rows.tolist(), self._visible, self._sightings, self._views, strict=True
            )
        ]

    def sees(self, robot: int, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        """Return which points of the frame of *robot* lie in its visibility region, from where it was observed last."""
        if not points_m:
            return []
        points = np.array(points_m, dtype=np.float64)
        seen: list[bool] = _in_region(self._poses, *self._walls, self._radii, self._limits, robot, points).tolist()
        return seen

    def ranges_m(self, robot: int) -> list[float]:
        """Return how far the beams of *robot* go, in turn of its frame, from where it was observed last."""
        ranges = np.empty(self._beams)
        _scan(self._poses, *self._walls, self._radii, self._limits, robot, ranges)
        found: list[float] = ranges.tolist()
        return found

    def in_world(self, robot: int, command: Command) -> Command:
        """Return *command*, which is meant in the frame of *robot*, in the world's."""
        if not isinstance(command, GoTo):
            return command
        return GoTo(*_to_world(self._poses[robot], command.x_m, command.y_m))


class _View:
    """Where one robot looks from."""

    __slots__ = ("_robot", "_senses")

    def __init__(self, senses: Senses, robot: int) -> None:
        self._senses = senses
        self._robot = robot

    def sees(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        return self._senses.sees(self._robot, points_m)

    def ranges_m(self) -> list[float]:
        return self._senses.ranges_m(self._robot)


@njit(cache=True)
def _uniform(key: Integers, tick: int, link: int, purpose: int) -> tuple[float, float]:
    """Return two numbers in [-1, 1)."""
    words = philox_words(tick & 0xFFFFFFFF, tick >> 32, link, purpose, key[0], key[1])
    return words[0] * 2.0**-31 - 1.0, words[1] * 2.0**-31 - 1.0


@njit(cache=True)
def _sense(
    poses: Floats,
    rows: Floats,
    frames: Floats,
    radii: Floats,
    limits: Floats,
    numbers: Floats,
    members: Ints,
    key: Integers,
    tick: int,
    moved: bool,
    places: Floats,
) -> None:
    """Do :func:`_locate`, and :func:`_see` if there is room for a picture."""
    _locate(poses, rows, frames, limits, key, tick, moved)
    if places.shape[0]:
        _see(poses, unpacked(numbers, members), radii, limits, key, tick, places)


@njit(cache=True)
def _locate(poses: Floats, rows: Floats, frames: Floats, limits: Floats, key: Integers, tick: int, moved: bool) -> None:
    """Write where robots are, and where they take themselves to be: exactly, or, if *moved*, from how they moved."""
    for i in range(poses.shape[0]):
        x, y, heading = rows[i, 0], rows[i, 1], rows[i, 2]
        pose = poses[i]
        if moved:
            dx, dy = x - pose[_X], y - pose[_Y]
            way = math.sqrt(dx * dx + dy * dy)
            slip, turn = _uniform(key, tick, i, _DRIFT_PURPOSE)
            # with the root, what adds up over a metre has the same spread whatever the ticks
            error = limits[_TURN] * turn * math.sqrt(way)
            angle = pose[_OWN_HEADING] - pose[_HEADING] + error
            cos, sin = math.cos(angle), math.sin(angle)
            stretch = 1.0 + limits[_SLIP] * slip
            pose[_OWN_X] += stretch * (cos * dx - sin * dy)
            pose[_OWN_Y] += stretch * (sin * dx + cos * dy)
            pose[_OWN_HEADING] = _wrapped(heading + angle)
        else:
            cos, sin = math.cos(frames[i, 2]), math.sin(frames[i, 2])
            dx, dy = x - frames[i, 0], y - frames[i, 1]
            pose[_OWN_X], pose[_OWN_Y] = cos * dx + sin * dy, cos * dy - sin * dx
            pose[_OWN_HEADING] = _wrapped(heading - frames[i, 2])
        pose[_X], pose[_Y], pose[_HEADING] = x, y, heading


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
def _hidden(poses: Floats, radii: Floats, i: int, j: int, x: float, y: float) -> bool:
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
        if ex * ex + ey * ey < radii[k] * radii[k]:
            return True
    return False


@njit(cache=True)
def _looks_at(
    poses: Floats, grid: SegmentGrid, radii: Floats, limits: Floats, i: int, j: int, x: float, y: float
) -> bool:
    """Return whether robot *i* sees a point of the world, which is robot *j* (or nobody, -1)."""
    dx, dy = x - poses[i, _X], y - poses[i, _Y]
    if dx * dx + dy * dy > limits[_RANGE] * limits[_RANGE]:
        return False
    half_field = limits[_HALF_FIELD]
    if half_field < math.pi and abs(_wrapped(math.atan2(dy, dx) - poses[i, _HEADING])) > half_field:
        return False
    if limits[_OCCLUDE] > 0.0 and _hidden(poses, radii, i, j, x, y):
        return False
    return in_sight(grid, poses[i, _X], poses[i, _Y], x, y)


@njit(cache=True)
def _see(
    poses: Floats, grid: SegmentGrid, radii: Floats, limits: Floats, key: Integers, tick: int, places: Floats
) -> None:
    """Write where each robot sees each other one, in its own frame; NaN where it does not."""
    for i in range(poses.shape[0]):
        for j in range(poses.shape[0]):
            x, y = poses[j, _X], poses[j, _Y]
            if i == j or not _looks_at(poses, grid, radii, limits, i, j, x, y):
                places[i, j] = np.nan
                continue
            dx, dy = x - poses[i, _X], y - poses[i, _Y]
            distance = math.sqrt(dx * dx + dy * dy)
            turn = poses[i, _OWN_HEADING] - poses[i, _HEADING]
            stretch = 1.0
            if limits[_DISTANCE_ERROR] > 0.0 or limits[_BEARING_ERROR] > 0.0:
                far, aside = _uniform(key, tick, i << 16 | j, _SIGHT_PURPOSE)
                stretch += limits[_DISTANCE_ERROR] * far
                turn += math.atan2(radii[j], distance) * limits[_BEARING_ERROR] * aside
            cos, sin = stretch * math.cos(turn), stretch * math.sin(turn)
            places[i, j, 0] = poses[i, _OWN_X] + cos * dx - sin * dy
            places[i, j, 1] = poses[i, _OWN_Y] + sin * dx + cos * dy


@njit(cache=True)
def _in_region(
    poses: Floats, numbers: Floats, members: Ints, radii: Floats, limits: Floats, i: int, points: Floats
) -> Bools:
    """Return which points of the frame of robot *i* it sees."""
    grid = unpacked(numbers, members)
    seen = np.empty(points.shape[0], np.bool_)
    for k in range(points.shape[0]):
        x, y = _to_world(poses[i], points[k, 0], points[k, 1])
        seen[k] = _looks_at(poses, grid, radii, limits, i, -1, x, y)
    return seen


@njit(cache=True)
def _scan(poses: Floats, numbers: Floats, members: Ints, radii: Floats, limits: Floats, i: int, ranges: Floats) -> None:
    """Write how far each beam of robot *i*, in turn of its own frame, meets a wall or a body; inf if it meets none."""
    grid = unpacked(numbers, members)
    limit = limits[_BEAM_RANGE]
    turn = poses[i, _HEADING] - poses[i, _OWN_HEADING]
    for k in range(ranges.shape[0]):
        angle = turn + 2.0 * math.pi * k / ranges.shape[0]
        dx, dy = limit * math.cos(angle), limit * math.sin(angle)
        wall = range_along(grid, poses[i, _X], poses[i, _Y], dx, dy)
        ranges[k] = min(wall, _first_body(poses, radii, i, dx, dy)) * limit


@njit(cache=True)
def _first_body(poses: Floats, radii: Floats, i: int, dx: float, dy: float) -> float:
    """Return at which fraction of the way (dx, dy) from robot *i* another body is met, or inf."""
    first = np.inf
    square = dx * dx + dy * dy
    for k in range(poses.shape[0]):
        if k == i:
            continue
        cx, cy = poses[k, _X] - poses[i, _X], poses[k, _Y] - poses[i, _Y]
        along = cx * dx + cy * dy
        if along <= 0.0:
            continue
        rest = along * along - square * (cx * cx + cy * cy - radii[k] * radii[k])
        if rest >= 0.0:
            part = max(0.0, (along - math.sqrt(rest)) / square)
            if part <= 1.0:
                first = min(first, part)
    return first
