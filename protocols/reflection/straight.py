"""Heading straight for a place in sight, and what to do when something is in the way after all.

A line of sight has no width, but a body has: it touches the jamb of a door, or another body, and stands. Then it steps
aside, to the side on which it sees more room, 45 or 90 degrees off its line; to the other side if both are blocked, and
then half back. After a step that was free it tries its line again. It passes on the right what lies right ahead, so
that two robots that meet pass each other. If all this brings the robot no nearer for a while, it is *stalled*.
"""

import math

import cosim.elementary as elementary
from cosim.observation import Observation
from cosim.units import Time
from protocols.motion.progress import Progress
from protocols.reflection.setup import Point

AHEAD_STEPS = 10.0
"""Distance of the place that stands for a direction, in motion steps."""
ASIDE_STEPS = 2.0
"""Length of a step aside, in motion steps."""
ASIDE_TICKS = 20
"""Longest duration of a step aside: a body that has to gather speed is slow."""
# A command acts a tick late.
DEAF_TICKS = 3
"""Ticks before which a step aside is not known to be blocked."""
TRIES = tuple(math.radians(angle) for angle in (45.0, 90.0, -45.0, -90.0, 135.0, -135.0))
"""Angles off its line at which a robot steps aside, tried in this order; negative is the other side."""
CALM_STEPS = 20
"""Steps without a touch after which a robot chooses its side again."""
PROBES = (1.5, 3.0, 4.5, 6.0)
"""Distances ahead, in radii, at which it looks for obstacles at the edges of where the body would pass."""
BODY_CONTACTS = 1.75
"""Distance within which another robot may be in the way, in distances of two bodies that touch."""


class Straight:
    """One robot's straight ways."""

    def __init__(self, radius_m: float, step_m: float, patience: Time, now: Time) -> None:
        self._radius_m = radius_m
        self._step_m = step_m
        self._patience = patience
        self._progress = Progress(0.25 * step_m)
        self.begin(now)

    def begin(self, now: Time) -> None:
        """Begin to head for another place."""
        self._ticks = 0
        self._tried = 0
        self._side = -1.0
        self._calm = CALM_STEPS
        self._from: Point = (0.0, 0.0)
        self._progress.begin(now)

    @property
    def rounding(self) -> bool:
        """True if the robot is going round something."""
        return self._ticks > 0

    def stalled(self, now: Time) -> bool:
        """Return whether the way has not become shorter for longer than the robot's patience."""
        return self._progress.held(now) > self._patience

    def towards(self, place: Point, length_m: float, observation: Observation, now: Time) -> Point:
        """Return where to go in order to reach *place*; *length_m* is the way that is left, there and beyond."""
        self._progress.look(length_m, now)
        if not self._ticks and not observation.blocked:
            self._calm += 1
            return place
        return self._step_aside(place, observation)

    def _step_aside(self, place: Point, observation: Observation) -> Point:
        x, y = observation.x_m, observation.y_m
        ahead = elementary.atan2(place[1] - y, place[0] - x)
        if not self._ticks:
            if self._calm >= CALM_STEPS:
                self._side = self._roomy_side(ahead, math.hypot(place[0] - x, place[1] - y), observation)
            self._calm = self._tried = 0
            self._from = x, y
        elif self._ticks >= DEAF_TICKS and observation.blocked:
            self._tried = (self._tried + 1) % len(TRIES)
            self._ticks, self._from = 0, (x, y)
        elif self._ticks >= ASIDE_TICKS or math.dist(self._from, (x, y)) >= (ASIDE_STEPS - 0.1) * self._step_m:
            self._ticks = 0
            self._side = math.copysign(self._side, self._side * TRIES[self._tried])
            return place
        self._ticks += 1
        angle = ahead + self._side * TRIES[self._tried]
        reach = AHEAD_STEPS * self._step_m
        return x + reach * elementary.cos(angle), y + reach * elementary.sin(angle)

    def _roomy_side(self, ahead: float, distance_m: float, observation: Observation) -> float:
        """Return the side of the line *ahead* on which less is in the way: 1 for the left, -1 for the right."""
        # Scans have too few beams for the end of a wall, so the robot looks for places beside its line.
        x, y = observation.x_m, observation.y_m
        radius = self._radius_m
        cos, sin = elementary.cos(ahead), elementary.sin(ahead)
        ways = [min(probe * radius, distance_m) for probe in PROBES]
        edges = [(x + way * cos - side * sin, y + way * sin + side * cos) for side in (radius, -radius) for way in ways]
        seen = observation.sees(edges)
        room = sum(seen[: len(ways)]) - sum(seen[len(ways) :])
        for sighting in observation.sightings:
            dx, dy = sighting.x_m - x, sighting.y_m - y
            if dx * cos + dy * sin > 0.0 and math.hypot(dx, dy) < BODY_CONTACTS * 2.0 * radius:
                room += len(ways) if dy * cos - dx * sin < -0.5 * radius else -len(ways)
        return 1.0 if room > 0 else -1.0
