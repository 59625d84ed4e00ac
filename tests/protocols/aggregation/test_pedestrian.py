"""People among walls that they do not know: they come where a way leads, and past others."""

import math

import pytest

from protocols.aggregation.parameters import WalkingParameters
from protocols.aggregation.walking import Pedestrian, Walker
from tests.protocols.aggregation.ground_scene import TICK, Stage, floor, ground_of, hall

MAZE = [(4, 0, 4, 6), (8, 2, 8, 8), (12, 0, 12, 6)]
TRAP = [(10, 1, 10, 7), (6, 1, 10, 1), (6, 7, 10, 7)]


def pedestrian(on, speed_mps=1.0, **parameters):
    return Pedestrian(on, 0.25, speed_mps, TICK, WalkingParameters(**parameters))


@pytest.mark.parametrize("drive", ["grid", "differential", "omni"])
@pytest.mark.parametrize("sight_m", [1.0, 5.0, 30.0])
@pytest.mark.parametrize("walls", [MAZE, TRAP], ids=["maze", "trap"])
def test_a_pedestrian_comes_to_its_goal(drive, sight_m, walls):
    on = hall(16.0, 8.0, walls)
    scene = Stage(on, [(2.0, 4.0)], drive)
    scene.walkers[0] = own = pedestrian(on, sight_m=sight_m)
    own.head_for((14.5, 4.0))
    assert scene.run(200.0) is not None
    assert math.dist(scene.place(0), (14.5, 4.0)) <= 0.3
    assert scene.least_clearance_m >= 0.25 - 1e-6


@pytest.mark.slow
def test_who_sees_farther_walks_less_and_a_map_is_better_still():
    on = hall(16.0, 8.0, MAZE)
    ways = []
    for own in (
        pedestrian(on, sight_m=0.6),
        pedestrian(on, sight_m=30.0),
        Walker(on, 0.25, 1.0, TICK, WalkingParameters()),
    ):
        scene = Stage(on, [(2.0, 1.0)], "omni")
        scene.walkers[0] = own
        own.head_for((14.5, 1.0))
        seconds = scene.run(300.0)
        assert seconds is not None
        ways.append(seconds)
    assert ways[0] > ways[1] > ways[2]


def test_a_pedestrian_knows_how_far_its_goal_is_and_no_more():
    on = hall(16.0, 8.0, MAZE)
    own = pedestrian(on)
    assert own.remaining_m((2.0, 1.0)) == 0.0
    own.head_for((14.0, 1.0))
    assert own.remaining_m((2.0, 1.0)) == 12.0


def test_a_pedestrian_finds_out_that_no_way_leads_to_a_goal():
    on = hall(16.0, 8.0, [(10, 2, 14, 2), (14, 2, 14, 6), (14, 6, 10, 6), (10, 6, 10, 2)])
    scene = Stage(on, [(2.0, 4.0)], "omni")
    scene.walkers[0] = own = pedestrian(on)
    own.head_for((12.0, 4.0))
    assert scene.run(60.0) is None
    assert own.stuck
    plans, calm = own.plans, 0
    for _ in range(300):
        scene.tick()
        calm, plans = (calm + 1 if own.plans == plans else 0), own.plans
        if calm == 30:
            break
    assert calm == 30, "it has stopped looking for a while"
    own.head_for((15.2, 4.0))
    assert scene.run(60.0) is not None
    assert not own.stuck


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["grid", "differential", "omni"])
def test_two_pedestrians_meet_in_a_door_and_pass_a_dead_body_there(drive):
    on = hall(16.0, 8.0, [(8, 0, 8, 3), (8, 5, 8, 8)])
    for starts, goals in (
        ([(2.0, 4.0), (14.0, 4.0)], [(14.0, 4.0), (2.0, 4.0)]),
        ([(2.0, 4.0), (8.0, 4.0)], [(14.0, 4.0), None]),
    ):
        scene = Stage(on, starts, drive)
        for robot, goal in enumerate(goals):
            if goal is not None:
                scene.walkers[robot] = pedestrian(on)
                scene.walkers[robot].head_for(goal)
        assert scene.run(120.0) is not None


@pytest.mark.slow
def test_pedestrians_and_robots_cross_the_laboratory_together():
    on = ground_of("laboratory", 1.5, 0.1)
    _, _, places, _ = floor("laboratory")
    scene = Stage(on, places["starts"], "grid", 0.3)
    for robot, goal in enumerate([(7.6, 2.0), (7.5, 0.4), (7.5, 3.6)]):
        kind = Pedestrian if robot == 1 else Walker
        scene.walkers[robot] = kind(on, 0.25, 0.3, TICK, WalkingParameters())
        scene.walkers[robot].head_for(goal)
    assert scene.run(300.0) is not None
