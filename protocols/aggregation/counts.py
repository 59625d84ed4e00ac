"""Counts of 16 bits, as the wire bears them: versions of plans, assignments, reports, rounds, epochs of memberships."""

from typing import Final

COUNTS: Final = 1 << 16
"""No count on the wire reaches this."""


def following(count: int) -> int:
    """Return the count after *count*: 1 after the last, as 0 stands for none yet."""
    return count % (COUNTS - 1) + 1
