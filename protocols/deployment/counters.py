"""What a robot counts."""

from dataclasses import dataclass, field, fields

from cosim.units import Time


@dataclass(slots=True)
class Counters:
    """Counts of one robot, and, as far as it was host, of the plays that it has had played."""

    plans: int = 0
    """Plans that it has begun to execute as host."""
    refused: int = 0
    """Plays that were called and cannot be played."""
    ended: list[tuple[int, str, Time]] = field(default_factory=list)
    """Number and result of the plans that it has ended as host, and when."""
    ordered: int = 0
    """Orders that its executive has given; those to others than itself are letters."""
    obeyed: int = 0
    """Orders that it has begun to carry out."""
    failed: int = 0
    """Orders that it could not carry out."""
    asides: int = 0
    """Times that it has stepped aside, ordered or asked."""
    lost: int = 0
    """Times that it, as host, took a robot for lost."""
    successions: int = 0
    """Times that it has become host in another's place."""
    breaches: int = 0
    letters: int = 0
    """Letters that it has posted."""
    returned: int = 0
    """Letters that were given up."""
    letter_bytes: int = 0
    frames: int = 0
    """Frames that it has put on the air, copies and acknowledgements included."""
    frame_bytes: int = 0
    pictures: int = 0
    way_m: float = 0.0
    blocked: int = 0
    """Ticks in which a wall or a body held it up."""

    def carry(self, before: "Counters") -> None:
        """Count on from where those of the robot's former life, *before* it booted again, have come to."""
        for each in fields(self):
            setattr(self, each.name, getattr(before, each.name) + getattr(self, each.name))
