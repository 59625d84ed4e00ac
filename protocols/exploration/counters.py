"""What a robot counts."""

from dataclasses import dataclass, field

from cosim.units import Time
from protocols.mapping.sharing import SharingCounters


@dataclass(slots=True)
class Counters(SharingCounters):
    """Counts of one robot."""

    steps: int = 0
    """Ticks in which the schemas, or a rival algorithm, led it."""
    escape_steps: int = 0
    """Ticks in which it followed a path out of a local minimum."""
    by_frontiers: int = 0
    """Steps in which the frontiers, and the cells of a path, were the strongest schema;"""
    by_obstacles: int = 0
    """obstacles were;"""
    by_robots: int = 0
    """other robots were."""
    stalls: int = 0
    """Times that it was caught in a local minimum."""
    way_m: float = 0.0
    waited: int = 0
    """Ticks in which its filter had it wait."""
    ticks: int = 0
    blocked: int = 0
    """Ticks in which a wall or a body held it up."""
    given_up: int = 0
    """Frontier cells that it gave up."""
    finished_at: Time | None = None
    known: list[int] = field(default_factory=list)
    """Cells that it knows, each second."""

    def drawn(self, frontiers: float, obstacles: float, robots: float) -> None:
        """Count a step by the strongest of its schemas, given how strong they were; of equal ones by the first."""
        if frontiers >= obstacles and frontiers >= robots:
            self.by_frontiers += 1
        elif obstacles >= robots:
            self.by_obstacles += 1
        else:
            self.by_robots += 1
