"""The tests that the published.csv of the deployments of paper 004 name hold, fail and stay open."""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from cosim.report.claims import Verdict, judge, published_claims
from experiments.deployment.deploying import lead_s, left
from experiments.deployment_strategies import figures as strategies
from experiments.deployment_wean import figures as wean
from tests.checkout import EXPERIMENTS

MODULES: dict[str, Any] = {"deployment_strategies": strategies, "deployment_wean": wean}
NONE = pd.DataFrame()
REPLICATES = 12
MOST = 8
EXACT = (
    "deployed",
    "plans_done",
    "refused",
    "stages",
    "collisions",
    "wall_contacts",
    *(f"moving_{n}" for n in range(1, MOST + 1)),
)
DECIDED_BY_ONE = ("moving", "four_to_b", "ahead", "refuses", "equal")
"""Where every single run decides, one is enough."""
Row = dict[str, Any]


CLAIMS = {name: {claim.id: claim for claim in published_claims(EXPERIMENTS / name)} for name in MODULES}
ROWS = [(name, claim) for name, claims in CLAIMS.items() for claim in claims]


def sweep(axes: dict[str, tuple[Any, ...]], row: Callable[[Row], Row], replicates: int) -> pd.DataFrame:
    rows = []
    for replicate in range(replicates):
        for number, values in enumerate(product(*axes.values())):
            arm = dict(zip(axes, values, strict=True))
            noise = 1.0 + 0.01 * np.sin(7 * replicate + 3 * number)
            same = 1.0 + 0.01 * np.sin(5 * replicate)
            found = {
                key: value * (1.0 if key in EXACT else same if arm.get("strategy") == "wave" else noise)
                for key, value in row(arm).items()
            }
            rows.append(arm | {"replicate": replicate} | found)
    return pd.DataFrame(rows)


def moving(strategy: str, robots: int, right: bool) -> Row:
    falling = list(range(robots, 0, -1))
    counts = {"group": falling, "wave": falling[::-1], "leap_frog": [1] * robots}[strategy]
    if not right:
        counts = [*counts[:-1], counts[-1] + 1]
    return {f"moving_{n}": float(counts[n - 1]) if n <= robots else math.nan for n in range(1, MOST + 1)}


def deployed(sign: int, arm: Row) -> Row:
    """Return the metrics of an arm where the paper is right (sign 1), and where it is wrong (sign -1)."""
    strategy, robots, right = arm["strategy"], arm["robots"], sign == 1
    way_s, plain = 100.0 * robots, arm["augmentation"] == "without"
    lost = {"wave": 0.0005 if right else 0.05}.get(strategy, 0.3 if plain == right else 0.1)
    return {
        "until_deployed_s": 60.0 * robots,
        "way_m": 10.0,
        "interference_s": lost * way_s,
        "hindered_s": lost * way_s,
        "waited_s": 0.0 if plain else 0.05 * way_s,
        "under_way_s": way_s,
        "deployed": 1.0 if right or plain else 0.0,
        "stages": float(robots),
        "collisions": 0.0 if right else 1.0,
        "wall_contacts": 0.0,
        **moving(strategy, robots, right),
    }


def typical(sign: int, arm: Row) -> Row:
    right = sign == 1
    if arm["calls"] != "deploy":  # as far from what is asked of the others as can be
        odd = dict.fromkeys(("until_deployed_s", "way_m", "moving_1"), 1000.0 if right else 210.0)
        refused = float((arm["calls"] == wean.TOO_SOON) == right)
        returned = {"plans_done": 2.0 if right else 1.0, "deployed": 1.0}
        return (
            odd
            | returned
            | {"refused": refused, "leap_ahead_s": -9.0 if right else 9.0, "collisions": 0.0, "wall_contacts": 0.0}
        )
    return {
        "until_deployed_s": 210.0 if right else 150.0,
        "way_m": 50.5 if right else 60.0,
        "deployed": 1.0 if right else 0.0,
        "moving_1": 4.0 if right else 3.0,
        "leap_ahead_s": 5.0 if right else -5.0,
        "collisions": 0.0,
        "wall_contacts": 0.0 if right else 1.0,
    }


def runs_of(name: str, sign: int, replicates: int) -> pd.DataFrame:
    if name == "deployment_wean":
        axes = {"network": wean.NETWORKS, "calls": ("deploy", "return", wean.TOO_SOON, wean.IN_GOOD_TIME)}
        return sweep(axes, lambda arm: typical(sign, arm), replicates)
    axes = {"strategy": strategies.STRATEGIES, "augmentation": ("with", "without"), "robots": strategies.SIZES}
    found = sweep(axes, lambda arm: deployed(sign, arm), replicates)
    if sign == -1:  # numbers of moving robots are asked of whole deployments
        found.loc[found["augmentation"] == "without", "deployed"] = 1.0
    return found


def judged(name: str, claim: str, sign: int, replicates: int = REPLICATES * 3) -> Verdict:
    return judge(CLAIMS[name][claim], runs_of(name, sign, replicates), NONE, MODULES[name])


@pytest.mark.parametrize(("name", "claim"), ROWS)
def test_a_claim_holds_where_the_paper_is_right(name: str, claim: str) -> None:
    found = judged(name, claim, 1)
    assert found.verdict == "holds", found.ours


@pytest.mark.parametrize(("name", "claim"), ROWS)
def test_a_claim_fails_where_the_paper_is_wrong(name: str, claim: str) -> None:
    found = judged(name, claim, -1)
    assert found.verdict == "fails", found.ours


@pytest.mark.parametrize(("name", "claim"), ROWS)
def test_a_claim_has_no_data_without_runs_and_stays_open_with_one_replicate(name: str, claim: str) -> None:
    assert judge(CLAIMS[name][claim], NONE, NONE, MODULES[name]).verdict == "no data"
    by_one = CLAIMS[name][claim].test.startswith(DECIDED_BY_ONE)
    assert judged(name, claim, 1, replicates=1).verdict == ("holds" if by_one else "open")


@pytest.mark.parametrize(
    ("mean_s", "holds"), [(181.0, None), (185.0, True), (235.0, True), (240.0, None), (244.0, False)]
)
def test_a_time_in_the_range_has_its_whole_interval_there(mean_s: float, holds: bool | None) -> None:
    times = [mean_s + 4.0 * (-1) ** replicate for replicate in range(10)]  # half an interval is 3 s
    runs = pd.DataFrame({"network": "ideal", "replicate": range(10), "until_deployed_s": times})
    assert getattr(wean, "time_ideal")(runs, NONE)[1] is holds  # noqa: B009


@pytest.mark.parametrize(("refused", "identified"), [((1, 0), True), ((1, 1), False), ((0, 0), False)])
def test_a_planner_that_refuses_every_call_or_none_identifies_nothing(
    refused: tuple[int, int], identified: bool
) -> None:
    calls = dict(zip((wean.TOO_SOON, wean.IN_GOOD_TIME), refused, strict=True))
    rows = [
        {"network": "ideal", "calls": each, "replicate": at, "refused": calls[each]} for each in calls for at in (0, 1)
    ]
    assert getattr(wean, "refuses_ideal")(pd.DataFrame(rows), NONE)[1] is identified  # noqa: B009


def test_sheets_without_the_axis_of_calls_are_judged_by_what_they_deploy() -> None:
    runs = runs_of("deployment_wean", 1, 30)
    plain = runs[runs["calls"] == "deploy"].drop(columns="calls")
    for claim in CLAIMS["deployment_wean"].values():
        known = not claim.id.startswith(("returns", "refuses"))
        assert judge(claim, plain, NONE, wean).verdict == ("holds" if known else "no data")


def test_interference_that_is_as_high_with_the_augmentations_is_not_lowered() -> None:
    runs = runs_of("deployment_strategies", 1, 40)
    runs["interference_s"] = 10.0 + runs["replicate"] % 7 + runs["robots"] * np.sin(runs.index)
    for strategy in strategies.AUGMENTED:
        assert getattr(strategies, f"lowers_{strategy}")(runs, NONE)[1] is False


def test_what_is_only_moved_from_interference_to_waiting_is_not_saved() -> None:
    runs = runs_of("deployment_strategies", 1, 40)
    waits = runs["augmentation"] == "with"
    runs.loc[waits, "waited_s"] = 0.25 * runs["under_way_s"]
    for strategy in strategies.AUGMENTED:
        for size in ("", *(f"_{size}" for size in strategies.SIZES)):
            assert getattr(strategies, f"lowers_{strategy}{size}")(runs, NONE)[1] is True
            assert getattr(strategies, f"saves_{strategy}{size}")(runs, NONE)[1] is False
    assert strategies.saves("group", 2, runs.drop(columns="waited_s"), NONE) == ("-", None)


def test_a_wave_that_is_disturbed_with_one_size_of_team_is_disturbed() -> None:
    runs = runs_of("deployment_strategies", 1, 12)
    runs.loc[(runs["strategy"] == "wave") & (runs["robots"] == 6), "interference_s"] *= 100
    assert strategies.none_wave(runs, NONE)[1] is False


def test_a_robot_has_left_once_its_body_has_whenever_it_was_ordered() -> None:
    events = {
        "event": ["Ordered", "TaskStarted", "TaskStarted", "TaskStarted", "TaskStarted"],
        "time_ns": [0, 10, 10, 20, 30],
        "source": [0, 0, 1, 2, 0],
        "task": ["x/leap/1", "x/leap/1", "x/group/1", "x/group/2", "x/leap/2"],
        "x_m": [0.0, 1.0, 5.0, 9.0, 3.0],
        "y_m": [0.0] * 5,
    }
    ways = {0: [1.0, 1.0, 1.0, 1.9, 2.1, 9.0], 1: [9.0, 5.0, 5.0, 5.0, 5.0, 6.1], 2: [9.0, 9.0, 9.0, 9.0, 9.0, 9.0]}
    rows = [(tick * 10, robot, way[tick], 0.0) for tick in range(6) for robot, way in ways.items()]
    poses = dict(zip(("time_ns", "source", "x_m", "y_m"), map(list, zip(*rows, strict=True)), strict=True))
    assert left(events, poses, "x/leap") == {0: 40}
    assert left(events, poses, "x/group") == {1: 50}
    assert lead_s(events, poses, "x/leap", "x/group") == pytest.approx(10e-9)
    assert lead_s(events, poses, "x/group", "x/leap") == pytest.approx(-10e-9)
    assert math.isnan(lead_s(events, poses, "x/leap", "x/wave"))


def test_the_table_has_a_row_for_each_strategy_and_size() -> None:
    (table,) = strategies.tables(runs_of("deployment_strategies", 1, 3), NONE).values()
    assert len(table) == 3 * 4
    shares = [float(text.removeprefix("x ")) for text in table.loc[table["strategy"] == "group", "interference_s"]]
    assert shares == pytest.approx([1 / 3] * 4, rel=0.01)
    summed = [float(text.removeprefix("x ")) for text in table.loc[table["strategy"] == "group", "lost_or_waited_s"]]
    assert summed == pytest.approx([0.15 / 0.3] * 4, rel=0.01)
    assert strategies.tables(NONE, NONE) == {}


def test_the_claims_are_those_of_the_paper() -> None:
    for name in MODULES:
        rows = published_claims(EXPERIMENTS / name)
        assert len({row.id for row in rows}) == len(rows)
        assert {row.paper for row in rows} == {"004"}


def test_the_bodies_of_the_sweeps_are_those_of_the_platforms() -> None:
    platforms = yaml.safe_load((EXPERIMENTS / "deployment_wean" / "platforms.yaml").read_text(encoding="utf-8"))
    teams = {
        name: yaml.safe_load((EXPERIMENTS / name / "sweep.yaml").read_text(encoding="utf-8"))["parameters"]["scenario"]
        for name in MODULES
    }
    groups = teams["deployment_wean"]["team"]["groups"]
    assert [group["size"] for group in groups] == [2, 1, 1]
    bodies = [group["body"] for group in groups] + [teams["deployment_strategies"]["team"]["body"]]
    for body, platform in zip(bodies, ("pioneer_at", "b21", "b24", "pioneer_at"), strict=True):
        for limit in ("radius_m", "speed_mps", "acceleration_mps2"):
            assert body[limit] == platforms[platform][limit]
        assert body["turn_radps"] == min(each["turn_radps"] for each in platforms.values())
    for scenario in teams.values():
        driving = scenario["protocol"]["parameters"]["driving"]
        assert driving["turn_radps"] == bodies[0]["turn_radps"]
        assert driving["turn_acceleration_radps2"] == bodies[0]["turn_acceleration_radps2"]
