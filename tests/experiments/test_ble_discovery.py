"""ble_discovery: its exact solutions against printed values and by hand."""

from math import gcd

import numpy as np
import pytest

from cosim.units import MS, US
from experiments.ble_discovery.exact import Timing, delayed, geometric, one_channel, overlapping

PDU = {"air": 376 * US, "spacing": 600 * US}
"""The PDU of the reference's table."""
TABLE = [  # ms: T_a, T_s, W; with advDelay: mean; found by event 1, 2, 3; one channel without: mean, most
    ((100, 30, 30), 2.80, (0.9825, 1.0), (1.6293, 100.376)),
    ((30, 60, 30), 21.92, (0.4937, 0.9097, 0.9987), None),
    ((500, 100, 10), 4501, (0.0962, 0.1461, 0.1957), None),
    ((1000, 2560, 320), 4981, (0.1249, 0.2497, 0.3746), (4447.422875, 17000.376)),
    ((318.75, 1280, 11.25), 27151, (0.0085, 0.0170, 0.0255), (39171.01465234375, 80325.376)),
    ((100, 1000, 300), None, (), (280.6768, 800.376)),
]


def timing(times_ms: tuple[float, float, float]) -> Timing:
    return Timing(*(round(time * MS) for time in times_ms), **PDU)


@pytest.mark.parametrize(("times_ms", "mean_ms", "found", "alone"), TABLE)
def test_exact_solutions_are_the_printed_ones(times_ms, mean_ms, found, alone) -> None:
    told = one_channel(timing(times_ms))
    if alone is None:
        assert told.met < 1
    else:
        mean, most = alone
        assert told.mean / MS == pytest.approx(mean, abs=5e-5 if mean < 2 else 1e-9 * mean)
        assert (told.greatest / MS, told.met) == (most, 1.0)
    if found:
        computed = delayed(timing(times_ms))
        assert computed.mean / MS == pytest.approx(mean_ms, rel=0.002)
        assert computed.found[: len(found)] == pytest.approx(found, abs=5.1e-5)


@pytest.mark.parametrize("times", [(30, 60, 30), (500, 100, 10), (7, 10, 4), (6, 10, 3), (9, 4, 2), (4, 4, 3)])
def test_one_channel_is_what_each_phase_by_itself_gives(times: tuple[int, int, int]) -> None:
    interval, cycle, window = times
    latencies = []
    for phase in np.arange(0.5, cycle):
        begins = [k for k in range(cycle // gcd(interval, cycle)) if (phase + k * interval) % cycle + 1 <= window]
        latencies += [1 + begins[0] * interval] if begins else []
    told = one_channel(Timing(interval, cycle, window, 1))
    assert told.met == pytest.approx(len(latencies) / cycle)
    assert (told.mean, told.greatest) == pytest.approx((np.mean(latencies), max(latencies)))


def test_independent_events_and_overlaps_are_closed_forms() -> None:
    assert geometric(timing((1000, 2560, 320))) / MS == pytest.approx(1005 * (2560 / 319.624 - 1), rel=1e-3)
    crowd = timing((100, 30, 30))
    assert [overlapping(crowd, size) for size in (10, 50, 100)] == pytest.approx([0.0626, 0.2969, 0.5091], abs=5e-5)
    assert overlapping(crowd, 1) == 0
