"""LE devices as a channel: what hosts ask for, and what comes of it, when."""

from itertools import pairwise, product
from math import floor

import pytest

from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M, T_IFS
from cosim.channels.ble.scanning import ScanWindows
from cosim.machine import (
    BROADCAST,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Page,
    PageFailed,
    Park,
    Reception,
    Role,
    RoleChanged,
    Scan,
    SwitchRole,
)
from cosim.trace import FRAMES, PAYLOADS, TRANSMISSIONS
from cosim.units import MS, US, S
from tests.channels.ble.ble_field import Field, found

PHYS = {"1M": LE_1M, "2M": LE_2M, "coded": CODED_S8}


# ---------------------------------------------------------------- finding and connecting


def first_heard(field: Field, scanner: int, advertiser: int, since: int) -> int:
    """Return when the scanner hears the advertiser first, packet by packet; nothing else is on the air."""
    beacon, windows = field.channel.devices[advertiser].station.beacon, scan_windows(field, scanner)
    assert beacon.advertiser is not None
    for event in beacon.advertiser.events_from(0):
        for turn, channel in enumerate(beacon.advertiser.channels):
            start = beacon.advertiser.start(event, turn)
            end = start + beacon.advertiser.air_time
            on = {windows.channel(at) for at in range(start, end, 1_000)} | {windows.channel(end - 1)}
            if start >= since and on == {channel}:
                return end
    raise AssertionError("events have no end")


def scan_windows(field: Field, address: int) -> ScanWindows:
    return field.channel.devices[address]._scan


@pytest.mark.parametrize("seed", range(20))
def test_an_inquiry_finds_who_advertises_with_the_first_packet_that_lies_in_a_window(seed: int) -> None:
    field = Field(2, seed, scan={"interval_s": 0.06, "window_s": 0.01}, listen={"interval_s": 0.06, "window_s": 0.01})
    field.do(0, Scan(False))
    field.until(123_456_789)
    due = first_heard(field, 0, 1, field.kernel.now)
    field.do(0, Inquire(20 * S, 1))
    field.until(30 * S)
    assert [(each.time, each.what) for each in field.news] == [(due, Discovered(1)), (due, InquiryComplete((1,)))]


def test_an_inquiry_ends_after_its_duration_and_finds_nobody_twice() -> None:
    field = Field(5)
    field.channel.power(3, False)
    found(field, 0)
    assert sorted(each.what.peer for each in field.of(0, Discovered)) == [1, 2, 4]
    complete = field.of(0, InquiryComplete)
    assert [each.time for each in complete] == [2 * S]
    assert sorted(complete[0].what.found) == [1, 2, 4]


def test_who_does_not_want_to_be_found_is_not() -> None:
    field = Field(3)
    field.do(1, Scan(False))
    found(field, 0)
    assert field.of(0, InquiryComplete)[0].what.found == (2,)
    field.do(1, Scan(True))
    found(field, 0)
    assert sorted(field.of(0, InquiryComplete)[1].what.found) == [1, 2]


def test_a_page_makes_a_link_with_both_ends_told_at_once() -> None:
    field = Field(2)
    field.do(0, Page(1))
    field.until(1 * S)
    (central,), (peripheral,) = field.of(0, Connected), field.of(1, Connected)
    assert (central.what.peer, central.what.role) == (1, Role.MASTER)
    assert (peripheral.what.peer, peripheral.what.role) == (0, Role.SLAVE)
    assert central.time == peripheral.time
    assert central.what.hop_address == peripheral.what.hop_address != 0


@pytest.mark.parametrize("peer", [-3, 0, 2])
def test_a_page_of_nobody_fails_at_once(peer: int) -> None:
    field = Field(2)
    field.do(0, Page(peer))
    field.until(1 * MS)
    assert [each.what for each in field.of(0, PageFailed)] == [PageFailed(peer)]


def test_a_page_of_who_is_not_there_fails_after_its_time() -> None:
    field = Field(2, page_s=1.5)
    field.channel.power(1, False)
    field.do(0, Page(1))
    field.until(5 * S)
    assert [(each.time, each.what) for each in field.news] == [(1_500 * MS, PageFailed(1))]


def test_no_more_links_than_parts_of_the_interval() -> None:
    field = Field(4, connection={"links": 2})
    field.do(0, Page(1), Page(2), Page(3))
    field.until(10 * S)
    assert [each.what.peer for each in field.of(0, Connected)] == [1, 2]
    assert [each.what.peer for each in field.of(0, PageFailed)] == [3]


def test_a_device_is_central_and_peripheral_at_once() -> None:
    field = Field(3)
    field.link(0, 1)
    field.link(1, 2)
    field.send(2, 1, b"up", 1)
    field.send(1, 0, b"further", 2)
    field.send(0, 1, b"down", 3)
    field.until(field.kernel.now + 1 * S)
    assert (field.arrived(0), sorted(field.arrived(1))) == ([b"further"], [b"down", b"up"])


def test_two_that_page_each_other_have_one_link() -> None:
    for seed in range(10):
        field = Field(2, seed)
        field.do(0, Page(1))
        field.do(1, Page(0))
        field.until(10 * S)
        told = [each.what for each in field.news if isinstance(each.what, Connected | PageFailed)]
        assert sorted(type(each).__name__ for each in told) == ["Connected", "Connected", "PageFailed"], seed
        assert len(field.channel.devices[0].links) == len(field.channel.devices[1].links) == 1


# ---------------------------------------------------------------- payloads over links


@pytest.mark.parametrize(
    ("phy", "octets", "interval_ms"),
    [
        case
        for case in product(PHYS, (27, 251), (7.5, 30.0, 400.0))
        if case not in (("coded", 251, 7.5), ("coded", 251, 30.0))  # a packet each way takes longer
    ],
)
def test_a_saturated_link_carries_whole_exchanges_only(phy: str, octets: int, interval_ms: float) -> None:
    settings = {"links": 1, "octets": octets, "phy": phy, "interval_s": interval_ms / 1000}
    field = Field(2, connection=settings, interference="none")
    field.do(1, Scan(True))
    field.link(0, 1)
    field.until(field.kernel.now + 15 * S)  # lengths and PHY are agreed on
    exchange = PHYS[phy].air_time(octets) + PHYS[phy].air_time(0) + 2 * T_IFS
    exchanges, events = floor(interval_ms * MS / exchange), 2 if interval_ms > 100 else 10
    began = field.kernel.now
    for token in range(events * exchanges):  # each is one packet
        field.send(0, 1, bytes(octets - 7), token)
    field.until(began + (events + 2) * round(interval_ms * MS))
    fates = [each.time for each in field.of(0, Fate)]
    assert len(fates) == len(field.arrived(1)) == events * exchanges
    for turn in range(events):  # an event begins anew after each lot
        lot = fates[turn * exchanges : (turn + 1) * exchanges]
        assert max(lot) - min(lot) == (exchanges - 1) * exchange
    starts = [fates[turn * exchanges] for turn in range(events)]
    assert all(abs(later - earlier - interval_ms * MS) < 20 * US for earlier, later in pairwise(starts))


def test_payloads_of_any_length_arrive_once_and_in_order() -> None:
    field = Field(2)
    field.link(0, 1)
    payloads = [bytes([length % 251]) * length for length in (0, 1, 20, 244, 245, 1000, 65_532, 3)]
    for token, payload in enumerate(payloads):
        field.send(0, 1, payload, token)
    field.until(field.kernel.now + 60 * S)
    assert field.arrived(1) == payloads
    assert [each.what for each in field.of(0, Fate)] == [Fate(token, Outcome.DELIVERED) for token in range(8)]


@pytest.mark.parametrize("links", [3, 8, 12, 20, 24])
def test_nobody_is_silenced_where_both_ends_of_all_links_have_much_to_say(links: int) -> None:
    """The part of a link is just long enough for a packet each way, however many parts there are."""
    field = Field(4, connection={"links": links})
    field.link(0, 1, 2, 3)
    for _ in range(8):
        for peer in (1, 2, 3):
            field.send(0, peer, bytes(200))
            field.send(peer, 0, bytes(200))
    field.until(field.kernel.now + 10 * S)
    assert [len(field.arrived(address)) for address in range(4)] == [24, 8, 8, 8]


def test_what_cannot_be_sent_has_its_fate_at_once_and_is_counted() -> None:
    field = Field(3, connection={"mtu_octets": 100}, queue_payloads=2)
    field.link(0, 1)
    field.send(0, 2, b"no link", 1)
    field.send(0, 1, bytes(97), 2)
    field.send(0, 1, bytes(98), 3)
    field.send(0, 1, b"second", 4)
    field.send(0, 1, b"third", 5)
    field.send(0, BROADCAST, bytes(LONGEST_BROADCAST + 1), 6)
    field.until(field.kernel.now + 1 * S)
    fates = {each.what.token: each.what.outcome.value for each in field.of(0, Fate)}
    assert fates == {1: "no_link", 2: "delivered", 3: "too_long", 4: "delivered", 5: "queue_full", 6: "too_long"}
    assert sum(field.channel.unsent.values()) == 4


def test_a_flush_takes_out_what_has_not_been_on_the_air() -> None:
    field = Field(2)
    field.link(0, 1)
    for token in range(3):
        field.send(0, 1, bytes([token]) * 10_000, token)
    field.until(field.kernel.now + 40 * MS)  # the first is on its way
    field.do(0, Flush(1))
    field.send(0, 1, b"after", 3)
    field.until(field.kernel.now + 10 * S)
    fates = {each.what.token: each.what.outcome.value for each in field.of(0, Fate)}
    assert fates == {0: "delivered", 1: "flushed", 2: "flushed", 3: "delivered"}
    assert field.arrived(1) == [bytes(10_000), b"after"]


# ---------------------------------------------------------------- the end of links


def test_a_disconnect_is_heard_of_at_the_other_end() -> None:
    field = Field(2)
    field.link(0, 1)
    began = field.kernel.now
    field.do(1, Disconnect(0))
    field.until(began + 1 * S)
    (one,), (other,) = field.of(0, Lost), field.of(1, Lost)
    assert (one.what, other.what) == (Lost(1), Lost(0))
    assert max(one.time, other.time) < began + 100 * MS
    field.send(0, 1, b"too late", 1)
    field.until(field.kernel.now + 1 * S)
    assert field.of(0, Fate)[0].what.outcome is Outcome.NO_LINK
    field.link(0, 1)  # and they connect again
    field.send(0, 1, b"again", 2)
    field.until(field.kernel.now + 1 * S)
    assert field.arrived(1) == [b"again"]


@pytest.mark.parametrize("dead", [0, 1])
def test_who_is_switched_off_is_lost_after_the_supervision_timeout(dead: int) -> None:
    field = Field(2, connection={"supervision_s": 2.0})
    field.link(0, 1)
    off = field.kernel.now
    field.channel.power(dead, False)
    field.send(1 - dead, dead, b"in vain", 1)
    field.until(off + 20 * S)
    (lost,) = field.of(1 - dead, Lost)
    assert off + 2 * S - 31 * MS < lost.time <= off + 2 * S
    assert [each.what for each in field.of(1 - dead, Fate)] == [Fate(1, Outcome.FLUSHED)]
    assert field.of(dead, Lost) == []
    field.channel.power(dead, True)
    field.link(0, 1)


def test_a_link_out_of_range_is_lost_at_both_ends_and_one_that_returns_in_time_is_not() -> None:
    field = Field(2, range_m=10, connection={"supervision_s": 2.0})
    field.move([(0, 0), (5, 0)])
    field.link(0, 1)
    away = field.kernel.now
    field.move([(0, 0), (15, 0)])
    field.until(away + 1_900 * MS)
    field.send(0, 1, b"kept", 1)
    field.move([(0, 0), (5, 0)])
    field.until(away + 10 * S)
    assert field.arrived(1) == [b"kept"]
    assert field.of(0, Lost) == field.of(1, Lost) == []
    away = field.kernel.now
    field.move([(0, 0), (15, 0)])
    field.until(away + 10 * S)
    for end in (0, 1):
        (lost,) = field.of(end, Lost)
        assert away + 2 * S - 31 * MS < lost.time <= away + 2 * S


# ---------------------------------------------------------------- payloads for everyone


def test_a_broadcast_reaches_each_once_and_is_sent_as_often_as_asked_for() -> None:
    field = Field(7, tables=(TRANSMISSIONS, PAYLOADS), broadcast={"events": 4})
    field.link(0, 1, 2)
    began, payload = field.kernel.now, bytes(range(256)) * 4
    field.send(3, BROADCAST, payload, 1)
    field.until(began + 1 * S)
    assert all(field.arrived(other) == [payload] for other in (0, 1, 2, 4, 5, 6))
    assert {each.what[1] for each in field.news if isinstance(each.what, tuple)} == {Reception(3, True)}
    assert [each.what for each in field.of(3, Fate)] == [Fate(1, Outcome.SENT)]
    kinds = field.trace.columns(TRANSMISSIONS.name)["kind"]
    assert (kinds.count("ADV_EXT_IND"), kinds.count("AUX_ADV_IND"), kinds.count("AUX_CHAIN_IND")) == (12, 4, 16)
    begun = field.trace.columns(PAYLOADS.name)["begun_ns"]
    assert began <= begun[0] <= began + 12 * MS


def test_the_longest_broadcast_arrives() -> None:
    field = Field(2)
    field.send(0, BROADCAST, bytes(LONGEST_BROADCAST))
    field.send(1, BROADCAST, b"")
    field.until(1 * S)
    assert field.arrived(1) == [bytes(LONGEST_BROADCAST)]
    assert field.arrived(0) == [b""]


def test_who_listens_seldom_hears_as_seldom() -> None:
    """One event of three packets within 1 ms meets a window of the interval's hundredth, on one of its channels."""
    field = Field(
        2, listen={"interval_s": 0.5, "window_s": 0.005}, broadcast={"events": 1}, advertise={"interval_s": 10}
    )
    count = 2_000
    for turn in range(count):
        field.send(0, BROADCAST, turn.to_bytes(2, "little"))
        field.until(field.kernel.now + 73_077_301)
    heard = len(field.arrived(1))
    share = (5_000 - 136) / 500_000  # all of the packet lies in the window
    assert abs(heard - count * share) < 4 * (count * share) ** 0.5


# ---------------------------------------------------------------- the rest


def test_what_links_cannot_do_is_answered() -> None:
    field = Field(3)
    field.link(0, 1)
    field.do(0, Park(1), Park(2), SwitchRole(1), SwitchRole(2))
    field.until(field.kernel.now + 1)
    answers = [each.what for each in field.news if isinstance(each.what, ModeChanged | RoleChanged)]
    none = ModeChanged(2, Mode.NONE)
    assert answers == [ModeChanged(1, Mode.ACTIVE), none, RoleChanged(1, Role.MASTER), none]


def test_packets_follow_each_other_after_the_interframe_space() -> None:
    field = Field(2, tables=(FRAMES,), idle_frames=True)
    field.link(0, 1)
    columns = field.trace.columns(FRAMES.name)
    ends = [t + d for t, d in zip(columns["time_ns"], columns["duration_ns"], strict=True)]
    polls = [i for i, kind in enumerate(columns["kind"]) if kind in ("EMPTY", "CONTROL") and columns["source"][i] == 0]
    assert len(polls) > 50
    assert all(columns["source"][i + 1] == 1 and columns["time_ns"][i + 1] - ends[i] == T_IFS for i in polls[:-1])
    starts = [columns["time_ns"][i] for i in polls]
    drift = field.channel.devices[0].clock.ppm
    apart = {later - earlier for earlier, later in pairwise(starts[10:])}
    assert apart
    assert all(abs(each - 30 * MS) <= 30 * abs(drift) + 1 for each in apart)


def test_a_payload_waits_for_the_next_event_of_its_link() -> None:
    field = Field(2)
    field.link(0, 1)
    waits = []
    for turn in range(50):
        began = field.kernel.now
        field.send(0, 1, b"x")
        field.until(began + 200 * MS + turn * 617 * US)
        waits.append(field.of(1, tuple)[-1].time - began)
    assert 0 < min(waits) < 3 * MS
    assert 27 * MS < max(waits) <= 30 * MS + LE_1M.air_time(8)


def test_reception_says_how_strong_it_was_where_signals_fade() -> None:
    field = Field(2, propagation={"model": "free_space"})
    field.move([(0, 0), (10, 0)])
    field.link(0, 1)
    field.send(0, 1, b"x")
    field.send(0, BROADCAST, b"y")
    field.until(field.kernel.now + 1 * S)
    receptions = [each.what[1] for each in field.of(1, tuple)]
    assert sorted(receptions) == sorted(
        Reception(0, broadcast, pytest.approx(-60.2, abs=1e-9)) for broadcast in (False, True)
    )
