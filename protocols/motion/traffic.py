"""What a robot knows of the others on the floor, from its camera and from what they broadcast."""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.navigation.dwa import BODY_COLUMNS
from cosim.observation import Observation
from cosim.units import Time, from_seconds, to_seconds
from protocols.motion.floor import Blocker
from protocols.motion.frames import Shift

_MOVED_M: Final = 0.02
"""Distance up to which a robot counts as not having moved."""
_NEAR_M: Final = 8.0
"""Distance beyond which other robots are not in the way yet."""
_SILENT_S: Final = 15.0  # it may be dead
"""Time without motion and without a message after which a robot counts as idle."""
_UNSEEN_M: Final = 4.0
"""Last known distance beyond which a robot cannot come round the next corner."""


class Other(NamedTuple):
    """Another robot, as known from what it has reported; in the frame of the robot that knows it."""

    address: Address
    x_m: float
    y_m: float
    radius_m: float
    speed_mps: float = 0.0
    heading_rad: float = 0.0
    braking_mps2: float = 1.0
    goal_m: Point | None = None
    """Where it is going, if it has reported that."""
    idle: bool = False
    """True if it has reported that it is not going anywhere."""
    age_s: float = 0.0
    """Age of the report; infinite without one."""


class Track:
    """Where one other robot is, and for how long it has stood there."""

    def __init__(self, address: Address) -> None:
        self.address = address
        self.place_m: Point = (math.inf, math.inf)
        self.radius_m, self.change = 0.0, 0.0
        self.goal_m: Point | None = None
        self.idle = False
        self.seen: Time = -1
        """Time at which the camera has seen it last; -1: never."""
        self.gone_m: Point | None = None
        """Displacement in the last tick, if it was seen before and after."""
        self._stood_m: Point = (math.inf, math.inf)
        self._since: Time = 0

    def at(self, place_m: Point, now: Time) -> None:
        """Note that it is at a place."""
        self.place_m = place_m
        if math.dist(place_m, self._stood_m) > _MOVED_M:
            self._stood_m, self._since = place_m, now

    def carry(self, carried: Shift) -> None:
        """Convert its places to a frame that has been corrected since."""
        self.place_m = carried.point(*self.place_m)
        self._stood_m = carried.point(*self._stood_m)

    def still_s(self, now: Time) -> float:
        """Return for how long it has not moved, seconds."""
        return to_seconds(now - self._since)

    @property
    def blocker(self) -> Blocker:
        """The body as an obstacle."""
        return Blocker(*self.place_m, self.radius_m)


class Traffic:
    """All others, as one robot knows them."""

    def __init__(self, me: Address, radius_m: float, change: float, seconds: float) -> None:
        """Take the robot's own radius and change of way per tick, assumed of others that have not reported."""
        self._me, self._radius_m, self._change, self._seconds = me, radius_m, change, seconds
        self._tracks: dict[Address, Track] = {}
        self._now: Time = 0
        self._blind = False

    def look(self, observation: Observation, others: Sequence[Other], now: Time, carried: Shift | None = None) -> None:
        """Take what is seen now, and what is known of the robots that are not seen.

        *carried*: shift from the robot's frame at the last tick to that of this one, if it was corrected.
        """
        self._now, self._blind = now, observation.view is None
        seen = {sighting.address: (sighting.x_m, sighting.y_m) for sighting in observation.sightings}
        for other in others:
            if other.address != self._me:
                self._hear(other, other.address in seen, now)
        for address, place in seen.items():
            track = self._tracks.get(address)
            if track is None:
                track = self._tracks[address] = Track(address)
                track.radius_m, track.change = self._radius_m, self._change
            before = now - from_seconds(self._seconds)
            if carried is not None and track.seen == before:
                track.carry(carried)
            was = track.place_m
            track.gone_m = (place[0] - was[0], place[1] - was[1]) if track.seen == before else None
            track.seen = now
            track.at(place, now)

    def _hear(self, other: Other, seen: bool, now: Time) -> None:
        track = self._tracks.setdefault(other.address, Track(other.address))
        track.radius_m, track.change = other.radius_m, other.braking_mps2 * (self._seconds * self._seconds)
        # a robot that goes nowhere is in the way until it is driven round: do not wait for it
        silent = min(other.age_s, track.still_s(now)) >= _SILENT_S
        track.goal_m, track.idle = other.goal_m, other.idle or silent
        if not seen:
            track.at((other.x_m, other.y_m), now)
            cos, sin = elementary.cos(other.heading_rad), elementary.sin(other.heading_rad)
            way = other.speed_mps * self._seconds
            track.gone_m = way * cos, way * sin

    def of(self, address: Address | None) -> Track | None:
        """Return the track of one robot; None if nothing is known of it."""
        return None if address is None else self._tracks.get(address)

    def tracks(self, here: Point) -> list[Track]:
        """Return the robots that are near, the nearest first."""
        near = [(math.dist(here, track.place_m), track.address, track) for track in self._tracks.values()]
        return [track for off, _, track in sorted(near, key=lambda each: each[:2]) if off < _NEAR_M]

    def standing(self, here: Point, but: Address | None = None) -> list[Blocker]:
        """Return the bodies near by that have not moved for a second, without robot *but*."""
        return [
            track.blocker for track in self.tracks(here) if track.address != but and track.still_s(self._now) >= 1.0
        ]

    def _visible(self) -> Iterator[Track]:
        # sorted, so that results do not depend on the order in which robots were met
        for address in sorted(self._tracks):
            track = self._tracks[address]
            if track.seen == self._now or self._blind:
                yield track

    def bodies(self) -> Floats:
        """Return the rows of the robots in sight for :mod:`cosim.navigation.dwa`."""
        rows = [
            (*track.place_m, *(track.gone_m or (0.0, 0.0)), track.radius_m, track.change) for track in self._visible()
        ]
        return np.array(rows, np.float64).reshape(-1, BODY_COLUMNS)

    def surprises(self, here: Point, near_m: float) -> bool:
        """Return whether a robot near by is seen for the first time, so that its motion is not known."""
        return any(track.gone_m is None and math.dist(here, track.place_m) < near_m for track in self._visible())

    def unseen_near(self, here: Point) -> bool:
        """Return whether a robot that is not in sight may come round the next corner."""
        return any(
            track.seen != self._now and math.dist(here, track.place_m) < _UNSEEN_M for track in self._tracks.values()
        )
