"""Exact latencies of discovery: on one channel without advDelay, and on three channels with it.

An advertiser begins an event every advInterval, and up to 10 ms later with advDelay; a scanner listens for scanWindow
at the beginning of every scanInterval, to one channel after the other. A PDU is heard if all of it lies in a window of
its channel. Latency is the time from the start of the first event, whose phase in the scanner's cycle is uniform, to
the end of the PDU that is heard.

One channel, no delay (Kindt et al., IEEE TMC 17(3), 2018): beacon k is heard for the phases in
[-k T_a, W - d - k T_a] mod T_s. What the beacons 0 to k leave is a set of intervals, and the mean latency is
d + T_a / T_s x the sum of the lengths that are left after each beacon. Where k T_a becomes a multiple of T_s before
nothing is left, some phases are never met.

Three channels with advDelay: the density of the phase of who is not found yet is carried on from event to event. Each
event takes out the phases in which one of its PDUs is heard, and T_a and a delay, uniform in 0 to 10 ms, shift what is
left. A delay is drawn after its event has failed, so that the mean is (T_a + 5 ms) x the expected number of failed
events, by Wald's identity, plus the mean time from the start of an event to the end of the PDU that is heard in it.

Times are in ns.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Floats
from cosim.units import MS, Time

CHANNELS: Final = 3
LONGEST_DELAY: Final[Time] = 10 * MS
CELLS: Final = 1 << 14
"""The most cells of the grid of phases."""
FINEST: Final[Time] = MS // 32
"""The shortest cell."""
REST: Final = 1e-9
"""Probability of not being found that counts as none."""

Spans = list[tuple[Time, Time]]
"""Disjoint intervals of phases, ascending."""


class Timing(NamedTuple):
    """One advertiser and one scanner."""

    interval: Time
    """advInterval."""
    scan_interval: Time
    window: Time
    air: Time
    """Duration of a PDU."""
    spacing: Time = 0
    """Time from the start of a PDU to that of the next one of the same event."""


class OneChannel(NamedTuple):
    """Latency on one channel without advDelay."""

    mean: float
    """ns, of the phases that are met."""
    greatest: Time
    met: float
    """Share of the phases that are ever met."""


class Delayed(NamedTuple):
    """Latency on three channels with advDelay."""

    mean: float
    found: tuple[float, ...]
    """Probability of being found by the first event, by the first two, and so on."""


def one_channel(timing: Timing) -> OneChannel:
    """Return the latency on one channel without advDelay."""
    interval, cycle = timing.interval, timing.scan_interval
    heard = timing.window - timing.air
    left: Spans = [(0, cycle)]
    unmet = math.gcd(interval, cycle) - heard  # of each part of the cycle to which all beacons come back
    never = max(0, unmet) / math.gcd(interval, cycle)
    total, greatest = 0.0, timing.air
    for beacon in range(cycle // math.gcd(interval, cycle)):
        before, start = _length(left), -beacon * interval % cycle
        left = _without(_without(left, start, start + heard), start - cycle, start + heard - cycle)
        total += (before - _length(left)) * (timing.air + beacon * interval)
        greatest = timing.air + beacon * interval if _length(left) < before else greatest
        if not left:
            break
    return OneChannel(total / (cycle - _length(left)), greatest, 1.0 - never)


def _length(spans: Spans) -> Time:
    return sum(end - begin for begin, end in spans)


def _without(spans: Spans, low: Time, high: Time) -> Spans:
    """Return *spans* without what lies from *low* to *high*."""
    parts = [part for begin, end in spans for part in ((begin, min(end, low)), (max(begin, high), end))]
    return [(begin, end) for begin, end in parts if begin < end]


@lru_cache
def delayed(timing: Timing, cells: int = CELLS) -> Delayed:
    """Return the latency on three channels with advDelay, on a grid of at most so many *cells*."""
    cycle = CHANNELS * timing.scan_interval
    size = min(cells, math.ceil(cycle / FINEST))
    cell = cycle / size
    heard = _heard(timing, size)
    missed = 1.0 - heard.sum(axis=0)
    step = np.fft.rfft(_shifted(timing.interval / cell, LONGEST_DELAY / cell, size))
    ends = timing.air + timing.spacing * np.arange(CHANNELS)
    density, found, events, offset = np.full(size, 1.0 / size), [0.0], 0.0, 0.0
    while found[-1] < 1.0 - REST:
        offset += float(ends @ (heard @ density))
        density = density * missed
        left = float(density.sum())
        events += left
        found.append(1.0 - left)
        density = np.fft.irfft(np.fft.rfft(density) * step, size)
    return Delayed(events * (timing.interval + LONGEST_DELAY / 2) + offset, tuple(found[1:]))


def _heard(timing: Timing, size: int) -> Floats:
    """Return by channel (rows) which share of each cell (columns) is of events whose PDU on it is heard first."""
    cycle, edges = CHANNELS * timing.scan_interval, np.linspace(0, CHANNELS * timing.scan_interval, size + 1)
    missed: Spans = [(0, cycle)]
    shares = []
    for channel in range(CHANNELS):
        low = channel * (timing.scan_interval - timing.spacing)
        high = low + timing.window - timing.air
        before = _inside(missed, edges)
        missed = _without(_without(missed, low, high), low + cycle, high + cycle)
        shares.append(before - _inside(missed, edges))
    return np.array(shares)


def _inside(spans: Spans, edges: Floats) -> Floats:
    """Return which share of each cell between *edges* lies in *spans*."""
    total = np.zeros(len(edges))
    for begin, end in spans:
        total += np.clip(edges, begin, end) - begin
    return np.diff(total) / np.diff(edges)


def _shifted(shift: float, spread: float, size: int) -> Floats:
    """Return what becomes of a phase anywhere in cell 0 after *shift* and a uniform delay of up to *spread* cells."""

    def integral(x: Floats) -> Floats:
        return np.asarray(np.maximum(x, 0.0) ** 2 / 2.0)

    cells = np.arange(math.floor(shift), math.ceil(shift + spread) + 2)
    at = np.asarray(cells - shift, dtype=np.float64)
    reached = (integral(at) - integral(at - 1.0) - integral(at - spread) + integral(at - 1.0 - spread)) / spread
    masses = np.zeros(size)
    np.add.at(masses, cells[:-1] % size, np.diff(reached))
    return masses


def overlapping(timing: Timing, advertisers: int) -> float:
    """Return the probability that a PDU overlaps one of the others that as many *advertisers* in reach send."""
    return 1.0 - (1.0 - 2 * timing.air / (timing.interval + LONGEST_DELAY / 2)) ** (advertisers - 1)


def geometric(timing: Timing) -> float:
    """Return the mean latency, ns, if events were found independently of each other, as in Liu, Chen and Ma."""
    chance = delayed(timing).found[0]
    return (timing.interval + LONGEST_DELAY / 2) * (1.0 / chance - 1.0)
