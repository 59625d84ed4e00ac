"""A robot's double: what it would order, where it is, had no other robot been there since it set off.

It measures interference (:mod:`protocols.deployment.interference`), and moves nobody. At every tick it stands where
the robot stands, but faces where it has itself turned to, at the speed that it has itself come to; it follows the field
of the bare map, and meets no bodies. Alone, a robot and its double go at the same speed.
"""

import math
from typing import Final

import numpy as np

from cosim.navigation.dwa import (
    BODY_COLUMNS,
    CLEAR,
    HEADING,
    MARGIN,
    MOST_WAY,
    RADIUS,
    TURN,
    TURN_CHANGE,
    WAY,
    WAY_CHANGE,
    X,
    Y,
    braking_way,
    choose,
    chord,
    stopping_m,
    towards,
    walls_near,
)
from cosim.navigation.schemas import Floats
from protocols.deployment.driving_parameters import DrivingParameters
from protocols.deployment.floor import Floor
from protocols.deployment.plan import Place

ROUNDING: Final = 1e-9
"""Headings and turns, rad, that are as near to each other are the same."""
_NOTHING: Final = (0, 2)
_NOBODY: Final = (0, BODY_COLUMNS)


class Double:
    """What one robot would do without the others; asked once a tick, with what DWA knows of the robot's motion."""

    def __init__(
        self, floor: Floor, radius_m: float, limits: Floats, parameters: DrivingParameters, seconds: float
    ) -> None:
        """Take the *limits* of the drive as :mod:`cosim.navigation.dwa` has them, and the length of a tick."""
        self._floor, self._radius_m, self._limits = floor, radius_m, limits
        self._own, self._seconds = parameters, seconds
        self.pace_mps: tuple[float, float] | None = None
        """The speed that the robot's last order leads to, and its own, m/s; None when the robot is not under way."""
        self.most = math.inf
        """m, so far it goes in the coming tick at most, for reasons of the floor."""
        self._sets_off = True
        self._heading = self._way = self._turn = 0.0
        self._points, self._bodies = np.zeros(_NOTHING), np.zeros(_NOBODY)

    def restart(self) -> None:
        """Set off anew, with the robot as it is then: it has another goal."""
        self._sets_off = True

    def look(self, motion: Floats, goal_m: Place | None, way: float, aside: bool = False) -> None:
        """Take what the robot orders at this tick, and order something too.

        *motion* is the robot's row for DWA; *goal_m* where it is under way to, or None; *way* metres a tick what it
        orders. If it does so to go *aside* for another, it counts as standing.
        """
        self.pace_mps = None
        if goal_m is not None:
            if self._sets_off:
                self._heading, self._way, self._turn = motion[[HEADING, WAY, TURN]].tolist()
                self._sets_off = False
            gone = 0.0 if aside else towards(way, float(motion[WAY]), float(self._limits[WAY_CHANGE]))
            self.pace_mps = gone / self._seconds, self._step(motion, goal_m)
        self.most = math.inf

    def _step(self, motion: Floats, goal_m: Place) -> float:
        """Return the speed, m/s, that it will have from the next tick on by what it orders now."""
        own = self._limits
        self._agree(motion)
        way, turn = self._ordered(motion, goal_m)
        self._heading += self._turn
        self._way = towards(way, self._way, own[WAY_CHANGE])
        self._turn = towards(turn, self._turn, own[TURN_CHANGE])
        return self._way / self._seconds

    def _agree(self, motion: Floats) -> None:
        """Take the robot's heading and turn where they differ from the own ones by rounding only."""
        heading, turn = float(motion[HEADING]), float(motion[TURN])
        if abs(math.remainder(heading - self._heading, math.tau)) < ROUNDING and abs(turn - self._turn) < ROUNDING:
            self._heading, self._turn = heading, turn

    def _ordered(self, motion: Floats, goal_m: Place) -> tuple[float, float]:
        own, state = self._limits, motion.copy()
        state[HEADING], state[WAY], state[TURN] = self._heading, self._way, self._turn
        x, y = float(state[X]), float(state[Y])
        aim = self._floor.field(self._radius_m, goal_m).aim((x, y), self._own.look_ahead_m)
        if aim is None or (aim.last and aim.left_m <= self._own.arrive_m):
            return 0.0, 0.0
        most = min(self.most, float(own[MOST_WAY]))
        if aim.last:
            dx, dy = chord(state[HEADING], state[WAY], state[TURN])
            left = math.hypot(aim.place_m[0] - x - dx, aim.place_m[1] - y - dy)
            most = min(most, braking_way(left, own[WAY_CHANGE]))
        stop_m = own[MOST_WAY] + stopping_m(own[MOST_WAY] + own[WAY_CHANGE], own[WAY_CHANGE])
        reach = own[RADIUS] + max(own[MARGIN], own[CLEAR]) + stop_m
        walls = walls_near(self._floor.walls, x, y, reach + 2.0 * own[RADIUS])
        way, turn, _ = choose(own, state, walls, self._points, self._bodies, aim.place_m[0], aim.place_m[1], most)
        return float(way), float(turn)
