"""Whole plays over every channel: with either executive, with hosts and robots that die, boot again, or are cut off."""

import functools
import itertools
import math
from typing import Any

import pytest

from cosim.simulation import Outcome
from protocols.deployment.tasks.plan import Place
from tests.protocols.deployment.crew_scene import CHANNELS, PLACES_M, STARTS_M, call, rows, run
from tests.tiers import all_pairs

QUICK = {"silence_s": 4.0, "alone_s": 12.0, "again_s": 2.0}
"""For robots that miss each other sooner, so that runs are short."""
EXECUTIVES = ("central", "distributed")
"""They take turns over the channels: the other way round when the host dies."""


@functools.cache
def undisturbed(play: str) -> Outcome:
    return run(calls=[call(play)])


def kill(robot: int, at_s: float) -> dict[str, Any]:
    return {"kind": "kill", "robot": robot, "at_s": at_s}


def ends(outcome: Any, plan: int | None = None) -> dict[int, Place]:
    """Return where each robot ended its last drive."""
    done = [row for row in rows(outcome, "TaskEnded") if row["result"] == "done" and plan in (None, row["plan"])]
    return {row["source"]: (row["x_m"], row["y_m"]) for row in done}


def held(outcome: Any) -> int:
    """Return how many places robots stand at, as far as they say."""
    return sum(any(math.dist(end, place) < 0.3 for end in ends(outcome).values()) for place in PLACES_M)


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "executive"), list(zip(CHANNELS, itertools.cycle(EXECUTIVES))))
def test_a_team_deploys_over_every_channel(channel: str, executive: str) -> None:
    outcome = run(channel, executive=executive)
    metrics = outcome.metrics
    assert metrics["plans_done"] == metrics["deployed"] == metrics["places_held"] == 1.0
    assert metrics["robots_lost"] == metrics["successions"] == metrics["collisions"] == 0.0
    assert held(outcome) == len(PLACES_M)
    assert metrics["simulated_s"] < 200.0


@pytest.mark.slow
@pytest.mark.parametrize("play", ["deploy/group", "deploy/wave", "deploy/leap-frog"])
def test_every_strategy_is_played_to_its_end(play: str) -> None:
    metrics = undisturbed(play).metrics
    assert metrics["plans_done"] == metrics["deployed"] == 1.0
    assert metrics["collisions"] == metrics["orders_failed"] == 0.0
    orders = {"deploy/group": 3 + 2 + 1, "deploy/wave": 1 + 2 + 3, "deploy/leap-frog": 1 + 2 + 3}
    assert metrics["orders"] >= orders[play]


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "executive"), list(zip(CHANNELS, itertools.cycle(EXECUTIVES[::-1]))))
def test_a_team_whose_host_dies_in_mid_play_still_ends_deployed(channel: str, executive: str) -> None:
    calls = [call("deploy/wave")]
    outcome = run(channel, [kill(0, 14.0)], executive=executive, calls=calls, **QUICK)
    metrics = outcome.metrics
    assert metrics["robots_killed"] == 1.0
    assert metrics["successions"] >= 1.0
    assert metrics["deployed"] == metrics["plans_done"] == 1.0
    assert metrics["collisions"] == 0.0
    assert held(outcome) >= 2


@pytest.mark.slow
def test_the_lowest_living_address_succeeds_the_host() -> None:
    outcome = run("ideal", [kill(0, 14.0), kill(1, 14.0)], calls=[call("deploy/wave")], **QUICK)
    assert outcome.metrics["deployed"] == 1.0
    hosts = [(row["source"], row["host"]) for row in rows(outcome, "HostChanged")]
    assert hosts == [(2, 2)]


@pytest.mark.slow
def test_a_robot_that_dies_is_lost_and_its_role_is_taken() -> None:
    outcome = run("ideal", [kill(2, 8.0)], calls=[call("deploy/leap-frog")], **QUICK)
    assert outcome.metrics["deployed"] == outcome.metrics["plans_done"] == 1.0
    lost = rows(outcome, "RobotLost")
    assert [(row["source"], row["robot"]) for row in lost] == [(0, 2)]
    silent_s = lost[0]["time_ns"] / 1e9 - 8.0
    assert 2.9 < silent_s <= 4.0 + 0.2  # its last news were up to a second old
    assert outcome.metrics["successions"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "for_s", "executive"), all_pairs([0, 1], [2.0, 9.0], EXECUTIVES))
def test_who_boots_again_is_told_the_plan_and_joins_in(robot: int, for_s: float, executive: str) -> None:
    crash = {"kind": "crash", "robot": robot, "at_s": 6.0, "for_s": for_s}
    outcome = run("ideal", [crash], executive=executive, calls=[call("deploy/wave")], **QUICK)
    metrics = outcome.metrics
    assert metrics["deployed"] == metrics["places_held"] == 1.0
    assert {row["plan"] for row in rows(outcome, "PlanTaken") if row["source"] == robot} == {1}
    assert metrics["collisions"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("robot", [0, 2])
def test_a_team_that_was_parted_reunites_under_the_lowest_address(robot: int) -> None:
    away = {"kind": "radio_off", "robot": robot, "at_s": 10.0, "until_s": 30.0}
    outcome = run("ideal", [away], calls=[call("deploy/leap-frog")], **QUICK)
    assert outcome.metrics["deployed"] == outcome.metrics["places_held"] == 1.0
    assert [row["host"] for row in rows(outcome, "HostChanged") if row["time_ns"] > 30e9] != []
    assert {row["host"] for row in rows(outcome, "HostChanged") if row["time_ns"] > 30e9} == {0}
    assert outcome.metrics["collisions"] == 0.0


@pytest.mark.slow
def test_who_is_cut_off_for_less_than_it_waits_alone_does_nothing_on_its_own() -> None:
    away = {"kind": "radio_off", "robot": 0, "at_s": 10.0, "until_s": 18.0}
    outcome = run("ideal", [away], calls=[call("deploy/wave")], **QUICK)
    assert outcome.metrics["deployed"] == 1.0
    assert [row for row in rows(outcome, "RobotLost") if row["source"] == 0] == []


@pytest.mark.slow
def test_plays_follow_each_other_and_a_play_that_cannot_be_played_is_refused() -> None:
    calls = [call("deploy/group"), call("deploy/group", [*PLACES_M, (3.0, 4.0)]), call("return", None)]
    calls[2]["call"] |= {"parameters": {"robots": 3}}
    del calls[2]["call"]["places"]
    outcome = run(calls=calls)
    metrics = outcome.metrics
    assert (metrics["plans_done"], metrics["refused"]) == (2.0, 1.0)
    refusal = rows(outcome, "PlanRefused")
    assert [row["play"] for row in refusal] == ["deploy/group"]
    assert refusal[0]["why"]
    assert refusal[0]["mend"]
    for robot, (x_m, y_m) in ends(outcome, plan=2).items():
        assert math.dist((x_m, y_m), STARTS_M[robot]) < 0.2


@pytest.mark.slow
def test_a_strategy_is_switched_while_it_is_played() -> None:
    outcome = run(calls=[call("deploy/leap-frog")], switches=[{"at_s": 15.0, "strategy": "group"}])
    assert outcome.metrics["plans_done"] == outcome.metrics["deployed"] == outcome.metrics["places_held"] == 1.0
    assert outcome.metrics["played_s"] < undisturbed("deploy/leap-frog").metrics["played_s"]


@pytest.mark.slow
def test_the_same_scenario_and_seed_have_the_same_digest() -> None:
    one, other = (run("adhoc", [kill(0, 6.0)], duration_s=16.0, **QUICK) for _ in range(2))
    assert one.digest == other.digest
    assert one.metrics["successions"] >= 1.0
