"""What can be wrong with the ideal channel on request: a range, payloads that are lost, delays that vary."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.errors import LocalProtocolError
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
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
)
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time

DELAY = 10 * US
SURE = 1e-4
"""Probability of a deviation that is none of chance's."""


class Host:
    """An endpoint that notes what comes in."""

    def __init__(self, address: Address, log: list[tuple[Time, Address, Any]]) -> None:
        self.address = address
        self.log = log

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.log.append((now, self.address, (int.from_bytes(data), reception.source)))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.log.append((now, self.address, event))

    def drain(self, now: Time) -> None:
        pass


class Room:
    """An ideal channel with flaws and its hosts, in a row a metre from each other."""

    def __init__(self, size: int = 3, seed: int = 1, **flaws: float) -> None:
        self.kernel = Kernel()
        self.trace = Trace([FRAMES])
        settings = IdealSettings.model_validate({"delay_s": DELAY / S} | flaws)
        self.channel = IdealChannel(settings, self.kernel, self.trace, size, Streams(seed))
        self.log: list[tuple[Time, Address, Any]] = []
        for address in range(size):
            self.channel.attach(address, Host(address, self.log))
        self.place(*range(size))

    def place(self, *x_m: float) -> None:
        self.channel.moved(np.array([(x, 0.0) for x in x_m]))

    def say(self, number: int, source: Address = 0, destination: Address = BROADCAST, token: int | None = None) -> None:
        self.channel.send(source, Outgoing(destination, number.to_bytes(4), token))

    def run(self, until: Time = S) -> list[tuple[Time, Address, Any]]:
        self.kernel.run(until)
        return self.log

    def heard(self, by: Address, source: Address = 0) -> list[int]:
        """Return the numbers of what has arrived, in order."""
        items = [what for _, address, what in self.log if address == by and isinstance(what, tuple)]
        return [number for number, whose in items if whose == source]


def assert_share(count: int, total: int, probability: float) -> None:
    assert stats.binomtest(count, total, probability).pvalue > SURE


# ---------------------------------------------------------------- a range


def test_a_broadcast_reaches_those_within_the_range_and_those_at_its_end():
    room = Room(size=4, range_m=2.0)
    room.say(7, token=1)
    assert room.run() == [(DELAY, 1, (7, 0)), (DELAY, 2, (7, 0)), (DELAY, 0, Fate(1, Outcome.SENT))]


def test_there_is_no_link_to_who_is_out_of_range_and_one_to_who_comes():
    room = Room(range_m=1.5)
    room.say(1, destination=2, token=4)
    assert room.run(MS) == [(0, 0, Fate(4, Outcome.NO_LINK))]
    assert room.channel.summary() == {"frames_sent": 0.0}
    room.log.clear()
    room.place(1, 1, 2)
    room.say(2, destination=2, token=5)
    assert room.run() == [(MS + DELAY, 2, (2, 0)), (MS + DELAY, 0, Fate(5, Outcome.DELIVERED))]


def test_who_leaves_while_a_payload_is_under_way_does_not_get_it():
    room = Room(range_m=1.5)
    room.say(1, destination=1, token=4)
    room.kernel.at(DELAY // 2, lambda: room.place(0, 2, 1))
    assert room.run() == [(DELAY, 0, Fate(4, Outcome.NO_LINK))]


def test_reach_and_inquiry_end_at_the_range():
    room = Room(range_m=1.5)
    assert [room.channel.in_reach(address) for address in range(3)] == [(1,), (0, 2), (1,)]
    room.channel.command(0, Inquire(S, 7))
    assert [what for *_, what in room.run()] == [Discovered(1), InquiryComplete((1,))]
    room.place(0, 5, 1)
    assert [room.channel.in_reach(address) for address in range(3)] == [(2,), (), (0,)]


def test_a_link_ends_once_when_its_ends_part_and_the_others_stay():
    room = Room(range_m=1.5)
    room.channel.command(1, Page(0))
    room.channel.command(1, Page(2))
    room.run(MS)
    room.log.clear()
    for x_m in (3, 4):
        room.place(0, 1, x_m)
    assert room.run() == [(MS, 1, Lost(2)), (MS, 2, Lost(1))]
    room.log.clear()
    room.channel.command(1, Disconnect(0))
    room.channel.command(1, Disconnect(2))  # there is no such link
    assert [(address, what) for _, address, what in room.run(2 * S)] == [(1, Lost(0)), (0, Lost(1))]


def test_who_is_out_of_range_cannot_be_paged():
    room = Room(range_m=1.5)
    room.channel.command(0, Page(2))
    room.channel.command(0, Page(1))
    assert [(address, what) for _, address, what in room.run()] == [
        (0, PageFailed(2)),
        (0, Connected(1, Role.MASTER)),
        (1, Connected(0, Role.SLAVE)),
    ]


def test_only_those_in_range_lose_a_device_that_goes_off():
    room = Room(range_m=1.5)
    room.channel.power(0, False)
    assert room.run() == [(0, 1, Lost(0))]


def test_without_a_range_nobody_is_too_far():
    room = Room()
    room.place(0, 1e9, -1e9)
    assert room.channel.in_reach(0) == (1, 2)


# ---------------------------------------------------------------- losses


def test_as_many_payloads_are_lost_as_was_asked_for_each_receiver_by_itself():
    room, total, loss = Room(loss=0.2), 4_000, 0.2
    for number in range(total):
        room.kernel.at(number * US, lambda number=number: room.say(number))
    room.run()
    missed = [set(range(total)) - set(room.heard(by)) for by in (1, 2)]
    for lost in missed:
        assert_share(len(lost), total, loss)
    assert_share(len(missed[0] & missed[1]), total, loss * loss)
    after_one = sum(number + 1 in missed[0] for number in missed[0])
    assert_share(after_one, len(missed[0]), loss)  # nor does a loss make the next one likelier


def test_the_sender_learns_which_payloads_were_lost_when_they_would_have_arrived():
    room = Room(loss=0.5)
    for number in range(100):
        room.kernel.at(number * MS, lambda number=number: room.say(number, destination=1, token=number))
    room.run()
    fates = {what.token: (time, what.outcome) for time, address, what in room.log if address == 0}
    arrived = set(room.heard(1))
    assert 20 < len(arrived) < 80
    assert fates == {
        number: (number * MS + DELAY, Outcome.DELIVERED if number in arrived else Outcome.UNACKNOWLEDGED)
        for number in range(100)
    }


def test_a_broadcast_that_nobody_gets_was_sent():
    room = Room(loss=1.0)
    room.say(1, token=3)
    assert room.run() == [(DELAY, 0, Fate(3, Outcome.SENT))]
    assert room.channel.summary() == {"frames_sent": 1.0}


def test_what_one_robot_loses_does_not_depend_on_what_others_send():
    heard = []
    for others in (0, 3):
        room = Room(loss=0.5, jitter_s=1e-3)
        for number in range(200):
            for _ in range(others):
                room.say(number, source=1)
            room.say(number)
        room.run()
        heard.append(room.heard(2))
    assert heard[0] == heard[1]
    assert 60 < len(heard[0]) < 140


@pytest.mark.parametrize(("seed", "same"), [(1, True), (2, False)])
def test_losses_depend_on_the_seed_alone(seed: int, same: bool):
    rooms = [Room(seed=one, loss=0.5) for one in (1, seed)]
    for room in rooms:
        for number in range(100):
            room.say(number)
        room.run()
    assert (rooms[0].heard(1) == rooms[1].heard(1)) is same


# ---------------------------------------------------------------- delays that vary


def test_delays_are_exponential_beyond_the_fixed_one_and_independent():
    room, total = Room(jitter_s=0.02), 2_000
    for number in range(total):
        room.kernel.at(number * S, lambda number=number: room.say(number))
    room.run(2 * total * S)
    delays = [
        np.array([time - what[0] * S - DELAY for time, address, what in room.log if address == by]) for by in (1, 2)
    ]
    for found in delays:
        assert len(found) == total
        assert found.min() >= 0
        assert stats.kstest(found / (0.02 * S), "expon").pvalue > SURE
    assert abs(stats.spearmanr(*delays).statistic) < 4 / math.sqrt(total)


def test_what_is_lost_does_not_depend_on_how_late_it_would_have_been():
    room, total = Room(jitter_s=0.02, loss=0.5), 1_000
    for number in range(total):
        room.kernel.at(number * S, lambda number=number: room.say(number, destination=1))
    room.run(2 * total * S)
    delays = np.array([time - what[0] * S - DELAY for time, _, what in room.log])
    assert_share(len(delays), total, 0.5)
    assert stats.kstest(delays / (0.02 * S), "expon").pvalue > SURE


def test_payloads_overtake_each_other_with_jitter_only():
    orders = []
    for jitter_s in (0.0, 0.02):
        room = Room(jitter_s=jitter_s)
        for number in range(50):
            room.kernel.at(number * MS, lambda room=room, number=number: room.say(number, destination=1))
        room.run()
        orders.append(room.heard(1))
    assert orders[0] == list(range(50)) == sorted(orders[1])
    assert orders[1] != orders[0]


def test_fates_come_with_the_payload_to_one_and_after_the_fixed_delay_for_all():
    room = Room(jitter_s=0.02)
    room.say(1, destination=1, token=1)
    room.say(2, token=2)
    room.run()
    fates = {what.token: (time, what.outcome) for time, _, what in room.log if isinstance(what, Fate)}
    arrivals = {what[0]: time for time, address, what in room.log if address == 1 and not isinstance(what, Fate)}
    assert fates == {1: (arrivals[1], Outcome.DELIVERED), 2: (DELAY, Outcome.SENT)}
    assert arrivals[1] > DELAY


# ---------------------------------------------------------------- the rest


@pytest.mark.parametrize("flaws", [{"loss": 0.1}, {"jitter_s": 0.1}])
def test_chance_needs_streams(flaws: dict[str, float]):
    with pytest.raises(LocalProtocolError, match="needs the streams"):
        IdealChannel(IdealSettings.model_validate(flaws), Kernel(), Trace(), 2)


def test_frames_are_traced_for_each_receiver_when_not_all_need_get_the_same():
    room = Room(size=4, range_m=2.5, loss=0.5)
    for number in range(20):
        room.kernel.at(number * MS, lambda number=number: room.say(number))
    room.run()
    columns = room.trace.columns("frames")
    rows = list(zip(columns["time_ns"], columns["destination"], columns["outcome"], strict=True))
    expected = [
        (number * MS, by, "out_of_range" if by == 3 else "received" if number in room.heard(by) else "lost")
        for number in range(20)
        for by in (1, 2, 3)
    ]
    assert rows == expected
    assert {outcome for *_, outcome in rows} == {"out_of_range", "received", "lost"}
    assert set(columns["duration_ns"]) == {DELAY}


def test_a_range_alone_has_the_frames_traced_for_each_receiver_too():
    room = Room(range_m=1.5)
    room.say(1)
    room.run()
    columns = room.trace.columns("frames")
    assert list(zip(columns["destination"], columns["outcome"], strict=True)) == [(1, "received"), (2, "out_of_range")]


def test_the_frame_of_a_payload_that_is_late_lasts_until_it_arrives():
    room = Room(jitter_s=0.02)
    room.say(1)
    room.run()
    columns = room.trace.columns("frames")
    arrivals = {address: time for time, address, _ in room.log}
    assert dict(zip(columns["destination"], columns["duration_ns"], strict=True)) == arrivals
