"""The executive runs plans to their ends, whatever is lost, late, told twice, or dies."""

import math

import pytest

from cosim.units import S
from protocols.deployment.executing.executive import STRIDE, Executive
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.orders import Halt, Report, Result, Whereabouts
from protocols.deployment.tasks.plan import Deployment, Explore, Go, Photo, Place, Plan, Task
from tests.protocols.deployment.play_scene import Plain, Scene, Troubles, crew_of
from tests.tiers import all_pairs, each_value

PLACES: tuple[Place, ...] = ((10.0, 0.0), (20.0, 0.0), (30.0, 0.0), (40.0, 0.0))
STRATEGIES = ("group", "wave", "leap_frog")


def deployment(strategy: str, size: int = 4, augmented: bool = True) -> Plan:
    act = Deployment(
        strategy=strategy,
        robots=tuple(range(size)),
        places_m=PLACES[:size],
        augmented=augmented,  # type: ignore[arg-type]
    )
    return Plan(number=1, play=strategy, robots=act.robots, root=Task(name="deploy", act=act))


def standing(scene: Scene, places: tuple[Place, ...]) -> list[int | None]:
    """Return who stands at each of *places*."""
    return [
        next((each.address for each in scene.robots if each.alive and math.dist(each.at_m, place) < 0.2), None)
        for place in places
    ]


@pytest.mark.parametrize("augmented", [True, False])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_leaves_every_robot_at_its_place(strategy: str, augmented: bool):
    scene = Scene(deployment(strategy, augmented=augmented), crew_of(4)).run()
    assert standing(scene, PLACES) == [0, 1, 2, 3]
    assert scene.executive is not None
    assert scene.executive.results["deploy"] is Result.DONE


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "dead", "at_s"), all_pairs(STRATEGIES, range(4), [1.0, 15.0, 29.0, 45.0]))
def test_after_a_death_the_others_occupy_the_first_places(strategy: str, dead: int, at_s: float):
    scene = Scene(deployment(strategy), crew_of(4), troubles=Troubles(deaths={dead: at_s})).run()
    assert scene.executive is not None
    if any(end.task == "deploy" and end.at > (at_s + 3.0) * S for end in scene.ends):  # else it was over before
        body, radius_m = scene.robots[dead].at_m, scene.crew.radius_m(dead)
        open_first = sorted(PLACES, key=lambda place: math.dist(place, body) < 2.0 * radius_m)  # nobody stands on it
        assert set(standing(scene, open_first[:3])) == {0, 1, 2, 3} - {dead}


# ---------------------------------------------------------------- commands


def go(name: str, robot: int, x_m: float) -> Task:
    return Task(name=name, act=Go(robot=robot, place_m=(x_m, 5.0)))


def plan_of(*subtasks: Task, order: str = "serial", robots: tuple[int, ...] = (0, 1)) -> Plan:
    root = Task(name="play", subtasks=subtasks, order=order)  # type: ignore[arg-type]
    return Plan(number=7, play="test", robots=robots, root=root)


def until(scene: Scene, seconds: float) -> Scene:
    while scene.now < seconds * S:
        scene.step()
    return scene


def executive(scene: Scene) -> Executive:
    assert scene.executive is not None
    return scene.executive


@pytest.mark.slow
@pytest.mark.parametrize(("before", "after", "at_s"), all_pairs(STRATEGIES, STRATEGIES, [5, 14, 33, 52]))
def test_a_switch_leaves_every_robot_its_place(before: str, after: str, at_s: int):
    scene = until(Scene(deployment(before), crew_of(4)), at_s)
    executive(scene).switch(after, scene.now)  # type: ignore[arg-type]
    scene.run()
    assert standing(scene, PLACES) == [0, 1, 2, 3]
    assert executive(scene).results["deploy"] is Result.DONE


def test_a_switch_changes_how_robots_move():
    scene = until(Scene(deployment("leap_frog"), crew_of(4)), 5)
    executive(scene).switch("group", scene.now)
    scene.step()
    assert {end.task for end in scene.ends if end.result is Result.TERMINATED} >= {"deploy/stage-1", "deploy/stage-4"}
    assert [robot for robot, _ in sorted(executive(scene).progress.errands().items())] == [0, 1, 2, 3]


def test_terminating_the_play_halts_everybody():
    scene = until(Scene(deployment("group"), crew_of(4)), 12.0)
    moving = {robot.address for robot in scene.robots if not robot.reported}
    executive(scene).terminate("deploy", scene.now)
    scene.run()
    halted = {order.robot for order in scene.orders if isinstance(order.errand, Halt)}
    assert halted == moving == {2, 3}
    assert executive(scene).results["deploy"] is Result.TERMINATED


def test_terminating_a_subtree_lets_the_play_go_on():
    scene = until(Scene(plan_of(go("a", 0, 50.0), go("b", 0, 3.0)), crew_of(2)), 2)
    executive(scene).terminate("a", scene.now)
    executive(scene).terminate("no such task", scene.now)
    scene.run()
    assert scene.robots[0].at_m == (3.0, 5.0)
    assert not any(isinstance(order.errand, Halt) for order in scene.orders)  # the next order does it


# ---------------------------------------------------------------- losses


def test_a_role_goes_to_a_robot_that_is_not_in_the_plan():
    plan = plan_of(go("a", 0, 9.0), Task(name="photo", act=Photo(robot=0)), robots=(0,))
    scene = Scene(plan, crew_of(3), troubles=Troubles(deaths={0: 4.0})).run()
    assert [(order.robot, order.task) for order in scene.orders] == [(0, "a"), (1, "a~2"), (1, "photo")]
    assert executive(scene).results["play"] is Result.DONE


def test_without_a_camera_nobody_takes_the_picture():
    crew = Crew((Body(), Body(camera=False), Body()), (0.0, 0.0))
    plan = plan_of(go("a", 0, 9.0), Task(name="photo", act=Photo(robot=0)), robots=(0, 2))
    scene = Scene(plan, crew, troubles=Troubles(deaths={0: 4.0})).run()
    assert executive(scene).results["play"] is Result.FAILED
    assert [order.robot for order in scene.orders] == [0]


def test_nobody_is_drafted_where_that_is_not_wanted():
    plan = plan_of(go("a", 0, 9.0), robots=(0,))
    parameters = ExecutiveParameters(draft=False)
    scene = Scene(plan, crew_of(3), troubles=Troubles(deaths={0: 4.0}), parameters=parameters).run()
    assert executive(scene).results["play"] is Result.FAILED


def test_the_tasks_of_the_dead_hold_nobody_up():
    plan = plan_of(go("a", 0, 9.0), go("b", 1, 9.0), order="parallel")
    scene = Scene(plan, crew_of(2), troubles=Troubles(deaths={0: 4.0})).run()
    assert executive(scene).states == {"play": "done", "a": "failed", "b": "done"}


def test_a_lost_robot_that_is_heard_again_stops_if_its_part_was_given_away():
    plan = plan_of(go("a", 0, 30.0), robots=(0,))
    scene = until(Scene(plan, crew_of(2)), 3)
    executive(scene).lost(0, scene.now)
    until(scene, 6)
    executive(scene).found(0, scene.now)
    scene.run()
    assert [order.errand.act for order in scene.robots[0].obeyed] == ["go", "halt"]
    assert scene.robots[1].at_m == (30.0, 5.0)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_lost_robot_that_is_heard_again_fills_an_empty_place(strategy: str):
    scene = until(Scene(deployment(strategy), crew_of(4)), 3)
    executive(scene).lost(2, scene.now)
    until(scene, 12)
    executive(scene).found(2, scene.now)
    scene.run()
    assert set(standing(scene, PLACES)) == {0, 1, 2, 3}


def test_spare_robots_fill_the_places_of_the_lost():
    scene = Scene(deployment("group"), crew_of(5), troubles=Troubles(deaths={1: 12.0})).run()
    assert set(standing(scene, PLACES)) == {0, 2, 3, 4}


def test_a_robot_that_fails_is_tried_again_and_then_left_behind():
    scene = Scene(deployment("group"), crew_of(4))
    scene.troubles.failing = 1.0
    scene.run()
    tries = [order.task for order in scene.orders if order.robot == 3]
    assert tries[:2] == ["deploy/stage-1/robot-3", "deploy/stage-1/robot-3~2"]
    assert executive(scene).results["deploy"] is Result.FAILED


def test_an_exploration_goes_on_without_the_dead():
    plan = plan_of(Task(name="explore", act=Explore(robots=(0, 1))))
    scene = Scene(plan, crew_of(2), troubles=Troubles(deaths={0: 1.0})).run()
    assert executive(scene).results["explore"] is Result.DONE


# ---------------------------------------------------------------- hosts


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "at_s"), each_value(STRATEGIES, range(1, 60, 7)))
def test_a_host_that_dies_in_mid_play_changes_nothing(strategy: str, at_s: int):
    trouble = Troubles(hosts=(float(at_s), at_s + 9.0), delay_s=(0.0, 1.0), twice=0.3)
    scene = Scene(deployment(strategy), crew_of(4), troubles=trouble, seed=at_s).run()
    assert standing(scene, PLACES) == [0, 1, 2, 3]


def test_a_successor_who_knows_of_no_numbers_is_obeyed():
    record = executive(until(Scene(deployment("group"), crew_of(4)), 20)).record.model_copy(update={"serials": {}})
    room = crew_of(4), Plain(), ExecutiveParameters()
    first = Executive.restored(record, *room, 20 * S).orders()
    second = Executive.restored(record, *room, 21 * S).orders()
    assert first
    assert second
    assert min(order.serial for order in second) > max(order.serial for order in first) >= STRIDE


def test_a_successor_halts_who_is_at_something_that_nobody_wants():
    scene = Scene(plan_of(go("a", 0, 30.0)), crew_of(2))
    executive(scene).terminate("play", 0)
    successor = Executive.restored(executive(scene).record, crew_of(2), Plain(), ExecutiveParameters(), S)
    at = Whereabouts(robot=0, x_m=1.0, y_m=0.0, heading_rad=0.0, plan=7, task="a", moving=True)
    for _ in range(3):
        successor.whereabouts(at, S)
    assert [order.errand.act for order in successor.orders()] == ["halt"]


def test_a_successor_halts_whom_it_sent_again_to_what_had_failed_before():
    before = Executive(plan_of(go("a", 0, 30.0)), crew_of(2), Plain(), ExecutiveParameters(), 0)
    successor = Executive.restored(before.record, crew_of(2), Plain(), ExecutiveParameters(), 9 * S)
    successor.report(Report(plan=7, serial=0, task="a", robot=0, result=Result.FAILED, at=4 * S), 10 * S)
    assert [order.errand.act for order in successor.orders()] == ["go", "halt"]


def test_who_was_moved_by_what_a_late_report_has_undone_goes_back_to_its_post():
    """The play has ended with one robot, whose report is late, before the other one is heard again."""
    act = Deployment(strategy="group", robots=(0, 1), places_m=((5.0, 0.0), (9.0, 0.0)))
    plan = Plan(number=7, play="test", robots=(0, 1), root=Task(name="deploy", act=act))
    here = Executive(plan, crew_of(2), Plain(), ExecutiveParameters(), 0)
    here.lost(0, S)
    ((task, _),) = [here.progress.errands()[1]]
    here.found(0, 9 * S)
    here.orders()
    here.report(Report(plan=7, serial=0, task=task, robot=1, result=Result.DONE, at=8 * S), 10 * S)
    orders = {order.robot: order.errand for order in here.orders()}
    assert orders[0].act == "halt"
    assert (orders[1].act, orders[1].place_m) == ("go", (5.0, 0.0))
    assert not here.finished


def test_replicas_that_have_heard_the_same_want_the_same_of_everybody():
    scene = until(Scene(deployment("wave"), crew_of(4)), 25)
    replica = Executive(executive(scene).plan, crew_of(4), Plain(), ExecutiveParameters(), 0)
    for fact in reversed(executive(scene).record.facts):
        replica.learn(fact, scene.now)
    assert replica.progress.errands() == executive(scene).progress.errands()
    assert replica.progress.errands()


def test_results_are_told_once_and_again_if_a_late_report_changes_them():
    task = Task(name="a", act=Go(robot=0, place_m=(9.0, 0.0)), time_out_s=5.0)
    here = Executive(plan_of(task), crew_of(2), Plain(), ExecutiveParameters(), 0)
    here.wake(5 * S)
    assert [(end.task, end.result) for end in here.ended()] == [("a", Result.FAILED), ("play", Result.FAILED)]
    late = Report(plan=7, serial=0, task="a", robot=0, result=Result.DONE, at=4 * S)
    here.report(late.model_copy(update={"plan": 6}), 6 * S)
    assert not here.ended()
    for _ in range(2):
        here.report(late, 6 * S)
    assert [(end.task, end.result) for end in here.ended()] == [("a", Result.DONE), ("play", Result.DONE)]
    assert not here.ended()
    here.report(late.model_copy(update={"result": Result.FAILED, "at": 3 * S}), 6 * S)  # what was done was done
    assert not here.ended()


def test_a_report_of_the_very_time_out_counts():
    task = Task(name="a", act=Go(robot=0, place_m=(9.0, 0.0)), time_out_s=5.0)
    here = Executive(plan_of(task), crew_of(2), Plain(), ExecutiveParameters(), 0)
    here.report(Report(plan=7, serial=0, task="a", robot=0, result=Result.DONE, at=5 * S), 6 * S)
    assert here.states["a"] == "done"


def test_an_executive_can_be_asked_at_any_time_when_it_wants_to_be_woken():
    task = Task(name="a", act=Go(robot=0, place_m=(9.0, 0.0)), time_out_s=5.0)
    here = Executive(plan_of(task), crew_of(2), Plain(), ExecutiveParameters(), 2 * S)
    assert here.wake_at() == 7 * S
    here.wake(7 * S)
    assert here.wake_at() is None
    assert here.finished
