"""The counterfactual twin of a robot: what it would order, where it is, had no other robot been there since it set off.

It measures interference (:mod:`protocols.deployment.referee`) and moves no robot. At every tick it stands where the
robot stands, but has the heading and the speed that it has itself come to; it follows the field of the bare map, and
meets no bodies. All else it does as its robot's driver does, by the same calls: alone, a robot and its twin order the
same.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Floats
from cosim.navigation.dwa import HEADING, TURN, WAY
from protocols.deployment.tasks.plan import Place
from protocols.motion.driver import Wheel
from protocols.motion.floor import Floor

ROUNDING: Final = 1e-9
"""Headings, ways and turns (rad, m, rad) that are as near to each other are the same."""
_SOMEBODY_M: Final = 0.5
"""What the scanner meets so near to a robot's body is taken for that robot, however late one has heard where it is."""


class Twin:
    """What one robot would do without the others; asked once a tick, when the robot has ordered what it does."""

    def __init__(self, floor: Floor, radius_m: float, arrive_m: float) -> None:
        """Take the known map, and how near to its goal (m) a robot has arrived."""
        self._floor, self._radius_m, self._arrive_m = floor, radius_m, arrive_m
        self.speeds_mps: tuple[float, float] | None = None
        """Speed to which the robot's last order leads, and the twin's own, m/s; None if the robot is not under way."""
        self._own: _Motion | None = None
        """How it moves; None: as the robot does."""

    def restart(self) -> None:
        """Set off anew, with the robot as it is then: it has another goal."""
        self._own = None

    def look(
        self, wheel: Wheel, goal_m: Place | None, bodies: Sequence[tuple[Place, float]], held: bool, aside: bool
    ) -> None:
        """Take what the robot orders at this tick, and order something too.

        *goal_m* is where the robot is under way to, or None; *bodies* are the places and radii (m) of the others as it
        knows them. *held*: it has not got on, and first gets away from what it is too near to. If it goes *aside* for
        another, it counts as standing.
        """
        self.speeds_mps = None
        if goal_m is None:
            return
        way, turn = wheel.motion[[WAY, TURN]].tolist()
        own = self._own or _Motion(0.0, way, turn)
        robots = wheel.reached(wheel.wanted, (way, turn))
        next_way, next_turn = wheel.reached(self._ordered(wheel, own, goal_m, bodies, held), (own.way, own.turn))
        own = _Motion(math.remainder(own.askew_rad + own.turn - turn, math.tau), next_way, next_turn)
        self._own = None if own.near(0.0, *robots) else own
        self.speeds_mps = wheel.speed_mps(0.0 if aside else robots[0]), wheel.speed_mps(next_way)

    def _ordered(
        self, wheel: Wheel, own: "_Motion", goal_m: Place, bodies: Sequence[tuple[Place, float]], held: bool
    ) -> tuple[float, float]:
        aim = self._floor.aim(self._radius_m, self._floor.field(self._radius_m, goal_m), wheel.here, held)
        if aim is None or (aim.last and aim.left_m <= self._arrive_m):
            return 0.0, 0.0
        motion = wheel.motion.copy()
        motion[HEADING] += own.askew_rad
        motion[[WAY, TURN]] = own.way, own.turn
        return wheel.alone(motion, aim, _but_bodies(wheel.points, bodies))


class _Motion(NamedTuple):
    """How a twin moves until the next tick."""

    askew_rad: float
    """By so much it faces left of where the robot does: corrections of the robot's heading turn both."""
    way: float
    turn: float

    def near(self, askew_rad: float, way: float, turn: float) -> bool:
        """Return whether that is the same, but for rounding."""
        apart = abs(self.askew_rad - askew_rad), abs(self.way - way), abs(self.turn - turn)
        return max(apart) < ROUNDING


def _but_bodies(points: Floats, bodies: Sequence[tuple[Place, float]]) -> Floats:
    """Return the *points*, shape (n, 2), that are not of other robots."""
    for place_m, radius_m in bodies:
        points = points[np.hypot(*(points - place_m).T) > radius_m + _SOMEBODY_M]
    return points
