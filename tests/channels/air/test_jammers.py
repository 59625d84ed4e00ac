"""What a jammer puts on the air is what the law of jammers says that it is on, at every instant."""

import pytest

from cosim.channels.air.jammers import emissions
from cosim.channels.jamming import CONSTANT, PULSED, SWEEPING, Jammer, jams

JAMMERS = [
    Jammer(0.0, 0.0, 10.0, (3, 40, 7), CONSTANT, 0, 0, 0, 20, 300),
    Jammer(0.0, 0.0, 10.0, (3, 40, 7), SWEEPING, 11, 0, 0, 20, 300),
    Jammer(0.0, 0.0, 10.0, (3, 40, 7), PULSED, 0, 6, 17, 20, 300),
]


@pytest.mark.parametrize("jammer", JAMMERS)
@pytest.mark.parametrize(("since", "until"), [(0, 400), (20, 21), (25, 90), (299, 400), (300, 400), (31, 31), (0, 20)])
def test_it_is_on_the_air_when_it_jams(jammer: Jammer, since: int, until: int) -> None:
    sent = list(emissions(jammer, 5, 2, 0.25, since, until))
    assert all((each.sender, each.tenant, each.sent_mw) == (5, 2, 0.25) for each in sent)
    of_law = jammer.mode, jammer.dwell, jammer.on, jammer.period, jammer.start, jammer.end
    for now in range(400):
        for place, channel in enumerate(jammer.channels):
            told = [each for each in sent if each.start <= now < each.end and each.centre == 2 * (2402 + channel)]
            on = since <= now < until and jams(*of_law, place, len(jammer.channels), now, now + 1)
            assert len(told) == on, (now, channel)
