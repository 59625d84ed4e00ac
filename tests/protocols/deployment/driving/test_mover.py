"""Movers on real bodies: they arrive, touch nothing and nobody, pass each other, and make way."""

import math

import numpy as np
import pytest

from cosim.machine import Drive
from cosim.observation import Observation
from protocols.deployment.driving.mover import Mover
from protocols.deployment.driving.yielding import in_the_way, off_way_m, refuge
from protocols.motion.floor import Blocker, Floor
from protocols.motion.parameters import DrivingParameters
from tests.protocols.deployment.driving_scene import TICK, Scene, body, box, line, random_office
from tests.tiers import soak_count

LOW, HIGH = 9.0, 11.0
CROSSING = line(
    *((0, LOW), (LOW, LOW), (LOW, 0), (HIGH, 0), (HIGH, LOW), (20, LOW)),
    *((20, HIGH), (HIGH, HIGH), (HIGH, 20), (LOW, 20), (LOW, HIGH), (0, HIGH), (0, LOW)),
)
BAY = line((0, 0), (20, 0), (20, 0.8), (12, 0.8), (12, 2), (11, 2), (11, 0.8), (0, 0.8), (0, 0))


def assert_unharmed(scene):
    assert not scene.touched
    assert scene.least_gap_m > 0.0
    assert scene.least_room_m > 0.0


def arrive(scene, goals, seconds):
    """Have all robots go to their goals; return when the last one has arrived."""
    for mover, goal in zip(scene.movers, goals, strict=False):
        mover.go(goal)
    took = scene.run(seconds, scene.all_there)
    assert_unharmed(scene)
    assert scene.all_there(), [(mover.state, mover.remaining_m) for mover in scene.movers]
    for me, goal in enumerate(goals):
        assert math.dist(scene.place(me), goal) <= scene.parameters.arrive_m + 1e-9
    return took


def test_a_robot_alone_loses_little_time():
    scene = Scene([*box(20, 10), *line((5, 0), (5, 4)), *line((5, 5), (5, 10))], [(1.0, 1.0)])
    length = scene.floor.length_m(0.2, (1.0, 1.0), (18.0, 9.0))
    assert length is not None
    took = arrive(scene, [(18.0, 9.0)], 120)
    assert length / 0.5 - 1.0 <= took < 1.15 * length / 0.5 + 3.0


def test_by_the_terms_of_fox_it_arrives_as_soon_by_another_way():
    took, ends = [], []
    for kind in ("progress", "fox"):
        walls = [*box(8, 5), *line((4, 0), (4, 2)), *line((4, 3), (4, 5))]
        scene = Scene(walls, [(1.0, 1.0)], parameters=DrivingParameters(kind=kind))
        took.append(arrive(scene, [(7.0, 4.0)], 60))
        ends.append(scene.place(0))
    assert took[1] == pytest.approx(took[0], rel=0.1)
    assert ends[0] != ends[1]


def test_it_turns_on_the_spot_when_it_starts():
    scene = Scene(box(10, 1), [(5.0, 0.5)], headings=math.pi)
    scene.movers[0].go((8.0, 0.5))
    scene.run(1.0)
    assert math.dist(scene.place(0), (5.0, 0.5)) < 0.05


@pytest.mark.parametrize("turned", [0.0, 0.5 * math.pi, math.pi])
def test_who_turns_and_picks_up_speed_is_not_held_by_one_that_waits_to_follow(turned):
    slow = body(acceleration_mps2=0.3, turn_radps=1.571, turn_acceleration_radps2=1.05)
    limits = DrivingParameters(turn_radps=1.571, turn_acceleration_radps2=1.05)
    scene = Scene(box(12, 2), [(2.5, 1.0), (4.5, 1.0)], [slow] * 2, limits, headings=[0.0, turned])
    scene.movers[0].go((8.0, 1.0))
    scene.movers[1].go((10.0, 1.0))
    yielded = set()
    for _ in range(60):
        scene.tick()
        yielded |= {mover.yielding_to for mover in scene.movers}
    assert yielded == {None}
    assert scene.place(1)[0] > 5.0


def test_way_points_are_passed_in_their_order():
    scene = Scene(box(10, 10), [(1.0, 1.0)])
    scene.movers[0].go((9.0, 1.0), [(1.0, 8.0), (9.0, 8.0)])
    passed = []
    for _ in range(900):
        scene.tick()
        for k, place in enumerate([(1.0, 8.0), (9.0, 8.0), (9.0, 1.0)]):
            if math.dist(scene.place(0), place) < 0.5 and k not in passed:
                passed.append(k)
    assert passed == [0, 1, 2]
    assert scene.movers[0].state == "arrived"


def test_a_halt_stops_it_and_a_new_goal_starts_it_again():
    scene = Scene(box(10, 2), [(1.0, 1.0)])
    scene.movers[0].go((9.0, 1.0))
    scene.run(4.0)
    assert scene.movers[0].state == "driving"
    scene.movers[0].halt()
    scene.run(2.0)
    assert scene.movers[0].state == "idle"
    assert scene.fleet.rests(0)
    arrive(scene, [(2.0, 1.0)], 30)


def test_without_a_way_it_is_stuck_and_stands():
    scene = Scene([*box(10, 4), *line((5, 0), (5, 4))], [(1.0, 2.0)])
    scene.movers[0].go((8.0, 2.0))
    scene.run(15.0)
    assert scene.movers[0].state == "stuck"
    assert scene.place(0) == (1.0, 2.0)


def test_nothing_new_is_not_ordered_again_but_after_somebody_else_has_driven():
    floor = Floor(box(10, 10), (0.0, 0.0, 10.0, 10.0), None)
    mover = Mover(floor, 0, 0.2, 0.5, 1.0, floor.parameters, TICK)
    here = Observation(5.0, 5.0, 0.0, 0.0, True, False)
    assert mover.step(here, [], 0) == Drive(0.0, 0.0)
    assert mover.step(here, [], TICK) is None
    assert mover.step(here, [], 5 * TICK) == Drive(0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("width", [3.0, 1.6])
def test_two_robots_pass_each_other_in_a_corridor(width):
    middle = width / 2
    scene = Scene(box(14, width), [(1.0, middle), (13.0, middle)], headings=[0.0, math.pi])
    assert arrive(scene, [(13.0, middle), (1.0, middle)], 90) < 12 / 0.5 + 25.0


@pytest.mark.slow
@pytest.mark.parametrize("swapped", [False, True])
def test_in_a_narrow_corridor_one_makes_way_in_the_bay(swapped):
    """The bay is on one side of where they meet: whoever of them is on that side backs off first."""
    ends = [(1.0, 0.4), (19.0, 0.4)]
    starts, headings = (ends[::-1], [math.pi, 0.0]) if swapped else (ends, [0.0, math.pi])
    scene = Scene(BAY, starts, headings=headings)
    made_way = []
    for mover, goal in zip(scene.movers, starts[::-1], strict=True):
        mover.go(goal)

    def done():
        made_way.extend(me for me, mover in enumerate(scene.movers) if mover.yielding_to is not None)
        return scene.all_there()

    scene.run(120, done)
    assert_unharmed(scene)
    assert scene.all_there()
    assert made_way[0] == (0 if swapped else 1)


@pytest.mark.slow
def test_four_robots_cross_an_intersection():
    starts = [(3.0, 10.0), (10.0, 3.0), (17.0, 10.0), (10.0, 17.0)]
    scene = Scene(CROSSING, starts, headings=[0.0, math.pi / 2, math.pi, -math.pi / 2])
    arrive(scene, [starts[2], starts[3], starts[0], starts[1]], 150)


def test_a_parked_robot_is_gone_round_without_a_stop():
    scene = Scene(box(12, 2), [(1.0, 1.0), (6.0, 1.0)])
    assert arrive(scene, [(11.0, 1.0)], 60) < 10 / 0.5 + 6.0
    assert scene.place(1) == (6.0, 1.0)


def test_one_that_closes_the_way_is_named_and_when_it_is_asked_makes_room_and_comes_back():
    walls = line((0, 0), (14, 0), (14, 1.2), (7, 1.2), (7, 3), (6, 3), (6, 1.2), (0, 1.2), (0, 0))
    scene = Scene(walls, [(1.0, 0.6), (7.5, 0.6)])
    named = set()
    scene.movers[0].go((13.0, 0.6))
    scene.movers[1].go((7.5, 0.6))

    def done():
        named.add(scene.movers[0].blocked_by)
        return scene.all_there() and not scene.asides

    scene.run(120, done)
    assert_unharmed(scene)
    assert 1 in named
    assert math.dist(scene.place(0), (13.0, 0.6)) < 0.11
    assert math.dist(scene.place(1), (7.5, 0.6)) < 0.11


def test_stepping_aside_is_across_the_way_of_who_passes():
    scene = Scene(box(12, 4), [(6.0, 2.0)])
    scene.tick()
    scene.movers[0].retreat((2.0, 2.0), [(2.0, 2.0), (10.0, 2.0)])
    scene.run(15.0)
    assert scene.movers[0].state == "arrived"
    x, y = scene.place(0)
    assert abs(y - 2.0) >= 0.4
    assert abs(x - 6.0) < 0.3
    scene.movers[0].go((6.0, 2.0))
    scene.run(15.0)
    assert math.dist(scene.place(0), (6.0, 2.0)) < 0.11


def test_a_refuge_is_the_nearest_place_off_the_way_by_brute_force():
    floor = Floor(BAY, (0.0, 0.0, 20.0, 2.0), None)
    way = [(3.0, 0.4), (19.0, 0.4)]
    found = refuge(floor, 0.2, (9.0, 0.4), way, 0.2, [Blocker(8.0, 0.4, 0.2)])
    assert found is not None
    assert 11.0 < found.place_m[0] < 12.0
    assert found.place_m[1] > 0.8
    assert off_way_m(found.place_m, way) >= 0.4
    assert not in_the_way(found.place_m, 0.2, way, 0.2, 0.03)
    grid, _ = floor.grid(0.2)
    off = [
        math.dist(grid.centre_m(int(cell)), (9.0, 0.4))
        for cell in np.flatnonzero(grid.free)
        if off_way_m(grid.centre_m(int(cell)), way) >= 0.4 + 2 * 0.03 + 0.1
        and 11.0 < grid.centre_m(int(cell))[0] < 12.0
    ]
    assert math.dist(found.place_m, (9.0, 0.4)) == pytest.approx(min(off), abs=0.25)
    shut_in = refuge(floor, 0.2, (3.0, 0.4), [(0.4, 0.4), (19.0, 0.4)], 0.2, [Blocker(4.0, 0.4, 0.2)])
    assert shut_in is None


def test_who_is_not_in_sight_is_slower_round_corners():
    """With somebody behind the wall it goes more slowly through a door than without, or if it does not care."""
    walls = [*box(10, 6), *line((5, 0), (5, 2.6)), *line((5, 3.4), (5, 6))]
    took = []
    for starts, careful in (([(1.0, 3.0)], True), ([(1.0, 3.0), (5.8, 5.5)], True), ([(1.0, 3.0), (5.8, 5.5)], False)):
        fast = [body(speed_mps=1.0)] * len(starts)
        scene = Scene(walls, starts, fast, DrivingParameters(blind_corners=careful))
        scene.movers[0].go((9.0, 3.0))
        took.append(scene.run(60, scene.all_there))
        assert_unharmed(scene)
    assert took[0] == took[2]
    assert took[0] + 0.2 < took[1] < took[0] + 6.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_robots_of_all_sizes_reach_their_goals_in_an_office(seed):
    scene = random_office(seed, 3, sizes=True)
    scene.run(240, scene.all_there)
    assert_unharmed(scene)
    assert scene.all_there()


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1000, 1000 + max(2, soak_count(200))))
def test_any_robots_reach_their_goals_in_any_office(seed, record_property):
    scene = random_office(seed, 1 + seed % 6, sizes=seed % 2 == 0)
    scene.run(300, scene.all_there)
    record_property("robots driven to goals in offices", len(scene.movers))
    assert_unharmed(scene)
    assert scene.all_there(), [(mover.state, mover.goal_m, mover.blocked_by) for mover in scene.movers]


def test_a_large_and_a_small_robot_meet():
    scene = Scene(box(12, 2), [(1.0, 1.0), (11.0, 1.0)], [body(radius_m=0.3), body(radius_m=0.15, speed_mps=0.8)])
    arrive(scene, [(11.0, 1.0), (1.0, 1.0)], 90)
