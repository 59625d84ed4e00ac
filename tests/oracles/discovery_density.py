"""Latency of discovery on three advertising channels with advDelay, by densities and by draws.

An advertiser sends a PDU on 37, 38 and 39, *spacing* apart; the next event begins *interval* and a uniform delay of 0
to 10 ms later. A scanner listens to one of the channels for *window* at the beginning of every *scan_interval*, in
turn. A PDU is heard if all of it lies in a window of its channel. The first event begins at a phase of the scanner's
cycle of three intervals that is uniform; latency is the time from there to the end of the PDU that is heard.

``event_chances`` carries on the density of the phase of who is not yet found, from event to event: a shift by
*interval* and a convolution with a box of 10 ms. A delay is drawn after the event before it has failed, so that by
Wald's identity the mean latency is (interval + 5 ms) times the expected number of failed events, plus the mean offset
of the PDU that is heard.

When that PDU is heard depends on the delays, and they on the phases. ``latencies`` therefore carries on the density of
the time of an event for each phase of the first one: the density of an event at t is that of an unheard event within
[t - interval - 10 ms, t - interval], and whether an event at t is heard follows from first phase and t.

Times are integers in ns; densities are means over cells of a grid. ``draw_latencies`` needs neither.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.oracles.discovery import Intervals, without

Array = NDArray[np.float64]

ADV_DELAY = 10_000_000
CHANNELS = 3


class Case(NamedTuple):
    """One advertiser and one scanner."""

    interval: int
    scan_interval: int
    window: int
    packet: int = 376_000
    spacing: int = 600_000

    @property
    def cycle(self) -> int:
        return CHANNELS * self.scan_interval

    @property
    def offsets(self) -> list[int]:
        """Time from the start of an event to the end of each of its PDUs."""
        return [self.packet + channel * self.spacing for channel in range(CHANNELS)]


def heard_phases(case: Case) -> list[Intervals]:
    """Return the phases of events whose first PDU that is heard is that on 37, 38 and 39, and those of unheard ones."""
    missed: Intervals = [(0, case.cycle)]
    parts: list[Intervals] = []
    for channel in range(CHANNELS):
        low = channel * (case.scan_interval - case.spacing)  # within the cycle: a spacing is less than an interval
        rest = without(missed, low, low + case.window - case.packet)
        heard = missed
        for start, end in rest:
            heard = without(heard, start, end)
        parts.append(heard)
        missed = rest
    return [*parts, missed]


def shares(phases: Intervals, cycle: int, cell: int) -> Array:
    """Return which part of every cell of the cycle is in *phases*."""
    edges = np.arange(0, cycle + 1, cell)
    inside = sum((np.clip(edges, start, end) for start, end in phases), np.zeros(len(edges)))
    return np.diff(inside) / cell


def in_cells(time: int, cell: int) -> int:
    """Return *time* in cells, of which it is a multiple."""
    assert time % cell == 0, f"{time} is no multiple of {cell}"
    return time // cell


class Chances(NamedTuple):
    """What follows from the density of the phase alone."""

    found: list[float]
    """Probability of being found by event 1, 2, ..."""
    mean: float


def event_chances(case: Case, cell: int, rest: float = 1e-9) -> Chances:
    """Return the chances by event, until at most *rest* is not found."""
    size, shift, box = (in_cells(time, cell) for time in (case.cycle, case.interval, ADV_DELAY))
    *heard, missed = (shares(part, case.cycle, cell) for part in heard_phases(case))
    density = np.full(size, 1.0 / size)
    found, events, offset = [], 0.0, 0.0
    while not found or found[-1] < 1.0 - rest:
        offset += sum(time * float((density * part).sum()) for time, part in zip(case.offsets, heard, strict=True))
        density = density * missed
        left = float(density.sum())
        found.append(1.0 - left)
        events += left
        density = np.roll(smeared(np.concatenate([density[-box - 1 :], density]), box), shift)
    return Chances(found, events * (case.interval + ADV_DELAY / 2) + offset)


def smeared(masses: Array, box: int) -> Array:
    """Return the convolution with a box of *box* cells from 0 on: the mass of each cell becomes a trapezium.

    The first axis has the cells; the first *box* + 1 of them are there for the others, and not in the result.
    """
    sums = np.concatenate([np.zeros_like(masses[:1]), np.cumsum(masses, axis=0)])
    last = sums[box + 1 :] - sums[1:-box]  # the *box* cells that end with each
    return (last[1:] + last[:-1]) / (2 * box)


class Latencies(NamedTuple):
    """A distribution of latencies up to some time."""

    offsets: list[int]
    first: list[float]
    """Probability of being found in the first event, by channel."""
    later: Array
    """Shape (3, cells): probability of being found in an event that begins in a cell of time, by channel."""
    cell: int

    def by(self, time: float) -> float:
        """Return the probability of a latency of at most *time*."""
        edges = np.arange(self.later.shape[1] + 1) * self.cell
        total = 0.0
        for offset, first, later in zip(self.offsets, self.first, self.later, strict=True):
            until = np.concatenate([[0.0], np.cumsum(later)])
            total += first * (time >= offset) + float(np.interp(time - offset, edges, until))
        return total

    def quantile(self, share: float) -> float:
        """Return the least latency that this *share* of cases do not exceed."""
        low, high = 0.0, float(self.later.shape[1] * self.cell)
        assert self.by(high) >= share, "the distribution ends before"
        while high - low > 1.0:
            middle = (low + high) / 2
            low, high = (low, middle) if self.by(middle) >= share else (middle, high)
        return high


def latencies(case: Case, cell: int, phase_cell: int, until: int) -> Latencies:
    """Return the distribution of latencies of events that begin before *until*.

    For the first phase, cells of length *phase_cell* are looked at from their middles, for the time those of *cell*.
    What happens within an interval follows from the one before and the last 10 ms of the one before that.
    """
    half, shift, box, size = (in_cells(time, cell) for time in (phase_cell // 2, case.interval, ADV_DELAY, case.cycle))
    parts = heard_phases(case)
    first = [shares(part, case.cycle, phase_cell) for part in parts]
    # by part, time and first phase; the phase is their sum, from the middle of a first cell on
    around = [np.roll(shares(part, case.cycle, cell), -half) for part in parts]
    longer = np.array([np.resize(share, 2 * size + shift) for share in around])
    by_time = np.lib.stride_tricks.sliding_window_view(longer, size, axis=1)[:, :, :: 2 * half]
    unheard = np.zeros((shift + box + 1, len(first[-1])))  # events of the last times, by first phase
    later = [np.zeros((CHANNELS, shift))]
    for start in range(shift, in_cells(until, cell), shift):
        events = smeared(unheard, box)
        if start == shift:
            events[:box] = first[-1] / len(first[-1]) / box  # event 0 is at an instant, not anywhere in a cell
        turn = slice(start % size, start % size + shift)
        later.append(np.einsum("tp,ctp->ct", events, by_time[:CHANNELS, turn]))
        unheard = np.concatenate([unheard[-box - 1 :], events * by_time[CHANNELS, turn]])
    return Latencies(case.offsets, [float(part.mean()) for part in first[:-1]], np.hstack(later), cell)


def draw_latencies(case: Case, count: int, stream: np.random.Generator) -> Array:
    """Return *count* latencies, drawn event by event."""
    found = np.zeros(count)
    open_ = np.arange(count)
    phase, elapsed = stream.uniform(0, case.cycle, count), np.zeros(count)
    while len(open_):
        latency = np.full(len(open_), np.inf)
        for channel, offset in reversed(list(enumerate(case.offsets))):
            begin = phase + elapsed + channel * (case.spacing - case.scan_interval)
            latency[begin % case.cycle <= case.window - case.packet] = offset
        latency += elapsed
        found[open_] = latency
        left = np.isinf(latency)
        open_, phase, elapsed = open_[left], phase[left], elapsed[left]
        elapsed += case.interval + stream.uniform(0, ADV_DELAY, len(open_))
    return found
