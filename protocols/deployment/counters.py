"""The counters of a robot."""

from dataclasses import dataclass, field, fields

from cosim.units import Time


@dataclass(slots=True)
class Counters:
    """Counts of one robot, and of the plays that it has executed as host."""

    plans: int = 0
    """Plans that it has begun to execute as host."""
    refused: int = 0
    """Plays that were called and refused."""
    ended: list[tuple[int, str, Time]] = field(default_factory=list)
    """Number and result of the plans that it has ended as host, and the time."""
    ordered: int = 0
    """Orders that its executive has given, those to itself included."""
    obeyed: int = 0
    """Orders that it has begun to carry out."""
    failed: int = 0
    """Orders that it could not carry out."""
    asides: int = 0
    """Times that it has stepped aside, by order or on request."""
    lost: int = 0
    """Times that it took a robot for lost, as host."""
    successions: int = 0
    """Times that it has become host in another's place."""
    breaches: int = 0
    """Temporal constraints that were not kept, as far as it was host."""
    letters: int = 0
    """Messages that it has sent reliably."""
    returned: int = 0
    """Such messages that were given up."""
    letter_bytes: int = 0
    """Bytes in these messages."""
    frames: int = 0
    """Frames that it has sent, copies and acknowledgements included."""
    frame_bytes: int = 0
    """Bytes in these frames."""
    pictures: int = 0
    """Pictures that it has taken by an order."""
    way_m: float = 0.0
    """Distance that it has driven, m."""
    blocked: int = 0
    """Ticks in which a wall or a body blocked it."""

    def carry(self, before: "Counters") -> None:
        """Add the counts of the robot's last incarnation, *before* it booted again."""
        for each in fields(self):
            setattr(self, each.name, getattr(before, each.name) + getattr(self, each.name))
