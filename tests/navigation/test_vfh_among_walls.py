"""Robots that VFH+ steers among walls: doors, corridors, planned ways, each other, and what no beam sees."""

import math

import numpy as np
import pytest
import shapely

from cosim.geometry.planning import wall_planning_grid
from cosim.geometry.segments import clearance
from cosim.navigation.status import Status
from cosim.navigation.vfh import Vfh, VfhParameters
from tests.navigation.small_world import STEP_M, SmallWorld, outline


def test_without_obstacles_the_way_is_straight():
    places, status = SmallWorld([]).run(Vfh(VfhParameters()), (0.0, 0.0), (3.0, 4.0), 60)
    assert status is Status.ARRIVED
    assert len(places) - 1 == 49
    assert np.abs(places @ [0.8, -0.6]).max() < 1e-9


@pytest.mark.parametrize("radius_m", [0.2, 0.25])
@pytest.mark.parametrize("door_m", [0.9, 1.0, 1.2])
@pytest.mark.parametrize("start", [(-2.0, 0.0), (-2.0, 0.8), (-0.5, 1.5), (-0.4, -2.5)])
def test_the_defaults_lead_through_an_office_door(start, door_m, radius_m):
    half = door_m / 2
    world = SmallWorld([(0.0, -4.0, 0.0, -half), (0.0, half, 0.0, 4.0)], radius_m, sight_m=2.5)
    places, status = world.run(Vfh(VfhParameters(robot_radius_m=radius_m)), start, (2.0, 0.0), 60)
    assert status is Status.ARRIVED
    assert clearance(world.grid, places, 1.0).min() > radius_m + 0.05


BENT = [(0, 0), (7, 0), (7, 6)], [(0, 1.5), (5.5, 1.5), (5.5, 6)]
POSTS = [(2.5, 0.3, 0.12), (4.3, 1.35, 0.15)]
"""A corridor 1.5 m wide with a bend to the left, and posts (x, y, radius) at its walls."""


@pytest.mark.slow
@pytest.mark.parametrize("start", [(0.4, 0.45), (0.4, 0.75), (0.4, 1.05)])
def test_in_a_bent_corridor_with_posts_no_wall_is_touched(start):
    walls = shapely.union_all(
        [shapely.LineString(line) for line in BENT] + [shapely.Point(x, y).buffer(r).exterior for x, y, r in POSTS]
    )
    shapely.prepare(walls)
    navigator, way = Vfh(VfhParameters()), [start]
    for goal in ((6.2, 0.8), (6.25, 5.0)):
        navigator.restart()
        for _ in range(120):
            x, y = way[-1]
            dx, dy, status = navigator.steer(x, y, goal, shapely_scan(walls, x, y))
            if status is Status.ARRIVED:
                break
            way.append((x + STEP_M * dx, y + STEP_M * dy))
        assert status is Status.ARRIVED
    assert walls.distance(shapely.LineString(way)) > 0.25
    assert len(way) < 1.15 * 11 / STEP_M


def shapely_scan(walls, x, y, beams=32, sight_m=2.5):
    ranges = []
    for k in range(beams):
        angle = 2 * math.pi * k / beams
        ray = shapely.LineString([(x, y), (x + sight_m * math.cos(angle), y + sight_m * math.sin(angle))])
        hit = ray.intersection(walls)
        ranges.append(math.inf if hit.is_empty else shapely.Point(x, y).distance(hit))
    return tuple(ranges)


@pytest.mark.slow
def test_a_robot_that_cannot_turn_sharply_touches_no_jamb_thanks_to_the_mask():
    for start in ((-2.0, 0.8), (-1.5, -0.9), (-1.0, 1.5), (-3.0, 2.0)):
        for heading in (0.0, math.pi / 2, math.pi, -math.pi / 2):
            assert nearest_of_a_car(start, heading, 0.5) > 0.35, (start, heading)
    assert nearest_of_a_car((-1.0, 1.5), 1.57, 0.0) < 0.2001, "without it, it is told to turn as it cannot"


def nearest_of_a_car(start, heading, told_m):
    """Return how near a car of radius 0.2 m that turns on circles of 0.5 m comes to the jambs of a door on its way.

    *told_m* is the turning radius that the navigator is told.
    """
    world = SmallWorld([(0.0, -4.0, 0.0, -0.5), (0.0, 0.5, 0.0, 4.0)], 0.2, sight_m=2.5)
    navigator = Vfh(VfhParameters(robot_radius_m=0.2, turning_radius_m=told_m))
    (x, y), places = start, [start]
    for _ in range(200):
        dx, dy, status = navigator.steer(x, y, (2.0, 0.0), world.scan(x, y))
        if status is Status.ARRIVED:
            break
        if dx == dy == 0.0:
            continue
        error = math.remainder(math.atan2(dy, dx) - heading, math.tau)
        heading += max(-STEP_M / 0.5, min(STEP_M / 0.5, error))
        x, y = world.move(x, y, STEP_M * math.cos(heading), STEP_M * math.sin(heading))
        places.append((x, y))
    assert status is Status.ARRIVED
    return clearance(world.grid, places, 1.0).min()


OFFICE = [
    *outline((0, 0), (8, 0), (8, 6), (0, 6), (0, 0)),
    *((0, 2.5, 1.2, 2.5), (2.1, 2.5, 5.6, 2.5), (6.5, 2.5, 8, 2.5)),  # doors of 0.9 m to a corridor of 1.4 m
    *((0, 3.9, 3.4, 3.9), (4.3, 3.9, 8, 3.9), (4, 0, 4, 2.5)),
]


@pytest.mark.parametrize("seed", range(4))
def test_planned_way_points_are_reached_without_touching_a_wall(seed):
    grid, world = wall_planning_grid((0, 0, 8, 6), 0.1, 0.4, OFFICE), SmallWorld(OFFICE, 0.25, sight_m=2.5)
    free = np.flatnonzero(grid.free)
    place, *goals = [grid.centre_m(cell) for cell in np.random.default_rng(seed).choice(free, 6).tolist()]
    navigator = Vfh(VfhParameters())
    for goal in goals:
        for way_point in grid.plan(place, [goal]):
            navigator.restart()
            places, status = world.run(navigator, place, way_point, 150)
            assert status is Status.ARRIVED
            assert clearance(world.grid, places, 1.0).min() > 0.26
            place = tuple(places[-1].tolist())


def test_two_robots_that_meet_head_on_pass_each_other_on_the_right():
    robots, goals = [(0.0, 0.0), (6.0, 0.0)], [(6.0, 0.0), (0.0, 0.0)]
    navigators = [Vfh(VfhParameters(robot_radius_m=0.2)) for _ in robots]
    nearest, sides = math.inf, []
    for _ in range(80):
        scans = [shapely_scan(shapely.Point(other).buffer(0.2), *own) for own, other in (robots, robots[::-1])]
        steers = [n.steer(*r, g, s) for n, r, g, s in zip(navigators, robots, goals, scans, strict=True)]
        robots = [(x + STEP_M * s.dx, y + STEP_M * s.dy) for (x, y), s in zip(robots, steers, strict=True)]
        nearest = min(nearest, math.dist(*robots))
        sides += [(robots[0][1], robots[1][1])] if abs(robots[0][0] - robots[1][0]) < 0.2 else []
    assert [s.status for s in steers] == [Status.ARRIVED] * 2
    assert nearest > 0.4
    assert all(first < second for first, second in sides)
    assert sides


def test_a_goal_in_front_of_a_wall_is_reached_and_one_too_near_to_it_is_not():
    world = SmallWorld([(3.0, -5.0, 3.0, 5.0)], 0.25, sight_m=2.5)
    for off_m, reached in ((0.4, True), (0.15, False)):
        places, status = world.run(Vfh(VfhParameters()), (0.0, 0.3), (3.0 - off_m, 0.0), 100)
        assert (status is Status.ARRIVED) == reached
        assert 3.0 - places[:, 0].max() > 0.25


def test_a_body_held_by_a_wall_end_that_no_beam_sees_goes_around_it():
    angle = math.pi / 8  # the wall points at the robot along an angle half way between two of eight beams
    away = (math.cos(angle), math.sin(angle))
    world = SmallWorld([(0.21 * away[0], 0.21 * away[1], 2 * away[0], 2 * away[1])], beams=8)
    assert world.scan(0.0, 0.0) == (math.inf,) * 8
    goal = (4 * away[0], 4 * away[1])
    places, _ = world.run(Vfh(VfhParameters(robot_radius_m=0.2, bump_steps=0)), (0.0, 0.0), goal, 40)
    assert np.hypot(*places.T).max() < 0.02, "held for good"
    places, status = world.run(Vfh(VfhParameters(robot_radius_m=0.2)), (0.0, 0.0), goal, 80)
    assert np.hypot(*places[:3].T).max() < 0.02, "held"
    assert status is Status.ARRIVED
