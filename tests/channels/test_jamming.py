"""Jammers: when they are on which channel, against their definition instant by instant."""

import numpy as np
import pytest

from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer, jams
from cosim.units import Time


def on_air(jammer: Jammer, start_ns: Time, end_ns: Time, channel: int) -> bool:
    """Ask the kernel whether *jammer* is on *channel* at any instant of [start_ns, end_ns)."""
    place = jammer.channels.index(channel) if channel in jammer.channels else -1
    times = jammer.mode, jammer.dwell, jammer.on, jammer.period, jammer.start, jammer.end
    return bool(jams(*times, place, len(jammer.channels), start_ns, end_ns))


def on_at(jammer: Jammer, time: Time, channel: int) -> bool:
    """Tell whether a jammer is on a channel at one instant: its definition, word by word."""
    if channel not in jammer.channels or not jammer.start <= time < jammer.end:
        return False
    since = time - jammer.start
    return {
        CONSTANT: True,
        SWEEPING: jammer.channels[(since // jammer.dwell) % len(jammer.channels)] == channel,
        PULSED: since % jammer.period < jammer.on,
    }[jammer.mode]


@pytest.mark.parametrize("mode", [CONSTANT, SWEEPING, PULSED])
def test_a_frame_meets_a_jammer_iff_it_does_so_at_some_instant(mode: int):
    draw = np.random.default_rng(mode)
    met = 0
    for _ in range(3_000):
        on = int(draw.integers(1, 6))
        channels = tuple(draw.permutation(6)[: draw.integers(1, 6)].tolist())
        start = int(draw.integers(0, 12))
        jammer = Jammer(
            0.0,
            0.0,
            0.0,
            channels,
            mode,
            dwell=int(draw.integers(1, 6)),
            on=on,
            period=on + int(draw.integers(0, 6)),
            start=start,
            end=start + int(draw.integers(0, 40)),
        )
        begin, channel = int(draw.integers(0, 50)), int(draw.integers(0, 6))
        end = begin + int(draw.integers(0, 12))
        expected = any(on_at(jammer, time, channel) for time in range(begin, end))
        assert on_air(jammer, begin, end, channel) == expected, (jammer, begin, end, channel)
        met += expected
    assert 300 < met < 2_700


def test_the_first_and_the_last_nanosecond_of_a_pulse_count_and_the_next_does_not():
    pulsed = Jammer(0.0, 0.0, 20.0, (5,), PULSED, dwell=0, on=10_000, period=1_000_000, start=500, end=10**12)
    second = 500 + 1_000_000
    cases = [
        (second - 9, second),
        (second - 9, second + 1),
        (second + 9_999, second + 10_009),
        (second + 10_000, second + 10_009),
    ]
    assert [on_air(pulsed, *case, 5) for case in cases] == [False, True, True, False]
    assert not on_air(pulsed, 0, 10**12, 6)
