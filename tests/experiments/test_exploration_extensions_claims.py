"""The tests that the published.csv of paper 001's extensions and of its gains name hold, fail and stay open."""

import csv
import math
from collections.abc import Callable
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from experiments.exploration_extensions import figures as extensions
from experiments.exploration_extensions import watching
from experiments.gain_tuning import figures as gains
from experiments.gain_tuning import tuning
from protocols.exploration.parameters import SchemaParameters
from tests.checkout import EXPERIMENTS

MODULES: dict[str, Any] = {"exploration_extensions": extensions, "gain_tuning": gains}
NONE = pd.DataFrame()
REPLICATES = 8
WHOLE = ("reached", "completed")
Row = dict[str, Any]


def claims(name: str) -> list[dict[str, str]]:
    with (EXPERIMENTS / name / "published.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


ROWS = [(name, row["test"]) for name in MODULES for row in claims(name)]


def sweep(axes: dict[str, tuple[Any, ...]], row: Callable[[Row], Row], replicates: int) -> pd.DataFrame:
    rows = []
    for replicate in range(replicates):
        for values in product(*axes.values()):
            arm = dict(zip(axes, values, strict=True))
            noise = 1.0 + 0.01 * np.sin(7 * replicate + 3 * len(rows))
            scattered = {key: value * (1.0 if key in WHOLE else noise) for key, value in row(arm).items()}
            rows.append(arm | {"replicate": replicate} | scattered)
    return pd.DataFrame(rows)


def extended(sign: int, arm: Row) -> Row:
    """Return the metrics of an arm where the paper is right (sign 1), and where it is wrong (sign -1)."""
    kind, right = arm["extension"], sign == 1
    return {
        "until_95_s": 1000.0 * (0.8**sign if kind in ("information", "choice") else 1.0),
        "reached": 1.0,
        "completed": 1.0,
        "coverage": 0.98 if right else 0.9,
        "in_sight": {"visibility": 0.9 if right else 0.3}.get(kind, 0.4),
        "nearest_m": {"visibility": 2.0 if right else 9.0}.get(kind, 6.0),
        "beacon_in_sight": {"leapfrog": 0.8 if right else 0.4}.get(kind, 0.02),
    }


def tuned(sign: int, arm: Row) -> Row:
    better = arm["gains"] == tuning.TUNED
    worth = 0.7 if better and sign == 1 else 1.3 if better else 1.0
    each = dict.fromkeys(tuning.GAINS, 1.0)
    return each | {"cost_s": 100.0 * worth, "until_95_s": 90.0 * worth, "reached": 1.0, "blocked_ticks": 9.0 * worth}


def observed(sign: int, replicates: int) -> pd.DataFrame:
    axes = {"stage": (tuning.EVALUATION,), "gains": (tuning.TRIAL, tuning.TUNED), "number": (0, 1)}
    searched = sweep(
        {"stage": (tuning.SEARCH,), "gains": (tuning.CANDIDATE,), "number": (0, 1)},
        lambda arm: tuned(sign, arm),
        replicates,
    )
    return pd.concat([sweep(axes, lambda arm: tuned(sign, arm), replicates), searched])


def answer(name: str, test: str, sign: int, replicates: int = REPLICATES) -> tuple[str, bool | None]:
    found: tuple[str, bool | None]
    if name == "gain_tuning":
        found = getattr(gains, test)(NONE, observed(sign, replicates))
        return found
    kinds = ("schemas", "information", "choice", "visibility", "leapfrog")
    axes = {"map": tuple(extensions.MAPS), "robots": (2, 4), "extension": kinds}
    found = getattr(extensions, test)(sweep(axes, lambda arm: extended(sign, arm), replicates), NONE)
    return found


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_holds_where_the_paper_is_right(name: str, test: str) -> None:
    words, holds = answer(name, test, 1)
    assert holds is True, words


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_fails_where_the_paper_is_wrong(name: str, test: str) -> None:
    words, holds = answer(name, test, -1)
    assert holds is False, words


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_has_no_data_without_runs_and_stays_open_with_one_replicate(name: str, test: str) -> None:
    assert getattr(MODULES[name], test)(NONE, NONE) == ("-", None)
    words, holds = answer(name, test, 1, replicates=1)
    assert words != "-"
    assert holds is None


def test_gains_that_are_no_slower_stay_open_where_their_runs_were_cut() -> None:
    seen = observed(1, REPLICATES)
    cut = seen.assign(reached=np.where((seen["gains"] == tuning.TUNED) & (seen["replicate"] == 0), 0.9, 1.0))
    assert gains.no_slower(NONE, cut)[1] is None


def test_leapfrog_is_not_reproduced_by_who_sees_standing_robots_as_often_without() -> None:
    axes = {"map": tuple(extensions.MAPS), "robots": (2, 4), "extension": ("schemas", "leapfrog")}
    runs = sweep(axes, lambda arm: extended(1, arm), REPLICATES).assign(beacon_in_sight=0.8)
    assert extensions.leapfrog("office", runs, NONE)[1] is False


def test_figures_and_tables_are_made(tmp_path: Path) -> None:
    kinds = ("schemas", "visibility")
    runs = sweep({"map": tuple(extensions.MAPS), "robots": (2, 4), "extension": kinds}, lambda arm: extended(1, arm), 2)
    seen = observed(1, 3)
    drawn = extensions.draw(runs, NONE, tmp_path) + gains.draw(NONE, seen, tmp_path)
    assert len(drawn) == 4
    assert all(path.stat().st_size > 0 for path in drawn)
    assert extensions.draw(NONE, NONE, tmp_path) == gains.draw(NONE, NONE, tmp_path) == []
    table = gains.tables(NONE, seen)["gains"]
    assert len(table) == 2 * 3
    assert set(tuning.GAINS) < set(table)
    assert gains.tables(NONE, NONE) == {}


# ---------------------------------------------------------------- what robots see of each other

WALL = segment_grid(np.array([[5.0, 0.0, 5.0, 10.0]]))


def told(places: Any, sight_m: float = 5.0) -> dict[str, float]:
    return watching.shares(np.array(places, float), WALL, sight_m)


def test_robots_see_each_other_in_range_and_past_the_walls() -> None:
    near, far, hidden = [[1, 1], [4, 1]], [[1, 1], [1, 7]], [[4, 1], [6, 1]]
    assert told([near, near, far, hidden])["in_sight"] == pytest.approx(1 / 3)  # the first look tells who stands
    assert told([near, near])["in_sight"] == 1.0
    assert told([near, near], sight_m=2.9)["in_sight"] == 0.0
    assert told([near, near, far])["nearest_m"] == pytest.approx((3 + 6) / 2)


def test_a_beacon_is_one_that_stands_in_sight_of_one_that_moves() -> None:
    moved = [[1, 1], [4, 1]], [[1.5, 1], [4, 1]], [[1.5, 1], [4, 1.5]], [[2, 1], [4, 2]], [[2, 1], [4.0, 2]]
    found = told(moved)
    assert found["standing"] == pytest.approx(4 / 8)
    assert found["beacon_in_sight"] == pytest.approx(2 / 4)  # in the third second both moved
    assert math.isnan(told([[[1, 1]], [[2, 1]]])["in_sight"])


# ---------------------------------------------------------------- the search


def settings(**changes: Any) -> tuning.Parameters:
    plain = yaml.safe_load((EXPERIMENTS / "gain_tuning" / "sweep.yaml").read_text(encoding="utf-8"))
    return tuning.Parameters.model_validate(plain["parameters"] | changes)


def test_a_range_goes_from_its_least_to_its_greatest_value_and_back() -> None:
    for given in (tuning.Range(low=0.5, high=2.0), tuning.Range(low=0.5, high=2.0, log=True)):
        assert [given.value(0.0), given.value(1.0)] == pytest.approx([0.5, 2.0])
        for share in (0.0, 0.3, 1.0):
            assert given.share(given.value(share)) == pytest.approx(share)
        assert (given.share(0.1), given.share(9.0)) == (0.0, 1.0)
    assert tuning.Range(low=0.5, high=2.0, log=True).value(0.5) == pytest.approx(1.0)
    assert tuning.Range(low=0.5, high=2.0).value(0.5) == pytest.approx(1.25)


@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges": {}},
        {"ranges": {"frontier_gain": {"low": 1, "high": 2}}},
        {"ranges": {"obstacle_m": {"low": 2, "high": 6}}},
        {"ranges": {"obstacle_m": {"low": 2, "high": 1}}},
        {"ranges": {"obstacle_m": {"low": 0, "high": 1, "log": True}}},
    ],
)
def test_ranges_that_no_exploration_can_have_are_refused(wrong: Row) -> None:
    with pytest.raises(ValidationError):
        settings(**wrong)


def test_no_office_is_trained_on_and_evaluated_or_in_two_searches() -> None:
    every = [
        office
        for stage in (tuning.SEARCH, tuning.EVALUATION)
        for seed in (0, 1, 2, 9000 - 11, 9000 - 10)
        for office in tuning.offices(stage, seed, tuning.MOST_OFFICES)
    ]
    assert len(every) == len(set(every)) == 10 * tuning.MOST_OFFICES
    with pytest.raises(UserError, match="seed"):
        tuning.offices(tuning.SEARCH, 10_000, 1)


def test_gains_and_office_are_set_in_the_scenario() -> None:
    given = settings()
    scenario = given.with_gains({"obstacle_m": 0.7}, 77, 33.0)
    assert (scenario.duration_s, given.with_gains({}, 77).duration_s) == (33.0, 150.0)
    assert scenario.floorplan.office.seed == 77
    assert scenario.protocol.parameters.schemas.obstacle_m == 0.7
    assert given.trial()["obstacle_m"] == SchemaParameters().obstacle_m


@pytest.fixture
def bowl(monkeypatch: pytest.MonkeyPatch) -> tuple[list[list[int]], list[float]]:
    """Let explorations cost least with an obstacle_m of 0.9 and an obstacle_gain of 1; note offices and times."""
    explored: list[list[int]] = []
    lasted: list[float] = []

    def explore(given: Any, gains: Row, offices: list[int], seed: int, longest_s: float) -> dict[str, float]:
        explored.append(offices)
        lasted.append(longest_s)
        cost = 10 + 100 * (gains["obstacle_m"] - 0.9) ** 2 + 10 * math.log(gains["obstacle_gain"]) ** 2
        return {"cost_s": cost, "until_95_s": cost, "coverage": 1.0, "blocked_ticks": 0.0}

    monkeypatch.setattr(tuning, "explore", explore)
    return explored, lasted


def test_the_search_finds_the_gains_that_cost_least_and_evaluates_them_elsewhere(
    bowl: tuple[list[list[int]], list[float]],
) -> None:
    ranges = {"obstacle_m": {"low": 0.3, "high": 1.2}, "obstacle_gain": {"low": 0.05, "high": 3.0, "log": True}}
    given = settings(ranges=ranges, generations=20, popsize=4, training=2, evaluation=3)
    rows = pd.DataFrame(tuning.measure(given.model_dump(mode="json"), 4))
    searched, seen = (rows[rows["stage"] == stage] for stage in (tuning.SEARCH, tuning.EVALUATION))
    assert len(searched) == 4 * 2 * 21
    trial = given.trial()
    assert (
        np.isclose(searched[["obstacle_m", "obstacle_gain"]], [trial["obstacle_m"], trial["obstacle_gain"]])
        .all(axis=1)[: 4 * 2]
        .any()
    )
    tuned_gains = seen[seen["gains"] == tuning.TUNED]
    assert tuned_gains["obstacle_m"].to_list() == pytest.approx([0.9] * 3, abs=0.05)
    assert tuned_gains["obstacle_gain"].to_list() == pytest.approx([1.0] * 3, abs=0.1)
    assert tuned_gains["cost_s"].iloc[0] == searched["cost_s"].min()
    assert seen[seen["gains"] == tuning.TRIAL]["obstacle_m"].to_list() == [trial["obstacle_m"]] * 3
    assert (rows["frontier_m"] == trial["frontier_m"]).all()
    explored, lasted = bowl
    training, evaluation = explored[: len(searched)], explored[len(searched) :]
    assert training == [tuning.offices(tuning.SEARCH, 4, 2)] * len(searched)
    assert lasted == [150.0] * len(searched) + [600.0] * len(evaluation)
    assert evaluation == [[office] for office in tuning.offices(tuning.EVALUATION, 4, 3)] * 2


def test_a_search_is_the_same_for_the_same_seed_only(bowl: tuple[list[list[int]], list[float]]) -> None:
    given = settings(generations=1)
    found = [tuning.search(given, seed) for seed in (1, 1, 2)]
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("time_95_s", "coverage", "blocked", "cost"), [(40.0, 1.0, 3.0, 46.0), (math.nan, 0.8, 0.0, 240.0)]
)
def test_a_candidate_costs_its_time_and_its_contacts(
    monkeypatch: pytest.MonkeyPatch, time_95_s: float, coverage: float, blocked: float, cost: float
) -> None:
    metrics = {"time_95_s": time_95_s, "coverage": coverage, "blocked_ticks": blocked}
    monkeypatch.setattr(tuning, "simulate", lambda scenario, seed: SimpleNamespace(metrics=metrics))
    given = settings(contact_s=2.0)
    found = tuning.explore(given, given.trial(), [5, 6], 1, 200.0)
    assert found["cost_s"] == pytest.approx(cost)
    assert found["reached"] == (not math.isnan(time_95_s))
    assert found["until_95_s"] == (40.0 if found["reached"] else 200.0)
