"""Deploying by a map just made: the experiment runs, and its claims hold, fail and stay open."""

import json
import math
import re
from copy import deepcopy
from itertools import product
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.experiment import load_experiment
from cosim.report.claims import judge, published_claims
from cosim.simulation import Simulation
from cosim.units import S
from experiments.deployment_learned_map import figures
from experiments.deployment_learned_map.learning import COLUMNS, Parameters, measure
from tests.checkout import EXPERIMENTS

FOLDER = EXPERIMENTS / "deployment_learned_map"
CLAIMS = {claim.id: claim for claim in published_claims(FOLDER)}
NONE = pd.DataFrame()
FLOOR_M2 = 6 * 8 + 21.8 * 2.4 + 2.4 * 68
"""The laboratory, the corridor to the intersection, the corridors from there: floors/wean.yaml."""


def parameters(**scenario: Any) -> dict[str, Any]:
    given: dict[str, Any] = yaml.safe_load((FOLDER / "sweep.yaml").read_text(encoding="utf-8"))["parameters"]
    plain = deepcopy(given)
    plain["scenario"]["floorplan"]["map"] = str(FOLDER.parent / "floors" / "wean.yaml")
    plain["scenario"] |= scenario
    return plain


def runs_of(right: bool, replicates: int) -> pd.DataFrame:
    rows = []
    for replicate in range(replicates):
        for kind, explorers, network in product(("learned", "given"), figures.EXPLORERS, figures.NETWORKS):
            lost = kind == "learned" and not right
            row = {"map": kind, "explorers": explorers, "network": network, "replicate": replicate}
            found = {"deployed": 0.0 if lost else 1.0, "returned_s": math.nan if lost else 100.0}
            rows.append(row | found | {"collisions": 0.0, "wall_contacts": float(lost)})
    return pd.DataFrame(rows)


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_claim_holds_and_fails_and_stays_open(claim: str) -> None:
    sweeps = (runs_of(True, 30), runs_of(False, 30), runs_of(True, 1), NONE)
    verdicts = [judge(CLAIMS[claim], runs, NONE, figures).verdict for runs in sweeps]
    assert verdicts == ["holds", "fails", "holds" if claim == "touches_nothing" else "open", "no data"]


def test_one_number_of_explorers_with_which_it_fails_is_enough() -> None:
    runs = runs_of(True, 30)
    runs.loc[(runs["map"] == "learned") & (runs["explorers"] == 4), "deployed"] = 0.0
    assert getattr(figures, "deploys_ideal")(runs, NONE)[1] is False  # noqa: B009
    runs = runs_of(True, 30)
    runs.loc[runs["map"] == "given", "deployed"] = 0.0
    assert getattr(figures, "deploys_ideal")(runs, NONE)[1] is True  # noqa: B009


def test_the_experiment_is_ready_to_run() -> None:
    found = load_experiment(FOLDER / "sweep.yaml")
    assert len(found.arms) == 2 * len(figures.EXPLORERS) * len(figures.NETWORKS)


def answered(plain: dict[str, Any], call: dict[str, Any]) -> dict[str, Any]:
    """Return what the host's console says to *call* before anything has happened."""
    run = Simulation(Parameters.model_validate(plain).placed(1), 1)
    run.begin()
    run.operate(0, json.dumps({"request": 1, "say": "call", "call": call}).encode())
    run.advance(S)
    said = [json.loads(each.payload) for each in run.said()]
    (answer,) = [each for each in said if each.get("answer") == 1]
    return answer


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "call", "deadline_s", "drives_m"),
    [
        ("given", {"play": "explore", "parameters": {"robots": 2}}, 5.0, 0.0),
        ("learned", {"play": "explore", "parameters": {"robots": 2}}, 5.0, 0.0),
        ("given", {"play": "survey", "places": ["B", "C"]}, 60.0, 42.0),
    ],
    ids=["explore", "explore a floor of which only places are known", "survey"],
)
def test_a_floor_that_is_too_large_for_the_time_is_refused_with_a_least_time_that_is_true(
    kind: str, call: dict[str, Any], deadline_s: float, drives_m: float
) -> None:
    """Paper 004, section 4: "map an area that is too large for them to cover in the required time".

    The farthest place is 58 m from A; of a floor that is to be learned nobody knows the way, only where the place is.
    Somebody has to come within 13 m of it at 0.3 m/s; all start within 3.4 m of A. Then the team drives at 0.5 m/s.
    """
    plain = parameters()
    plain["scenario"]["protocol"]["parameters"] |= {"map": kind, "calls": []}
    play, deadline = call["play"], {"kind": "deadline", "seconds": deadline_s}
    refusal = answered(plain, call | {"constraints": [deadline]})
    assert (refusal["say"], len(refusal["conflicts"]), len(refusal["mend"])) == ("refusal", 2, 1)
    assert refusal["conflicts"][0] == f"the call: {play} ends at most {deadline_s:g} s after the plan begins"
    (least_s,) = map(float, re.findall(rf"^{play}/explore: exploring takes at least (\S+) s$", refusal["conflicts"][1]))
    far_m = 58.0 if kind == "given" else math.hypot(26.0, 32.0)
    assert 0.85 * (far_m - 3.4 - 13.2) / 0.3 < least_s < (far_m + 2.0 + 3.4 - 13.0) / 0.3
    (instead,) = refusal["calls"].values()
    (relaxed,) = instead["constraints"]
    assert relaxed["seconds"] - least_s >= max(0.9 * drives_m / 0.5, -0.05)
    assert answered(plain, instead)["say"] == "plan"


@pytest.mark.slow
def test_a_team_explores_returns_and_deploys_by_its_map() -> None:
    """Two robots will do, and the nearer places: it takes a while as it is."""
    plain = parameters()
    plain["scenario"]["team"]["size"] = 2
    explore, back, deploy = plain["scenario"]["protocol"]["parameters"]["calls"]
    explore["call"]["parameters"]["robots"] = back["call"]["parameters"]["robots"] = 2
    deploy["call"]["places"] = ["C", "E"]
    found = measure(plain, 1)
    assert set(found) == {column.name for column in COLUMNS}
    assert (found["plans_done"], found["refused"], found["deployed"], found["places_held"]) == (3.0, 0.0, 1.0, 1.0)
    assert found["collisions"] == found["wall_contacts"] == found["orders_failed"] == 0.0
    assert found["map_m2"] == pytest.approx(FLOOR_M2, rel=0.01)
    assert found["map_alike"] == 1.0
    assert found["explored_s"] > 58.0 / 0.3 * 0.9  # somebody has been near the end of the longest way
    told = answered(plain, explore["call"])  # the first call finds the floor as it is told here
    assert 30.0 < told["windows"]["explore"][2] < found["explored_s"]


@pytest.mark.slow
def test_a_run_that_ends_before_the_deployment_counts_with_its_length() -> None:
    found = measure(parameters(duration_s=30), 1)
    assert found["deploy_s"] == 30.0
    assert found["deployed"] == 0.0
    assert all(math.isnan(found[name]) for name in ("explored_s", "returned_s", "map_m2", "map_alike"))
