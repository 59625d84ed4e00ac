"""Random motion: straight in a random direction as far as the ground in view is free, then in another."""

import math

import numpy as np

from cosim.geometry.planning import Point
from cosim.geometry.segments import free_fraction
from cosim.machine import Command, GoTo
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.aggregation.ground import TOUCH_M, Ground
from protocols.aggregation.walking_aside import in_the_way
from protocols.aggregation.walking_evasion import STAND
from protocols.aggregation.walking_parameters import WalkingParameters

_TRIES = 16
"""So many directions are drawn until one leads farther than to a robot that is near; else the farthest is taken."""
_THERE_M = 0.05
_LOOK_S = 1.0


class Stroller:
    """One robot's random motion; it strolls from the beginning on, until it is told to stand."""

    def __init__(
        self,
        ground: Ground,
        parameters: WalkingParameters,
        tick: Time,
        stream: np.random.Generator,
    ) -> None:
        """Draw directions from *stream*."""
        self._ground = ground
        self._stream = stream
        self._leg_m = parameters.leg_m
        self._near_m = parameters.near_m
        self._room_m = 2.0 * ground.radius_m + parameters.safety_m
        self._look_ticks = max(1, round(_LOOK_S / to_seconds(tick)))
        self._ticks = 0
        self._look_at = 0
        self._calm_from = 0
        self._order: Command | None = None
        self._strolls = True
        self.goal_m: Point | None = None
        """The end of the present piece."""
        self.arrived = False
        self.stuck = False
        """The robot can go nowhere."""

    def head_for(self, goal_m: Point | None) -> None:
        """Stand still for None; else stroll, whatever the goal."""
        if self._strolls != (goal_m is not None):
            self._strolls = goal_m is not None
            self.goal_m = None
            self._look_at = 0
            self._order = None

    def remaining_m(self, here: Point) -> float:
        """Return how long the present piece still is in metres."""
        return 0.0 if self.goal_m is None else math.dist(here, self.goal_m)

    def step(self, observation: Observation) -> Command | None:
        """Return an order to the body, or None where the last one goes on; to be called once a tick."""
        self._ticks += 1
        if self._ticks < self._look_at and not observation.blocked and not observation.sightings:
            return None
        here = observation.x_m, observation.y_m
        if not self._strolls:
            return self._stand()
        if self.goal_m is None or self._over(observation, here):
            self.goal_m = self._draw(observation, here)
            self.stuck = math.dist(here, self.goal_m) <= _THERE_M
            self._calm_from = self._ticks + self._look_ticks
        self._look_at = self._ticks + self._look_ticks
        order = GoTo(*self.goal_m)
        if order == self._order:
            return None
        self._order = order
        return order

    def _stand(self) -> Command | None:
        self._look_at = self._ticks + self._look_ticks
        if self._order == STAND:
            return None
        self._order = STAND
        return STAND

    def _over(self, observation: Observation, here: Point) -> bool:
        """Return whether the piece ends here: at its end, or at what holds the robot, or before another one."""
        assert self.goal_m is not None
        if observation.arrived or math.dist(here, self.goal_m) <= _THERE_M:
            return True
        if self._ticks < self._calm_from:
            return False  # it takes a body a while to turn away from what is ahead
        return observation.blocked or any(
            math.dist(here, (x, y)) < self._near_m and in_the_way(here, self.goal_m, (x, y), self._room_m)
            for _, x, y in observation.sightings
        )

    def _draw(self, observation: Observation, here: Point) -> Point:
        """Return the end of the next piece."""
        farthest, most = here, 0.0
        near = [(x, y) for _, x, y in observation.sightings if math.dist(here, (x, y)) < self._near_m]
        for _ in range(_TRIES):
            angle = self._stream.uniform(-math.pi, math.pi)
            dx, dy = self._leg_m * math.cos(angle), self._leg_m * math.sin(angle)
            free = free_fraction(self._ground.walls, *here, dx, dy, self._ground.radius_m + TOUCH_M, 0.0)
            there = here[0] + free * dx, here[1] + free * dy
            if any(in_the_way(here, there, body, self._room_m) for body in near):
                continue
            if free * self._leg_m > most:
                farthest, most = there, free * self._leg_m
            if most >= min(self._near_m, self._leg_m):
                break
        return farthest
