"""Units of time and the conversions at the program's edges: inside, time is an integer count of nanoseconds.

A float would not do: 1600 slots of 625e-6 s do not add up to 1 s, and a Bluetooth clock tick of 312.5 us is not
a whole number of microseconds. An int64 of nanoseconds holds 292 years.
"""

from typing import TypeAlias

Time: TypeAlias = int
"""An instant or a duration, in nanoseconds."""

NS: Time = 1
US: Time = 1_000
MS: Time = 1_000_000
S: Time = 1_000_000_000

TICK: Time = 312_500
"""One tick of a Bluetooth native clock (CLK bit 0), half a slot."""
SLOT: Time = 625_000
"""One Bluetooth slot."""


def from_seconds(seconds: float) -> Time:
    """Return *seconds* as the nearest whole number of nanoseconds."""
    return round(seconds * S)


def to_seconds(time: Time) -> float:
    """Return *time* in seconds, for people and for tables."""
    return time / S
