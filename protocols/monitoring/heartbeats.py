"""The one message of monitoring: a robot is alive (big-endian, closed by the CRC-16 of ``protocols.wire``).

    source     16 bits   who sends it; the last hop may be another robot
    begun_ns   63 bits   when its heartbeat 0 was sent, by its own clock: it tells one life of a robot from the next
    number     33 bits   which of its heartbeats this is; 63 bits if that is not enough

Heartbeat i is sent at begun + i periods, so the stamp of the sending needs no field of its own.
"""

from typing import Final, NamedTuple

from cosim.errors import WireError
from cosim.machine import Address
from cosim.units import Time
from protocols import wire

LAYOUT: Final[wire.Layout] = (("source", 16), ("begun_ns", 63), ("number", 33))

_SHORT: Final = 1 << 33
"""Numbers from here on are told in a longer frame: clocks that faults set forward make them as great."""
_LONG: Final[wire.Layout] = (*LAYOUT[:-1], ("number", 63))


class Heartbeat(NamedTuple):
    """What a heartbeat says."""

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
