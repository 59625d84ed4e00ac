"""What cameras have seen, of all robots at once: found out when the first robot asks, at this tick or later.

Most machines look at few of the pictures that they are handed, many at none. Errors are drawn by tick and pair, so that
it does not matter when, or if, a picture is made.
"""

from collections.abc import Collection, Sequence
from functools import cached_property
from itertools import pairwise, repeat
from typing import Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.segments import PackedWalls
from cosim.observation import Sighting
from cosim.robots.sense_kernels import BLIND, Room, see
from cosim.world.sight import lines_of_sight, seen_by_each

_IN_SIGHT: Final = 32
"""Number of others in sight of each robot for which there is room at first."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class TeamPicture(Protocol):
    """What all robots see at one tick."""

    @property
    def visible(self) -> Sequence[tuple[int, ...]]:
        """Whom each robot sees."""

    @property
    def sightings(self) -> Sequence[tuple[Sighting, ...]]:
        """Whom each robot sees, and where."""


class OnePicture(NamedTuple):
    """What one robot sees of it: a :class:`cosim.observation.Picture`."""

    team: TeamPicture
    robot: int

    @property
    def visible(self) -> tuple[int, ...]:
        """Whom the robot sees."""
        return self.team.visible[self.robot]

    @property
    def sightings(self) -> tuple[Sighting, ...]:
        """Whom the robot sees, and where."""
        return self.team.sightings[self.robot]


def pictures(team: TeamPicture, size: int) -> list[OnePicture]:
    """Return the picture of each robot of a team of some *size*."""
    return list(map(_new, repeat(OnePicture), zip(repeat(team), range(size))))  # without a loop in Python


class Cameras:
    """What the robots' cameras see, with their errors, each in its own frame."""

    def __init__(self, room: Room, tick: int) -> None:
        """Look from where the robots are now; the tick says which errors are drawn."""
        poses, limits, numbers, members = room
        self._poses = poses.copy()
        self._room: Room = self._poses, limits, numbers, members
        self._tick = tick

    def without(self, robot: int) -> "Cameras":
        """Return the same, but that *robot* has seen nothing."""
        other = Cameras(self._room, self._tick)
        other._poses[robot, BLIND] = 1.0
        return other

    @cached_property
    def _found(self) -> tuple[list[tuple[int, int]], list[int], list[float], list[float]]:
        """Which of those seen are whose, and all that are seen, robot by robot: who, and where."""
        count = len(self._poses)
        ends, room = np.empty(count + 1, np.int64), min(count, _IN_SIGHT) * count
        while True:
            others, places = np.empty(room, np.int64), np.empty((2, room))
            seen = see(*self._room, self._tick, ends, others, places)
            if seen <= room:
                return list(pairwise(ends.tolist())), others[:seen].tolist(), *places[:, :seen].tolist()
            room = seen

    @cached_property
    def visible(self) -> list[tuple[int, ...]]:
        """Whom each robot sees."""
        shares, others, _, _ = self._found
        return [tuple(others[begin:end]) for begin, end in shares]

    @cached_property
    def sightings(self) -> list[tuple[Sighting, ...]]:
        """Whom each robot sees, and where."""
        shares, *seen = self._found
        sightings = [_new(Sighting, other_there) for other_there in zip(*seen, strict=True)]
        return [tuple(sightings[begin:end]) for begin, end in shares]


class Sightlines:
    """Which robots have no wall between them, for protocols that need to know no more."""

    def __init__(self, walls: PackedWalls, positions_m: Floats, range_m: float, blind: Collection[int]) -> None:
        """Look from *positions_m* (n, 2) at this tick, but not with the eyes of *blind* robots."""
        self._seen_from = walls, positions_m.copy(), range_m
        self._blind = list(blind)

    @cached_property
    def visible(self) -> list[tuple[int, ...]]:
        """Whom each robot sees."""
        seen = lines_of_sight(*self._seen_from)
        seen[self._blind] = False
        return seen_by_each(seen)

    @cached_property
    def sightings(self) -> list[tuple[Sighting, ...]]:
        """Nobody: where they are is not seen."""
        return [()] * len(self._seen_from[1])
