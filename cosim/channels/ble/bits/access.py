"""Access addresses: the one of advertising, and those that a connection may have (Core v5.0, Vol 6 Part B, 2.1.2).

An address is a number of 32 bits, sent from its least significant bit on.
"""

from typing import Final

import numpy as np

ADVERTISING_ADDRESS: Final = 0x8E89BED6
"""Access address of all packets on the primary and secondary advertising channels but those of periodic trains."""

_BITS: Final = 32


def is_valid(address: int, *, coded: bool = True) -> bool:
    """Return whether a connection may have *address*; *coded*: also one of a device that supports LE Coded.

    That it differs by more than one bit from the addresses in use on a device is for the device to see to.
    """
    if not 0 <= address < 1 << _BITS:
        return False
    transitions = (address ^ address >> 1) & (1 << _BITS - 1) - 1  # bit i: bits i and i + 1 of the address differ
    return (
        _longest_run(transitions) <= 6
        and (address ^ ADVERTISING_ADDRESS).bit_count() > 1
        and len(set(address.to_bytes(4, "little"))) > 1
        and transitions.bit_count() <= 24
        and (transitions >> 26).bit_count() >= 2  # among the six most significant bits
        and (not coded or ((address & 0xFF).bit_count() >= 3 and (transitions & 0x7FFF).bit_count() <= 11))
    )


def draw(stream: np.random.Generator) -> int:
    """Return an address from *stream*, each that :func:`is_valid` on all PHYs with the same probability."""
    while not is_valid(address := int(stream.integers(1 << _BITS))):
        pass
    return address


def _longest_run(transitions: int) -> int:
    """Return the length of the longest run of equal bits, given where neighbours differ."""
    return max(len(same) for same in f"{transitions:031b}".split("1")) + 1
