"""Windows of a recorded run: its boxes are the rows of the tables, and its cells what a plain count of them gives."""

from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.scenario import load
from cosim.simulation import Simulation
from cosim.timeline.window import MOST_BOXES
from cosim.trace import TABLES
from cosim.web.recorded import Recorded
from cosim.web.timeline import AskBox, AskNext, AskWindow
from tests.checkout import ROOT
from tests.timeline.made import Box, Read, made_rows, made_trace, read, written

LAST = 1_000_000
"""End of a made-up run, ns."""


class Page:
    """What asks a session."""

    def __init__(self, session: Any) -> None:
        message, _ = session.timeline.told(None)
        self.session = session
        self.lanes = {lane["lane"]: lane for lane in message["lanes"]}
        self.kinds = [kind["name"] for kind in message["kinds"]]
        self.outcomes = [(outcome["name"], outcome["part"]) for outcome in message["outcomes"]]
        self.lost = [outcome["lost"] for outcome in message["outcomes"]]
        self.last = int(message["last_ns"])

    def window(self, start: int, end: int, step: int = 1 << 40, lanes: list[int] | None = None) -> Read:
        asked = list(self.lanes) if lanes is None else lanes
        span = {"from_ns": str(start), "to_ns": str(end), "step_ns": str(step)}
        return read(self.session.timeline.answer(AskWindow(say="window", number=7, lanes=asked, **span)))

    def everything(self) -> dict[int, list[Box]]:
        """Return all boxes of each lane; lanes are asked for one by one, for all at once are too many boxes."""
        end = max(self.last, 100 * LAST) + 1
        return {lane: self.window(-1, end, lanes=[lane]).boxes[lane] for lane in self.lanes}

    def find(self, start: int, **more: Any) -> Any:
        return self.session.timeline.answer(AskNext(say="find", from_ns=str(start), **more))

    def box(self, lane: int, row: int) -> Any:
        return self.session.timeline.answer(AskBox(say="box", lane=lane, row=row))

    def named(self, box: Box) -> tuple[int, int, str, str, str]:
        """Return what a box tells in words: start, end, kind, outcome, part."""
        return box.start, box.end, self.kinds[box.kind], *self.outcomes[box.outcome]


class Drawn(NamedTuple):
    """A frame at a receiver, as drawn, or as the table has it."""

    start: int
    end: int
    kind: str
    outcome: str
    part: str
    source: int
    destination: int
    radio: int


def drawn(page: Page, window: Read) -> Counter[Drawn]:
    """Return the frames at receivers that *window* has."""
    found: Counter[Drawn] = Counter()
    for number, boxes in window.boxes.items():
        lane = page.lanes[number]
        for box in boxes:
            if lane["what"] == "received":
                found[Drawn(*page.named(box), box.peer, lane["robot"], lane["radio"])] += 1
            elif lane["what"] == "broadcasts":
                assert box.peer == lane["robot"]
                found[Drawn(*page.named(box), lane["robot"], -1, lane["radio"])] += 1
    return found


def stored(frames: pd.DataFrame, start: int, end: int) -> Counter[Drawn]:
    """Return the frames of *frames* that overlap a window, by plain comparison."""
    ends = frames.time_ns + frames.duration_ns
    inside = frames[(frames.time_ns < end) & (ends > start)]
    radios = inside.radio if "radio" in inside else [0] * len(inside)
    names = [inside.time_ns, ends[inside.index], inside.kind, inside.outcome, inside.part, inside.source]
    return Counter(Drawn(*row) for row in zip(*names, inside.destination, radios, strict=True))


def windows(seed: int, last: int, count: int = 20) -> list[tuple[int, int]]:
    stream = np.random.default_rng(seed)
    lengths = (10 ** stream.uniform(0, np.log10(last), count)).astype(int)
    starts = stream.integers(0, last, count)
    return list(zip(starts.tolist(), (starts + lengths).tolist(), strict=True))


@pytest.fixture(scope="module", params=[1, 2], ids=["one radio", "two radios"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows = made_rows(request.param, 900, LAST, radios=request.param)
    return written(tmp_path_factory.mktemp("made"), made_trace(rows, radios=request.param))


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """More boxes than are sent at once, and enough in some lanes for levels."""
    return written(tmp_path_factory.mktemp("dense"), made_trace(made_rows(3, 24_000, 50 * LAST)))


@pytest.mark.parametrize("example", ["2_bluetooth", "3_walls_and_faults", "1_coverage", "4_two_radios"])
def test_boxes_of_random_windows_are_rows_of_frames(example: str, tmp_path: Path):
    simulation = Simulation(load(ROOT / "examples" / f"{example}.yaml"), 1, tuple(TABLES.values()))
    simulation.begin()
    simulation.advance(8_000_000_000)
    simulation.trace.write(tmp_path)
    frames = pd.read_parquet(tmp_path / "frames.parquet")
    page = Page(Recorded(tmp_path))
    senders = "sent" if not simulation.trace.count("transmissions") else "nobody"
    seen = 0
    for start, end in windows(4, int(frames.time_ns.max())):
        found = drawn(page, page.window(start, end))
        expected = stored(frames, start, end)
        if senders == "sent":  # a frame for all is drawn at its sender, where there are no rows of transmissions
            expected = Counter({row: count for row, count in expected.items() if row.destination >= 0})
        assert found == expected
        seen += len(found)
    assert seen > 20


def test_boxes_of_a_made_up_run_are_rows_of_frames(folder: Path):
    frames, page = pd.read_parquet(folder / "frames.parquet"), Page(Recorded(folder))
    for start, end in windows(5, LAST):
        assert drawn(page, page.window(start, end)) == stored(frames, start, end)


@pytest.mark.parametrize("what", ["sent", "states", "messages", "wakes", "events"])
def test_each_row_is_a_box_of_its_robot(folder: Path, what: str):
    page = Page(Recorded(folder))
    table = {"sent": "transmissions", "states": "intervals"}.get(what, what)
    rows = pd.read_parquet(folder / f"{table}.parquet")
    found = {}
    for number, boxes in page.everything().items():
        lane = page.lanes[number]
        if lane["what"] == what:
            found |= {box.row: (lane["robot"], lane["radio"], box.start, box.end) for box in boxes}
    start, robot = rows.iloc[:, 0], rows.iloc[:, 1]
    end = rows.end_ns if what == "states" else start + (rows.duration_ns if what == "sent" else 0)
    no_radio = [-1 if what in ("messages", "wakes", "events") else 0] * len(rows)
    radio = rows.radio if "radio" in rows else no_radio
    assert [found[row] for row in sorted(found)] == list(zip(robot, radio, start, end, strict=True))


def test_boxes_of_a_lane_of_states_do_not_overlap(folder: Path):
    page = Page(Recorded(folder))
    lanes = [number for number, lane in page.lanes.items() if lane["what"] == "states"]
    assert any(page.lanes[number]["stacked"] for number in lanes)
    for boxes in page.window(0, 10 * LAST, lanes=lanes).boxes.values():
        assert all(before.end <= after.start for before, after in pairwise(boxes))


def test_a_frame_of_an_rf_channel_is_in_its_lane(folder: Path):
    page = Page(Recorded(folder))
    sent = pd.read_parquet(folder / "transmissions.parquet")
    found = defaultdict(list)
    for number, boxes in page.everything().items():
        if page.lanes[number]["what"] == "channel":
            found[page.lanes[number]["channel"]] += [(box.start, box.end, box.peer) for box in boxes]
    assert sorted(found) == [0, 1, 2]
    for channel, boxes in found.items():
        own = sent[sent.channel == channel]
        assert sorted(boxes) == sorted(zip(own.time_ns, own.time_ns + own.duration_ns, own.source, strict=True))


def test_a_sender_sees_which_of_its_frames_a_receiver_has_lost(folder: Path):
    page = Page(Recorded(folder))
    frames = pd.read_parquet(folder / "frames.parquet")
    radios = frames.radio if "radio" in frames else [0] * len(frames)
    columns = zip(frames.time_ns, frames.source, radios, frames.kind, frames.outcome, strict=True)
    lost = {row[:4] for row in columns if row[4] != "received"}
    sent = pd.read_parquet(folder / "transmissions.parquet")
    seen = Counter()
    for number, boxes in page.everything().items():
        lane = page.lanes[number]
        if lane["what"] in ("sent", "channel"):
            for box in boxes:
                source = lane["robot"] if lane["what"] == "sent" else box.peer
                known = (box.start, source, lane["radio"], page.kinds[box.kind]) in lost
                assert page.lost[box.outcome] == (known or not sent.whole[box.row])
                seen[lane["what"], known] += 1
    assert min(seen.values()) > 50


def test_a_loss_is_shown_at_its_sender_only_though_another_sends_the_same_on_that_channel(tmp_path: Path):
    rows = made_rows(1, 0, LAST)
    for source, outcome in ((0, "received"), (1, "collided"), (2, "received")):
        rows["transmissions"].append((50, source, "DM1", 3, 0, 0, False, False, True, "", 7, 5, 1, 3))
        rows["frames"].append((50, source, 3, 7, "DM1", 5, 1, 3, outcome, ""))
    page = Page(Recorded(written(tmp_path, made_trace(rows))))
    shown = Counter()
    for number, boxes in page.everything().items():
        lane = page.lanes[number]
        for box in boxes if lane["what"] in ("sent", "channel") else ():
            shown[lane["what"], box.peer if lane["what"] == "channel" else lane["robot"], page.lost[box.outcome]] += 1
    assert shown == Counter((what, robot, robot == 1) for what in ("sent", "channel") for robot in range(3))


def test_at_any_instant_all_that_is_in_the_air_or_open_is_known(folder: Path):
    page = Page(Recorded(folder))
    tables = {"frames": "duration_ns", "transmissions": "duration_ns", "intervals": "end_ns"}
    rows = {name: pd.read_parquet(folder / f"{name}.parquet") for name in tables}
    of_what = {"received": "frames", "broadcasts": "frames", "sent": "transmissions", "states": "intervals"}
    for at in np.random.default_rng(6).integers(0, LAST, 100).tolist():
        found = defaultdict(set)
        for number, boxes in page.window(at, at).boxes.items():
            if page.lanes[number]["what"] in of_what:
                found[of_what[page.lanes[number]["what"]]] |= {box.row for box in boxes}
        for name, column in tables.items():
            table = rows[name]
            end = table.end_ns if name == "intervals" else table.time_ns + table[column]
            assert found[name] == set(np.flatnonzero((table.iloc[:, 0] <= at) & (end > at)).tolist())


# ---------------------------------------------------------------- cells


def plain_cells(
    boxes: list[Box], lost: list[bool], start: int, step: int, count: int
) -> list[tuple[int, int, int, int]]:
    """Count cells as their documentation says, one box and one cell after the other."""
    cells = []
    touching = defaultdict(list)
    for box in boxes:
        for at in range(box.start // step, max(box.end - 1, box.start) // step + 1):
            touching[at].append(box)
    for at in range(start // step, start // step + count):
        here = touching[at]
        times: Counter[int] = Counter()
        begun: Counter[int] = Counter()
        for box in here:
            times[box.kind] += min(box.end, (at + 1) * step) - max(box.start, at * step)
            begun[box.kind] += box.start // step == at
        bad = {box.kind for box in here if lost[box.outcome]}
        kinds = bad or set(times)
        kind = min(kinds, key=lambda kind: (-times[kind], -begun[kind], kind), default=0xFFFF)
        share = min(255, -(-255 * sum(times.values()) // step))
        cells.append((kind, share, int(bool(bad)), sum(begun.values())))
    return cells


@pytest.mark.parametrize("shift", range(8, 22))
def test_cells_are_what_a_plain_count_gives(dense: Path, shift: int):
    page = Page(Recorded(dense))
    stream = np.random.default_rng(shift)
    summed = [lane.levels for lane in page.session.timeline.index.lanes if lane.levels is not None]
    assert summed
    assert any(levels.lowest <= 15 < levels.lowest + len(levels.levels) for levels in summed)
    length = min(page.last, 300 << shift)
    start = int(stream.integers(0, max(1, page.last - length)))
    step = (1 << shift) + int(stream.integers(1 << shift))
    seen = 0
    wide = page.window(start, start + length, step)
    for number, cells in wide.cells.items():
        assert (wide.start, wide.step) == (start >> shift << shift, 1 << shift)
        assert wide.start + len(cells) * wide.step >= start + length
        boxes = [box for at in range(wide.start, wide.start + len(cells) * wide.step, LAST) for box in page.window(
            at, min(at + LAST, wide.start + len(cells) * wide.step), lanes=[number]
        ).boxes[number]]  # fmt: skip
        unique = sorted({(box.start, box.row): box for box in boxes}.values())
        assert [tuple(cell) for cell in cells] == plain_cells(unique, page.lost, wide.start, wide.step, len(cells))
        seen += 1
    assert seen or shift < 14


def test_few_boxes_are_sent_one_by_one_and_many_as_cells(dense: Path):
    page = Page(Recorded(dense))
    whole = page.window(0, page.last, 1 << 16)
    assert 0 < sum(map(len, whole.boxes.values())) <= MOST_BOXES
    assert whole.cells
    few = max(map(len, whole.boxes.values()), default=0)
    assert all(sum(cell.count for cell in cells) >= few for cells in whole.cells.values())
    assert set(whole.boxes) | set(whole.cells) == set(page.lanes)


def test_a_lost_frame_wins_over_any_number_of_whole_ones(tmp_path: Path):
    rows = made_rows(7, 0, LAST)
    for at in range(8000):
        fate = ("bit_errors", "payload") if at == 4321 else ("received", "")
        rows["frames"].append((at * 100, 0, 1, 5 if at == 4321 else 90, "ID" if at == 4321 else "DM1", 3, 1, 3, *fate))
    page = Page(Recorded(written(tmp_path, made_trace(rows))))
    [lane] = [number for number, lane in page.lanes.items() if lane["what"] == "received"]
    [cells] = page.window(0, 800_000, 1 << 17, lanes=[lane]).cells.values()
    assert [(page.kinds[cell.kind], cell.lost) for cell in cells] == [
        ("ID" if at == 432_100 >> 17 else "DM1", int(at == 432_100 >> 17)) for at in range(7)
    ]


# ---------------------------------------------------------------- search


@pytest.mark.parametrize("back", [False, True])
def test_what_comes_next_is_what_a_linear_search_finds(folder: Path, back: bool):
    page = Page(Recorded(folder))
    everything = [
        (box.start, number, box.row, box)
        for number, boxes in page.everything().items()
        if page.lanes[number]["what"] != "channel"
        for box in boxes
    ]
    everything.sort(key=lambda each: each[:3])
    stream = np.random.default_rng(8)
    nothing = 0
    for _ in range(150):
        kind, robot, lost = (
            int(stream.integers(-2, len(page.kinds) + 1)),
            int(stream.integers(-2, 5)),
            stream.random() < 0.5,
        )
        wanted = {"kind": None if kind < 0 else kind, "robot": None if robot < -1 else robot, "lost": bool(lost)}
        start, number, row, _ = everything[stream.integers(len(everything))]
        with_present = stream.random() < 0.5
        found = page.find(start, back=back, **wanted, **({"lane": number, "row": row} if with_present else {}))
        fitting = [
            each[:3]
            for each in everything
            if (kind < 0 or each[3].kind == kind)
            and (robot < -1 or page.lanes[each[1]]["robot"] == robot)
            and (not lost or page.lost[each[3].outcome])
        ]
        here = (start, number, row) if with_present else (start, -1, -1)
        side = [each for each in fitting if (each < here if back else each > here)]
        expected = max(side, default=None) if back else min(side, default=None)
        assert (None if found["lane"] is None else (int(found["start_ns"]), found["lane"], found["row"])) == expected
        nothing += expected is None
    assert 0 < nothing < 100


def test_lanes_of_rf_channels_are_searched_only_if_they_are_named(folder: Path):
    page = Page(Recorded(folder))
    [number] = [number for number, lane in page.lanes.items() if lane["channel"] == 1][:1]
    assert page.lanes[page.find(0)["lane"]]["what"] != "channel"
    assert page.find(0, lanes=[number])["lane"] == number
    with pytest.raises(UserError, match="there is no lane 9999"):
        page.find(0, lanes=[9999])


def test_one_walks_through_all_boxes_of_an_instant(tmp_path: Path):
    rows = made_rows(9, 0, LAST)
    rows["events"] = [(5, robot, "Met") for robot in (0, 0, 1, 2)]
    page = Page(Recorded(written(tmp_path, made_trace(rows))))
    walked, present = [], {}
    while (found := page.find(5, **present))["lane"] is not None:
        present = {"lane": found["lane"], "row": found["row"]}
        walked.append((found["robot"], found["row"]))
    assert walked == [(0, 0), (0, 1), (1, 2), (2, 3)]
