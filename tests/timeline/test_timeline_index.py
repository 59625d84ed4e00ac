"""The index beside a trace: made once, mapped later, anew if it is stale or damaged; and traces that lack tables."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cosim.timeline import index, levels
from cosim.timeline.assembly import lanes_of
from cosim.timeline.index import FILE, FOLDER, Index, opened
from cosim.timeline.lanes import Boxes
from cosim.web.recorded import Recorded
from tests.timeline.made import made_rows, made_trace, written
from tests.timeline.test_timeline_windows import LAST, Page, drawn, stored

COUNT = 2400


@pytest.fixture(autouse=True)
def levels_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "FEWEST", 100)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path, made_trace(made_rows(1, COUNT, 30 * LAST)))


def content(found: Index) -> list[object]:
    """Return all that an index tells, as plain data."""
    lanes = [
        (lane.named, lane.table, *(column.tolist() for column in lane.boxes), lane.longest, lane.disjoint)
        for lane in found.lanes
    ]
    summed = [
        [[column.tolist() for column in level] for level in lane.levels.levels] if lane.levels else None
        for lane in found.lanes
    ]
    return [lanes, summed, found.codes.plain]


def forbidden(*_: object) -> Index:
    raise AssertionError("the tables are read again")


def test_an_index_is_made_once_and_tells_the_same_when_it_is_mapped(folder: Path, monkeypatch: pytest.MonkeyPatch):
    said: list[str] = []
    told: list[tuple[int, int]] = []
    made = index.made(folder, lambda done, total: told.append((done, total)))
    first = opened(folder, say=said.append)
    monkeypatch.setattr(index, "made", forbidden)
    second = opened(folder, say=said.append)
    assert said == []
    assert content(made) == content(first) == content(second)
    assert any(lane.levels is not None for lane in second.lanes)
    assert all(not column.flags.owndata for lane in second.lanes for column in lane.boxes)
    rows = sum(len(pd.read_parquet(folder / f"{name}.parquet")) for name in index.stamp_of(folder))
    assert told[-1] == (2 * rows, 2 * rows)
    assert told == sorted(told)
    assert sorted(path.name for path in folder.iterdir() if path.is_dir()) == [FOLDER]


def test_the_lanes_of_a_trace_in_memory_are_those_of_its_files(folder: Path):
    lanes, codes = lanes_of(made_trace(made_rows(1, COUNT, 30 * LAST)))
    assert content(Index(lanes, codes)) == content(opened(folder))


def append(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"x")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-8])


def other_type(path: Path) -> None:
    column = np.load(path)
    np.save(path, column.astype(np.float64 if column.dtype.itemsize == 8 else np.int64)[: len(column)])


def changed(**values: object) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | values), encoding="utf-8")

    return change


DAMAGES = [
    ("starts.npy", cut),
    ("rows.npy", append),
    ("level_cells.npy", cut),
    ("peers.npy", Path.unlink),
    (FILE, cut),
    (FILE, Path.unlink),
    (FILE, lambda path: path.write_text("[]", encoding="utf-8")),
    (FILE, changed(lanes=[])),
    (FILE, changed(lanes=[{}])),
    (FILE, changed(kinds=7)),
    (FILE, changed(outcomes=["x"])),
    (FILE, changed(format=0)),
    (FILE, changed(stamp={})),
]


@pytest.mark.parametrize(("name", "damage"), DAMAGES)
def test_an_index_that_is_stale_or_damaged_is_made_anew(folder: Path, name: str, damage: Callable[[Path], None]):
    before = content(opened(folder))
    damage(folder / FOLDER / name)
    said: list[str] = []
    assert content(opened(folder, say=said.append)) == before
    assert len(said) == 1
    assert said[0].endswith("made anew")
    assert "\n" not in said[0]
    assert content(opened(folder, say=said.append)) == before
    assert len(said) == 1


def test_columns_of_other_types_are_noticed(folder: Path):
    before = content(opened(folder))
    place = folder / FOLDER
    other_type(place / "kinds.npy")
    about = json.loads((place / FILE).read_text(encoding="utf-8"))
    about["sizes"]["kinds.npy"] = (place / "kinds.npy").stat().st_size
    (place / FILE).write_text(json.dumps(about), encoding="utf-8")
    said: list[str] = []
    assert content(opened(folder, say=said.append)) == before
    assert len(said) == 1


def test_an_index_of_other_tables_is_not_used(folder: Path):
    opened(folder)
    made_trace(made_rows(2, COUNT, 30 * LAST)).write(folder)
    said: list[str] = []
    after = content(opened(folder, say=said.append))
    assert said == [f"{folder / FOLDER}: is not about the tables as they are: made anew"]
    assert after == content(index.made(folder))


def test_where_no_index_can_be_written_lanes_are_in_memory(folder: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", refuse)
    said: list[str] = []
    found = opened(folder, say=said.append)
    assert len(said) == 1
    assert "Read-only file system" in said[0]
    assert not (folder / FOLDER).exists()
    assert content(found) == content(index.made(folder))


def test_rows_that_were_written_in_another_order_are_boxes_in_the_order_of_time(folder: Path):
    before = opened(folder)
    frames = pd.read_parquet(folder / "frames.parquet")
    frames.iloc[::-1].to_parquet(folder / "frames.parquet", index=False, row_group_size=500)
    after = opened(folder)
    for one, two in zip(before.lanes, after.lanes, strict=True):
        assert one.named == two.named
        columns = [Boxes(*(column.tolist() for column in lane.boxes)) for lane in (one, two)]
        spans = [sorted(zip(boxes.starts, boxes.ends, boxes.outcomes, strict=True)) for boxes in columns]
        assert (np.diff(two.boxes.starts) >= 0).all()
        assert len(spans[0]) == len(spans[1])
        if one.named.what in ("received", "broadcasts"):
            assert [span[:2] for span in spans[0]] == [span[:2] for span in spans[1]]


# ---------------------------------------------------------------- traces that lack tables


def test_an_older_trace_has_lanes_of_its_frames(tmp_path: Path):
    rows = made_rows(4, 800, LAST, older=True)
    folder = written(tmp_path, made_trace(rows, older=True))
    assert not (folder / "transmissions.parquet").exists()
    frames, page = pd.read_parquet(folder / "frames.parquet"), Page(Recorded(folder))
    told = {"sent", "received", "channel", "messages", "wakes", "events"}
    assert {lane["what"] for lane in page.lanes.values()} == told
    for start in range(0, LAST, LAST // 20):
        expected = stored(frames, start, start + 999)
        to_one = {row: count for row, count in expected.items() if row.destination >= 0}
        assert drawn(page, page.window(start, start + 999)) == to_one
    sent = sorted(
        (lane["robot"], box.start, box.end, page.kinds[box.kind], page.lost[box.outcome])
        for number, lane in page.lanes.items()
        if lane["what"] == "sent"
        for box in page.everything()[number]
    )
    lost = frames.outcome != "received"
    by_frame = lost.groupby([frames.source, frames.time_ns, frames.time_ns + frames.duration_ns, frames.kind]).any()
    assert sent == [(*frame, any_lost) for frame, any_lost in by_frame.items()]


def test_empty_tables_make_no_lanes(tmp_path: Path):
    page = Page(Recorded(written(tmp_path, made_trace(made_rows(1, 0, LAST)))))
    assert page.lanes == {}
    assert page.window(0, 100).boxes == {}
    assert page.find(0)["lane"] is None
    assert Page(Recorded(tmp_path)).lanes == {}


def test_a_trace_of_poses_alone_has_no_lanes(tmp_path: Path):
    written(tmp_path, made_trace(made_rows(1, 0, LAST)))
    for path in tmp_path.glob("*.parquet"):
        if path.name != "poses.parquet":
            path.unlink()
    assert Page(Recorded(tmp_path)).lanes == {}


def test_lanes_are_named_and_stand_in_order(tmp_path: Path):
    folder = written(tmp_path, made_trace(made_rows(5, 600, LAST, radios=2), radios=2))
    page = Page(Recorded(folder))
    names = [lane["name"] for lane in page.lanes.values()]
    assert [name for name in names if name.startswith("robot 1") and not name[-1].isdigit()] == [
        "robot 1: host",
        "robot 1: messages",
        "robot 1: wakes",
        "robot 1: events",
        *(
            f"robot 1, radio {radio}: {what}"
            for radio in (0, 1)
            for what in ("states", "sent", "received", "broadcasts")
        ),
    ]
    robots = [lane["robot"] for lane in page.lanes.values() if lane["robot"] >= 0]
    assert robots == sorted(robots)
    assert "jammers and walls" in names
    assert names[-6:] == [f"channel {channel}, radio {radio}" for channel in (0, 1, 2) for radio in (0, 1)]
