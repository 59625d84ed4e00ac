"""The planner: plans hold together, infeasible calls are refused with a true conflict, and what is offered mends it."""

import math
import re
from collections.abc import Mapping
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from protocols.deployment.planning.planner import Call, PlannerParameters, Refusal
from protocols.deployment.planning.timing import TimingParameters, drive_s
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Deployment, Go, Place, Plan
from tests.protocols.deployment.planner_scene import NEAR_FAR, WEAN, assert_mends, scene_of, schedule
from tests.protocols.deployment.plays_scene import BODY, OpenFloor, Scene

# ---------------------------------------------------------------- roles


@pytest.mark.parametrize("play", ["deploy/group", "deploy/wave", "deploy/leap-frog"])
def test_robots_are_assigned_so_that_their_routes_are_shortest_together(play: str) -> None:
    """Against all permutations: a robot's route goes from place to place as its strategy has it."""
    places = [(4.0, 3.0), (9.0, -2.0), (12.0, 5.0)]
    scene = Scene()
    scene.starts_m = {0: (3.0, 9.0), 1: (-4.0, 1.0), 2: (0.0, -7.0), 3: (8.0, 8.0)}
    (leaf,) = [task.act for task in scene.plan(play, places=places).root.walk() if task.leaf]
    assert isinstance(leaf, Deployment)

    def route_m(robot: int, place: int) -> float:
        along = [scene.starts_m[robot], *places[: place + 1]]
        return sum(math.dist(a, b) for a, b in pairwise(along))

    def total_m(robots: tuple[int, ...]) -> float:
        return sum(route_m(robot, place) for place, robot in enumerate(robots))

    assert total_m(leaf.robots) == min(total_m(robots) for robots in permutations(range(4), 3))


@pytest.mark.parametrize(
    ("play", "last", "given"),
    [
        ("deploy/group", (2, 0, 1), {"places": [[10, 0], [15, 0], [20, 0]]}),  # in front who goes farthest
        ("deploy/wave", (2, 0, 1), {"places": [[10, 0], [15, 0], [20, 0]]}),  # in front the point man
        ("deploy/leap-frog", (1, 0, 2), {"places": [[10, 0], [15, 0], [20, 0]]}),  # in front who leaps first
    ],
)
def test_of_equal_routes_the_robot_in_front_gets_the_role_that_sets_out_first(
    play: str, last: tuple[int, ...], given: dict[str, Any]
) -> None:
    """In a corridor all assignments are equally long: nobody is to pass another at the start."""
    scene = Scene([BODY] * 3)
    scene.starts_m = {0: (-1.0, 0.0), 1: (0.0, 0.0), 2: (-2.0, 0.0)}
    (leaf,) = [task.act for task in scene.plan(play, **given).root.walk() if task.leaf]
    assert isinstance(leaf, Deployment)
    assert leaf.robots == last


def test_robots_gather_in_the_order_in_which_they_stand() -> None:
    scene = Scene()
    scene.starts_m = {0: (-2.0, 0.0), 1: (0.0, 0.0), 2: (-3.0, 0.0), 3: (-1.0, 0.0)}
    plan = scene.plan("wean/to-crossing", parameters=WEAN)
    assert [task.act.robot for task in plan.root.subtasks if isinstance(task.act, Go)] == [1, 3, 0, 2]


def test_the_nearest_place_is_the_first() -> None:
    (leaf,) = [task.act for task in Scene().plan("deploy/group", places=[[9, 0], [5, 0]]).root.walk() if task.leaf]
    assert isinstance(leaf, Deployment)
    assert leaf.places_m == ((5.0, 0.0), (9.0, 0.0))


def test_the_quickest_assignment_is_another_than_the_shortest() -> None:
    bodies = [BODY, BODY._replace(speed_mps=2.0)]
    starts_m = {0: (2.0, 0.0), 1: (0.0, 0.0)}
    found = {}
    for cost in ("length", "time"):
        scene = Scene(bodies, parameters=PlannerParameters.model_validate({"cost": cost}))
        scene.starts_m = starts_m
        plan = scene.plan("photo", parameters={"place": "hall"})
        found[cost] = plan.robots
    assert found == {"length": (0,), "time": (1,)}


def test_only_a_robot_with_a_camera_takes_a_picture() -> None:
    scene = Scene([BODY._replace(camera=robot == 2) for robot in range(3)])
    assert scene.plan("photo", parameters={"place": "hall"}).robots == (2,)


def test_a_wide_robot_is_not_sent_where_it_has_no_room() -> None:
    """A narrow passage is what the navigation layer has no way for."""
    floor = OpenFloor([(5.0, 1.2, 0.8)])  # leaves a radius of 0.4 at (5, 0)
    scene = Scene([BODY._replace(radius_m=0.5), BODY._replace(radius_m=0.3)], floor)
    assert scene.plan("deploy/group", places=[[5, 0]]).robots == (1,)
    refusal = assert_mends(scene, "deploy/group", 2, places=[[5, 0]], robots=[0])
    assert refusal.conflicts[1:] == ("robot 0, 1 m wide: no room for it at (5, 0)",)


@pytest.mark.parametrize("play", ["deploy/group", "deploy/wave", "deploy/leap-frog"])
def test_too_few_robots_are_told_and_how_many_more_it_takes(play: str) -> None:
    scene = Scene([BODY] * 2)
    refusal = assert_mends(scene, play, 1, places=[[5, 0], [9, 0], [13, 0], [17, 0]])
    assert refusal.mend == ("2 more robots",)
    assert refusal.conflicts == ("roles robots-1, robots-2, robots-3, robots-4 want 4 robots, and there are 2: 0, 1",)


def test_far_too_many_places_are_refused_before_a_single_route_is_asked_for() -> None:
    scene = Scene()
    refusal = scene.refusal("deploy", places=[[float(x), float(y)] for x in range(16) for y in range(16)])
    assert refusal.conflicts[0].endswith("want 256 robots, and there are 4: 0, 1, 2, 3")
    assert refusal.mend == ()
    assert scene.floor.asked <= 3 * 256  # once a play, to put places in order


def test_a_missing_camera_is_told() -> None:
    scene = Scene([BODY._replace(camera=False)] * 2)
    refusal = assert_mends(scene, "photo", 1, parameters={"place": "hall"})
    assert refusal.mend == ("1 more robot with a camera",)
    assert "robot 1 has no camera" in refusal.conflicts


def test_who_was_left_out_or_fixed_by_the_call_may_be_the_reason() -> None:
    scene = Scene([BODY._replace(camera=robot == 1) for robot in range(3)])
    refusal = assert_mends(scene, "photo", 2, parameters={"place": "hall"}, robots=[0, 2])
    assert refusal.mend[0] == "robots 1 may take part"
    assert {text: call.robots for text, call in refusal.calls.items()} == {refusal.mend[0]: None}
    refusal = assert_mends(scene, "photo", 1, parameters={"place": "hall"}, roles={"robot": 2})
    assert refusal.mend == ("the planner chooses the robots for all roles",)
    assert refusal.calls[refusal.mend[0]].roles == {}
    assert "robot 2 has no camera" in refusal.conflicts


def test_a_call_may_say_who_plays_a_role() -> None:
    plan = Scene().plan("deploy/group", places=NEAR_FAR, roles={"robots-2": 3})
    (leaf,) = [task.act for task in plan.root.walk() if task.leaf]
    assert isinstance(leaf, Deployment)
    assert leaf.robots == (0, 3)
    with pytest.raises(UserError, match="roles: there is no role 'robots-9', did you mean robots-"):
        Scene().call("deploy/group", places=NEAR_FAR, roles={"robots-9": 3})


# ---------------------------------------------------------------- places


def test_a_place_that_nobody_can_get_to_is_told_with_one_nearby() -> None:
    scene = Scene(floor=OpenFloor([(5.0, 0.0, 1.0)]))
    refusal = assert_mends(scene, "deploy/group", 1, places=NEAR_FAR)
    assert refusal.conflicts == ("no robot can get to (5, 0)",)


def test_robots_cannot_end_up_in_each_other() -> None:
    refusal = Scene().refusal("deploy/group", places=[[5.0, 0.0], [5.4, 0.0]])
    assert refusal.conflicts == ("robot 0 at (5.4, 0) and robot 1 at (5, 0) would overlap",)


def test_robots_that_gather_want_a_way_to_stand_on() -> None:
    given = WEAN | {"leap_places": [[13, 0], [30, 0]]}
    refusal = assert_mends(Scene(), "wean", 1, parameters=given)
    assert refusal.conflicts == (
        "wean/to-crossing: 4 robots 1.5 m apart want 4.5 m of way from (10, 0) to (13, 0), and there are 3.0 m",
    )
    assert refusal.mend == ("robots gather at most 1 m apart",)


def test_who_has_not_been_heard_is_told_where_robots_are_too_few() -> None:
    scene = Scene()
    present = {robot: place for robot, place in scene.starts_m.items() if robot in (0, 2)}
    for robots, lost in ((None, [1, 3]), ((0, 3), [3])):
        call = Call(play="return", parameters={"robots": 4}, robots=robots)
        refusal = scene.planner.call(call, present, 7, {1: 1988.2, 3: 31.0})
        assert isinstance(refusal, Refusal)
        told = {1: "robot 1 has not been heard for 1988 s", 3: "robot 3 has not been heard for 31 s"}
        assert list(refusal.conflicts[1:]) == [told[robot] for robot in lost]


# ---------------------------------------------------------------- time


def test_a_deadline_that_cannot_be_met_is_told_with_the_one_that_can() -> None:
    deadline = {"kind": "deadline", "seconds": 20.0}
    refusal = assert_mends(Scene(), "deploy/leap-frog", 1, places=NEAR_FAR, constraints=[deadline])
    assert refusal.conflicts[0] == "the call: leap-frog ends at most 20 s after the plan begins"
    drives = [re.sub(r" at 0.5.*", "", text) for text in refusal.conflicts[1:]]
    assert set(drives) <= {
        "leap-frog/deploy/stage-1/robot-0-leg-1: robot 0 drives 5.0 m to (5, 0)",
        "leap-frog/deploy/stage-2/robot-1-leg-1: robot 1 drives 6.0 m to (5, 0)",
        "leap-frog/deploy/stage-2/robot-1-leg-2: robot 1 drives 5.0 m to (10, 0)",
    }
    lengths_m = [float(re.findall(r"drives ([\d.]+) m", text)[0]) for text in drives]
    assert 0.9 * sum(drive_s(length_m, BODY) for length_m in lengths_m) > 20.0  # they conflict by themselves
    least_s = 0.9 * sum(drive_s(length_m, BODY) for length_m in (5.0, 6.0, 5.0))
    assert refusal.mend == (
        f"the call: leap-frog ends at most {math.ceil(least_s * 10) / 10:g} s after the plan begins",
    )
    (longer,) = refusal.calls[refusal.mend[0]].constraints
    assert longer.model_dump() == deadline | {"task": "", "seconds": math.ceil(least_s * 10) / 10}


def test_two_conflicts_are_mended_by_two_changes() -> None:
    constraints = [
        {"kind": "deadline", "seconds": 1.0, "task": "to-crossing"},
        {"kind": "deadline", "seconds": 60.0, "task": "beyond/group"},
    ]
    refusal = assert_mends(Scene(), "wean", 1, parameters=WEAN, constraints=constraints)
    assert refusal.mend[0].count("; and ") == 1
    assert len(refusal.calls) == 1
    deadline, within = {"kind": "deadline", "seconds": 60.0}, {"kind": "within", "task": "beyond/leap", "seconds": 10.0}
    refusal = Scene().refusal("wean", parameters=WEAN, constraints=[deadline, within])
    assert len(refusal.mend) == 1
    assert re.sub(r"[\d.]+", "#", refusal.mend[0]) == (
        "the call: wean ends at most # s after the plan begins; "
        "and the call: wean/beyond/leap ends at most # s after wean/beyond/leap starts"
    )


def test_a_time_out_that_is_too_short_is_told(tmp_path: Path) -> None:
    play = {
        "parameters": {"r": {"kind": "robot"}, "patience_s": {"kind": "number", "default": 10}},
        "tasks": [{"kind": "go", "robot": "r", "to": [20, 0], "time_out_s": "patience_s"}],
    }
    refusal = assert_mends(scene_of(tmp_path, play), "mine", 1, parameters={})
    assert refusal.conflicts[0] == "mine/go: times out after 10 s"


def test_a_robot_cannot_do_two_things_at_once(tmp_path: Path) -> None:
    go = {"kind": "go", "robot": "r"}
    play = {
        "parameters": {"r": {"kind": "robot"}},
        "order": "parallel",
        "tasks": [go | {"label": "a", "to": [5, 0]}, go | {"label": "b", "to": [9, 0]}],
    }
    refusal = assert_mends(scene_of(tmp_path, play), "mine", 2)
    assert refusal.conflicts == ("robot 0 is wanted by mine/a and by mine/b at once",)
    assert refusal.mend == ("mine/b after mine/a", "mine/a after mine/b")


def test_contradicting_orders_are_told() -> None:
    before = {"kind": "before", "first": "beyond/group", "then": "beyond/leap"}
    refusal = assert_mends(Scene(), "wean", 2, parameters=WEAN, constraints=[before])
    assert refusal.mend == tuple(f"without: {text}" for text in refusal.conflicts[:2])
    assert {text: call.constraints for text, call in refusal.calls.items()} == {refusal.mend[1]: ()}  # not the play's
    assert refusal.conflicts[:2] == (
        "wean: wean/beyond/group starts at least 5 s after wean/beyond/leap starts",
        "the call: wean/beyond/leap starts any time after wean/beyond/group ends",
    )


def test_a_refusal_comes_at_once() -> None:
    """Each length is asked of the navigation layer once a call, whatever is tried to mend it."""
    scene = Scene([BODY] * 8)
    places = [[3.0 * at, float(at % 3)] for at in range(1, 9)]
    scene.plan("deploy/group", places=places)
    once = scene.floor.asked
    scene.floor.asked = 0
    scene.refusal("deploy/group", places=places, constraints=[{"kind": "deadline", "seconds": 10}])
    assert scene.floor.asked <= once


def test_expected_times_lie_between_the_earliest_and_forever() -> None:
    scene = Scene(parameters=PlannerParameters(timing=TimingParameters(turns_s=0.0, least_share=1.0)))
    plan = scene.plan("deploy/leap-frog", places=NEAR_FAR)
    sum_s = sum(drive_s(length_m, BODY) for length_m in (5.0, 6.0, 5.0))
    assert scene.planner.expected_s(plan, scene.starts_m) == pytest.approx(sum_s, abs=1e-6)
    assert schedule(plan, scene)["leap-frog", "end"] == pytest.approx(sum_s, abs=1e-6)


EXPLORED_S = 100.0


def exploring(explorers: Mapping[int, Body], places_m: Mapping[int, Place]) -> float:
    """Return that it takes so long, and a second more for each metre of the first robot from base."""
    return EXPLORED_S + math.dist(places_m[0], (0.0, 0.0))


DEADLINE = {"kind": "deadline", "seconds": 60.0}


def test_an_area_that_is_too_large_for_the_time_is_refused_with_the_least_time() -> None:
    """Paper 004, section 4: "a user might request a team of robots to map an area that is too large"."""
    refusal = assert_mends(Scene(exploring=exploring), "explore", 1, parameters={"robots": 2}, constraints=[DEADLINE])
    assert refusal.conflicts == (
        "the call: explore ends at most 60 s after the plan begins",
        "explore/explore: exploring takes at least 100.0 s",
    )
    assert refusal.mend == ("the call: explore ends at most 100 s after the plan begins",)


def test_what_is_offered_for_a_survey_leaves_time_to_explore() -> None:
    refusal = assert_mends(Scene(exploring=exploring), "survey", 1, places=NEAR_FAR, constraints=[DEADLINE])
    (least_s,) = re.findall(r"at most ([\d.]+) s", refusal.mend[0])
    assert float(least_s) > EXPLORED_S + 0.9 * drive_s(5.0, BODY)


def test_nobody_knows_how_long_exploring_takes_in_the_end() -> None:
    scene = Scene(exploring=exploring)
    for play, more in (("explore", {"parameters": {"robots": 2}}), ("survey", {"places": NEAR_FAR})):
        plan = scene.plan(play, **more)
        assert math.isinf(scene.planner.expected_s(plan, scene.starts_m))
        assert schedule(plan, scene)[plan.root.name, "end"] >= EXPLORED_S


def test_a_robot_that_has_explored_may_be_anywhere(tmp_path: Path) -> None:
    """It may be where it is to go next already; only from there on it is known where it is."""
    go = {"kind": "go", "robot": "r"}
    tasks = [
        {"kind": "explore", "robots": ["r"]},
        go | {"label": "a", "to": [50, 0]},
        go | {"label": "b", "to": [0, 0]},
    ]
    scene = scene_of(tmp_path, {"parameters": {"r": {"kind": "robot"}}, "tasks": tasks}, exploring=exploring)
    plan = scene.plan("mine")
    ends_s = schedule(plan, scene)
    assert ends_s["mine/explore", "end"] == ends_s["mine/a", "end"] == EXPLORED_S
    assert ends_s["mine/b", "end"] == pytest.approx(EXPLORED_S + 0.9 * drive_s(50.0, BODY))


@pytest.mark.parametrize(
    ("order", "tasks", "least_s"),
    [
        ("serial", ["go", "explore"], EXPLORED_S + 20.0),  # by where the robot is when it begins to explore
        ("parallel", ["go", "explore"], 0.0),  # who drives about meanwhile sees, too
        ("serial", ["explore", "explore"], EXPLORED_S),  # what was seen once is seen
    ],
)
def test_what_else_is_seen_makes_exploring_shorter(
    tmp_path: Path, order: str, tasks: list[str], least_s: float
) -> None:
    steps = {"go": {"kind": "go", "robot": "r", "to": [20, 0]}, "explore": {"kind": "explore", "robots": ["q"]}}
    robots = {"r": {"kind": "robot"}, "q": {"kind": "robot"}}
    play = {"parameters": robots, "order": order, "tasks": [steps[name] for name in tasks]}
    scene = scene_of(tmp_path, play, exploring=exploring)
    plan = scene.plan("mine", roles={"r": 0, "q": 1} if "go" in tasks else {})
    times_s = schedule(plan, scene)
    explored = [name for name, edge in times_s if edge == "end" and "explore" in name]
    assert sum(times_s[name, "end"] - times_s[name, "start"] for name in explored) == pytest.approx(least_s)


def test_nobody_knows_what_robots_that_are_lost_have_seen() -> None:
    scene = Scene(exploring=exploring)
    del scene.starts_m[3]
    assert isinstance(scene.call("explore", parameters={"robots": 2}, constraints=[DEADLINE]), Plan)


def test_a_play_of_which_it_is_known_how_long_it_takes_is_taken_for_the_quicker(tmp_path: Path) -> None:
    explore = {"kind": "explore", "robots": ["r"]}
    stand = {"kind": "wait", "seconds": 5000}
    robot = {"parameters": {"r": {"kind": "robot"}}}
    plays = {
        "a": robot | {"tasks": [explore, {"kind": "wait", "seconds": 9}]},
        "b": robot | {"tasks": [explore]},
        "c": robot | {"order": "parallel", "tasks": [explore | {"ends_with": "wait"}, stand]},
    }
    assert scene_of(tmp_path, {"plays": plays}, exploring=exploring).plan("mine").play == "mine/c"
    del plays["c"]
    assert scene_of(tmp_path, {"plays": plays}, exploring=exploring).plan("mine").play == "mine/b"


def test_robots_of_one_team_differ_in_speed() -> None:
    bodies = [Body(speed_mps=1.0, acceleration_mps2=1.0), Body(speed_mps=0.25, acceleration_mps2=1.0)]
    scene = Scene(bodies, parameters=PlannerParameters(timing=TimingParameters(turns_s=0.0)))
    times_s = [
        scene.planner.expected_s(scene.plan("photo", parameters={"place": [9, 0], "robot": robot}), scene.starts_m)
        for robot in (0, 1)
    ]
    assert times_s == [pytest.approx(9.0 + 1.0 + 5.0), pytest.approx(10.0 / 0.25 + 0.25 + 5.0)]
