"""All bodies of a run and their motion, tick by tick: structure of arrays, one kernel call a tick.

A tick at time t ends the interval before it and begins the next: ``step`` puts every body where its velocity has taken
it, then chooses the velocities until t + tick, under the limits of the drives and cut where bodies or walls would be
entered. So the pose at any time up to the next tick is known, and a command applied before ``step`` acts from t on.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.errors import LocalProtocolError
from cosim.geometry.segments import SegmentGrid
from cosim.jit import njit
from cosim.machine import Address, Command, GoTo, Observation
from cosim.robots.body import BodySettings
from cosim.robots.contact import fractions
from cosim.robots.drive import ALIGNED_RAD, LAND_M, approach, chord, towards, wrapped
from cosim.units import Time, to_seconds

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""

_NOWHERE: Final[tuple[tuple[Address, ...], ...]] = ()


class _Limits(NamedTuple):
    """What the drives can do, in ways per tick; arrays (n,)."""

    radius: Floats
    way: Floats
    way_change: Floats
    turn: Floats
    turn_change: Floats
    turns_first: Bools


class _Bodies(NamedTuple):
    """State of all bodies: poses at the last tick, ways until the next one; arrays (n,)."""

    x: Floats
    y: Floats
    heading: Floats
    way: Floats
    """Signed length of the path until the next tick, cut at contact."""
    turn: Floats
    next_x: Floats
    next_y: Floats
    going: Bools
    """There is a point to go to; else the wanted way and turn count."""
    goal_x: Floats
    goal_y: Floats
    wanted_way: Floats
    wanted_turn: Floats
    speed: Floats
    """Signed way of the interval that ended."""
    landing: Bools
    """The goal is reached at the next tick."""
    arrived: Bools
    cut: Bools
    """The way until the next tick has been cut."""
    blocked: Bools


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
    ) -> None:
        """Place *bodies* at *starts_m*, shape (n, 2), which must be free (see ``placement``)."""
        count = len(bodies)
        starts = np.asarray(starts_m, dtype=np.float64).reshape(count, 2)
        self.tick = tick
        self.time = start
        """The last tick."""
        self._walls = walls
        self._limits = _limits(bodies, to_seconds(tick))
        heading = np.broadcast_to(np.asarray(headings_rad, np.float64), (count,)).copy()
        self._state = _at_rest(starts, heading)

    def __len__(self) -> int:
        return len(self._state.x)

    def apply(self, commands: Iterable[tuple[int, Command]]) -> None:
        """Take *commands* (body, command) in order; they act from the next :meth:`step` on; a body's last counts.

        Raise LocalProtocolError for a number that is not finite.
        """
        state, seconds = self._state, to_seconds(self.tick)
        for body, command in commands:
            one, two = (
                (command.x_m, command.y_m) if isinstance(command, GoTo) else (command.speed_mps, command.turn_radps)
            )
            if not (math.isfinite(one) and math.isfinite(two)):
                raise LocalProtocolError(f"body {body}: {command} is not finite")
            state.going[body] = isinstance(command, GoTo)
            state.arrived[body] = not state.going[body]
            state.landing[body] = False
            if state.going[body]:
                state.goal_x[body], state.goal_y[body] = one, two
            else:
                state.wanted_way[body], state.wanted_turn[body] = one * seconds, two * seconds

    def step(self) -> None:
        """Move all bodies to the next tick, and choose how they move until the one after it."""
        _step(self._state, self._limits, self._walls)
        self.time += self.tick

    def pose_at(self, body: int, time: Time) -> Pose:
        """Return the pose of *body* at *time* (ns), at constant velocity since the last tick.

        Raise LocalProtocolError for a time before the last tick or after the next.
        """
        if not self.time <= time <= self.time + self.tick:
            raise LocalProtocolError(f"pose at {time} ns, known from {self.time} to {self.time + self.tick} ns")
        state, part = self._state, (time - self.time) / self.tick
        x, y = float(state.x[body]), float(state.y[body])
        heading = wrapped(float(state.heading[body] + part * state.turn[body]))
        if part == 1.0:
            return float(state.next_x[body]), float(state.next_y[body]), heading
        return x + part * float(state.next_x[body] - x), y + part * float(state.next_y[body] - y), heading

    def rests(self, body: int) -> bool:
        """Return whether *body* stays where it is until the next tick."""
        return bool(self._state.way[body] == 0.0)

    @property
    def positions_m(self) -> Floats:
        """A copy of the positions at the last tick, shape (n, 2)."""
        return np.stack((self._state.x, self._state.y), axis=1)

    @property
    def radii_m(self) -> Floats:
        """The radii of the bodies, shape (n,)."""
        return self._limits.radius

    def observations(self, visible: Sequence[tuple[Address, ...]] = _NOWHERE) -> list[Observation]:
        """Return what each body observes at the last tick; *visible* names for each body the others in its sight."""
        state, seconds = self._state, to_seconds(self.tick)
        rows = np.stack(
            (state.x, state.y, state.heading, state.speed / seconds, state.arrived, state.blocked), axis=1
        ).tolist()
        return [
            Observation(x, y, heading, speed, arrived > 0, blocked > 0, visible[body] if visible else ())
            for body, (x, y, heading, speed, arrived, blocked) in enumerate(rows)
        ]


def _limits(bodies: Sequence[BodySettings], seconds: float) -> _Limits:
    return _Limits(
        np.array([body.radius_m for body in bodies]),
        np.array([body.speed_mps * seconds for body in bodies]),
        np.array([body.acceleration_mps2 * seconds**2 for body in bodies]),
        np.array([body.turn_radps * seconds for body in bodies]),
        np.array([body.turn_acceleration_radps2 * seconds**2 for body in bodies]),
        np.array([body.drive == "differential" for body in bodies]),
    )


def _at_rest(starts: Floats, heading: Floats) -> _Bodies:
    def zeros() -> Floats:
        return np.zeros(len(starts))

    def no() -> Bools:
        return np.zeros(len(starts), np.bool_)

    x, y = starts[:, 0].copy(), starts[:, 1].copy()
    return _Bodies(
        x=x,
        y=y,
        heading=heading,
        way=zeros(),
        turn=zeros(),
        next_x=x.copy(),
        next_y=y.copy(),
        going=no(),
        goal_x=zeros(),
        goal_y=zeros(),
        wanted_way=zeros(),
        wanted_turn=zeros(),
        speed=zeros(),
        landing=no(),
        arrived=~no(),
        cut=no(),
        blocked=no(),
    )


@njit(cache=True)
def _step(state: _Bodies, limits: _Limits, walls: SegmentGrid) -> None:
    bodies = state.x.shape[0]
    dx, dy = np.empty(bodies), np.empty(bodies)
    for i in range(bodies):
        _settle(state, i)
        dx[i], dy[i] = _to_goal(state, limits, i) if state.going[i] else _as_wanted(state, limits, i)
    part = fractions(walls, state.x, state.y, dx, dy, limits.radius)
    for i in range(bodies):
        state.cut[i] = part[i] < 1.0
        if state.cut[i]:
            state.way[i] *= part[i]
            state.landing[i] = False
        state.next_x[i] = state.goal_x[i] if state.landing[i] else state.x[i] + part[i] * dx[i]
        state.next_y[i] = state.goal_y[i] if state.landing[i] else state.y[i] + part[i] * dy[i]


@njit(cache=True)
def _settle(state: _Bodies, i: int) -> None:
    """End the interval: the pose is where its motion has led to."""
    state.x[i], state.y[i] = state.next_x[i], state.next_y[i]
    state.heading[i] = wrapped(state.heading[i] + state.turn[i])
    state.speed[i] = state.way[i]
    state.blocked[i] = state.cut[i]
    state.arrived[i] |= state.landing[i]


@njit(cache=True)
def _as_wanted(state: _Bodies, limits: _Limits, i: int) -> tuple[float, float]:
    """Choose way and turn next to what a ``Drive`` asked for; return the straight way of the tick."""
    way = min(max(state.wanted_way[i], -limits.way[i]), limits.way[i])
    turn = min(max(state.wanted_turn[i], -limits.turn[i]), limits.turn[i])
    state.way[i] = towards(way, state.way[i], limits.way_change[i])
    state.turn[i] = towards(turn, state.turn[i], limits.turn_change[i])
    return chord(state.heading[i], state.way[i], state.turn[i])


@njit(cache=True)
def _to_goal(state: _Bodies, limits: _Limits, i: int) -> tuple[float, float]:
    """Choose way and turn towards the goal of a ``GoTo``: stop, turn, then straight; return the way of the tick."""
    goal_x, goal_y = state.goal_x[i] - state.x[i], state.goal_y[i] - state.y[i]
    distance = math.hypot(goal_x, goal_y)
    standing = state.way[i] == 0.0 and state.turn[i] == 0.0
    slower = towards(0.0, state.way[i], limits.way_change[i])
    steadier = towards(0.0, state.turn[i], limits.turn_change[i])
    state.landing[i] = distance <= LAND_M and slower == 0.0 and steadier == 0.0
    if state.landing[i]:
        state.way[i] = state.turn[i] = 0.0
        return goal_x, goal_y
    bearing = math.atan2(goal_y, goal_x)
    if standing and not limits.turns_first[i]:
        state.heading[i] = bearing
    error = wrapped(bearing - state.heading[i])
    astray = abs(error) > ALIGNED_RAD
    passing = distance <= LAND_M  # too fast to stay: a bearing means nothing here
    if astray and not passing and slower == 0.0 and limits.turns_first[i]:
        sign = 1.0 if error > 0.0 else -1.0
        turn = approach(abs(error), sign * state.turn[i], limits.turn[i], limits.turn_change[i])
        state.way[i], state.turn[i] = 0.0, sign * turn
        return 0.0, 0.0
    if astray or passing or steadier != 0.0:
        state.way[i], state.turn[i] = slower, steadier
        return chord(state.heading[i], slower, steadier)
    way = approach(distance, state.way[i], limits.way[i], limits.way_change[i])
    state.way[i], state.turn[i] = way, 0.0
    state.landing[i] = abs(way - distance) <= LAND_M and towards(0.0, way, limits.way_change[i]) == 0.0
    return goal_x * way / distance, goal_y * way / distance
