"""The null model: a fixed delay, nothing lost, links at once, answers in new events."""

from typing import Any

import pytest

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time

DELAY = 10 * US


class Host:
    """An endpoint that notes what comes in, and when it is drained."""

    def __init__(self, address: Address, log: list[tuple[Time, Address, Any]]) -> None:
        self.address = address
        self.log = log

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.log.append((now, self.address, (data, reception)))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.log.append((now, self.address, event))

    def drain(self, now: Time) -> None:
        self.log.append((now, self.address, "drain"))


class Room:
    """An ideal channel and its hosts."""

    def __init__(self, size: int = 3) -> None:
        self.kernel = Kernel()
        self.trace = Trace([FRAMES])
        self.channel = IdealChannel(IdealSettings(delay_s=DELAY / S), self.kernel, self.trace, size)
        self.log: list[tuple[Time, Address, Any]] = []
        for address in range(size):
            self.channel.attach(address, Host(address, self.log))

    def run(self, until: Time = MS) -> list[tuple[Time, Address, Any]]:
        self.kernel.run(until)
        return [entry for entry in self.log if entry[2] != "drain"]

    @property
    def drains(self) -> list[Address]:
        return [address for _, address, what in self.log if what == "drain"]


@pytest.fixture
def room() -> Room:
    return Room()


# ---------------------------------------------------------------- payloads


def test_a_payload_arrives_after_the_delay_and_its_fate_with_it(room: Room):
    room.kernel.at(100, lambda: room.channel.send(0, Outgoing(2, b"hello", token=7)))
    assert room.run() == [
        (100 + DELAY, 2, (b"hello", Reception(0, False))),
        (100 + DELAY, 0, Fate(7, Outcome.DELIVERED)),
    ]


def test_a_broadcast_reaches_everyone_but_its_author(room: Room):
    room.channel.send(1, Outgoing(BROADCAST, b"all", token=1))
    assert room.run() == [
        (DELAY, 0, (b"all", Reception(1, True))),
        (DELAY, 2, (b"all", Reception(1, True))),
        (DELAY, 1, Fate(1, Outcome.SENT)),
    ]


def test_without_a_token_there_is_no_fate(room: Room):
    room.channel.send(0, Outgoing(1, b"x"))
    room.channel.send(0, Outgoing(9, b"x"))
    assert room.run() == [(DELAY, 1, (b"x", Reception(0, False)))]


@pytest.mark.parametrize("destination", [0, 3, -2])
def test_there_is_no_link_to_oneself_or_to_nobody(room: Room, destination: Address):
    room.channel.send(0, Outgoing(destination, b"x", token=4))
    assert room.log == []  # never inside the call
    assert room.run() == [(0, 0, Fate(4, Outcome.NO_LINK))]
    assert room.channel.summary() == {"frames_sent": 0.0}


def test_what_is_sent_at_one_instant_is_one_event_and_drains_each_host_once(room: Room):
    for source in (2, 0, 1):
        room.channel.send(source, Outgoing(BROADCAST, bytes([source]), token=source))
    room.run()
    assert room.kernel.executed == 1
    assert room.drains == [0, 1, 2]
    assert [data for _, address, (data, _) in room.log[:6] if address == 1] == [b"\x02", b"\x00"]  # in send order


def test_hosts_are_drained_in_order_of_addresses_in_large_teams_too():
    room = Room(size=20)
    for destination in (17, 9, 1):
        room.channel.send(0, Outgoing(destination, b"x"))
    room.run()
    assert room.drains == [1, 9, 17]


def test_what_is_sent_at_two_instants_arrives_at_two(room: Room):
    for time in (5, 6):
        room.kernel.at(time, lambda: room.channel.send(0, Outgoing(1, b"x")))
    assert [time for time, *_ in room.run()] == [5 + DELAY, 6 + DELAY]
    assert room.drains == [1, 1]


def test_an_answer_within_a_delivery_is_a_sending_of_its_own(room: Room):
    class Echo(Host):
        def drain(self, now: Time) -> None:
            if now < 3 * DELAY:
                room.channel.send(self.address, Outgoing(0, b"again"))

    room.channel.attach(1, Echo(1, room.log))
    room.channel.send(0, Outgoing(1, b"go"))
    assert [time for time, address, _ in room.run() if address == 0] == [2 * DELAY]


def test_the_shortest_delay_is_one_nanosecond():
    assert IdealChannel(IdealSettings(delay_s=1e-12), Kernel(), Trace(), 2).delay == 1


def test_frames_are_traced_with_their_outcome(room: Room):
    room.channel.power(2, False)
    room.kernel.at(50, lambda: room.channel.send(0, Outgoing(1, b"four")))
    room.kernel.at(60, lambda: room.channel.send(1, Outgoing(BROADCAST, b"")))
    room.kernel.at(61, lambda: room.channel.power(0, False))
    room.run()
    columns = room.trace.columns("frames")
    assert columns["time_ns"] == [50, 60]
    assert columns["source"] == [0, 1]
    assert columns["destination"] == [1, BROADCAST]
    assert columns["duration_ns"] == [DELAY, DELAY]
    assert columns["length"] == [4, 0]
    assert columns["outcome"] == ["received", "out_of_range"]
    assert room.channel.summary() == {"frames_sent": 2.0}


# ---------------------------------------------------------------- links


def test_an_inquiry_is_answered_by_a_new_event_at_the_same_instant(room: Room):
    def ask() -> None:
        room.channel.command(1, Inquire(10 * S, 7))
        assert room.log == []

    room.kernel.at(100, ask)
    found = [Discovered(0), Discovered(2), InquiryComplete((0, 2))]
    assert room.run() == [(100, 1, event) for event in found]
    assert room.drains == [1]


def test_an_inquiry_ends_when_enough_are_found_and_finds_only_who_scans(room: Room):
    room.channel.command(1, Scan(False))
    room.channel.command(0, Inquire(10 * S, 1))
    assert room.run() == [(0, 0, Discovered(2)), (0, 0, InquiryComplete((2,)))]
    room.log.clear()
    room.channel.command(1, Scan(True))
    room.channel.command(0, Inquire(10 * S, 1))
    assert [event for *_, event in room.run(2 * MS)] == [Discovered(1), InquiryComplete((1,))]


def test_a_page_connects_both_sides(room: Room):
    room.kernel.at(100, lambda: room.channel.command(0, Page(2)))
    assert room.run() == [(100, 0, Connected(2, Role.MASTER)), (100, 2, Connected(0, Role.SLAVE))]


@pytest.mark.parametrize("peer", [0, 1, 9, -1])
def test_a_page_fails_for_who_does_not_scan_and_for_nobody(room: Room, peer: Address):
    room.channel.command(1, Scan(False))
    room.channel.command(0, Page(peer))
    assert room.run() == [(0, 0, PageFailed(peer))]


def test_a_link_that_is_closed_is_lost_on_both_sides(room: Room):
    room.channel.command(0, Disconnect(2))
    assert room.run() == [(0, 0, Lost(2)), (0, 2, Lost(0))]


@pytest.mark.parametrize("command", [Disconnect(9), Disconnect(-1), Flush(1), Scan(True)])
def test_a_command_without_effect_has_no_answer(room: Room, command: Any):
    room.channel.command(0, command)
    assert room.run() == []


def test_answers_of_one_instant_are_one_event(room: Room):
    room.channel.command(0, Page(1))
    room.channel.command(2, Page(1))
    room.channel.send(0, Outgoing(9, b"x", token=1))
    room.run()
    assert room.kernel.executed == 1
    assert room.drains == [0, 1, 2]


# ---------------------------------------------------------------- power


def test_everybody_else_is_in_reach_while_both_are_on(room: Room):
    assert [room.channel.in_reach(address) for address in range(3)] == [(1, 2), (0, 2), (0, 1)]
    room.channel.power(1, False)
    assert [room.channel.in_reach(address) for address in range(3)] == [(2,), (), (0,)]
    room.channel.power(1, True)
    assert room.channel.in_reach(1) == (0, 2)


def test_the_others_lose_a_device_that_goes_off_once(room: Room):
    room.channel.power(1, False)
    room.channel.power(1, False)
    assert room.run() == [(0, 0, Lost(1)), (0, 2, Lost(1))]


def test_a_device_that_is_off_takes_no_command(room: Room):
    room.channel.power(1, False)
    room.channel.command(1, Scan(False))
    room.channel.power(1, True)
    room.run(1)
    room.log.clear()
    room.channel.command(0, Page(1))
    assert room.run()[0] == (1, 0, Connected(1, Role.MASTER))


def test_a_device_that_comes_on_is_no_news(room: Room):
    room.channel.power(1, True)
    assert room.run() == []
    assert room.kernel.executed == 0


def test_a_device_that_is_off_neither_sends_nor_asks_nor_hears(room: Room):
    room.channel.power(1, False)
    room.run(1)
    room.log.clear()
    room.channel.send(1, Outgoing(BROADCAST, b"x", token=1))
    room.channel.send(1, Outgoing(0, b"x", token=2))
    room.channel.command(1, Inquire(S, 7))
    room.channel.command(1, Page(0))
    room.channel.command(1, Disconnect(0))
    room.channel.send(0, Outgoing(BROADCAST, b"y"))
    room.channel.command(0, Disconnect(1))
    room.channel.send(0, Outgoing(1, b"z", token=3))
    assert [entry[1:] for entry in room.run()] == [
        (0, Fate(3, Outcome.NO_LINK)),
        (2, (b"y", Reception(0, True))),
    ]
    assert room.channel.summary() == {"frames_sent": 1.0}


def test_what_is_under_way_to_a_device_that_goes_off_is_lost(room: Room):
    room.channel.send(0, Outgoing(1, b"x", token=1))
    room.channel.send(1, Outgoing(0, b"y", token=2))
    room.kernel.at(DELAY // 2, lambda: room.channel.power(1, False))
    assert room.run() == [
        (DELAY // 2, 0, Lost(1)),
        (DELAY // 2, 2, Lost(1)),
        (DELAY, 0, (b"y", Reception(1, False))),
        (DELAY, 0, Fate(1, Outcome.NO_LINK)),
    ]


def test_news_for_a_device_that_goes_off_at_the_same_instant_are_lost(room: Room):
    room.channel.command(0, Page(1))
    room.channel.power(1, False)
    assert [entry[1:] for entry in room.run()] == [(0, Connected(1, Role.MASTER)), (0, Lost(1)), (2, Lost(1))]
