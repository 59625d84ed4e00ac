"""When jammers change what an 802.11 channel receives of them, against their definition instant by instant."""

import numpy as np
import pytest

from cosim.channels.adhoc.jamming import Source, source
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer
from cosim.units import MS, S, Time


def weight_at(jammer: Jammer, at: Time, channel: int, bandwidth_mhz: float) -> float:
    """Return how many MHz of the band a jammer is on at an instant, by quarters of MHz: its definition."""
    since = at - jammer.start
    if not jammer.start <= at < jammer.end or (jammer.mode == PULSED and since % jammer.period >= jammer.on):
        return 0.0
    on = jammer.channels
    if jammer.mode == SWEEPING:
        on = (on[(since // jammer.dwell) % len(on)],)
    middle = 2412 + 5 * (channel - 1)
    quarters = [2402 + k - 0.5 + (part + 0.5) / 4 for k in on for part in range(4)]
    return sum(abs(quarter - middle) < bandwidth_mhz / 2 for quarter in quarters) / 4


@pytest.mark.parametrize("mode", [CONSTANT, SWEEPING, PULSED])
def test_between_one_change_and_the_next_a_jammer_is_what_it_is_by_definition(mode: int) -> None:
    draw = np.random.default_rng(mode)
    for _ in range(200):
        on, start = int(draw.integers(1, 6)), int(draw.integers(0, 12))
        channels = tuple(draw.permutation(26)[: draw.integers(1, 9)].tolist())
        times = {"dwell": int(draw.integers(1, 6)), "on": on, "period": on + int(draw.integers(0, 6))}
        jammer = Jammer(0, 0, 0, channels, mode, **times, start=start, end=start + int(draw.integers(1, 60)))
        heard = source(jammer, 1, 20e6)
        if heard is None:
            assert not any(weight_at(jammer, at, 1, 20.0) for at in range(80))
            continue
        following: Time | None = 0
        for at in range(90):
            expected = weight_at(jammer, at, 1, 20.0)
            assert heard.weight(at) == expected
            if at == following:
                following = heard.next_change(at)
                assert following is None or following > at
            else:
                assert expected == weight_at(jammer, at - 1, 1, 20.0), "a change that was not told of"
        assert following is None


def test_no_change_is_told_of_twice_in_a_part_of_a_sweep_that_is_all_in_the_band() -> None:
    heard = source(Jammer(0, 0, 0, tuple(range(79)), SWEEPING, MS, 0, 0, 0, S), 1, 22e6)
    assert isinstance(heard, Source)
    assert heard.next_change(0) == 21 * MS, "from whole channels to half of one"
    assert heard.next_change(22 * MS) == 79 * MS
