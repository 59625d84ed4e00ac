"""Walking by VisBug: exactly where it leads, though a command acts a tick late, and round bodies, which it cannot know.

VisBug sends the robot from corner to corner of the grown walls; whoever overshoots a corner by a step may be out of
sight of its intermediate target. So it is asked from where the robot will be when the answer takes effect.
"""

import math
from collections.abc import Mapping

from cosim.machine import Address
from cosim.navigation.status import STUCK, UNREACHABLE, Status
from cosim.navigation.steering import Navigator
from cosim.observation import Observation
from cosim.units import Time
from protocols.reflection.setup import Point
from protocols.reflection.straight import AHEAD_STEPS, Straight

WHOLE = 0.999
"""The square of the length from which on a step is a whole one."""


class LoopWalk:
    """One robot's way by an algorithm that knows the walls and nothing else."""

    def __init__(self, navigator: Navigator, straight: Straight, step_m: float, near_m: float) -> None:
        """Take a robot within *near_m* to be what blocks this one."""
        self._navigator = navigator
        self._straight = straight
        self._step_m = step_m
        self._near_m = near_m

    def choose(
        self,
        observation: Observation,
        sightings: Mapping[Address, Point],
        place: Point,
        going: Point | None,
        now: Time,
    ) -> Point | None:
        """Return where to go in order to come to *place*; None if that is proved impossible.

        *going* is where the robot goes now.
        """
        here = observation.x_m, observation.y_m
        x, y = here if observation.blocked or going is None else self._ahead(here, going)
        steer = self._navigator.steer(x, y, place, (), (), self._step_m)
        if steer.status == UNREACHABLE:
            return None
        whole = steer.dx * steer.dx + steer.dy * steer.dy > WHOLE
        ahead = (AHEAD_STEPS if whole else 1.0) * self._step_m
        there = x + ahead * steer.dx, y + ahead * steer.dy
        if self._straight.rounding or (observation.blocked and self._held(here, sightings, steer.status)):
            return self._straight.towards(there, 0.0, observation, now)
        return there

    def _ahead(self, here: Point, going: Point) -> Point:
        """Return where the robot will be a tick from now."""
        dx, dy = going[0] - here[0], going[1] - here[1]
        distance = math.hypot(dx, dy)
        if distance <= self._step_m:
            return going
        return here[0] + self._step_m * dx / distance, here[1] + self._step_m * dy / distance

    def _held(self, here: Point, sightings: Mapping[Address, Point], status: Status) -> bool:
        """Return whether it is a body that blocks the robot, as far as it knows."""
        return status == STUCK or any(math.dist(here, peer) < self._near_m for peer in sightings.values())
