"""A robot's double: what it would order, where it is, had no other robot been there since it set off.

It measures interference (:mod:`protocols.deployment.interference`), and moves nobody. At every tick it stands where
the robot stands, but faces where it has itself turned to, at the speed that it has itself come to; it follows the field
of the bare map, and meets no bodies. All else it does as its robot's wheel does, by the same calls: alone, a robot and
its double order the same.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.navigation.dwa import HEADING, TURN, WAY
from cosim.navigation.schemas import Floats
from protocols.deployment.floor import Floor
from protocols.deployment.plan import Place
from protocols.deployment.wheel import Wheel

ROUNDING: Final = 1e-9
"""Headings and turns, rad, that are as near to each other are the same."""
_SOMEBODY_M: Final = 0.5
"""What the scanner meets so near to a robot's body is taken for that robot, however late one has heard where it is."""


class Double:
    """What one robot would do without the others; asked once a tick, when the robot has ordered what it does."""

    def __init__(self, floor: Floor, radius_m: float, arrive_m: float) -> None:
        """Take the known map, and how near to its goal (m) a robot has arrived."""
        self._floor, self._radius_m, self._arrive_m = floor, radius_m, arrive_m
        self.pace_mps: tuple[float, float] | None = None
        """The speed that the robot's last order leads to, and its own, m/s; None when the robot is not under way."""
        self._sets_off = True
        self._heading, self._drive = 0.0, (0.0, 0.0)

    def restart(self) -> None:
        """Set off anew, with the robot as it is then: it has another goal."""
        self._sets_off = True

    def look(
        self, wheel: Wheel, goal_m: Place | None, bodies: Sequence[tuple[Place, float]], held: bool, aside: bool
    ) -> None:
        """Take what the robot orders at this tick, and order something too.

        *goal_m* is where the robot is under way to, or None; *bodies* are the places and radii (m) of the others as it
        knows them. *held*: it has not got on, and first gets away from what it is too near to. If it goes *aside* for
        another, it counts as standing.
        """
        self.pace_mps = None
        if goal_m is None:
            return
        way, turn = wheel.motion[[WAY, TURN]].tolist()
        if self._sets_off:
            self._heading, self._drive, self._sets_off = float(wheel.motion[HEADING]), (way, turn), False
        gone = 0.0 if aside else wheel.reached(wheel.wanted, (way, turn))[0]
        self._step(wheel, goal_m, bodies, held)
        self.pace_mps = wheel.speed_mps(gone), wheel.speed_mps(self._drive[0])

    def _step(self, wheel: Wheel, goal_m: Place, bodies: Sequence[tuple[Place, float]], held: bool) -> None:
        """Come to the heading and the motion that it will have from the next tick on by what it orders now."""
        self._agree(wheel.motion)
        ordered = self._ordered(wheel, goal_m, bodies, held)
        self._heading += self._drive[1]
        self._drive = wheel.reached(ordered, self._drive)

    def _agree(self, motion: Floats) -> None:
        """Take the robot's heading and turn where they differ from the own ones by rounding only."""
        (way, turn), (heading, robots_turn) = self._drive, motion[[HEADING, TURN]].tolist()
        if abs(math.remainder(heading - self._heading, math.tau)) < ROUNDING and abs(turn - robots_turn) < ROUNDING:
            self._heading, self._drive = heading, (way, robots_turn)

    def _ordered(
        self, wheel: Wheel, goal_m: Place, bodies: Sequence[tuple[Place, float]], held: bool
    ) -> tuple[float, float]:
        aim = self._floor.aim(self._radius_m, self._floor.field(self._radius_m, goal_m), wheel.here, held)
        if aim is None or (aim.last and aim.left_m <= self._arrive_m):
            return 0.0, 0.0
        motion = wheel.motion.copy()
        motion[[HEADING, WAY, TURN]] = self._heading, *self._drive
        return wheel.alone(motion, aim, _but_bodies(wheel.points, bodies))


def _but_bodies(points: Floats, bodies: Sequence[tuple[Place, float]]) -> Floats:
    """Return the *points*, shape (n, 2), that are not of other robots."""
    for place_m, radius_m in bodies:
        points = points[np.hypot(*(points - place_m).T) > radius_m + _SOMEBODY_M]
    return points
