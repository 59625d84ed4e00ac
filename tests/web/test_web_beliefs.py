"""After any seek the floor shows what robots believed and scanned then, as the tables and the machines have it."""

import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.observation import Observation
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.units import MS, S, Time, to_seconds
from cosim.web.live import Live
from cosim.web.messages import AskMap, AskScan, Pause, Plain, Seek, parsed
from cosim.web.recorded import Recorded
from cosim.web.scans import Scanner
from cosim.web.scenes import scene_of, write_scene
from tests.test_beliefs import EXPLORING, SEEKING, apart, grown
from tests.web.browser import GRAVE, Browser, axe, tab
from tests.web.console import PLAIN
from tests.web.served import Served
from tests.web.test_web_live import Page

TICK = 100 * MS
ERRING = SEEKING | {
    "team": SEEKING["team"]
    | {"senses": SEEKING["team"]["senses"] | {"range_noise_m": 0.05, "false_return_rate": 0.1, "odometry_slip": 0.05}}
}
Scans = dict[tuple[Time, int], np.ndarray[Any, Any]]


def record(plain: dict[str, Any], folder: Path, scans: Scans | None = None) -> Path:
    """Write the trace of a run to *folder*; what each machine is told at each tick by its scanner to *scans*."""
    scenario = Scenario.model_validate(plain)
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    for robot, machine in enumerate(run.machines if scans is not None else []):

        def observe(seen: Observation, now: Time, robot: int = robot, own: Any = machine.observe) -> Any:
            assert scans is not None
            scans[now, robot] = seen.ranges_m.copy()
            return own(seen, now)

        machine.observe = observe  # type: ignore[method-assign]
    outcome = run.run()
    outcome.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


@pytest.fixture(scope="module")
def exploring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(EXPLORING, tmp_path_factory.mktemp("exploring"))


def seek(session: Recorded, time: Time) -> Plain:
    session.wish(Seek(say="seek", time_s=time / S))
    [message], _ = session.look(None)
    beliefs: Plain = message.get("beliefs", {})
    return beliefs


def moments(count: int, end: Time) -> list[Time]:
    """Return instants in no order, half of them just at a tick."""
    draws = np.random.default_rng(26).integers(0, end, count)
    return [int(draw) if at % 2 else int(draw) // TICK * TICK for at, draw in enumerate(draws)]


def states_of(message: Plain) -> np.ndarray[Any, Any]:
    """Return the cells of a message ``map``."""
    cells = np.zeros((message["rows"], message["columns"]), dtype=int)
    for name, state in (("empty", -1), ("occupied", 1)):
        for run in filter(None, message[name].split(",")):
            first, _, last = run.partition("-")
            cells.flat[int(first) : int(last or first) + 1] = state
    return cells


def test_after_any_seek_maps_are_those_of_the_trace(exploring: Path):
    session, maps = Recorded(exploring, lambda: 0.0, playing=False), pd.read_parquet(exploring / "maps.parquet")
    for time in moments(60, 29 * S):
        told = seek(session, time)
        changes = maps[maps.time_ns <= time].groupby("source").size().to_dict()
        assert told["maps"] == [[source, changes[source]] for source in sorted(changes)]
        expected = [grown(maps, robot, time) for robot in changes]
        for robot in changes:
            shown = session.answer(AskMap(say="map", robot=robot))
            assert np.array_equal(states_of(shown), expected[robot]), (robot, time)
            assert shown["maps"] == [[robot, changes[robot]]]
        team = states_of(session.answer(AskMap(say="map", robot=-1)))
        assert np.array_equal(team > 0, np.any([each > 0 for each in expected], axis=0))
        assert np.array_equal(team != 0, np.any([each != 0 for each in expected], axis=0))
    assert session.answer(AskMap(say="map", robot=7))["maps"] == []


def test_after_any_seek_ways_are_those_of_the_trace(exploring: Path):
    session, ways = Recorded(exploring, lambda: 0.0, playing=False), pd.read_parquet(exploring / "ways.parquet")
    counts = set()
    for time in moments(60, 29 * S):
        last = ways[ways.time_ns <= time].groupby("source").last()  # skips what is empty
        last["points"] = ways[ways.time_ns <= time].groupby("source").points.agg(lambda texts: texts.iloc[-1])
        expected = [
            [robot, [[float(value) for value in point.split()] for point in row.points.split(", ")]]
            for robot, row in last.iterrows()
            if row.points
        ]
        shown = seek(session, time).get("ways", [])
        assert [row[:2] for row in shown] == expected
        assert all(math.dist(points[-1], goal) < 0.001 for _, points, goal in shown)
        counts.add(len(shown))
    assert counts == {0, 1, 2} or counts == {1, 2}


@pytest.mark.parametrize("plain", [EXPLORING, ERRING], ids=["known place", "drift, noise, own frames, carried off"])
def test_after_any_seek_a_scan_is_the_one_that_the_robot_had(plain: dict[str, Any], tmp_path: Path):
    scans: Scans = {}
    session = Recorded(record(plain | {"faults": plain["faults"][-1:]}, tmp_path, scans), lambda: 0.0, playing=False)
    compared = met = 0
    for time in moments(40, 10 * S):
        seek(session, time)
        for robot in (0, 1):
            had = scans.get((time // TICK * TICK, robot))
            shown = session.answer(AskScan(say="scan", robot=robot))
            assert shown["time_s"] == to_seconds(time // TICK * TICK)
            if had is None:  # its host was down
                continue
            ranges_m = [math.inf if far_m is None else far_m for far_m in shown["ranges_m"]]
            assert ranges_m == pytest.approx(had, abs=2e-4), (robot, time)
            compared += 1
            met += int(np.isfinite(had).sum())
    assert compared > 60
    assert met > 200


def test_beams_look_where_they_are_drawn(tmp_path: Path):
    session = Recorded(record(SEEKING, tmp_path), lambda: 0.0, playing=False)
    walls = [*SEEKING["floorplan"]["walls"], [0, 0, 9, 0], [9, 0, 9, 6], [9, 6, 0, 6], [0, 6, 0, 0]]
    ends = []
    for time in (2 * S, 8 * S):
        seek(session, time)
        shown = session.answer(AskScan(say="scan", robot=1))
        (x, y), turned = shown["place_m"], shown["turned_rad"]
        for beam, far_m in enumerate(shown["ranges_m"]):
            if far_m is not None:
                angle = turned + 2 * math.pi * beam / len(shown["ranges_m"])
                ends.append((x + far_m * math.cos(angle), y + far_m * math.sin(angle)))
    off = [min(apart(end, [(x1, y1), (x2, y2)]) for x1, y1, x2, y2 in walls) for end in ends]
    assert len(ends) > 10
    assert sorted(off)[len(off) * 3 // 4] < 0.001  # the rest have met the other robot


def test_after_any_seek_estimates_are_those_of_the_tick(tmp_path: Path):
    session = Recorded(record(ERRING, tmp_path), lambda: 0.0, playing=False)
    estimates = pd.read_parquet(tmp_path / "estimates.parquet")
    for time in moments(30, 11 * S):
        at = estimates[estimates.time_ns == time // TICK * TICK]
        shown = seek(session, time)["estimates"]
        assert [row[:2] for row in shown] == [[0, "odometry"], [1, "odometry"]]
        assert np.allclose([row[2:5] for row in shown], at[["x_m", "y_m", "heading_rad"]], atol=1e-6)
        assert all(row[5:] == [None, None, None] for row in shown)


def test_only_what_has_changed_is_sent_again(exploring: Path):
    session = Recorded(exploring, lambda: 0.0, playing=False)
    session.wish(Seek(say="seek", time_s=20.0))
    [first], cursor = session.look(None)
    assert first["beliefs"].keys() == {"maps", "ways"}
    session.wish(parsed('{"say": "step"}'))  # type: ignore[arg-type]
    [second], cursor = session.look(cursor)
    assert "maps" in second.get("beliefs", {"maps"})
    for message in (first, second):
        assert "estimates" not in message.get("beliefs", {})
    assert session.look(cursor)[0] == []


@pytest.fixture
def live() -> Iterator[Live]:
    session = Live(Scenario.model_validate(ERRING | {"faults": []}), 1, playing=True, speed=50.0)
    yield session
    session.close()


def test_a_run_under_way_shows_the_same(live: Live, tmp_path: Path):
    page = Page(live)
    page.until(lambda message: message["say"] == "now" and message["time_s"] > 3)
    live.wish(Pause(say="pause"))
    paused = page.until(lambda message: message["say"] == "now" and message["state"] == "paused")
    time = round(paused["time_s"] * S)
    shown = {"scan": live.answer(AskScan(say="scan", robot=0))}
    believed: Plain = {}
    for message in page.messages:
        believed |= message.get("beliefs", {})
    recorded = Recorded(record(ERRING | {"faults": []}, tmp_path), lambda: 0.0, playing=False)
    expected = seek(recorded, time)
    assert believed["ways"] == expected["ways"]
    assert believed["estimates"] == expected["estimates"]
    again = recorded.answer(AskScan(say="scan", robot=0))
    assert shown["scan"].pop("ranges_m") == pytest.approx(again.pop("ranges_m"), abs=2e-4)
    assert shown["scan"].pop("turned_rad") == pytest.approx(again.pop("turned_rad"))
    assert shown["scan"] == again


def test_a_run_under_way_is_paused_and_looked_at_while_a_scan_is_computed(live: Live, monkeypatch: pytest.MonkeyPatch):
    page = Page(live)
    page.until(lambda message: message["say"] == "now" and message["time_s"] > 1)
    scan, done = Scanner.scan, threading.Event()

    def pause() -> None:
        live.wish(Pause(say="pause"))
        page.until(lambda message: message["say"] == "now" and message["state"] == "paused")
        done.set()

    def scanned(*given: Any) -> Plain:
        threading.Thread(target=pause, daemon=True).start()
        assert done.wait(30)
        return scan(*given)

    monkeypatch.setattr(Scanner, "scan", scanned)
    assert live.answer(AskScan(say="scan", robot=0))["robot"] == 0


def test_a_map_of_a_run_under_way_is_that_of_the_machine():
    session = Live(Scenario.model_validate(EXPLORING | {"faults": []}), 1, playing=True, speed=50.0)
    page = Page(session)
    page.until(lambda message: message["say"] == "now" and message["time_s"] > 3)
    session.close()
    machine = session._simulation.machines[1]
    shown = session.answer(AskMap(say="map", robot=1))
    assert np.array_equal(states_of(shown), np.sign(machine.belief.evidence))


def test_what_cannot_be_answered_is_told_in_a_line(exploring: Path, tmp_path: Path):
    session = Recorded(exploring, lambda: 0.0, playing=False)
    with pytest.raises(UserError, match="there is no robot 2"):
        session.answer(AskScan(say="scan", robot=2))
    record(ERRING | {"duration_s": 1, "faults": []}, tmp_path)
    (tmp_path / "estimates.parquet").unlink()
    with pytest.raises(UserError, match="does not tell how robots take themselves to head"):
        Recorded(tmp_path, lambda: 0.0, playing=False).answer(AskScan(say="scan", robot=0))


def test_robots_without_a_view_have_no_scanner():
    scenario = Scenario.model_validate(PLAIN)
    assert scene_of(scenario, Simulation(scenario, 1).floorplan, 1)["scanner"] is None


# ---------------------------------------------------------------- the page


@pytest.mark.slow
def test_layers_of_beliefs_go_on_and_off_and_are_told_in_words(browser: Browser, exploring: Path):
    served = Served(Recorded(exploring, playing=False))
    with tab(browser, served, own=True) as page:

        def until(condition: str) -> None:
            page.wait_for_function(
                f"() => {{ const {{ map, ways, scan }} = cosim.seen().beliefs; return {condition}; }}"
            )

        page.locator("#scrub").fill("20")
        until("map?.robot === -1 && map.empty > 0 && scan === null && ways.length > 0")
        page.click("#robots button >> nth=1")
        until("map?.robot === 1")
        page.locator("#legend button[data-layer=scans]").focus()
        page.keyboard.press("Enter")
        until("scan?.robot === 1 && scan.time_s === 20")
        page.wait_for_function("() => /layers=[a-z,]*scans/.test(location.hash) && /robot=1/.test(location.hash)")
        page.wait_for_function(
            "() => /beams meet something/.test(document.getElementById('floor-beliefs').textContent)"
        )
        words = page.inner_text("#floor-beliefs")
        assert "known as empty" in words
        assert "the goal is at" in words
        before = page.evaluate("cosim.seen().beliefs.map.empty")
        page.locator("#scrub").fill("5")
        until(f"scan?.time_s === 5 && map?.empty < {before}")
        page.locator("#legend button[data-layer=maps]").click()
        page.locator("#legend button[data-layer=scans]").click()
        until("map === null && scan === null")
        page.evaluate(axe())
        assert page.evaluate(GRAVE) == []
    served.stop()
