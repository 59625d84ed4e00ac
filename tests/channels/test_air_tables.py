"""What the ideal and the optical channel write of transmissions, receptions and intervals, each by hand or by count."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.vision import OpticalChannel, OpticalSettings
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.intervals import STATES, Interval
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Disconnect,
    LinkEvent,
    Outgoing,
    Page,
    Reception,
    SwitchRole,
)
from cosim.randomness import Streams
from cosim.trace import FRAMES, INTERVALS, RECEPTIONS, TRANSMISSIONS, Table, Trace
from cosim.units import MS, US, S, Time

ALL = (FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS)
WALL = [[2.0, -1.0, 2.0, 1.0]]
"""Hides (4, 0) from (0, 0)."""


class Host:
    """An endpoint that notes what it gets."""

    def __init__(self) -> None:
        self.received: list[tuple[Time, Address, bytes]] = []
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.received.append((now, reception.source, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots at *places* and their channel, ideal or, if there are walls, optical."""

    def __init__(
        self, *places: tuple[float, float], walls: Any = None, tables: tuple[Table, ...] = ALL, **settings: Any
    ) -> None:
        self.kernel, self.trace = Kernel(), Trace(tables)
        size = len(places)
        if walls is None:
            ideal = IdealSettings(**settings)
            self.channel: IdealChannel = IdealChannel(ideal, self.kernel, self.trace, size, Streams(1))
        else:
            grid = packed_walls(segment_grid(np.array(walls, dtype=float).reshape(-1, 4)))
            self.channel = OpticalChannel(OpticalSettings(**settings), self.kernel, self.trace, size, grid)
        self.hosts = [Host() for _ in places]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(places, dtype=float))

    def at(self, time: Time, act: Callable[..., None], *arguments: Any) -> None:
        self.kernel.at(time, lambda: act(*arguments))

    def send(self, source: Address, destination: Address, payload: bytes) -> None:
        self.channel.send(source, Outgoing(destination, payload))

    def move_at(self, time: Time, *places: tuple[float, float]) -> None:
        self.kernel.at(time, lambda: self.channel.moved(np.array(places, dtype=float)), WORLD)

    def run(self, until: Time = S) -> None:
        self.kernel.run(until)
        self.channel.close(self.kernel.now)

    def rows(self, table: Table, *names: str) -> list[tuple[Any, ...]]:
        columns = self.trace.columns(table.name)
        return list(zip(*(columns[name] for name in names or columns), strict=True))

    def intervals(self) -> list[tuple[Any, ...]]:
        rows = self.rows(INTERVALS)
        assert all(row[4] in STATES for row in rows)
        return sorted(rows)


IN_A_ROW = (0.0, 0.0), (1.0, 0.0), (2.0, 0.0)


# ---------------------------------------------------------------- ideal


def test_an_ideal_payload_is_one_transmission_and_a_reception_for_each_receiver() -> None:
    field = Field(*IN_A_ROW, delay_s=1e-5, range_m=1.5)
    field.at(7, field.send, 0, BROADCAST, b"\x01\xff")
    field.at(9, field.send, 1, 2, b"")
    field.run()
    assert field.rows(TRANSMISSIONS) == [
        (7, 0, "IDEAL", BROADCAST, 0, 0, False, False, True, "01ff", 10 * US, -1, 0, 2),
        (9, 1, "IDEAL", 2, 0, 0, False, False, True, "", 10 * US, -1, 0, 0),
    ]
    assert field.rows(RECEPTIONS) == [
        (7, 0, 1, None, None, "received", ""),
        (7, 0, 2, None, None, "out_of_range", ""),
        (9, 1, 2, None, None, "received", ""),
    ]


def test_an_ideal_broadcast_has_receptions_where_the_table_of_frames_has_one_row_for_all() -> None:
    field = Field(*IN_A_ROW)
    field.send(0, BROADCAST, b"x")
    field.channel.power(2, False)
    field.run()
    assert field.rows(FRAMES, "destination", "outcome") == [(BROADCAST, "received")]
    assert field.rows(RECEPTIONS, "receiver", "outcome") == [(1, "received"), (2, "out_of_range")]


@pytest.mark.parametrize("walls", [None, WALL], ids=["ideal", "optical"])
def test_receptions_of_what_is_sent_at_one_instant_come_in_the_order_of_the_transmissions(walls: Any) -> None:
    field = Field(*IN_A_ROW, walls=walls, **({"loss": 0.5} if walls is None else {}))
    payloads = [(b"%d" % k, BROADCAST if k % 3 else 1) for k in range(40)]
    for payload, destination in payloads:
        field.send(0, destination, payload)
    field.run()
    sent = field.rows(TRANSMISSIONS, "body", "destination")
    assert sent == [(payload.hex(), destination) for payload, destination in payloads]
    heard = [data.hex() for _, _, data in field.hosts[1].received]
    outcomes = [outcome for receiver, outcome in field.rows(RECEPTIONS, "receiver", "outcome") if receiver == 1]
    assert [body for (body, _), outcome in zip(sent, outcomes, strict=True) if outcome == "received"] == heard
    assert (len(heard) < 40) == (walls is None)


def test_every_ideal_payload_is_told_whatever_is_lost_and_late_and_lasts_until_its_last_arrival() -> None:
    field = Field(*IN_A_ROW, delay_s=1e-3, loss=0.3, jitter_s=5e-3)
    sent = [(k * MS, k % 3, BROADCAST if k % 2 else (k + 1) % 3, bytes([k])) for k in range(200)]
    for time, *payload in sent:
        field.at(time, field.send, *payload)
    field.run(2 * S)
    told = field.rows(TRANSMISSIONS, "time_ns", "source", "destination", "body")
    assert told == [(time, source, to, data.hex()) for time, source, to, data in sent]
    outcomes: dict[tuple[Time, Address], str] = {
        (t, r): o for t, r, o in field.rows(RECEPTIONS, "time_ns", "receiver", "outcome")
    }
    meant = {(t, r) for t, source, to, _ in sent for r in range(3) if r != source and to in (BROADCAST, r)}
    assert outcomes.keys() == meant
    heard = {(data[0] * MS, r): at for r, host in enumerate(field.hosts) for at, _, data in host.received}
    assert {key for key, outcome in outcomes.items() if outcome == "received"} == heard.keys()
    assert set(outcomes.values()) == {"received", "lost"}
    durations = dict(field.rows(TRANSMISSIONS, "time_ns", "duration_ns"))
    complete = [t for t, *_ in sent if all(outcomes[key] == "received" for key in meant if key[0] == t)]
    assert len(complete) > 50
    for time in complete:
        assert time + durations[time] == max(at for (begin, _), at in heard.items() if begin == time)


def test_a_radio_that_is_off_is_an_interval_and_one_that_is_off_at_the_end_too() -> None:
    field = Field(*IN_A_ROW)
    for time, robot, on in ((10, 1, False), (20, 1, False), (30, 1, True), (40, 1, True), (50, 2, False)):
        field.at(time, field.channel.power, robot, on)
    field.kernel.run(60)
    assert field.channel.under_way(60) == [Interval(50, 2, 60, 0, "off", "")]
    field.run()
    assert field.intervals() == [(10, 1, 30, 0, "off", ""), (50, 2, S, 0, "off", "")]


def test_a_link_is_an_interval_of_both_its_ends_from_the_page_to_its_loss() -> None:
    field = Field(*IN_A_ROW, range_m=1.5)
    command = field.channel.command
    field.at(10, command, 0, Page(1))
    field.at(15, command, 0, Page(2))  # out of range
    field.at(20, command, 1, SwitchRole(0))
    field.at(30, command, 2, Page(1))
    field.at(40, command, 1, Disconnect(0))
    field.move_at(50, (0.0, 0.0), (1.0, 0.0), (9.0, 0.0))
    field.at(60, command, 0, Page(1))
    field.at(70, field.channel.power, 1, False)
    field.run()
    links = [row for row in field.intervals() if row[4] == "link"]
    assert links == [
        (10, 0, 20, 0, "link", "peer=1 role=master"),
        (10, 1, 20, 0, "link", "peer=0 role=slave"),
        (20, 0, 40, 0, "link", "peer=1 role=slave"),
        (20, 1, 40, 0, "link", "peer=0 role=master"),
        (30, 1, 50, 0, "link", "peer=2 role=slave"),
        (30, 2, 50, 0, "link", "peer=1 role=master"),
        (60, 0, 70, 0, "link", "peer=1 role=master"),
        (60, 1, 70, 0, "link", "peer=0 role=slave"),
    ]


# ---------------------------------------------------------------- optical


def test_an_optical_payload_is_told_when_it_is_over_and_one_on_the_air_at_the_end_without_receptions() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL, rate_bps=8_000, latency_s=0.01)
    field.send(0, BROADCAST, bytes(100))
    field.send(0, 1, bytes(3))
    field.send(0, BROADCAST, bytes(1000))
    field.run(200 * MS)
    assert field.rows(TRANSMISSIONS, "time_ns", "destination", "whole", "duration_ns", "length") == [
        (0, BROADCAST, True, 110 * MS, 100),
        (100 * MS, 1, True, 13 * MS, 3),
        (103 * MS, BROADCAST, True, 1010 * MS, 1000),
    ]
    assert field.rows(RECEPTIONS, "time_ns", "receiver", "outcome") == [(0, 1, "received"), (100 * MS, 1, "received")]
    assert field.channel.summary()["frames_sent"] == 3


def test_a_payload_whose_sender_is_switched_off_is_not_whole_and_as_long_as_it_was_on_the_air() -> None:
    field = Field((0, 0), (1, 0), walls=WALL, rate_bps=8_000)
    field.send(0, BROADCAST, bytes(100))
    field.send(0, BROADCAST, bytes(100))  # waits, and is never on the air
    field.at(30 * MS, field.channel.power, 0, False)
    field.run()
    assert field.rows(TRANSMISSIONS, "time_ns", "whole", "duration_ns") == [(0, False, 30 * MS)]
    assert field.rows(RECEPTIONS, "receiver", "outcome") == [(1, "out_of_range")]


def test_a_receiver_is_occluded_while_it_does_not_see_the_sender_of_what_is_on_the_air_for_it() -> None:
    field = Field((0, 0), (1, 0), (4, 0), walls=WALL, rate_bps=8_000)
    field.send(0, BROADCAST, bytes(100))  # for robot 1, until 100 ms and the latency
    field.move_at(20 * MS, (0, 0), (4, 0.5), (1, 0))
    field.move_at(50 * MS, (0, 0), (1, 0), (1, 0.5))
    field.move_at(70 * MS, (0, 0), (4, 0.5), (4, 0))
    field.move_at(80 * MS, (0, 0), (4, 0), (4, 0.5))
    field.move_at(300 * MS, (0, 0), (1, 0), (4, 0))
    field.run()
    assert field.intervals() == [
        (20 * MS, 1, 50 * MS, 0, "occluded", "peer=0"),
        (70 * MS, 1, 100 * MS + US, 0, "occluded", "peer=0"),
    ]
    assert field.rows(RECEPTIONS, "receiver", "outcome") == [(1, "out_of_range")]


def test_an_occlusion_ends_with_the_sender() -> None:
    field = Field((0, 0), (1, 0), walls=WALL, rate_bps=8_000)
    field.send(0, 1, bytes(100))
    field.move_at(20 * MS, (0, 0), (4, 0))
    field.at(60 * MS, field.channel.power, 0, False)
    field.kernel.run(40 * MS)
    assert field.channel.under_way(40 * MS) == [Interval(20 * MS, 1, 40 * MS, 0, "occluded", "peer=0")]
    field.run()
    assert [row for row in field.intervals() if row[4] != "off"] == [(20 * MS, 1, 60 * MS, 0, "occluded", "peer=0")]


# ---------------------------------------------------------------- what nobody wants


@pytest.mark.parametrize("walls", [None, WALL], ids=["ideal", "optical"])
def test_hosts_get_the_same_whatever_is_kept_and_nothing_is_kept_that_is_not_wanted(walls: Any) -> None:
    settings = {"loss": 0.2, "jitter_s": 0.01, "range_m": 3.0} if walls is None else {"rate_bps": 80_000}
    fields = [Field(*IN_A_ROW, walls=walls, tables=tables, **settings) for tables in (ALL, (FRAMES,), ())]
    for field in fields:
        field.at(5, field.channel.command, 0, Page(1))
        for k in range(60):
            field.at(k * 10 * MS, field.send, k % 3, BROADCAST if k % 4 else (k + 1) % 3, bytes(50))
        for k in range(1, 6):
            field.move_at(k * 100 * MS + 2 * MS, (0, 0), (1 + k % 3, 0), (2 + 2 * (k % 2), 0))
        field.at(250 * MS, field.channel.power, 1, False)
        field.at(350 * MS, field.channel.power, 1, True)
        field.run()
    wanted, some, none = fields
    assert {row[4] for row in wanted.intervals()} == {"off", "link", *(("occluded",) if walls else ())}
    for other in (some, none):
        for host, same in zip(wanted.hosts, other.hosts, strict=True):
            assert host.received
            assert (host.received, host.events) == (same.received, same.events)
        assert wanted.kernel.executed == other.kernel.executed
        assert other.channel.under_way(S) == []
        assert other.channel._linked == set()
    assert wanted.rows(FRAMES) == some.rows(FRAMES)
    assert none.trace.tables == {}
