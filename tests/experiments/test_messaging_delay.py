from collections.abc import Callable

import pytest
from pydantic import ValidationError

from experiments.messaging_delay.delay import Parameters, Strategy, exchange_slots

TEAMS = range(2, 9)


@pytest.mark.slow
@pytest.mark.parametrize("n_bc", [1, 2, 3])
@pytest.mark.parametrize(
    ("strategy", "slots"),
    [
        # a broadcast of every state, n times a slot pair each, and a slot pair for every slave that is polled
        ("broadcast", lambda m, n: 2 * n * m + 2 * (m - 1)),
        # a poll of every slave, and every state but the receiver's own to everyone
        ("unicast", lambda m, n: 2 * m * (m - 1)),
        # the polls carry the master's state: M - 1 packets fewer
        ("unicast_piggyback", lambda m, n: 2 * (m - 1) ** 2),
        # a poll, and n broadcasts
        ("one_message_broadcast", lambda m, n: 2 + 2 * n),
        # a poll, and a packet to each other slave
        ("one_message_unicast", lambda m, n: 2 * (m - 1)),
    ],
)
def test_an_exchange_takes_the_slots_that_its_frames_need(strategy: str, slots: Callable[[int, int], int], n_bc: int):
    measured = {
        m: exchange_slots(Parameters(team_size=m, strategy=Strategy(strategy), n_bc=n_bc), seed=1) for m in TEAMS
    }
    assert measured == {m: slots(m, n_bc) for m in TEAMS}


@pytest.mark.slow
def test_a_broadcast_exchange_without_repetition_takes_4m_minus_2_slots():
    measured = [exchange_slots(Parameters(team_size=m, strategy=Strategy.BROADCAST), seed=2) for m in TEAMS]
    assert measured == [6, 10, 14, 18, 22, 26, 30]


@pytest.mark.parametrize(("team_size", "n_bc"), [(1, 1), (9, 1), (2, 0)])
def test_what_a_piconet_cannot_be_is_refused(team_size: int, n_bc: int):
    with pytest.raises(ValidationError):
        Parameters(team_size=team_size, strategy=Strategy.BROADCAST, n_bc=n_bc)
