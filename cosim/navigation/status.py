"""Statuses that every local navigation algorithm returns."""

from enum import IntEnum
from typing import Final


class Status(IntEnum):
    """How far the robot is on its way; numbers, so that kernels can hold them."""

    UNDERWAY = 0
    ARRIVED = 1
    """The goal is nearer than the algorithm's tolerance."""
    UNREACHABLE = 2
    """Proved: no way leads to the goal."""
    STUCK = 3
    """The robot has made no progress for a while; it may still, if something changes."""


UNDERWAY, ARRIVED, UNREACHABLE, STUCK = map(int, Status)  # for kernels
STATUSES: Final = tuple(Status)
"""Statuses by their numbers: faster than the enumeration's constructor."""
