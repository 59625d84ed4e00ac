"""Discovery with advDelay on three channels: densities against a table made before, and against draws.

The table's quantiles are those of 200 000 draws, so that they are wrong by what such draws are. So is the mean at most.
"""

from functools import cache
from math import sqrt

import numpy as np
import pytest

from cosim.units import MS, US
from tests.oracles.discovery import Intervals
from tests.oracles.discovery_density import (
    ADV_DELAY,
    Case,
    Chances,
    Latencies,
    draw_latencies,
    event_chances,
    heard_phases,
    latencies,
    shares,
    smeared,
)

DRAWS = 200_000
"""Draws with which the table was made."""
SIGMAS = 4


@cache
def chances(case: Case, cell: int) -> Chances:
    return event_chances(case, cell)


@cache
def distribution(case: Case, cell: int, phase_cell: int, until: int) -> Latencies:
    return latencies(case, cell, phase_cell, until)


@cache
def drawn(case: Case) -> np.ndarray:
    return draw_latencies(case, DRAWS, np.random.default_rng(2016))


TABLE = [  # mean (ms) and half of its last digit; found by event 1, 2, 3; cell
    (Case(100 * MS, 30 * MS, 30 * MS), 2.80, 0.005, (0.9825, 1.0), 31_250),
    (Case(30 * MS, 60 * MS, 30 * MS), 21.92, 0.005, (0.4937, 0.9097, 0.9987), 31_250),
    (Case(500 * MS, 100 * MS, 10 * MS), 4501, 0.5, (0.0962, 0.1461, 0.1957), 31_250),
    (Case(1000 * MS, 2560 * MS, 320 * MS), 4981, 0.5, (0.1249, 0.2497, 0.3746), 250_000),
    (Case(318_750 * US, 1280 * MS, 11_250 * US), 27151, 0.5, (0.0085, 0.0170, 0.0255), 250_000),
]
QUANTILES = [  # median, 95 %, 99 % (ms) and half of their last digit; cell of time and of first phase, end (ms)
    (TABLE[0][0], (0.98, 1.58, 104.6), (0.005, 0.005, 0.05), 31_250, 62_500, 140),
    (TABLE[1][0], (30.8, 72.1, 77.8), (0.05, 0.05, 0.05), 31_250, 62_500, 95),
    (TABLE[2][0], (4538, 9585, 11578), (0.5, 0.5, 0.5), 312_500, 625_000, 12_500),
    (TABLE[3][0], (4007, 14084, 17084), (0.5, 0.5, 0.5), 1_250_000, 2_500_000, 19_000),
    (TABLE[4][0], (20405, 77010, 114944), (0.5, 0.5, 0.5), 625_000, 10_000_000, 120_000),
]
IDS = ["100-30-30", "30-60-30", "500-100-10", "1000-2560-320", "318.75-1280-11.25"]


@pytest.mark.slow
@pytest.mark.parametrize(("case", "mean_ms", "digit", "found", "cell"), TABLE, ids=IDS)
def test_chances_by_event_and_the_mean_are_those_of_the_table(
    case: Case, mean_ms: float, digit: float, found: tuple[float, ...], cell: int
) -> None:
    computed = chances(case, cell)
    assert [round(chance, 4) for chance in computed.found[: len(found)]] == list(found)
    error = drawn(case).std() / MS / sqrt(DRAWS)
    assert computed.mean / MS == pytest.approx(mean_ms, abs=SIGMAS * error + digit)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "cell"), [(row[0], row[-1]) for row in TABLE], ids=IDS)
def test_chances_by_event_and_the_mean_are_those_of_draws(case: Case, cell: int) -> None:
    computed, draws = chances(case, cell), drawn(case)
    assert computed.mean == pytest.approx(draws.mean(), abs=SIGMAS * draws.std() / sqrt(DRAWS))
    for event, chance in enumerate(computed.found[:3]):  # an event begins before the next one can
        share = (draws < (event + 1) * case.interval).mean()
        assert chance == pytest.approx(share, abs=SIGMAS * sqrt(chance * (1 - chance) / DRAWS) + 1 / DRAWS)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "printed", "digits", "cell", "phase_cell", "end"), QUANTILES, ids=IDS)
def test_quantiles_are_those_of_the_table_and_of_draws(
    case: Case, printed: tuple[float, ...], digits: tuple[float, ...], cell: int, phase_cell: int, end: int
) -> None:
    computed = distribution(case, cell, phase_cell, end * MS)
    for share, value, digit in zip((0.5, 0.95, 0.99), printed, digits, strict=True):
        error = SIGMAS * sqrt(share * (1 - share) / DRAWS)
        low, high = computed.quantile(share - error), computed.quantile(share + error)
        assert low / MS - digit <= value <= high / MS + digit
        assert low - US <= np.quantile(drawn(case), share) <= high + US


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "cell", "phase_cell"), [(row[0], row[3], row[4]) for row in QUANTILES[:4]], ids=IDS[:4]
)
def test_times_and_phases_give_the_same_chances(case: Case, cell: int, phase_cell: int) -> None:
    computed = distribution(case, cell, phase_cell, QUANTILES[[row[0] for row in QUANTILES].index(case)][5] * MS)
    for event, chance in enumerate(chances(case, TABLE[[row[0] for row in TABLE].index(case)][4]).found[:3]):
        assert computed.by((event + 1) * case.interval - 1) == pytest.approx(chance, abs=1e-4)


def test_the_first_event_is_heard_with_the_share_of_the_window() -> None:
    for case in (row[0] for row in TABLE[1:]):
        *heard, missed = heard_phases(case)
        lengths = [sum(end - start for start, end in part) for part in heard]
        assert lengths == [case.window - case.packet] * 3
        assert sum(end - start for start, end in missed) == case.cycle - sum(lengths)


def test_with_a_continuous_scan_an_event_is_missed_where_the_channel_changes() -> None:
    case = TABLE[0][0]
    first, second, third, missed = heard_phases(case)
    # ms: 37 in [0, 29.624]; 38 in [29.4, 59.024], after 37; 39 in [58.8, 88.424], after 38
    assert first == [(0, 29_624_000)]
    assert second == [(29_624_000, 59_024_000)]
    assert third == [(59_024_000, 88_424_000)]
    assert missed == [(88_424_000, 90_000_000)]
    assert sum(end - start for start, end in missed) == 2 * case.spacing + case.packet  # the reference's (2 delta + d)


def test_shares_of_cells() -> None:
    phases: Intervals = [(0, 5), (12, 20), (29, 30)]
    assert shares(phases, 30, 10).tolist() == [0.5, 0.8, 0.1]


def test_a_cell_and_a_box_make_a_trapezium() -> None:
    density = np.zeros(12)
    density[9] = 1.0
    assert smeared(density, 4).tolist() == pytest.approx([*[0.0] * 4, 1 / 8, 1 / 4, 1 / 4])
    density[:] = 0.0
    density[5] = 1.0
    assert smeared(density, 4).tolist() == pytest.approx([1 / 8, 1 / 4, 1 / 4, 1 / 4, 1 / 8, 0.0, 0.0])
    assert smeared(np.ones((12, 2)), 4).tolist() == [[1.0, 1.0]] * 7


def test_a_distribution_is_steps_and_ramps() -> None:
    later = np.array([[0.0, 0.2, 0.2], [0.0, 0.0, 0.0], [0.0, 0.0, 0.3]])
    computed = Latencies([1, 2, 3], [0.1, 0.1, 0.1], later, 10)
    assert [computed.by(time) for time in (0, 1, 2, 3, 11)] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.3])
    assert computed.by(16) == pytest.approx(0.3 + 0.1)
    assert computed.by(28) == pytest.approx(0.3 + 0.2 + 0.14 + 0.15)
    assert computed.quantile(0.4) == pytest.approx(16, abs=1)


def test_draws_keep_to_the_times_that_events_may_have() -> None:
    case = TABLE[1][0]
    for latency in drawn(case)[:2_000]:
        starts = [latency - offset for offset in case.offsets]
        events = [round(start // case.interval) for start in starts]
        assert any(
            start >= -1 and 0 <= start - event * case.interval <= event * ADV_DELAY + 1
            for start, event in zip(starts, events, strict=True)
        )
