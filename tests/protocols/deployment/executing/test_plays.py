"""Whatever play is called, the executive brings its plan to an end."""

import math

import pytest
from hypothesis import strategies as st

from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Plan
from tests.protocols.deployment.play_scene import Scene, Troubles, posts_of
from tests.protocols.deployment.plays_scene import Scene as Office
from tests.protocols.deployment.random_plays import RandomCall, random_calls
from tests.tiers import tiers

WEAN = {"crossing": [9.0, 1.0], "leap_places": [[20.0, 9.0], [30.0, 9.0]], "group_places": [[20.0, -9.0], [30.0, -9.0]]}


def played(plan: Plan, office: Office, troubles: Troubles | None = None) -> Scene:
    scene = Scene(plan, office.crew, ways=office.floor, troubles=troubles).run(20000)
    assert scene.executive is not None
    assert set(scene.executive.states.values()) <= {"done", "failed", "terminated"}
    return scene


@tiers(12, 100, random_calls())
def test_a_random_play_is_executed_within_its_windows(call: RandomCall):
    plan, office = call.plan()
    scene = played(plan, office)
    assert scene.executive is not None
    assert scene.executive.states[plan.root.name] == "done"
    assert not scene.breaches


@tiers(8, 100, random_calls(), st.dictionaries(st.integers(0, 3), st.floats(0, 200), max_size=2), st.integers(1, 200))
def test_a_random_play_ends_though_robots_and_hosts_die(call: RandomCall, deaths: dict[int, float], at_s: int):
    plan, office = call.plan()
    played(plan, office, Troubles(deaths=deaths, hosts=(float(at_s),), delay_s=(0.0, 1.0), twice=0.2))


@pytest.mark.parametrize("dead", [None, 0, 1, 2, 3])
def test_the_scenario_of_section_7_ends_deployed(dead: int | None):
    office = Office()
    plan = office.call("wean", parameters=WEAN)
    assert isinstance(plan, Plan)
    scene = played(plan, office, Troubles(deaths={} if dead is None else {dead: 12.0}))
    assert scene.executive is not None
    posts_m = posts_of(scene.executive)
    living = [robot for robot in scene.robots if robot.alive]
    assert all(math.dist(robot.at_m, posts_m[robot.address]) < 1e-9 for robot in living)
    assert {(20.0, 9.0), (20.0, -9.0)} <= {posts_m[robot.address] for robot in living}
    assert scene.executive.states[plan.root.name] == "done"


def test_tasks_start_and_end_with_others_as_a_call_has_it():
    """Those that leap wait for the others' second stage, and are terminated when these have deployed."""
    leap, group = "beyond/leap/stage-1", "beyond/group/stage-2"
    together = {"kind": "after", "task": leap, "edge": "start", "of": group, "of_edge": "start", "at_most_s": 0}
    ends = {"kind": "ends_with", "task": "beyond/leap", "of": "beyond/group"}
    office = Office()
    plan = office.plan("wean", parameters=WEAN | {"ahead_s": 0}, constraints=[together, ends])
    scene, begun = Scene(plan, office.crew, ways=office.floor), dict[str, int]()
    assert scene.executive is not None
    while not scene.executive.finished:
        scene.step()
        for task in (leap, group):
            if scene.executive.states[f"wean/{task}"] != "waiting":
                begun.setdefault(task, scene.now)
    ends_at = {end.task: (end.at, end.result) for end in scene.ends}
    assert begun[leap] == begun[group] > ends_at["wean/to-crossing"][0]
    assert ends_at["wean/beyond/leap"] == (ends_at["wean/beyond/group"][0], Result.TERMINATED)
    assert ends_at["wean"][1] is ends_at["wean/beyond/group"][1] is Result.DONE
    assert not scene.breaches
