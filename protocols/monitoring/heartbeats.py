"""The one message of monitoring: a robot is alive (big-endian, closed by the CRC-16 of ``protocols.wire``).

    source     16 bits   the robot that sends it; the last hop may be another one
    begun_ns   63 bits   when its heartbeat 0 was sent, by its own clock: this distinguishes its incarnations
    number     33 bits   the number of the heartbeat; 63 bits if that is not enough

Heartbeat i is sent at begun + i periods, so the time of sending needs no field of its own.
"""

from typing import Final, NamedTuple

from cosim.errors import WireError
from cosim.machine import Address
from cosim.units import Time
from protocols import wire

LAYOUT: Final[wire.Layout] = (("source", 16), ("begun_ns", 63), ("number", 33))

_SHORT: Final = 1 << 33
"""Number from which on a longer frame is used: clocks that faults set forward make numbers as great."""
_LONG: Final[wire.Layout] = (*LAYOUT[:-1], ("number", 63))


class Heartbeat(NamedTuple):
    """The content of a heartbeat."""

    source: Address
    begun: Time
    number: int


def encode(heartbeat: Heartbeat) -> bytes:
    """Return the bytes of *heartbeat*; raise WireError if a field does not hold its value."""
    source, begun, number = heartbeat
    layout = LAYOUT if number < _SHORT else _LONG
    return wire.pack(layout, {"source": source, "begun_ns": begun, "number": number})


def decode(data: bytes) -> Heartbeat:
    """Return the heartbeat in *data*; raise WireError if it is none."""
    values = wire.unpack(_LONG if len(data) == wire.size(_LONG) else LAYOUT, data)
    if len(data) == wire.size(_LONG) and values["number"] < _SHORT:
        raise WireError("a long frame for a short number")
    return Heartbeat(values["source"], values["begun_ns"], values["number"])
