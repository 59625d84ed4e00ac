"""The counterfactual twin of a robot: what it would order at the same place if it had been alone since it set off.

It measures interference (:mod:`protocols.deployment.referee`) and moves no robot. At every tick it is where the robot
is, but with the heading and the speed that it has come to by itself; it follows the field of the bare map and meets no
bodies. In all else it calls the same functions as the robot's driver, so a robot that is alone and its twin order the
same.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.navigation.dwa import HEADING, TURN, WAY
from protocols.deployment.tasks.plan import Place
from protocols.motion.driver import Driver
from protocols.motion.floor import Floor

ROUNDING: Final = 1e-9
"""Difference up to which headings, ways and turns (rad, m, rad) are the same."""
_NEAR_BODY_M: Final = 0.5  # reports of where a robot is come late
"""Distance from a robot's reported body within which scanned points belong to it."""


class Twin:
    """What one robot would do without the others; called once a tick, after the robot has given its order."""

    def __init__(self, floor: Floor, radius_m: float, arrive_m: float) -> None:
        """Take the known map, and the distance (m) within which a goal is reached."""
        self._floor, self._radius_m, self._arrive_m = floor, radius_m, arrive_m
        self.speeds_mps: tuple[float, float] | None = None
        """Speed to which the robot's last order leads, and the twin's own, m/s; None if the robot is not under way."""
        self._own: _Motion | None = None
        """Its own motion; None: the same as the robot's."""

    def restart(self) -> None:
        """Set off again with the robot's own motion: the robot has another goal."""
        self._own = None

    def look(
        self, driver: Driver, goal_m: Place | None, bodies: Sequence[tuple[Place, float]], held: bool, aside: bool
    ) -> None:
        """Take what the robot orders at this tick, and compute the twin's order.

        *goal_m* is the robot's goal if it is under way, or None; *bodies* are the places and radii (m) of the others as
        it knows them. *held*: it has made no progress, and first gets away from what it is too near to. If it goes
        *aside* for another, it counts as standing.
        """
        self.speeds_mps = None
        if goal_m is None:
            return
        way, turn = driver.motion[[WAY, TURN]].tolist()
        own = self._own or _Motion(0.0, way, turn)
        robots = driver.reached(driver.wanted, (way, turn))
        next_way, next_turn = driver.reached(self._ordered(driver, own, goal_m, bodies, held), (own.way, own.turn))
        own = _Motion(math.remainder(own.askew_rad + own.turn - turn, math.tau), next_way, next_turn)
        # once both move alike, the robot's motion is taken again, so that rounding errors do not add up
        self._own = None if own.near(0.0, *robots) else own
        self.speeds_mps = driver.speed_mps(0.0 if aside else robots[0]), driver.speed_mps(next_way)

    def _ordered(
        self, driver: Driver, own: "_Motion", goal_m: Place, bodies: Sequence[tuple[Place, float]], held: bool
    ) -> tuple[float, float]:
        aim = self._floor.aim(self._radius_m, self._floor.field(self._radius_m, goal_m), driver.here, held)
        if aim is None or (aim.last and aim.left_m <= self._arrive_m):
            return 0.0, 0.0
        motion = driver.motion.copy()
        motion[HEADING] += own.askew_rad
        motion[[WAY, TURN]] = own.way, own.turn
        return driver.alone(motion, aim, _but_bodies(driver.points, bodies))


class _Motion(NamedTuple):
    """Motion of a twin until the next tick."""

    askew_rad: float
    """Angle by which it faces left of the robot: corrections of the robot's heading turn both."""
    way: float
    turn: float

    def near(self, askew_rad: float, way: float, turn: float) -> bool:
        """Return whether another motion is the same, but for rounding."""
        apart = abs(self.askew_rad - askew_rad), abs(self.way - way), abs(self.turn - turn)
        return max(apart) < ROUNDING


def _but_bodies(points: Floats, bodies: Sequence[tuple[Place, float]]) -> Floats:
    """Return the *points*, shape (n, 2), that do not belong to other robots."""
    for place_m, radius_m in bodies:
        points = points[elementary.hypots(*(points - place_m).T) > radius_m + _NEAR_BODY_M]
    return points
