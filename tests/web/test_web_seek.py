"""After any seek a page shows all that was in the air or linked then, as the tables of the run have it."""

from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import INTERVALS, TABLES, TableFile, Trace
from cosim.units import MS, S, Time
from cosim.web.air import GLOW_S, MOST_FRAMES, RecentAir, StoredAir
from cosim.web.air import Frame as Shown
from cosim.web.messages import Plain, Seek, Speed, Step
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.spans import FiledSpans, Spans
from tests.web.browser import Browser, tab
from tests.web.served import Served

PICONET: dict[str, Any] = {
    "name": "piconet",
    "duration_s": 30,
    "floorplan": {"map": "walls", "bounds_m": [0, 0, 20, 10]},
    "team": {"size": 4},
    "channel": {"kind": "bluetooth", "range_m": 40, "idle_frames": True, "t_poll_slots": 40},
    "protocol": {"use": "pseudonet", "parameters": {"algorithm": "spanning_tree"}},
    "faults": [{"kind": "kill", "robot": 2, "at_s": 12.0}],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a piconet that is set up, and loses a slave."""
    folder = tmp_path_factory.mktemp("piconet")
    scenario = Scenario.model_validate(PICONET)
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    outcome = run.run()
    outcome.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


@pytest.fixture(scope="module")
def frames(folder: Path) -> pd.DataFrame:
    table = pd.read_parquet(folder / "frames.parquet")
    return table.assign(end_ns=table.time_ns + table.duration_ns)


@pytest.fixture
def paused(folder: Path) -> Recorded:
    return Recorded(folder, lambda: 0.0, playing=False)


def moments(frames: pd.DataFrame) -> list[Time]:
    """Return a hundred instants: at the edges of frames, in the middle of them, and anywhere."""
    draws = np.random.default_rng(26)
    chosen = frames.sample(25, random_state=26)
    edges = [*chosen.time_ns, *(chosen.end_ns - 1), *((chosen.time_ns + chosen.end_ns) // 2)]
    return [int(time) for time in (*edges, *draws.integers(0, 30 * S, 25))]


def seek(session: Recorded, time: Time) -> Plain:
    session.wish(Seek(say="seek", time_s=time / S))
    [message], _ = session.look(None)
    assert message["time_s"] == time / S
    return message


def linked(folder: Path, time: Time) -> set[tuple[str, int, int]]:
    """Return who has a link to whom at *time*, in which role."""
    intervals = pd.read_parquet(folder / "intervals.parquet")
    own = intervals[intervals.state.isin(["master", "slave"])]
    if len(own):
        at = own[(own.start_ns <= time) & (time < own.end_ns)]
        return {(row.state, row.robot, int(row.detail.split("=")[1].split()[0])) for row in at.itertuples()}
    news = pd.read_parquet(folder / "links.parquet")
    news = news[news.event.isin(["Connected", "Lost"]) & (news.time_ns <= time)]
    last = news.groupby(["source", "peer"]).last().reset_index()
    return {(row.detail, row.source, row.peer) for row in last.itertuples() if row.event == "Connected"}


def changes(folder: Path) -> list[Time]:
    """Return when links come and go, and the instants just before."""
    intervals, news = (pd.read_parquet(folder / f"{name}.parquet") for name in ("intervals", "links"))
    own = intervals[intervals.state.isin(["master", "slave"])]
    at = {*own.start_ns, *own.end_ns, *news[news.event.isin(["Connected", "Lost"])].time_ns} - {own.end_ns.max()}
    return [int(time) + before for time in at for before in (-1, 0)]


def test_after_a_hundred_seeks_all_is_shown_that_was_in_the_air(paused: Recorded, frames: pd.DataFrame):
    flying = 0
    for time in moments(frames):
        told = seek(paused, time)
        at = frames[(frames.time_ns <= time) & (time < frames.end_ns)]
        expected = Counter(zip(at.source, at.destination, at.kind, at.channel, at.outcome, strict=True))
        shown = Counter((row[2], row[3], row[4], row[7], row[5]) for row in told["frames"] if row[1] > told["time_s"])
        assert shown == expected
        flying += len(at)
    assert flying > 75


def test_after_a_hundred_seeks_every_frame_is_counted(paused: Recorded, frames: pd.DataFrame):
    for time in moments(frames):
        told = seek(paused, time)
        begun = frames[frames.time_ns <= time]
        lost = (begun.outcome != "received").sum()
        assert (told["frames_seen"], told["frames_lost"]) == (len(begun), lost)
        late = frames[(frames.time_ns <= time) & (frames.end_ns > time - GLOW_S * S)]
        assert len(told["frames"]) + told["frames_left_out"] == len(late)


def test_after_a_hundred_seeks_all_links_are_shown_that_there_were(
    paused: Recorded, folder: Path, frames: pd.DataFrame
):
    seen = set()
    for time in (*moments(frames), *changes(folder)):
        told = seek(paused, time)
        shown = {
            (state, robot, int(detail.split("=")[1].split()[0]))
            for state, robot, _, _, detail, *_ in told["doing"]
            if state in ("master", "slave")
        }
        assert shown == linked(folder, time)
        seen.add(len(shown))
    assert {0, 6} <= seen  # none, and all of three links from either end


def test_frames_fade_by_the_clock_of_the_run(paused: Recorded, frames: pd.DataFrame):
    time = int(frames.time_ns.iloc[len(frames) // 2])
    for speed in (0.01, 0.1, 1.0):
        paused.wish(Speed(say="speed", speed=speed))
        told = seek(paused, time)
        late = frames[(frames.time_ns <= time) & (frames.end_ns > time - GLOW_S * speed * S)]
        assert len(told["frames"]) + told["frames_left_out"] == len(late)
        assert told["frames_left_out"] == 0


def test_frames_that_are_too_many_are_left_out_and_said(paused: Recorded, frames: pd.DataFrame):
    paused.wish(Speed(say="speed", speed=100.0))
    told = seek(paused, 20 * S)
    begun = int((frames.time_ns <= 20 * S).sum())
    assert begun > 2 * MOST_FRAMES
    assert len(told["frames"]) == MOST_FRAMES
    assert told["frames_left_out"] == begun - MOST_FRAMES


def test_steps_go_from_frame_to_frame_and_from_slot_to_slot(paused: Recorded, frames: pd.DataFrame):
    starts = frames.time_ns.unique()
    seek(paused, int(starts[100]))
    for by, count, expected in (
        ("frame", 1, starts[101]),
        ("frame", 3, starts[104]),
        ("frame", -4, starts[100]),
        ("slot", 2, starts[100] + 2 * 625_000),
        ("slot", -2, starts[100]),
        ("tick", 1, starts[100] + 100 * MS),
        ("frame", -1000, 0),
    ):
        paused.wish(Step(say="step", by=by, count=count))
        [message], _ = paused.look(None)
        assert message["time_s"] == expected / S, (by, count)


def test_a_step_back_to_an_event_shows_it_as_the_latest(paused: Recorded):
    seek(paused, 12 * S + 1)
    for by, count in (("event", -1), ("event", -1), ("event", 1)):
        paused.wish(Step(say="step", by=by, count=count))
        [message], _ = paused.look(None)
        assert message["events"][-1][1] == message["time_s"]


def test_spans_are_found_whatever_their_length():
    draws = np.random.default_rng(1)
    starts = np.sort(draws.integers(0, 10**6, 20_000))
    ends = starts + np.where(draws.random(20_000) < 0.001, 10**6, draws.integers(0, 50, 20_000))
    edges = [0, 7000, 7001, 15_000, 20_000]
    parts = [Spans(starts[a:b], ends[a:b]) for a, b in pairwise(edges)]
    spans = FiledSpans(edges[1:], lambda at: parts[at])
    assert (len(spans), spans.last) == (20_000, ends.max())
    for time in [0, 10**6, *starts[[6999, 7000, 7001]].tolist(), *draws.integers(0, 2 * 10**6, 50).tolist()]:
        assert spans.begun(time) == (starts <= time).sum()
        for longer in (0, 1000, 400_000):
            expected = np.flatnonzero((starts <= time) & (time < ends + longer))
            assert np.array_equal(spans.at(time, longer), expected)


def test_a_run_under_way_shows_what_a_recorded_one_does(folder: Path, frames: pd.DataFrame):
    stored, recent = StoredAir(TableFile(folder / "frames.parquet")), RecentAir()
    rows = frames.sort_values("end_ns", kind="stable").to_dict("records")
    time = int(frames.end_ns.iloc[-1]) + 1
    for row in rows:
        named = {name: row[name] for name in Shown._fields[2:-1]}
        recent.append(Shown(row["time_ns"], row["end_ns"], **named, radio=0))
    for speed in (0.1, 1.0):
        one, two = stored.at(time, speed), recent.at(time, speed)
        assert sorted(one.pop("frames")) == sorted(two.pop("frames"))
        assert one == two


def test_intervals_that_last_until_the_end_are_shown_there(folder: Path, tmp_path: Path):
    (tmp_path / "poses.parquet").write_bytes((folder / "poses.parquet").read_bytes())
    end = int(pd.read_parquet(tmp_path / "poses.parquet").time_ns.max())
    trace = Trace([INTERVALS])
    trace.row(INTERVALS, S, 0, end, 0, "master", "slave=1 lt_addr=1")
    trace.row(INTERVALS, 2 * S, 1, 3 * S, 0, "slave", "master=0 lt_addr=1")
    trace.write(tmp_path)
    session = Recorded(tmp_path, lambda: 0.0, playing=False)
    told = [seek(session, time)["doing"] for time in (S - 1, S, 3 * S - 1, 3 * S, end)]
    assert [[state for state, *_ in rows] for rows in told] == [[], ["master"], ["master", "slave"], *[["master"]] * 2]


def test_the_last_interval_is_over_when_it_ends_before_the_run_does(folder: Path, tmp_path: Path):
    (tmp_path / "poses.parquet").write_bytes((folder / "poses.parquet").read_bytes())
    trace = Trace([INTERVALS])
    trace.row(INTERVALS, 2 * S, 1, 3 * S, -1, "crashed", "")
    trace.write(tmp_path)
    session = Recorded(tmp_path, lambda: 0.0, playing=False)
    told = [seek(session, time)["doing"] for time in (2 * S, 3 * S - 1, 3 * S, 20 * S)]
    assert [[state for state, *_ in rows] for rows in told] == [["crashed"], ["crashed"], [], []]


@pytest.mark.slow
def test_the_page_draws_after_a_seek_what_the_tables_say(browser: Browser, folder: Path, frames: pd.DataFrame):
    session = Recorded(folder, playing=False)
    served = Served(session)
    with tab(browser, served) as page:
        for time in moments(frames):
            session.wish(Seek(say="seek", time_s=time / S))
            page.wait_for_function("time_s => cosim.seen().time_s === time_s", arg=time / S)
            page.evaluate("() => new Promise(requestAnimationFrame)")
            page.evaluate("() => new Promise(requestAnimationFrame)")
            seen = page.evaluate("cosim.seen()")
            at = frames[(frames.time_ns <= time) & (time < frames.end_ns)]
            flying = Counter(
                (f["source"], f["destination"], f["kind"]) for f in seen["frames"] if f["end_s"] > time / S
            )
            assert flying == Counter(zip(at.source, at.destination, at.kind, strict=True))
            expected = linked(folder, time)
            assert {(each["master"], each["slave"]) for each in seen["links"]} == {
                (robot, peer) if state == "master" else (peer, robot) for state, robot, peer in expected
            }
            assert seen["counts"]["frames"] == (frames.time_ns <= time).sum()
    served.stop()
