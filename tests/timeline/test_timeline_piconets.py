"""Boxes of links in piconets: the robot at the other end is their peer, recorded and live."""

from pathlib import Path

from cosim.channels.bluetooth.links import Memberships
from cosim.intervals import Interval, Intervals
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
    intervals.add(3, 10, 20, "page_response", "role=slave peer=12")
    intervals.add(MASTER, 5, 9, "inquiry", "train=A")
    for device in (MASTER, 3):
        links.end(device, 3, 5000)
    return trace, intervals.under_way(7000)


def peers(lanes: list[Lane], kinds: list[tuple[str, str]]) -> set[tuple[int, str, int, int]]:
    """Return robot, state, start and peer of all boxes."""
    return {
        (lane.named.robot, kinds[kind][1], start, peer)
        for lane in lanes
        for boxes in (lane.boxes, lane.under_way)
        for start, kind, peer in zip(boxes.starts.tolist(), boxes.kinds.tolist(), boxes.peers.tolist(), strict=True)
    }


OTHERS = {(3, "page_response", 10, -1), (MASTER, "inquiry", 5, -1)}
OVER = {(MASTER, "master", 300, 3), (3, "slave", 300, MASTER)}
UNDER_WAY = {(MASTER, "master", 1500, 15), (15, "slave", 1500, MASTER)}


def test_a_recorded_link_has_the_other_robot_as_its_peer(tmp_path: Path) -> None:
    made()[0].write(tmp_path)
    for _ in range(2):  # made, then mapped
        index = opened(tmp_path)
        assert peers(index.lanes, index.codes.kinds) == OTHERS | OVER


def test_a_link_that_is_under_way_has_one_too() -> None:
    trace, under_way = made()
    growing = Growing([INTERVALS])
    columns = trace.columns(INTERVALS.name)
    growing.take({INTERVALS.name: list(zip(*columns.values(), strict=True))}, under_way, 7000)
    assert peers(growing.lanes, growing.codes.kinds) == OTHERS | OVER | UNDER_WAY
