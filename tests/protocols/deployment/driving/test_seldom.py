"""What happens seldom: a place that cannot be reached, a robot that is shut in, a goal that somebody stands on."""

import math

import pytest

from cosim.units import S
from protocols.deployment.executing.executive import Executive
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.tasks.orders import Report, Result
from protocols.deployment.tasks.plan import Deployment, Go, Place, Plan, Task
from tests.protocols.deployment.driving_scene import Scene, box, line
from tests.protocols.deployment.play_scene import Plain, crew_of

PLACES: tuple[Place, ...] = ((10.0, 0.0), (20.0, 0.0), (30.0, 0.0))


def deploy(closed: tuple[int, Place], lost: int | None = None, rounds: int = 2) -> tuple[Executive, list[Place]]:
    """Deploy a group of which one robot never gets to one place; return the executive, and where that one was sent."""
    act = Deployment(strategy="group", robots=(0, 1, 2), places_m=PLACES, augmented=False)
    plan = Plan(number=1, play="p", robots=act.robots, root=Task(name="p", act=act))
    own = ExecutiveParameters(rounds=rounds, tries=2)
    executive, now = Executive(plan, crew_of(3), Plain(), own, 0), 0
    if lost is not None:
        executive.orders()
        executive.lost(lost, now)
    sent: list[Place] = []
    while orders := executive.orders():
        now += S
        for order in orders:
            if not isinstance(order.errand, Go) or order.robot == lost:
                continue
            fails = (order.robot, order.errand.place_m) == closed
            result = Result.FAILED if fails else Result.DONE
            sent += [order.errand.place_m] * (order.robot == closed[0])
            report = Report(plan=1, serial=order.serial, task=order.task, robot=order.robot, result=result, at=now)
            executive.report(report, now)
    return executive, sent


@pytest.mark.parametrize("rounds", [0, 1, 2])
def test_who_has_not_come_to_its_place_is_sent_there_again_in_the_end(rounds: int) -> None:
    executive, sent = deploy((2, PLACES[2]), rounds=rounds)
    assert sent == [PLACES[0], PLACES[1]] + [PLACES[2]] * 2 * (1 + rounds)
    assert executive.results["p"] is Result.FAILED


def test_who_cannot_come_to_its_place_is_sent_to_an_empty_one_at_last() -> None:
    executive, sent = deploy((1, PLACES[0]), lost=0)
    assert sent == [PLACES[0]] * 2 * 2 + [PLACES[2]], "robots 1 and 2 were to hold the first two"
    assert executive.results["p"] is Result.DONE


@pytest.mark.slow
def test_who_is_shut_in_by_one_that_stands_makes_for_where_it_would_go_without_that_one() -> None:
    walls = line((0, 0), (14, 0), (14, 0.8), (7, 0.8), (7, 3), (6, 3), (6, 0.8), (0, 0.8), (0, 0))
    scene = Scene(walls, [(9.0, 0.4), (8.2, 0.4)])
    scene.run(2.0)
    scene.movers[0].retreat((3.0, 0.4), [(13.8, 0.4)])
    goal_m = scene.movers[0].goal_m
    assert goal_m is not None
    assert 6.0 < goal_m[0] < 7.0
    assert goal_m[1] > 0.8
    before = scene.place(0)
    scene.run(3.0)
    assert scene.place(0)[0] < before[0], "it has set off"


@pytest.mark.slow
@pytest.mark.parametrize(("beyond_m", "taken"), [(-0.02, True), (0.02, False)])
def test_a_goal_is_taken_if_somebody_stands_nearer_to_it_than_both_bodies_need(beyond_m: float, taken: bool) -> None:
    scene = Scene(box(10, 6), [(2.0, 3.0), (8.0, 3.0)])
    goal_m = (8.0 - 2 * scene.radii[0] - scene.parameters.margin_m - beyond_m, 3.0)
    scene.movers[0].go(goal_m)
    named = set()

    def stands() -> bool:
        named.add(scene.movers[0].blocked_by)
        return scene.movers[0].state == "arrived"

    scene.asides.clear()
    scene.ask = lambda: None  # type: ignore[method-assign]
    scene.run(20.0, stands)
    assert (1 in named) == taken
    assert math.dist(scene.place(0), goal_m) < 0.6, "it comes as near as it can"
    assert not scene.touched
