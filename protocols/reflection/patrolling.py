"""What a robot without goals does: it keeps a post or patrols its way points."""

import math
from collections.abc import Mapping, Sequence

from cosim.machine import Address
from cosim.navigation.steering import Navigator
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.reflection.setup import Point
from protocols.reflection.straight import AHEAD_STEPS, Straight

LOST_STALLS = 2
"""Ways in a row on which a robot has stalled after which it is lost."""
LOST = 5 * S
"""Least time for which the algorithm A then leads it; doubled each time until it comes to a way point."""
# The algorithm A stops a step before its goal.
AT_STEPS = 1.5
"""Distance at which a lost robot is at its way point, in motion steps."""
# Avoid Past mostly finds out of a room within five minutes.
MOST_DOUBLINGS = 6
"""Greatest number of doublings."""


class Patrol:
    """A patrol of way points, there and back or round and round; a single one is a post.

    A way leads straight from each to the next. A robot that leaves it to yield lays a thread of places, each in sight
    of the one before, and goes back along it. A robot that makes no progress any more (as it was carried away, for
    example) is lost: the algorithm A leads it until it sees a way point again. It may see one past a jamb that its body
    does not pass, so A leads it for longer each time that it is lost again.
    """

    def __init__(
        self, points_m: tuple[Point, ...], shuttle: bool, step_m: float, straight: Straight, navigator: Navigator
    ) -> None:
        self.points_m = (*points_m, *points_m[-2:0:-1]) if shuttle else points_m
        self._step_m = step_m
        self._straight = straight
        self._navigator = navigator
        self._at = 0
        self._stalls = 0
        self._lost_until: Time = 0
        self._losses = 0
        self._in_sight: int | None = None
        self._thread: list[Point] = []
        self._last: Point | None = None

    def places(self) -> list[Point]:
        """Return the places whose visibility ``look`` needs to know.

        They are the end of the thread and what comes before it, or all way points, if the robot is lost.
        """
        return list(self.points_m) if self.lost else self._thread[-1:-3:-1]

    @property
    def off_its_way(self) -> bool:
        """True if there is a thread that leads back, or the robot is lost."""
        return bool(self._thread) or self._stalls >= LOST_STALLS

    @property
    def lost(self) -> bool:
        """True if the robot has made no progress for a while, and looks for its way points."""
        return self._stalls >= LOST_STALLS

    def look(self, visible: Sequence[bool], here: Point) -> None:
        """Shorten the thread if more of it is in sight, extend it if its end is not; *visible* answers ``places``."""
        if visible:
            if self.lost:
                self._in_sight = next((at for at, seen in enumerate(visible) if seen), None)
            elif len(visible) > 1 and visible[1]:
                self._thread.pop()
            elif not visible[0] and self._last is not None:
                self._thread.append(self._last)
        self._last = here

    def left(self, here: Point) -> None:
        """Note that the robot leaves its way at *here*, or has already left it."""
        if not self._thread and not self.lost:
            self._thread.append(here)

    def displaced(self, now: Time) -> None:
        """Begin again from where the robot was moved to."""
        self._thread.clear()
        self._last = None
        self._stalls = LOST_STALLS
        self._lost_until = now
        self._losses = 0
        self._in_sight = None
        self._navigator.restart()

    def choose(self, observation: Observation, sightings: Mapping[Address, Point], now: Time) -> Point:
        """Return where to go from here."""
        here = observation.x_m, observation.y_m
        if not self._thread and not self._stalls:
            place = self.points_m[self._at]
            distance = math.dist(here, place)
            if distance > self._step_m and not self._straight.stalled(now):
                return self._straight.towards(place, distance, observation, now)
        if self.lost:
            if math.dist(here, self.points_m[self._at]) <= AT_STEPS * self._step_m:
                self._in_sight = self._at
            elif self._in_sight is None or now < self._lost_until:
                return self._by_algorithm(observation, sightings)
            self._at, self._stalls = self._in_sight, 0
            self._straight.begin(now)
        if len(self._thread) == 1 and math.dist(here, self._thread[0]) <= self._step_m:
            self._thread.pop()
            self._straight.begin(now)
        distance = math.dist(here, self._next())
        if self._straight.stalled(now):
            self._stall(distance, now)
        elif not self._thread and distance <= self._step_m:
            self._turn_to_next(now)
        place = self._next()
        return self._straight.towards(place, math.dist(here, place), observation, now)

    def _next(self) -> Point:
        return self._thread[-1] if self._thread else self.points_m[self._at]

    def _stall(self, distance_m: float, now: Time) -> None:
        """Leave out a place that cannot be approached."""
        self._straight.begin(now)
        if self._thread or distance_m > self._step_m:
            self._stalls += 1
        if self.lost:
            self._lost_until, self._in_sight = now + (LOST << min(self._losses, MOST_DOUBLINGS)), None
            self._losses += 1
            self._thread.clear()
            self._navigator.restart()
        elif not self._thread:
            self._at = (self._at + 1) % len(self.points_m)

    def _turn_to_next(self, now: Time) -> None:
        self._stalls = self._losses = 0
        if len(self.points_m) > 1:
            self._at = (self._at + 1) % len(self.points_m)
            self._straight.begin(now)

    def _by_algorithm(self, observation: Observation, sightings: Mapping[Address, Point]) -> Point:
        x, y = observation.x_m, observation.y_m
        place = self.points_m[self._at]
        steer = self._navigator.steer(x, y, place, observation.ranges_m, list(sightings.values()), self._step_m)
        ahead = AHEAD_STEPS * self._step_m
        return x + ahead * steer.dx, y + ahead * steer.dy
