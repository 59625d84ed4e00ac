"""Whether a robot that drives gets nearer to its goal, by its way on the bare map, whatever its mover tries."""

import math
from typing import Final

from cosim.geometry.planning import Point
from cosim.units import S, Time
from protocols.motion.floor import Floor

NEARER_M: Final = 0.2
"""Decrease in the length of the way that counts as progress."""
LOOK: Final = S
"""Interval between progress checks."""


class Approach:
    """One robot's drive to one place."""

    def __init__(self, floor: Floor, radius_m: float) -> None:
        self._floor = floor
        self._radius_m = radius_m
        self._goal_m: Point | None = None
        self._left_m = math.inf
        self._since: Time = 0
        self._looked: Time = 0

    def begin(self, goal_m: Point, now: Time) -> None:
        """Begin a drive to a place."""
        self._goal_m, self._left_m = goal_m, math.inf
        self._since = self._looked = now

    def held(self, here: Point, now: Time) -> Time:
        """Return for how long the robot, now *here*, has made no progress."""
        if self._goal_m is not None and not 0 <= now - self._looked < LOOK:
            self._looked = now
            left_m = self._floor.field(self._radius_m, self._goal_m).distance_m(here)
            if left_m < self._left_m - NEARER_M:
                self._left_m, self._since = left_m, now
        return max(now - self._since, 0)
