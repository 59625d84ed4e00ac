"""Calls that are tailored: constraints, way points, strategies and expansions that are added to a play."""

import math
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from protocols.deployment.planning.planner import Call, PlannerParameters, Refusal
from protocols.deployment.tasks.plan import Deployment, Go, Instant, Plan
from tests.protocols.deployment.planner_scene import NEAR_FAR, WEAN, scene_of, schedule
from tests.protocols.deployment.plays_scene import BODY, Scene


def test_constraints_and_waypoints_are_added_to_a_called_play() -> None:
    plan = Scene().plan(
        "deploy/leap-frog",
        places=NEAR_FAR,
        constraints=[{"kind": "before", "first": "deploy/stage-1", "then": "deploy/stage-2", "at_least_s": 10}],
        via={"deploy/stage-1/robot-0-leg-1": [[3, 3], "hall"]},
    )
    (constraint,) = plan.constraints
    assert constraint.later == Instant(task="leap-frog/deploy/stage-2")
    assert constraint.why == (
        "the call: leap-frog/deploy/stage-2 starts at least 10 s after leap-frog/deploy/stage-1 ends"
    )
    act = plan.tasks["leap-frog/deploy/stage-1/robot-0-leg-1"].act
    assert isinstance(act, Go)
    assert act.via_m == ((3.0, 3.0), (30.0, 0.0))


def test_an_edge_comes_after_an_edge_of_another_task() -> None:
    after = {"kind": "after", "task": "beyond/group", "of": "beyond/leap", "of_edge": "end", "at_most_s": 9}
    plan = Scene().plan("wean", parameters=WEAN, constraints=[after | {"edge": "end"}])
    found = plan.constraints[-1]
    assert (found.earlier, found.at_least_s, found.at_most_s) == (
        Instant(task="wean/beyond/leap", edge="end"),
        0.0,
        9.0,
    )
    assert found.later == Instant(task="wean/beyond/group", edge="end")
    found = Scene().plan("wean", parameters=WEAN, constraints=[after]).constraints[-1]
    assert (found.earlier.edge, found.later.edge) == ("end", "start")


ENDS = {"kind": "ends_with", "task": "beyond/group", "of": "beyond/leap"}


def test_a_task_ends_with_another_one_by_the_call() -> None:
    """Paper 004, section 5: "a task can be constrained to terminate whenever another task completes"."""
    scene, usual = Scene(), Scene().plan("wean", parameters=WEAN)
    plan = scene.plan("wean", parameters=WEAN, constraints=[ENDS])
    enders = {name: task.ends_with for name, task in plan.tasks.items() if task.ends_with is not None}
    assert enders == {"wean/beyond/group": "wean/beyond/leap"}
    assert plan.constraints == usual.constraints, "it is no bound on times"
    windows = scene.planner.windows_s(plan, scene.starts_m)
    shortest_s, usual_s = (
        one[Instant(task="wean/beyond/group", edge="end")][0]
        for one in (windows, scene.planner.windows_s(usual, scene.starts_m))
    )
    assert shortest_s is not None
    assert usual_s is not None
    assert shortest_s < usual_s, "it may be cut short"


def test_what_ends_with_another_one_is_seen_in_a_deployment_that_is_not_expanded() -> None:
    ends = {"kind": "ends_with", "task": "deploy/stage-1/robot-0", "of": "deploy/stage-1/robot-1"}
    plan = Scene().plan("deploy/group", places=NEAR_FAR, constraints=[ends])
    assert plan.tasks["group/deploy/stage-1/robot-0"].ends_with == "group/deploy/stage-1/robot-1"


def test_what_would_end_before_it_starts_is_refused() -> None:
    within = {"kind": "deadline", "seconds": 900.0}
    ends = {"kind": "ends_with", "task": "deploy/stage-2", "of": "deploy/stage-1"}
    refusal = Scene().refusal("deploy/group", places=NEAR_FAR, constraints=[within, ends])
    asked = "the call: group/deploy/stage-2 ends with group/deploy/stage-1"
    assert refusal.conflicts == (f"{asked}, which ends before group/deploy/stage-2 starts",)
    assert refusal.mend == (f"without: {asked}",)
    (instead,) = refusal.calls.values()
    assert [each.kind for each in instead.constraints] == ["deadline"]
    assert isinstance(Scene().planner.call(instead, Scene().starts_m, 7), Plan)


def test_a_task_starts_with_another_one() -> None:
    """As the page says it: no time lies between the two."""
    start = {"kind": "after", "task": "beyond/group", "edge": "start", "of": "beyond/leap/stage-2", "of_edge": "start"}
    scene = Scene()
    plan = scene.plan("wean", parameters=WEAN, constraints=[start | {"at_least_s": 0, "at_most_s": 0}])
    starts_s = schedule(plan, scene)
    assert starts_s["wean/beyond/group", "start"] == starts_s["wean/beyond/leap/stage-2", "start"]
    assert starts_s["wean/beyond/group", "start"] > starts_s["wean/beyond/leap", "start"] + 5.0


def test_a_task_that_its_play_ends_with_another_does_not_end_with_a_third(tmp_path: Path) -> None:
    waits = [{"kind": "wait", "label": label, "seconds": 9} for label in "abc"]
    waits[0] |= {"ends_with": "b"}
    scene = scene_of(tmp_path, {"order": "parallel", "tasks": waits})
    ends = {"kind": "ends_with", "task": "a"}
    assert scene.plan("mine", constraints=[ends | {"of": "b"}]).tasks["mine/a"].ends_with == "mine/b"
    with pytest.raises(UserError, match="mine/a ends with mine/b, and cannot end with mine/c too"):
        scene.call("mine", constraints=[ends | {"of": "c"}])


@pytest.mark.parametrize(
    ("more", "error"),
    [
        ({"via": {"deploy": [[1, 1]]}}, "via: group/deploy is no drive of one robot, expected the name of one"),
        ({"via": {"deplyo": [[1, 1]]}}, "there is no task 'group/deplyo' in group, did you mean group/deploy?"),
        ({"constraints": [{"kind": "within", "task": "x", "seconds": 1}]}, "there is no task 'group/x' in group"),
        (
            {"constraints": [{"kind": "ends_with", "task": "deploy", "of": "x"}]},
            "there is no task 'group/x' in group",
        ),
        (
            {"constraints": [{"kind": "ends_with", "task": "deploy/stage-1", "of": "deploy"}]},
            "group/deploy/stage-1 cannot end with group/deploy: one is part of the other",
        ),
        (
            {"constraints": [{"kind": "ends_with", "task": "", "of": "deploy"}]},
            "group cannot end with group/deploy: one is part of the other",
        ),
        (
            {
                "constraints": [
                    {"kind": "ends_with", "task": "deploy/stage-1/robot-0", "of": "deploy/stage-1/robot-1"},
                    {"kind": "ends_with", "task": "deploy/stage-1/robot-0", "of": "deploy/stage-2"},
                ]
            },
            "group/deploy/stage-1/robot-0 ends with group/deploy/stage-1/robot-1, and cannot end with",
        ),
        ({"constraints": [{"kind": "within", "seconds": "x"}]}, "deploy/group: 'x' is not a number, and there is none"),
    ],
)
def test_tailoring_that_means_nothing_is_told(more: dict[str, Any], error: str) -> None:
    with pytest.raises(UserError, match=re.escape(error)):
        Scene().call("deploy/group", places=NEAR_FAR, **more)


@pytest.mark.parametrize("seconds", [1e300, -1e300, math.nan, math.inf, True, None])
def test_a_number_that_is_no_time_makes_no_call(seconds: object) -> None:
    with pytest.raises(ValidationError, match="is not a number, or the name of a parameter that is one"):
        Call.model_validate({"play": "deploy", "constraints": [{"kind": "deadline", "seconds": seconds}]})


def test_waypoints_make_a_play_longer_and_a_deadline_notices() -> None:
    more = {"places": [[5.0, 0.0]], "constraints": [{"kind": "deadline", "seconds": 30.0}]}
    assert isinstance(Scene().call("deploy/group", **more), Plan)
    via = {"deploy/stage-1/robot-0": [[0.0, 20.0]]}
    assert isinstance(Scene().call("deploy/group", via=via, **more), Refusal)


def test_strategy_and_augmentation_are_set_by_the_call() -> None:
    plan = Scene().plan("wean", parameters=WEAN, strategy="wave", augmented=False)
    acts = [task.act for task in plan.root.walk() if isinstance(task.act, Deployment)]
    assert [(act.strategy, act.augmented) for act in acts] == [("wave", False)] * 2


@pytest.mark.parametrize(
    ("own", "called", "deepest"),
    [("none", None, 2), ("all", None, 5), ("none", "all", 5), ("all", 1, 2), ("none", 2, 5)],
)
def test_either_side_expands_a_deployment(own: str, called: str | int | None, deepest: int) -> None:
    scene = Scene(parameters=PlannerParameters.model_validate({"expand": own}))
    plan = scene.plan("wean", parameters=WEAN, expand=called)
    assert max(name.count("/") for name in plan.tasks) + 0 == deepest - (deepest == 5)


def test_a_group_stage_that_is_called_alone_stands_in_line() -> None:
    plan = Scene([BODY] * 3).plan("deploy/group/stage-1", places=[[5, 0], [10, 0], [15, 0]])
    goes = [task.act for task in plan.root.subtasks if isinstance(task.act, Go)]
    assert [go.final for go in goes] == [True, False, False]
    assert goes[0].place_m == (5.0, 0.0)
    assert 5.5 < goes[1].place_m[0] < goes[2].place_m[0] < 10.0
    assert [go.behind for go in goes] == [goes[1].robot, goes[2].robot, None]
