"""A payload for everyone, or a piece of one, as a structure of advertising data: manufacturer specific data."""

from typing import Final

_STRUCTURE: Final = bytes.fromhex("ffffff")
"""What begins a piece after its length: manufacturer specific data, of a company that is none."""
OVERHEAD: Final = 1 + len(_STRUCTURE)
"""Octets of a structure that are none of the piece."""


def structure(piece: bytes) -> bytes:
    """Return a *piece* of a payload as a structure of advertising data."""
    return bytes([len(_STRUCTURE) + len(piece)]) + _STRUCTURE + piece


def piece_of(data: bytes) -> bytes | None:
    """Return the part of a payload in the *data* of a PDU; None if they are not what ``structure`` makes."""
    size, begin = len(data), data[1:OVERHEAD]
    return data[OVERHEAD:] if size and data[0] == size - 1 and begin == _STRUCTURE else None
