"""Deployments from places that are drawn: they fit, are the same for all arms of a replicate, and are carried out."""

import json
import math
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from cosim.experiment import load_experiment
from cosim.scenario import load
from cosim.simulation import Simulation
from experiments.deployment import deploying
from experiments.deployment.deploying import COLUMNS, Parameters, measure
from tests.checkout import EXPERIMENTS

NAMES = ("deployment_strategies", "deployment_wean")


def parameters(name: str, **scenario: Any) -> dict[str, Any]:
    given = yaml.safe_load((EXPERIMENTS / name / "sweep.yaml").read_text(encoding="utf-8"))["parameters"]
    plain: dict[str, Any] = deepcopy(given)
    plain["scenario"]["floorplan"]["map"] = str(
        EXPERIMENTS / "floors" / Path(plain["scenario"]["floorplan"]["map"]).name
    )
    plain["scenario"] |= scenario
    return plain


def starts(name: str, seed: int) -> tuple[tuple[float, float], ...]:
    found = Parameters.model_validate(parameters(name)).placed(seed).team.starts
    assert found is not None
    return found


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_is_ready_to_run(name: str) -> None:
    found = load_experiment(EXPERIMENTS / name / "sweep.yaml", quick=True)
    assert found.arms
    assert found.settings.run is not None


SHEETS = [*((name, "alternatives") for name in NAMES), ("deployment_wean", "positions")]


@pytest.mark.parametrize(("name", "sheet"), SHEETS)
def test_the_alternatives_are_ready_to_run(name: str, sheet: str) -> None:
    found = load_experiment(EXPERIMENTS / name / f"{sheet}.yaml")
    assert found.arms
    for arm in found.arms:
        plain = deepcopy(arm.parameters)
        plain["scenario"]["floorplan"] = parameters(name)["scenario"]["floorplan"]
        Parameters.model_validate(plain)


def test_with_true_positions_the_runs_are_those_of_the_sweep_and_else_odometry_errs() -> None:
    sheets = (load_experiment(EXPERIMENTS / "deployment_wean" / f"{name}.yaml") for name in ("positions", "sweep"))
    chosen, usual = ({tuple(arm.labels.values()): deepcopy(arm.parameters) for arm in each.arms} for each in sheets)
    found = dict[tuple[Any, ...], tuple[Any, ...]]()
    for labels, plain in (*chosen.items(), *usual.items()):
        senses, own = plain["scenario"]["team"]["senses"], plain["scenario"]["protocol"]["parameters"]
        errs = [senses.pop(name) > 0 for name in ("odometry_slip", "odometry_turn_rad", "range_noise_m")]
        found[labels] = own["positioning"].pop("kind"), *errs
        del plain["scenario"]["name"]
    for network, calls in usual:
        if calls != "deploy":
            continue
        plain = usual[network, calls]
        assert [chosen[name, network] == plain for name in ("true", "mcl", "odometry")] == [True] * 3
        assert found["true", network] == found[network, calls] == ("given", False, False, False)
        assert found["mcl", network] == ("mcl", True, True, True)
        assert found["odometry", network] == ("given", True, True, True)


@pytest.mark.parametrize("name", NAMES)
def test_robots_start_in_their_square_and_apart(name: str) -> None:
    own = Parameters.model_validate(parameters(name))
    places = {"deployment_strategies": (4.0, 4.0), "deployment_wean": (3.0, 34.0)}
    for seed in range(20):
        found = starts(name, seed)
        assert len(found) == 4
        for number, start in enumerate(found):
            off = [abs(a - b) for a, b in zip(start, places[name], strict=True)]
            assert off[0] <= own.starts.half_m[0] + 1e-3
            assert off[1] <= own.starts.half_m[1] + 1e-3
            assert all(math.dist(start, other) >= own.starts.apart_m for other in found[:number])


def test_starts_come_from_the_seed_alone() -> None:
    assert starts("deployment_wean", 3) == starts("deployment_wean", 3) != starts("deployment_wean", 4)
    other = parameters("deployment_wean", channel={"kind": "adhoc", "range_m": 50})
    assert Parameters.model_validate(other).placed(3).team.starts == starts("deployment_wean", 3)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"starts": {"base": "nowhere", "half_m": [2, 2], "apart_m": 1}}, "nowhere"),
        ({"starts": {"base": "base", "half_m": [1, 1], "apart_m": 9}}, "room"),
        ({"posts": "base"}, "base"),
    ],
)
def test_what_does_not_fit_is_refused(changes: Mapping[str, Any], wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deploying, "ATTEMPTS", 3)
    with pytest.raises(ValidationError, match=wrong):
        Parameters.model_validate(parameters("deployment_strategies") | changes)


@pytest.mark.slow
@pytest.mark.parametrize("size", [2, 8])
def test_a_team_gets_as_many_posts_as_it_has_robots(size: int) -> None:
    plain = parameters("deployment_strategies")
    plain["scenario"]["team"]["size"] = size
    scenario = Parameters.model_validate(plain).placed(1)
    (timed,) = scenario.protocol.parameters.calls  # type: ignore[attr-defined]
    assert len(timed.call.places) == size
    assert timed.call.places[0] == (14.0, 4.0)


@pytest.mark.slow
def test_the_typical_scenario_is_carried_out() -> None:
    """With coarser ticks and cells than the experiment's, which cost twice as much."""
    plain = parameters("deployment_wean", tick_s=0.2)
    plain["scenario"]["protocol"]["parameters"]["driving"]["cell_m"] = 0.2
    found = measure(plain, 1)
    assert set(found) == {column.name for column in COLUMNS}
    assert found["deployed"] == found["places_held"] == 1.0
    # ordered 5 s apart; of its first metre the slowest body makes 0.42 m in 1.67 s and the rest in 1.17 s, the quickest
    # all in 2 s
    assert found["leap_ahead_s"] >= 5.0 - (2.84 - 2.0)
    assert found["collisions"] == found["wall_contacts"] == 0
    assert 45.0 < found["way_m"] < 60.0
    assert found["until_deployed_s"] == found["deployment_s"] > 16.0 * 2 / 0.95


@pytest.mark.slow
def test_the_team_of_the_playbook_is_deployed_and_comes_home() -> None:
    """With coarser ticks and cells than the playbook's, which cost twice as much."""
    choices = {"crossing": "B", "leap_places": ["C", "D"], "group_places": ["E", "F"]}
    calls = [
        {"at_s": 0, "call": {"play": "wean", "parameters": choices}},
        {"at_s": 200, "call": {"play": "return", "parameters": {"robots": 4}}},
    ]
    own = [f"protocol.parameters.calls={json.dumps(calls)}", "tick_s=0.2", "protocol.parameters.driving.cell_m=0.2"]
    run = Simulation(load(EXPERIMENTS / "deployment_wean" / "playbook.yaml", own), 1)
    starts_m = run.fleet.positions_m.copy()
    metrics = run.run().metrics
    assert (metrics["plans_done"], metrics["refused"], metrics["robots_lost"]) == (2.0, 0.0, 0.0)
    assert np.hypot(*(run.fleet.positions_m - starts_m).T).max() < 0.3
    assert metrics["way_m"] > 2 * 45.0, "in the mean, there and back"


@pytest.mark.slow
def test_a_deployment_that_does_not_come_to_its_end_counts_with_the_longest_run() -> None:
    found = measure(parameters("deployment_wean", duration_s=5), 1)
    assert math.isnan(found["deployment_s"])
    assert found["until_deployed_s"] == 5
    assert found["deployed"] == 0.0
    assert math.isnan(found["leap_ahead_s"])
