"""Durations against closed forms, the order of tasks, and the network of a plan."""

import math
from itertools import pairwise

import networkx as nx
import pytest
from scipy.integrate import quad

from cosim.units import S
from protocols.deployment.planning.methods import expanded
from protocols.deployment.planning.timing import (
    Leg,
    Span,
    TimingParameters,
    drive_s,
    driving,
    ending,
    expected_s,
    in_order,
    lasting,
    legs_of,
    precedence,
    standing,
    structure,
    timing_out,
    wanted_at_once,
)
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Between, Deployment, Face, Go, Instant, Photo, Task, Wait, actors
from protocols.deployment.tasks.stn import Network, asked

BODY = Body(speed_mps=0.5, acceleration_mps2=0.25)


def waits(name: str, *seconds: float, order: str = "serial", **more: object) -> Task:
    """Return a net of tasks that wait."""
    inner = tuple(Task(name=f"{name}/{at}", act=Wait(seconds=each)) for at, each in enumerate(seconds))
    return Task.model_validate({"name": name, "order": order, "subtasks": inner} | more)


def spans(root: Task) -> dict[str, Span]:
    parameters = TimingParameters()
    found = {task.name: standing(task, [BODY], parameters) for task in root.walk() if task.leaf}
    return {name: span for name, span in found.items() if span is not None}


def network(root: Task, *constraints: Between) -> Network:
    bounds = [*structure(root), *lasting(root, spans(root)), *ending(root), *(asked(each) for each in constraints)]
    return Network([*bounds, *(bound for bound, _ in timing_out(root))])


def least_s(root: Task, *constraints: Between) -> float:
    """Return the earliest end of *root*."""
    earliest, _ = network(root, *constraints).windows()[root.name, "end"]
    assert earliest is not None
    return earliest / S


# ---------------------------------------------------------------- durations


def integrated_s(length_m: float, body: Body) -> float:
    """Return the integral of ds/v(s): v is as fast as the limits of speed, accelerating and braking let it be."""

    def slowness(s_m: float) -> float:
        fastest = math.sqrt(2.0 * body.acceleration_mps2 * min(s_m, length_m - s_m))
        return 1.0 / min(body.speed_mps, fastest)

    corner_m = body.speed_mps**2 / (2.0 * body.acceleration_mps2)
    corners = sorted({0.0, min(corner_m, length_m / 2), max(length_m - corner_m, length_m / 2), length_m})
    return sum(quad(slowness, a, b)[0] for a, b in pairwise(corners))


@pytest.mark.parametrize("length_m", [0.1, 0.9, 1.0, 1.1, 4.0])
def test_a_drive_takes_the_time_of_accelerating_driving_and_braking(length_m: float) -> None:
    assert drive_s(length_m, BODY) == pytest.approx(integrated_s(length_m, BODY), rel=1e-6)


def test_no_way_takes_no_time() -> None:
    assert drive_s(0.0, BODY) == 0.0


def test_a_drive_is_between_a_share_of_its_free_time_and_a_multiple_of_what_is_expected() -> None:
    parameters = TimingParameters(least_share=0.5, turns_s=3.0, slack=2.0)
    span = driving(Leg("t", 1, ((0.0, 0.0), (10.0, 0.0))), 10.0, BODY, parameters)
    free_s = 10.0 / 0.5 + 0.5 / 0.25
    assert span[:3] == (0.5 * free_s, free_s + 3.0, 2.0 * (free_s + 3.0))
    assert span.name == "t: robot 1 drives 10.0 m to (10, 0) at 0.5 m/s in 11.0 to 50.0 s"


def test_a_picture_takes_a_while_at_most() -> None:
    for act, most_s in (
        (Photo(robot=0), 4.0),
        (Photo(robot=0, heading_rad=1.0), 13.0),
        (Face(robot=0, towards_m=(1.0, 2.0)), 13.0),
    ):
        span = standing(Task(name="p", act=act), [Body(half_turn_s=9.0)], TimingParameters(photo_s=4.0))
        assert span is not None
        assert span[:3] == (0.0, most_s, most_s)


# ---------------------------------------------------------------- networks


def test_series_add_up_and_what_is_at_once_takes_the_longest() -> None:
    assert least_s(waits("a", 3, 4, 5)) == 12.0
    assert least_s(waits("a", 3, 4, 5, order="parallel")) == 5.0
    both = Task(name="r", subtasks=(waits("r/a", 3, 4), waits("r/b", 5, 9, order="parallel")))
    assert least_s(both) == 16.0


def test_constraints_delay_what_they_name() -> None:
    root = waits("a", 3, 4, order="parallel")
    before = Between(earlier=Instant(task="a/0", edge="end"), later=Instant(task="a/1"), at_least_s=10.0)
    assert least_s(root, before) == 17.0
    assert expected_s(root, spans(root), [before]) == 17.0


def test_a_time_out_that_is_too_short_is_a_conflict_unless_its_failure_is_skipped() -> None:
    assert network(waits("a", 3, 4, time_out_s=7.0)).consistent
    stuck = network(waits("a", 3, 4, time_out_s=6.9))
    assert "a: times out after 6.9 s" in {bound.name for bound in stuck.conflict}
    assert network(waits("a", 3, 4, time_out_s=6.9, on_failure="skip")).consistent
    inner = waits("r/a", 3, 4, time_out_s=1.0)
    assert not network(Task(name="r", subtasks=(inner,))).consistent
    assert network(Task(name="r", subtasks=(inner,), on_failure="skip")).consistent


def test_a_task_that_ends_with_another_may_be_cut_short() -> None:
    long, short = (Task(name=f"r/{name}", act=Wait(seconds=s)) for name, s in (("long", 50.0), ("short", 2.0)))
    root = Task(name="r", order="parallel", subtasks=(long.model_copy(update={"ends_with": "r/short"}), short))
    deadline = Between(later=Instant(task="r", edge="end"), at_most_s=2.0)
    assert network(root, deadline).consistent
    assert expected_s(root, spans(root), [deadline]) == 2.0
    assert not network(root, deadline.model_copy(update={"at_most_s": 1.9})).consistent


@pytest.mark.parametrize(("strategy", "longest"), [("group", 3), ("wave", 3), ("leap_frog", 6)])
def test_a_deployment_takes_its_stages_one_after_the_other(strategy: str, longest: int) -> None:
    act = Deployment.model_validate(
        {"strategy": strategy, "robots": (0, 1, 2), "places_m": ((5.0, 0.0), (10.0, 0.0), (15.0, 0.0))}
    )
    root = expanded(Task(name="d", act=act))
    each = {task.name: Span(2.0, 2.0, None, task.name) for task in root.walk() if task.leaf}
    found = Network([*structure(root), *lasting(root, each)])
    assert found.windows()["d", "end"][0] == longest * 2 * S


# ---------------------------------------------------------------- order


def test_tasks_at_once_come_in_the_order_that_constraints_give_them() -> None:
    names = ("r/a", "r/b", "r/c")
    goes = tuple(Task(name=name, act=Go(robot=1, place_m=(float(at), 0.0))) for at, name in enumerate(names))
    root = Task(name="r", order="parallel", subtasks=goes)
    between = [
        Between(earlier=Instant(task="r/c", edge="end"), later=Instant(task="r/a")),
        Between(earlier=Instant(task="r/a", edge="end"), later=Instant(task="r/b")),
    ]
    graph = precedence(root, between)
    leaves = in_order(root, graph)
    assert [leaf.name for leaf in leaves] == ["r/c", "r/a", "r/b"]
    assert wanted_at_once(leaves, graph, lambda task: actors(task.act)) == []
    legs = legs_of(leaves, {1: (9.0, 9.0)})
    assert [legs[name].places_m[0] for name in ("r/c", "r/a", "r/b")] == [(9.0, 9.0), (2.0, 0.0), (0.0, 0.0)]
    graph = precedence(root, between[:1])
    clashes = wanted_at_once(in_order(root, graph), graph, lambda task: actors(task.act))
    assert {frozenset(clash[1:]) for clash in clashes} & {frozenset(("r/a", "r/b")), frozenset(("r/b", "r/c"))}


def test_an_order_that_bites_its_tail_is_that_of_the_plan() -> None:
    root = waits("a", 1, 2, order="parallel")
    between = [Between(earlier=Instant(task=f"a/{i}", edge="end"), later=Instant(task=f"a/{1 - i}")) for i in (0, 1)]
    graph = precedence(root, between)
    assert not nx.is_directed_acyclic_graph(graph)
    assert [leaf.name for leaf in in_order(root, graph)] == ["a/0", "a/1"]
    assert math.isinf(expected_s(root, spans(root), between))
