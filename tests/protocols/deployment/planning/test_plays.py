"""Plays in YAML: the library is valid, what is wrong in one is told by file and place, nets become tasks."""

from pathlib import Path

import pytest
import yaml

from cosim.errors import UserError
from protocols.deployment.planning.binding import MissingParametersError
from protocols.deployment.planning.play import Play, labels
from protocols.deployment.planning.playbook import BUILT_IN, Playbook
from protocols.deployment.tasks.plan import Deployment, Explore, Face, Go, Photo, Plan, Task, Wait
from tests.protocols.deployment.planner_scene import scene_of
from tests.protocols.deployment.plays_scene import Scene, built_in, paths_of, playbook_of, reader
from tests.protocols.deployment.random_plays import RandomCall, random_calls
from tests.tiers import tiers

WEAN = {
    "crossing": [10, 0],
    "leap_places": [[20, 0], [30, 0]],
    "group_places": [[10, 10], [10, 20]],
}


def library(folder: Path, **plays: object) -> Playbook:
    """Return a library of files written there."""
    for name, play in plays.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(play))
    return playbook_of(folder)


def acts(plan: Plan) -> list[object]:
    return [task.act for task in plan.root.walk() if task.leaf]


# ---------------------------------------------------------------- our own


def test_the_library_has_the_plays_of_the_paper() -> None:
    paths = paths_of(built_in())
    assert {"deploy", "deploy/group", "deploy/wave", "deploy/leap-frog"} < set(paths)
    assert {"return", "photo", "explore", "survey", "wean"} < set(paths)
    assert all(built_in().play(path).about for path in paths)


def test_the_typical_scenario_of_section_7() -> None:
    """One group stage to B; then two leap-frog to C and D, while two others deploy as a group to E and F."""
    scene = Scene()
    plan = scene.plan("wean", parameters=WEAN)
    gather, beyond = plan.root.subtasks
    assert gather.order == "parallel"
    goes = [task.act for task in gather.subtasks]
    assert [go.place_m for go in goes if isinstance(go, Go)] == [(14.5, 0.0), (13.0, 0.0), (11.5, 0.0), (10.0, 0.0)]
    leap, group = (task.act for task in beyond.subtasks)
    assert isinstance(leap, Deployment)
    assert isinstance(group, Deployment)
    assert (leap.strategy, leap.places_m) == ("leap_frog", ((20.0, 0.0), (30.0, 0.0)))
    assert (group.strategy, group.places_m) == ("group", ((10.0, 10.0), (10.0, 20.0)))
    assert sorted(leap.robots + group.robots) == [0, 1, 2, 3]
    assert isinstance(goes[0], Go)
    assert goes[0].robot == leap.robots[0]  # who leaps first stands in front of all
    assert [(go.behind, go.behind_m) for go in goes if isinstance(go, Go)] == [
        (None, 0.0),
        *((robot, 1.5) for robot in (*leap.robots, *group.robots)[:3]),
    ]
    (after,) = plan.constraints
    assert (after.earlier.task, after.earlier.edge) == ("wean/beyond/leap", "start")
    assert (after.later.task, after.later.edge, after.at_least_s) == ("wean/beyond/group", "start", 5.0)


def test_explore_return_deploy() -> None:
    scene = Scene()
    found = acts(scene.plan("survey", places=[[5, 0], [9, 0]], parameters={"strategy": "wave"}))
    assert isinstance(found[0], Explore)
    assert {go.robot: go.place_m for go in found[1:3] if isinstance(go, Go)} == {
        robot: scene.starts_m[robot] for robot in found[0].robots
    }
    assert isinstance(found[3], Deployment)
    assert found[3].strategy == "wave"


def test_a_picture_is_taken_where_the_robot_has_gone() -> None:
    plan = Scene().plan("photo", parameters={"place": "hall"})
    go, photo = acts(plan)
    assert isinstance(go, Go)
    assert isinstance(photo, Photo)
    assert (go.place_m, go.robot) == ((30.0, 0.0), photo.robot)


def test_who_watches_faces_a_place_where_it_has_gone() -> None:
    scene = Scene()
    go, face = acts(scene.plan("watch", parameters={"place": "hall", "towards": [9, 4]}))
    assert isinstance(go, Go)
    assert face == Face(robot=go.robot, towards_m=(9.0, 4.0))
    with pytest.raises(UserError, match="towards"):
        scene.plan("watch", parameters={"place": "hall"})


def test_robots_return_to_their_own_places() -> None:
    scene = Scene()
    goes = acts(scene.plan("return", parameters={"robots": [2, 0]}))
    assert [(go.robot, go.place_m) for go in goes if isinstance(go, Go)] == [(2, (-2.0, 0.0)), (0, (0.0, 0.0))]


# ---------------------------------------------------------------- levels


@pytest.mark.parametrize(
    ("path", "name", "size"),
    [
        ("wean", "wean", 4),
        ("wean/to-crossing", "to-crossing", 4),
        ("wean/beyond", "beyond", 4),
        ("wean/beyond/leap", "leap", 2),
        ("wean/beyond/leap/stage-2", "leap/stage-2", 1),
        ("wean/beyond/group/stage-1", "group/stage-1", 2),
    ],
)
def test_a_play_is_called_at_any_level_of_the_tree(path: str, name: str, size: int) -> None:
    plan = Scene().plan(path, parameters=WEAN)
    assert (plan.root.name, len(plan.robots), plan.play) == (name, size, path)


def test_a_stage_is_called_without_the_only_task_of_its_play() -> None:
    plan = Scene().plan("deploy/wave/stage-1", places=[[5, 0], [9, 0]])
    assert [task.name for task in plan.root.walk()] == ["deploy/stage-1", "deploy/stage-1/robot-0"]


def test_a_task_wants_only_the_parameters_that_it_makes_use_of() -> None:
    given = {"leap_places": [[20, 0], [30, 0]]}
    assert Scene().plan("wean/beyond/leap", parameters=given).robots == (0, 1)
    with pytest.raises(MissingParametersError) as error:
        Scene().call("wean/beyond", parameters=given)
    assert error.value.names == ("group_places",)


def test_all_parameters_that_are_missing_are_told_at_once() -> None:
    with pytest.raises(MissingParametersError) as error:
        Scene().call("wean")
    assert error.value.names == ("crossing", "leap_places", "group_places")
    assert str(error.value) == (
        "wean wants to know more: crossing (a place: [x, y] in metres, or a name), "
        "leap_places (places: [[x, y], ...] in metres, or names), "
        "group_places (places: [[x, y], ...] in metres, or names)"
    )


def test_missing_are_those_that_waypoints_plays_within_and_constraints_make_use_of(tmp_path: Path) -> None:
    known = ["corner", "goal", "how", "latest", "spots", "unused"]
    kinds = dict(zip(known, ["place", "place", "strategy", "number", "places", "number"], strict=True))
    play = {
        "parameters": {"r": {"kind": "robot"}} | {name: {"kind": kind} for name, kind in kinds.items()},
        "tasks": [
            {"kind": "go", "robot": "r", "to": "goal", "via": [[1, 1], "corner"]},
            {"kind": "play", "play": "survey", "given": {"places": ["spots"], "strategy": "how", "robots": 2}},
        ],
        "constraints": [{"kind": "deadline", "seconds": "latest"}],
    }
    scene = scene_of(tmp_path, play)
    for path, names in (("mine", known[:-1]), ("mine/go", ["corner", "goal"]), ("mine/play", ["how", "spots"])):
        with pytest.raises(MissingParametersError) as error:
            scene.call(path)
        assert list(error.value.names) == names


def test_a_folder_is_the_quickest_play_in_it() -> None:
    scene = Scene()
    places = [[5, 0], [10, 0], [15, 0]]
    plans = [scene.plan(path, places=places) for path in built_in().below("deploy")]
    found = scene.plan("deploy", places=places)
    assert found in plans
    assert scene.planner.expected_s(found, scene.starts_m) == min(
        scene.planner.expected_s(plan, scene.starts_m) for plan in plans
    )


@pytest.mark.parametrize(
    ("path", "error"),
    [
        ("deploy/gruop", "play: there is no 'deploy/gruop', did you mean deploy/group?"),
        ("wean/beyond/laep", "wean: there is no task 'laep' in beyond, did you mean leap?"),
        ("wean/beyond/leap/stage-3", "there is no task 'stage-3' in leap, did you mean stage-2?"),
        ("photo/go/further", "there is no task 'further' in go, and there is none"),
    ],
)
def test_a_path_that_leads_nowhere_is_told(path: str, error: str) -> None:
    with pytest.raises(UserError) as raised:
        Scene().call(path, parameters=WEAN if path.startswith("wean") else {"place": "hall"})
    assert str(raised.value) == error


def test_the_tree_is_told_with_all_that_can_be_called() -> None:
    tree = {branch["name"]: branch for branch in built_in().tree()}
    assert [branch["path"] for branch in tree["deploy"]["plays"]] == ["deploy/group", "deploy/wave", "deploy/leap-frog"]
    assert tree["wean"]["parameters"]["crossing"]["kind"] == "place"
    beyond = tree["wean"]["tasks"][1]
    assert [twig["path"] for twig in beyond["tasks"]] == ["wean/beyond/leap", "wean/beyond/group"]


# ---------------------------------------------------------------- a user's own


def test_a_users_library_is_added_to_ours(tmp_path: Path) -> None:
    play = {
        "parameters": {"scout": {"kind": "robot", "needs": {"camera": True}}, "far": {"kind": "place"}},
        "order": "parallel",
        "tasks": [
            {"kind": "go", "robot": "scout", "to": "far", "via": [[1, 1]], "time_out_s": 60, "on_failure": "retry"},
            {"kind": "wait", "seconds": 10},
            {"kind": "wait", "seconds": 20, "ends_with": "go"},
        ],
    }
    playbook = library(tmp_path, mine={"about": "Mine.", "plays": {"look": play}})
    assert {"mine", "mine/look", "deploy/group"} < set(paths_of(playbook))
    root = Scene(playbook=playbook).plan("mine/look", parameters={"far": [3, 4], "scout": 1}).root
    assert root == Task(
        name="look",
        label="look",
        order="parallel",
        subtasks=(
            Task(
                name="look/go",
                label="go",
                act=Go(robot=1, place_m=(3.0, 4.0), via_m=((1.0, 1.0),)),
                time_out_s=60.0,
                on_failure="retry",
            ),
            Task(name="look/wait-1", label="wait-1", act=Wait(seconds=10.0)),
            Task(name="look/wait-2", label="wait-2", act=Wait(seconds=20.0), ends_with="look/go"),
        ),
    )


def test_a_library_may_be_one_file(tmp_path: Path) -> None:
    path = tmp_path / "library.yaml"
    path.write_text(yaml.safe_dump({"plays": {"pause": {"tasks": [{"kind": "wait", "seconds": 1}]}}}))
    assert "pause" in paths_of(Playbook.read([BUILT_IN, path], reader))
    path.write_text(yaml.safe_dump({"tasks": [{"kind": "wait", "seconds": 1}]}))
    with pytest.raises(UserError, match="is a play, expected a folder"):
        Playbook.read([path], reader)


def test_a_play_in_a_play_gets_its_parameters_and_finds_its_own_robots(tmp_path: Path) -> None:
    inner = {"kind": "play", "label": "in", "play": "deploy/wave", "given": {"places": ["a", [9, 0]]}}
    outer = {
        "parameters": {"a": {"kind": "place"}, "team": {"kind": "robots", "default": 2}},
        "order": "parallel",
        "tasks": [
            inner,
            {**inner, "label": "too", "play": "deploy/group", "given": {"robots": "team", "places": [[4, 9], "b"]}},
        ],
    }
    outer["parameters"]["b"] = {"kind": "place", "default": [8, 9]}  # type: ignore[index]
    scene = Scene(playbook=library(tmp_path, outer=outer))
    plan = scene.plan("outer", parameters={"a": [5, 0], "team": [3, 2]})
    wave, group = acts(plan)
    assert isinstance(wave, Deployment)
    assert isinstance(group, Deployment)
    assert (wave.places_m, set(wave.robots)) == (((5.0, 0.0), (9.0, 0.0)), {0, 1})
    assert (group.places_m, group.robots) == (((4.0, 9.0), (8.0, 9.0)), (3, 2))
    assert plan.root.subtasks[0].subtasks[0].name == "outer/in/deploy"


def test_unnamed_tasks_are_called_by_their_kinds() -> None:
    wait, go = {"kind": "wait", "seconds": 1}, {"kind": "go", "robot": "r", "to": [0, 0]}
    play = Play.model_validate({"tasks": [wait, go, wait, {**go, "label": "there"}, wait]})
    assert labels(play.tasks) == ["wait-1", "go", "wait-2", "there", "wait-3"]


TASK = {"kind": "go", "robot": "r", "to": [1, 2]}
PLAY = {"parameters": {"r": {"kind": "robot"}, "n": {"kind": "number"}}, "tasks": [TASK]}


@pytest.mark.parametrize(
    ("play", "error"),
    [
        (PLAY | {"tasks": []}, "bad has neither tasks and plays, expected one of them"),
        (PLAY | {"plays": {"x": PLAY}}, "bad has both tasks and plays, expected one of them"),
        (PLAY | {"tasks": [TASK | {"robot": "q"}]}, "tasks[0].robot: 'q' is no parameter that is a robot"),
        (PLAY | {"tasks": [TASK | {"to": "n"}]}, "tasks[0].to: 'n' is a parameter of kind number, expected a place"),
        (PLAY | {"tasks": [TASK | {"to": [1, 2, 3]}]}, "[1, 2, 3] is not a place, expected [x, y] in metres"),
        (PLAY | {"tasks": [TASK | {"time_out_s": "m"}]}, "tasks[0].time_out_s: 'm' is no parameter that is a number"),
        (PLAY | {"tasks": [TASK | {"kind": "fly"}]}, "tasks[0].kind: 'fly' is not one of"),
        (PLAY | {"tasks": [TASK | {"speed": 1}]}, "1 is not expected here: there is no such key"),
        (PLAY | {"tasks": [TASK, TASK | {"label": "go"}, TASK | {"label": "go"}]}, "'go' is the label of another task"),
        (PLAY | {"tasks": [TASK | {"ends_with": "go"}]}, "tasks[0].ends_with: 'go' is no other task of the net"),
        (
            PLAY | {"constraints": [{"kind": "before", "first": "go", "then": "goo"}]},
            "constraints[0].then: 'goo' is no task of the net, did you mean go?",
        ),
        (
            PLAY | {"constraints": [{"kind": "deadline", "seconds": "r"}]},
            "constraints[0].seconds: 'r' is no parameter that is a number, expected one of n",
        ),
        (
            PLAY | {"tasks": [{"kind": "net", "tasks": [TASK, TASK | {"robot": "x"}]}]},
            "tasks[0].tasks[1].robot: 'x' is no parameter",
        ),
        (PLAY | {"tasks": [{"kind": "play", "play": "deploy"}]}, "tasks[0].play: 'deploy' is no play, did you mean"),
        (
            PLAY | {"tasks": [{"kind": "play", "play": "deploy/group", "given": {"spots": "n"}}]},
            "tasks[0].given.spots: deploy/group has no parameter 'spots'",
        ),
        (PLAY | {"tasks": [{"kind": "play", "play": "bad"}]}, "tasks[0].play: 'bad' is a task of itself: bad > bad"),
        (
            PLAY | {"tasks": [{"kind": "deploy", "strategy": "swarm", "robots": ["r"], "places": [[1, 2]]}]},
            "tasks[0].strategy: 'swarm' is no strategy, expected one of group, leap_frog, wave",
        ),
        (PLAY | {"parameters": {"base": {"kind": "robot"}}}, "parameters.base: 'base' has a meaning of its own"),
        (
            PLAY | {"parameters": {"r": {"kind": "robots", "as_many_as": "n"}}},
            "parameters.r.as_many_as: 'n' is no parameter of kind places",
        ),
        ({"plays": {"x": PLAY | {"tasks": [TASK | {"robot": "q"}]}}}, "plays.x.tasks[0].robot: 'q' is no parameter"),
    ],
)
def test_what_is_wrong_in_a_play_is_told_by_file_and_place(tmp_path: Path, play: object, error: str) -> None:
    with pytest.raises(UserError) as raised:
        library(tmp_path, bad=play)
    assert str(raised.value).startswith(f"{tmp_path / 'bad.yaml'}: ")
    assert error in str(raised.value)
    assert "\n" not in str(raised.value)


def test_plays_that_are_tasks_of_each_other_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="'one' is a task of itself: one > two > one"):
        library(
            tmp_path,
            one={"tasks": [{"kind": "play", "play": "two"}]},
            two={"tasks": [{"kind": "net", "tasks": [{"kind": "play", "play": "one"}]}]},
        )


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"nowhere": 1}, "there is no parameter 'nowhere', expected one of how, near, pause, robots"),
        ({"near": [1]}, "parameters.near: [1], expected a place: [x, y] in metres, or a name"),
        ({"near": "hal"}, "'hal' is not a place, did you mean hall?"),
        ({"robots": -1}, "parameters.robots: -1, expected a number of robots, or their addresses"),
        ({"robots": [1.5]}, "parameters.robots: [1.5], expected a number of robots, or their addresses"),
        ({"robots": 0}, "parameters.robots: 0, expected a number of robots"),
        ({"pause": -2}, "parameters.pause: -2, expected a number >= 0"),
        ({"pause": [3]}, "parameters.pause: [3], expected a number >= 0"),
        ({"how": "swarm"}, "'swarm' is not a strategy, expected one of group, leap_frog, wave"),
        ({"robots": [9]}, "roles: robots-1 is to be robot 9, expected one of 0 to 3"),
        ({}, "out wants to know more: near (a place: [x, y] in metres, or a name)"),
        ({"near": [0, 5], "robots": 2}, "2 robots are to deploy to 1 places, expected one place each"),
    ],
)
def test_what_is_wrong_in_a_call_is_told(tmp_path: Path, given: dict[str, object], error: str) -> None:
    play = {
        "parameters": {
            "near": {"kind": "place"},
            "robots": {"kind": "robots", "default": 1},
            "pause": {"kind": "number", "default": 1, "least": 0},
            "how": {"kind": "strategy", "default": "group"},
        },
        "tasks": [
            {"kind": "wait", "seconds": "pause"},
            {"kind": "deploy", "strategy": "how", "robots": ["robots"], "places": ["near"]},
        ],
    }
    scene = Scene(playbook=library(tmp_path, out=play))
    with pytest.raises(UserError) as raised:
        scene.call("out", parameters=given if not given or "near" in given else {"near": [1, 1]} | given)
    assert error in str(raised.value)


@pytest.mark.parametrize(
    ("task", "error"),
    [
        ({"kind": "wait", "seconds": "n"}, "mine: n is -1, expected >= 0"),
        ({"kind": "wait", "seconds": 1, "time_out_s": "n"}, "mine: n is -1, expected >= 0.1"),
        (
            {"kind": "gather", "robots": ["r"], "at": [1, 1], "towards": [9, 1], "apart_m": "n"},
            "n is -1, expected >= 0",
        ),
    ],
)
def test_numbers_that_a_task_cannot_have_are_told(tmp_path: Path, task: dict[str, object], error: str) -> None:
    parameters = {"r": {"kind": "robot"}, "n": {"kind": "number", "default": -1}}
    scene = Scene(playbook=library(tmp_path, mine={"parameters": parameters, "tasks": [task]}))
    with pytest.raises(UserError, match=error):
        scene.call("mine")
    with pytest.raises(UserError, match=r"parameters\.n: 1e\+300, expected a number"):
        scene.call("mine", parameters={"n": 1e300})
    parameters["n"]["default"] = 1e300  # type: ignore[assignment]
    with pytest.raises(UserError, match=r"parameters\.n\.default: 1e\+300 is not <= 1e\+09"):
        library(tmp_path, mine={"parameters": parameters, "tasks": [task]})


# ---------------------------------------------------------------- random ones


@tiers(15, 100, random_calls())
def test_a_random_valid_play_becomes_a_plan_that_says_all_that_the_play_says(case: RandomCall) -> None:
    playbook = case.playbook()
    plan, scene = case.plan()
    assert Plan.model_validate_json(plan.model_dump_json()) == plan
    assert paths_of(scene.planner.playbook) == paths_of(playbook)
    play = playbook.play("random")
    assert [task.label for task in plan.root.subtasks] == labels(play.tasks)
    written = case.text.count("kind: before") + case.text.count("kind: after")
    written += case.text.count("kind: within") + case.text.count("kind: deadline")
    assert len(plan.constraints) == written
    assert sum(task.time_out_s is not None for task in plan.root.walk()) == case.text.count("time_out_s")
    assert sum(task.ends_with is not None for task in plan.root.walk()) == case.text.count("ends_with")
    assert plan.robots == tuple(range(case.size))[: len(plan.robots)]
