"""Heading straight for a place in sight, and what to do when something is in the way after all.

A line of sight has no width, a body has: it touches the jamb of a door, or another body, and stands. Then it goes round
what it has touched, on the side on which the line to the place passes it, until there is room for its body on the line
again. What lies right ahead is passed on the right, so that two robots that meet pass each other. If its scan does not
show what it has touched (beams miss the end of a wall), it gropes: a little more to one side, then to the other. If all
this brings the robot no nearer for a while, it is *stalled*.
"""

import math

from cosim.jit import njit
from cosim.observation import Observation
from cosim.units import Time
from protocols.reflection.knowledge import Point
from protocols.reflection.yielding import Floats, free_way

ROUND_STEPS = 20
"""For so many steps at most a robot goes round what it has touched."""
ROOM_STEPS = 3.0
"""With room for so many steps on its line a robot goes straight again."""
AHEAD_STEPS = 10.0
"""A direction is turned into a place so many steps ahead."""
OFF = 0.5
"""How strongly a robot that goes round something turns away from it, for each tick on end in which it is blocked."""
NEAR_M = 0.03
GROPE_RAD = math.radians(30.0)
GROPE_STEPS = 4
"""A robot that gropes keeps a direction for so many steps, if it is not blocked again."""
UNSEEN_M = 0.1
"""What is farther away than this and the radius is not what the robot has touched."""
"""Who is as near as that to touching something turns away from it too: beams miss corners."""


class Straight:
    """One robot's straight ways."""

    def __init__(self, radius_m: float, step_m: float, patience: Time, now: Time) -> None:
        self._radius_m = radius_m
        self._step_m = step_m
        self._patience = patience
        self.begin(now)

    def begin(self, now: Time) -> None:
        """Begin to head for another place."""
        self._left = 0
        self._touches = 0
        self._groped = 0
        self._groping = 0
        self._side = -1.0
        self._shortest_m = math.inf
        self._progress_at = now

    @property
    def rounding(self) -> bool:
        """The robot is just going round something."""
        return self._left > 0

    def stalled(self, now: Time) -> bool:
        """Return whether the way has not become shorter for longer than one should wait."""
        return now - self._progress_at > self._patience

    def towards(self, place: Point, length_m: float, observation: Observation, now: Time) -> Point:
        """Return where to go in order to come to *place*; *length_m* is the way that is left, there and beyond."""
        if length_m < self._shortest_m - 0.25 * self._step_m:
            self._shortest_m = length_m
            self._progress_at = now
        self._touches = self._touches + 1 if observation.blocked else 0
        if not self._left and not self._touches:
            return place
        return self._round(place, observation)

    def _round(self, place: Point, observation: Observation) -> Point:
        x, y = observation.x_m, observation.y_m
        ranges = observation.ranges_m
        ahead = math.atan2(place[1] - y, place[0] - x)
        beam, nearest_m = nearest(ranges, ahead)
        if not self._left:
            self._left = ROUND_STEPS
            self._side = 1.0 if math.sin(beam - ahead) < 0.0 else -1.0
        self._left -= 1
        room_m = min(ROOM_STEPS * self._step_m, math.hypot(place[0] - x, place[1] - y))
        if (
            not self._touches
            and not self._groping
            and free_way(ranges, ahead, self._radius_m + NEAR_M, room_m) >= room_m
        ):
            self._left = 0
            return place
        if self._touches and nearest_m > self._radius_m + UNSEEN_M:
            self._groped, self._groping = self._groped + 1, GROPE_STEPS
        reach = AHEAD_STEPS * self._step_m
        if self._groping:
            return self._grope(x, y, ahead, reach)
        along = beam + self._side * 0.5 * math.pi
        off = OFF * max(self._touches, nearest_m < self._radius_m + NEAR_M)
        return (
            x + reach * (math.cos(along) - off * math.cos(beam)),
            y + reach * (math.sin(along) - off * math.sin(beam)),
        )

    def _grope(self, x: float, y: float, ahead: float, reach: float) -> Point:
        """Try 30 degrees to one side, to the other, 60 degrees, and so on."""
        self._groping -= 1
        apart = GROPE_RAD * ((self._groped + 1) // 2)
        angle = ahead + (apart if self._groped % 2 else -apart)
        if not self._groping:
            self._groped = 0
        return x + reach * math.cos(angle), y + reach * math.sin(angle)


@njit(cache=True)
def nearest(ranges_m: Floats, ahead_rad: float) -> tuple[float, float]:
    """Return the direction (rad) and distance (m) of the nearest thing that a scan has hit in the half plane ahead.

    Where it has hit nothing, that is as if something were right ahead.
    """
    best, at = math.inf, ahead_rad
    for beam in range(ranges_m.shape[0]):
        hit_m, angle = ranges_m[beam], 2.0 * math.pi * beam / ranges_m.shape[0]
        if hit_m < best and math.cos(angle - ahead_rad) > 0.0:
            best, at = hit_m, angle
    return at, best
