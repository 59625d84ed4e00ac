"""Boxes of links in piconets: the robot at the other end is their peer, recorded and live."""

from pathlib import Path

from cosim.channels.bluetooth.links import Memberships, Presence
from cosim.channels.clock import NativeClock
from cosim.intervals import LINKED, MEMBER, STATES, Interval, Intervals, link_of
from cosim.present import Present
from cosim.timeline.growing import Growing
from cosim.timeline.index import opened
from cosim.timeline.lanes import Lane
from cosim.trace import INTERVALS, Trace

MASTER, SLAVES = 12, (3, 15)


def made() -> tuple[Trace, list[Interval]]:
    """Return a trace with the links of a piconet, one of them over, and with what is no link, and what is under way."""
    trace = Trace([INTERVALS])
    intervals = Intervals(trace)
    links = Memberships(MASTER, intervals)
    for slave in SLAVES:
        for device in (slave, MASTER):
            links.begin(device, slave, 1, 100 * slave)
    links.change_presence(15, Presence(here=False), 2000)
    links.change_presence(15, Presence(True, 192, 0, 64, NativeClock(77)), 2500)
    intervals.add(3, 10, 20, "page_response", "role=slave peer=12")
    intervals.add(MASTER, 5, 9, "inquiry", "train=A")
    for device in (MASTER, 3):
        links.end(device, 3, 5000)
    return trace, intervals.under_way(7000)


def made_of_low_energy() -> tuple[Trace, list[Interval]]:
    """Return the same of a central with two peripherals, by what devices of Low Energy write."""
    trace = Trace([INTERVALS])
    intervals = Intervals(trace)
    intervals.begin(MASTER, "initiating", 5, "peer=3")
    intervals.end(MASTER, "initiating", 9, "peer=3")
    for peripheral in SLAVES:
        intervals.begin(MASTER, "central", 100 * peripheral, f"peer={peripheral}")
        intervals.begin(peripheral, "peripheral", 100 * peripheral, f"peer={MASTER}")
    intervals.end(MASTER, "central", 5000, "peer=3")
    intervals.end(3, "peripheral", 5500, f"peer={MASTER}")
    return trace, intervals.under_way(7000)


def peers(lanes: list[Lane], kinds: list[tuple[str, str]]) -> set[tuple[int, str, int, int]]:
    """Return robot, state, start and peer of the boxes of robots."""
    return {
        (lane.named.robot, kinds[kind][1], start, peer)
        for lane in lanes
        if lane.named.what == "states"
        for boxes in (lane.boxes, lane.under_way)
        for start, kind, peer in zip(boxes.starts.tolist(), boxes.kinds.tolist(), boxes.peers.tolist(), strict=True)
    }


def members(lanes: list[Lane], kinds: list[tuple[str, str]]) -> set[tuple[int, int, str, int, int]]:
    """Return master, member, state, start and end of the boxes of piconets."""
    return {
        (lane.named.robot, lane.named.row, kinds[kind][1], start, end)
        for lane in lanes
        for boxes in (lane.boxes, lane.under_way)
        for start, end, kind in zip(boxes.starts.tolist(), boxes.ends.tolist(), boxes.kinds.tolist(), strict=True)
        if lane.named.what == "piconet"
    }


OTHERS = {(3, "page_response", 10, -1), (MASTER, "inquiry", 5, -1), (15, "away", 2000, -1)}
OVER = {(MASTER, "master", 300, 3), (3, "slave", 300, MASTER)}
UNDER_WAY = {(MASTER, "master", 1500, 15), (15, "slave", 1500, MASTER), (15, "part_time", 2500, -1)}
MEMBERS_OVER = {(MASTER, 3, "slave", 300, 5000), (MASTER, 15, "away", 2000, 2500)}
MEMBERS_UNDER_WAY = {(MASTER, 15, "slave", 1500, 7000), (MASTER, 15, "part_time", 2500, 7000)}


def test_a_recorded_link_has_the_other_robot_as_its_peer(tmp_path: Path) -> None:
    made()[0].write(tmp_path)
    for _ in range(2):  # made, then mapped
        index = opened(tmp_path)
        assert peers(index.lanes, index.codes.kinds) == OTHERS | OVER
        assert members(index.lanes, index.codes.kinds) == MEMBERS_OVER
    last = index.lanes[-1].named  # below the robots
    assert (last.what, last.called(16)) == ("piconet", "piconet of robot 12: robot 15")


LE_OVER = {(MASTER, "central", 300, 3), (3, "peripheral", 300, MASTER), (MASTER, "initiating", 5, -1)}
LE_UNDER_WAY = {(MASTER, "central", 1500, 15), (15, "peripheral", 1500, MASTER)}
LE_MEMBERS_OVER = {(MASTER, 3, "peripheral", 300, 5500)}
LE_MEMBERS_UNDER_WAY = {(MASTER, 15, "peripheral", 1500, 7000)}


def test_a_link_of_low_energy_has_peers_and_a_strip_too(tmp_path: Path) -> None:
    trace, under_way = made_of_low_energy()
    trace.write(tmp_path)
    for _ in range(2):  # made, then mapped
        index = opened(tmp_path)
        assert peers(index.lanes, index.codes.kinds) == LE_OVER
        assert members(index.lanes, index.codes.kinds) == LE_MEMBERS_OVER
    growing = Growing([INTERVALS])
    rows = list(zip(*trace.columns(INTERVALS.name).values(), strict=True))
    growing.take({INTERVALS.name: rows}, Present(7000, under_way))
    assert peers(growing.lanes, growing.codes.kinds) == LE_OVER | LE_UNDER_WAY
    assert members(growing.lanes, growing.codes.kinds) == LE_MEMBERS_OVER | LE_MEMBERS_UNDER_WAY


def test_pages_are_told_what_a_robot_is_in_its_link_whatever_its_state_is_called(tmp_path: Path) -> None:
    for name, (trace, _) in {"classic": made(), "low_energy": made_of_low_energy()}.items():
        trace.write(tmp_path / name)
        told = {each["name"]: each["role"] for each in opened(tmp_path / name).codes.plain["kinds"]}
        roles = {"master": "master", "central": "master", "slave": "slave", "peripheral": "slave"}
        assert told == {state: roles.get(state, "") for state in told}
        assert {"master", "slave"} <= set(told.values())


def test_each_state_of_a_link_is_one_of_the_table_and_names_the_other_end_as_its_meaning_says() -> None:
    for state, linked in LINKED.items():
        if state != "peer":  # which no radio writes
            assert linked.other in STATES[state]
    assert MEMBER.keys() < STATES.keys()


def test_what_is_said_in_a_detail_is_a_word_of_it() -> None:
    assert link_of("slave", "master=7 lt_addr=1") == ("slave", 7)
    assert link_of("link", "peer=2 role=peer") == ("peer", 2)
    assert link_of("peripheral", "peer=0") == ("slave", 0)
    assert link_of("master", "slave=many") == ("master", -1)
    assert link_of("initiating", "peer=3") is None
    assert link_of("central", "no_peer=3") == ("master", -1)


def test_what_lasts_while_a_device_is_a_member_is_told_whenever_it_is_one() -> None:
    trace = Trace([INTERVALS])
    intervals = Intervals(trace)
    links = Memberships(MASTER, intervals)
    links.change_presence(3, Presence(True, 192, 0, 64), 10)
    links.leave_out([4, 5, 9], 20)
    links.suspend(True, 30)
    for begin, end in ((100, 200), (300, 400)):
        for device in (3, MASTER):
            links.begin(device, 3, 1, begin)
            links.end(device, 3, end)
    links.suspend(False, 500)
    rows = {(*row[:3], row[4]) for row in zip(*trace.columns(INTERVALS.name).values(), strict=True)}
    for begin, end in ((100, 200), (300, 400)):
        assert {(begin, 3, end, "part_time"), (begin, MASTER, end, "away"), (begin, MASTER, end, "afh")} <= rows
    assert len(rows) == 10
    assert intervals.under_way(600) == []


def test_a_link_that_is_under_way_has_one_too() -> None:
    trace, under_way = made()
    growing = Growing([INTERVALS])
    columns = trace.columns(INTERVALS.name)
    growing.take({INTERVALS.name: list(zip(*columns.values(), strict=True))}, Present(7000, under_way))
    assert peers(growing.lanes, growing.codes.kinds) == OTHERS | OVER | UNDER_WAY
    assert members(growing.lanes, growing.codes.kinds) == MEMBERS_OVER | MEMBERS_UNDER_WAY


def test_an_absence_ends_with_the_membership_and_begins_with_the_next_one() -> None:
    trace = Trace([INTERVALS])
    links = Memberships(MASTER, Intervals(trace))
    links.change_presence(3, Presence(here=False), 50)  # no member yet: nothing is told
    for begin, end in ((100, 200), (300, 400)):
        links.begin(3, 3, 1, begin)
        links.end(3, 3, end)
    rows = zip(
        *(trace.columns(INTERVALS.name)[name] for name in ("start_ns", "end_ns", "state", "detail")), strict=True
    )
    away = [(start, end, detail) for start, end, state, detail in rows if state == "away"]
    assert away == [(100, 200, "master=12"), (300, 400, "master=12")]
