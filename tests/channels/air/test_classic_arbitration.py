"""Arbitration between a robot's own radios, of which one is Bluetooth classic.

What is on the air is told anew from the tables of a run and from what was told to the air, IDs included.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest

import cosim.channels.bluetooth.reporting.seats as seats
from cosim.channels.bluetooth.packets import HEADER_AIR, ID_AIR
from cosim.channels.bluetooth.scanning import sent_ids
from cosim.intervals import Interval
from cosim.kernel import DELIVER
from cosim.machine import BROADCAST, Connected, Disconnect, Discovered, Inquire, Lost, Outgoing, Page
from cosim.units import MS, SLOT, US, S
from tests.channels.air.arbitrated_field import DELAY, OTHER, WIFI, Field, across, at_once

CLASSIC = OTHER
SIFS = 10 * US
QUICK: dict[str, Any] = {
    "kind": "bluetooth",
    "page_scan": {"interval_s": 0.01125},
    "inquiry_scan": {"interval_s": 0.01125},
    "page": {"mode": "R0"},
    "inquiry": {"n_inquiry": 1},
    "idle_frames": True,
}
"""Devices that find each other in some milliseconds."""


@cache
def busy(seed: int, until: int = 3 * S, asks: int = 0, **settings: Any) -> Field:
    """Return a field, played *until* then, whose robots have much to say by both radios.

    Robot 0 is the master of 1 and 2, of which 2 has no 802.11; 3 has nothing else. 4 looks for 5, and pages it. So many
    times somebody *asks* what is on the air.
    """
    random = np.random.default_rng((41, seed))
    both = CLASSIC, WIFI
    carried = [both, both, (CLASSIC,), (WIFI,), both, both]
    classic = {**QUICK, "scheduler": str(random.choice(("lazy", "round_robin"))), "packet_choice": "best"}
    wifi = {"rate_mbps": float(random.choice((2, 5.5, 11))), "rts_threshold": 400}
    field = Field(random.uniform(0.0, 12.0, (6, 2)).tolist(), carried, classic, wifi, seed=seed, **settings)
    field.link(0, 1, 2)
    field.at(S, 4, Inquire(S, 5))
    field.at(2 * S, 4, Page(5))
    stations, devices = (0, 1, 3, 4, 5), (0, 1, 2)
    for _ in range(until // (8 * MS)):
        at = int(random.integers(S // 4, until - S // 4))
        source, destination = random.choice(stations, 2, replace=False).tolist()
        to = BROADCAST if random.random() < 0.2 else destination
        field.at(at, source, Outgoing(to, bytes(int(random.integers(1, 1400))), None, WIFI))
        source = int(random.choice(devices))
        to = int(random.choice((1, 2, BROADCAST), p=(0.45, 0.45, 0.1))) if source == 0 else 0
        field.at(at + int(random.integers(MS)), source, Outgoing(to, bytes(int(random.integers(1, 339)))))
    for at in np.random.default_rng(5).integers(1, until, asks).tolist():
        field.kernel.at(at, lambda: field.air.band.settle(field.kernel.now), DELIVER)
    field.until(until)
    field.close()
    return field


def pairs(field: Field) -> list[tuple[int, int, tuple[int, int]]]:
    """Return (start, end, (master, slave)) of each pair of slots that was answered."""
    rows = [row for row in field.rows("transmissions") if row["radio"] == CLASSIC and row["lt_addr"]]
    found: list[tuple[int, int, tuple[int, int]]] = []
    asked: dict[tuple[int, int], int] = {}
    for row in sorted(rows, key=lambda row: row["time_ns"]):
        start, ends = row["time_ns"], (row["source"], row["destination"])
        before, master = asked.pop(ends, 0), ends[::-1]
        if before and min(abs(start - before - slots * SLOT) for slots in (1, 3, 5)) < US:
            found.append((before, start + row["duration_ns"], master))
        else:
            asked[master] = start
    return found


# ---------------------------------------------------------------- one at a time


@pytest.mark.parametrize("seed", range(2))
def test_a_robots_radios_never_send_at_once(seed: int) -> None:
    field = busy(seed)
    sent = field.sent()
    both = {(robot, radio) for robot in (0, 1, 4, 5) for radio in (CLASSIC, WIFI)}
    assert {(each.robot, each.radio) for each in sent} >= both
    assert at_once(sent) == 0
    frames = [row for row in field.rows("transmissions") if row["radio"] == WIFI]
    for row in frames:  # with the time that they reserve for what follows
        begin, end = row["time_ns"], row["time_ns"] + row["duration_ns"] + row["reserves_ns"]
        if row["kind"] in ("DATA", "RTS"):
            own = [each for each in sent if (each.robot, each.radio) == (row["source"], CLASSIC)]
            assert not any(begin <= each.start < end for each in own)
    starts = {robot: np.array([row["time_ns"] for row in frames if row["source"] == robot]) for robot in range(6)}
    answered = pairs(field)
    assert len(answered) > 200
    for start, end, ends in answered:  # between the packet and the answer to it, too
        for robot in ends:
            assert not np.any((starts[robot] >= start) & (starts[robot] < end)), (start, robot)
    assert min(field.channel.summary()[f"radio_{radio}_refused"] for radio in (CLASSIC, WIFI)) > 20


def test_nothing_is_received_across_what_the_robots_other_radio_sends() -> None:
    """Even where isolation is perfect: whatever the arithmetic."""
    field = busy(1, isolation_db=300.0)
    received = field.received()
    assert min(sum(each.radio == radio for each in received) for radio in (CLASSIC, WIFI)) > 200
    assert across(received, field.sent()) == 0


def test_who_scans_is_deaf_while_802_11_sends() -> None:
    """It asks for nothing, and what it would hear does not keep 802.11 from sending."""
    field = Field([(0, 0), (3, 0)], [(CLASSIC,), (CLASSIC, WIFI)], QUICK, {"rate_mbps": 1}, isolation_db=300.0)
    for at in range(100 * MS, 2 * S, 100 * MS):
        field.at(at, 0, Inquire(80 * MS, 1))
        for number in range(7):
            field.at(at - MS + number * 13 * MS, 1, Outgoing(BROADCAST, bytes(700), None, WIFI))
    field.until(2 * S)
    field.close()
    received = [each for each in field.received() if each.radio == CLASSIC]
    assert sum(each.robot == 1 for each in received) > 5
    assert across(received, field.sent()) == 0


def test_without_arbitration_both_happens() -> None:
    field = busy(1, isolation_db=300.0, arbitration=False)
    sent = field.sent()
    assert at_once(sent) > 50
    assert across(field.received(), sent) > 50


def test_what_inquiries_and_pages_send_is_asked_for() -> None:
    """And nobody hears what was refused."""
    field = Field([(0, 0), (3, 0)], None, QUICK, {"rate_mbps": 2}, isolation_db=300.0)
    random, until = np.random.default_rng(53), 8 * S
    for at in range(100 * MS, until, 200 * MS):
        field.at(at, 0, Inquire(60 * MS, 1))
        field.at(at + 1, 0, Page(1))
        field.at(at + 190 * MS, 0, Disconnect(1))
    for at in range(100 * MS, until, 5 * MS):
        source = int(random.integers(2))
        to = BROADCAST if random.random() < 0.5 else 1 - source
        wait = int(random.integers(5 * MS))
        field.at(at + wait, source, Outgoing(to, bytes(int(random.integers(300))), None, WIFI))
    field.until(until)
    field.close()
    sent, received = field.sent(), field.received()
    assert at_once(sent) == 0
    assert across(received, sent) == 0
    told = {(each.start, each.end) for each in sent if each.radio == CLASSIC}
    heard = [(each.start, each.end) for each in received if each.radio == CLASSIC]
    assert [each for each in heard if each not in told] == []
    events = [type(event) for _, event in field.hosts[0].events]
    assert min(events.count(Discovered), events.count(Connected)) > 5
    assert len(field.deferred(CLASSIC)) > 100


def test_inquiries_and_pages_come_to_their_ends() -> None:
    events = [event for _, event in busy(0).hosts[4].events]
    assert any(isinstance(event, Discovered) and event.peer == 5 for event in events)
    assert any(isinstance(event, Connected) and event.peer == 5 for event in events)


def test_ids_are_those_of_the_table_without_those_that_were_refused() -> None:
    field = busy(0)
    since, until = S + 200 * MS, S + 900 * MS  # in which 802.11 is in use
    own = [row for row in field.rows("intervals") if row["robot"] == 4 and row["radio"] == CLASSIC]
    silences = [(row["start_ns"] - 1, row["end_ns"]) for row in own if row["state"] == "deferred"]
    assert len(silences) > 5
    frames = [row for row in field.rows("transmissions") if row["kind"] == "FHS" and row["destination"] == 4]
    silences += [(row["time_ns"], row["time_ns"] + row["duration_ns"]) for row in frames]  # all are received
    found: list[int] = []
    for row in own:
        if row["state"] == "inquiry":
            train = Interval(row["start_ns"], 4, row["end_ns"], CLASSIC, row["state"], row["detail"])
            found += sent_ids(train, since, until, silences)[0].tolist()
    ids = [each for each in field.told if each.sender == 4 and each.end - each.start == ID_AIR]
    assert found == [each.start for each in ids if since <= each.start < until]
    assert len(found) > 500


def test_refusals_are_in_the_trace() -> None:
    field = busy(0)
    until = field.kernel.now
    for radio in (CLASSIC, WIFI):
        rows = field.deferred(radio)
        assert len(rows) == field.channel.summary()[f"radio_{radio}_refused"]
        assert {row["detail"] for row in rows} == {f"radio={1 - radio}"}
        assert {row["robot"] for row in rows} == {0, 1, 4, 5}  # which have both
        assert all(row["start_ns"] < row["end_ns"] <= until for row in rows)


@pytest.mark.parametrize("seed", range(2))
def test_low_energy_and_classic_share_a_robot(seed: int) -> None:
    random = np.random.default_rng((43, seed))
    low_energy = {"kind": "ble", "connection": {"interval_s": 0.0075}, "advertise": {"interval_s": 0.02}}
    field = Field([(0, 0), (3, 0)], None, QUICK, low_energy, seed=seed, isolation_db=300.0)
    field.at(MS, 0, Page(1))
    field.at(MS, 1, Page(0, radio=1))
    for _ in range(200):
        at, source = int(random.integers(S // 2, 2 * S)), int(random.integers(2))
        field.at(at, source, Outgoing(1 - source, bytes(100)))
        field.at(at + int(random.integers(10 * MS)), source, Outgoing(1 - source, bytes(100), None, 1))
    field.until(2 * S + 100 * MS)
    field.close()
    sent = field.sent()
    assert at_once(sent) == 0
    assert across(field.received(), sent) == 0
    assert min(field.got(robot, radio) for robot in (0, 1) for radio in (0, 1)) > 50
    assert min(len(field.deferred(radio)) for radio in (0, 1)) > 20


def quiet_beside_low_energy(asks: int) -> Field:
    """Return an idle piconet of two robots that have a link of Low Energy, too, with much to say."""
    low_energy = {"kind": "ble", "connection": {"interval_s": 0.0075}, "advertise": {"interval_s": 0.02}}
    field = Field([(0, 0), (3, 0)], None, {**QUICK, "t_poll_slots": 16}, low_energy, isolation_db=300.0)
    field.at(MS, 0, Page(1))
    field.at(MS, 1, Page(0, radio=1))
    for at in range(S // 2, 3 * S, 8 * MS):
        field.at(at, at // (8 * MS) % 2, Outgoing(1 - at // (8 * MS) % 2, bytes(300), None, 1))
    for at in np.random.default_rng(5).integers(1, 3 * S, asks).tolist():
        field.kernel.at(at, lambda: field.air.band.settle(field.kernel.now), DELIVER)
    field.until(3 * S)
    field.close()
    return field


def test_idle_polls_are_asked_for_beside_low_energy_whoever_catches_up_when() -> None:
    field = quiet_beside_low_energy(0)
    sent = field.sent()
    assert at_once(sent) == 0
    assert across(field.received(), sent) == 0
    assert min(len(field.deferred(radio)) for radio in (0, 1)) > 10
    assert rows(quiet_beside_low_energy(1000)) == rows(field)


# ---------------------------------------------------------------- who goes first


def loaded(arbitration: bool, until: int = 3 * S) -> Field:
    """Return two robots with both radios, which meet on 22 of 23 channels, and much to say by both; isolation 0 dB.

    A frame of robot 0 takes 11.7 ms of 12 ms, and a payload waits 20 ms at most.
    """
    classic = {**QUICK, "channels": 23, "flush_s": 0.02}
    wifi = {"rate_mbps": 1, "channel": 1}
    field = Field([(0, 0), (3, 0)], None, classic, wifi, isolation_db=0.0, arbitration=arbitration)
    field.link(0, 1)
    for at in range(S // 2, until - S // 4, 20 * MS):
        field.at(at, 0, Outgoing(1, bytes(20)))
        field.at(at, 1, Outgoing(0, bytes(20)))
    for at in range(S // 2, until - S // 4, 12 * MS):
        field.at(at, 0, Outgoing(BROADCAST, bytes(1400), None, WIFI))
    field.until(until)
    field.close()
    return field


def test_both_starve_without_it_and_get_through_with_it() -> None:
    """Of 113 payloads of the slave 34 arrive without, and 113 with it; of 188 frames of 802.11 38, and 188.

    Payloads of the master wait for a pause, and then need nothing of what its own radios disturb but the answer.
    """
    of_slave, of_wifi = 113, 188
    without, field = loaded(False), loaded(True)
    assert without.got(0, CLASSIC) < 0.5 * of_slave
    assert without.got(1, WIFI) < 0.5 * of_wifi
    assert min(field.got(0, CLASSIC), field.got(1, CLASSIC)) > 0.9 * of_slave
    assert field.got(1, WIFI) > 0.9 * of_wifi
    assert at_once(field.sent()) == 0


def crowded(until: int = 4 * S) -> Field:
    """Return an idle piconet whose master hears 802.11 all the time, for itself: its link lives for 0.1 s.

    What it hears is too weak to destroy anything of the piconet.
    """
    carried = [(CLASSIC, WIFI), (CLASSIC,), (WIFI,), (WIFI,)]
    classic = {**QUICK, "supervision_s": 0.1}
    field = Field([(0, 0), (1, 0), (0, 25), (1, 25)], carried, classic, {"rate_mbps": 1})
    field.link(0, 1)
    for at in range(300 * MS, until, 24 * MS):
        for source in (2, 3):
            field.at(at, source, Outgoing(0, bytes(1400), None, WIFI))
    field.until(until)
    field.close()
    return field


def links(field: Field, robot: int) -> list[type]:
    return [type(event) for _, event in field.hosts[robot].events if isinstance(event, Connected | Lost)]


def test_a_link_that_is_lost_soon_goes_before_what_is_received() -> None:
    field = crowded()
    assert links(field, 0) == links(field, 1) == [Connected]
    assert len(field.deferred(CLASSIC)) > 100


def test_a_link_that_never_goes_first_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seats, "LAST_POLLS", -1)
    assert Lost in links(crowded(), 0)


def test_an_idle_poll_leaves_alone_what_802_11_receives_and_its_answer() -> None:
    field = Field([(0, 0), (3, 0), (0, 3)], [(CLASSIC, WIFI), (CLASSIC,), (WIFI,)], QUICK, {"rate_mbps": 2})
    field.link(0, 1)
    for at in range(300 * MS, 3 * S, 7_654_321):
        field.at(at, 2, Outgoing(0, bytes(1000), None, WIFI))
    field.until(3 * S)
    field.close()
    polls = np.array([each.start for each in field.sent() if (each.robot, each.radio) == (0, CLASSIC)])
    rows = [row for row in field.rows("transmissions") if row["radio"] == WIFI]
    ack = next(row["duration_ns"] for row in rows if row["kind"] == "ACK")
    ends = HEADER_AIR + SLOT  # of the answer
    for row in rows:
        if row["kind"] == "DATA":
            start, over = row["time_ns"] + DELAY, row["time_ns"] + row["duration_ns"] + SIFS + ack
            if not np.any((polls < start) & (polls + ends > start)):  # which has begun before
                assert not np.any((polls > start) & (polls < over))
    assert len(field.deferred(CLASSIC)) > 20


def test_a_payload_of_the_master_goes_before_a_frame_that_has_not_begun() -> None:
    field = loaded(True)
    began = np.array([row["time_ns"] for row in field.rows("transmissions") if row["radio"] == WIFI])
    queued = range(S // 2, 11 * S // 4, 20 * MS)
    frames = sorted(row["time_ns"] for row in field.rows("transmissions") if row["kind"] in ("DM1", "DH1"))
    of_master = {row["time_ns"] for row in field.rows("transmissions") if row["source"] == 0}
    for at in queued:  # no frame begins from then on before the payload does
        first = next(time for time in frames if time >= at and time in of_master)
        assert not np.any((began > at) & (began < first)), at


def test_slots_that_are_refused_are_no_losses_to_afh() -> None:
    """Each pair that AFH counts has begun: there is a packet of the master in the table."""
    counts = []
    classic = {**QUICK, "afh": True, "afh_interval_s": 100.0}
    field = Field([(0, 0), (3, 0), (0, 3)], [(CLASSIC, WIFI), (CLASSIC,), (WIFI,)], classic, {"rate_mbps": 2})
    field.link(0, 1)

    def count() -> None:
        field.channel.advance(field.kernel.now)
        counts.append(int(field.channel.parts[CLASSIC].air.adapt().tallies[0].sum()))  # type: ignore[attr-defined]

    since, until = 300 * MS - 7 * US, 3 * S - 7 * US
    for at in (since, until):
        field.kernel.at(at, count)
    for at in range(400 * MS, 2900 * MS, 7_654_321):
        field.at(at, 2, Outgoing(0, bytes(1000), None, WIFI))
    field.until(3 * S)
    field.close()
    rows = [row for row in field.rows("transmissions") if row["radio"] == CLASSIC and row["source"] == 0]
    assert counts[1] - counts[0] == sum(since <= row["time_ns"] < until for row in rows) > 50
    assert len(field.deferred(CLASSIC)) > 20


def test_a_slave_that_is_refused_neither_hears_nor_answers() -> None:
    field = Field([(0, 0), (3, 0), (0, 3)], [(CLASSIC,), (CLASSIC, WIFI), (WIFI,)], QUICK, {"rate_mbps": 1})
    field.link(0, 1)
    for number in range(150):
        field.at(300 * MS + number * 9 * MS, 2, Outgoing(1, bytes(500), None, WIFI))
    field.until(2 * S)
    field.close()
    refused = field.deferred(CLASSIC)
    assert len(refused) > 20
    heard = [each for each in field.received() if each.radio == CLASSIC]
    told = [each for each in field.sent() if each.radio == CLASSIC]
    for row in refused:
        since, until = row["start_ns"], row["start_ns"] + 2 * SLOT
        assert row["robot"] == 1
        assert [each.robot for each in told if since <= each.start < until] == [0]
        assert not any(since <= each.start < until for each in heard)


# ---------------------------------------------------------------- what does not change


@pytest.mark.parametrize("arbitration", [False, True])
def test_a_payload_of_a_slave_goes_with_its_next_poll(arbitration: bool) -> None:
    """That is so at all times, and so while there is an event for each poll, as 802.11 is in use."""
    carried = [(CLASSIC,), (CLASSIC,), (WIFI,), (CLASSIC, WIFI)]
    places = [(0.0, 0.0), (1.0, 0.0), (0.0, 40.0), (5.0, 40.0)]
    field = Field(places, carried, QUICK, {"rate_mbps": 1}, arbitration=arbitration)
    field.link(0, 1)
    random, times = np.random.default_rng(47), [S // 2]
    for _ in range(40):
        times.append(times[-1] + 60 * MS + int(random.integers(25 * MS)))
        field.at(times[-1], 1, Outgoing(0, bytes(20)))
    for at in range(S // 3, times[-1], 9 * MS):
        field.at(at, 2, Outgoing(BROADCAST, bytes(1000), None, WIFI))
    field.until(times[-1] + 100 * MS)
    arrived = [at for at, radio, _, _ in field.hosts[0].heard if radio == CLASSIC]
    assert len(arrived) == 40
    t_poll, pair = 25 * MS, 2 * SLOT
    assert all(late - at < t_poll + pair for at, late in zip(times[1:], arrived, strict=True))


def rows(field: Field) -> list[Any]:
    found = [(name, row) for name in ("transmissions", "receptions", "intervals") for row in field.rows(name)]
    return sorted([(name, *sorted((key, str(value)) for key, value in row.items())) for name, row in found])


def test_who_catches_up_when_changes_nothing() -> None:
    """The air may be asked, and so have all catch up, at any instants."""
    alone = rows(busy(1, until=2 * S))
    assert len(alone) > 5000
    assert rows(busy(1, until=2 * S, asks=2000)) == alone


@pytest.mark.parametrize("carried", [(CLASSIC, WIFI), (CLASSIC,)])
def test_it_changes_nothing_while_802_11_says_nothing(carried: tuple[int, ...]) -> None:
    """Or while all robots that say anything by it have one radio."""

    def played(arbitration: bool) -> list[Any]:
        both = [carried, carried, (WIFI,), (WIFI,)]
        field = Field([(0, 0), (4, 0), (0, 4), (4, 4)], both, QUICK, isolation_db=0.0, arbitration=arbitration)
        field.link(0, 1)
        for number in range(100):
            at, source = S // 2 + number * 13 * MS, number % 2
            field.at(at, source, Outgoing(1 - source, bytes(3 * number)))
            if len(carried) == 1:
                field.at(at, 2, Outgoing(3, bytes(1000), None, WIFI))
        field.until(2 * S)
        field.close()
        return rows(field)

    assert played(True) == played(False)
