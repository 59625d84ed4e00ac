"""A clock estimate ages: two clocks that drift apart by more than half a train make a page begin on the wrong one."""

from math import sqrt

import numpy as np
import pytest

from cosim.machine import Connected, Inquire, InquiryComplete, Page
from cosim.randomness import Streams
from cosim.units import TICK, S, Time
from tests.channels.bluetooth.bluetooth_world import World

PPM = (250, -250)
CASES = 60
SCAN_INTERVAL: Time = 4096 * TICK
HALF_TRAIN: Time = 8 * 4096 * TICK
"""Train A holds the scan channels of 8 blocks of 1.28 s before the estimate, and of 7 after it."""


class _Fixed:
    def __init__(self, values: list[int]) -> None:
        self._values = iter(values)

    def integers(self, *_: int) -> int:
        return next(self._values)


class _DriftingStreams(Streams):
    """Devices 0 and 1 have random clocks that drift apart as fast as they may."""

    def __call__(self, *names: str | int) -> np.random.Generator:
        stream = super().__call__(*names)
        if names[:2] != ("bluetooth", "device"):
            return stream
        phase, _, word = (int(stream.integers(1 << 28)) * TICK, 0, int(stream.integers(1 << 32)))
        return _Fixed([phase, PPM[int(names[2])], word])  # type: ignore[return-value]


def page_time_s(seed: int, age: Time) -> float:
    """Seconds from a page to the link, *age* after the inquiry that told the other's clock.

    And a part of the scan interval that goes with the seed: the inquiry ends just after one of the other's windows.
    """
    age += seed * SCAN_INTERVAL // CASES
    world = World(2, streams=_DriftingStreams(seed), clock_ppm=250)
    world.command(0, Inquire(11 * S, 1))
    world.kernel.run(12 * S)
    found = world.hosts[0].when(InquiryComplete)[0]
    world.kernel.run(found + age)
    world.command(0, Page(1))
    world.kernel.run(found + age + 6 * S)
    (connected,) = world.hosts[0].when(Connected)
    return (connected - found - age) / S


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drifted", "mean_s"),
    [
        (0.0, 0.64),  # the scanner's next window, somewhere in 1.28 s
        (0.8, 0.64),
        (1.3, 1.28 + 0.64),  # one turn of the wrong train before
        (2.6, 1.28 + 0.64),
        (3.4, 0.64),  # the channels repeat after 32 blocks
    ],
)
def test_the_page_time_grows_when_the_estimate_is_off_by_more_than_half_a_train(drifted: float, mean_s: float) -> None:
    relative = (PPM[0] - PPM[1]) * 1e-6
    age = max(20 * S, round(drifted * HALF_TRAIN / relative))
    times = [page_time_s(seed, age) for seed in range(CASES)]
    exchange_s = 0.01  # from the ID that is heard to the NULL, and the search within a window
    deviation = 1.28 / sqrt(12) / sqrt(len(times))
    assert abs(np.mean(times) - mean_s - exchange_s) < 4 * deviation
    assert min(times) > mean_s - 0.64
    assert max(times) < mean_s + 0.64 + 0.03
