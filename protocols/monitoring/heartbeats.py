"""The one message of monitoring: a robot is alive (big-endian, closed by the CRC-16 of ``protocols.wire``).

    source     16 bits   who sends it; the last hop may be another robot
    begun_ns   63 bits   when its heartbeat 0 was sent, by its own clock: it tells one life of a robot from the next
    number     33 bits   which of its heartbeats this is

Heartbeat i is sent at begun + i periods, so the stamp of the sending needs no field of its own.
"""

from typing import Final, NamedTuple

from cosim.machine import Address
from cosim.units import Time
from protocols import wire

LAYOUT: Final[wire.Layout] = (("source", 16), ("begun_ns", 63), ("number", 33))


class Heartbeat(NamedTuple):
    """What a heartbeat says."""

    source: Address
    begun: Time
    number: int


def encode(heartbeat: Heartbeat) -> bytes:
    """Return the bytes of *heartbeat*; raise WireError if a field does not hold its value."""
    source, begun, number = heartbeat
    return wire.pack(LAYOUT, {"source": source, "begun_ns": begun, "number": number})


def decode(data: bytes) -> Heartbeat:
    """Return the heartbeat in *data*; raise WireError if it is none."""
    values = wire.unpack(LAYOUT, data)
    return Heartbeat(values["source"], values["begun_ns"], values["number"])
