"""The air between Bluetooth devices: who hears whom, and which frames destroy each other.

No noise here: a frame that is in reach, on the channel that its receiver is tuned to, and alone on that channel for
as long as it lasts is received. Frames that overlap in time on one channel destroy each other at every receiver
that is in reach of both.
"""

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple

from cosim.machine import Address
from cosim.units import MS, Time

Reach = Callable[[Address, Address, Time], bool]
"""(transmitter, receiver, instant) -> whether the one is heard by the other."""

LONGEST_FRAME: Time = 4 * MS
"""No frame of Basic Rate lasts longer (five slots are 3.125 ms)."""


class Heard(StrEnum):
    """What became of a frame at the receiver that it was meant for."""

    RECEIVED = "received"
    OUT_OF_RANGE = "out_of_range"
    COLLIDED = "collided"
    NOT_TUNED = "not_tuned"
    """The receiver listened on another channel, or not at all."""
    BUSY = "busy"
    """The receiver was in the middle of another frame."""


class Frame(NamedTuple):
    """One frame on the air."""

    start: Time
    duration: Time
    kind: str
    """Packet type: ID, FHS, POLL, NULL, DM1..."""
    source: Address
    destination: Address
    """The receiver that it is meant for; BROADCAST for all slaves."""
    channel: int
    """RF channel k, 2402 + k MHz."""
    lt_addr: int = 0
    """Logical transport address; 0 for a broadcast and outside of a piconet."""
    length: int = 0
    """User payload in bytes."""


class Air:
    """Frames that are or just were on the air, and a record of those that somebody asks for."""

    def __init__(self, reach: Reach, record: Callable[[Frame, Heard], None] | None = None) -> None:
        self.reach = reach
        self._record = record
        self._frames: list[Frame] = []

    def put(self, frame: Frame) -> None:
        """Note that *frame* goes on the air; called at its start, in the order of starts."""
        # a frame that ends now may have begun so long ago, and whatever was on the air then may have destroyed it
        horizon = frame.start - LONGEST_FRAME
        self._frames = [old for old in self._frames if old.start + old.duration > horizon]
        self._frames.append(frame)

    def clear(self, receiver: Address, source: Address, channel: int, start: Time, end: Time) -> bool:
        """Return whether nothing but *source* is heard by *receiver* on *channel* during [start, end)."""
        return not any(
            other.channel == channel
            and other.source != source
            and other.source != receiver
            and other.start < end
            and other.start + other.duration > start
            and self.reach(other.source, receiver, other.start)
            for other in self._frames
        )

    def record(self, frame: Frame, heard: Heard) -> None:
        """Hand *frame* and its fate to the trace, if there is one."""
        if self._record is not None:
            self._record(frame, heard)
