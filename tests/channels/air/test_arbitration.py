"""Arbitration between a robot's own radios: what is on the air, told anew from the tables of a run and what was told.

Low Energy puts advertising on the air that is in no table: what it tells the air is written down as it is told.
Bluetooth classic has a file of its own.
"""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import cosim.channels.ble.device as device
import cosim.channels.ble.session as session
import cosim.channels.radios as radios
from cosim.channels.air.arbitration import PRIORITIES, Arbitration, Rank
from cosim.channels.ble.connections.channel_map import ChannelMap
from cosim.channels.ble.phy import T_IFS
from cosim.channels.kinds import channel_spec
from cosim.channels.radios import RadiosSettings
from cosim.intervals import Intervals
from cosim.kernel import DELIVER
from cosim.machine import BROADCAST, Connected, Disconnect, Fate, Inquire, LinkEvent, Lost, Outgoing, Page, Scan
from cosim.trace import INTERVALS, Trace
from cosim.units import MS, US, S
from tests.channels.air.arbitrated_field import DELAY, OTHER, WIFI, Field, across, at_once
from tests.channels.air.shared_field import FREE
from tests.checkout import ROOT

BLE = OTHER
SIFS = 10 * US
IN_BAND = ChannelMap(tuple(range(12, 20)))
"""Channels of Low Energy within 8 MHz of 802.11's channel 6."""


def busy(seed: int, size: int = 4, until: int = 4 * S, asks: int = 0, **settings: Any) -> Field:
    """Return a field, played *until* then, whose robots have much to say by both radios; some have one only.

    So many times somebody *asks* what is on the air.
    """
    random = np.random.default_rng((37, seed))
    places = random.uniform(0.0, 15.0, (size, 2)).tolist()
    carried = [(BLE, WIFI)] * (size - 2) + [(BLE,), (WIFI,)]
    ble = {"connection": {"interval_s": float(random.choice((0.0075, 0.03)))}, "advertise": {"interval_s": 0.03}}
    wifi = {"rate_mbps": float(random.choice((2, 5.5, 11))), "rts_threshold": 400}
    field = Field(places, carried, ble, wifi, seed=seed, **settings)
    field.link(0, *range(1, size - 1))
    field.at(2 * S, size - 2, Inquire(S, 2))
    carriers = {BLE: range(size - 1), WIFI: [*range(size - 2), size - 1]}
    for _ in range(500):
        at = int(random.integers(S // 2, until - S // 2))
        source, destination = random.choice(carriers[WIFI], 2, replace=False).tolist()
        to = BROADCAST if random.random() < 0.2 else destination
        for _ in range(int(random.integers(1, 4))):
            field.at(at, source, Outgoing(to, bytes(int(random.integers(1, 1500))), None, WIFI))
        source = int(random.choice(carriers[BLE]))
        to = int(random.integers(1, size - 1)) if source == 0 else 0
        to = BROADCAST if random.random() < 0.1 else to
        field.at(at + int(random.integers(MS)), source, Outgoing(to, bytes(int(random.integers(1, 400)))))
    for at in np.random.default_rng(5).integers(1, until, asks).tolist():
        field.kernel.at(at, lambda: field.air.band.settle(field.kernel.now), DELIVER)
    field.until(until)
    field.close()
    return field


# ---------------------------------------------------------------- one at a time


@pytest.mark.parametrize("seed", range(5))
def test_a_robots_radios_never_send_at_once(seed: int) -> None:
    field = busy(seed)
    sent = field.sent()
    assert {(each.robot, each.radio) for each in sent} >= {(robot, radio) for robot in (0, 1) for radio in (BLE, WIFI)}
    assert at_once(sent) == 0
    frames = [row for row in field.rows("transmissions") if row["radio"] == WIFI and row["kind"] in ("DATA", "RTS")]
    for row in frames:  # with the time that they reserve for what follows
        begin, end = row["time_ns"], row["time_ns"] + row["duration_ns"] + row["reserves_ns"]
        assert not any(begin < each.start < end for each in sent if (each.robot, each.radio) == (row["source"], BLE))
    assert sum(field.channel.summary()[f"radio_{radio}_refused"] for radio in (BLE, WIFI)) > 50


@pytest.mark.parametrize("seed", range(5))
def test_a_low_energy_radio_never_sends_two_packets_at_once(seed: int) -> None:
    """In seed 1 an advertiser's clock is 8 ns faster in an event than that of who asks to connect."""
    sent = [each for each in busy(seed).sent() if each.radio == BLE]
    assert len(sent) > 1000
    for robot in {each.robot for each in sent}:
        own = [each for each in sent if each.robot == robot]
        assert all(before.end <= after.start for before, after in pairwise(own))


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_received_across_what_the_robots_other_radio_sends(seed: int) -> None:
    """Even where isolation is perfect: whatever the arithmetic."""
    field = busy(seed, isolation_db=300.0)
    received = field.received()
    assert min(sum(each.radio == radio for each in received) for radio in (BLE, WIFI)) > 200
    assert across(received, field.sent()) == 0


@pytest.mark.parametrize("told", [False, True])
def test_a_station_is_deaf_to_what_begins_after_its_robots_other_radio(told: bool) -> None:
    """Nobody has said anything by 802.11 when the other radio begins; the air may have been *told* of that before."""
    field = Field([(0, 0), (3, 0)], [(BLE, WIFI), (WIFI,)], {"advertise": {"interval_s": 0.1}}, isolation_db=300.0)
    low_energy: Any = field.channel.parts[BLE]
    beacon = low_energy.devices[0].station.beacon
    advertised = [packet for packet in beacon.packets(S, 6 * S) if packet.channel == 37]
    for packet in advertised:
        if told:
            field.kernel.at(packet.start + 10 * US, lambda: field.air.band.settle(field.kernel.now))
        field.at(packet.start + 20 * US, 1, Outgoing(0, bytes(20), None, WIFI))
    field.until(7 * S)
    field.close()
    assert field.got(0, WIFI) == len(advertised) > 40
    first = [row for row in field.rows("receptions") if row["receiver"] == 0 and row["outcome"] != "received"]
    assert len(first) >= len(advertised)
    assert across(field.received(), field.sent()) == 0


def test_without_arbitration_both_happens() -> None:
    field = busy(1, isolation_db=300.0, arbitration=False)
    sent = field.sent()
    assert at_once(sent) > 100
    assert across(field.received(), sent) > 100
    assert not any(name.endswith("refused") for name in field.channel.summary())


@pytest.mark.parametrize("seed", range(3))
def test_refusals_are_in_the_trace(seed: int) -> None:
    field = busy(seed)
    until = field.kernel.now
    for radio in (BLE, WIFI):
        rows = field.deferred(radio)
        assert len(rows) == field.channel.summary()[f"radio_{radio}_refused"] > 10
        assert {row["detail"] for row in rows} == {f"radio={1 - radio}"}
        assert {row["robot"] for row in rows} == {0, 1}  # which have both
        assert all(row["start_ns"] < row["end_ns"] <= until for row in rows)
    frames = [row for row in field.rows("transmissions") if row["radio"] == WIFI and row["kind"] in ("DATA", "RTS")]
    for row in field.deferred(WIFI):
        own = [frame["time_ns"] for frame in frames if frame["source"] == row["robot"]]
        assert not any(row["start_ns"] <= at < row["end_ns"] for at in own), row


# ---------------------------------------------------------------- who goes first


def saturated(arbitration: bool, until: int = 6 * S) -> Field:
    """Return two robots with both radios, which meet on all channels, and much to say by both; isolation 0 dB.

    A frame of robot 0 takes 11.7 ms of the 15 ms from one event of its link, as the peripheral, to the next.
    """
    link = {"connection": {"interval_s": 0.015}}
    field = Field([(0, 0), (3, 0)], None, link, {"rate_mbps": 1}, isolation_db=0.0, arbitration=arbitration)
    field.link(1, 0)
    for number in range((until - S) // (15 * MS)):
        field.at(S + number * 15 * MS, 0, Outgoing(1, bytes(20)))
        field.at(S + number * 15 * MS, 1, Outgoing(0, bytes(20)))
    for number in range((until - S) // (12 * MS)):
        field.at(S + number * 12 * MS, 0, Outgoing(BROADCAST, bytes(1400), None, WIFI))
    field.until(until)
    field.close()
    return field


def test_both_starve_without_it_and_get_through_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "ALL_CHANNELS", IN_BAND)
    events = 5 * S // (15 * MS)
    without, field = saturated(False), saturated(True)
    assert max(without.got(1, WIFI), without.got(1, BLE), without.got(0, BLE)) < 0.5 * events
    assert min(field.got(1, WIFI), field.got(1, BLE), field.got(0, BLE)) > 0.9 * events
    assert at_once(field.sent()) == 0
    for robot in (0, 1):
        sent = [each for each in field.sent() if each.robot == robot]
        assert sum(each.end - each.start for each in sent) <= field.kernel.now


def idle_link(until: int = 8 * S) -> Field:
    """Return two robots whose link has nothing to carry, and must be heard of each 0.3 s, beside a saturated 802.11."""
    link = {"interval_s": 0.03, "supervision_s": 0.3}
    field = Field([(0, 0), (3, 0)], None, {"connection": link}, {"rate_mbps": 1})
    field.link(0, 1)
    for number in range((until - S) // (13 * MS)):
        field.at(S + number * 13 * MS, number % 2, Outgoing(1 - number % 2, bytes(1400), None, WIFI))
    field.until(until)
    field.close()
    return field


def events(field: Field, robot: int) -> list[type]:
    return [type(event) for _, event in field.hosts[robot].events if isinstance(event, Connected | Lost)]


def test_a_link_that_is_lost_soon_goes_first() -> None:
    field = idle_link()
    assert events(field, 0) == events(field, 1) == [Connected]
    assert len(field.deferred(BLE)) > 100


def test_a_link_that_never_goes_first_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "LAST_EVENTS", -1)
    assert Lost in events(idle_link(), 0)


def addressed(field: Field, robot: int) -> list[tuple[int, int]]:
    """Return from when to when frames of 802.11 for a *robot*, and its answers to them, are on the air.

    Those are left out of which it misses the beginning, as it sends itself.
    """
    deaf = [each for each in field.sent() if (each.robot, each.radio) == (robot, BLE)]
    rows = [row for row in field.rows("transmissions") if row["radio"] == WIFI]
    ack = next(row["duration_ns"] for row in rows if row["kind"] == "ACK")
    frames = [row for row in rows if row["kind"] == "DATA" and row["destination"] == robot]
    starts = [(row["time_ns"] + DELAY, row["duration_ns"]) for row in frames]
    heard = [each for each in starts if not any(own.start <= each[0] < own.end for own in deaf)]
    return [(start, start + duration + SIFS + ack) for start, duration in heard]


def beside(robots: tuple[int, int] | None, octets: int, wait: int, advertises: bool = False, **ble: Any) -> Field:
    """Return a field: 0 has Low Energy, 1 both radios, and 2 802.11, by which it says so much to 1, after each *wait*.

    The first of *robots*, if there are any, pages the second.
    """
    link = {"interval_s": 0.0075, "supervision_s": 8.0}
    ble = {"connection": link, "advertise": {"interval_s": 0.02}, **ble}
    field = Field([(0, 0), (3, 0), (0, 3)], [(BLE,), (BLE, WIFI), (WIFI,)], ble, {"rate_mbps": 2})
    if robots is not None:
        field.at(MS, robots[0], Page(robots[1]))
    if not advertises:
        field.at(2 * S - MS, 1, Scan(False))
    for number in range(4 * S // wait):
        field.at(2 * S + number * wait, 2, Outgoing(1, bytes(octets), None, WIFI))
    return field


@pytest.mark.parametrize("robots", [(0, 1), (1, 0)])
@pytest.mark.parametrize(("octets", "wait"), [(1000, 9_876_543), (20, 1_010_101)])
def test_an_empty_event_leaves_alone_what_802_11_receives_and_its_answer(
    robots: tuple[int, int], octets: int, wait: int
) -> None:
    field = beside(robots, octets, wait)
    field.until(6 * S)
    field.close()
    own = [each for each in field.sent() if each.radio == BLE and each.robot == 1]
    begins = np.array([each.start for each in own if each.start > 2 * S])
    if robots[0] == 0:  # what it sends answers a packet, in T_IFS
        begins -= 80 * US + T_IFS
    assert len(begins) > 100
    received = addressed(field, 1)
    assert len(received) > 0.9 * 4 * S / wait
    assert [span for span in received if np.any((begins > span[0]) & (begins < span[1]))] == []


def test_requests_leave_alone_what_802_11_receives() -> None:
    field = beside(None, 1000, 9_876_543, advertises=True, scan={"active": True})
    for number in range(13):
        at = 2 * S + number * 300 * MS
        field.at(at, 1, Inquire(100 * MS, 1))
        field.at(at + 100 * MS, 1, Page(0))
        field.at(at + 230 * MS, 1, Disconnect(0))
    field.until(6 * S)
    field.close()
    rows = [row for row in field.rows("transmissions") if row["radio"] == BLE and row["source"] == 1]
    for kind in ("SCAN_REQ", "CONNECT_IND"):
        asked = np.array([row["time_ns"] for row in rows if row["kind"] == kind]) - T_IFS
        assert len(asked) > 5
        assert [span for span in addressed(field, 1) if np.any((asked > span[0]) & (asked < span[1]))] == [], kind


def test_who_receives_by_802_11_does_not_follow_a_payload_for_everyone() -> None:
    """It does not advertise, and has no link: nothing else of it asks."""
    field = beside(None, 1000, 6_543_210)
    for number in range(100):
        field.at(2 * S + number * 40 * MS, 0, Outgoing(BROADCAST, bytes(200)))
    field.until(6 * S)
    field.close()
    assert field.got(1, BLE) > 50
    assert len([row for row in field.deferred(BLE) if row["start_ns"] > 2 * S]) > 20
    assert across(field.received(), field.sent()) == 0


def test_data_of_a_link_goes_before_a_frame_that_has_not_begun() -> None:
    """A central that has something to say at each event leaves none out for a frame of the robot's own."""
    field = Field([(0, 0), (3, 0)], None, {"connection": {"interval_s": 0.03}}, {"rate_mbps": 1})
    field.link(0, 1)

    def link(event: LinkEvent, now: int) -> None:
        if isinstance(event, Fate):
            field.channel.send(0, Outgoing(1, bytes(20), token=1))

    field.hosts[0].link = link  # type: ignore[method-assign]
    field.at(S, 0, Scan(False), Outgoing(1, bytes(20), token=1))
    for number in range(400):
        field.at(S + number * 13 * MS, 0, Outgoing(BROADCAST, bytes(1400), None, WIFI))
    field.until(6 * S)
    field.close()
    own = [each for each in field.sent() if each.radio == WIFI and each.robot == 0]
    left_out = [row["start_ns"] for row in field.deferred(BLE) if row["robot"] == 0 and row["start_ns"] > S + 100 * MS]
    assert len(own) > 100
    assert field.got(1, BLE) > 150
    assert [at for at in left_out if any(each.start < at < each.end for each in own)] == []
    assert len(field.deferred(WIFI)) > 100


# ---------------------------------------------------------------- the arbiter


def test_an_arbiter_refuses_for_the_last_use_that_goes_first() -> None:
    def uses(of: Rank, until: int, start: int, end: int, rank: Rank) -> int | None:
        return until if of > rank and until > start else None

    trace = Trace((INTERVALS,))
    arbitration = Arbitration([(0, 1, 2), (1,), (0, 1)])
    intervals = Intervals(trace)
    seats = [
        arbitration.seat(0, radio, partial(uses, of, until), intervals)
        for radio, (of, until) in enumerate(((Rank.EMPTY, 90), (Rank.DATA, 50), (Rank.RECEPTION, 40)))
    ]
    one, _, last = seats
    assert one is not None
    assert last is not None
    assert arbitration.seat(1, 1, partial(uses, Rank.BEGUN, 9), intervals) is None  # its only one
    assert arbitration.seat(2, 2, partial(uses, Rank.BEGUN, 9), intervals) is None  # which it has not
    assert one.ask(10, 20, 30, Rank.FRAME) == 50
    assert one.ask(11, 20, 30, Rank.DATA) == 40
    assert one.ask(12, 20, 30, Rank.RECEPTION) is None
    assert one.ask(13, 45, 60, Rank.DATA) is None
    assert last.ask(14, 20, 30, Rank.DATA) is None  # itself is not in its way
    assert last.ask(15, 20, 30, Rank.FRAME) == 50
    assert [arbitration.refused(radio) for radio in range(3)] == [2, 0, 1]
    arbitration.close(45)
    rows = sorted(zip(*(trace.columns("intervals")[name] for name in ("start_ns", "end_ns", "detail")), strict=True))
    assert rows == [(10, 45, "radio=1"), (11, 40, "radio=2"), (15, 45, "radio=1")]


# ---------------------------------------------------------------- what does not change


def test_who_catches_up_when_changes_nothing() -> None:
    """The air may be asked, and so have all catch up, at any instants."""

    def played(asks: int) -> list[Any]:
        field = busy(3, asks=asks)
        rows = [row for name in ("transmissions", "receptions", "intervals") for row in field.rows(name)]
        return sorted(sorted((name, str(value)) for name, value in row.items()) for row in rows)

    alone = played(0)
    assert len(alone) > 1000
    assert played(3000) == alone


def test_robots_with_one_radio_each_have_the_same_run() -> None:
    def played(arbitration: bool) -> tuple[list[Any], list[Any]]:
        places = [(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (4.0, 4.0)]
        field = Field(places, [(BLE,), (BLE,), (WIFI,), (WIFI,)], isolation_db=0.0, arbitration=arbitration)
        field.link(0, 1)
        for number in range(300):
            field.at(S + number * 5 * MS, 0, Outgoing(1, bytes(100)))
            field.at(S + number * 5 * MS, 2, Outgoing(3, bytes(1000), None, WIFI))
        field.until(3 * S)
        field.close()
        return field.rows("transmissions"), [str(row) for row in field.rows("receptions")]

    assert played(True) == played(False)


def test_what_is_not_arbitrated_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    two = [{"kind": "ble", "propagation": FREE}, {"kind": "adhoc", "propagation": FREE}]
    with pytest.raises(ValidationError, match="needs air: shared"):
        RadiosSettings.model_validate({"radios": two, "arbitration": True})
    monkeypatch.setattr(radios, "channel_spec", lambda kind: replace(channel_spec(kind), arbitrated=kind != "ble"))
    shared = {"radios": two, "air": "shared"}
    with pytest.raises(ValidationError, match="has no arbitration"):
        RadiosSettings.model_validate({**shared, "arbitration": True})
    RadiosSettings.model_validate(shared)


def test_the_page_has_the_order_of_the_table() -> None:
    lines = (ROOT / "docs" / "shared_air.md").read_text(encoding="utf-8").splitlines()
    told = [f"| {number} | {what} |" for number, what in enumerate(PRIORITIES.values(), 1)]
    at = lines.index(told[0])
    assert lines[at : at + len(told)] == told
    assert list(PRIORITIES) == sorted(Rank, reverse=True)
