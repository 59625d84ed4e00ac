"""The ad hoc network as a channel: who gets what when, what senders are told, devices that go off."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address, Fate, LinkEvent, Outcome, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, Trace
from cosim.units import MS, US, S, Time


class Host:
    def __init__(self) -> None:
        self.received_: list[tuple[Time, Address, bytes, bool]] = []
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.received_.append((now, reception.source, data, reception.broadcast))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots on a plane, their hosts, and a channel between them."""

    def __init__(self, *places_m: tuple[float, float], **settings: Any) -> None:
        self.kernel = Kernel()
        self.trace = Trace((FRAMES,))
        size = len(places_m)
        self.channel = AdhocChannel(AdhocSettings(**settings), self.kernel, self.trace, size, Streams(1))
        self.hosts = [Host() for _ in places_m]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places_m))

    def send_at(self, time: Time, source: Address, destination: Address, length: int = 100, token: int = 7) -> None:
        outgoing = Outgoing(destination, bytes(length), token)
        self.kernel.at(time, lambda: self.channel.send(source, outgoing), WORLD)

    def rows(self) -> list[tuple[Any, ...]]:
        columns = self.trace.columns("frames")
        names = ("time_ns", "source", "destination", "kind", "outcome")
        return list(zip(*(columns[name] for name in names), strict=True))


def test_a_payload_is_there_after_difs_and_its_air_time_and_acknowledged_sifs_later() -> None:
    field = Field((0, 0), (5, 0), (0, 5))
    field.send_at(1 * MS, 0, 1)
    field.kernel.run(S)
    # 802.11b, 1 Mb/s: the medium has been idle for long; preamble 192 us, 136 octets, 1 us on the way
    arrival = 1 * MS + (192 + 8 * 136 + 1) * US
    assert field.hosts[1].received_ == [(arrival, 0, bytes(100), False)]
    assert field.hosts[0].events == [Fate(7, Outcome.DELIVERED)]
    assert field.hosts[2].received_ == []
    ack = arrival + 10 * US
    assert field.rows() == [(1 * MS, 0, 1, "DATA", "received"), (ack, 1, 0, "ACK", "received")]


def test_nobody_sends_before_difs() -> None:
    field = Field((0, 0), (5, 0))
    field.send_at(0, 0, 1)
    field.kernel.run(S)
    assert field.rows()[0][0] == 50 * US


def test_a_broadcast_reaches_all_in_range_once_and_is_not_acknowledged() -> None:
    field = Field((0, 0), (5, 0), (0, 5), (100, 0), range_m=20.0)
    field.send_at(1 * MS, 0, BROADCAST)
    field.kernel.run(S)
    assert [len(host.received_) for host in field.hosts] == [0, 1, 1, 0]
    assert field.hosts[1].received_[0][3] is True
    assert field.hosts[0].events == [Fate(7, Outcome.SENT)]
    assert [row[3] for row in field.rows()] == ["DATA", "DATA"]


def test_who_does_not_answer_is_tried_seven_times_then_given_up() -> None:
    field = Field((0, 0), (100, 0), range_m=20.0)
    field.send_at(1 * MS, 0, 1)
    field.kernel.run(S)
    assert field.hosts[0].events == [Fate(7, Outcome.UNACKNOWLEDGED)]
    assert field.channel.summary() == {"frames_sent": 7.0, "payloads_dropped": 1.0}


def test_terminals_that_do_not_hear_each_other_collide_at_a_third_unless_they_ask_before() -> None:
    arrived, collided = {}, {}
    for threshold in (None, 0):
        field = Field((0, 0), (15, 0), (30, 0), range_m=20.0, rts_threshold=threshold)
        for number in range(20):
            field.send_at(number * 100 * MS + 1 * MS, 0, 1, 1500)
            field.send_at(number * 100 * MS + 3 * MS, 2, 1, 1500)
        field.kernel.run(3 * S)
        arrived[threshold] = len(field.hosts[1].received_)
        collided[threshold] = [row[3] for row in field.rows() if row[4] == "collided"]
    assert arrived[None] < 20
    assert arrived[0] == 40
    assert collided[None].count("DATA") >= 40
    assert "DATA" not in collided[0]


def test_a_full_queue_is_told_at_once() -> None:
    field = Field((0, 0), (5, 0), queue_payloads=2)
    for token in range(4):
        field.send_at(1 * MS, 0, 1, token=token)
    field.kernel.run(S)
    assert sorted(field.hosts[0].events, key=str) == sorted(
        [
            Fate(2, Outcome.QUEUE_FULL),
            Fate(3, Outcome.QUEUE_FULL),
            Fate(0, Outcome.DELIVERED),
            Fate(1, Outcome.DELIVERED),
        ],
        key=str,
    )


def test_hosts_that_act_at_one_instant_collide_unless_they_take_their_time() -> None:
    heard = []
    for jitter_s in (0.0, 0.05):
        field = Field((0, 0), (5, 0), (0, 5), host_jitter_s=jitter_s)
        for number in range(20):
            for source in (0, 1):
                field.send_at((1 + 100 * number) * MS, source, BROADCAST)
        field.kernel.run(3 * S)
        heard.append(len(field.hosts[2].received_))
        assert all(time < (60 + 100 * (at // 2)) * MS for at, (time, *_) in enumerate(field.hosts[2].received_))
    assert heard[0] == 0
    assert 30 <= heard[1] <= 40


def test_what_a_host_has_handed_over_keeps_its_order_and_is_lost_with_the_device() -> None:
    field = Field((0, 0), (5, 0), host_jitter_s=0.05)
    for length in range(1, 9):
        field.send_at(1 * MS, 0, BROADCAST, length)
        field.send_at(200 * MS, 0, BROADCAST, 50 + length)
    field.kernel.at(201 * MS, lambda: field.channel.power(0, False))
    field.kernel.at(202 * MS, lambda: field.channel.power(0, True))
    field.kernel.run(S)
    lengths = [len(data) for _, _, data, _ in field.hosts[1].received_]
    assert lengths[:8] == list(range(1, 9))
    assert len(lengths) < 16


def test_payloads_of_one_sender_keep_their_order_broadcast_or_not() -> None:
    field = Field((0, 0), (5, 0))
    for length in range(1, 9):
        field.send_at(1 * MS, 0, BROADCAST if length % 2 else 1, length)
    field.kernel.run(S)
    assert [len(data) for _, _, data, _ in field.hosts[1].received_] == list(range(1, 9))


@pytest.mark.parametrize("on_again", [1_600 * US, 900 * MS])
def test_what_a_device_holds_and_sends_is_lost_when_it_goes_off(on_again: Time) -> None:
    field = Field((0, 0), (5, 0))
    for token in range(3):
        field.send_at(1 * MS, 0, 1, token=token)
    field.kernel.at(1_500 * US, lambda: field.channel.power(0, False))  # in the midst of the first frame
    field.kernel.at(on_again, lambda: field.channel.power(0, True))
    field.send_at(950 * MS, 0, 1, 33, token=9)
    field.kernel.run(S)
    assert [len(data) for _, _, data, _ in field.hosts[1].received_] == [33]
    assert field.hosts[0].events == [Fate(9, Outcome.DELIVERED)]


@pytest.mark.parametrize("off", [2_350 * US, 2_500 * US, 2_650 * US, 2_700 * US])
@pytest.mark.parametrize("rest", [10 * US, 100 * MS])
def test_a_device_that_is_on_again_begins_anew_whatever_it_was_about(off: Time, rest: Time) -> None:
    """While an ACK is awaited that nobody sends, and in back-off: it finds the medium idle."""
    field = Field((0, 0), (5, 0), (0, 5))
    field.channel.power(2, False)
    field.send_at(1 * MS, 0, 2)
    field.kernel.at(off, lambda: field.channel.power(0, False))
    field.kernel.at(off + rest, lambda: field.channel.power(0, True))
    begun = off + rest + 100 * US
    field.send_at(begun, 0, BROADCAST, 33)
    field.send_at(begun + 20 * MS, 1, 0, 20)
    field.send_at(begun + 40 * MS, 0, BROADCAST, 33)
    field.kernel.run(S)
    data = (192 + 8 * 56 + 1) * US  # with the preamble, and on the way
    assert [(time, source, kind, outcome) for time, source, _, kind, outcome in field.rows() if time > off] == [
        (begun, 0, "DATA", "received"),
        (begun + 20 * MS, 1, "DATA", "received"),
        (begun + 20 * MS + data + 10 * US, 0, "ACK", "received"),
        (begun + 40 * MS, 0, "DATA", "received"),
    ]


def test_a_device_that_is_on_again_backs_off_as_one_that_has_not_failed() -> None:
    """After failures its window had grown; the next payload, which finds the medium busy, waits 31 slots at most."""
    slots = []
    for off in range(20):
        field = Field((0, 0), (5, 0), (100, 0), range_m=20.0)
        field.send_at(1 * MS, 0, 2)  # nobody answers
        field.kernel.at(12 * MS + off * 500 * US, partial(field.channel.power, 0, False))
        field.kernel.at(180 * MS, partial(field.channel.power, 0, True))
        field.send_at(200 * MS, 1, BROADCAST)
        field.send_at(200 * MS + 500 * US, 0, BROADCAST)
        field.kernel.run(S)
        idle = 200 * MS + (192 + 8 * 136 + 1) * US + 50 * US
        slots += [divmod(time - idle, 20 * US) for time, source, *_ in field.rows() if source == 0 and time > 180 * MS]
    assert len(slots) == 20
    assert all(rest == 0 and 0 <= count <= 31 for count, rest in slots)


@pytest.mark.parametrize("propagation", [None, {"model": "free_space"}])
def test_a_device_that_is_on_again_does_not_receive_what_it_has_begun_to_and_what_comes_then_it_does(
    propagation: Any,
) -> None:
    field = Field((0, 0), (5, 0), propagation=propagation)
    field.send_at(1 * MS, 1, BROADCAST, 100)  # arrives until 2.281 ms
    field.kernel.at(1_500 * US, lambda: field.channel.power(0, False))
    field.kernel.at(1_600 * US, lambda: field.channel.power(0, True))
    field.send_at(10 * MS, 1, BROADCAST, 33)
    field.kernel.run(S)
    assert [len(data) for _, _, data, _ in field.hosts[0].received_] == [33]


def test_a_device_that_is_on_again_knows_of_no_reservation() -> None:
    """It has heard the CTS to one that it does not hear itself."""
    for off in (False, True):
        field = Field((30, 0), (15, 0), (0, 0), range_m=20.0, rts_threshold=500)
        field.send_at(1 * MS, 2, 1, 1500)
        if off:
            field.kernel.at(2 * MS, partial(field.channel.power, 0, False))
            field.kernel.at(3 * MS, partial(field.channel.power, 0, True))
        field.send_at(4 * MS, 0, BROADCAST)
        field.kernel.run(S)
        (begun,) = [time for time, source, *_ in field.rows() if source == 0]
        assert (begun == 4 * MS) is off, "the data take until 14 ms"


def test_a_device_listens_for_difs_once_it_is_on() -> None:
    field = Field((0, 0), (5, 0))
    field.channel.power(0, False)
    field.kernel.at(10 * MS, lambda: field.channel.power(0, True))
    field.send_at(10 * MS + 10 * US, 0, BROADCAST)
    field.kernel.run(S)
    assert [time for time, *_ in field.rows()] == [10 * MS + 50 * US]


def test_a_device_that_is_off_neither_hears_nor_answers() -> None:
    field = Field((0, 0), (5, 0), (0, 5))
    field.channel.power(1, False)
    field.send_at(1 * MS, 0, 1)
    field.send_at(500 * MS, 0, BROADCAST)
    field.kernel.run(S)
    assert field.hosts[1].received_ == []
    assert Fate(7, Outcome.UNACKNOWLEDGED) in field.hosts[0].events
    assert len(field.hosts[2].received_) == 1
    assert field.channel.in_reach(0) == (2,)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rate_mbps": 3}, "rate_mbps\n  is not one of 1, 2, 5.5, 11 .*=3.0"),
        (
            {"phy": "erp", "basic_rates_mbps": (1,)},
            "basic_rates_mbps\n  is not one of 6, 9, 12, 18, 24, 36, 48, 54 .*=1.0",
        ),
        ({"cw_min": 63, "cw_max": 31}, "cw_max\n  is not >= 63, cw_min"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        AdhocSettings(**settings)
