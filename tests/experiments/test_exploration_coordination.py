"""The rows of exploration_teams that a second reading asks for: what holds, fails and stays open, and a bound."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.experiment import load_experiment
from cosim.report.claims import published_claims
from cosim.world.floorplan import FloorplanSettings, load_floorplan
from experiments.exploration.exploring import swept_s
from experiments.exploration_teams.coordination import figures
from tests.checkout import EXPERIMENTS, FLOORS

SHEET = EXPERIMENTS / "exploration_teams" / "coordination" / "sweep.yaml"
NONE = pd.DataFrame()
CLAIMS = {claim.id: claim for claim in published_claims(SHEET.parent)}
FUNCTIONS = sorted(claim.test for claim in CLAIMS.values() if claim.test.isidentifier())
ARMS = [arm.labels for arm in load_experiment(SHEET).arms]
METRICS = {
    "until_95_s": 100.0,
    "bound_s": 50.0,
    "reached": 1.0,
    "blocked_ticks": 0.0,
    "parted_by_escape_m": 2.0,
    "parted_else_m": 1.0,
}


def runs_of(changes: Any) -> pd.DataFrame:
    """Return five runs of each arm of the sheet; *changes* gives other metrics of an arm."""
    return pd.DataFrame(
        {**labels, "replicate": at}
        | {name: value + 0.01 * at * (value > 0) for name, value in (METRICS | changes(labels)).items()}
        for labels in ARMS
        for at in range(5)
    )


def answer(test: str, runs: pd.DataFrame) -> Any:
    return getattr(figures, test)(runs, NONE)[1]


def right(arm: Any) -> dict[str, float]:
    return {"until_95_s": 80.0} if arm["algorithm"] == "utility" else {}


def test_the_sheet_is_exploration_teams_again_but_for_whom_partings_are_asked_of() -> None:
    usual, own = load_experiment(SHEET.parents[1] / "sweep.yaml"), load_experiment(SHEET)
    for base in (usual.base, own.base):
        base["scenario"]["name"] = ""
    assert usual.base["partings"].pop("near_m") is None
    assert own.base["partings"].pop("near_m") == 2 * own.base["scenario"]["team"]["senses"]["beam_range_m"]
    assert own.base == usual.base
    assert usual.seed + usual.replicates < own.seed


@pytest.mark.parametrize("test", FUNCTIONS)
def test_rows_hold_where_the_paper_is_right_and_have_no_data_without_runs(test: str) -> None:
    assert answer(test, runs_of(right)) is True
    assert getattr(figures, test)(NONE, NONE) == ("-", None)


SPOILT = {"parted_by_escape_m": ("parts_near", "parts_more_near"), "parted_else_m": ("diverge_near",)}
"""The rows that a metric refutes."""


@pytest.mark.parametrize("metric", SPOILT)
@pytest.mark.parametrize(("floor", "robots"), [("empty", 4), ("corridor", 8), ("office", 4), ("office", 8)])
def test_rows_fail_with_one_size_of_team_and_on_their_floor_alone(floor: str, robots: int, metric: str) -> None:
    def spoilt(arm: Any) -> dict[str, float]:
        here = arm["map"] == floor and arm["robots"] == robots and arm["algorithm"] == "schemas"
        return right(arm) | ({metric: -2.0} if here else {})

    runs = runs_of(spoilt)
    failed = {test for test in FUNCTIONS if answer(test, runs) is False}
    assert failed == {f"{test}_{floor}" for test in SPOILT[metric]}


@pytest.mark.parametrize("robots", [4, 8])
def test_a_rival_that_is_no_faster_refutes_nothing(robots: int) -> None:
    slow = runs_of(lambda arm: {"until_95_s": 120.0} if arm["robots"] == robots else right(arm))
    assert answer("not_optimal_office", slow) is None


def test_a_single_touch_of_a_thick_wall_refutes_that_there_are_none() -> None:
    runs = runs_of(right)
    here = (runs["map"] == "thick") & (runs["algorithm"] == "schemas") & (runs["replicate"] == 3)
    assert answer("untouched_thick", runs.assign(blocked_ticks=here.astype(float))) is False
    assert answer("untouched_thick", runs.assign(blocked_ticks=(runs["map"] == "office").astype(float))) is True


def test_ratios_are_shown_and_decide_nothing() -> None:
    ratios = [claim for name, claim in CLAIMS.items() if name.startswith("ratio_")]
    assert len(ratios) == 6
    assert all(claim.test.startswith("not comparable: ") for claim in ratios)
    assert {claim.quantity for claim in ratios} == {"until_95_s / bound_s"}


@pytest.mark.parametrize("way_m", [0.0, 3.0, 11.0])
def test_a_disc_that_drives_straight_on_sweeps_as_much_as_the_bound_has_it(way_m: float) -> None:
    """By counting the cells of a fine grid that lie within the range of the way."""
    x, y = np.meshgrid(np.arange(-3, way_m + 3, 0.02), np.arange(-3, 3, 0.02))
    swept_m2 = float(np.count_nonzero(np.hypot(x - np.clip(x, 0, way_m), y) <= 2.5)) * 0.02**2
    assert swept_s(swept_m2 * 4, 4, 2.5, 0.3) == pytest.approx(way_m / 0.3, abs=0.1)
    assert swept_s(swept_m2 / 2, 1, 2.5, 0.3) < way_m / 0.3 or way_m == 0.0
    assert swept_s(1.0, 1, 2.5, 0.3) == 0.0


def test_the_office_with_thick_walls_is_solid_where_the_other_has_a_wall() -> None:
    thin, thick = (load_floorplan(FloorplanSettings(map=f"explore_{name}.yaml"), FLOORS) for name in OFFICES)
    along = np.linspace(0.01, 0.99, 7)[:, None]
    inner = thin.walls_m[:-4]  # the outer ones come last
    points = np.concatenate([a + along * (b - a) for a, b in inner.reshape(-1, 2, 2)])
    assert thick.forbidden(points).all()
    solid_m2 = sum(abs(_area(np.array(ring))) for ring in thick.polygons_m)
    length_m = float(np.hypot(*(inner[:, :2] - inner[:, 2:]).T).sum())
    assert solid_m2 == pytest.approx(0.1 * length_m, rel=0.02)


OFFICES = ("office", "office_thick")


def _area(ring: Any) -> float:
    x, y = ring.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)
