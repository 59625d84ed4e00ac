"""What all explorers of a run know beforehand."""

from dataclasses import dataclass

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import Time
from protocols.exploration.targets import Targets
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief, Frame


@dataclass(frozen=True, eq=False)
class Setup:
    """The team, the frame of its maps, and, if the scenario says so, the one map that all have."""

    size: int
    tick: Time
    frame: Frame
    starts_m: tuple[Point, ...]
    radii_m: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    range_m: float
    """How far the robots' range scanners reach."""
    beams: int
    shared: Belief | None
    """The map that all have in common; None if each has its own."""
    terrain: Terrain | None
    """Where robots can go by it."""
    targets: Targets | None
    """What robots with a map in common, and an algorithm that chooses frontiers, have in common beside it."""
    places_m: dict[Address, Point]
    """Where the others are, as all know who have a map in common; empty if each has its own."""
