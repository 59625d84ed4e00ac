"""Plays that a person writes by mistake, or that mean something unusual: told, or planned as they are meant."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from cosim.errors import UserError
from protocols.deployment.tasks.plan import Explore, Go, Plan, Task
from tests.protocols.deployment.plays_scene import BODY, OpenFloor, Scene, playbook_of, reader

ROBOT = {"kind": "robot"}
WAIT = {"kind": "wait", "seconds": 1}


def of(folder: Path, **play: Any) -> Scene:
    """Return a scene with one more play, ``mine``."""
    (folder / "mine.yaml").write_text(yaml.safe_dump(play), encoding="utf-8")
    return Scene(playbook=playbook_of(folder))


def two(kind: str, **more: Any) -> list[dict[str, Any]]:
    """Return two tasks of a kind, of a robot each; *more*: by task, what else is said of both."""
    who = {"a": "r", "b": "s"}
    named = {label: {"robots": [robot]} if kind == "explore" else {"robot": robot} for label, robot in who.items()}
    return [{"kind": kind, "label": label, **named[label], **more.get(label, {})} for label in who]


def before(first: str, then: str) -> dict[str, str]:
    return {"kind": "before", "first": first, "then": then}


# ---------------------------------------------------------------- circles

BOTH_WAYS = [before("a", "b"), before("b", "a")]
GOING = {"a": {"to": [5, 0], "ends_with": "b"}, "b": {"to": [9, 0], "ends_with": "a"}}


@pytest.mark.parametrize(
    ("tasks", "order", "constraints", "conflicts"),
    [
        (two("photo"), "parallel", BOTH_WAYS, ["b starts any time after mine/a", "a starts any time after mine/b"]),
        (two("explore"), "parallel", BOTH_WAYS, ["b starts any time after mine/a", "a starts any time after mine/b"]),
        (
            two("go", **GOING),
            "parallel",
            BOTH_WAYS,
            ["b starts any time after mine/a", "a starts any time after mine/b"],
        ),
        (two("explore"), "parallel", [before("a", "a")], ["a starts any time after mine/a"]),
        (two("explore"), "serial", [before("b", "a")], ["a starts any time after mine/b"]),
        (two("photo"), "serial", [before("a", "b"), before("b", "a")], ["a starts any time after mine/b"]),
    ],
)
def test_who_would_have_to_wait_for_his_own_end_is_refused_and_told_which_order_to_drop(
    tmp_path: Path, tasks: list[dict[str, Any]], order: str, constraints: list[Any], conflicts: list[str]
) -> None:
    play: dict[str, Any] = {"parameters": {"r": ROBOT, "s": ROBOT}, "order": order, "tasks": tasks}
    found = of(tmp_path, **play, constraints=constraints).refusal("mine")
    texts = [f"mine: mine/{conflict} ends" for conflict in conflicts]
    assert sorted(found.conflicts) == sorted(texts)
    assert sorted(found.mend) == sorted(f"without: {text}" for text in texts)
    for left_out in range(len(constraints)):
        left = [each for at, each in enumerate(constraints) if at != left_out]
        fine = not left or (order == "serial" and left == [before("a", "b")]) or order == "parallel"
        assert isinstance(of(tmp_path, **play, constraints=left).call("mine"), Plan) is fine


def test_tasks_that_start_together_leave_the_others_in_their_order(tmp_path: Path) -> None:
    together = [
        {"kind": "after", "task": one, "of": other, "of_edge": "start"} for one, other in (("v", "w"), ("w", "v"))
    ]
    scene = of(
        tmp_path,
        parameters={"r": ROBOT},
        order="parallel",
        tasks=[
            *({"kind": "go", "label": label, "robot": "r", "to": to} for label, to in (("x", [9, 0]), ("y", [5, 0]))),
            *(WAIT | {"label": label} for label in ("v", "w")),
        ],
        constraints=[before("y", "x"), *together],
    )
    plan = scene.plan("mine")
    spans = scene.planner.windows_s(plan, scene.starts_m)
    starts = {point.task: least for point, (least, _) in spans.items() if point.edge == "start"}
    assert starts["mine/v"] == starts["mine/w"] == 0.0
    assert (starts["mine/x"] or 0.0) > 5.0, "it drives to y first, 5 m"


# ---------------------------------------------------------------- names


def test_a_task_that_is_called_like_the_net_around_it_keeps_its_own_time_out(tmp_path: Path) -> None:
    go = {"kind": "go", "label": "a", "robot": "r", "to": [20, 0], "time_out_s": 500}
    net = {"kind": "net", "label": "a", "time_out_s": 30, "on_failure": "skip", "tasks": [go, WAIT]}
    photo = {"kind": "play", "label": "photo", "play": "photo", "given": {"place": [20, 0]}, "time_out_s": 300}
    scene = of(tmp_path, parameters={"r": ROBOT}, tasks=[net, photo])
    (task,) = scene.plan("mine/a/a").root.walk()
    assert (task.time_out_s, task.on_failure) == (500.0, "fail")
    (task,) = scene.plan("mine/photo/photo").root.walk()
    assert task.time_out_s is None
    assert scene.plan("mine/photo").root.time_out_s == 300.0


@pytest.mark.parametrize("name", ["Patrol", "my play", "a.b", "_x", "über"])
def test_a_file_whose_name_cannot_be_that_of_a_play_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump({"tasks": [WAIT]}), encoding="utf-8")
    with pytest.raises(UserError) as raised:
        playbook_of(tmp_path)
    assert (
        str(raised.value) == f"{tmp_path / name}.yaml: {name!r} is no name of a play, expected a-z, 0-9, _ and - only"
    )


def test_a_robot_is_not_called_like_one_of_several_others(tmp_path: Path) -> None:
    tasks = [{"kind": "go", "robot": "guard-1", "to": [5, 0]}, {"kind": "return", "robots": ["guard"]}]
    several = {"kind": "robots", "default": 2}
    with pytest.raises(UserError, match=r"parameters.guard-1: 'guard-1' is what one of the robots guard is called"):
        of(tmp_path, parameters={"guard-1": ROBOT, "guard": several}, tasks=tasks)
    tasks[0]["robot"] = "guard-a"
    assert of(tmp_path, parameters={"guard-a": ROBOT, "guard": several}, tasks=tasks).plan("mine").robots == (0, 1, 2)


# ---------------------------------------------------------------- robots


def test_a_robot_that_is_named_twice_gathers_and_explores_once(tmp_path: Path) -> None:
    tasks = [
        {"kind": "gather", "robots": ["r", "s", "r"], "at": [5, 0], "towards": [20, 0]},
        {"kind": "explore", "robots": ["s", "s", "r"]},
    ]
    plan = of(tmp_path, parameters={"r": ROBOT, "s": ROBOT}, tasks=tasks).plan("mine")
    acts = [task.act for task in plan.root.walk()]
    gathering = [(act.robot, act.place_m) for act in acts if isinstance(act, Go)]
    (first, at_m), (second, behind_m) = gathering
    assert {first, second} == {0, 1}
    assert (at_m, behind_m) == ((6.5, 0.0), (5.0, 0.0))
    assert [act.robots for act in acts if isinstance(act, Explore)] == [(second, first)]


def test_no_play_asks_for_more_robots_than_there_are_addresses(tmp_path: Path) -> None:
    of(tmp_path, parameters={"r": {"kind": "robots", "default": 256}}, tasks=[WAIT])
    with pytest.raises(UserError, match=r"parameters.r.robots.default: 257 is not <= 256|r.default: 257 is not <= 256"):
        of(tmp_path, parameters={"r": {"kind": "robots", "default": 257}}, tasks=[WAIT])


def test_who_fits_through_the_waypoints_of_a_call_is_chosen() -> None:
    """Robot 0 is nearer, but too wide for (5, 0)."""
    wide, narrow = BODY._replace(radius_m=0.6), BODY
    scene = Scene(bodies=(wide, narrow), floor=OpenFloor([(5.0, 1.0, 0.5)]))
    assert scene.plan("photo", parameters={"place": [10, 0]}).robots == (0,)
    assert scene.plan("photo", parameters={"place": [10, 0]}, via={"go": [[5, 0]]}).robots == (1,)


# ---------------------------------------------------------------- times


def test_a_mend_is_told_to_the_tenth_of_a_second_however_long_it_takes(tmp_path: Path) -> None:
    scene = of(tmp_path, tasks=[WAIT | {"seconds": 123456.3}])
    refusal = scene.refusal("mine", constraints=[{"kind": "deadline", "seconds": 1000}])
    assert refusal.conflicts[1] == "mine/wait: lasts 123456.3 s"
    assert refusal.mend == ("the call: mine ends at most 123456.3 s after the plan begins",)
    assert scene.plan("mine", constraints=[{"kind": "deadline", "seconds": 123456.3}])
    late = of(tmp_path, tasks=[WAIT | {"seconds": 123456.3, "time_out_s": 5}])
    assert late.refusal("mine").mend == ("mine/wait: times out after 123456.3 s",)


def test_a_constraint_that_leaves_no_time_is_a_mistake_where_it_stands(tmp_path: Path) -> None:
    after = {"kind": "after", "task": "b", "of": "a", "at_least_s": 10, "at_most_s": 5}
    tasks = [WAIT | {"label": label} for label in ("a", "b")]
    with pytest.raises(UserError, match=r"constraints\[0\].at_most_s: 5.0 is not >= 10, at_least_s$"):
        of(tmp_path, tasks=tasks, constraints=[after])
    assert isinstance(of(tmp_path, tasks=tasks, constraints=[after | {"at_least_s": 5}]).plan("mine").root, Task)


@pytest.mark.parametrize("text", ["2024-02-30", "0x_", "9" * 5000, "!!int x"])
def test_what_looks_like_a_number_or_a_date_and_is_none_is_told_with_its_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"tasks: [{{kind: wait, seconds: 1}}]\nabout: {text}\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"mine.yaml: line 2, column 8: .* is no (timestamp|int): "):
        reader(path)


def test_a_tag_that_does_not_fit_is_no_yaml(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("tasks: !!map [a]\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"mine.yaml: "):
        reader(path)
