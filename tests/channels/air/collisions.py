"""Frames that are drawn over a band, and how many of them anything overlaps: kernels for the closed forms.

Each frame begins at 0 in a band of its own, which holds only what may overlap it. Times are nanoseconds.
"""

import math
from typing import Final

import numpy as np

from cosim.arrays import Floats, Int64s
from cosim.channels.air.band import Band
from cosim.channels.air.emissions import Table, Tuning, Wanted, insert, overlapping
from cosim.channels.air.spectra import CLASSIC, LE_1M
from cosim.channels.bluetooth.hopping import basic_hop
from cosim.jit import njit
from cosim.randomness import philox_words
from cosim.units import SLOT, US, Time

VICTIM: Final = Wanted(0, 0)
"""What the frame belongs to: all else is told as another channel's."""
LE_CENTRES: Final[Int64s] = np.array([2 * (2402 + 2 * k) for k in range(40) if k not in (0, 12, 39)])
"""The centres of LE's data channels by their index."""


def empty_band(senders: int) -> Table:
    """Return the table of a band in which all *senders* are received by each other with what they send."""
    band = Band(senders, 0.0)
    band.moved(np.zeros((senders, senders)), 0)
    band.reserve(1_000)
    return band.table


@njit(cache=True)
def centre_of(channel: int) -> int:
    """Return the centre of a channel of Bluetooth classic in steps of 0.5 MHz."""
    return 2 * (2402 + channel)


@njit(cache=True)
def hop(address: int, clock: int, independent: bool) -> int:
    """Return the channel of a piconet by the hop selection kernel, or one that is independent of all others."""
    if independent:
        return int(philox_words(clock & 0xFFFFFFFF, clock >> 32, address, 0, 79, 0)[0] % 79)
    return basic_hop(address, clock)


@njit(cache=True)
def lost_to_piconets(
    table: Table,
    tuning: Tuning,
    length: Time,
    on: Time,
    slots: int,
    least_share: float,
    addresses: Int64s,
    phases: Int64s,
    clocks: Int64s,
    independent: bool,
) -> Int64s:
    """Return how many frames are overlapped by piconets that send for *on* every *slots*, for each set of addresses.

    *addresses*, (sets, n), of the masters; *phases* and *clocks*, (sets, frames, n): when after 0 each has a slot, and
    what its clock says then. The channels are those of :func:`hop`.
    """
    sets, frames, count = phases.shape
    period = slots * SLOT
    lost = np.zeros(sets, np.int64)
    for one in range(sets):
        for frame in range(frames):
            table.state[0] = 0
            for piconet in range(count):
                back = on // period + 2
                begin = phases[one, frame, piconet] - back * period
                clock = clocks[one, frame, piconet] - 2 * slots * back
                while begin < length:
                    if begin + on > 0:
                        channel = hop(addresses[one, piconet], clock, independent)
                        insert(table, begin, begin + on, CLASSIC, centre_of(channel), piconet + 1, 1, 1.0)
                    begin += period
                    clock += 2 * slots
            lost[one] += len(overlapping(table, tuning, 0, length, VICTIM, least_share)) > 0
    return lost


@njit(cache=True)
def lost_to_periods(
    table: Table,
    tuning: Tuning,
    length: Time,
    on: Time,
    period: Time,
    least_share: float,
    phases: Int64s,
    channels: Int64s,
) -> Int64s:
    """Return how many frames are overlapped by one that sends for *on* every *period*, perhaps longer than that.

    *phases*, (sets, frames), and *channels*, (sets, frames, m): those of its frames from the first that may overlap.
    """
    lost = np.zeros(len(phases), np.int64)
    for one in range(len(phases)):
        for frame in range(phases.shape[1]):
            table.state[0] = 0
            begin, number = phases[one, frame] - (on // period + 1) * period, 0
            while begin < length:
                centre = centre_of(channels[one, frame, number])
                insert(table, begin, begin + on, CLASSIC, centre, 1 + number % 4, 1, 1.0)
                begin, number = begin + period, number + 1
            lost[one] += len(overlapping(table, tuning, 0, length, VICTIM, least_share)) > 0
    return lost


@njit(cache=True)
def lost_to_station(
    table: Table,
    tunings: Int64s,
    length: Time,
    kind: int,
    centre: int,
    on: Time,
    load: float,
    least_share: float,
    chances: Floats,
    gaps: Floats,
) -> Int64s:
    """Return how many frames are overlapped by a station that sends frames of *on* at a *load*, with exponential gaps.

    *tunings*, (sets, frames, 2): kind and centre of the receiver; *chances*, (sets, frames), uniform; *gaps*, (sets,
    frames, m), exponential with mean 1.
    """
    lost = np.zeros(len(chances), np.int64)
    mean = on * (1.0 - load) / load
    for one in range(len(chances)):
        for frame in range(chances.shape[1]):
            table.state[0] = 0
            chance, number = chances[one, frame], 0
            if chance < load:  # in the middle of a frame
                begin = -math.floor(on * chance / load)
            else:
                begin, number = math.floor(mean * gaps[one, frame, 0]), 1
            while begin < length:
                insert(table, begin, begin + on, kind, centre, 1, 1, 1.0)
                begin += on + math.floor(mean * gaps[one, frame, number])
                number += 1
            tuning = Tuning(tunings[one, frame, 0], tunings[one, frame, 1], 0)
            lost[one] += len(overlapping(table, tuning, 0, length, VICTIM, least_share)) > 0
    return lost


@njit(cache=True)
def lost_exchanges(
    table: Table, tunings: Int64s, frame: Time, kind: int, centre: int, least_share: float
) -> tuple[Int64s, Int64s]:
    """Return how many frames, and how many pairs of frame and answer, meet a station that sends without a pause.

    *tunings*, (sets, pairs, 4): kind and centre of the receivers of both. An answer begins 625 us after its frame.
    """
    frames, pairs = np.zeros(len(tunings), np.int64), np.zeros(len(tunings), np.int64)
    table.state[0] = 0
    insert(table, 0, 100_000 * US, kind, centre, 1, 1, 1.0)
    for one in range(len(tunings)):
        for pair in range(tunings.shape[1]):
            there = Tuning(tunings[one, pair, 0], tunings[one, pair, 1], 0)
            back = Tuning(tunings[one, pair, 2], tunings[one, pair, 3], 0)
            first = len(overlapping(table, there, 0, frame, VICTIM, least_share)) > 0
            answer = len(overlapping(table, back, SLOT, SLOT + frame, VICTIM, least_share)) > 0
            frames[one] += first
            pairs[one] += first or answer
    return frames, pairs


def hop_tunings(addresses: Int64s, clocks: Int64s, packets: int, independent: bool) -> Int64s:
    """Return kinds and centres, (sets, frames, 2 packets), of receivers that hop from *clocks*, (sets, frames), on."""
    tunings = np.full((*clocks.shape, 2 * packets), CLASSIC)
    _write_hops(tunings, addresses, clocks, independent)
    return tunings


@njit(cache=True)
def _write_hops(tunings: Int64s, addresses: Int64s, clocks: Int64s, independent: bool) -> None:
    for one in range(len(clocks)):
        for frame in range(clocks.shape[1]):
            for packet in range(tunings.shape[2] // 2):
                channel = hop(addresses[one], clocks[one, frame] + 2 * packet, independent)
                tunings[one, frame, 2 * packet + 1] = centre_of(channel)


def le_tunings(random: np.random.Generator, sets: int, frames: int, packets: int) -> Int64s:
    """Return kinds and centres, (sets, frames, 2 packets), of receivers of LE: an event keeps to its channel.

    The channels are uniform, as selection #2 makes them; there is no kernel of it here.
    """
    tunings = np.full((sets, frames, 2 * packets), LE_1M)
    tunings[:, :, 1::2] = random.choice(LE_CENTRES, size=(sets, frames, 1))
    return tunings
