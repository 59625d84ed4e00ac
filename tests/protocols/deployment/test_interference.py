"""Interference is what a drive took longer than it would have without others: against closed forms."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.robots.motion import approach
from cosim.units import MS, S
from protocols.deployment.referee import SLIGHT, STILL_MPS, Log, Shortfall, shortfall, stage_of
from protocols.deployment.tasks.events import Driving, PlanBegun, TaskEnded, TaskStarted
from protocols.deployment.tasks.plan import Deployment, Go, Photo, Task, ends_m

TICK = 100 * MS
TICK_S = 0.1
SPEEDS = st.floats(-2.0, 2.0)


@given(SPEEDS, SPEEDS)
def test_a_shortfall_is_a_share(speed_mps: float, free_mps: float) -> None:
    assert 0.0 <= shortfall(speed_mps, free_mps) <= 1.0


@given(st.floats(0.01, 2.0), st.floats(0.0, 1.0))
def test_a_share_of_the_free_speed_lacks_the_rest(free_mps: float, share: float) -> None:
    assert shortfall(share * free_mps, free_mps) == pytest.approx(1.0 - share, abs=1e-12)


@pytest.mark.parametrize("speed_mps", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("free_mps", [-0.3, 0.0, STILL_MPS])
def test_who_would_stand_or_turn_anyway_is_not_hindered(speed_mps: float, free_mps: float) -> None:
    assert shortfall(speed_mps, free_mps) == 0.0


def test_who_backs_off_counts_as_standing() -> None:
    assert shortfall(-0.4, 0.5) == shortfall(0.0, 0.5) == 1.0


def test_who_is_faster_than_its_double_makes_nothing_good() -> None:
    noted = Shortfall(TICK)
    for speed_mps in (0.0, 1.0, 1.0):
        noted.note(speed_mps, 0.5)
    assert noted.lost_s == pytest.approx(TICK_S)


def test_a_robot_held_up_for_seven_seconds_loses_seven() -> None:
    noted = Shortfall(TICK)
    for tick in range(200):
        noted.note(0.0 if 50 <= tick < 120 else 0.6, 0.6)
    assert noted.lost_s == pytest.approx(7.0)
    assert noted.hindered_s == pytest.approx(7.0)


def test_behind_a_robot_of_a_third_of_its_speed_it_loses_two_thirds_of_the_time() -> None:
    noted = Shortfall(TICK)
    for _ in range(300):
        noted.note(0.2, 0.6)
    assert noted.lost_s == pytest.approx(20.0)
    assert noted.hindered_s == pytest.approx(30.0)


def test_what_is_hardly_slower_counts_as_lost_but_not_as_hindered() -> None:
    noted = Shortfall(TICK)
    for share in (1.0 - 0.9 * SLIGHT, 1.0 - 1.1 * SLIGHT):
        noted.note(share, 1.0)
    assert noted.hindered_s == pytest.approx(TICK_S)
    assert noted.lost_s == pytest.approx(2.0 * SLIGHT * TICK_S)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.1, 1.5)), min_size=1, max_size=60))
def test_what_is_lost_is_the_time_on_the_way_less_that_of_its_double_there(parts: list[tuple[float, float]]) -> None:
    noted, free_s = Shortfall(TICK), 0.0
    for share, free_mps in parts:  # the free speed is that of the place: ds / u each tick
        noted.note(share * free_mps, free_mps)
        free_s += share * free_mps * TICK_S / free_mps
    assert noted.lost_s == pytest.approx(len(parts) * TICK_S - free_s, abs=1e-9)


def test_a_start_after_a_stop_costs_v_over_2a_beside_the_stop() -> None:
    """A robot stops for 5 s on a long way, then speeds up at *a* while its double has kept *v*: v / (2 a) in all."""
    most, change = 0.6 * TICK_S, 0.5 * TICK_S**2
    noted, way = Shortfall(TICK), 0.0
    for tick in range(400):
        way = 0.0 if tick < 50 else approach(1e6, way, most, change)
        noted.note(way / TICK_S, 0.6)
    assert noted.lost_s == pytest.approx(5.0 + 0.6 / (2 * 0.5), abs=TICK_S)


# ---------------------------------------------------------------- what robots report


def test_the_log_adds_up_all_robots() -> None:
    log = Log(3, TICK)
    for _ in range(10):
        log.note(0, Driving("a/b", False, True, (0.0, 0.5)), 0)
        log.note(2, Driving("a/b", False, True, (0.25, 0.5)), 0)
        log.note(1, Driving("a/b", True, False, None), 0)
    assert log.lost_s() == pytest.approx(1.5)
    assert log.hindered_s() == pytest.approx(2.0)
    assert log.under_way_s() == pytest.approx(2.0)
    assert log.waited_s() == pytest.approx(1.0)


def test_a_robot_that_has_arrived_is_not_under_way() -> None:
    log = Log(1, TICK)
    log.note(0, Driving("a/b", False, False, (0.0, 0.5)), 0)
    assert log.lost_s() == log.under_way_s() == 0.0


ENDS = [TaskEnded(1, 0, "t", "done", "", 0.0, 0.0), TaskStarted(1, 1, "photo", "photo", 0.0, 0.0, 0.0, 0.0)]


@pytest.mark.parametrize("event", ENDS, ids=["it ends", "another task begins"])
def test_a_drive_is_known_by_its_task_until(event: object) -> None:
    log = Log(2, TICK)
    log.note(1, Driving("deploy/stage-1/robot-1", False, True, None), 0)
    assert log.tasks == [None, "deploy/stage-1/robot-1"]
    log.note(1, event, 0)  # type: ignore[arg-type]
    assert log.tasks == [None, None]


@pytest.mark.parametrize(
    ("task", "stage"),
    [
        ("deploy/stage-2/robot-1", "deploy/stage-2"),
        ("deploy/stage-10/robot-1-leg-3", "deploy/stage-10"),
        ("a/stage-1/b/stage-2/robot-0", "a/stage-1/b/stage-2"),
        ("wean/to-crossing/robot-0", "wean/to-crossing"),
        ("visit", ""),
        ("wean/beyond/leap~back-3", None),
    ],
)
def test_a_drive_belongs_to_the_stage_above_it(task: str, stage: str | None) -> None:
    assert stage_of(task) == stage


def test_a_plan_ends_where_the_last_own_place_of_each_robot_is() -> None:
    deploy = Task(name="d", act=Deployment(strategy="wave", robots=(0, 1), places_m=((1, 1), (2, 2))))
    passing = Task(name="p", act=Go(robot=0, place_m=(7, 7), final=False))
    photo = Task(name="c", act=Photo(robot=1))
    home = Task(name="h", act=Go(robot=1, place_m=(0, 0)))
    root = Task(name="all", subtasks=(deploy, passing, photo, home))
    assert ends_m(root) == {0: (1, 1), 1: (0, 0)}


def test_what_an_expanded_strategy_says_counts_by_its_subtasks() -> None:
    left = Task(name="d/x", act=Go(robot=0, place_m=(5, 5)))
    act = Deployment(strategy="wave", robots=(0, 1), places_m=((1, 1), (2, 2)))
    assert ends_m(Task(name="d", act=act, subtasks=(left,))) == {0: (5, 5)}


def test_a_successor_that_begins_a_plan_again_changes_nothing() -> None:
    log = Log(2, TICK)
    log.note(0, PlanBegun(4, (0,), ((1, 2),)), 2 * S)
    log.note(1, PlanBegun(4, (0,), ((1, 2),)), 9 * S)
    log.note(1, PlanBegun(5, (0,), ((1, 2),)), 9 * S)
    assert [(each.plan.number, each.at) for each in log.begun] == [(4, 2 * S), (5, 9 * S)]
    assert log.begun[0].plan.places_m == ((1, 2),)
    assert not math.isnan(log.lost_s())
