"""Deploying over five channels with robots that die: the experiment runs, and its claims hold, fail and stay open."""

import math
from itertools import product
from typing import Any

import pandas as pd
import pytest
import yaml

from cosim.experiment import load_experiment
from cosim.report.claims import judge, published_claims
from cosim.units import S
from experiments.deployment_channels import figures
from experiments.deployment_channels.recovering import COLUMNS, measure, recovery
from tests.checkout import EXPERIMENTS
from tests.tiers import each_value

FOLDER = EXPERIMENTS / "deployment_channels"
CLAIMS = {claim.id: claim for claim in published_claims(FOLDER)}
SWEEP: dict[str, Any] = yaml.safe_load((FOLDER / "sweep.yaml").read_text(encoding="utf-8"))
NONE = pd.DataFrame()


def parameters(network: str, killed: str, executive: str) -> dict[str, Any]:
    sets = (f"network={network}", f"killed={killed}", f"executive={executive}")
    (arm,) = load_experiment(FOLDER / "sweep.yaml", sets).arms
    return arm.parameters


def runs_of(right: bool, replicates: int) -> pd.DataFrame:
    rows = []
    for replicate in range(replicates):
        for network, executive, killed in product(figures.NETWORKS, figures.EXECUTIVES, figures.KILLED):
            row = {"network": network, "executive": executive, "killed": killed, "replicate": replicate}
            rows.append(row | {"deployed": float(right), "collisions": float(not right), "wall_contacts": 0.0})
    return pd.DataFrame(rows)


def answer(test: str, runs: pd.DataFrame) -> bool | None:
    holds: bool | None = getattr(figures, test)(runs, NONE)[1]
    return holds


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_claim_holds_and_fails_and_stays_open(claim: str) -> None:
    sweeps = (runs_of(True, 30), runs_of(False, 30), runs_of(True, 1), NONE)
    verdicts = [judge(CLAIMS[claim], runs, NONE, figures).verdict for runs in sweeps]
    assert verdicts == ["holds", "fails", "holds" if claim == "touches_nothing" else "open", "no data"]


def test_every_arm_of_the_sweep_is_judged() -> None:
    deaths = ["".join(each) for each in product(figures.NETWORKS, ("", "_robot", "_host"))]
    assert sorted(CLAIMS) == sorted(["touches_nothing", *(f"deploys_{each}" for each in deaths)])


def test_each_channel_executive_and_death_is_judged_by_its_own_runs() -> None:
    runs = runs_of(True, 30)
    runs.loc[(runs["network"] == "adhoc") & (runs["killed"] == "host"), "deployed"] = 0.0
    assert answer("deploys_adhoc", runs) is True
    assert answer("deploys_adhoc_host", runs) is False
    runs.loc[(runs["network"] == "ideal") & (runs["executive"] == "distributed"), "deployed"] = 0.0
    assert answer("deploys_ideal", runs) is False
    assert answer("deploys_ideal", runs[runs["executive"] == "central"]) is True


def test_the_experiment_is_ready_to_run() -> None:
    found = load_experiment(FOLDER / "sweep.yaml")
    assert len(found.arms) == len(figures.NETWORKS) * len(figures.EXECUTIVES) * len(figures.KILLED)


def event(at_s: float, source: int, name: str, **more: Any) -> dict[str, Any]:
    nothing = {"robot": None, "host": None, "plan": None, "task": None}
    return {"time_ns": round(at_s * S), "source": source, "event": name} | nothing | more


def started(at_s: float, source: int, task: str, plan: int = 1) -> dict[str, Any]:
    return event(at_s, source, "TaskStarted", task=task, plan=plan)


def test_times_count_from_the_death_and_only_what_the_living_do() -> None:
    rows = [
        event(55.0, 1, "RobotLost", robot=0),
        event(70.0, 2, "HostChanged", host=1),
        event(71.0, 1, "HostChanged", host=1),
        event(80.0, 1, "RobotLost", robot=3),
        started(81.0, 2, "deploy~2/stage-1/robot-2-to-3"),
        event(86.5, 1, "RobotLost", robot=0),
        started(86.7, 0, "deploy~3/stage-1/robot-0-to-1"),
        started(87.0, 1, "deploy~3/stage-1/robot-1-to-3"),
        started(88.0, 2, "deploy~3/stage-1/robot-2-to-2"),
    ]
    expected = {"noticed_s": 26.5, "succeeded_s": 11.0, "recovery_s": 27.0}
    assert recovery(rows, [(0, 60 * S)], 0) == expected
    other = recovery(rows, [(3, 60 * S)], 0)
    assert (other["noticed_s"], other["recovery_s"]) == (20.0, 21.0)
    assert math.isnan(other["succeeded_s"])
    assert all(math.isnan(value) for value in recovery(rows, [], 0).values())
    assert all(math.isnan(value) for value in recovery(rows[:3], [(2, 60 * S)], 0).values())


@pytest.mark.parametrize(
    "task",
    [
        "deploy/stage-4/robot-1-to-4",  # the next ordinary stage
        "deploy~2/stage-2/robot-1-to-3",  # made anew before, for another
        "deploy/stage-4/robot-1-to-4~2",  # what failed, once more
        "deploy~aside-7",  # making room
    ],
)
def test_what_would_have_been_ordered_anyway_is_no_recovery(task: str) -> None:
    rows = [
        started(50.0, 1, "deploy~2/stage-1/robot-1-to-2"),
        event(75.0, 1, "RobotLost", robot=2),
        event(75.5, 1, "Ordered", robot=1, task=task, plan=1),
        started(76.0, 1, task),
        started(90.0, 3, "deploy~3/stage-1/robot-3-to-1"),
    ]
    assert math.isnan(recovery(rows[:-1], [(2, 60 * S)], 0)["recovery_s"])
    assert recovery(rows, [(2, 60 * S)], 0)["recovery_s"] == 30.0


def test_a_team_that_meets_again_has_recovered() -> None:
    task = "deploy/reunited/places/part-1/stage-1/robot-1"
    rows = [event(75.0, 1, "RobotLost", robot=2), started(95.0, 1, task, 2)]
    assert recovery(rows, [(2, 60 * S)], 0)["recovery_s"] == 35.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "executive"),
    each_value([("ideal", "none"), ("adhoc", "robot"), ("bluetooth", "host")], figures.EXECUTIVES),
)
def test_a_team_deploys_whoever_dies(case: tuple[str, str], executive: str) -> None:
    network, killed = case
    found = measure(parameters(network, killed, executive), 2)
    assert set(found) == {column.name for column in COLUMNS}
    assert found["deployed"] == 1.0
    assert found["collisions"] == found["wall_contacts"] == 0.0
    assert found["robots_killed"] == (killed != "none")
    assert found["places_held"] == (1.0 if killed == "none" else 0.75)
    assert found["until_deployed_s"] < 300.0
    if killed != "none":
        assert 14.0 < found["noticed_s"] < 50.0
        assert found["noticed_s"] <= found["recovery_s"] < found["noticed_s"] + 10.0
    assert math.isnan(found["succeeded_s"]) is (killed != "host")
