"""What all machines of a run know beforehand: the floor, the posts, who leads whom; and where the targets are.

Where the targets are serves a robot's camera alone, which has to be asked about places: no decision rests on it.
"""

from dataclasses import dataclass
from typing import TypeAlias

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.ground import Ground

Tours: TypeAlias = tuple[tuple[int, ...], ...]
"""The posts that each of several searchers is to visit, in order."""


@dataclass(frozen=True)
class Setup:
    """The same for all machines of a run. Lengths in metres."""

    size: int
    hosts: int
    tick: Time
    ground: Ground
    regions: tuple[frozenset[int], ...]
    """The posts of each sub-team in the beginning."""
    starts_m: tuple[Point, ...]
    """Where the robots start: the place where all are in contact."""
    radii_m: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    targets_m: tuple[Point, ...]
    area_m2: float
    """Of the floor."""
    exit_m: Point | None
    """The floor's exit, if it names one."""

    def host_of(self, searcher: Address) -> Address:
        """Return in whose sub-team *searcher* begins."""
        return (searcher - self.hosts) % self.hosts

    def searchers_of(self, host: Address) -> tuple[Address, ...]:
        """Return who begins in the sub-team of *host*."""
        return tuple(range(self.hosts + host, self.size, self.hosts))
