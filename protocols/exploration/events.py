"""What an explorer reports: events, as rows of the trace, and counters, for the metrics."""

from dataclasses import dataclass, field

from cosim.units import Time
from protocols.mapping.sharing import SharingCounters

_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_WHY = {"meaning": "what has made the robot think so"}
_CELLS = {"meaning": "how many cells it has"}
_IN_SIGHT = {"meaning": "whether the frontier is in line of sight"}


@dataclass(frozen=True, slots=True)
class Stalled:
    """A robot believes that it is caught in a local minimum."""

    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class PathLaid:
    """A robot has laid a path to a frontier into its own map, as cells that seem unexplored."""

    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    cells: int = field(metadata=_CELLS)
    in_sight: bool = field(metadata=_IN_SIGHT)


@dataclass(frozen=True, slots=True)
class PathLeft:
    """A robot no longer follows its path."""

    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class FrontierGivenUp:
    """A robot gives up a frontier: connected cells, whose middle is there."""

    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    why: str = field(metadata=_WHY)
    cells: int = field(default=1, metadata=_CELLS)


@dataclass(frozen=True, slots=True)
class Explored:
    """A robot knows of no frontier that it has not given up."""


EVENTS = (Stalled, PathLaid, PathLeft, FrontierGivenUp, Explored)
"""Events of what leads a robot."""


@dataclass(slots=True)
class Counters(SharingCounters):
    """Counts of one robot."""

    steps: int = 0
    """Ticks in which the schemas, or a rival algorithm, led it."""
    escape_steps: int = 0
    """Ticks in which it followed a path out of a local minimum."""
    by_frontiers: int = 0
    """Steps in which the frontiers, and the cells of a path, were the strongest schema."""
    by_obstacles: int = 0
    """Steps in which obstacles were the strongest schema."""
    by_robots: int = 0
    """Steps in which other robots were the strongest schema."""
    stalls: int = 0
    """Times that it was caught in a local minimum."""
    way_m: float = 0.0
    """Length of the way that it has driven."""
    waited: int = 0
    """Ticks in which its filter made it wait."""
    ticks: int = 0
    blocked: int = 0
    """Ticks in which a wall or a body held it up."""
    given_up: int = 0
    """Frontier cells that it gave up."""
    finished_at: Time | None = None
    known: list[int] = field(default_factory=list)
    """Cells that it knows, one number a second."""

    def drawn(self, frontiers: float, obstacles: float, robots: float) -> None:
        """Count a step by the strongest of its schemas, given their strengths; of equal ones by the first."""
        if frontiers >= obstacles and frontiers >= robots:
            self.by_frontiers += 1
        elif obstacles >= robots:
            self.by_obstacles += 1
        else:
            self.by_robots += 1
