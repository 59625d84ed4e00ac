"""Yielding: bodies are solid, and a robot that shows the way to a goal may stand in it (paper 000, section 3, rule 3).

The paper asks for "some sort of coordination strategy". Ours: a robot that has promised a way to a seeker stands in the
seeker's way if it is near the seeker, and near the line that the seeker will follow, from the seeker to the place to
which the promised way leads. It then goes where it is farthest from that line. Where nothing leads away from the line,
as in a door, it goes on along it, away from the seeker, until something does. It looks for room in its scan.
"""

import math
from collections.abc import Mapping
from typing import Final

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.machine import Address, Event
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.reflection.events import MadeWay
from protocols.reflection.promises import Ways
from protocols.reflection.setup import Point

SLACK_M: Final = 0.1
"""Room that a yielding robot leaves beyond a touch."""
YIELD_TIME: Final = 5 * S
"""Time for which a robot with goals yields to another."""
DIRECTIONS: Final = 16
"""Number of directions that are tried."""
NEAR_CONTACTS: Final = 1.75
"""Distance, less than a follower keeps, at which a seeker needs the place, in distances of two bodies that touch."""
AWAY: Final = 0.2
"""Weight of a metre away from the seeker, against a metre away from its line."""


@njit(cache=True)
def distance_to_segment(point: Point, one: Point, other: Point) -> float:
    """Return the distance of *point* from the segment between *one* and *other*, metres."""
    dx, dy = other[0] - one[0], other[1] - one[1]
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(max(((point[0] - one[0]) * dx + (point[1] - one[1]) * dy) / square, 0.0), 1.0)
    return elementary.hypot(one[0] + share * dx - point[0], one[1] + share * dy - point[1])


def in_the_way(me: Point, seeker: Point, place: Point, contact_m: float) -> bool:
    """Return whether a body at *me* is where the seeker's body will pass, soon, on its line to *place*.

    *contact_m* is the distance of two centres whose bodies nearly touch. A seeker that comes as near as that needs the
    place; one that has passed, or never comes by, does not.
    """
    dx, dy = me[0] - seeker[0], me[1] - seeker[1]
    distance = math.hypot(dx, dy)
    if distance >= NEAR_CONTACTS * contact_m or dx * (place[0] - seeker[0]) + dy * (place[1] - seeker[1]) <= 0.0:
        return False
    return distance < contact_m or distance_to_segment(me, seeker, place) < contact_m


@njit(cache=True)
def free_way(ranges_m: Floats, angle_rad: float, radius_m: float, limit_m: float) -> float:
    """Return how far a disc can go along *angle_rad* before it touches what the scan has hit, at most *limit_m*."""
    free = limit_m
    for beam in range(ranges_m.shape[0]):
        hit_m = ranges_m[beam]
        if hit_m == math.inf:
            continue
        apart = 2.0 * math.pi * beam / ranges_m.shape[0] - angle_rad
        along, across = hit_m * elementary.cos(apart), hit_m * elementary.sin(apart)
        if along > 0.0 and abs(across) < radius_m:
            free = min(free, along - math.sqrt(radius_m * radius_m - across * across))
    return max(free, 0.0)


@njit(cache=True)
def step_aside(me: Point, seeker: Point, place: Point, ranges_m: Floats, radius_m: float, room_m: float) -> Point:
    """Return where to go, out of the way of *seeker*, which heads for *place*; *me* if no place is better.

    *ranges_m* is the scan, beam k at 2 pi k / n; *radius_m* that of the body; *room_m* a sufficient distance from the
    line.
    """
    best, best_worth = me, worth(me, me, seeker, place, room_m)
    for k in range(DIRECTIONS):
        angle = 2.0 * math.pi * k / DIRECTIONS
        free = free_way(ranges_m, angle, radius_m, 2.0 * room_m)
        for share in (0.5, 1.0):
            way = share * free
            there = me[0] + way * elementary.cos(angle), me[1] + way * elementary.sin(angle)
            gain = worth(there, me, seeker, place, room_m)
            if gain > best_worth + 1e-6:
                best, best_worth = there, gain
    return best


@njit(cache=True)
def worth(there: Point, me: Point, seeker: Point, place: Point, room_m: float) -> float:
    """Return the worth of going *there* for a robot at *me*, if *seeker* heads for *place*: metres off its line."""
    off = min(distance_to_segment(there, seeker, place), room_m)
    if (
        distance_to_segment(seeker, me, there)
        < min(room_m, elementary.hypot(seeker[0] - me[0], seeker[1] - me[1])) - 1e-6
    ):
        return -1.0  # through the seeker, or nearer to it
    away = elementary.hypot(there[0] - seeker[0], there[1] - seeker[1])
    return off + AWAY * min(away, 4.0 * room_m) - 0.01 * elementary.hypot(there[0] - me[0], there[1] - me[1])


class Yielding:
    """Yields to the robots to which a way was promised."""

    def __init__(self, ways: Ways, radius_m: float, hold: Time, events: list[Event]) -> None:
        self._ways = ways
        self._radius_m = radius_m
        self._room_m = 2.0 * radius_m + SLACK_M
        self._hold = hold
        self._events = events
        self._until: Time | None = None
        self._aside: Point = (0.0, 0.0)

    def evade(self, observation: Observation, sightings: Mapping[Address, Point], now: Time) -> Point | None:
        """Return where to go, or to stay, out of another robot's way; None if the robot need not yield."""
        here = observation.x_m, observation.y_m
        ways = self._ways.of
        for seeker, place in sightings.items():
            way = ways[seeker]
            if way is None or not self._ways.book.identifiers[seeker]:
                continue
            line_end = way.x_m, way.y_m
            if in_the_way(here, place, line_end, self._room_m):
                if self._until is None:
                    self._events.append(MadeWay(seeker))
                self._until = now + self._hold
                self._aside = step_aside(here, place, line_end, observation.ranges_m, self._radius_m, self._room_m)
                break
        if self._until is None:
            return None
        if now >= self._until:
            self._until = None
            return None
        return self._aside


class Standoff:
    """Resolves it when two robots with goals want to pass the same door: that with the higher number yields.

    It assumes that the other one wants to go where it stands itself, and on. Both would try for ever otherwise.
    """

    def __init__(self, me: Address, radius_m: float, patience: Time) -> None:
        self._me = me
        self._radius_m = radius_m
        self._room_m = 2.0 * radius_m + SLACK_M
        self._patience = patience
        self._since: Time | None = None
        self._at: Point = (0.0, 0.0)
        self._until: Time = 0
        self._peer: Address = me

    def evade(self, observation: Observation, sightings: Mapping[Address, Point], now: Time) -> Point | None:
        """Return where to go, out of another robot's way; None if the robot need not yield."""
        here = observation.x_m, observation.y_m
        if now < self._until:
            return self._away(observation, here, sightings[self._peer]) if self._peer in sightings else None
        peer = self._opponent(here, sightings)
        if peer is None:
            self._since = None
        elif self._since is None or math.dist(here, self._at) > self._room_m:
            self._since, self._at = now, here
        elif now - self._since > self._patience:
            self._since, self._until, self._peer = None, now + YIELD_TIME, peer
        return None

    def _opponent(self, here: Point, sightings: Mapping[Address, Point]) -> Address | None:
        for peer, place in sightings.items():
            if peer < self._me and math.dist(here, place) < NEAR_CONTACTS * self._room_m:
                return peer
        return None

    def _away(self, observation: Observation, here: Point, peer_m: Point) -> Point:
        beyond = 3.0 * here[0] - 2.0 * peer_m[0], 3.0 * here[1] - 2.0 * peer_m[1]
        return step_aside(here, peer_m, beyond, observation.ranges_m, self._radius_m, self._room_m)
