"""The events of exploration, as rows of the trace."""

from dataclasses import dataclass, field

from protocols.wire import BadBytes

_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_WHY = {"meaning": "what has made the robot think so"}
_CELLS = {"meaning": "how many cells it has"}
_IN_SIGHT = {"meaning": "whether the frontier is in line of sight"}


@dataclass(frozen=True, slots=True)
class Stalled:
    """A robot takes itself to be caught in a local minimum."""

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
    """A robot follows its path no more."""

    why: str = field(metadata=_WHY)


@dataclass(frozen=True, slots=True)
class FrontierGivenUp:
    """A robot will not go to a frontier any more: connected cells, whose middle is there."""

    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    why: str = field(metadata=_WHY)
    cells: int = field(default=1, metadata=_CELLS)


@dataclass(frozen=True, slots=True)
class Explored:
    """A robot knows of no frontier that it has not given up."""


EVENTS = (Stalled, PathLaid, PathLeft, FrontierGivenUp, Explored, BadBytes)
"""All of them, for the protocol's specification."""
