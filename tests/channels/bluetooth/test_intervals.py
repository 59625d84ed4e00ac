"""What a run over Bluetooth tells of intervals, transmissions and receptions where no oracle does: modes, power."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from cosim.channels.bluetooth.hopping import CHANNELS
from cosim.channels.bluetooth.polling import USED
from cosim.channels.bluetooth.scanning import sent_ids
from cosim.channels.jamming import CONSTANT, Jammer
from cosim.intervals import STATES, Interval
from cosim.machine import (
    Disconnect,
    Hold,
    Inquire,
    InquiryComplete,
    Outgoing,
    Page,
    Park,
    Scan,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.trace import FRAMES, INTERVALS, RECEPTIONS, TRANSMISSIONS, Table
from cosim.units import MS, SLOT, S, Time
from tests.channels.bluetooth.bluetooth_world import World

ALL = (FRAMES, INTERVALS, TRANSMISSIONS, RECEPTIONS)


def world(size: int, *tables: Table, **settings: object) -> World:
    return World(size, tables=tables or ALL, **settings)


def connected(*slaves: int, **settings: object) -> World:
    """Return a world in which 0 is the master of the *slaves*."""
    net = world(max(slaves) + 1, **settings)
    net.connect(*slaves)
    return net


def run(net: World, time: Time) -> None:
    net.kernel.run(net.kernel.now + time)


def intervals(net: World, *states: str) -> list[tuple[Time, int, Time, str, str]]:
    """Return (start, robot, end, state, detail) of the rows of these *states*, by start and robot; the run is over."""
    net.channel.advance(net.kernel.now)
    net.channel.close(net.kernel.now)
    rows = zip(*net.trace.columns("intervals").values(), strict=True)
    return sorted((*row[:3], *row[4:]) for row in rows if row[4] in states)


def table(net: World, name: str) -> list[dict[str, Any]]:
    columns = net.trace.columns(name)
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


# ---------------------------------------------------------------- membership and modes


def test_a_hold_is_an_interval_of_both_sides_within_that_of_the_link():
    net = connected(1)
    begin = net.kernel.now
    net.command(1, Hold(0, 200))
    run(net, S)
    hold = intervals(net, "hold")
    assert [(row[1], row[3:]) for row in hold] == [(0, ("hold", "slave=1")), (1, ("hold", "master=0"))]
    for start, _, end, _, _ in hold:
        assert start == begin
        assert 200 * SLOT <= end - start < 202 * SLOT
    links = intervals(net, "master", "slave")
    assert [(row[1], row[3], row[4]) for row in links] == [
        (1, "slave", "master=0 lt_addr=1"),
        (0, "master", "slave=1 lt_addr=1"),
    ]
    assert all(end == net.kernel.now for _, _, end, _, _ in links)


def test_sniff_modes_follow_each_other_until_the_link_is_closed():
    net = connected(1)
    times = [net.kernel.now + number * S for number in range(5)]
    for time, wish in zip(times, (Sniff(1, 100, 4, 8), Sniff(1, 100, 4, 8), Sniff(1, 200, 4, 8)), strict=False):
        net.at(time, partial(net.command, 0, wish))
    net.at(times[3], partial(net.command, 0, Sniff(1, 0, 0, 0)))
    net.at(times[4], partial(net.command, 0, Sniff(1, 100, 0, 2)))
    net.at(times[4] + 7, partial(net.command, 0, Disconnect(1)))
    run(net, 6 * S)
    parts = "interval_slots={} offset_slots={} attempt_slots={}"
    modes = [(times[0], times[2], parts.format(100, 4, 8)), (times[2], times[3], parts.format(200, 4, 8))]
    modes.append((times[4], times[4] + 7, parts.format(100, 0, 2)))
    sides = ((0, "slave=1"), (1, "master=0"))
    expected = [(start, robot, end, "sniff", f"{peer} {more}") for start, end, more in modes for robot, peer in sides]
    assert intervals(net, "sniff") == expected
    assert [row[2] for row in intervals(net, "master", "slave")] == [times[4] + 7] * 2


def test_a_hold_in_sniff_mode_interrupts_it():
    net = connected(1)
    begin = net.kernel.now
    net.command(0, Sniff(1, 100, 4, 8))
    net.at(begin + S, partial(net.command, 0, Hold(1, 100)))
    run(net, 2 * S)
    mine = [row for row in intervals(net, "sniff", "hold") if row[1] == 0]
    assert [row[3] for row in mine] == ["sniff", "hold", "sniff"]
    assert [row[0] for row in mine] == [begin, begin + S, mine[1][2]]
    assert mine[0][2] == begin + S
    assert mine[1][4] == "slave=1"


def test_a_parked_slave_has_no_lt_addr():
    net = connected(1)
    parked = net.kernel.now
    net.command(0, Park(1))
    run(net, 2 * S)
    net.command(1, Unpark(0))
    run(net, 4 * S)
    park, links = intervals(net, "park"), intervals(net, "master", "slave")
    assert [(row[0], row[1], row[4]) for row in park] == [(parked, 0, "slave=1"), (parked, 1, "master=0")]
    (again,) = {row[2] for row in park}
    assert parked + 2 * S < again < parked + 4 * S
    assert [(row[1], row[3]) for row in links] == [(1, "slave"), (0, "master"), (0, "master"), (1, "slave")]
    assert [row[2] for row in links[:2]] == [parked] * 2
    assert [row[0] for row in links[2:]] == [again] * 2


def test_a_role_switch_ends_two_memberships_and_begins_two():
    net = connected(1)
    net.command(0, SwitchRole(1))
    run(net, S)
    rows = intervals(net, "master", "slave")
    (turned,) = {row[2] for row in rows[:2]}
    assert [(row[0], row[1], row[3], row[4]) for row in rows[2:]] == [
        (turned, 0, "slave", "master=1 lt_addr=1"),
        (turned, 1, "master", "slave=0 lt_addr=1"),
    ]


# ---------------------------------------------------------------- power


def test_a_device_that_is_off_does_nothing_else():
    net = world(2)
    off, on = 3 * S + 1, 5 * S
    net.at(off, lambda: net.channel.power(1, False))
    net.at(on, lambda: net.channel.power(1, True))
    run(net, 8 * S)
    assert intervals(net, "off") == [(off, 1, on, "off", "")]
    scans = [row for row in intervals(net, "inquiry_scan", "page_scan") if row[1] == 1]
    assert {row[3] for row in scans} == {"inquiry_scan", "page_scan"}
    assert all(end <= off or start >= on for start, _, end, _, _ in scans)
    assert len(scans) >= 8


def test_the_peer_of_a_device_that_is_off_is_its_master_until_supervision_ends():
    net = connected(1, supervision_s=1.0)
    off = net.kernel.now
    net.channel.power(1, False)
    run(net, 2 * S)
    slave, master = intervals(net, "master", "slave")
    assert slave[2] == off
    assert off + 900 * MS < master[2] <= off + S


def test_a_frame_is_not_whole_if_its_sender_is_switched_off_meanwhile():
    net = connected(1, packet_types=["DH5"])
    net.channel.send(0, Outgoing(1, bytes(339)))
    run(net, 100 * MS)
    first = next(row for row in table(net, "transmissions") if row["kind"] == "DH5")
    assert (first["whole"], first["body"], first["length"]) == (True, bytes(339).hex(), 339)
    slot = first["time_ns"] + 400 * SLOT  # the same place of a later slot pair
    net.at(slot - SLOT, lambda: net.channel.send(0, Outgoing(1, bytes(339))))
    net.at(slot + 2 * MS, lambda: net.channel.power(0, False))
    run(net, S)
    last = [row for row in table(net, "transmissions") if row["kind"] == "DH5"][-1]
    assert last["time_ns"] <= slot + 2 * MS < last["time_ns"] + last["duration_ns"]
    assert not last["whole"]


def test_an_exchange_that_the_pager_leaves_is_told_as_far_as_it_went():
    net = world(2)
    net.connect(1)
    fhs = [row["time_ns"] for row in table(net, "transmissions") if row["kind"] == "FHS" and row["source"] == 0]
    again = world(2)  # the same draws, so the same page
    again.hosts[0].react = lambda event: again.command(0, Page(1)) if isinstance(event, InquiryComplete) else None
    again.at(0, lambda: again.command(0, Inquire(11 * S, 1)))
    again.at(fhs[0] + 5, lambda: again.channel.power(0, False))
    run(again, fhs[0] + S)
    cut = [row for row in table(again, "transmissions") if row["time_ns"] == fhs[0]]
    assert [(row["kind"], row["whole"]) for row in cut] == [("FHS", False)]
    rows = intervals(again, "page_response", "page")
    assert [row[2] for row in rows if row[3] == "page_response" and row[1] == 0] == [fhs[0] + 5]


# ---------------------------------------------------------------- what is wanted


@pytest.mark.parametrize("wanted", ALL[1:], ids=lambda each: each.name)
def test_each_table_is_kept_by_itself_and_says_the_same(wanted: Table):
    def rows(*tables: Table) -> list[dict[str, Any]]:
        net = world(3, *tables, idle_frames=True)
        net.connect(1, 2)
        net.channel.send(0, Outgoing(1, b"to one"))
        run(net, S)
        net.channel.advance(net.kernel.now)
        net.channel.close(net.kernel.now)
        return table(net, wanted.name)

    assert rows(wanted) == rows(*ALL)
    assert rows(wanted)


def test_idle_frames_are_told_if_they_are_asked_for():
    def kinds(**settings: object) -> list[str]:
        net = connected(1, **settings)
        begin = net.kernel.now
        run(net, S)
        net.channel.advance(net.kernel.now)
        return [row["kind"] for row in table(net, "transmissions") if row["time_ns"] >= begin]

    assert kinds() == []
    assert kinds(idle_frames=True)[:4] == ["POLL", "NULL", "POLL", "NULL"]


def test_a_broadcast_is_one_transmission_with_a_reception_for_each_slave():
    net = connected(1, 2, n_bc=2)
    net.channel.send(0, Outgoing(-1, b"to all"))
    run(net, S)
    sent = [row for row in table(net, "transmissions") if row["kind"] == "DM1"]
    assert [(row["destination"], row["retry"]) for row in sent] == [(-1, False), (-1, True)]
    times = {row["time_ns"] for row in sent}
    heard = [(row["receiver"], row["outcome"]) for row in table(net, "receptions") if row["time_ns"] in times]
    assert heard == [(1, "received"), (2, "received")] * 2


def test_every_state_of_a_run_has_a_meaning():
    net = connected(1, 2)
    net.command(0, Hold(1, 100), Sniff(2, 100, 0, 4))
    run(net, S)
    net.command(0, Park(2))
    net.channel.power(1, False)
    run(net, S)
    net.channel.close(net.kernel.now)
    states = set(net.trace.columns("intervals")["state"])
    assert {"inquiry", "inquiry_scan", "page", "page_scan", "master", "slave", "hold", "sniff", "park", "off"} <= states
    assert states <= set(STATES)


def test_who_looks_sees_what_is_under_way():
    net = world(2)
    net.at(S, lambda: net.command(0, Inquire(5 * S, 7)))
    run(net, 2 * S)
    now = net.kernel.now
    (row,) = (each for each in net.channel.under_way(now) if each.state == "inquiry")
    assert (row.robot, row.end, row.radio) == (0, now, 0)
    assert S <= row.start <= S + 2 * SLOT
    net.command(1, Scan(False))
    assert [each.state for each in net.channel.under_way(now)] == ["inquiry"]


def test_only_trains_have_ids():
    with pytest.raises(ValueError, match="'page_scan' is no train of IDs, expected one of 'inquiry' or 'page'"):
        sent_ids(Interval(0, 1, 2, 0, "page_scan", ""), 0, 1)


# ---------------------------------------------------------------- hop sets


def left_out(net: World) -> set[int]:
    """Return the channels that the hop set of 0, as the air uses it, does not have."""
    air = net.channel.air
    return {*range(CHANNELS)} - {*air.adapted.used[0, : air.band.piconets[0, USED]].tolist()}


@pytest.mark.slow
def test_channels_are_told_as_left_out_while_the_hop_set_is_without_them_and_there_is_a_piconet() -> None:
    net = connected(1, 2, t_poll_slots=16, afh=True, afh_retry_s=4)
    over = net.kernel.now + 6 * S
    net.channel.air.set_jammers(
        [Jammer(0.0, 0.0, 0.0, tuple(range(30, 50)), CONSTANT, 0, 0, 0, 0, over)], net.kernel.now
    )
    net.channel.air.set_jam_powers(np.full((1, 3), 20.0), net.kernel.now)
    seen = {}
    for _ in range(160):
        run(net, 100 * MS)
        seen[net.kernel.now] = left_out(net)
    assert max(map(len, seen.values())) > 10
    assert left_out(net) == set()
    rows = intervals(net, "afh")
    assert {robot for _, robot, *_ in rows} == {0}
    for now, channels in seen.items():
        told = [detail for start, _, end, _, detail in rows if start <= now < end]
        assert channels == {channel for detail in told for channel in channels_of(detail)}, now


def test_what_a_piconet_leaves_out_is_told_until_its_last_link_ends() -> None:
    net = connected(1, t_poll_slots=16, afh=True)
    run(net, S)
    net.channel.air.adapted.tallies[0, 1, 5] = 10
    run(net, 2 * S)
    net.command(0, Disconnect(1))
    gone = net.kernel.now
    run(net, 2 * S)
    assert left_out(net) == {5}
    ((start, *_, detail),) = rows = intervals(net, "afh")
    assert detail == "channels=5"
    assert start < rows[0][2] == max(end for _, _, end, *_ in intervals(net, "master")) <= gone + S


def channels_of(detail: str) -> set[int]:
    """Return the channels of a detail, channels=3-5,9."""
    spans = [part.split("-") for part in detail.removeprefix("channels=").split(",")]
    return {channel for span in spans for channel in range(int(span[0]), int(span[-1]) + 1)}
