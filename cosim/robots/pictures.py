"""What cameras have seen, of all robots at once: found out when the first robot asks, at this tick or later.

Most machines look at few of the pictures that they are handed, many at none. Errors are drawn by tick and pair, so that
it does not matter when, or if, a picture is made.
"""

import math
from collections.abc import Collection, Sequence
from functools import cached_property
from itertools import pairwise, repeat
from typing import Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Floats, Int64s
from cosim.geometry.segments import PackedWalls
from cosim.observation import Sighting
from cosim.robots.sense_kernels import BLIND, DISTANCE_ERROR, OWN_X, OWN_Y, RANGE, Room, see
from cosim.world.sight import lines_of_sight, seen_by_each

_IN_SIGHT: Final = 128
"""Number of others in sight of each robot for which there is room at first."""
_ROUNDING_M: Final = 1e-6
"""More than rounding makes of distances on any floor, metres."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class TeamPicture(Protocol):
    """What all robots see at one tick."""

    def visible(self, robot: int) -> tuple[int, ...]:
        """Return whom *robot* sees."""

    def sightings(self, robot: int) -> tuple[Sighting, ...]:
        """Return whom *robot* sees, and where."""

    def around(self, robot: int, x_m: float, y_m: float, reach_m: float) -> Sequence[Sighting]:
        """Return those whom *robot* sees nearer than *reach_m* to a place."""


class OnePicture(NamedTuple):
    """What one robot sees of it: a :class:`cosim.observation.Picture`."""

    team: TeamPicture
    robot: int

    @property
    def visible(self) -> tuple[int, ...]:
        """Whom the robot sees."""
        return self.team.visible(self.robot)

    @property
    def sightings(self) -> tuple[Sighting, ...]:
        """Whom the robot sees, and where."""
        return self.team.sightings(self.robot)

    def around(self, x_m: float, y_m: float, reach_m: float) -> Sequence[Sighting]:
        """Return those whom the robot sees nearer than *reach_m* to a place."""
        return self.team.around(self.robot, x_m, y_m, reach_m)


def pictures(team: TeamPicture, size: int) -> list[OnePicture]:
    """Return the picture of each robot of a team of some *size*."""
    return list(map(_new, repeat(OnePicture), zip(repeat(team), range(size))))  # without a loop in Python


class _Look(NamedTuple):
    """Who is seen, robot by robot."""

    ends: list[int]
    """Where the share of each robot begins, or that of the one before ends."""
    others: Int64s
    """Shape (k,)."""
    places: Floats
    """Where they are, shape (2, k)."""


class Cameras:
    """What the robots' cameras see, with their errors, each in its own frame."""

    def __init__(self, room: Room, tick: int) -> None:
        """Look from where the robots are now; the tick says which errors are drawn."""
        poses, limits, numbers, members = room
        self._poses = poses.copy()
        self._room: Room = self._poses, limits, numbers, members
        self._tick = tick
        self._looks: dict[float, _Look] = {}
        """Who is seen, by the range of sight."""
        self._sightings: dict[int, tuple[Sighting, ...]] = {}
        """What robots have asked for."""
        self._about: dict[float, list[list[Sighting]]] = {}
        """Of all robots, whom they see nearer than a reach, for those that have been asked for."""

    def without(self, robot: int) -> "Cameras":
        """Return the same, but that *robot* has seen nothing."""
        other = Cameras(self._room, self._tick)
        other._poses[robot, BLIND] = 1.0
        return other

    def _within(self, reach_m: float) -> _Look:
        """Return who is seen nearer than *reach_m*, by what the robots measure, and some beyond."""
        poses, limits, numbers, members = self._room
        most_m = limits[RANGE]
        if reach_m < most_m:  # in whole metres, so that there are few looks
            most_m = min(math.ceil((reach_m + _ROUNDING_M) / (1.0 - limits[DISTANCE_ERROR])), most_m)
        for range_m, look in self._looks.items():
            if range_m >= most_m:
                return look
        limits = limits.copy()
        limits[RANGE] = most_m
        look = self._looks[most_m] = self._look((poses, limits, numbers, members))
        return look

    def _look(self, room: Room) -> _Look:
        count = len(self._poses)
        ends, most = np.empty(count + 1, np.int64), min(count, _IN_SIGHT) * count
        while True:
            others, places = np.empty(most, np.int64), np.empty((2, most))
            seen = see(*room, self._tick, ends, others, places)
            if seen <= most:
                return _Look(ends.tolist(), others, places)
            most = seen

    def visible(self, robot: int) -> tuple[int, ...]:
        """Return whom *robot* sees."""
        ends, others, _ = self._within(math.inf)
        return tuple(others[ends[robot] : ends[robot + 1]].tolist())

    def sightings(self, robot: int) -> tuple[Sighting, ...]:
        """Return whom *robot* sees, and where: the same object whenever it is asked."""
        seen = self._sightings.get(robot)
        if seen is None:
            ends, others, places = self._within(math.inf)
            share = slice(ends[robot], ends[robot + 1])
            seen = self._sightings[robot] = tuple(_sightings(others[share], places[:, share]))
        return seen

    def around(self, robot: int, x_m: float, y_m: float, reach_m: float) -> list[Sighting]:
        """Return those whom *robot* sees nearer than *reach_m* to a place: of the others nothing is made."""
        gone_m = math.dist((x_m, y_m), self._poses[robot, OWN_X : OWN_Y + 1].tolist())
        if gone_m == 0.0:
            return self._around_all(reach_m)[robot]  # at the tick of the picture, as most robots ask: all at once
        ends, others, places = self._within(gone_m + reach_m)
        share = slice(ends[robot], ends[robot + 1])
        dx, dy = places[0, share] - x_m, places[1, share] - y_m
        near = np.flatnonzero(dx * dx + dy * dy < reach_m * reach_m) + ends[robot]
        return _sightings(others[near], places[:, near]) if len(near) else []

    def _around_all(self, reach_m: float) -> list[list[Sighting]]:
        """Return whom each robot sees nearer than *reach_m* to where it is: what ``around`` returns there."""
        about = self._about.get(reach_m)
        if about is None:
            ends, others, places = self._within(reach_m)
            here = np.repeat(self._poses[:, OWN_X : OWN_Y + 1].T, np.diff(ends), axis=1)
            dx, dy = places[:, : ends[-1]] - here
            near = np.flatnonzero(dx * dx + dy * dy < reach_m * reach_m)
            seen, shares = _sightings(others[near], places[:, near]), np.searchsorted(near, ends).tolist()
            about = self._about[reach_m] = [seen[first:end] for first, end in pairwise(shares)]
        return about


def _sightings(others: Int64s, places: Floats) -> list[Sighting]:
    return list(map(_new, repeat(Sighting), zip(others.tolist(), *places.tolist(), strict=True)))


class Sightlines:
    """Which robots have no wall between them, for protocols that need to know no more."""

    def __init__(self, walls: PackedWalls, positions_m: Floats, range_m: float, blind: Collection[int]) -> None:
        """Look from *positions_m* (n, 2) at this tick, but not with the eyes of *blind* robots."""
        self._seen_from = walls, positions_m.copy(), range_m
        self._blind = list(blind)

    @cached_property
    def _visible(self) -> list[tuple[int, ...]]:
        seen = lines_of_sight(*self._seen_from)
        seen[self._blind] = False
        return seen_by_each(seen)

    def visible(self, robot: int) -> tuple[int, ...]:
        """Return whom *robot* sees."""
        return self._visible[robot]

    def sightings(self, robot: int) -> tuple[Sighting, ...]:
        """Return nobody: where they are is not seen."""
        return ()

    def around(self, robot: int, x_m: float, y_m: float, reach_m: float) -> tuple[Sighting, ...]:
        """Return nobody."""
        return ()
