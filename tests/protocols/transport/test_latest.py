"""Transports and their news: of a topic the latest reaches all, and what is no news is refused."""

import pytest

from cosim.errors import LocalProtocolError
from cosim.machine import BROADCAST, Address, Fate, Outcome, Outgoing
from cosim.units import MS, S
from protocols.transport.frames import PUBLICATION_OVERHEAD, Publication
from tests.protocols.transport.lossy_air import Air
from tests.protocols.transport.transport_alone import all_sent, hears, transport


def test_news_reach_all_and_are_not_repeated() -> None:
    air = Air(3, spread_s=0.0)
    air.publish(0, 7, b"here")
    air.run(10 * S)
    for me in (1, 2):
        (news,) = air.published[me]
        assert news == (0, 7, b"here", 10 * MS)
        assert air.transports[me].heard(0) == 10 * MS
    assert air.published[0] == []
    assert air.transports[1].heard(2) is None
    assert len(air.frames) == 1


def test_of_news_that_wait_only_the_latest_of_a_topic_is_sent() -> None:
    robot = transport(in_device=1, spread_s=0.0)
    robot.publish(0, b"1", 0)
    (first,) = robot.drain()
    assert isinstance(first, Outgoing)
    assert first.destination == BROADCAST
    for number in (2, 3, 4):
        robot.publish(0, bytes([number]), 0)
    robot.publish(1, b"other", 0)
    assert robot.drain() == []
    assert first.token is not None
    robot.link(Fate(first.token, Outcome.SENT), 0)
    assert [frame.body for frame in all_sent(robot, 0)] == [Publication(0, 4, b"\x04"), Publication(1, 5, b"other")]


def test_news_wait_a_little_each_another_time_so_that_robots_do_not_all_speak_at_once() -> None:
    waits = []
    for me in range(3):
        robot = transport(me, spread_s=0.05)
        for number in range(40):
            now = number * S
            robot.publish(0, b"", now)
            assert robot.drain() == []
            robot.publish(0, b"newer", now)  # that makes it no later
            at = robot.wake_at()
            assert at is not None
            robot.wake(at)
            (said,) = all_sent(robot, at)
            assert isinstance(said.body, Publication)
            assert said.body.payload == b"newer"
            waits.append(at - now)
    assert 0 < min(waits) < 3 * MS
    assert 47 * MS < max(waits) < 50 * MS
    assert len(set(waits)) > 110


def test_news_that_are_older_or_known_are_not_heard() -> None:
    robot = transport()
    for number in (2, 1, 2, 3):
        hears(robot, 1, Publication(0, number, bytes([number])))
    hears(robot, 1, Publication(0, 1, b"reborn"), incarnation=9)
    hears(robot, 1, Publication(1, 1, b"other topic"))
    assert [news.payload for news in robot.published()] == [b"\x02", b"\x03", b"reborn", b"other topic"]


def test_news_that_are_flooded_reach_who_is_out_of_reach_and_each_says_them_once() -> None:
    air = Air(5, flood=True)
    air.reach = lambda teller, hearer: abs(teller - hearer) == 1
    air.publish(0, 0, b"far")
    air.run(S)
    assert [[news.payload for news in each] for each in air.published] == [[], *[[b"far"]] * 4]
    assert len(air.frames) == 5


@pytest.mark.parametrize("news", [(0, bytes(200 - PUBLICATION_OVERHEAD + 1)), (255, b""), (-1, b"")])
def test_news_that_are_none_are_our_own_mistake(news: tuple[int, bytes]) -> None:
    with pytest.raises(LocalProtocolError):
        transport().publish(*news, 0)
    transport().publish(254, bytes(200 - PUBLICATION_OVERHEAD), 0)


@pytest.mark.parametrize("robot", [-1, 3])
def test_nobody_writes_to_who_does_not_exist(robot: Address) -> None:
    with pytest.raises(LocalProtocolError):
        transport().send(robot, b"", 0)
    with pytest.raises(LocalProtocolError):
        transport().forget(robot, 0)
