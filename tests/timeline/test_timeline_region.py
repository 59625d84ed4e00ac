"""Sums of what lies in a part of time, against what pandas counts in the tables of a run."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.present import Present
from cosim.timeline import levels
from cosim.timeline.index import opened
from cosim.web.recorded import Recorded
from cosim.web.timeline import AskRegion, Grown
from tests.timeline.made import KINDS, TABLES, made_rows, made_trace, written
from tests.timeline.test_timeline_windows import LAST, Page

COUNT = 3000
FIRST_COLUMN = {
    "sent": "time_ns",
    "received": "time_ns",
    "states": "start_ns",
    "messages": "time_ns",
    "wakes": "time_ns",
    "events": "time_ns",
}
WHOSE = {
    "sent": "source",
    "received": "destination",
    "states": "robot",
    "messages": "source",
    "wakes": "source",
    "events": "source",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("made"), made_trace(made_rows(7, COUNT, LAST)))


@pytest.fixture(scope="module")
def tables(folder: Path) -> dict[str, pd.DataFrame]:
    names = {"sent": "transmissions", "received": "frames", "states": "intervals"}
    found = {what: pd.read_parquet(folder / f"{names.get(what, what)}.parquet") for what in WHOSE}
    found["received"] = found["received"][found["received"].destination >= 0]
    return found


def ask(session: Any, start: int, end: int, robot: int | None = None) -> Any:
    asked = AskRegion(say="region", number=5, robot=robot, from_ns=str(start), to_ns=str(end))
    return session.timeline.answer(asked)


def expected(tables: dict[str, pd.DataFrame], start: int, end: int, robot: int | None) -> dict[tuple[str, str], Any]:
    """Return count, losses and time by what lanes are of and by kind, as pandas counts them."""
    found = {}
    for what, table in tables.items():
        rows = table if robot is None else table[table[WHOSE[what]] == robot]
        begins = rows["start_ns" if what == "states" else "time_ns"]
        ends = rows.end_ns if what == "states" else begins + rows.get("duration_ns", 0)
        kinds = rows.get("kind", rows.get("state", rows.get("event", pd.Series(what.removesuffix("s"), rows.index))))
        inside = (begins >= start) & (begins < end)
        touched = inside | ((begins < end) & (ends > start))
        times = np.minimum(ends, end) - np.maximum(begins, start)
        bad = inside & (rows.outcome != "received") if what == "received" else inside & False
        for kind in sorted(set(kinds[touched])):
            of = kinds == kind
            found[what, kind] = (inside & of).sum(), (bad & of).sum(), times[touched & of].sum()
    return found


@pytest.mark.parametrize("robot", [None, 0, 3])
@pytest.mark.parametrize("summed", [True, False], ids=["by levels", "by boxes"])
def test_sums_are_those_that_pandas_finds(
    folder: Path, tables: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, robot: int | None, summed: bool
) -> None:
    if summed:
        monkeypatch.setattr(levels, "FEWEST", 50)
    folder = written(tmp_path, made_trace(made_rows(7, COUNT, LAST)))
    index = opened(folder)
    assert summed == any(lane.levels is not None for lane in index.lanes)
    session = Recorded(folder)
    page = Page(session)
    stream = np.random.default_rng(11)
    regions = [tuple(sorted(stream.integers(0, LAST, 2).tolist())) for _ in range(12)]
    for start, end in [(0, 2 * LAST), (LAST // 3, LAST // 3 + 1), *regions]:
        told = ask(session, start, end, robot)
        found = {
            (each["what"], page.kinds[each["kind"]]): (each["count"], each["lost"], int(each["time_ns"]))
            for each in told["sums"]
        }
        mine = expected(tables, start, end, robot)
        assert {key[0] for key in found} >= {key[0] for key in mine}
        for what in WHOSE:
            ours = {kind: sums for (of, kind), sums in found.items() if of == what}
            if what == "sent":  # a frame is lost there if anybody has lost it
                ours = {kind: (count, 0, time) for kind, (count, _, time) in ours.items()}
            assert ours == {kind: sums for (of, kind), sums in mine.items() if of == what}, what
        heard = tables["received"] if robot is None else tables["received"][tables["received"].destination == robot]
        heard = heard[(heard.time_ns >= start) & (heard.time_ns < end) & (heard.outcome == "received")]
        assert told["received_bytes"] == heard.length.sum()
        sent = tables["sent"] if robot is None else tables["sent"][tables["sent"].source == robot]
        sent = sent[(sent.time_ns >= start) & (sent.time_ns < end)]
        spans = sorted(zip(sent.time_ns, sent.time_ns + sent.duration_ns, strict=True))
        assert [told["first"], told["last"]] == (
            [[str(time) for time in span] for span in (spans[0], spans[-1])] if spans else [None, None]
        )


def test_a_run_under_way_has_the_sums_of_its_trace(folder: Path) -> None:
    rows = made_rows(7, COUNT, LAST)
    growing = Grown([*TABLES, *(table for table in made_trace(rows).tables.values() if table.name == "events")])
    for part in range(4):
        growing.take({name: each[part::4] for name, each in rows.items()}, Present(LAST))

    class Session:
        timeline = growing

    for robot in (None, 1):
        one, two = ask(Session, LAST // 5, LAST // 2, robot), ask(Recorded(folder), LAST // 5, LAST // 2, robot)
        words = [
            {(each["what"], page.kinds[each["kind"]]): each for each in told["sums"]}
            for told, page in ((one, Page(Session)), (two, Page(Recorded(folder))))
        ]
        assert words[0].keys() == words[1].keys()
        for key, each in words[0].items():
            assert each | {"kind": 0} == words[1][key] | {"kind": 0}
        assert {name: one[name] for name in ("first", "last", "received_bytes")} == {
            name: two[name] for name in ("first", "last", "received_bytes")
        }
        assert {kind for what, kind in words[0] if what == "sent"} == set(KINDS)


def test_a_link_that_its_piconet_shows_too_is_counted_once(tmp_path: Path) -> None:
    rows = made_rows(7, 5, LAST)
    rows["intervals"] = [(10, 0, 90, 0, "master", "slave=1 lt_addr=1"), (10, 1, 90, 0, "slave", "master=0 lt_addr=1")]
    session = Recorded(written(tmp_path, made_trace(rows)))
    page = Page(session)
    assert "piconet" in {lane["what"] for lane in page.lanes.values()}
    sums = {
        (each["what"], page.kinds[each["kind"]]): (each["count"], each["time_ns"])
        for each in ask(session, 0, 50)["sums"]
        if page.kinds[each["kind"]] in ("master", "slave")
    }
    assert sums == {("states", "master"): (1, "40"), ("states", "slave"): (1, "40")}


def test_a_region_of_no_length_is_told_in_a_line(folder: Path) -> None:
    with pytest.raises(UserError, match="region: expected from_ns < to_ns"):
        ask(Recorded(folder), 7, 7)
