"""Lanes of a run that is under way: however its rows come in, they are those that its tables give at the end."""

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.channels.radios import with_radio
from cosim.errors import UserError
from cosim.intervals import Interval
from cosim.present import Present
from cosim.scenario import load
from cosim.simulation import Simulation
from cosim.timeline import growing, levels
from cosim.timeline.assembly import lanes_of, lost_codes
from cosim.timeline.codes import Codes
from cosim.timeline.growing import Growing
from cosim.timeline.lanes import Lane
from cosim.timeline.window import cells
from cosim.trace import INTERVALS, TABLES, events_table
from cosim.web.live import Live
from tests.checkout import ROOT
from tests.timeline.made import TABLES as MADE
from tests.timeline.made import Rows, made_rows, made_trace
from tests.timeline.test_timeline_windows import LAST, Page, drawn, stored, windows

EVENTS = events_table(())


def grown(rows: Rows, radios: int = 1, most: int = 10**9, seed: int = 1) -> Growing:
    """Return lanes to which *rows* have come in parts of random sizes, each table's by itself."""
    tables = with_radio((*MADE, EVENTS)) if radios > 1 else (*MADE, EVENTS)
    found = Growing(tables, most)
    stream = np.random.default_rng(seed)
    left = {name: list(each) for name, each in rows.items()}
    now = 0
    while any(left.values()):
        new = {}
        for name, each in left.items():
            count = min(int(stream.geometric(0.03)), len(each))
            new[name], left[name] = each[:count], each[count:]
        now = max([now, *(row[0] for each in new.values() for row in each)])
        found.take(new, Present(now))
    return found


def told(lanes: list[Any], codes: Codes, stacked: bool = True) -> dict[Any, list[Any]]:
    """Return the boxes of each lane in words; states of one robot and radio together unless *stacked*."""
    found = defaultdict(list)
    for lane in lanes:
        named = lane.named if stacked else lane.named._replace(row=0)
        columns = (column.tolist() for column in lane.boxes)
        for start, end, kind, outcome, _, peer in zip(*columns, strict=True):
            found[named].append((start, end, codes.kinds[kind], codes.outcomes[outcome], peer))
    return {named: sorted(boxes) for named, boxes in found.items()}


@pytest.mark.parametrize("radios", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_lanes_grow_to_those_of_the_whole_run(radios: int, seed: int):
    rows = made_rows(seed, 700, LAST, radios=radios)
    found = grown(rows, radios, seed=seed)
    lanes, codes = lanes_of(made_trace(rows, radios))
    assert told(found.lanes, found.codes, stacked=False) == told(lanes, codes, stacked=False)
    assert sum(len(lane.boxes.starts) for lane in lanes) > 3000
    for lane in found.lanes:
        assert (np.diff(lane.boxes.starts) >= 0).all()


def test_each_box_leads_to_its_row():
    rows = made_rows(2, 400, LAST)
    found = grown(rows)
    for lane in found.lanes:
        for start, end, row in zip(lane.boxes.starts, lane.boxes.ends, lane.boxes.rows, strict=True):
            about = found.row(lane.table, int(row))
            table = {each.name: each for each in (*MADE, EVENTS)}[lane.table]
            assert tuple(about.values()) == rows[lane.table][row]
            assert list(about) == [field.name for field in table.fields]
            assert start == rows[lane.table][row][0]
            assert end >= start
    heard = found.at("receptions", rows["receptions"][5][0])
    assert tuple(heard[0].values()) in rows["receptions"]


def test_boxes_of_a_lane_of_states_do_not_overlap_while_they_come():
    found = grown(made_rows(3, 700, LAST))
    states = [lane for lane in found.lanes if lane.named.what == "states"]
    assert any(lane.named.row for lane in states)
    for lane in states:
        if lane.named.row < 15:
            assert lane.disjoint
            assert (lane.boxes.starts[1:] >= lane.boxes.ends[:-1]).all()


def plain_levels(lane: Any) -> Lane:
    return Lane(lane.named, lane.table, lane.boxes, lane.longest, lane.disjoint)


def test_levels_of_a_lane_that_has_grown_tell_what_its_boxes_do(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(growing, "_UNSUMMED", 50)
    monkeypatch.setattr(levels, "FEWEST", 100)
    found = grown(made_rows(4, 3000, 10 * LAST))
    summed = 0
    for lane in found.lanes:
        if lane.levels is None:
            continue
        summed += lane.levels.summed < len(lane.boxes.starts)
        lost = lost_codes(found.codes)
        for shift in range(lane.levels.lowest, lane.levels.lowest + 8, 2):
            first, end = 1, min(2000, (10 * LAST >> shift) + 2)
            with_levels, without = (
                cells(lane, shift, first, end, lost),
                cells(plain_levels(lane), shift, first, end, lost),
            )
            for one, two in zip(with_levels, without, strict=True):
                assert one.tolist() == two.tolist()
    assert summed > 5


def test_the_oldest_rows_are_forgotten_and_that_is_told():
    rows = made_rows(5, 2000, LAST)
    total = sum(map(len, rows.values()))
    found = grown(rows, most=4000)
    kept = {table.name: found._tables[table.name] for table in (*MADE, EVENTS)}
    assert found.forgotten == total - sum(map(len, kept.values()))
    assert 2000 < sum(map(len, kept.values())) <= 4000
    for lane in found.lanes:
        assert (lane.boxes.rows >= kept[lane.table].first).all()
    boxes = sum(len(lane.boxes.starts) for lane in found.lanes if lane.named.what in ("received", "broadcasts"))
    assert boxes == len(kept["frames"])
    with pytest.raises(UserError, match="there is no row 0, or not any more"):
        found.row("frames", 0)


def test_what_is_under_way_has_a_box_that_ends_now():
    found = Growing([INTERVALS])
    link, scan = Interval(10, 0, 500, 0, "link", "peer=1"), Interval(20, 0, 500, 0, "scan", "")
    found.take({}, Present(500, [link, scan]))
    lanes = {lane.named.row: lane for lane in found.lanes}
    assert [lane.within(499, 500).ends.tolist() for lane in lanes.values()] == [[500], [500]]
    number = int(lanes[0].under_way.rows[0])
    assert found.row("intervals", number)["detail"] == "peer=1"
    ended = [(30, 0, 40, 0, "scan", "x"), (20, 0, 600, 0, "scan", "")]
    found.take({"intervals": ended}, Present(700, [link._replace(end=700)]))
    lanes = {lane.named.row: lane for lane in found.lanes}
    assert {row: lane.within(0, 10**6).starts.tolist() for row, lane in lanes.items()} == {0: [10], 1: [20], 2: [30]}
    found.take({"intervals": [(10, 0, 800, 0, "link", "peer=1")]}, Present(900))
    assert [lane.within(0, 10**6).ends.tolist() for lane in found.lanes] == [[800], [600], [40]]
    assert all(not len(lane.under_way.starts) for lane in found.lanes)
    with pytest.raises(UserError, match="there is no row"):
        found.row("intervals", number)


def test_transmissions_that_are_told_late_take_the_place_of_frames():
    rows = made_rows(6, 200, LAST)
    found = Growing((*MADE, EVENTS))
    frames = rows["frames"]
    found.take({"frames": frames[:10]}, Present(10))
    assert {lane.table for lane in found.lanes if lane.named.what == "sent"} == {"frames"}
    found.take({"frames": frames[10:], "transmissions": rows["transmissions"]}, Present(LAST))
    lanes, codes = lanes_of(
        made_trace({**made_rows(6, 0, LAST), "frames": frames, "transmissions": rows["transmissions"]})
    )
    sent, expected = told(found.lanes, found.codes), told(lanes, codes)
    for named in expected:
        if named.what in ("sent", "channel"):
            assert [box[:3] for box in sent[named]] == [box[:3] for box in expected[named]]


# ---------------------------------------------------------------- a run that really is under way


@pytest.fixture(params=["4_two_radios", "2_bluetooth", "1_coverage"])
def live(request: pytest.FixtureRequest) -> Iterator[Live]:
    scenario = load(ROOT / "examples" / f"{request.param}.yaml", ("duration_s=8", "faults=[]"))
    session = Live(scenario, 1, speed=1000.0)
    yield session
    session.close()


def test_boxes_of_random_windows_of_a_live_run_are_rows_of_its_trace(live: Live, tmp_path: Path):
    end_s = time.monotonic() + 60
    asked = 0
    while live.look(None)[0][-1]["say"] != "ended":
        page = Page(live)
        asked += len(page.window(0, page.last).boxes)
        assert time.monotonic() < end_s
    simulation: Any = live._simulation
    scenario = simulation.scenario
    trace = Simulation(scenario, 1, tuple(TABLES.values())).run().trace
    trace.write(tmp_path)
    frames = pd.read_parquet(tmp_path / "frames.parquet")
    page = Page(live)
    told_at_senders = not trace.count("transmissions")
    seen = 0
    for start, end in windows(4, int(frames.time_ns.max())):
        found, expected = drawn(page, page.window(start, end)), stored(frames, start, end)
        if told_at_senders:
            expected = Counter({row: count for row, count in expected.items() if row.destination >= 0})
        assert found == expected
        seen += len(found)
    assert seen > 20
    everything = page.everything()
    for what, table in (("states", "intervals"), ("messages", "messages"), ("wakes", "wakes"), ("events", "events")):
        count = sum(len(boxes) for lane, boxes in everything.items() if page.lanes[lane]["what"] == what)
        assert count == (trace.count(table) if table in trace.tables else 0)
    for lane, boxes in everything.items():
        if page.lanes[lane]["what"] == "states":
            assert all(one.end <= two.start for one, two in pairwise(boxes))
