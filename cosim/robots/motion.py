"""All bodies of a run and their motion, tick by tick: structure of arrays, one kernel call a tick.

A tick at time t ends the interval before it and begins the next: ``step`` puts every body where its velocity has taken
it, then chooses the velocities until t + tick, under the limits of the drives and cut where bodies or walls would be
entered. So the pose at any time up to the next tick is known, and a command applied before ``step`` acts from t on.

State and limits are the rows of one array (see ``table``).

Within a tick the velocity is constant, so everything counts in ways per tick: a way u, at most the speed limit's way,
that changes from tick to tick by at most h = a T^2. From u a body can stop after u, then u - h, u - 2h and so on down
to 0. The greatest u from which it stops within a distance D follows in closed form: m ways are together
m u - h m (m - 1) / 2, hence u = D / m + h (m - 1) / 2 for the least m with D <= h m (m + 1) / 2. A body that takes this
u tick after tick brakes by exactly h a tick at the end, and its last way ends on the goal. Angles are treated alike.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

import cosim.elementary as elementary
from cosim.arrays import Floats, Int32s, Int64s
from cosim.errors import LocalProtocolError
from cosim.geometry.segments import SegmentGrid, packed_walls
from cosim.jit import njit
from cosim.machine import Command, GoTo
from cosim.observation import NOBODY, Observation, Picture, View
from cosim.robots.body import BodySettings
from cosim.robots.contact import BODY_SLACK_M, FEW, all_pairs, cut, pairs_near
from cosim.robots.table import (
    ANY_WAY,
    ARRIVED,
    BLOCKED,
    CUT,
    DX,
    DY,
    FROZEN,
    GOAL_X,
    GOAL_Y,
    GOING,
    GUIDED,
    HEADING,
    LANDING,
    MOST_TURN,
    MOST_WAY,
    NEXT_X,
    NEXT_Y,
    OBSERVED,
    PART,
    RADIUS,
    ROOM,
    ROWS,
    SECONDS,
    SPEED,
    TURN,
    TURN_CHANGE,
    TURNS_FIRST,
    WANTED_TURN,
    WANTED_WAY,
    WAY,
    WAY_CHANGE,
    X,
    Y,
)
from cosim.robots.trajectories import Paths, turned
from cosim.units import Time, to_seconds

Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""

LAND_M: Final = 1e-9
"""Distance from its goal at which a body that would end a tick there ends it on the goal."""
ALIGNED_RAD: Final = 1e-9
"""Difference between heading and the goal's bearing that needs no turn."""
_ROUNDING: Final = 1e-9
"""Share of h by which a change of the way may exceed it, so that rounding costs no tick."""
_ORDERS: Final = (LANDING, GOING, ARRIVED, GOAL_X, GOAL_Y, WANTED_WAY, WANTED_TURN)
"""The rows that commands change."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class Carry(NamedTuple):
    """The rigid motion of the plane that brings a body from one pose to another."""

    before: Pose
    after: Pose

    def pose(self, x_m: float, y_m: float, heading_rad: float) -> Pose:
        """Return where a pose gets that is carried along."""
        turn = self.after[2] - self.before[2]
        cos, sin = elementary.cos(turn), elementary.sin(turn)
        dx, dy = x_m - self.before[0], y_m - self.before[1]
        return self.after[0] + cos * dx - sin * dy, self.after[1] + sin * dx + cos * dy, heading_rad + turn


class Fleet:
    """The bodies of a run, numbered from 0, at rest in the beginning."""

    def __init__(
        self,
        bodies: Sequence[BodySettings],
        starts_m: npt.ArrayLike,
        walls: SegmentGrid,
        tick: Time,
        start: Time = 0,
        headings_rad: npt.ArrayLike = 0.0,
        paths: Paths | None = None,
    ) -> None:
        """Place *bodies* at *starts_m*, shape (n, 2), which must be free (see ``placement``).

        Those that have *paths* follow them, whatever they are told and whatever is in their way.
        """
        count = len(bodies)
        starts = np.asarray(starts_m, dtype=np.float64).reshape(count, 2)
        self.tick = tick
        self._seconds = to_seconds(tick)
        self.time = start
        """Time of the last tick."""
        self._wall_numbers, self._wall_members = packed_walls(walls)
        self._table = np.zeros((ROWS, count))
        self._table[X], self._table[Y] = self._table[NEXT_X], self._table[NEXT_Y] = starts.T
        self._table[HEADING] = headings_rad
        self._table[ARRIVED] = 1.0
        self._orders: list[Any] = [self._table[row].data for row in _ORDERS]  # their cells are written fastest so
        _write_limits(self._table, bodies, self._seconds)
        self._observed = self._table[:OBSERVED].T
        self.x_m: Floats = self._table[X]
        """The positions at the last tick, x alone, shape (n,); not to be changed."""
        self.y_m: Floats = self._table[Y]
        self._positions, self._spare = starts.copy(), starts.copy()
        self._pairs = all_pairs(count) if count <= FEW else None
        self._paths = paths
        if paths is not None:
            self._table[GUIDED, paths.bodies] = 1.0
            self._guide(paths, start)
            self._arrive(paths, start + tick)

    def __len__(self) -> int:
        return self._table.shape[1]

    def apply(self, commands: Iterable[tuple[int, Command]]) -> None:
        """Take *commands* (body, command) in order; they act from the next :meth:`step` on; a body's last counts.

        Raise LocalProtocolError for a number that is not finite.
        """
        landing, going, arrived, goal_x, goal_y, wanted_way, wanted_turn = self._orders
        seconds, isfinite = self._seconds, math.isfinite
        for body, command in commands:
            one, two = command
            if not (isfinite(one) and isfinite(two)):
                raise LocalProtocolError(f"body {body}: {command} is not finite")
            landing[body] = 0.0
            if isinstance(command, GoTo):
                going[body], arrived[body] = 1.0, 0.0
                goal_x[body], goal_y[body] = one, two
            else:
                going[body], arrived[body] = 0.0, 1.0
                wanted_way[body], wanted_turn[body] = one * seconds, two * seconds

    def step(self) -> float:
        """Move all bodies to the next tick, and choose how they move until the one after it.

        Return the way that all bodies together have gone since the tick before, in metres.
        """
        self._positions, self._spare = self._spare, self._positions
        gone: float
        if self._paths is not None:
            now, pairs = self.time + self.tick, self._pairs
            gone = _choose(self._table, self._positions)
            self._guide(self._paths, now)
            pairs = pairs_near(self._table) if pairs is None else pairs
            _end(self._table, pairs, self._wall_numbers, self._wall_members)
            self._arrive(self._paths, now + self.tick)
        elif self._pairs is not None:
            gone = _step(self._table, self._positions, self._pairs, self._wall_numbers, self._wall_members)
        else:
            gone = _choose(self._table, self._positions)
            _end(self._table, pairs_near(self._table), self._wall_numbers, self._wall_members)
        self.time += self.tick
        return gone

    def _guide(self, paths: Paths, now: Time) -> None:
        """Have the bodies that follow *paths* go, from *now* to the next tick, to where they are then."""
        table, bodies = self._table, paths.bodies
        x, y, heading = paths.at(now)
        next_x, next_y, next_heading = paths.at(now + self.tick)
        table[HEADING, bodies], table[TURN, bodies] = heading, turned(next_heading - heading)
        table[DX, bodies], table[DY, bodies] = next_x - x, next_y - y
        table[WAY, bodies] = elementary.hypots(next_x - x, next_y - y)
        table[LANDING, bodies] = 0.0

    def _arrive(self, paths: Paths, then: Time) -> None:
        """Write where the bodies that follow *paths* are at the next tick, *then*: exactly there."""
        self._table[NEXT_X, paths.bodies], self._table[NEXT_Y, paths.bodies], _ = paths.at(then)

    def pose_at(self, body: int, time: Time) -> Pose:
        """Return the pose of *body* at *time* (ns), at constant velocity since the last tick.

        Raise LocalProtocolError for a time before the last tick or after the next.
        """
        if not self.time <= time <= self.time + self.tick:
            raise LocalProtocolError(f"pose at {time} ns, known from {self.time} to {self.time + self.tick} ns")
        own, part = self._table[:, body].tolist(), (time - self.time) / self.tick
        heading = wrapped(own[HEADING] + part * own[TURN])
        if part == 1.0:
            return own[NEXT_X], own[NEXT_Y], heading
        x, y = own[X], own[Y]
        return x + part * (own[NEXT_X] - x), y + part * (own[NEXT_Y] - y), heading

    def freeze(self, body: int, frozen: bool) -> None:
        """Have *body* brake from the next :meth:`step` on, and stand; or follow its last command again."""
        self._table[FROZEN, body] = frozen

    def carry(self, body: int, carried: Carry, unaware: bool) -> bool:
        """Have *body* stand at another pose at the coming tick, of which this is the instant, before the :meth:`step`.

        The way that it has gone counts. If the robot is *unaware* of it, the goal of its last ``GoTo`` goes along.
        Return whether there is room between the other bodies; if not, nothing has happened.
        """
        own, (x, y, heading) = self._table[:, body], carried.after
        apart = elementary.hypots(self._table[NEXT_X] - x, self._table[NEXT_Y] - y) - self._table[RADIUS] - own[RADIUS]
        apart[body] = 0.0
        if (apart < -BODY_SLACK_M).any():
            return False
        own[X], own[Y], _ = carried.pose(*own[[X, Y, HEADING]].tolist())
        if unaware:
            own[GOAL_X], own[GOAL_Y], _ = carried.pose(*own[[GOAL_X, GOAL_Y, HEADING]].tolist())
        own[NEXT_X], own[NEXT_Y], own[HEADING] = x, y, heading
        own[[WAY, TURN, LANDING, CUT, ROOM]] = 0.0
        return True

    def way_m(self, body: int) -> float:
        """Return how far *body* goes from the last tick to the next, in metres."""
        own = self._table[:, body]
        return math.hypot(own[NEXT_X] - own[X], own[NEXT_Y] - own[Y])

    def rests(self, body: int) -> bool:
        """Return whether *body* stays where it is until the next tick, or follows a path: it does not go by itself."""
        return bool(self._table[WAY, body] == 0.0 or self._table[GUIDED, body])

    @property
    def positions_m(self) -> Floats:
        """The positions at the last tick, shape (n, 2); not to be changed, and others from the next step but one on."""
        return self._positions

    @property
    def radii_m(self) -> Floats:
        """The radii of the bodies, shape (n,)."""
        radii: Floats = self._table[RADIUS]
        return radii

    @property
    def observed(self) -> Floats:
        """What each body observes of itself at the last tick: rows x, y, heading, speed, arrived, blocked."""
        return self._observed

    def observations(self, pictures: Sequence[Picture] = ()) -> list[Observation]:
        """Return what each body observes at the last tick, with the *pictures* of their cameras, if they have any."""
        return observations(self._table[:OBSERVED], pictures or [NOBODY] * len(self), [None] * len(self))


def observations(told: Floats, pictures: Sequence[Picture], views: Sequence[View | None]) -> list[Observation]:
    """Return the observations of all robots: *told* has the rows x, y, heading, speed, arrived, blocked.

    Without a loop in Python, as every robot has one at every tick.
    """
    x, y, heading, speed, arrived, blocked = told.tolist()
    fields = zip(x, y, heading, speed, map(bool, arrived), map(bool, blocked), pictures, views, strict=True)
    return list(map(_new, repeat(Observation), fields))


def _write_limits(table: Floats, bodies: Sequence[BodySettings], seconds: float) -> None:
    table[RADIUS] = [body.radius_m for body in bodies]
    table[MOST_WAY] = [body.speed_mps * seconds for body in bodies]
    table[WAY_CHANGE] = [body.acceleration_mps2 * (seconds * seconds) for body in bodies]
    table[MOST_TURN] = [body.turn_radps * seconds for body in bodies]
    table[TURN_CHANGE] = [body.turn_acceleration_radps2 * (seconds * seconds) for body in bodies]
    table[TURNS_FIRST] = [body.drive == "differential" for body in bodies]
    table[ANY_WAY] = [body.drive == "omni" for body in bodies]
    table[SECONDS] = seconds


@njit(cache=True, borrows=True)
def braking_way(distance: float, change: float) -> float:
    """Return the greatest way of the next tick from which one can stop within *distance*, losing *change* a tick."""
    ticks = max(1.0, math.ceil((math.sqrt(1.0 + 8.0 * distance / change) - 1.0) / 2.0))
    return distance / ticks + change * (ticks - 1.0) / 2.0


@njit(cache=True, borrows=True)
def approach(distance: float, last: float, most: float, change: float) -> float:
    """Return the next way towards a goal *distance* ahead; *last* was the way before, negative if it led back."""
    return max(min(braking_way(distance, change), most, last + change), last - change)


@njit(cache=True, borrows=True)
def towards(wanted: float, last: float, change: float) -> float:
    """Return the way nearest to *wanted* that differs from *last* by no more than *change*."""
    slack = change * (1.0 + _ROUNDING)
    if abs(wanted - last) <= slack:
        return wanted
    return last + change if wanted > last else last - change


@njit(cache=True, borrows=True)
def wrapped(angle: float) -> float:
    """Return *angle* (radians) in [-pi, pi]; an angle that lies there already is not changed."""
    if -math.pi <= angle <= math.pi:
        return angle
    return elementary.atan2(elementary.sin(angle), elementary.cos(angle))


@njit(cache=True, borrows=True)
def chord(heading: float, way: float, turn: float) -> tuple[float, float]:
    """Return the straight way (x, y) that joins the ends of an arc of length *way* that begins along *heading*."""
    half = 0.5 * turn
    length = way if half == 0.0 else way * elementary.sin(half) / half
    return length * elementary.cos(heading + half), length * elementary.sin(heading + half)


@njit(cache=True, borrows=True)
def _step(table: Floats, positions: Floats, pairs: Int64s, wall_numbers: Floats, wall_members: Int32s) -> float:
    gone = _choose(table, positions)
    _end(table, pairs, wall_numbers, wall_members)
    return gone


@njit(cache=True, borrows=True)
def _choose(table: Floats, positions: Floats) -> float:
    """End the interval before, and choose the ways of the next; return the way that all have gone."""
    gone = _settle(table)
    for i in range(table.shape[1]):
        positions[i, 0], positions[i, 1] = table[X, i], table[Y, i]
        if table[FROZEN, i]:
            table[DX, i], table[DY, i] = _brake(table, i)
        else:
            table[DX, i], table[DY, i] = _to_goal(table, i) if table[GOING, i] else _as_wanted(table, i)
    return gone


@njit(cache=True, borrows=True)
def _end(table: Floats, pairs: Int64s, wall_numbers: Floats, wall_members: Int32s) -> None:
    """Cut the ways that have been chosen, and write where they lead to."""
    cut(table, pairs, wall_numbers, wall_members)
    for i in range(table.shape[1]):
        part = table[PART, i]
        table[CUT, i] = part < 1.0
        if part < 1.0:
            table[WAY, i] *= part
            table[LANDING, i] = 0.0
        landing = table[LANDING, i] > 0.0
        table[NEXT_X, i] = table[GOAL_X, i] if landing else table[X, i] + part * table[DX, i]
        table[NEXT_Y, i] = table[GOAL_Y, i] if landing else table[Y, i] + part * table[DY, i]


@njit(cache=True, borrows=True)
def _settle(table: Floats) -> float:
    """End the interval: poses are where their motions have led to. Return the way that all have gone."""
    gone = 0.0
    for i in range(table.shape[1]):
        x, y = table[NEXT_X, i], table[NEXT_Y, i]
        gone_x, gone_y = x - table[X, i], y - table[Y, i]
        gone += math.sqrt(gone_x * gone_x + gone_y * gone_y)
        table[X, i], table[Y, i] = x, y
        table[HEADING, i] = wrapped(table[HEADING, i] + table[TURN, i])
        table[SPEED, i] = table[WAY, i] / table[SECONDS, i]
        table[BLOCKED, i] = table[CUT, i]
        table[ARRIVED, i] = max(table[ARRIVED, i], table[LANDING, i])
    return gone


@njit(cache=True, borrows=True)
def _brake(table: Floats, i: int) -> tuple[float, float]:
    """Choose way and turn next to standing still; return the straight way of the tick."""
    table[LANDING, i] = 0.0
    table[WAY, i] = towards(0.0, table[WAY, i], table[WAY_CHANGE, i])
    table[TURN, i] = towards(0.0, table[TURN, i], table[TURN_CHANGE, i])
    return chord(table[HEADING, i], table[WAY, i], table[TURN, i])


@njit(cache=True, borrows=True)
def _as_wanted(table: Floats, i: int) -> tuple[float, float]:
    """Choose way and turn next to what a ``Drive`` asked for; return the straight way of the tick."""
    way = min(max(table[WANTED_WAY, i], -table[MOST_WAY, i]), table[MOST_WAY, i])
    turn = min(max(table[WANTED_TURN, i], -table[MOST_TURN, i]), table[MOST_TURN, i])
    table[WAY, i] = towards(way, table[WAY, i], table[WAY_CHANGE, i])
    table[TURN, i] = towards(turn, table[TURN, i], table[TURN_CHANGE, i])
    return chord(table[HEADING, i], table[WAY, i], table[TURN, i])


@njit(cache=True, borrows=True)
def _to_goal(table: Floats, i: int) -> tuple[float, float]:
    """Choose way and turn towards the goal of a ``GoTo``: stop, turn, then straight; return the way of the tick."""
    goal_x, goal_y = table[GOAL_X, i] - table[X, i], table[GOAL_Y, i] - table[Y, i]
    distance = elementary.hypot(goal_x, goal_y)
    slower = towards(0.0, table[WAY, i], table[WAY_CHANGE, i])
    steadier = towards(0.0, table[TURN, i], table[TURN_CHANGE, i])
    passing = distance <= LAND_M  # if it is too fast to stay: a bearing means nothing here
    if passing and slower == 0.0 and steadier == 0.0:
        table[WAY, i] = table[TURN, i] = 0.0
        table[LANDING, i] = 1.0
        return goal_x, goal_y
    table[LANDING, i] = 0.0
    bearing = elementary.atan2(goal_y, goal_x)
    still = table[WAY, i] == 0.0 and table[TURN, i] == 0.0
    if table[ANY_WAY, i] or (still and not table[TURNS_FIRST, i]):
        table[HEADING, i] = bearing
    error = wrapped(bearing - table[HEADING, i])
    astray = abs(error) > ALIGNED_RAD
    if astray and not passing and slower == 0.0 and table[TURNS_FIRST, i]:
        sign = 1.0 if error > 0.0 else -1.0
        turn = approach(abs(error), sign * table[TURN, i], table[MOST_TURN, i], table[TURN_CHANGE, i])
        table[WAY, i], table[TURN, i] = 0.0, sign * turn
        return 0.0, 0.0
    if astray or passing or steadier != 0.0:
        table[WAY, i], table[TURN, i] = slower, steadier
        return chord(table[HEADING, i], slower, steadier)
    way = approach(distance, table[WAY, i], table[MOST_WAY, i], table[WAY_CHANGE, i])
    table[WAY, i], table[TURN, i] = way, 0.0
    table[LANDING, i] = abs(way - distance) <= LAND_M and towards(0.0, way, table[WAY_CHANGE, i]) == 0.0
    return goal_x * way / distance, goal_y * way / distance
