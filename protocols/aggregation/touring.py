"""How a searcher moves: from post to post, to a rendezvous, at random, or not at all."""

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.geometry.planning import Point
from cosim.geometry.segments import free_fraction
from cosim.machine import Command, GoTo
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.aggregation.ground import TOUCH_M, Ground
from protocols.aggregation.parameters import WalkingParameters
from protocols.aggregation.walking import STAND, Near, in_the_way

Measure: TypeAlias = Callable[[Point, Point], float | None]
"""Returns the length of a way between two places as a searcher estimates it, m; None if it knows of no way."""
_TRIES: Final = 16
"""Number of directions drawn until one leads farther than to a robot that is near; else the farthest is taken."""
_THERE_M: Final = 0.05
_LOOK_S: Final = 1.0


class Mover(Protocol):
    """What moves a robot to a goal, or about: a walker, a pedestrian or a random walk."""

    @property
    def arrived(self) -> bool:
        """True if the robot is at the goal."""

    @property
    def ahead_m(self) -> list[Point]:
        """The points by which the robot goes from here on; empty if it stands, or does not know yet."""

    def head_for(self, goal_m: Point | None) -> None:
        """Go to a goal; stand still if it is None. The same goal again changes nothing."""

    def step(self, observation: Observation) -> Command | None:
        """Return the next order, if there is a new one; to be called once a tick."""


class Motion:
    """How one searcher moves."""

    def __init__(
        self,
        ground: Ground,
        mover: Mover,
        random_walk: Mover,
        length_m: Measure,
        stream: np.random.Generator,
        at_random: bool,
    ) -> None:
        """Search by posts, or, *at_random*, without any; draw from *stream* where to wander."""
        self._ground = ground
        self._mover = mover
        self._random_walk = random_walk
        self._length_m = length_m
        self._random = at_random
        self._stream = stream
        self._wandering_to: Point | None = None
        self._posts: list[int] = []
        self._here: Point | None = None
        self._touring = False
        self._walking_at_random = False

    @property
    def done(self) -> bool:
        """True if no post is left to visit; a searcher at random is never done."""
        return not self._posts and not self._random

    @property
    def reached(self) -> int | None:
        """The post that the robot has just come to on its tour."""
        return self._posts[0] if self._touring and self._posts and self._mover.arrived else None

    @property
    def ahead_m(self) -> list[Point]:
        """The points by which the robot goes from here on; empty if it stands."""
        return (self._random_walk if self._walking_at_random else self._mover).ahead_m

    def assign(self, posts: Sequence[int]) -> None:
        """Visit *posts* and no others from now on, in this order."""
        self._posts = list(posts)
        self._touring = False

    def next(self, seen: bool) -> None:
        """Go on to the next post; return to this one at the end of the tour if it has not been *seen*."""
        post = self._posts.pop(0)
        if not seen:
            self._posts.append(post)
        self._touring = False

    def search(self, observation: Observation) -> Command | None:
        """Return the next order on the tour."""
        if self._random:
            return self.walk_at_random(observation)
        if not self._posts:
            return self.stand(observation)
        self._mover.head_for(self._ground.posts_m[self._posts[0]])
        self._touring = True
        return self._step(observation)

    def approach(self, goal_m: Point, observation: Observation) -> Command | None:
        """Return the next order on the way to a place."""
        self._touring = False
        self._mover.head_for(goal_m)
        return self._step(observation)

    def stand(self, observation: Observation) -> Command | None:
        """Return the order to stand still, if it has to be given."""
        self._touring = False
        self._mover.head_for(None)
        return self._step(observation)

    def wander(self, observation: Observation) -> Command | None:
        """Return the next order on the way from one post of the floor to another, drawn at random."""
        if self._wandering_to is None or self._mover.arrived:
            posts_m = self._ground.posts_m
            self._wandering_to = posts_m[int(self._stream.integers(len(posts_m)))]
        return self.approach(self._wandering_to, observation)

    def walk_at_random(self, observation: Observation) -> Command | None:
        """Return the next order of a random walk."""
        self._touring = False
        self._here = here = observation.x_m, observation.y_m
        if not self._walking_at_random:
            self._walking_at_random = True
            self._random_walk.head_for(None)
            self._random_walk.head_for(here)
        return self._random_walk.step(observation)

    def way_m(self, point_m: Point) -> float | None:
        """Return the estimated length of the way to a place, metres; None if no way leads there."""
        return None if self._here is None else self._length_m(self._here, point_m)

    def _step(self, observation: Observation) -> Command | None:
        self._here = observation.x_m, observation.y_m
        if self._walking_at_random:  # what gave the last order has to take it back
            self._walking_at_random = False
            self._random_walk.head_for(None)
            return self._random_walk.step(observation)
        return self._mover.step(observation)


class RandomWalk:
    """Random motion: straight in a random direction as far as the ground in view is free, then in another.

    It moves from the beginning on, until it is told to stand.
    """

    def __init__(self, ground: Ground, parameters: WalkingParameters, tick: Time, stream: np.random.Generator) -> None:
        """Draw directions from *stream*."""
        self._ground = ground
        self._stream = stream
        self._leg_m = parameters.leg_m
        self._near_m = parameters.near_m
        self._others = Near(parameters.near_m)
        self._room_m = 2.0 * ground.radius_m + parameters.safety_m
        self._look_ticks = max(1, round(_LOOK_S / to_seconds(tick)))
        self._ticks = 0
        self._look_at = 0
        self._calm_from = 0
        self._order: Command | None = None
        self._walks = True
        self.goal_m: Point | None = None
        """The end of the present piece."""
        self.arrived = False
        self.stuck = False
        """True if the robot cannot move in any direction tried."""

    @property
    def ahead_m(self) -> list[Point]:
        """The end of the present piece, if there is one."""
        return [] if self.goal_m is None else [self.goal_m]

    def head_for(self, goal_m: Point | None) -> None:
        """Stand still for None; else walk at random, whatever the goal."""
        if self._walks != (goal_m is not None):
            self._walks = goal_m is not None
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
        if not self._walks:
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
            return False  # a body needs a while to turn away from what is ahead
        return observation.blocked or any(
            in_the_way(here, self.goal_m, (x, y), self._room_m) for _, x, y in self._others.look(observation)
        )

    def _draw(self, observation: Observation, here: Point) -> Point:
        """Return the end of the next piece."""
        farthest, most = here, 0.0
        near = [(x, y) for _, x, y in self._others.look(observation)]
        for _ in range(_TRIES):
            angle = self._stream.uniform(-math.pi, math.pi)
            dx, dy = self._leg_m * elementary.cos(angle), self._leg_m * elementary.sin(angle)
            free = free_fraction(self._ground.walls, *here, dx, dy, self._ground.radius_m + TOUCH_M, 0.0)
            there = here[0] + free * dx, here[1] + free * dy
            if any(in_the_way(here, there, body, self._room_m) for body in near):
                continue
            if free * self._leg_m > most:
                farthest, most = there, free * self._leg_m
            if most >= min(self._near_m, self._leg_m):
                break
        return farthest
