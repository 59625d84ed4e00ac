"""The terms of Fox, Burgard and Thrun: the choice is the best that a plain enumeration of the window finds."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.geometry.segments import swept_clearance
from cosim.navigation.dwa import BODY_COLUMNS, OWN, choose
from tests.navigation.fox_oracle import STEPS, Robot, judge
from tests.navigation.test_dwa import AIMS, ROOM, Drivers, bodies, differential, places, row

NO_WALLS, NO_POINTS, NOBODY = np.empty((0, 4)), np.empty((0, 2)), np.empty((0, BODY_COLUMNS))


def own(robot):
    """Return the row of a robot, in metres and radians per tick."""
    tick, told = robot.tick_s, np.empty(OWN)
    told[:] = (
        robot.radius_m,
        robot.speed_mps * tick,
        robot.acceleration_mps2 * tick**2,
        robot.turn_radps * tick,
        robot.turn_acceleration_radps2 * tick**2,
        robot.margin_m,
        robot.stray_m,
        robot.clear_m,
        robot.alpha,
        robot.beta,
        robot.gamma,
        robot.arc_m,
    )
    return told


def scene(rng):
    """Return a robot in a room with some more walls and scanned points, how it moves, its aim, and its limit."""
    robot = Robot(
        radius_m=float(rng.uniform(0.1, 0.3)),
        speed_mps=float(rng.uniform(0.2, 1.5)),
        acceleration_mps2=float(rng.uniform(0.3, 3.0)),
        turn_radps=float(rng.uniform(0.5, 3.0)),
        turn_acceleration_radps2=float(rng.uniform(1.0, 8.0)),
        stray_m=float(rng.choice((0.04, 0.2))),
        alpha=float(rng.choice((0.1, 0.8, 2.0))),
        beta=float(rng.choice((0.1, 0.2, 2.0))),
        gamma=float(rng.choice((0.1, 0.2, 2.0))),
        arc_m=float(rng.choice((0.5, 1.0, 3.0))),
    )
    ends = rng.uniform(0, 6, (4, 2))
    walls = np.vstack((ROOM, np.column_stack((ends, ends + rng.uniform(-1, 1, (4, 2))))))
    points = rng.uniform(0, 6, (int(rng.integers(4)), 2))
    things = shapely.union_all([*(shapely.LineString(wall.reshape(2, 2)) for wall in walls), *shapely.points(points)])
    while True:
        x, y = rng.uniform(0.1, 5.9, 2).tolist()
        if shapely.distance(shapely.Point(x, y), things) > robot.radius_m:
            break
    share, turning = rng.choice((0.0, 1.0, float(rng.uniform())), 2)
    now = x, y, float(rng.uniform(-4, 4)), robot.speed_mps * share, robot.turn_radps * turning * rng.choice((-1, 1))
    aim = tuple((np.array((x, y)) + rng.uniform(-1.5, 1.5, 2)).tolist())
    return robot, now, walls, points, things, aim, robot.speed_mps * float(rng.choice((0.3, 1.0)))


@pytest.mark.parametrize("part", range(8))
def test_the_choice_is_the_best_of_a_window_that_is_enumerated(part):
    chosen, alike = 0, 0
    for number in range(40):
        robot, now, walls, points, things, aim, most = scene(np.random.default_rng((72, part, number)))
        tick = robot.tick_s
        state = np.array((*now[:3], now[3] * tick, now[4] * tick, 0.0, 0.0))
        way, turn, free = choose(own(robot), state, walls, points, NOBODY, *aim, most * tick)
        window = judge(robot, now, things, aim, most)
        if not free:
            assert not window.surely.any()
            continue
        apart = np.abs(window.commands * tick - (way, turn)).max(axis=1)
        assert apart.min() < 1e-9
        mine = int(apart.argmin())
        assert window.perhaps[mine]
        best = window.worth[window.surely].max(initial=-math.inf)
        assert window.worth[mine] >= best - 2.0 * robot.beta / STEPS - 1e-9
        chosen += 1
        alike += window.worth[mine] >= best
    assert chosen > 20
    assert alike > 0.8 * chosen


@pytest.mark.slow
@settings(max_examples=30)
@given(bodies, st.floats(-3, 3), st.lists(places, min_size=40, max_size=40), st.sampled_from((0.5, 1.0, 3.0)))
def test_one_robot_touches_no_wall_whatever_it_aims_at(body, heading, aims, arc):
    drivers = Drivers([body], [(1.0, 1.0)], headings=heading, arc=arc)
    for aim in aims:
        for _ in range(3):
            drivers.tick([aim])
            here = drivers.state[:, :2]
            assert swept_clearance(drivers.grid, here, here, 1.0)[0] >= body.radius_m


@pytest.mark.slow
@settings(max_examples=20)
@given(bodies, bodies, st.floats(-3, 3), AIMS)
def test_two_robots_never_touch(one, other, heading, aims):
    drivers = Drivers([one, other], [(1.0, 1.0), (4.9, 1.0)], headings=[heading, heading + 3.0], arc=1.0)
    for aim in aims:
        for _ in range(5):
            drivers.tick(aim)
            assert drivers.gap() >= -1e-9


def test_what_is_beside_the_way_does_not_count_but_what_is_on_it():
    """In a lane the stopping path is near a wall on both sides; along the arc nothing is met."""
    lane = np.array([(-1.0, 0.26, 9.0, 0.26), (-1.0, -0.26, 9.0, -0.26)])
    told = row(differential(), arc=1.0)
    told[8:11] = 0.0, 1.0, 0.1  # only being clear, and a little being fast
    state = np.array([0.0, 0.0, 0.0, 0.04, 0.0, 0.04, 0.0])
    assert choose(told, state, lane, NO_POINTS, NOBODY, 5.0, 0.0, 0.05) == (0.05, 0.0, True)
    shut = np.vstack((lane, (0.7, -1.0, 0.7, 1.0)))
    slower = choose(told, state, shut, NO_POINTS, NOBODY, 5.0, 0.0, 0.05)
    assert slower[2]
    assert slower[0] < 0.05 or slower[1] != 0.0


def test_a_body_that_stands_on_the_way_is_an_obstacle():
    told = row(differential(), arc=1.0)
    told[8:11] = 0.1, 1.0, 0.1
    state = np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.05, 0.0])
    stands = np.array([(1.2, 0.0, 0.0, 0.0, 0.2, 0.01)])
    assert choose(told, state, NO_WALLS, NO_POINTS, NOBODY, 5.0, 0.0, 0.05) == (0.05, 0.0, True)
    assert choose(told, state, NO_WALLS, NO_POINTS, stands, 5.0, 0.0, 0.05)[1] != 0.0


def test_the_rate_of_turn_is_to_be_braked_within_the_way_too():
    """w <= sqrt(2 dist w'): a stop that leaves the arc in time is not enough."""
    state = np.array([0.0, 0.0, 0.0, 0.02, 0.15, 0.02, 0.0])
    wall = np.array([(0.26, -1.0, 0.26, 1.0)])
    for arc, chosen in ((0.0, True), (1.0, False)):
        told = row(differential(turn_acceleration_radps2=1.0), arc=arc)
        assert choose(told, state, wall, NO_POINTS, NOBODY, 5.0, 0.0, 0.05)[2] == chosen
