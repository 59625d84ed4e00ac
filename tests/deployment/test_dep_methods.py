"""The three strategies against the loops of Fig. 3, and strategies that are switched while they run."""

from typing import get_args

import pytest

from protocols.deployment.methods import Move, expanded, expanded_to, stages, switched
from protocols.deployment.plan import Between, Deployment, Go, Instant, Place, Plan, Strategy, Task

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


def plan(strategy: Strategy, size: int, expand: bool = True) -> Plan:
    task = Task(name="deploy", act=deployment(strategy, size))
    return Plan(number=1, play="p", robots=tuple(range(1, size + 1)), root=expanded(task) if expand else task)


def last_places(task: Task) -> dict[int, Place]:
    """Return where each robot is after all moves below *task*, in their order."""
    whole = expand_all(task)
    return {each.act.robot: each.act.place_m for each in whole.walk() if isinstance(each.act, Go)}


def expand_all(task: Task) -> Task:
    task = expanded(task)
    return task.model_copy(update={"subtasks": tuple(expand_all(each) for each in task.subtasks)})


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


# ---------------------------------------------------------------- switching


@pytest.mark.parametrize("new", STRATEGIES)
@pytest.mark.parametrize("old", STRATEGIES)
@pytest.mark.parametrize("size", [2, 4])
def test_robots_keep_their_final_places_whenever_the_strategy_is_switched(
    old: Strategy, new: Strategy, size: int
) -> None:
    before = plan(old, size)
    leaves = [task for task in before.root.walk() if task.leaf]
    for count in range(len(leaves) + 1):
        finished = {task.name for task in leaves[:count]}
        after = switched(before, new, finished)
        assert last_places(after.root) == last_places(before.root)
        assert finished <= after.tasks.keys()
        deployed = {task.act.robot for task in leaves[:count] if isinstance(task.act, Go) and task.act.final}
        moving = {
            task.act.robot
            for task in expand_all(after.root).walk()
            if isinstance(task.act, Go) and task.name not in finished
        }
        assert moving == set(range(1, size + 1)) - deployed


def test_nobody_is_sent_to_a_place_where_another_waits_for_its_turn() -> None:
    """A wave's robots, switched to leap-frog, first leave the places that others are to take."""
    before = plan("wave", 4)
    finished = [task.name for task in before.root.subtasks[0].walk()]
    after = switched(before, "leap_frog", finished)
    assert [task.name for task in after.root.subtasks] == ["deploy/stage-1", "deploy/clear-1", "deploy/switch-1"]
    clearing, rest = after.root.subtasks[1:]
    assert [task.act for task in clearing.subtasks] == [Go(robot=1, place_m=(3.0, 0.0))]
    assert isinstance(rest.act, Deployment)
    assert (rest.act.robots, rest.act.strategy, rest.subtasks) == ((4, 3, 2), "leap_frog", ())


def test_a_robot_in_the_middle_of_its_leap_goes_on_first() -> None:
    before = plan("leap_frog", 3)
    finished = [task.name for task in before.root.subtasks[0].walk()] + ["deploy/stage-2/robot-2-leg-1"]
    clearing, rest = switched(before, "wave", finished).root.subtasks[-2:]
    assert [task.act for task in clearing.subtasks] == [Go(robot=2, place_m=(1.0, 0.0))]
    assert isinstance(rest.act, Deployment)
    assert rest.act.robots == (1,)


def test_a_group_needs_no_clearing() -> None:
    before = plan("group", 3)
    after = switched(before, "leap_frog", [task.name for task in before.root.subtasks[0].walk()])
    assert [task.label for task in after.root.subtasks] == ["stage-1", "switch-1"]
    assert isinstance(after.root.subtasks[1].act, Deployment)
    assert after.root.subtasks[1].act.robots == (2, 1)


def test_a_deployment_that_has_not_begun_is_only_told_its_new_strategy() -> None:
    for expand in (True, False):
        after = switched(plan("group", 3, expand), "wave").root
        assert after == plan("wave", 3, expand=False).root


def test_a_strategy_is_switched_twice() -> None:
    before = plan("group", 4)
    once = switched(before, "leap_frog", [task.name for task in before.root.subtasks[0].walk()])
    grown = once.model_copy(update={"root": expand_all(once.root)})
    done = [task.name for task in grown.root.subtasks[0].walk()]
    done += [task.name for task in grown.tasks["deploy/switch-1"].subtasks[0].walk()]
    twice = switched(grown, "wave", done)
    assert [task.label for task in twice.root.subtasks] == ["stage-1", "switch-1", "switch-2"]
    assert last_places(twice.root) == last_places(before.root)
    assert isinstance(twice.root.subtasks[2].act, Deployment)
    assert twice.root.subtasks[2].act.robots == (2, 1)


def test_what_has_ended_and_what_is_elsewhere_stays_as_it_was() -> None:
    tasks = tuple(Task(name=f"top/{name}", act=deployment("group", 2)) for name in "ab")
    both = Plan(number=1, play="p", robots=(1, 2), root=Task(name="top", subtasks=tasks))
    found = switched(both, "wave", within="top/b").root.subtasks
    assert [each.act.strategy for each in found if isinstance(each.act, Deployment)] == ["group", "wave"]
    found = switched(both, "wave", finished=["top/a"]).root.subtasks
    assert [each.act.strategy for each in found if isinstance(each.act, Deployment)] == ["group", "wave"]


def test_constraints_on_tasks_that_leave_the_plan_leave_it_too() -> None:
    before = plan("group", 2)
    kept = Between(later=Instant(task="deploy", edge="end"), at_most_s=60.0)
    lost = Between(later=Instant(task="deploy/stage-2"), at_least_s=10.0)
    watcher = Task(name="top/w", act=Go(robot=9, place_m=(9.0, 9.0)), ends_with="deploy/stage-2")
    root = Task(name="top", order="parallel", subtasks=(before.root, watcher))
    whole = Plan(number=1, play="p", robots=(1, 2, 9), root=root, constraints=(kept, lost))
    after = switched(whole, "wave", ["deploy/stage-1/robot-2"])
    assert after.constraints == (kept,)
    assert after.tasks["top/w"].ends_with is None
