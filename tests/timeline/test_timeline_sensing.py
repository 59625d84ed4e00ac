"""Lanes of carrier sense: instants worked out by hand, and whole runs, in which nobody counts down while they hold."""

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.radios import with_radio
from cosim.machine import BROADCAST
from cosim.present import Present
from cosim.timeline import levels
from cosim.timeline.growing import Growing
from cosim.timeline.index import Index, opened
from cosim.timeline.sensing import adhoc_radios
from cosim.trace import FRAMES, POSES, RECEPTIONS, TABLES, TRANSMISSIONS, Trace
from cosim.units import US, S
from cosim.web.recorded import Recorded
from tests.channels.adhoc.test_adhoc_tables import Field
from tests.timeline.test_timeline_windows import Page

ADHOC = {"kind": "adhoc", "propagation_s": 3e-6}


def written(folder: Path, sent: list[Any], heard: list[Any], channel: Any, radios: bool = False) -> Path:
    """Write a trace of rows (time, source, kind, destination, reserves, duration) and (time, source, receiver,
    outcome), each followed by its radio if there are several; and return its folder."""
    tables = (FRAMES, TRANSMISSIONS, RECEPTIONS)
    trace = Trace([POSES, *(with_radio(tables) if radios else tables)])
    names = trace.tables
    for time, source, kind, to, reserves, duration, *radio in sent:
        about = kind, to, reserves, 0, False, False, True, "", duration, -1, -1, 0
        trace.row(names["transmissions"], time, source, *about, *radio)
    for time, source, receiver, outcome, *radio in heard:
        trace.row(names["receptions"], time, source, receiver, None, None, outcome, "", *radio)
    for robot in range(4):
        trace.row(POSES, 0, robot, 0.0, 0.0, 0.0)
    trace.write(folder, {"scenario": json.dumps({"channel": channel})})
    return folder


def silences(index: Index | Growing, what: str) -> dict[tuple[int, int], list[tuple[int, int, int, int]]]:
    """Return begin, end, row and peer of all boxes of the lanes *what*, by robot and radio."""
    found = {}
    for lane in index.lanes:
        if lane.named.what == what:
            columns = (column.tolist() for column in (*lane.boxes[:2], *lane.boxes[4:]))
            assert {index.codes.kinds[code] for code in lane.boxes.kinds.tolist()} == {("state", what)}
            found[lane.named.robot, lane.named.radio] = list(zip(*columns, strict=True))
    return found


EXCHANGE = [
    (1000, 0, "RTS", 1, 90_000, 10_000),
    (24_000, 1, "CTS", 0, 60_000, 9000),
    (46_000, 0, "DATA", 1, 20_000, 30_000),
    (89_000, 1, "ACK", 0, 0, 8000),
    (200_000, 2, "DATA", BROADCAST, 0, 5000),
    (206_000, 0, "DATA", BROADCAST, 0, 5000),
]
"""Robot 2 hears both ends, robot 3 robot 1 only, and nobody the last two but robot 1."""
RECEIVED = [
    *((time, source, to, "received") for time, source, _, to, *_ in EXCHANGE[:4]),
    *((time, source, 2, "received") for time, source, *_ in EXCHANGE[:2]),
    (46_000, 0, 2, "collided"),
    (89_000, 1, 2, "received"),
    (24_000, 1, 3, "received"),
    (46_000, 0, 3, "out_of_range"),
    (89_000, 1, 3, "received"),
    (200_000, 2, 1, "received"),
    (206_000, 0, 1, "received"),
]


def test_what_is_busy_and_reserved_is_what_one_works_out_by_hand(tmp_path: Path) -> None:
    index = opened(written(tmp_path, EXCHANGE, RECEIVED, ADHOC))
    assert silences(index, "busy") == {
        (0, 0): [
            (1000, 11_000, 0, 0),
            (27_000, 36_000, 1, 1),
            (46_000, 76_000, 2, 0),
            (92_000, 100_000, 3, 1),
            (206_000, 211_000, 5, 0),
        ],
        (1, 0): [
            (4000, 14_000, 0, 0),
            (24_000, 33_000, 1, 1),
            (49_000, 79_000, 2, 0),
            (89_000, 97_000, 3, 1),
            (203_000, 208_000, 4, 2),
            (209_000, 214_000, 5, 0),
        ],
        (2, 0): [
            (4000, 14_000, 0, 0),
            (27_000, 36_000, 1, 1),
            (49_000, 79_000, 2, 0),
            (92_000, 100_000, 3, 1),
            (200_000, 205_000, 4, 2),
        ],
        (3, 0): [(27_000, 36_000, 1, 1), (92_000, 100_000, 3, 1)],
    }
    assert silences(index, "NAV") == {(2, 0): [(14_000, 104_000, 0, 0)], (3, 0): [(36_000, 96_000, 1, 1)]}
    assert [lane.named.called(4) for lane in index.lanes if lane.named.robot == 3] == ["robot 3: busy", "robot 3: NAV"]
    assert all(kind["meaning"] for kind in index.codes.plain["kinds"])


def test_of_frames_that_end_together_the_one_that_was_received_has_reserved_the_medium(tmp_path: Path) -> None:
    sent = [(1000, 0, "RTS", 1, 90_000, 10_000), (1000, 3, "RTS", 1, 70_000, 10_000)]
    heard = [(1000, 0, 2, "received"), (1000, 3, 2, "collided")]
    index = opened(written(tmp_path, sent, heard, ADHOC))
    assert silences(index, "NAV") == {(2, 0): [(14_000, 104_000, 0, 0)]}


def test_a_box_tells_of_the_frame_that_it_begins_with(tmp_path: Path) -> None:
    page = Page(Recorded(written(tmp_path, EXCHANGE, RECEIVED, ADHOC)))
    lanes = {(lane["robot"], lane["what"]): number for number, lane in page.lanes.items()}
    told = page.box(lanes[3, "NAV"], 1)
    assert (told["start_ns"], told["end_ns"], told["peer"]) == ("36000", "96000", 1)
    assert (told["fields"]["kind"], told["fields"]["reserves_ns"]) == ("CTS", "60000")
    assert [each["receiver"] for each in told["receptions"]] == [0, 2, 3]
    found = page.find(0, kind=page.kinds.index("NAV"), robot=3)
    assert (found["lane"], found["row"], found["start_ns"]) == (lanes[3, "NAV"], 1, "36000")


def test_each_radio_has_a_network_and_settings_of_its_own(tmp_path: Path) -> None:
    channel = {"kind": "radios", "radios": [{"kind": "ideal"}, ADHOC, ADHOC | {"propagation_s": 5e-6}]}
    sent = [(*row, radio) for radio in (0, 1, 2) for row in EXCHANGE]
    heard = [(*row, radio) for radio in (0, 1, 2) for row in RECEIVED]
    index = opened(written(tmp_path, sent, heard, channel, radios=True))
    reserved = silences(index, "NAV")
    spans = {place: [box[:2] for box in boxes] for place, boxes in reserved.items()}
    assert spans == {
        (2, 1): [(14_000, 104_000)],
        (2, 2): [(16_000, 106_000)],
        (3, 1): [(36_000, 96_000)],
        (3, 2): [(38_000, 98_000)],
    }
    rows = pd.read_parquet(tmp_path / "transmissions.parquet")
    for (_, radio), boxes in reserved.items():
        assert all(rows.radio[row] == radio for *_, row, _ in boxes)


def comes(tables: dict[str, list[Any]], channel: Any, seed: int) -> Growing:
    """Return lanes to which the rows of *tables* have come part by part, each table's up to 0.5 s late."""
    found = Growing([TABLES[name] for name in tables], radios=adhoc_radios(channel))
    stream, left, now = random.Random(seed), dict(tables), 0
    while any(left.values()):
        new = {}
        for name, rows in left.items():
            told = now - stream.randrange(S // 2)
            count = next((at for at, row in enumerate(rows) if row[0] > told), len(rows))
            new[name], left[name] = rows[:count], rows[count:]
        found.take(new, Present(now))
        now += stream.randrange(S // 10)
    return found


def of_frames(index: Any, what: str, frame: Any) -> dict[tuple[int, int], list[tuple[int, int, Any, int]]]:
    """Return what ``silences`` does, with *frame*(row) of each box in the place of its row."""
    return {
        place: [(begin, end, frame(row), peer) for begin, end, row, peer in boxes]
        for place, boxes in silences(index, what).items()
    }


@pytest.mark.parametrize("seed", range(2))
def test_a_run_under_way_has_the_lanes_that_its_trace_has(tmp_path: Path, seed: int) -> None:
    settings = {"range_m": 15.0, "rts_threshold": 200}
    wanted = (FRAMES, TRANSMISSIONS, RECEPTIONS, POSES)
    field = Field([(0, 0), (10, 0), (20, 0), (10, 8)], wanted, **settings)
    chance = random.Random(seed)
    for _ in range(200):
        source, to = chance.sample(range(-1, 4), 2)
        if source >= 0:
            field.send_at(chance.randrange(2 * S), source, to, chance.randrange(300))
    field.run(3 * S)
    channel = AdhocSettings(**settings).model_dump(mode="json")
    field.trace.write(tmp_path, {"scenario": json.dumps({"channel": channel})})
    names = (FRAMES.name, TRANSMISSIONS.name, RECEPTIONS.name)
    tables = {name: list(zip(*field.trace.columns(name).values(), strict=True)) for name in names}
    grown = comes(tables, channel, seed)
    rows = pd.read_parquet(tmp_path / "transmissions.parquet")
    of_row = list(zip(rows.time_ns, rows.source, strict=True))
    for what in ("busy", "NAV"):
        whole = of_frames(opened(tmp_path), what, of_row.__getitem__)
        assert of_frames(grown, what, lambda row: tables["transmissions"][row][:2]) == whole
        assert sum(map(len, whole.values())) > 100


@pytest.mark.parametrize("channel", [{"kind": "bluetooth"}, {"kind": "adhoc", "strange": 1}, None])
def test_what_does_not_tell_of_80211_has_no_such_lanes(tmp_path: Path, channel: Any) -> None:
    index = opened(written(tmp_path, EXCHANGE, RECEIVED, channel))
    assert {lane.named.what for lane in index.lanes} == {"sent"}


CCA = 15 * US
"""Time after which a station knows that the medium is busy (IEEE 802.11-1999, clause 15.4.8.4)."""


@pytest.mark.parametrize("settings", [{"range_m": 15.0}, {"propagation": {}, "power_dbm": 5.0}], ids=["disc", "fades"])
def test_nobody_counts_down_while_the_medium_is_busy_or_reserved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any]
) -> None:
    """What a station does is told by its states, which come from the model itself."""
    monkeypatch.setattr(levels, "FEWEST", 100)
    settings |= {"rts_threshold": 200}
    field = Field([(0, 0), (10, 0), (20, 0), (10, 8)], tuple(TABLES.values()), **settings)
    chance = random.Random(1)
    for _ in range(1500):
        source, to = chance.sample(range(-1, 4), 2)
        if source >= 0:
            field.send_at(chance.randrange(4 * S), source, to, chance.randrange(300))
    field.run(5 * S)
    channel = AdhocSettings(**settings).model_dump(mode="json")
    field.trace.write(tmp_path, {"scenario": json.dumps({"channel": channel})})
    index = opened(tmp_path)
    states = pd.read_parquet(tmp_path / "intervals.parquet")
    states = states[states.state.isin(["backoff", "difs", "eifs"])]
    seen = {"busy": 0, "NAV": 0}
    for lane in index.lanes:
        if lane.named.what in seen:
            own = states[states.robot == lane.named.robot]
            begins, ends = lane.boxes.starts, lane.boxes.ends
            assert (begins[1:] > ends[:-1]).all()
            before = np.searchsorted(begins, own.end_ns - CCA)
            last = np.where(before > 0, ends[np.maximum(before - 1, 0)], 0)
            assert (last <= own.start_ns).all()
            assert lane.levels is None or sum(lane.levels.levels[-1].counts) == len(begins)
            seen[lane.named.what] += len(begins)
    assert min(seen.values()) > 100
