"""Random motion: straight pieces in all directions, never into a wall, and the same for the same stream."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from cosim.machine import Drive, GoTo
from protocols.aggregation.parameters import WalkingParameters
from protocols.aggregation.touring import RandomWalk
from tests.protocols.aggregation.ground_scene import TICK, Stage, hall


def walking(on, starts, seed=1, drive="omni", **parameters):
    scene = Stage(on, starts, drive)
    for robot in range(len(starts)):
        stream = np.random.default_rng([seed, robot])
        scene.walkers[robot] = RandomWalk(on, WalkingParameters(**parameters), TICK, stream)
    return scene


def ends_of(scene, robot=0):
    return [(order.x_m, order.y_m) for _, order in scene.orders[robot] if isinstance(order, GoTo)]


@pytest.mark.parametrize("drive", ["grid", "differential", "omni"])
def test_a_walk_goes_from_end_to_end_and_touches_no_wall(drive):
    on = hall(16.0, 8.0, [(8, 0, 8, 3), (8, 5, 8, 8)])
    scene = walking(on, [(3.0, 3.0)], drive=drive, leg_m=6.0)
    places = []
    for _ in range(3000):
        scene.tick()
        scene._measure()
        places.append(scene.place(0))
    ends = ends_of(scene)
    assert len(ends) > 20
    assert scene.least_clearance_m >= 0.25
    assert all(math.dist(a, b) <= 6.0 + 0.2 for a, b in pairwise([(3.0, 3.0), *ends]))
    for end in ends[:-1]:
        assert min(math.dist(end, place) for place in places) < 0.06
    assert not scene.walkers[0].stuck


@pytest.mark.slow
def test_directions_are_uniform_where_nothing_is_in_the_way():
    on = hall(10.0, 10.0)
    turns = []
    for seed in range(250):
        scene = walking(on, [(5.0, 5.0)], seed, leg_m=2.0)
        scene.tick()
        (end,) = ends_of(scene)
        assert math.dist(end, (5.0, 5.0)) == pytest.approx(2.0)
        turns.append(math.atan2(end[1] - 5.0, end[0] - 5.0))
    assert stats.kstest(turns, stats.uniform(-math.pi, math.tau).cdf).pvalue > 1e-3
    assert stats.kstest(np.abs(turns), stats.uniform(0, math.pi).cdf).pvalue > 1e-3


def test_a_walk_depends_on_its_stream_alone():
    on = hall(16.0, 8.0)
    runs = []
    for seed in (1, 1, 2):
        scene = walking(on, [(3.0, 3.0)], seed)
        for _ in range(400):
            scene.tick()
        runs.append(ends_of(scene))
    assert runs[0] == runs[1] != runs[2]


def test_a_walk_stands_when_told_and_goes_on_when_told():
    scene = walking(hall(16.0, 8.0), [(3.0, 3.0)])
    own = scene.walkers[0]
    for _ in range(20):
        scene.tick()
    own.head_for(None)
    for _ in range(30):
        scene.tick()
    at = scene.place(0)
    assert scene.orders[0][-1][1] == Drive(0.0, 0.0)
    orders = len(scene.orders[0])
    for _ in range(50):
        scene.tick()
    assert scene.place(0) == at
    assert len(scene.orders[0]) == orders
    own.head_for((1.0, 1.0))
    for _ in range(30):
        scene.tick()
    assert math.dist(scene.place(0), at) > 0.5


def test_a_walk_does_not_set_out_towards_a_robot_that_is_near():
    on = hall(10.0, 10.0)
    for seed in range(60):
        scene = walking(on, [(5.0, 5.0), (5.8, 5.0)], seed)
        scene.walkers[1] = None
        scene.tick()
        (end,) = ends_of(scene)
        for share in np.linspace(0.0, 1.0, 40):
            there = 5.0 + share * (end[0] - 5.0), 5.0 + share * (end[1] - 5.0)
            assert math.dist(there, (5.8, 5.0)) > 0.5


def test_walks_turn_away_from_each_other_and_keep_walking():
    on = hall(8.0, 5.0)
    scene = walking(on, [(1.0, 1.0), (7.0, 1.0), (1.0, 4.0), (7.0, 4.0), (4.0, 2.5)])
    spots = [set() for _ in scene.walkers]
    for _ in range(3000):
        scene.tick()
        for robot, spot in enumerate(spots):
            x, y = scene.place(robot)
            spot.add((int(x), int(y)))
    assert min(map(len, spots)) > 20, "each has been almost everywhere"


def test_where_nothing_is_free_a_walk_is_stuck():
    scene = walking(hall(0.9, 0.9, cell_m=0.1), [(0.45, 0.45)], leg_m=0.04)
    scene.tick()
    assert scene.walkers[0].stuck
