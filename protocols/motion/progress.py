"""Whether a robot that drives gets anywhere: by what is left of its way on the bare map, whatever its mover tries."""

import math
from typing import Final

from cosim.geometry.planning import Point
from cosim.units import S, Time
from protocols.motion.floor import Floor

NEARER_M: Final = 0.2
"""Who has come nearer by so much has got somewhere."""
LOOK: Final = S
"""So often that is looked at."""


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
        """Set off to a place."""
        self._goal_m, self._left_m = goal_m, math.inf
        self._since = self._looked = now

    def held(self, here: Point, now: Time) -> Time:
        """Return for how long the robot, which is *here*, has not got nearer."""
        if self._goal_m is not None and not 0 <= now - self._looked < LOOK:
            self._looked = now
            left_m = self._floor.field(self._radius_m, self._goal_m).distance_m(here)
            if left_m < self._left_m - NEARER_M:
                self._left_m, self._since = left_m, now
        return max(now - self._since, 0)
