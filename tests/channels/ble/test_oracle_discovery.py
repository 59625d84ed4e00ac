"""The exact solver of discovery on one channel: printed values, the closed form, and each phase by itself."""

from fractions import Fraction
from itertools import product

import pytest

from cosim.units import MS, US
from tests.oracles.discovery import Latency, closed_form, solve, step_by_step, without

PACKET = 376 * US


@pytest.mark.parametrize(
    ("interval_us", "scan_ms", "window_us", "mean_ms", "greatest_ms"),
    [
        (100_000, 1000, 300_000, "280.6768", "800.376"),
        (100_000, 30, 30_000, "1.6293", "100.376"),
        (1_000_000, 2560, 320_000, "4447.422875", "17000.376"),
        (318_750, 1280, 11_250, "39171.01465234375", "80325.376"),
    ],
)
def test_printed_latencies(interval_us: int, scan_ms: int, window_us: int, mean_ms: str, greatest_ms: str) -> None:
    latency = solve(interval_us * US, scan_ms * MS, window_us * US, PACKET)
    assert latency is not None
    digits = len(mean_ms.partition(".")[2])
    assert round(latency.mean / MS, digits) == Fraction(mean_ms)
    assert Fraction(latency.greatest, MS) == Fraction(greatest_ms)


def test_the_printed_means_of_many_digits_are_exact() -> None:
    for interval_us, scan_ms, window_us, mean_ms in (
        (100_000, 1000, 300_000, "280.6768"),
        (1_000_000, 2560, 320_000, "4447.422875"),
        (318_750, 1280, 11_250, "39171.01465234375"),
    ):
        latency = solve(interval_us * US, scan_ms * MS, window_us * US, PACKET)
        assert latency is not None
        assert latency.mean / MS == Fraction(mean_ms)


@pytest.mark.parametrize(("interval", "scan", "window"), [(30, 60, 30), (500, 100, 10)])
def test_intervals_that_lock_never_meet_for_some_phases(interval: int, scan: int, window: int) -> None:
    assert solve(interval * MS, scan * MS, window * MS, PACKET) is None


def test_the_closed_form_is_what_the_solver_finds() -> None:
    assert closed_form(100 * MS, 1000 * MS, 300 * MS, PACKET) == Latency(Fraction(2_806_768 * MS, 10_000), 800_376 * US)
    cases = [case for case in product(range(1, 12), range(1, 40), range(1, 40), range(3)) if case[2] <= case[1]]
    cases = [case for case in cases if case[0] <= case[2] - case[3]]
    assert len(cases) > 5_000
    for case in cases:
        assert solve(*case) == closed_form(*case)
    with pytest.raises(ValueError, match="jump over"):
        closed_form(10, 20, 10, 1)


@pytest.mark.slow
def test_the_solver_finds_what_each_phase_by_itself_does() -> None:
    never = 0
    for interval, scan, window, packet in product(range(1, 26), range(1, 14), range(1, 14), range(3)):
        if window <= scan:
            latency = solve(interval, scan, window, packet)
            assert latency == step_by_step(interval, scan, window, packet)
            never += latency is None
    assert never > 100


def test_what_is_taken_from_intervals() -> None:
    assert without([(0, 10)], 3, 5) == [(0, 3), (5, 10)]
    assert without([(0, 10)], 3, 3) == [(0, 3), (3, 10)]
    assert without([(0, 4), (6, 9)], 2, 7) == [(0, 2), (7, 9)]
    assert without([(0, 4)], -2, 5) == []
    assert without([(0, 4)], 5, 6) == [(0, 4)]
