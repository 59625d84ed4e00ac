"""What a robot counts."""

from dataclasses import dataclass, field

from cosim.units import Time


@dataclass(slots=True)
class Records:
    """Counts of one robot."""

    steps: int = 0
    """Ticks in which the schemas, or a rival algorithm, led it."""
    escape_steps: int = 0
    """Ticks in which it followed a path out of a local minimum."""
    stalls: int = 0
    """Times that it was caught in a local minimum."""
    frames: int = 0
    payload_bytes: int = 0
    pieces_again: int = 0
    """Pieces of maps that it has told on demand; they had been told before."""
    pieces_known: int = 0
    """Pieces that it has heard and had already."""
    way_m: float = 0.0
    blocked: int = 0
    """Ticks in which a wall or a body held it up."""
    given_up: int = 0
    """Frontier cells that it gave up."""
    finished_at: Time | None = None
    known: list[int] = field(default_factory=list)
    """Cells that it knows, each second."""
