"""What robots believe, as rows of a trace: their maps as they grow, their ways, where they take themselves to be.

A protocol's spec says by ``believes`` what a machine believes; a body tells its odometry. Both are asked once a tick,
and only if the trace wants to know; neither draws a number nor changes anything, so that a run is the same with and
without. All is told in the world's frame: what is meant in a robot's own frame is put where that frame was in the
beginning, which is where the robot believes that it is. Who was carried off, or has slipped, is elsewhere.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.protocol import Belief, CellMap, PoseEstimate
from cosim.ranges import ranges_of
from cosim.robots.senses import WORLD_FRAME, Frame, Senses
from cosim.trace import BELIEFS, ESTIMATES, MAPS, WAYS, Trace
from cosim.units import Time

COMMON: Final = -1
"""The source of rows about a map that all robots have in common."""
ODOMETRY: Final = "odometry"
MACHINE: Final = "machine"
_NOTHING: Final = Belief()
_NONE: Final = (None, None, None)
"""The columns of a covariance that is not known."""
_STRAIGHT_M2: Final = 1e-6
"""The greatest area between two legs of a way that count as one."""
_STATES: Final = (0, -1, 1)
"""The states of cells, unknown, empty and occupied, in the order of the table's columns."""


class _Told(NamedTuple):
    """What the trace has been told of a map."""

    of: Any
    """The machine's own array: another machine has another one."""
    version: int
    states: np.ndarray[Any, np.dtype[np.int8]]


class Beliefs:
    """What the robots of a run believe, told to its trace tick by tick."""

    def __init__(
        self, trace: Trace, believes: Callable[[Any], Belief] | None, senses: Senses | None, frames: Sequence[Frame]
    ) -> None:
        """Ask machines by *believes*, and the *senses* for odometry; *frames* are the robots' own in the beginning."""
        self._trace = trace
        self._believes = believes
        self._senses = None if senses is None or senses.aware else senses
        self._frames = frames
        self._maps: dict[int, _Told] = {}
        self._ways: dict[int, tuple[Any, ...]] = {}
        told = believes is not None or self._senses is not None
        self.wanted = told and any(trace.wants(table) for table in BELIEFS)
        """Whether there is anything to tell, and anybody who wants to know."""

    def note(self, machines: Sequence[Any], alive: Sequence[bool], now: Time) -> None:
        """Tell the trace what has changed; a robot that is not *alive* means to go nowhere."""
        if self._senses is not None and self._trace.wants(ESTIMATES):
            for robot, pose in enumerate(self._senses.own_poses.tolist()):
                place = in_world(self._frames[robot], pose[:2])
                self._trace.row(ESTIMATES, now, robot, ODOMETRY, *place, _turned(self._frames[robot], pose[2]), *_NONE)
        if self._believes is None:
            return
        for robot, machine in enumerate(machines):
            belief = self._believes(machine) if alive[robot] else _NOTHING
            frame = WORLD_FRAME if belief.frame == "world" else self._frames[robot]
            if belief.map is not None:
                self._note_map(COMMON if belief.map.common else robot, belief.map, frame, now)
            self._note_way(robot, belief, frame, now)
            if belief.estimate is not None:
                self._trace.row(ESTIMATES, now, robot, MACHINE, *_placed(belief.estimate, frame))

    def _note_map(self, source: int, known: CellMap, frame: Frame, now: Time) -> None:
        told = self._maps.get(source)
        if told is not None and told.of is known.cells and told.version == known.version:
            return
        states = np.sign(known.cells)
        before = np.zeros_like(states) if told is None or told.states.shape != states.shape else told.states
        self._maps[source] = _Told(known.cells, known.version, states)
        changed = np.flatnonzero(states != before)
        if not len(changed) and told is not None:
            return
        now_are = states.flat[changed]
        rows, columns = states.shape
        corner = in_world(frame, known.corner_m)
        cells = (ranges_of(changed[now_are == state]) for state in _STATES)
        self._trace.row(MAPS, now, source, *corner, frame[2], known.cell_m, columns, rows, *cells)

    def _note_way(self, robot: int, belief: Belief, frame: Frame, now: Time) -> None:
        goal = (None, None) if belief.goal_m is None else in_world(frame, belief.goal_m)
        way = points_of(corners_of([in_world(frame, point) for point in belief.way_m])), *goal
        if way != self._ways.get(robot, ("", None, None)):
            self._ways[robot] = way
            self._trace.row(WAYS, now, robot, *way)


# ---------------------------------------------------------------- frames


def in_world(frame: Frame, place_m: Sequence[float]) -> tuple[float, float]:
    """Return where a place of a robot's own *frame* is in the world."""
    x, y = float(place_m[0]), float(place_m[1])
    if frame == WORLD_FRAME:
        return x, y
    cos, sin = elementary.cos(frame[2]), elementary.sin(frame[2])
    return frame[0] + cos * x - sin * y, frame[1] + sin * x + cos * y


def _turned(frame: Frame, heading_rad: float) -> float:
    return math.remainder(heading_rad + frame[2], math.tau)


def _placed(estimate: PoseEstimate, frame: Frame) -> tuple[float | None, ...]:
    """Return the columns of an estimate in the world's frame."""
    x, y, heading, xx, xy, yy = map(float, estimate)
    place = *in_world(frame, (x, y)), _turned(frame, heading)
    if math.isnan(xx + xy + yy):
        return *place, *_NONE
    cos, sin = elementary.cos(frame[2]), elementary.sin(frame[2])
    across = 2.0 * cos * sin * xy
    turned_xy = cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy
    return *place, cos * cos * xx - across + sin * sin * yy, turned_xy, sin * sin * xx + across + cos * cos * yy


# ---------------------------------------------------------------- ways


def corners_of(way_m: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points of a way without those that it passes straight."""
    corners: list[tuple[float, float]] = []
    for at, (x, y) in enumerate(way_m):
        if corners and at + 1 < len(way_m):
            (last_x, last_y), (next_x, next_y) = corners[-1], way_m[at + 1]
            dx, dy, on_x, on_y = x - last_x, y - last_y, next_x - x, next_y - y
            if abs(dx * on_y - dy * on_x) < _STRAIGHT_M2 and dx * on_x + dy * on_y > 0.0:
                continue
        corners.append((x, y))
    return corners


def points_of(way_m: Iterable[tuple[float, float]]) -> str:
    """Return the points of a way as text, in mm: ``0.500 1.250, 2.000 1.250``."""
    return ", ".join(f"{x:.3f} {y:.3f}" for x, y in way_m)


def way_of(points: str) -> list[list[float]]:
    """Return the points that ``points_of`` has made text of."""
    return [[float(value) for value in point.split()] for point in points.split(", ")] if points else []
