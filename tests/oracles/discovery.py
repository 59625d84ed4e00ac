"""Exact latency of neighbour discovery on one channel without advDelay, in integers and fractions.

After P. H. Kindt, M. Saur, M. Balszun, S. Chakraborty, "Neighbor discovery latency in BLE-like protocols", IEEE TMC
17(3), 2018. A scanner listens for *window* at the beginning of every *scan_interval*; beacons of length *packet* begin
every *interval*, the first at a phase of the scanner's cycle that is uniform. A beacon is heard if all of it lies in
one window. The latency is the time from the start of the first beacon to the end of the one that is heard.

The phases of the first beacon with which none of the beacons 0 to k is heard are a set of open intervals. Beacon k
takes [-k interval, window - packet - k interval] modulo the cycle from it. All times are integers of one unit.
"""

from fractions import Fraction
from typing import NamedTuple

Intervals = list[tuple[int, int]]
"""Disjoint open intervals of phases, ascending."""


class Latency(NamedTuple):
    """Mean and greatest latency, in the unit of the times."""

    mean: Fraction
    greatest: int


def without(phases: Intervals, low: int, high: int) -> Intervals:
    """Return *phases* without the closed interval from *low* to *high*."""
    left: Intervals = []
    for start, end in phases:
        left += [part for part in ((start, min(end, low)), (max(start, high), end)) if part[0] < part[1]]
    return left


def solve(interval: int, scan_interval: int, window: int, packet: int) -> Latency | None:
    """Return the latency, or None if some phases are never met."""
    # the cycle is cut at the start of a window, where beacon 0 is heard: no interval crosses the cut
    missed: Intervals = [(0, scan_interval)]
    heard = window - packet
    if heard < 0:
        return None
    measures = 0
    beacon = 0
    while True:
        start = -beacon * interval % scan_interval
        if beacon and start == 0:
            return None  # from here on the beacons meet what they have met
        missed = without(missed, start, start + heard)  # what is beyond the cycle, beacon 0 has taken
        if not missed:
            mean = packet + Fraction(interval * measures, scan_interval)
            return Latency(mean, packet + beacon * interval)
        measures += sum(end - start for start, end in missed)
        beacon += 1


def closed_form(interval: int, scan_interval: int, window: int, packet: int) -> Latency:
    """Return the latency where interval <= window - packet, so that no beacon can jump over a window."""
    if interval > window - packet:
        raise ValueError("beacons that may jump over a window")
    gap = scan_interval - (window - packet)
    jumps = range(-(-gap // interval))
    mean = packet + Fraction(interval * sum(gap - jump * interval for jump in jumps), scan_interval)
    return Latency(mean, packet + interval * len(jumps))


def step_by_step(interval: int, scan_interval: int, window: int, packet: int) -> Latency | None:
    """Return the latency by looking at each phase, half a unit after an integer, and each beacon.

    What happens depends on the integers around a phase only, so that these phases are all.
    """
    latencies = []
    for phase in range(1, 2 * scan_interval, 2):
        for beacon in range(scan_interval + 1):
            begin = (phase + 2 * beacon * interval) % (2 * scan_interval)
            if begin + 2 * packet <= 2 * window:
                latencies.append(packet + beacon * interval)
                break
        else:
            return None
    return Latency(Fraction(sum(latencies), len(latencies)), max(latencies))
