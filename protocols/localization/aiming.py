"""Orders to go to a place of the map, by a robot whose own frame slides against the map's, or against the world.

A body that is told to go to a place of its own frame goes straight to where in the world that is at this moment. As the
robot drives, its estimate changes, and so does where the place is by it. So the order is given again when the body
would miss the place by the estimate, or has stopped beside it; but then only, though the machine may repeat it at every
tick: some bodies stop in order to turn, by however little.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.machine import Command, GoTo
from cosim.observation import Observation
from protocols.motion.frames import Shift

_MISS_M: Final = 0.02
"""Distance by which a body may miss its place at the end: less than what any machine takes for having reached one."""
_ASTRAY: Final = 0.03
"""How much more that may be for each metre that is left: it is mended on the way."""


class Aim:
    """The place that one robot has been sent to."""

    def __init__(self) -> None:
        self._goal_m: GoTo | None = None
        """In the map's frame; None if the last order was another one."""

    def order(self, command: Command | None, observation: Observation, shift: Shift) -> Command | None:
        """Return the order to the body, in the robot's own frame, that *command* or the last one makes at this tick.

        *command* and *observation* are in the map's frame, *shift* leads to it from the robot's own. None is returned
        where the body is to go on as it does.
        """
        if command is not None and command != self._goal_m:
            self._goal_m = command if isinstance(command, GoTo) else None
            return command if self._goal_m is None else GoTo(*shift.back(*self._goal_m))
        if self._goal_m is None or not _misses(observation, self._goal_m):
            return None
        return GoTo(*shift.back(*self._goal_m))


def _misses(observation: Observation, goal_m: GoTo) -> bool:
    """Return whether the robot is about to pass too far from *goal_m*, or has stopped or gone too far past it."""
    dx, dy = goal_m.x_m - observation.x_m, goal_m.y_m - observation.y_m
    cos, sin = elementary.cos(observation.heading_rad), elementary.sin(observation.heading_rad)
    left_m = cos * dx + sin * dy
    if observation.arrived or left_m < 0.0:
        return math.hypot(dx, dy) > _MISS_M
    return abs(cos * dy - sin * dx) > _MISS_M + _ASTRAY * left_m
