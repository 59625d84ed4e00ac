"""The three strategies against the loops of Fig. 3."""

from typing import get_args

import pytest

from protocols.deployment.planning.methods import Move, expanded, expanded_to, stages
from protocols.deployment.tasks.plan import Deployment, Go, Place, Strategy, Task

STRATEGIES: tuple[Strategy, ...] = get_args(Strategy)


def deployment(strategy: Strategy, size: int) -> Deployment:
    """Return the deployment of the robots size, size - 1, ..., 1."""
    return Deployment(
        strategy=strategy,
        robots=tuple(range(size, 0, -1)),
        places_m=tuple((float(place), 0.0) for place in range(size)),
    )


def fig_3(strategy: Strategy, deploy_list: list[tuple[int, Place]]) -> list[list[tuple[int, Place]]]:
    """Return what the loops of Fig. 3 spawn, written down as they stand there."""
    length, spawned = len(deploy_list), list[list[tuple[int, Place]]]()
    for phase in range(length):
        stage = list[tuple[int, Place]]()
        if strategy == "group":
            for j in range(phase, length):
                stage.append((deploy_list[j][0], deploy_list[phase][1]))
        elif strategy == "wave":
            k = length - 1
            for j in range(phase + 1):
                stage.append((deploy_list[k - phase + j][0], deploy_list[j][1]))
        else:
            for j in range(phase + 1):
                stage.append((deploy_list[phase][0], deploy_list[j][1]))
        spawned.append(stage)
    return spawned


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("size", [1, 2, 3, 8])
def test_stages_are_the_loops_of_figure_3(strategy: Strategy, size: int) -> None:
    act = deployment(strategy, size)
    found = [[(move.robot, move.place_m) for move in stage] for stage in stages(act)]
    assert found == fig_3(strategy, list(zip(act.robots, act.places_m, strict=True)))


@pytest.mark.parametrize(
    ("strategy", "moving"), [("group", [4, 3, 2, 1]), ("wave", [1, 2, 3, 4]), ("leap_frog", [1, 1, 1, 1])]
)
def test_as_many_robots_move_as_the_paper_says(strategy: Strategy, moving: list[int]) -> None:
    assert [len({move.robot for move in stage}) for stage in stages(deployment(strategy, 4))] == moving


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_robot_ends_up_at_its_own_place(strategy: Strategy) -> None:
    act = deployment(strategy, 5)
    moves = [move for stage in stages(act) for move in stage]
    assert {move.robot: move.place_m for move in moves} == dict(zip(act.robots, act.places_m, strict=True))
    assert [move for move in moves if move.final] == [
        Move(robot, dict(zip(act.robots, act.places_m, strict=True))[robot], True)
        for robot in (move.robot for move in moves if move.final)
    ]
    assert sum(move.final for move in moves) == 5


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_an_expanded_task_has_its_stages_in_series_and_says_still_what_it_is(strategy: Strategy) -> None:
    task = Task(name="a/deploy", act=deployment(strategy, 3), time_out_s=9.0, on_failure="skip")
    whole = expanded(task)
    assert (whole.act, whole.time_out_s, whole.on_failure, whole.order) == (task.act, 9.0, "skip", "serial")
    assert [each.name for each in whole.subtasks] == [f"a/deploy/stage-{number}" for number in (1, 2, 3)]
    order = "serial" if strategy == "leap_frog" else "parallel"
    assert {each.order for each in whole.subtasks} == {order}
    names = [each.name for each in whole.walk()]
    assert len(set(names)) == len(names)
    assert expanded(whole) == whole


def test_a_task_that_is_no_deployment_is_expanded_to_itself() -> None:
    task = Task(name="go", act=Go(robot=1, place_m=(0.0, 0.0)))
    assert expanded(task) == task


def test_deployments_are_expanded_down_to_a_depth() -> None:
    inner = Task(name="top/b/c", act=deployment("wave", 2))
    top = Task(
        name="top",
        subtasks=(Task(name="top/a", act=deployment("group", 2)), Task(name="top/b", subtasks=(inner,))),
    )
    found = {
        depth: sum(bool(isinstance(task.act, Deployment) and task.subtasks) for task in expanded_to(top, depth).walk())
        for depth in (0, 1, 2, None)
    }
    assert found == {0: 0, 1: 1, 2: 2, None: 2}
