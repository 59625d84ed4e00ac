"""What robots sense: where they are in their own frames, where they see each other, and how far the walls are.

A robot's frame F_i is odometry: it begins where the scenario has it and, with a drift, turns and stretches as the robot
drives. What a robot sees lies relative to its body, so it is given in F_i by where the robot takes itself to be.

The camera measures another robot's distance d and direction alpha with the errors of Sgorbissa and Arkin ("Local
navigation strategies for a team of robots", section 6.1, equations 1 and 2): d (1 + U[-e, e]), and alpha plus the angle
under which half of the other's body appears, times U[-b, b]. The paper has b = 1.

The range scanner measures where each of a ring of beams meets a wall or a body first: with normal noise, which makes it
miss what it would measure beyond its range, and with false returns, which may be any range up to its own.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import chain
from struct import Struct
from typing import Final, Literal, TypeAlias

import numpy as np
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.segments import PackedWalls
from cosim.machine import Command, GoTo
from cosim.observation import Marks, Observation, View
from cosim.randomness import Streams
from cosim.robots.motion import Carry, Fleet, observations
from cosim.robots.pictures import Cameras, pictures
from cosim.robots.sense_kernels import (
    BLIND,
    BLOCKED,
    COLUMNS,
    FRAME_TURN,
    FRAME_X,
    HEADING,
    OWN_HEADING,
    OWN_X,
    OWN_Y,
    RADIUS,
    Room,
    X,
    Y,
    few_in_region,
    in_region,
    locate,
    scan,
    sees_mark,
)
from cosim.settings import Angle, Metres, Seconds, Settings
from cosim.units import Time, to_seconds

Frame: TypeAlias = tuple[float, float, float]
"""Origin (x, y, m) and direction (rad) in the world."""

WORLD_FRAME: Final[Frame] = (0.0, 0.0, 0.0)
_POINTS: Final = 16
"""Number of points that fit at first."""
_FEW: Final = 2
"""Number of points that are passed as numbers."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class SenseSettings(Settings):
    """Parameters of the robots' sensors and of what they know of their own place."""

    frames: Literal["world", "own"] = Field(
        default="world", description="whose frame a robot knows: the world's, or its own, begun at an unknown place"
    )
    odometry_slip: float = Field(
        default=0.0, ge=0, lt=1, description="share by which a metre of odometry is wrong: uniform, new every tick"
    )
    odometry_turn_rad: Angle = Field(
        default=0.0, ge=0, description="rad, by which a tick's way of one metre turns the heading wrongly, at most"
    )
    odometry_way_m: Metres | None = Field(
        default=None,
        gt=0,
        description="m, a tick's way at which odometry errs so; its errors are in proportion to a tick's way, and so "
        "grow with the speed; null: they are the same at any speed",
    )
    field_of_view_deg: float = Field(
        default=360.0, gt=0, le=360, description="degrees, the camera's field of view, about the heading"
    )
    camera_period_s: Seconds | None = Field(
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
    beam_range_m: Metres = Field(default=2.5, gt=0, description="m, how far they reach")
    range_noise_m: Metres = Field(default=0.0, ge=0, description="m, standard deviation of a range that is measured")
    false_return_rate: float = Field(
        default=0.0, ge=0, le=1, description="share of the beams that tell a uniform range, whatever is there"
    )

    @property
    def drifts(self) -> bool:
        """True if odometry errs."""
        return self.odometry_slip > 0.0 or self.odometry_turn_rad > 0.0


class Senses:
    """The sensors of all robots of a run; read once a tick, after the robots have moved."""

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
        self._drifts = settings.drifts
        self.aware = settings.frames == "world" and not self._drifts
        """True if a robot knows where it is, also if it has been carried there: odometry would not notice."""
        self._poses = np.zeros((count, COLUMNS))
        self._poses[:, FRAME_X : FRAME_TURN + 1] = frames
        self._poses[:, RADIUS] = radii_m
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
                settings.range_noise_m,
                settings.false_return_rate,
                *streams.draws("senses").key,
                settings.odometry_way_m or 0.0,
            ]
        )
        self._room = self._poses, self._limits, *walls
        self._period = max(1, round((settings.camera_period_s or 0.0) / to_seconds(tick)))
        self._ticks = 0
        self._told = self._poses[:, OWN_X : BLOCKED + 1].T
        self._scanner = _Scanner(self._room, settings.beams)
        self._views = [_View(self._room, robot, self._scanner) for robot in range(count)]
        self._show(Cameras(self._room, 0))

    def observe(self, fleet: Fleet) -> list[Observation]:
        """Return what each robot senses now."""
        locate(self._poses, self._limits, fleet.observed, self._ticks, self._drifts and self._ticks > 0)
        if self._ticks % self._period == 0:
            self._show(Cameras(self._room, self._ticks))
        self._scanner.begin(self._ticks)
        self._ticks += 1
        return observations(self._told, self._pictures, self._views)

    @property
    def poses(self) -> Floats:
        """All that the sensors know of where robots are at this tick: for :meth:`view_from`."""
        return self._poses

    def view_from(self, robot: int, poses: Floats, tick: int) -> View:
        """Return where *robot* looks from if all robots are where the *poses* of such senses at a *tick* say.

        For a process that has these senses as they were in the beginning.
        """
        self._poses[:] = poses
        self._scanner.begin(tick)
        return self._views[robot]

    @property
    def own_poses(self) -> Floats:
        """Where robots take themselves to be, each in its own frame: x and y (m), heading (rad), shape (n, 3)."""
        return self._poses[:, OWN_X : OWN_HEADING + 1]

    def ranges_from(self, robot: int, poses: Floats, turned_rad: Floats, tick: int) -> Floats:
        """Return what the scanner of *robot* reads at a *tick* if all robots are at *poses* (n, 3) of the world then.

        *turned_rad* (n,) is the angle by which the frame of each one's odometry is turned against the world's. For who
        looks on, with senses of his own.
        """
        self._poses[:, X : HEADING + 1] = poses
        self._poses[:, OWN_HEADING] = poses[:, 2] - turned_rad
        self._scanner.begin(tick)
        return self._views[robot].ranges_m()

    def _show(self, seen: Cameras) -> None:
        self._seen = seen
        self._pictures = pictures(seen, len(self._poses))

    def blind(self, robot: int, blind: bool) -> None:
        """Switch the camera of *robot* off, and forget its last picture; or on, to see from the next picture on."""
        self._poses[robot, BLIND] = blind
        if blind:
            self._show(self._seen.without(robot))

    def carry(self, robot: int, carried: Carry) -> None:
        """Have *robot* carried away at this tick, before it senses: what an unaware one knows goes along."""
        if not self.aware:
            for first in (X, FRAME_X):
                own = self._poses[robot, first : first + 3]
                own[:] = carried.pose(*own.tolist())

    def in_world(self, robot: int, command: Command) -> Command:
        """Return *command*, which is meant in the frame of *robot*, in the world's."""
        if not isinstance(command, GoTo):
            return command
        x, y, heading, own_x, own_y, own_heading, *_ = self._poses[robot].tolist()
        cos, sin = elementary.cos(heading - own_heading), elementary.sin(heading - own_heading)
        dx, dy = command[0] - own_x, command[1] - own_y
        return _new(GoTo, (x + cos * dx - sin * dy, y + sin * dx + cos * dy))


class _Scanner:
    """The range scanners of all robots.

    Who has asked for scans at the last two ticks is taken to do so again: one call for all is a small part of a call
    for each.
    """

    def __init__(self, room: Room, beams: int) -> None:
        self._room = room
        self._ways, self._turned = np.empty((beams, 2)), np.array([math.nan])
        self._tick = 0
        self._scanned: set[int] = set()
        """Who has been scanned for at this tick."""
        self._scans: dict[int, Floats] = {}
        """Their scans that nobody has asked for yet."""
        self._asked: set[int] = set()
        """Who has asked at the tick before."""
        self._expected: set[int] = set()

    def begin(self, tick: int) -> None:
        """Begin a tick."""
        self._tick = tick
        asked = self._scanned - self._scans.keys()
        self._expected = asked & self._asked
        self._asked, self._scanned, self._scans = asked, set(), {}

    def ranges_m(self, robot: int) -> Floats:
        """Return the ranges of *robot* at this tick, an array of its own."""
        ranges = self._scans.pop(robot, None)
        if ranges is None:
            expected = robot in self._expected and robot not in self._scanned
            robots = [*self._expected] if expected else [robot]
            self._scanned.update(robots)
            scans = np.empty((len(robots), len(self._ways)))
            scan(*self._room, self._tick, np.array(robots), self._ways, self._turned, scans)
            self._scans.update(zip(robots, scans, strict=True))
            ranges = self._scans.pop(robot)
        return ranges


class _View:
    """Where one robot looks from."""

    __slots__ = ("_points", "_pose", "_robot", "_room", "_seen", "ranges_m")

    def __init__(self, room: Room, robot: int, scanner: _Scanner) -> None:
        self._room = room
        self._robot = robot
        self._pose = room[0][robot].data  # its cells are read fastest so
        self.ranges_m = partial(scanner.ranges_m, robot)
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
        seen = few_in_region(*self._room, self._robot, count, x, y, other_x, other_y)
        return [seen > 1] if count == 1 else [seen > 1, seen % 2 > 0]

    def detects(self, marks_m: Marks, range_m: float) -> list[tuple[float, float] | None]:
        here = self._pose[X], self._pose[Y]
        return [self._detected(mark) if math.dist(here, mark) <= range_m else None for mark in marks_m]

    def _detected(self, mark_m: tuple[float, float]) -> tuple[float, float] | None:
        """Return where a mark that is in range appears in the robot's frame; None if the robot does not see it."""
        if not sees_mark(*self._room, self._robot, *mark_m):
            return None
        pose = self._pose
        turn = pose[OWN_HEADING] - pose[HEADING]
        more_cos, sin = elementary.cos(turn) - 1.0, elementary.sin(turn)
        dx, dy = mark_m[0] - pose[X], mark_m[1] - pose[Y]
        # so that who knows its pose sees it just where it is, without rounding
        return (
            mark_m[0] + (pose[OWN_X] - pose[X]) + (more_cos * dx - sin * dy),
            mark_m[1] + (pose[OWN_Y] - pose[Y]) + (sin * dx + more_cos * dy),
        )

    def _sees_many(self, points_m: Sequence[tuple[float, float]]) -> list[bool]:
        count = len(points_m)
        if count > len(self._seen):
            self._points, self._seen = np.empty(4 * count), np.empty(2 * count, np.bool_)
        _layout(2 * count)(self._points.data, 0, *chain.from_iterable(points_m))  # half the time of np.array
        in_region(*self._room, self._robot, self._points, self._seen, count)
        seen: list[bool] = self._seen[:count].tolist()
        return seen


@cache
def _layout(count: int) -> Callable[..., None]:
    return Struct(f"{count}d").pack_into
