"""What all machines of a run know beforehand: the floor, the posts, the first sub-teams; and where the targets are.

The places of the targets serve only the robots' cameras: no decision rests on them.
"""

from dataclasses import dataclass
from typing import TypeAlias

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.ground import Ground
from protocols.localization.positioning import KnownMaps

Tours: TypeAlias = tuple[tuple[int, ...], ...]
"""For each of several searchers, the posts that it is to visit, in order."""


@dataclass(frozen=True)
class Setup:
    """Static knowledge, the same for all machines of a run. Lengths in metres."""

    size: int
    hosts: int
    tick: Time
    ground: Ground
    regions: tuple[frozenset[int], ...]
    """Posts of each sub-team in the beginning."""
    starts_m: tuple[Point, ...]
    """Starting places of the robots, where all are in contact."""
    radii_m: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    targets_m: tuple[Point, ...]
    area_m2: float
    """Area of the floor's bounds."""
    exit_m: Point | None
    """Exit of the floor, if it names one."""
    maps: KnownMaps
    """The floor as maps on which robots localise."""
    integration_s: float | None = None
    """SRP's static integration time, s from the start; None if finds are not kept back for one."""

    def host_of(self, searcher: Address) -> Address:
        """Return the host in whose sub-team *searcher* begins."""
        return (searcher - self.hosts) % self.hosts

    def searchers_of(self, host: Address) -> tuple[Address, ...]:
        """Return the searchers that begin in the sub-team of *host*."""
        return tuple(range(self.hosts + host, self.size, self.hosts))
