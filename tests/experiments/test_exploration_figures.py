"""Figures of explorations: what had been seen when, the map as it grows, and the report that draws them."""

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from cosim.geometry.marking import EMPTY, OCCUPIED, UNKNOWN
from cosim.scenario import Scenario
from cosim.units import S
from experiments.exploration.exploring import COLUMNS, COVERAGE, measure
from experiments.exploration_teams import figures, growing
from experiments.exploration_teams.growing import SHARES, Exploration, chosen, watch

NONE = pd.DataFrame()


@pytest.fixture
def runs() -> pd.DataFrame:
    """Return runs that see a hundredth of the floor in every so many seconds, by algorithm and team size."""
    paces = {"schemas": 10.0, "nearest": 8.0, "utility": 7.0, "assignment": 6.0}
    rows = []
    for floor, (name, pace), robots, replicate in product(("empty", "office"), paces.items(), (1, 4), range(4)):
        axes = {"map": floor, "algorithm": name, "robots": robots, "replicate": replicate}
        seen = {column: 100 * share * pace * (1 + replicate / 10) / robots for column, share in COVERAGE[1].items()}
        ended = {
            "simulated_s": 1500.0,
            "coverage": 1.0,
            "until_95_s": 95 * pace / robots,
            "covered_twice": 0.1 * robots,
        }
        rows.append(axes | seen | ended)
    return pd.DataFrame(rows)


# ---------------------------------------------------------------- one run


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a floor of two small rooms with a door."""
    path = tmp_path_factory.mktemp("floor") / "rooms.yaml"
    walls = [[4.0, 0.0, 4.0, 1.5], [4.0, 3.0, 4.0, 5.0]]
    path.write_text(yaml.safe_dump({"name": "rooms", "bounds_m": [0.0, 0.0, 9.0, 5.0], "walls": walls}))
    return path


def small(room: Path, *sets: str) -> Scenario:
    starts = "scenario.team.starts=[[1, 1], [1, 2]]"
    return chosen([f"scenario.floorplan.map={room}", "robots=2", starts, "scenario.duration_s=120", *sets])


@pytest.fixture(scope="module")
def run(room: Path) -> Exploration:
    return watch(small(room), 1)


@pytest.mark.slow
def test_the_map_is_kept_as_soon_as_so_much_has_been_seen(run: Exploration):
    assert len(run.pictures) > 1
    coverages = [picture.coverage for picture in run.pictures]
    assert coverages[-1] >= 0.99
    for before, coverage in pairwise([0.0, *coverages]):
        assert any(before < share <= coverage for share in SHARES)
    assert all(picture.time % (5 * S) == 0 for picture in run.pictures)
    known = [int((picture.cells != UNKNOWN).sum()) for picture in run.pictures]
    assert known == sorted(set(known))
    last = run.pictures[-1].cells
    assert last.shape == (52, 92)
    assert (last == EMPTY).sum() > 0.95 * 45 / 0.01  # of 9 m x 5 m in cells of 10 cm
    assert (last == OCCUPIED).sum() > 200
    assert run.extent_m == pytest.approx((-0.1, 9.1, -0.1, 5.1))


@pytest.mark.slow
def test_the_ways_are_those_until_the_last_picture(run: Exploration):
    assert set(run.ways) == {0, 1}
    for way, start in zip(run.ways.values(), ((1, 1), (1, 2)), strict=True):
        assert way[0].tolist() == [0.0, *start]
        assert run.pictures[-1].time - 5 * S < way[-1, 0] < run.pictures[-1].time
        steps = np.hypot(*np.diff(way[:, 1:], axis=0).T)
        assert 0 < steps.max() <= 0.03 + 1e-9  # 0.3 m/s, a tenth of a second


@pytest.mark.slow
def test_a_run_that_sees_less_is_watched_to_its_end(room: Path):
    run = watch(small(room, "scenario.duration_s=12"), 1, (0.1, 0.999))
    assert [picture.time for picture in run.pictures] == [5 * S, 12 * S]
    assert run.pictures[-1].coverage < 0.999


@pytest.mark.slow
def test_the_coverage_that_is_watched_is_that_of_the_metrics(room: Path):
    scenario = small(room, "scenario.duration_s=10", "scenario.team.senses.beam_range_m=1")
    plain = scenario.model_dump(mode="json") | {"floorplan": {"map": str(room)}}
    found = measure({"scenario": plain}, 1)
    assert set(found) == {column.name for column in COLUMNS}
    assert watch(scenario, 1).pictures[-1].coverage == found["coverage"]
    # two robots at 0.3 m/s see 95 % of 45 m2 at least, by a range of 1 m and a cell's diagonal
    assert found["bound_s"] == pytest.approx((0.95 * 45 / 2 - np.pi * 1.1414**2) / (2 * 1.1414 * 0.3), rel=0.02)


@pytest.mark.slow
def test_a_run_tells_when_each_tenth_had_been_seen(room: Path):
    plain = small(room).model_dump(mode="json") | {"floorplan": {"map": str(room)}}
    found = measure({"scenario": plain}, 1)
    at = [found[f"seen_{tenth}0_s"] for tenth in range(1, 10)]
    assert at == sorted(at)
    assert at[0] < at[-1] <= found["time_95_s"]
    assert at[4] == found["time_50_s"]


@pytest.mark.slow
def test_the_pictures_are_drawn(run: Exploration, tmp_path: Path):
    growing.draw_growth(run, tmp_path / "growth.png")
    growing.draw_ways(run, tmp_path / "ways.png")
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("growth.png", "ways.png"))


@pytest.mark.slow
def test_the_command_draws_the_run_that_its_words_choose(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "run.png"
    words = [f"scenario.floorplan.map={room}", "robots=1", "scenario.duration_s=6"]
    growing.main([str(path), "--seed", "2", *(word for each in words for word in ("--set", each))])
    assert path.stat().st_size > 10_000
    assert capsys.readouterr().out.strip() == str(path)


@pytest.mark.slow
def test_the_report_watches_the_first_run_of_four_robots_on_the_last_floor(
    runs: pd.DataFrame, run: Exploration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    watched: list[tuple[Scenario, int]] = []
    monkeypatch.setattr(figures, "watch", lambda scenario, seed: watched.append((scenario, seed)) or run)
    names = {path.name for path in figures.draw(runs.assign(seed=runs["replicate"] + 7), NONE, tmp_path)}
    assert names >= {"time_by_size.png", "coverage_over_time.png", "map_growth.png", "ways.png"}
    ((scenario, seed),) = watched
    assert seed == 7
    assert scenario.team.size == 4
    assert scenario.floorplan.map is not None
    assert Path(scenario.floorplan.map).name == "explore_office.yaml"
    assert scenario.protocol.parameters.model_dump()["algorithm"] == "schemas"
