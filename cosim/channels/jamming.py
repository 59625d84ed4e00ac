"""Jammers: transmitters that take part in nothing and disturb what is sent on their channels.

A jammer is on the air during [start, end) only. A constant one is on all of its channels all the time; a sweeping one
on one channel at a time, *dwell* on each in their order, and over again; a pulsed one on all of its channels for *on*
out of every *period*. The power is that on each channel of 1 MHz that it is on.
"""

from typing import Final, NamedTuple

from cosim.jit import njit
from cosim.units import Time

CONSTANT: Final = 0
SWEEPING: Final = 1
PULSED: Final = 2


class Jammer(NamedTuple):
    """A transmitter at a fixed place. Times in ns; those that its *mode* does not need are 0."""

    x_m: float
    y_m: float
    power_dbm: float
    """Power on each channel that it is on."""
    channels: tuple[int, ...]
    """RF channels k, 2402 + k MHz, none twice, in the order in which they are swept."""
    mode: int
    """CONSTANT, SWEEPING or PULSED."""
    dwell: Time
    """Time for which a sweeping jammer stays on a channel."""
    on: Time
    """Time for which a pulsed one sends, from the beginning of every period."""
    period: Time
    start: Time
    end: Time


@njit(cache=True)
def jams(
    mode: int,
    dwell: Time,
    on: Time,
    period: Time,
    start: Time,
    end: Time,
    place: int,
    count: int,
    from_ns: Time,
    to_ns: Time,
) -> bool:
    """Return whether a jammer is on a channel at any instant of [from_ns, to_ns); a kernel for kernels.

    *place* is the position of the channel among the *count* channels of the jammer, or -1 if it is none of them.
    """
    first, last = max(from_ns, start) - start, min(to_ns, end) - 1 - start  # instants, both included
    if place < 0 or first > last:
        return False
    if mode == CONSTANT:
        return True
    if mode == PULSED:
        return first % period < on or first // period < last // period
    step = first // dwell
    return step + (place - step) % count <= last // dwell
