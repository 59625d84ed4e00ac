"""Frames that any overlap destroys, drawn over the band, against the closed forms of coexistence.

For each cell 100,000 of them are drawn, in 200 sets with addresses of their own. An estimate is
to be within four standard errors of the printed value: those of the means of the sets, or those of independent frames
if they are greater.

The formula of a frame that meets several of a piconet takes their channels for independent. Those of the hop selection
kernel are not: F moves only once in 64 slots, and PERM5 keeps the number of ones in X. With them fewer frames are lost
than printed where channels of one piconet decide together; then the estimate is compared with the hops themselves,
counted without any band, and found below what is printed.
"""

from typing import NamedTuple

import numpy as np
import pytest

from cosim.arrays import Floats, Int64s
from cosim.channels.air.emissions import Tuning
from cosim.channels.air.spectra import CLASSIC, DSSS, OFDM, shares
from cosim.channels.bluetooth.hopping import adapted_channel, basic_channel
from cosim.units import US
from tests.channels.air.collisions import (
    centre_of,
    empty_band,
    hop_tunings,
    le_tunings,
    lost_exchanges,
    lost_to_periods,
    lost_to_piconets,
    lost_to_station,
)
from tests.tiers import two_tiers

pytestmark = pytest.mark.slow

SETS, FRAMES = 200, 500
ROUNDING = 5e-5
PACKET = 366 * US


class Radio(NamedTuple):
    """A station of 802.11, and the share of power from which on frequencies count as overlapping."""

    kind: int
    centre: int
    share: float

    @property
    def tuning(self) -> Tuning:
        return Tuning(self.kind, self.centre, 0)


# receivers: all of a channel lies in the filter, or none of it
TAKES_22 = Radio(DSSS, 2 * 2436 + 1, 0.9)
TAKES_20 = Radio(OFDM, 2 * 2441 + 1, 0.9)
TAKES_17 = Radio(OFDM, 2 * 2473 + 1, 0.9)
"""At the end of the band, of which no more lie in its filter."""
TAKES_1 = Radio(CLASSIC, 2 * 2412, 0.9)
# senders: with a share, into 1 MHz, between those on both sides of the border
SENDS_22 = Radio(DSSS, 2 * 2436 + 1, 10**-3.8)
SENDS_20 = Radio(OFDM, 2 * 2441 + 1, 10**-2.9)
SENDS_17 = Radio(OFDM, 2 * 2437, 10**-1.5)
SENDS_10_OF_37 = Radio(DSSS, 2 * 2437, 10**-3.1)


@pytest.mark.parametrize(("radio", "count"), [(TAKES_22, 22), (TAKES_20, 20), (TAKES_17, 17), (TAKES_1, 1)])
def test_a_receiver_takes_in_as_many_channels_as_the_formula_has(radio: Radio, count: int):
    offsets = [abs(centre_of(channel) - radio.centre) for channel in range(79)]
    assert sum(shares()[CLASSIC, radio.kind, offset] >= radio.share for offset in offsets if offset < 103) == count


def within(lost: Int64s, frames: int, printed: float) -> None:
    """Fail if the mean of *lost* of *frames* in each set is not what is printed."""
    mean, error = estimate(lost / frames)
    independent = (printed * (1 - printed) / (frames * len(lost))) ** 0.5
    assert abs(mean - printed) <= 4 * max(error, independent) + ROUNDING, (mean, error, printed)


def estimate(values: Floats) -> tuple[float, float]:
    return float(values.mean()), float(values.std(ddof=1) / len(values) ** 0.5)


def piconets(random: np.random.Generator, sets: int, frames: int, count: int, slots: int) -> tuple[Int64s, ...]:
    """Return addresses, phases and clocks."""
    return (
        random.integers(1 << 28, size=(sets, count)),
        random.integers(slots * 625 * US, size=(sets, frames, count)),
        random.integers(1 << 26, size=(sets, frames, count)) << 2,
    )


# ---------------------------------------------------------------- 802.11 under piconets

UNDER_PICONETS = {
    (1310, TAKES_22): (0.5782, 0.8221, 0.9250, 0.9867, 0.9998),
    (1214, TAKES_22): (0.5560, 0.8028, 0.9124, 0.9827, 0.9997),
    (582, TAKES_22): (0.3823, 0.6185, 0.7643, 0.9101, 0.9919),
    (2427, TAKES_22): (0.7644, 0.9445, 0.9869, 0.9993, 1.0),
    (6336, TAKES_22): (0.9695, 0.9991, 1.0, 1.0, 1.0),
    (254, TAKES_17): (0.2135, 0.3814, 0.5134, 0.6990, 0.9094),
    (248, TAKES_22): (0.2736, 0.4723, 0.6167, 0.7977, 0.9591),
}
CELLS = [
    *[
        (length, radio, count, 1, printed)
        for (length, radio), row in UNDER_PICONETS.items()
        for count, printed in zip((1, 2, 3, 5, 10), row, strict=True)
    ],
    (1310, TAKES_22, 1, 2, 0.3470),
    (254, TAKES_20, 1, 1, 0.2511),
]


@pytest.mark.parametrize(("length", "radio", "count", "slots", "printed"), two_tiers(CELLS, 8))
def test_piconets_destroy_80211_frames_as_printed_if_their_channels_are_independent(
    length: int, radio: Radio, count: int, slots: int, printed: float
):
    random = np.random.default_rng((1, length, count, slots))
    drawn = piconets(random, SETS, FRAMES, count, slots)
    lost = lost_to_piconets(
        empty_band(11), radio.tuning, length * US, PACKET, slots, radio.share, *drawn, independent=True
    )
    within(lost, FRAMES, printed)


SHORT = [cell for cell in CELLS if (cell[0] * US + PACKET) <= 625 * US]
LONG = [cell for cell in CELLS if cell not in SHORT and cell[2] == 1]


@pytest.mark.parametrize(("length", "radio", "count", "slots", "printed"), two_tiers(SHORT, 4))
def test_piconets_with_real_hops_destroy_frames_that_meet_one_of_each_as_printed(
    length: int, radio: Radio, count: int, slots: int, printed: float
):
    random = np.random.default_rng((2, length, count, slots))
    drawn = piconets(random, SETS, FRAMES, count, slots)
    lost = lost_to_piconets(
        empty_band(11), radio.tuning, length * US, PACKET, slots, radio.share, *drawn, independent=False
    )
    within(lost, FRAMES, printed)


HALVES = {TAKES_22: 21, TAKES_20: 19, SENDS_22: 21, SENDS_20: 19, SENDS_17: 16}
"""Half the widths of stations, in steps of 0.5 MHz."""


def any_of(radio: Radio, address: int, clocks: Int64s, slots: int, count: int) -> float:
    """Return how often any of *count* hops from *clocks* on lies within the width of a station."""
    hit = np.zeros(len(clocks), np.bool_)
    for number in range(count):
        channels = np.asarray(basic_channel(address, clocks + 2 * slots * number))
        hit |= np.abs(4804 + 2 * channels - radio.centre) <= HALVES[radio]
    return float(hit.mean())


@pytest.mark.parametrize(("length", "radio", "count", "slots", "printed"), LONG)
def test_a_piconet_with_real_hops_destroys_longer_frames_as_its_hops_say_and_fewer_than_printed(
    length: int, radio: Radio, count: int, slots: int, printed: float
):
    random = np.random.default_rng((3, length, slots))
    drawn = piconets(random, SETS, FRAMES, count, slots)
    lost = lost_to_piconets(
        empty_band(2), radio.tuning, length * US, PACKET, slots, radio.share, *drawn, independent=False
    )
    met, rest = divmod(length * US + PACKET, slots * 625 * US)
    part = rest / (slots * 625 * US)
    clocks = random.integers(1 << 26, size=4_096) << 2
    by_hops = np.array(
        [
            (1 - part) * any_of(radio, address, clocks, slots, met)
            + part * any_of(radio, address, clocks, slots, met + 1)
            for address in drawn[0][:, 0].tolist()
        ]
    )
    difference, error = estimate(lost / FRAMES - by_hops)
    assert abs(difference) <= 4 * error
    assert by_hops.mean() < printed + ROUNDING


@pytest.mark.parametrize(("radio", "printed"), [(TAKES_1, 0.0194), (TAKES_22, 0.3873)])
def test_an_example_of_garg(radio: Radio, printed: float):
    """Frames of 4 ms each 3 ms, by several senders, on independent channels; he prints .0195 for the first."""
    random = np.random.default_rng(217)
    phases = random.integers(3_000 * US, size=(SETS, FRAMES))
    channels = random.integers(79, size=(SETS, FRAMES, 8))
    drawn = empty_band(6), radio.tuning, 625 * US, 4_000 * US, 3_000 * US, radio.share, phases, channels
    within(lost_to_periods(*drawn), FRAMES, printed)


# ---------------------------------------------------------------- Bluetooth under 802.11

LOADS = (0.1, 0.3, 0.5, 0.7, 0.9)
UNDER_A_STATION = {
    ("classic", 366): (0.0355, 0.1055, 0.1732, 0.2350, 0.2762),
    ("classic", 2870): (0.0820, 0.2023, 0.2629, 0.2780, 0.2785),
    ("le", 80): (0.0287, 0.0860, 0.1431, 0.2000, 0.2547),
    ("le", 2088): (0.0665, 0.1747, 0.2428, 0.2683, 0.2703),
}
STATION_CELLS = [
    (system, length, load, printed)
    for (system, length), row in UNDER_A_STATION.items()
    for load, printed in zip(LOADS, row, strict=True)
]


def tunings(random: np.random.Generator, system: str, packets: int, independent: bool = False) -> Int64s:
    """Return what *packets* of each frame are received on: kinds and centres."""
    if system == "le":
        return le_tunings(random, SETS, FRAMES, packets)
    addresses = random.integers(1 << 28, size=SETS)
    clocks = random.integers(1 << 26, size=(SETS, FRAMES)) << 2
    return hop_tunings(addresses, clocks, packets, independent)


@pytest.mark.parametrize(("system", "length", "load", "printed"), two_tiers(STATION_CELLS, 5))
def test_a_station_destroys_packets_as_printed(system: str, length: int, load: float, printed: float):
    random = np.random.default_rng((4, length, int(10 * load)))
    radio = SENDS_10_OF_37 if system == "le" else SENDS_22
    lost = lost_to_station(
        empty_band(2),
        tunings(random, system, 1),
        length * US,
        radio.kind,
        radio.centre,
        1_310 * US,
        load,
        radio.share,
        random.random((SETS, FRAMES)),
        random.exponential(size=(SETS, FRAMES, 30)),
    )
    within(lost, FRAMES, printed)


def exchanges(seed: int, system: str, radio: Radio, independent: bool = False) -> tuple[Int64s, Int64s]:
    """Return how many packets, and how many pairs of packet and answer, a station without pauses destroys."""
    received = tunings(np.random.default_rng((5, seed)), system, 2, independent)
    return lost_exchanges(empty_band(2), received, PACKET, radio.kind, radio.centre, radio.share)


CONTINUOUS = [(SENDS_22, 0.2785, 0.4794), (SENDS_20, 0.2532, 0.4422), (SENDS_17, 0.2152, 0.3841)]


@pytest.mark.parametrize(("radio", "packet", "pair"), CONTINUOUS)
def test_a_station_without_pauses_destroys_packets_and_pairs_of_classic_as_printed_if_hops_are_independent(
    radio: Radio, packet: float, pair: float
):
    packets, pairs = exchanges(radio.centre, "classic", radio, independent=True)
    within(packets, FRAMES, packet)
    within(pairs, FRAMES, pair)


@pytest.mark.parametrize(("radio", "packet", "pair"), CONTINUOUS)
def test_with_real_hops_packets_are_destroyed_as_printed_and_pairs_as_their_hops_say_and_less_often(
    radio: Radio, packet: float, pair: float
):
    packets, pairs = exchanges(1 + radio.centre, "classic", radio)
    within(packets, FRAMES, packet)
    random = np.random.default_rng(11)
    clocks = random.integers(1 << 26, size=1_000) << 2
    by_hops = np.array(
        [any_of(radio, address, clocks, 1, 2) for address in random.integers(1 << 28, size=SETS).tolist()]
    )
    (mean, error), (counted, counted_error) = estimate(pairs / FRAMES), estimate(by_hops)
    assert abs(mean - counted) <= 4 * (error**2 + counted_error**2) ** 0.5
    assert mean < pair


def test_an_event_of_le_is_lost_or_not_as_a_whole():
    packets, pairs = exchanges(0, "le", SENDS_10_OF_37)
    within(packets, FRAMES, 0.2703)
    assert packets.tolist() == pairs.tolist()


# ---------------------------------------------------------------- orders


def test_a_set_of_channels_adapted_to_a_station_meets_it_never_and_else_it_is_met():
    hopping = tunings(np.random.default_rng(6), "classic", 1)
    free = tuple(channel for channel in range(79) if abs(centre_of(channel) - SENDS_22.centre) > 21)
    assert len(free) == 57
    adapted = hopping.copy()
    for one in range(len(adapted)):
        clocks = np.arange(FRAMES) * 4
        adapted[one, :, 1] = 4804 + 2 * np.asarray(adapted_channel(7 * one + 1, clocks, free))
    band, twice = empty_band(2), (0, 1, 0, 1)
    lost = [
        lost_exchanges(band, received[:, :, twice], PACKET, SENDS_22.kind, SENDS_22.centre, SENDS_22.share)[0].sum()
        for received in (hopping, adapted)
    ]
    assert lost[0] > 0.27 * SETS * FRAMES
    assert lost[1] == 0


def test_longer_frames_of_either_kind_are_lost_more_often():
    rates = []
    for length in (248, 582, 1214, 1310, 2427, 6336):
        drawn = piconets(np.random.default_rng(7), SETS, 50, 1, 1)
        band = empty_band(2)
        lost = lost_to_piconets(band, TAKES_22.tuning, length * US, PACKET, 1, 0.9, *drawn, independent=False)
        rates.append(int(lost.sum()))
    assert rates == sorted(set(rates))
    short, long = (
        lost_to_station(
            empty_band(2),
            tunings(np.random.default_rng(8), "classic", 1),
            length * US,
            SENDS_22.kind,
            SENDS_22.centre,
            1_310 * US,
            0.3,
            SENDS_22.share,
            np.random.default_rng(9).random((SETS, FRAMES)),
            np.random.default_rng(10).exponential(size=(SETS, FRAMES, 30)),
        ).sum()
        for length in (366, 2870)
    )
    assert short < long
