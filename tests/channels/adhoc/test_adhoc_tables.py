"""What an 802.11 channel writes of its radios' doings: intervals, transmissions, receptions, and routes."""

import math
import random
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc import stations
from cosim.channels.adhoc.carrier import carrier
from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.log import MOST_SLOTS, packed_slots, unpacked_slots
from cosim.channels.adhoc.routing.aodv import Aodv
from cosim.channels.adhoc.routing.olsr import Olsr
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.jamming import PULSED, Jammer
from cosim.intervals import STATES, Interval
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, INTERVALS, RECEPTIONS, TRANSMISSIONS, UNSENT, Table, Trace
from cosim.units import MS, US, S, Time

KEPT = (INTERVALS, TRANSMISSIONS, RECEPTIONS)
LOSS = {"model": "log_distance", "exponent": 3.0, "reference_loss_db": 40.0}
"""What is 10 m away is 70 dB fainter, what is 20 m away 79 dB."""


class Host:
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        pass

    def link(self, event: LinkEvent, now: Time) -> None:
        pass

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots on a plane, and a channel between them."""

    def __init__(self, places_m: list[tuple[float, float]], tables: tuple[Table, ...] = KEPT, **settings: Any) -> None:
        self.kernel = Kernel()
        self.trace = Trace(tables)
        self.channel = AdhocChannel(AdhocSettings(**settings), self.kernel, self.trace, len(places_m), Streams(1))
        for address in range(len(places_m)):
            self.channel.attach(address, Host())
        self.channel.moved(np.array(places_m))

    def send_at(self, time: Time, source: Address, destination: Address, length: int = 100) -> None:
        self.kernel.at(time, lambda: self.channel.send(source, Outgoing(destination, bytes(length))), WORLD)

    def power_at(self, time: Time, address: Address, on: bool) -> None:
        self.kernel.at(time, lambda: self.channel.power(address, on), WORLD)

    def run(self, until: Time) -> None:
        self.kernel.run(until)
        self.channel.close(until)

    def rows(self, table: Table, *names: str) -> list[tuple[Any, ...]]:
        columns = self.trace.columns(table.name)
        return sorted(zip(*(columns[name] for name in names), strict=True))

    def doings(self, *states: str) -> list[tuple[Any, ...]]:
        """Return the intervals in these *states*, or in all: start, end, robot, state, detail."""
        rows = self.rows(INTERVALS, "start_ns", "end_ns", "robot", "state", "detail")
        return [row for row in rows if not states or row[3] in states]

    def busy(self, seed: int, until: Time, tenths: int = 200) -> None:
        """Have robots send at random times, and two of them go off and on again."""
        chance = random.Random(seed)
        count = self.channel.size
        for _ in range(tenths):
            source = chance.randrange(count)
            other = chance.choice([robot for robot in range(BROADCAST, count) if robot != source])
            self.send_at(chance.randrange(until), source, other, chance.randrange(300))
        for robot in (0, 1):
            off, on = sorted((chance.randrange(until), chance.randrange(until)))
            self.power_at(off, robot, False)
            self.power_at(on, robot, True)


# ---------------------------------------------------------------- what one exchange leaves


def test_an_exchange_leaves_the_wait_for_its_answer_and_a_back_off_after_it() -> None:
    field = Field([(0, 0), (5, 0), (0, 5)], range_m=50.0)
    field.send_at(1 * MS, 0, 1)
    field.run(S)
    end = 1 * MS + (192 + 8 * 136) * US
    acked = end + (1 + 10 + 304 + 1) * US  # 14 octets at 1 Mb/s, SIFS, and twice the way
    assert field.rows(TRANSMISSIONS, "time_ns", "source", "kind", "destination", "duration_ns", "length") == [
        (1 * MS, 0, "DATA", 1, end - 1 * MS, 100),
        (end + 11 * US, 1, "ACK", 0, 304 * US, 0),
    ]
    assert field.rows(RECEPTIONS, "time_ns", "source", "receiver", "outcome") == [
        (1 * MS, 0, 1, "received"),
        (1 * MS, 0, 2, "received"),
        (end + 11 * US, 1, 0, "received"),
        (end + 11 * US, 1, 2, "received"),
    ]
    (backoff,) = field.doings("backoff")
    start, over, robot, _, detail = backoff
    slots = int(detail.split()[0].removeprefix("slots="))
    assert detail == f"slots={slots} of={slots} cw=31"
    assert (start, over, robot) == (acked + 50 * US, acked + 50 * US + slots * 20 * US, 0)
    assert field.doings("awaits_ack", "difs") == [
        (end, acked, 0, "awaits_ack", ""),
        (acked, acked + 50 * US, 0, "difs", ""),
    ]
    assert len(field.doings()) == 3


def test_whoever_a_frame_does_not_reach_has_a_row_and_its_wait_is_as_long_as_the_time_out() -> None:
    field = Field([(0, 0), (100, 0)], range_m=20.0, short_retries=1)
    field.send_at(1 * MS, 0, 1)
    field.send_at(20 * MS, 1, BROADCAST)
    field.run(S)
    names = "time_ns", "source", "receiver", "power_dbm", "outcome"
    assert field.rows(RECEPTIONS, *names) == [(1 * MS, 0, 1, None, "out_of_range")]
    ((start, end, *_),) = field.doings("awaits_ack")
    assert end - start == AdhocSettings().timing().timeout


def test_eifs_is_seen_after_two_frames_that_have_collided() -> None:
    """Robots 0 and 2 do not hear each other; robot 1 cannot read what they send together, and has a frame itself."""
    field = Field([(0, 0), (10, 0), (20, 0)], range_m=15.0)
    for source in (0, 2):
        field.send_at(1 * MS, source, BROADCAST, 500)
    field.send_at(2 * MS, 1, BROADCAST)
    field.run(S)
    timing = AdhocSettings().timing()
    end = 1 * MS + (192 + 8 * 536 + 1) * US
    assert field.doings("eifs")[0] == (end, end + timing.eifs, 1, "eifs", "")
    collided = field.rows(RECEPTIONS, "time_ns", "source", "receiver", "outcome")[:2]
    assert collided == [(1 * MS, 0, 1, "collided"), (1 * MS, 2, 1, "collided")]


def test_what_a_device_was_doing_is_over_when_it_goes_off() -> None:
    field = Field([(0, 0), (100, 0)], range_m=20.0)
    field.send_at(1 * MS, 0, 1, 0)
    sent = 1 * MS + (192 + 8 * 36) * US
    field.power_at(sent + 100 * US, 0, False)
    field.power_at(50 * MS, 0, True)
    field.send_at(60 * MS, 0, BROADCAST, 0)
    field.power_at(60 * MS + (192 + 8 * 36 + 30) * US, 0, False)
    field.run(S)
    assert field.doings("awaits_ack", "off", "difs") == [
        (sent, sent + 100 * US, 0, "awaits_ack", ""),
        (sent + 100 * US, 50 * MS, 0, "off", ""),
        (60 * MS + 480 * US, 60 * MS + 510 * US, 0, "difs", ""),
        (60 * MS + 510 * US, S, 0, "off", ""),
    ]


def test_energy_that_is_not_sensed_yet_when_a_device_goes_off_leaves_no_interval_beyond() -> None:
    field = Field([(0, 0), (10, 0)], range_m=15.0)
    field.send_at(1 * MS, 0, BROADCAST, 0)  # from its end on a back-off waits for DIFS
    end = 1 * MS + 480 * US
    field.send_at(end - 20 * US, 1, BROADCAST, 0)
    field.send_at(end + 10 * US, 1, BROADCAST, 0)
    for later in range(60):
        field.power_at(end + later * 10 * MS + 7 * US, 0, True)
    field.power_at(end + 60 * US, 0, False)
    field.run(S)
    assert field.doings("difs", "backoff")
    assert all(stop <= end + 60 * US for _, stop, robot, *_ in field.doings("difs", "backoff") if robot == 0)


def test_the_slots_of_a_back_off_pack_into_one_number() -> None:
    for slots in ((0, 0, 0), (1, 2, 3), (5, 31, 31), (1023, 1023, 1023), (MOST_SLOTS,) * 3):
        assert unpacked_slots(packed_slots(*slots)) == slots
    assert unpacked_slots(packed_slots(1, 1 << 40, 1 << 41)) == (1, MOST_SLOTS, MOST_SLOTS)


# ---------------------------------------------------------------- signals that fade


def fading(*places_m: tuple[float, float], **settings: Any) -> Field:
    return Field(list(places_m), propagation=LOSS, **settings)


def test_receptions_tell_power_and_the_least_ratio_to_noise_and_others() -> None:
    """Robot 1 follows what robot 0 sends, 10 m away; that of robot 2, 180 m away, comes in meanwhile."""
    field = fading((0, 0), (10, 0), (190, 0), (200, 0))
    field.send_at(1 * MS, 0, 1, 500)
    field.send_at(1 * MS + 500 * US, 2, BROADCAST, 0)
    field.run(S)
    rows = {row[:3]: row[3:] for row in field.rows(RECEPTIONS, *(field.name for field in RECEPTIONS.fields))}
    power_dbm, sinr_db, outcome, part = rows[1 * MS, 0, 1]
    assert (outcome, part) == ("received", "")
    assert power_dbm == pytest.approx(15 - 40 - 30, abs=1e-9)
    noise_mw = AdhocSettings(propagation=LOSS).limits().noise_mw
    other_mw = 10 ** ((15 - 40 - 30 * math.log10(180)) / 10)
    assert sinr_db == pytest.approx(power_dbm - 10 * math.log10(noise_mw + other_mw), abs=1e-6)
    faint_dbm, *rest = rows[1 * MS + 500 * US, 2, 1]
    assert faint_dbm == pytest.approx(10 * math.log10(other_mw))
    assert rest == [None, "collided", ""]  # not followed, and a disturbance to what was
    assert rows[1 * MS + 500 * US, 2, 3][2] == "received"
    assert (1 * MS + 500 * US, 2, 0) not in rows  # meant for all, but too faint to be noticed there
    assert (1 * MS, 0, 2) not in rows
    times = [time for time, source, receiver in rows if (source, receiver) == (1, 0)]
    assert len(times) == 1


def test_who_is_too_faint_to_be_noticed_has_a_row_only_where_it_spoils_what_is_for_that_robot() -> None:
    """Robot 0 is 37 m from robot 1, which notices it; robot 2 is 82 m away, and is not noticed."""
    field = fading((0, 0), (37, 0), (119, 0), short_retries=1)
    field.send_at(1 * MS, 0, 1, 500)
    field.send_at(1 * MS + 500 * US, 2, 3, 0)
    field.send_at(30 * MS, 2, 3, 0)
    field.run(S)
    powers = {(time, source, to): power for time, source, to, power in field.rows(RECEPTIONS, *NAMED)}
    assert powers[1 * MS, 0, 1] == pytest.approx(15 - 40 - 30 * math.log10(37))
    ((time, power_dbm),) = [(time, power) for (time, source, to), power in powers.items() if (source, to) == (2, 1)]
    assert time == 1 * MS + 500 * US
    assert -82.5 < power_dbm < -82
    assert [time for time, source, to in powers if (source, to) == (2, 3)] == [time, 30 * MS]


NAMED = "time_ns", "source", "receiver", "power_dbm"


# ---------------------------------------------------------------- carrier sense


def columns_of(field: Field) -> tuple[dict[str, Any], dict[str, Any]]:
    return field.trace.columns("transmissions"), field.trace.columns("receptions")


def test_carrier_sense_of_a_bystander_follows_from_the_rows() -> None:
    field = Field([(0, 0), (5, 0), (0, 5), (5, 5)], range_m=50.0)
    field.send_at(1 * MS, 0, 1, 100)
    field.run(S)
    end = 1 * MS + (192 + 8 * 136) * US
    ack = end + 11 * US
    bystander = carrier(*columns_of(field), 2, 1 * US)
    assert bystander.busy.tolist() == [[1 * MS + US, end + US], [ack + US, ack + 305 * US]]
    assert bystander.reserved.tolist() == [[end + US, end + US + 10 * US + 304 * US]]
    sender = carrier(*columns_of(field), 0, 1 * US)
    assert sender.busy.tolist() == [[1 * MS, end], [ack + US, ack + 305 * US]]
    assert sender.reserved.tolist() == []


def test_of_an_empty_run_nothing_is_busy() -> None:
    field = Field([(0, 0), (5, 0)])
    field.run(S)
    busy, reserved = carrier(*columns_of(field), 0, US)
    assert busy.shape == reserved.shape == (0, 2)


def test_a_frame_without_a_transmission_yet_is_left_out() -> None:
    field = Field([(0, 0), (5, 0)])
    field.send_at(1 * MS, 0, BROADCAST)
    field.send_at(5 * MS, 0, BROADCAST)
    field.run(S)
    sent, heard = columns_of(field)
    sent = {name: column[:1] for name, column in sent.items()}
    assert len(carrier(sent, heard, 1, US).busy) == 1
    assert len(carrier({name: column[:0] for name, column in sent.items()}, heard, 1, US).busy) == 0


def test_energy_of_several_frames_together_makes_the_medium_busy_where_signals_fade() -> None:
    sent = {
        "time_ns": [0, 0, 0, 100],
        "source": [0, 1, 2, 3],
        "destination": [BROADCAST] * 4,
        "duration_ns": [50, 100, 40, 10],
        "reserves_ns": [0] * 4,
    }
    heard = {
        "time_ns": [0, 0, 0, 100],
        "source": [0, 1, 2, 3],
        "receiver": [9, 9, 9, 9],
        "power_dbm": [-64.0, -64.0, -90.0, -70.0],
        "sinr_db": [None, None, None, 3.0],
        "outcome": ["collided"] * 3 + ["received"],
    }
    assert carrier(sent, heard, 9, 5).busy.tolist() == [[5, 55], [105, 115]]
    assert carrier(sent, heard, 9, 5, -65.0).busy.tolist() == [[5, 115]]
    assert carrier(sent, heard, 9, 5, -60.0).busy.tolist() == [[105, 115]]


# ---------------------------------------------------------------- keeping them


def jammed(tables: tuple[Table, ...], seed: int, fades: bool, routing: str | None) -> Field:
    places_m = [(10.0 * robot, 0.0) for robot in range(5)]
    law: dict[str, Any] = {"propagation": LOSS} if fades else {"range_m": 15.0}
    router = {} if routing is None else {"routing": {"kind": routing}}
    field = Field(places_m, tables, rts_threshold=150, **law, **router)
    field.channel.jam(Jammer(0.0, 5.0, 10.0, (10, 11, 12), PULSED, 0, 7 * US, 3 * MS, 300 * MS, 900 * MS))
    field.busy(seed, 2 * S)
    return field


@pytest.mark.parametrize("fades", [False, True])
@pytest.mark.parametrize("routing", [None, "aodv", "olsr", "flooding"])
def test_keeping_tables_changes_nothing(fades: bool, routing: str | None) -> None:
    """The frames are the same, and as many events of the kernel bring them about."""
    told = []
    for tables in ((FRAMES, UNSENT), (FRAMES, UNSENT, *KEPT)):
        field = jammed(tables, 3, fades, routing)
        field.run(2 * S)
        told.append((field.trace.digest(("frames", "unsent")), field.channel.summary(), field.kernel.executed))
    assert told[0] == told[1]
    assert all(field.trace.count(table.name) for table in KEPT)


@pytest.mark.parametrize("table", KEPT, ids=lambda table: table.name)
def test_a_table_that_is_kept_alone_has_the_rows_that_it_has_beside_others(table: Table) -> None:
    names = [field.name for field in table.fields]
    alone, beside = (jammed(tables, 5, False, None) for tables in ((table,), KEPT))
    for field in (alone, beside):
        field.run(2 * S)
    assert alone.rows(table, *names) == beside.rows(table, *names)
    assert alone.trace.count(table.name) > 50


def test_what_is_under_way_is_told_at_any_time_and_asking_changes_no_row() -> None:
    fields = [jammed(KEPT, 4, False, "aodv") for _ in range(2)]
    asked: list[tuple[Time, list[Interval]]] = []
    chance = random.Random(1)

    def ask() -> None:
        now = fields[0].kernel.now
        asked.append((now, fields[0].channel.under_way(now)))
        if now < 2 * S - 10 * MS:
            fields[0].kernel.at(now + chance.randrange(1, 3 * MS), ask, WORLD)

    fields[0].kernel.at(1, ask, WORLD)
    for field in fields:
        field.run(2 * S)
    one, other = (field.doings() for field in fields)
    assert one == other
    for table in KEPT[1:]:
        names = [field.name for field in table.fields]
        assert fields[0].trace.count(table.name) == fields[1].trace.count(table.name) > 0
        assert {row[:2] for row in fields[0].rows(table, *names)} == {row[:2] for row in fields[1].rows(table, *names)}
    assert sum(len(intervals) for _, intervals in asked) > 100
    for now, intervals in asked:
        then = {(start, robot, state, detail) for start, end, robot, state, detail in one if start < now < end}
        told = {(each.start, each.robot, each.state, each.detail) for each in intervals}
        assert then <= told
        assert all(each.end == now for each in intervals)
        ended = {(start, robot, state, detail) for start, end, robot, state, detail in one if end == now}
        assert told <= then | ended


def test_rows_are_handed_over_in_bulk_and_none_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stations, "LOG_ROWS", 50)
    field = Field([(float(robot), 0.0) for robot in range(6)], (FRAMES, *KEPT))
    field.busy(1, 2 * S, 200)
    field.run(2 * S)
    assert all(field.trace.count(table.name) > 200 for table in KEPT)
    assert field.trace.count("transmissions") == field.channel.summary()["frames_sent"]
    columns = "time_ns", "source", "destination", "kind", "length", "outcome"
    told = set(field.rows(FRAMES, *columns))
    receptions = {(time, source, to): what for time, source, to, what in field.rows(RECEPTIONS, *NAMED[:3], "outcome")}
    assert all(receptions[time, source, to] == what for time, source, to, _, _, what in told)
    sent = {(time, source): rest for time, source, *rest in field.rows(TRANSMISSIONS, "time_ns", "source", *OF_FRAME)}
    assert {(time, source): [kind, length, length] for time, source, _, kind, length, _ in told}.items() <= {
        frame: [kind, length, len(body) // 2] for frame, (kind, length, body) in sent.items()
    }.items()


OF_FRAME = "kind", "length", "body"


def test_intervals_of_one_state_do_not_overlap_and_all_states_are_known() -> None:
    for seed in range(4):
        field = jammed(KEPT, seed, seed % 2 == 0, "aodv")
        field.run(2 * S)
        assert {state for *_, state, _ in field.doings()} <= STATES.keys()
        waits: dict[Address, Time] = {}
        for start, end, robot, state, _ in field.doings():
            assert start < end <= 2 * S
            if state != "route":
                assert waits.get(robot, 0) <= start, (seed, robot, start)
                waits[robot] = end


# ---------------------------------------------------------------- routes


def known(router: Any, now: Time) -> Iterator[tuple[Address, Address, int]]:
    """Yield the routes of a *router*, to whom, over whom and how many hops, without asking it for any."""
    if isinstance(router, Olsr):
        for destination, (next_hop, hops) in router._table.items():
            yield destination, next_hop, hops
    elif isinstance(router, Aodv):
        for destination, route in router.table._routes.items():
            if route.active and route.until > now:
                yield destination, route.next_hop, route.hops


@pytest.mark.parametrize("routing", ["aodv", "olsr"])
def test_routes_are_those_of_the_tables_of_routers_at_any_time(routing: str) -> None:
    places_m = [(10.0 * robot, 3.0 * (robot % 2)) for robot in range(6)]
    field = Field(places_m, range_m=14.0, routing={"kind": routing})
    field.busy(2, 60 * S)
    chance = random.Random(3)
    seen: list[tuple[Time, set[tuple[Address, Address, Address, int]]]] = []

    def look() -> None:
        assert field.channel._forwarding is not None
        routers = enumerate(field.channel._forwarding.routers)
        now = field.kernel.now
        on = field.channel._on
        seen.append((now, {(robot, *way) for robot, each in routers if on[robot] for way in known(each, now)}))
        if now < 60 * S:
            field.kernel.at(now + chance.randrange(1, 200 * MS), look, WORLD)

    def shift() -> None:
        moved = np.array(places_m)
        moved[3] += chance.uniform(-8.0, 8.0), chance.uniform(-8.0, 8.0)
        field.channel.moved(moved)
        field.kernel.at(field.kernel.now + 7 * S, shift, WORLD)

    field.kernel.at(1, look, WORLD)
    field.kernel.at(10 * S + 1, shift, WORLD)
    field.run(60 * S)
    routes = field.doings("route")
    for now, ways in seen:
        there = set()
        for start, end, robot, _, detail in routes:
            if start < now <= end:
                there.add((robot, *(int(word.partition("=")[2]) for word in detail.split())))
        assert there == ways, now
    assert max(len(ways) for _, ways in seen) > 20
    assert max(hops for _, ways in seen for *_, hops in ways) > 2
    assert len(routes) > 60


def test_an_unused_route_of_aodv_is_over_when_its_time_is_though_nobody_asks_for_it() -> None:
    field = Field([(0, 0), (10, 0), (20, 0)], range_m=14.0, routing={"kind": "aodv", "use_hello": False})
    field.send_at(1 * S, 0, 2)
    field.run(60 * S)
    to_last = [row for row in field.doings("route") if row[2] == 0 and row[4] == "to=2 next=1 hops=2"]
    ((start, end, *_),) = to_last
    assert 1 * S < start < 2 * S
    assert end - start < 10 * S
