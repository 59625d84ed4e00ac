"""What takes robots to goals, and how a searcher moves: by posts, to a meeting, at random, or not at all."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

import numpy as np

from cosim.geometry.planning import Point
from cosim.machine import Command
from cosim.observation import Observation
from protocols.aggregation.ground import Ground

Measure: TypeAlias = Callable[[Point, Point], float | None]
"""Returns how far a searcher takes it to be from one place to another, m; None if it knows that no way leads there."""


class Feet(Protocol):
    """What takes a robot to a goal, or about: a walker, a stroller or a pedestrian."""

    @property
    def arrived(self) -> bool:
        """Whether it is at the goal."""

    def head_for(self, goal_m: Point | None) -> None:
        """Go to a goal; stand still if it is None. The same goal again is no news."""

    def step(self, observation: Observation) -> Command | None:
        """Return the next order, if there is a new one; to be called once a tick."""


class Legs:
    """The ways of one searcher."""

    def __init__(
        self,
        ground: Ground,
        feet: Feet,
        stroll: Feet,
        length_m: Measure,
        stream: np.random.Generator,
        at_random: bool,
    ) -> None:
        """Search by posts, or, *at_random*, without any; draw from *stream* where to wander."""
        self._ground = ground
        self._feet = feet
        self._stroll = stroll
        self._length_m = length_m
        self._random = at_random
        self._stream = stream
        self._wandering_to: Point | None = None
        self._posts: list[int] = []
        self._here: Point | None = None
        self._touring = False
        self._strolling = False

    @property
    def done(self) -> bool:
        """Whether no post is left to visit; who searches at random is never done."""
        return not self._posts and not self._random

    @property
    def reached(self) -> int | None:
        """The post that the robot has just come to on its tour."""
        return self._posts[0] if self._touring and self._posts and self._feet.arrived else None

    def assign(self, posts: Sequence[int]) -> None:
        """Visit *posts* from now on, in this order, and no others."""
        self._posts = list(posts)
        self._touring = False

    def next(self, seen: bool) -> None:
        """Go on to the next post; come back to this one at the end of the tour if it has not been *seen*."""
        post = self._posts.pop(0)
        if not seen:
            self._posts.append(post)
        self._touring = False

    def search(self, observation: Observation) -> Command | None:
        """Return the next order on the tour."""
        if self._random:
            return self.stroll(observation)
        if not self._posts:
            return self.stand(observation)
        self._feet.head_for(self._ground.posts_m[self._posts[0]])
        self._touring = True
        return self._step(observation)

    def approach(self, goal_m: Point, observation: Observation) -> Command | None:
        """Return the next order on the way to a place."""
        self._touring = False
        self._feet.head_for(goal_m)
        return self._step(observation)

    def stand(self, observation: Observation) -> Command | None:
        """Return the order to stand still, if it has to be given."""
        self._touring = False
        self._feet.head_for(None)
        return self._step(observation)

    def wander(self, observation: Observation) -> Command | None:
        """Return the next order on the way from one post of the floor to another, drawn at random."""
        if self._wandering_to is None or self._feet.arrived:
            posts_m = self._ground.posts_m
            self._wandering_to = posts_m[int(self._stream.integers(len(posts_m)))]
        return self.approach(self._wandering_to, observation)

    def stroll(self, observation: Observation) -> Command | None:
        """Return the next order of a random walk."""
        self._touring = False
        self._here = here = observation.x_m, observation.y_m
        if not self._strolling:
            self._strolling = True
            self._stroll.head_for(None)
            self._stroll.head_for(here)
        return self._stroll.step(observation)

    def way_m(self, point_m: Point) -> float | None:
        """Return how far the robot takes it to be to a place; None if no way leads there."""
        return None if self._here is None else self._length_m(self._here, point_m)

    def _step(self, observation: Observation) -> Command | None:
        self._here = observation.x_m, observation.y_m
        if self._strolling:  # the one who gave the last order has to take it back
            self._strolling = False
            self._stroll.head_for(None)
            return self._stroll.step(observation)
        return self._feet.step(observation)
