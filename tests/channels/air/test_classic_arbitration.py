"""Arbitration between a robot's own radios, of which one is Bluetooth classic.

What is on the air is told anew from the tables of a run and from what was told to the air, IDs included.
"""

from typing import Any

import numpy as np
import pytest

import cosim.channels.bluetooth.tenancy as tenancy
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.kernel import DELIVER
from cosim.machine import BROADCAST, Connected, Discovered, Inquire, Lost, Outgoing, Page
from cosim.units import MS, SLOT, US, S
from tests.channels.air.arbitrated_field import DELAY, OTHER, WIFI, Field, Sent, across, at_once

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
    found, asked = [], {}
    for row in sorted(rows, key=lambda row: row["time_ns"]):
        start, ends = row["time_ns"], (row["source"], row["destination"])
        before, master = asked.pop(ends, 0), ends[::-1]
        if before and min(abs(start - before - slots * SLOT) for slots in (1, 3, 5)) < US:
            found.append((before, start + row["duration_ns"], master))
        else:
            asked[master] = start
    return found


# ---------------------------------------------------------------- one at a time


@pytest.mark.parametrize("seed", range(3))
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
    starts = {robot: np.array([row["time_ns"] for row in frames if row["source"] == robot]) for robot in (0, 1)}
    answered = pairs(field)
    assert len(answered) > 200
    for start, end, ends in answered:  # between the packet and the answer to it, too
        for robot in {*ends} - {2}:
            assert not np.any((starts[robot] >= start) & (starts[robot] < end)), (start, robot)
    assert min(field.channel.summary()[f"radio_{radio}_refused"] for radio in (CLASSIC, WIFI)) > 20


@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_received_across_what_the_robots_other_radio_sends(seed: int) -> None:
    """Even where isolation is perfect: whatever the arithmetic."""
    field = busy(seed, isolation_db=300.0)
    received = field.received()
    assert min(sum(each.radio == radio for each in received) for radio in (CLASSIC, WIFI)) > 200
    assert across(received, field.sent()) == 0
    assert any(row["outcome"] == "busy" for row in field.rows("receptions") if row["radio"] == CLASSIC)


def test_without_arbitration_both_happens() -> None:
    field = busy(1, isolation_db=300.0, arbitration=False)
    sent = field.sent()
    assert at_once(sent) > 50
    assert across(field.received(), sent) > 50


def test_inquiries_and_pages_come_to_their_ends() -> None:
    events = [event for _, event in busy(0).hosts[4].events]
    assert any(isinstance(event, Discovered) and event.peer == 5 for event in events)
    assert any(isinstance(event, Connected) and event.peer == 5 for event in events)


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


# ---------------------------------------------------------------- who goes first


def saturated(arbitration: bool, until: int = 3 * S) -> Field:
    """Return two robots with both radios, which meet on 22 of 23 channels, and much to say by both; isolation 0 dB."""
    classic = {**QUICK, "channels": 23}
    field = Field([(0, 0), (3, 0)], None, classic, {"rate_mbps": 1, "channel": 1}, 0.0, arbitration)
    field.link(0, 1)
    return field


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
