"""Marks on the slider of time: those of all events if these are few, else of each kind and robot; and their filters."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.units import S
from cosim.web.marks import MOST_MARKS, marks_of
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from tests.web.browser import Browser, pixels, tab
from tests.web.console import PLAIN
from tests.web.served import Served


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a run in which all mark, robot 2 is killed, and robot 0 answers."""
    folder = tmp_path_factory.mktemp("trace")
    faults = [{"kind": "kill", "robot": 2, "at_s": 4.0}]
    protocol = {"use": "tests.web.console:SPEC", "parameters": {"calls": 8}}
    scenario = Scenario.model_validate(PLAIN | {"faults": faults, "protocol": protocol})
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    run.begin()
    run.operate(0, b"{}")
    run.advance(20 * S)
    run.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


def test_few_events_have_a_mark_each(folder: Path):
    marks, events = Recorded(folder).scene["marks"], pd.read_parquet(folder / "events.parquet")
    told = [(round(time_s * S), robot, marks["kinds"][kind]) for time_s, robot, kind in marks["rows"]]
    assert told == list(zip(events.time_ns, events.source, events.event, strict=True))
    assert marks["kinds"] == ["Answered", "Killed", "Marked"]


def test_of_many_events_each_kind_of_each_robot_keeps_its_first_and_rare_ones_all():
    draws = np.random.default_rng(1)
    times = np.sort(draws.integers(0, 100 * S, 60_000))
    robots, names = draws.integers(0, 5, len(times)), np.where(draws.random(len(times)) < 0.5, "Common", "Usual")
    names[30_000] = "Unique"
    marks = marks_of(times, robots, names)
    told = pd.DataFrame(marks["rows"], columns=["time_s", "robot", "kind"])
    assert MOST_MARKS / 2 < len(told) <= MOST_MARKS
    assert told.time_s.is_monotonic_increasing
    events = pd.DataFrame({"time_s": times / S, "robot": robots, "kind": np.searchsorted(marks["kinds"], names)})
    assert (told.groupby(["robot", "kind"]).time_s.min() == events.groupby(["robot", "kind"]).time_s.min()).all()
    assert set(map(tuple, told.values)) <= set(map(tuple, events.values))
    gaps = told[told.kind < 2].groupby(["robot", "kind"]).time_s.diff().dropna()
    assert gaps.max() < 2 * 100 / (MOST_MARKS // 11) + 1


def test_marks_of_too_many_robots_are_of_any():
    times = np.arange(9000)
    marks = marks_of(times, np.arange(9000), np.where(times % 2, "Odd", "Even"))
    assert {robot for _, robot, _ in marks["rows"]} == {None}
    assert {kind for _, _, kind in marks["rows"]} == {0, 1}
    assert len(marks["rows"]) <= MOST_MARKS


@pytest.fixture
def served(folder: Path) -> Iterator[Served]:
    served = Served(Recorded(folder, playing=False))
    yield served
    served.stop()


def drawn(page: Any) -> list[bool]:
    """Return which of the kinds Answered, Killed and Marked have marks."""
    page.wait_for_timeout(200)
    return [pixels(page, f"kind-{kind}", "marks") > 0 for kind in range(3)]


@pytest.mark.slow
def test_the_filters_of_events_are_those_of_the_marks(browser: Browser, served: Served):
    with tab(browser, served, own=True) as page:
        assert drawn(page) == [True, True, True]
        all_marks = pixels(page, "kind-2", "marks")
        page.select_option("#kind", "Killed")
        assert drawn(page) == [False, True, False]
        page.select_option("#kind", "")
        page.select_option("#of-robot", "2")
        assert drawn(page) == [False, True, True]
        assert 0 < pixels(page, "kind-2", "marks") < all_marks / 2
        page.select_option("#of-robot", "0")
        assert drawn(page) == [True, False, True]
        assert page.get_attribute("#marks", "aria-hidden") == "true"
        assert page.get_by_role("slider", name="Time").is_enabled()
        page.keyboard.press("End")
        page.wait_for_function("() => Number(document.getElementById('scrub').value) > 8")  # the slider is there too
        page.wait_for_selector("#events .sign")
        part = "[row.querySelector('button').textContent, row.querySelector('.sign').style.background]"
        signs = page.eval_on_selector_all("#events li", f"rows => rows.map(row => {part})")
        assert {tuple(sign) for sign in signs} == {("Marked", "var(--kind-2)"), ("Answered", "var(--kind-0)")}


@pytest.mark.slow
def test_marks_are_where_the_slider_has_their_times(browser: Browser, served: Served):
    with tab(browser, served, own=True) as page:
        page.select_option("#kind", "Killed")
        page.wait_for_timeout(200)
        columns = page.evaluate("""() => {
          const canvas = document.getElementById("marks");
          const { data, width, height } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          const seen = new Set();
          for (let at = 3; at < data.length; at += 4) if (data[at]) seen.add(((at - 3) / 4) % width);
          const [left, right] = [Math.min(...seen), Math.max(...seen)];
          return [(left + right + 1) / 2, width];
        }""")
        duration_s = float(page.get_attribute("#scrub", "max"))
        assert (columns[0] - 8) / (columns[1] - 16) == pytest.approx(4.0 / duration_s, abs=0.003)
