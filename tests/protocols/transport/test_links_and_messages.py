"""Transports in a piconet: what a master passes on, to whom a slave speaks, and what waits for who is not there."""

import pytest

from cosim.machine import BROADCAST, Connected, Fate, Lost, Outcome, Outgoing, Page, PageFailed, Reception, Role
from cosim.units import S
from protocols.transport.frames import ALL, Ack, Frame, Part, Publication, encode
from tests.protocols.transport.transport_alone import TIMES, bluetooth_transport, linked, sent, transport


def test_a_master_that_follows_another_tells_it_of_its_slaves_and_they_are_paged_at_once() -> None:
    second, first = (
        linked(bluetooth_transport(1, 5), Role.MASTER, 2, 3),
        linked(bluetooth_transport(0, 5), Role.MASTER, 4),
    )
    second.links.leading = True  # type: ignore[union-attr]
    linked(second, Role.MASTER, 2, 3)
    first.forget(2, 0)
    first.tick((), 0)
    first.link(PageFailed(1), 0)
    first.tick((), 0)
    first.link(PageFailed(3), 5 * S)
    first.drain()
    second.link(Connected(0, Role.SLAVE), 6 * S)
    ((to, frame),) = sent(second)
    assert (to, frame.body) == (0, Publication(255, 1, bytes([2, 3])))
    first.link(Connected(1, Role.MASTER), 6 * S)
    first.receive(encode(frame), Reception(1, False), 6 * S)
    first.tick((), 6 * S)
    assert Page(2) in first.drain()
    first.link(Connected(2, Role.MASTER), 7 * S)
    first.tick((), 7 * S)
    assert Page(3) in first.drain()


def test_a_transport_without_a_link_keeps_what_it_has_to_say() -> None:
    robot = bluetooth_transport(1)
    robot.send(2, b"x", 0)
    robot.publish(0, b"old", 0)
    robot.publish(0, b"new", 0)
    assert sent(robot) == []
    robot.link(Connected(0, Role.SLAVE), S)
    (to_all, frame), (to_one, message) = sent(robot)
    assert to_all == to_one == 0
    assert frame == Frame(1, ALL, 0, Publication(0, 2, b"new"))
    assert message.destination == 2


def test_a_master_passes_on_what_slaves_say_to_each_other_and_to_all() -> None:
    master = linked(bluetooth_transport(0), Role.MASTER, 1, 2)
    to_two, to_all = Frame(1, 2, 0, Ack(0, 0, 0)), Frame(1, ALL, 0, Publication(0, 1, b""))
    for frame in (to_two, to_all):
        master.receive(encode(frame), Reception(1, False), 0)
    assert sent(master) == [(2, to_two), (BROADCAST, to_all)]
    assert [news.source for news in master.published()] == [1]
    assert master.messages() == []
    assert master.counts.relayed == 2


@pytest.mark.parametrize(
    ("frame", "reception"),
    [
        (Frame(1, 3, 0, Ack(0, 0, 0)), Reception(1, False)),  # to whom it has no link
        (Frame(1, 2, 0, Ack(0, 0, 0)), Reception(2, False)),  # was passed on already
        (Frame(1, ALL, 0, Publication(0, 1, b"")), Reception(2, False)),
        (Frame(1, ALL, 0, Publication(0, 1, b"")), Reception(1, True)),  # all have heard it
    ],
)
def test_nothing_else_is_passed_on(frame: Frame, reception: Reception) -> None:
    master = linked(bluetooth_transport(0), Role.MASTER, 1, 2)
    master.receive(encode(frame), reception, 0)
    assert sent(master) == []


def test_news_of_the_only_slave_are_told_to_nobody() -> None:
    master = linked(bluetooth_transport(0), Role.MASTER, 1)
    master.receive(encode(Frame(1, ALL, 0, Publication(0, 1, b""))), Reception(1, False), 0)
    assert sent(master) == []


def test_a_slave_passes_nothing_on() -> None:
    slave = linked(bluetooth_transport(3), Role.SLAVE, 0)
    slave.receive(encode(Frame(1, 2, 0, Ack(0, 0, 0))), Reception(1, False), 0)
    assert sent(slave) == []


def test_only_who_has_something_to_do_about_news_says_so() -> None:
    news = encode(Frame(1, ALL, 0, Publication(0, 1, b"x")))
    slave, master = linked(bluetooth_transport(2), Role.SLAVE, 0), linked(bluetooth_transport(0), Role.MASTER, 1, 2)
    assert not slave.receive(news, Reception(0, True), S)
    assert [each.payload for each in slave.published()] == [b"x"]
    assert master.receive(news, Reception(1, False), S), "it relays it"
    assert slave.receive(b"noise", Reception(0, True), S), "there is an event"
    assert not bluetooth_transport(2).receive(news, Reception(0, True), S)
    assert transport(2, 4, links=TIMES).receive(news, Reception(0, True), S), "its first link commands wait"
    slave.receive(news, Reception(0, True), 5 * S)
    assert slave.receive(news, Reception(0, True), 3 * S), "its clock was set back, and with it the deadlines"


def test_a_tick_says_whether_anything_has_come_of_it() -> None:
    master = linked(bluetooth_transport(0), Role.MASTER, 1, 2)
    assert master.tick((), 0), "it has somebody to page"
    assert master.drain() == [Page(3)]
    assert not master.tick((), S)
    assert master.tick((), 2 * S), "it lets itself be heard"
    ((_, beat),) = sent(master)
    assert beat.body == Publication(255, 1, b"")
    assert not master.tick((), 3 * S)
    assert master.tick((), S), "its clock was set back, and with it the deadlines"
    assert not master.tick((), S)


def test_a_tick_comes_before_the_deadline_of_its_instant_and_meets_it() -> None:
    robot = linked(bluetooth_transport(2), Role.SLAVE, 0)
    robot.send(1, b"x", 0)
    assert len(sent(robot)) == 1
    due = robot.wake_at()
    assert due is not None
    assert not robot.tick((), due - 1)
    assert robot.tick((), due)
    assert robot.wake_at() > due  # type: ignore[operator]


def test_a_fate_says_whether_anything_has_waited_for_it() -> None:
    slave = linked(bluetooth_transport(2), Role.SLAVE, 0)
    for value in range(6):
        slave.publish(value, b"", 0)
    tokens = [item.token for item in slave.drain() if isinstance(item, Outgoing)]
    assert len(tokens) == 4, "the radio holds no more"
    assert slave.link(Fate(tokens[0] or 0, Outcome.SENT), S), "there is room for the next"
    assert slave.link(Fate(tokens[1] or 0, Outcome.SENT), S)
    assert len(sent(slave)) == 2
    assert not slave.link(Fate(tokens[2] or 0, Outcome.SENT), S), "there was nothing left to wait"
    slave.send(1, b"x", S)
    assert slave.link(Fate(tokens[3] or 0, Outcome.SENT), S), "a message waits for its answer"


def test_what_others_wait_for_is_sent_as_soon_as_a_fate_makes_room() -> None:
    master, slave = linked(bluetooth_transport(0), Role.MASTER, 1, 2), linked(bluetooth_transport(2), Role.SLAVE, 0)
    for number in range(5):
        master.receive(encode(Frame(1, 2, 0, Ack(0, number, 0))), Reception(1, False), 0)
        slave.publish(number, b"", 0)
    slave.link(Fate(1, Outcome.SENT), 0)
    slave.receive(encode(Frame(1, 2, 0, Part(0, 0, 0, 1, b"x"))), Reception(0, False), 0)
    for robot, waiting in ((master, Ack(0, 4, 0)), (slave, Ack(0, 1, 0))):
        assert len(sent(robot)) == (4 if robot is master else 5)
        assert robot.link(Fate(2, Outcome.SENT), 0)
        ((_, frame),) = sent(robot)
        assert frame.body == waiting


def test_what_waits_for_a_slave_that_is_lost_is_not_passed_on_later() -> None:
    master = linked(bluetooth_transport(0), Role.MASTER, 1, 2)
    for number in range(6):
        master.receive(encode(Frame(1, 2, 0, Ack(0, number, 0))), Reception(1, False), 0)
    assert len(sent(master)) == 4  # the radio holds no more
    master.link(Lost(2), S)
    linked(master, Role.MASTER, 2)
    master.wake(10 * S)
    assert sent(master) == []


def test_a_master_that_has_nothing_to_say_lets_itself_be_heard_and_nobody_takes_that_for_news() -> None:
    master, slave = linked(bluetooth_transport(0), Role.MASTER, 1), linked(bluetooth_transport(1), Role.SLAVE, 0)
    beats = []
    for tick in range(100):
        now = tick * S // 10
        master.tick((), now)
        for destination, frame in sent(master):
            beats.append(tick)
            assert destination == BROADCAST
            slave.receive(encode(frame), Reception(0, True), now)
        if tick == 30:
            master.publish(0, b"news", now)
    assert beats[:2] == [20, 31]
    assert [news.payload for news in slave.published()] == [b"news"]
    assert slave.heard(0) == beats[-1] * S // 10


def test_without_slaves_no_master_speaks() -> None:
    master = bluetooth_transport(0)
    for tick in range(100):
        master.tick((), tick * S)
        assert sent(master) == []
