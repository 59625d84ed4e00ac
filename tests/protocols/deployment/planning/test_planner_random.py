"""The planner and whatever is called: random plays, with deadlines that are too tight, and random calls."""

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import strategies as st
from pydantic import ValidationError

from cosim.errors import UserError
from protocols.deployment.planning.planner import Call, Refusal
from protocols.deployment.tasks.plan import ORIGIN, Plan, actors
from tests.protocols.deployment.planner_scene import NEAR_FAR, WEAN, assert_mends, schedule
from tests.protocols.deployment.plays_scene import Scene
from tests.protocols.deployment.random_plays import RandomCall, random_calls
from tests.tiers import tiers


@tiers(15, 100, random_calls())
def test_the_earliest_schedule_of_a_random_play_keeps_all_that_the_plan_says(case: RandomCall) -> None:
    plan, scene = case.plan()
    times = schedule(plan, scene)
    for each in plan.constraints:
        apart = times[each.later.task, each.later.edge] - times[each.earlier.task, each.earlier.edge]
        assert apart >= each.at_least_s - 1e-6
        assert each.at_most_s is None or apart <= each.at_most_s + 1e-6
    for task in plan.root.walk():
        assert times[ORIGIN, "start"] <= times[task.name, "start"] <= times[task.name, "end"]
        spans = [(times[inner.name, "start"], times[inner.name, "end"]) for inner in task.subtasks]
        assert all(times[task.name, "start"] <= a <= b <= times[task.name, "end"] for a, b in spans)
        if task.order == "serial":
            assert all(b <= c for (_, b), (c, _) in pairwise(spans))
    busy: dict[int, list[tuple[float, float]]] = {}
    for task in plan.root.walk():
        for robot in actors(task.act) if task.leaf else ():
            busy.setdefault(robot, []).append((times[task.name, "start"], times[task.name, "end"]))
    for spans in busy.values():
        assert all(b <= c + 1e-9 for (_, b), (c, _) in pairwise(sorted(spans)))


@tiers(10, 100, random_calls(), st.integers(1, 100))
def test_a_random_play_under_a_deadline_below_its_least_time_is_refused_truly(case: RandomCall, percent: int) -> None:
    plan, scene = case.plan()
    earliest_s = schedule(plan, scene)["random", "end"]
    least_s = math.floor(earliest_s * 10.0) / 10.0
    if least_s < 0.2:
        return
    tight = {"kind": "deadline", "seconds": round(least_s * percent / 101.0, 3)}
    more = {"parameters": case.parameters, "constraints": [tight]}
    refusal = assert_mends(scene, "random", None, **more)
    (text,) = [text for text in refusal.conflicts if text.startswith("the call: ")]
    assert text.startswith("the call: random ends at most ")
    assert sum(text.startswith("the call: random ends at most ") for text in refusal.mend) == 1
    loose = tight | {"seconds": math.ceil(earliest_s * 10.0 + 1e-6) / 10.0}
    assert isinstance(scene.call("random", parameters=case.parameters, constraints=[loose]), Plan)


NAMES = st.sampled_from(["hall", "base", "group", "places", "robots-1", "deploy", "deploy/stage-1", "leap", "x", ""])
NUMBERS = st.integers(-3, 9) | st.sampled_from([1e9, 1e300, -1e300, 10**30, 0.5])
SCALARS = NAMES | NUMBERS | st.booleans() | st.none()
JSON = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=4), max_leaves=6)
PARAMETERS = ["places", "robots", "robot", "place", "strategy", *WEAN, "leapers", "others", "apart_m", "ahead_s", "x"]


@tiers(
    75,
    300,
    st.sampled_from(
        ["deploy", "wean", "photo", "return", "survey", "explore", "wean/beyond/leap", "deploy/wave/stage-1"]
    ),
    st.dictionaries(st.sampled_from(PARAMETERS), JSON, max_size=5),
    st.booleans(),
    st.fixed_dictionaries(
        {},
        optional={
            "robots": st.lists(st.integers(-1, 9), max_size=4),
            "roles": st.dictionaries(NAMES, st.integers(-2, 9), max_size=2),
            "via": st.dictionaries(NAMES, st.lists(st.just("hall"), max_size=2), max_size=2),
            "expand": st.sampled_from(["none", "all", -1, 0, 3]),
            "strategy": st.sampled_from(["wave", "leap_frog"]),
            "constraints": st.lists(
                st.fixed_dictionaries({"kind": st.just("deadline"), "task": NAMES, "seconds": NUMBERS}), max_size=2
            ),
        },
    ),
)
def test_whatever_is_called_is_planned_or_refused_or_told_to_be_wrong(
    play: str, parameters: dict[str, Any], whole: bool, more: dict[str, Any]
) -> None:
    known = WEAN if play.startswith("wean") else {"place": "hall"} if play == "photo" else {"places": NEAR_FAR}
    if whole and play not in ("return", "explore"):
        parameters = known | parameters
    try:
        call = Call.model_validate({"play": play, "parameters": parameters, **more})
    except ValidationError:
        return
    scene = Scene()
    try:
        found = scene.planner.call(call, scene.starts_m, 7)
    except UserError:
        return
    assert isinstance(found, Plan | Refusal)
    assert type(found).model_validate_json(found.model_dump_json()) == found


def test_that_nobody_is_to_explore_is_told_to_the_caller() -> None:
    scene = Scene()
    call = Call.model_validate({"play": "survey", "parameters": {"places": []}})
    with pytest.raises(UserError, match="survey: robots stands for no robot, expected one at least"):
        scene.planner.call(call, scene.starts_m, 7)
