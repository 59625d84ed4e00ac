"""Bit-exact encodings: a layout is a tuple of (field, bits), packed most significant bit first and closed by a CRC-16.

The CRC is CRC-CCITT (polynomial x^16 + x^12 + x^5 + 1, initial value 0xFFFF), over all bytes before it.
"""

from binascii import crc_hqx
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from cosim.errors import WireError

Layout: TypeAlias = tuple[tuple[str, int], ...]

CRC_BYTES: Final = 2
CRC_START: Final = 0xFFFF
"""Initial value of the CRC."""


@dataclass(frozen=True, slots=True)
class BadBytes:
    """A robot received bytes that are no message of its team, or none for this robot: an event."""

    sender: int = field(metadata={"meaning": "who sent them last"})
    length: int = field(metadata={"unit": "B", "meaning": "how many they are"})


def size(layout: Layout) -> int:
    """Return the length in bytes of a packet of *layout*, padding and CRC included."""
    return -(-sum(bits for _, bits in layout) // 8) + CRC_BYTES


def pack(layout: Layout, values: Mapping[str, int]) -> bytes:
    """Encode *values*; raise :exc:`WireError` for a value that its field cannot hold."""
    word = width = 0
    for name, bits in layout:
        value = values[name]
        if not 0 <= value < 1 << bits:
            raise WireError(f"{name} = {value} does not fit into {bits} bits")
        word = word << bits | value
        width += bits
    return seal((word << -width % 8).to_bytes(-(-width // 8), "big"))


def unpack(layout: Layout, data: bytes) -> dict[str, int]:
    """Decode *data*; raise :exc:`WireError` for a wrong length, CRC or padding."""
    if len(data) != size(layout):
        raise WireError(f"{len(data)} bytes where {size(layout)} were expected")
    word = int.from_bytes(open(data), "big")
    rest = 8 * (len(data) - CRC_BYTES)
    values = {}
    for name, bits in layout:
        rest -= bits
        values[name] = word >> rest & (1 << bits) - 1
    if word & (1 << rest) - 1:
        raise WireError("padding that is not zero")
    return values


def seal(data: bytes) -> bytes:
    """Return *data* with its CRC."""
    return data + crc_hqx(data, CRC_START).to_bytes(CRC_BYTES, "big")


def open(data: bytes) -> bytes:
    """Return *data* without its CRC; raise :exc:`WireError` unless it ends with that of what comes before."""
    check(data)
    return data[:-CRC_BYTES]


def check(data: bytes) -> None:
    """Raise :exc:`WireError` unless *data* ends with the CRC of what comes before."""
    if len(data) <= CRC_BYTES or crc_hqx(data, CRC_START):  # bytes that end with their CRC have the CRC 0
        raise WireError("the CRC does not fit")
