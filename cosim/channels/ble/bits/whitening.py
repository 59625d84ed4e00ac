"""Whitening of PDU and CRC: x^7 + x^4 + 1, started by the channel index (Core v5.0, Vol 6 Part B, section 3.2).

The sequence has a period of 127 bits, hence also of 127 octets, and is the same for all channels but for its start.
"""

from functools import cache
from typing import Final

from cosim.channels.ble.channels import CHANNELS

_PERIOD: Final = 127


@cache
def _sequence(index: int) -> bytes:
    """Return one period, in octets, of the sequence of a channel *index*."""
    if not 0 <= index < CHANNELS:
        raise ValueError(f"{index} is no channel index (0 to {CHANNELS - 1})")
    register = 1 << 6 | index  # position 0 on the left, position 6, the output, on the right
    sequence = 0
    for i in range(8 * _PERIOD):
        out = register & 1
        sequence |= out << i
        register = register >> 1 ^ (0b1000100 if out else 0)  # the output enters positions 0 and 4
    return sequence.to_bytes(_PERIOD, "little")


def whiten(data: bytes, index: int) -> bytes:
    """Return *data*, from the header on, whitened or dewhitened for a channel *index*; ValueError if it is none."""
    periods = -(-len(data) // _PERIOD)
    return bytes(octet ^ noise for octet, noise in zip(data, _sequence(index) * periods, strict=False))
