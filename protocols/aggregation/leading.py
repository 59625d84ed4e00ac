"""How a host divides its sub-team's work: which posts are its to see to, and which of them it gives to whom.

The paper (002, section VI.A) asks for "dynamic task allocation" and does not say which. Chosen: a searcher that has
nothing left is given a part of what nobody has been given yet; if there is nothing, half of what the busiest of those
in contact has left. The region of a host that has fallen silent, or leads nobody, falls to the one whose rally point is
nearest: all who hear each other agree who that is.
"""

import math
from collections.abc import Collection, Mapping, Sequence

from cosim.geometry.planning import Point
from cosim.machine import Address
from protocols.aggregation.roll import Roll
from protocols.aggregation.setup import Setup
from protocols.aggregation.tours import tours


class Work:
    """The posts of one sub-team."""

    def __init__(self, setup: Setup, host: Address, rallies_m: Sequence[Point], at_random: bool) -> None:
        """Divide nothing if the searchers move *at_random*."""
        self._setup = setup
        self._host = host
        self._rallies_m = rallies_m
        self._random = at_random
        self._own = setup.regions[host]

    def first(self, searchers: Sequence[Address]) -> Mapping[Address, tuple[int, ...]]:
        """Return the tours of all *searchers* at the start."""
        starts = [self._setup.starts_m[searcher] for searcher in searchers]
        if not searchers:
            return {}
        return dict(zip(searchers, tours(self._setup.ground, self._own, starts), strict=True))

    def next(
        self, here_m: Point, roll: Roll, visited: Collection[int], idle: Collection[Address], waiting: int
    ) -> tuple[int, ...]:
        """Return what a searcher at *here_m* is to do, if *waiting* others need work, too; nothing if all is given."""
        if self._random:
            return ()
        free = self._responsible(idle) - set(visited) - roll.taken(visited)
        if not free:
            return ()
        parts = tours(self._setup.ground, free, [here_m] * min(1 + waiting, len(free)))
        return next((part for part in parts if part), ())

    def shared(self, posts: Collection[int], here_m: Point, there_m: Point) -> tuple[tuple[int, ...], ...]:
        """Return the *posts* of a searcher in two parts: for one that is here, and for itself, there."""
        return tours(self._setup.ground, posts, [here_m, there_m])

    def _responsible(self, idle: Collection[Address]) -> set[int]:
        """Return the own posts, and those of *idle* hosts that are nearest to this one."""
        posts = set(self._own)
        living = [host for host in range(self._setup.hosts) if host not in idle]
        for host in idle:
            rally = self._rallies_m[host]
            heir = min(living, key=lambda each: (math.dist(self._rallies_m[each], rally), each))
            if heir == self._host:
                posts |= self._setup.regions[host]
        return posts
