"""Orders to places of the map: given again when the robot would miss its place, and not when it would not."""

import math

import pytest

from cosim.machine import Command, Drive, GoTo
from cosim.observation import Observation
from cosim.robots.senses import SenseSettings
from protocols.localization.aiming import Aim
from protocols.localization.positioning import Given
from protocols.localization.scan import Sensor
from protocols.motion.frames import Shift
from tests.protocols.deployment.driving_scene import Scene, body
from tests.protocols.localization.positioning_scene import BEAMS, RADIUS_M, WALLS, localised, scanned, told

GOAL = GoTo(4.0, 1.0)
HERE = Shift()


def at(x_m: float, y_m: float, heading_rad: float = 0.0, arrived: bool = False) -> Observation:
    return Observation(x_m, y_m, heading_rad, 0.3, arrived, False)


def sent(*seen: Observation, command: Command = GOAL) -> list[Command | None]:
    """Return what a robot is told that is sent off at (0, 1), then makes observations."""
    aim = Aim()
    assert aim.order(command, at(0.0, 1.0), HERE) == command
    return [aim.order(None, each, HERE) for each in seen]


def test_a_robot_that_heads_for_its_place_is_left_alone() -> None:
    assert sent(at(1.0, 1.0), at(2.0, 1.07), at(3.9, 1.02), at(4.0, 1.0, arrived=True)) == [None] * 4


@pytest.mark.parametrize(
    "seen",
    [at(2.0, 1.0, 0.05), at(3.9, 1.03), at(4.1, 1.0), at(3.97, 1.0, arrived=True), at(4.0, 0.97, math.pi / 2, True)],
    ids=["heads past", "is beside its way", "is beyond", "has stopped short", "has stopped beside"],
)
def test_a_robot_that_misses_its_place_is_sent_there_again(seen: Observation) -> None:
    assert sent(seen) == [GOAL]


def test_the_same_order_once_more_is_no_news() -> None:
    aim = Aim()
    aim.order(GOAL, at(0.0, 1.0), HERE)
    assert aim.order(GOAL, at(1.0, 1.0), HERE) is None
    assert aim.order(GOAL, at(2.0, 1.0, 0.05), HERE) == GOAL
    assert aim.order(GoTo(4.0, 1.01), at(2.0, 1.0), HERE) == GoTo(4.0, 1.01)


def test_a_robot_that_is_told_to_stand_is_not_sent_on() -> None:
    aim = Aim()
    aim.order(GOAL, at(0.0, 1.0), HERE)
    stand = Drive(0.0, 0.0)
    assert aim.order(stand, at(1.0, 1.0), HERE) == stand
    assert aim.order(None, at(1.0, 2.0), HERE) is None
    assert aim.order(GOAL, at(1.0, 2.0), HERE) == GOAL


def test_a_place_of_the_map_is_told_in_the_robots_own_frame_by_the_shift_of_the_moment() -> None:
    aim = Aim()
    assert aim.order(GOAL, at(0.0, 1.0), Shift(1.0, 2.0)) == GoTo(3.0, -1.0)
    turned = aim.order(None, at(2.0, 1.0, 1.0), Shift(0.0, 0.0, math.pi / 2.0))
    assert turned == pytest.approx(GoTo(1.0, -4.0))


def test_a_pose_that_is_the_truth_passes_orders_as_they_are() -> None:
    given = Given(Sensor(BEAMS), (0.0, 0.0, 0.0))
    seen = given.locate(at(2.0, 3.0, 1.0))
    assert [given.order(each, seen) for each in (GOAL, GOAL, None)] == [GOAL, GOAL, None]


def test_a_pose_that_errs_and_one_in_a_frame_of_its_own_are_aimed_by() -> None:
    errs = Given(Sensor(BEAMS), (0.0, 0.0, 0.0), errs=True)
    assert [errs.order(each, at(2.0, 1.0, 0.05)) for each in (GOAL, None)] == [GOAL, GOAL]
    own = Given(Sensor(BEAMS), (1.0, 2.0, 0.0))
    assert own.order(GOAL, own.locate(at(0.0, 0.0))) == GoTo(3.0, -1.0)


def test_a_filter_sends_the_body_by_its_estimate() -> None:
    pose = (3.0, 2.0, 0.0)
    filter_ = localised(frame=pose)
    seen = filter_.locate(told((0.0, 0.0, 0.0), ranges_m=scanned(pose)))
    there = filter_.order(GoTo(4.0, 2.0), seen)
    assert isinstance(there, GoTo)
    assert filter_.shift.point(*there) == pytest.approx((4.0, 2.0))


def test_a_body_whose_odometry_drifts_ends_where_it_takes_its_place_to_be() -> None:
    """And it would not if it was sent off only once."""
    assert drive(Aim()) < 0.02
    assert drive(None) > 0.1


def drive(aim: Aim | None) -> float:
    """Return how far from its place a robot takes itself to be at the end of a way of 16 m."""
    bodies = [body(radius_m=RADIUS_M, speed_mps=0.5, acceleration_mps2=0.5)]
    scene = Scene(WALLS, [(2.0, 5.2)], bodies, senses=SenseSettings(odometry_slip=0.03, odometry_turn_rad=0.03))
    (seen,), goal = scene.senses.observe(scene.fleet), GoTo(18.0, 5.2)
    order: Command | None = goal
    for _ in range(500):
        order = order if aim is None else aim.order(order, seen, HERE)
        if order is not None:
            scene.fleet.apply([(0, scene.senses.in_world(0, order))])
        scene.fleet.step()
        (seen,), order = scene.senses.observe(scene.fleet), None
    return math.dist(seen[:2], goal)
