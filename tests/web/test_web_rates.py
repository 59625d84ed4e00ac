"""Payloads delivered and frames lost in parts of a window, against the tables of a run; and their curves."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.timeline.lanes import Boxes, Lane
from cosim.timeline.rates import rates
from cosim.timeline.rows import lane_name
from cosim.trace import TABLES
from cosim.units import S
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.timeline import AskRates
from tests.web.browser import Browser, pixels, tab
from tests.web.console import PLAIN
from tests.web.served import Served


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a run of three robots that call out to all."""
    folder = tmp_path_factory.mktemp("trace")
    protocol = {"use": "tests.web.console:SPEC", "parameters": {"calls": 8}}
    scenario = Scenario.model_validate(PLAIN | {"protocol": protocol})
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    run.begin()
    run.advance(20 * S)
    run.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


def test_what_is_delivered_is_what_messages_say(folder: Path):
    asked = AskRates(say="rates", number=4, from_ns="500000000", to_ns="6500000000", step_ns="700000000")
    told = Recorded(folder).timeline.answer(asked)
    assert isinstance(told, dict)
    edges = 500_000_000 + 700_000_000 * np.arange(10)
    times = pd.read_parquet(folder / "messages.parquet").time_ns.to_numpy()
    expected = [int(((times >= low) & (times < high)).sum()) for low, high in pairwise(edges)]
    assert told["delivered"] == expected
    assert sum(expected) > 6
    assert (told["number"], told["lost"]) == (4, [0] * 9)


def test_lost_frames_are_counted_where_they_begin():
    starts = np.arange(0, 100, 10)
    outcomes = np.array([0, 1, 0, 1, 1, 0, 0, 0, 0, 1], dtype=np.uint8)
    columns = dict.fromkeys(("kinds", "rows", "peers"), np.zeros(10, dtype=np.int64))
    boxes = Boxes(starts=starts, ends=starts + 5, outcomes=outcomes, **columns)
    lanes = [Lane(lane_name(what, (0, 0, 0), False), "frames", boxes) for what in ("received", "sent")]
    found = rates(lanes, 10, 20, 4, np.array([False, True]))
    assert (found.lost.tolist(), found.delivered.tolist()) == ([1, 2, 0, 0], [0] * 4)


@pytest.mark.parametrize("words", [("0", "-1", "1"), ("0", "10", "0"), ("0", "100000", "1")])
def test_what_cannot_be_counted_is_told(folder: Path, words: tuple[str, str, str]):
    asked = dict(zip(("from_ns", "to_ns", "step_ns"), words, strict=True))
    with pytest.raises(UserError, match="rates: expected"):
        Recorded(folder).timeline.answer(AskRates(say="rates", number=1, **asked))


@pytest.mark.slow
def test_curves_are_under_the_lanes(browser: Browser, folder: Path):
    served = Served(Recorded(folder, playing=False))
    with tab(browser, served, own=True) as page:
        assert not page.locator(".tl-plots").is_visible()  # lanes come first where there is little room
        page.set_viewport_size({"width": 1366, "height": 1080})
        page.wait_for_function("() => document.querySelector('.tl-plots output').textContent.includes('delivered/s')")
        page.evaluate("document.querySelector('.tl-plots canvas').id = 'curves'")
        assert pixels(page, "accent", "curves") > 20
        assert pixels(page, "bad", "curves") == 0
        lanes, curves = (page.locator(part).bounding_box() for part in (".tl-stage", ".tl-plots canvas"))
        assert (curves["x"], curves["width"]) == (
            pytest.approx(lanes["x"], abs=1),
            pytest.approx(lanes["width"], abs=1),
        )
    served.stop()
