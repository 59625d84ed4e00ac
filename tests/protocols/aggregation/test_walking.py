"""Walking with real bodies: along ways, past others, through doors; after whatever happens to a robot."""

import math
from itertools import pairwise

import numpy as np
import pytest

from cosim.machine import GoTo
from cosim.observation import Observation, Seen, Sighting
from cosim.robots.motion import Carry
from protocols.aggregation.parameters import WalkingParameters
from protocols.aggregation.walking import Near, Walker, in_the_way, retreat, way_round
from tests.protocols.aggregation.ground_scene import TICK, Stage, floor, ground_of, hall
from tests.tiers import soak_count

PARAMETERS = WalkingParameters()
DRIVES = ["grid", "differential", "omni"]


def two_rooms(door_m=2.0):
    return hall(16.0, 8.0, [(8, 0, 8, 4 - door_m / 2), (8, 4 + door_m / 2, 8, 8)])


def walker(on, speed_mps=1.0, **parameters):
    return Walker(on, 0.25, speed_mps, TICK, WalkingParameters(**parameters))


def stage(on, starts, goals, drive="grid", speed_mps=1.0, **options):
    """Return robots on their ways; those without a goal have no walker, as if dead."""
    scene = Stage(on, starts, drive, speed_mps, **options)
    for robot, goal in enumerate(goals):
        if goal is not None:
            scene.walkers[robot] = walker(on, speed_mps)
            scene.walkers[robot].head_for(goal)
    return scene


def way_m(on, start, goal):
    return on.length_m(start, goal)


# ---------------------------------------------------------------- alone


@pytest.mark.parametrize("drive", DRIVES)
def test_a_robot_alone_takes_about_as_long_as_its_way_and_gets_one_order_a_piece(drive):
    on = hall(16.0, 8.0, [(5, 0, 5, 6), (10, 2, 10, 8)])
    start, goal = (1.0, 1.0), (15.0, 7.0)
    scene = stage(on, [start], [goal], drive)
    pieces = len(on.way(start, goal))
    assert pieces >= 3
    seconds = scene.run(100.0)
    assert seconds is not None
    # a stop at every bend costs a second to brake and gather speed, and up to two to turn
    assert way_m(on, start, goal) <= seconds <= way_m(on, start, goal) + 3.5 * pieces + 2.0
    assert len(scene.orders[0]) == pieces
    assert math.dist(scene.place(0), goal) <= PARAMETERS.arrival_m
    assert scene.least_clearance_m >= 0.25
    scene.run(3.0)
    assert not scene.walkers[0].stuck
    for _ in range(30):
        scene.tick()
    assert math.dist(scene.place(0), goal) < 0.01, "it goes to the very place in the end"


def test_the_way_that_remains_becomes_shorter_and_is_that_of_the_ground():
    on = two_rooms()
    scene = stage(on, [(2.0, 1.0)], [(14.0, 1.0)])
    own = scene.walkers[0]
    assert own.remaining_m((2.0, 1.0)) == pytest.approx(on.length_m((2.0, 1.0), (14.0, 1.0)))
    left = []
    while not own.arrived:
        scene.tick()
        left.append(own.remaining_m(scene.place(0)))
    assert left[0] == pytest.approx(on.length_m((2.0, 1.0), (14.0, 1.0)), abs=0.2)
    assert all(b <= a + 1e-9 for a, b in pairwise(left))
    assert left[-1] <= PARAMETERS.arrival_m
    own.head_for(None)
    assert own.remaining_m(scene.place(0)) == 0.0


def test_without_a_goal_a_robot_stops_and_stands():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)])
    own = scene.walkers[0]
    for _ in range(40):
        scene.tick()
    own.head_for(None)
    assert own.arrived
    assert not own.stuck
    assert own.goal_m is None
    at = scene.place(0)
    for _ in range(30):
        scene.tick()
    assert 0.3 < math.dist(at, scene.place(0)) < 0.7, "it needs half a metre to brake, and does not come back"
    orders = len(scene.orders[0])
    for _ in range(50):
        scene.tick()
    assert len(scene.orders[0]) == orders == 2


def test_the_same_goal_again_is_no_news_and_another_is():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)])
    own = scene.walkers[0]
    for _ in range(20):
        own.head_for((14.0, 4.0))
        scene.tick()
    assert own.plans == 1
    assert len(scene.orders[0]) == 1
    own.head_for((2.0, 7.0))
    assert not own.arrived
    assert scene.run(30.0) is not None
    assert math.dist(scene.place(0), (2.0, 7.0)) <= PARAMETERS.arrival_m


def test_the_order_for_a_goal_is_given_again_after_others_have_moved_the_body():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(6.0, 4.0)])
    own = scene.walkers[0]
    scene.tick()
    assert scene.orders[0] == [(1, GoTo(6.0, 4.0))]
    scene.fleet.apply([(0, GoTo(2.0, 4.0))])  # by somebody else
    for _ in range(20):
        scene.fleet.step()
    own.head_for(None)
    own.head_for((6.0, 4.0))
    scene.tick()
    assert scene.orders[0][1:] == [(2, GoTo(6.0, 4.0))]
    assert scene.run(20.0) is not None


def test_a_robot_that_follows_a_moving_goal_keeps_moving():
    on = two_rooms()
    scene = stage(on, [(1.0, 4.0)], [(2.0, 4.0)], speed_mps=0.5)
    for second in range(20):
        scene.walkers[0].head_for((2.0 + 0.5 * second, 4.0))
        for _ in range(10):
            scene.tick()
    assert scene.place(0)[0] > 2.0 + 0.5 * 19 - 1.2


def test_a_goal_in_a_closed_room_leaves_the_robot_stuck_but_alert():
    on = hall(16.0, 8.0, [(8, 0, 8, 8)])
    scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)])
    own = scene.walkers[0]
    for _ in range(600):
        scene.tick()
    assert own.stuck
    assert not own.arrived
    assert own.remaining_m(scene.place(0)) == math.inf
    assert math.dist(scene.place(0), (2.0, 4.0)) < 0.01
    assert 3 <= own.plans <= 10, "it asks again and again, after longer and longer"
    own.head_for((6.0, 4.0))
    assert scene.run(20.0) is not None
    assert not own.stuck


def test_a_goal_where_nobody_can_stand_is_reached_at_the_nearest_free_place():
    on = two_rooms()
    goal = (8.1, 7.0)
    scene = stage(on, [(2.0, 4.0)], [goal])
    assert scene.run(40.0) is not None
    assert scene.place(0)[0] > 8.0
    assert math.dist(scene.place(0), on.stands(goal)) <= PARAMETERS.arrival_m


# ---------------------------------------------------------------- others in the way


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("door_m", [2.0, 1.2])
@pytest.mark.parametrize("off_m", [0.0, 0.3])
def test_two_robots_that_meet_in_a_door_get_past_each_other(drive, door_m, off_m):
    on = two_rooms(door_m)
    scene = stage(on, [(2.0, 4.0), (14.0, 4.0 + off_m)], [(14.0, 4.0), (2.0, 4.0)], drive)
    assert scene.run(120.0) is not None
    assert scene.nearest_m >= -1e-6
    assert scene.least_clearance_m >= 0.25 - 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
def test_three_robots_go_through_one_door(drive):
    scene = stage(two_rooms(), [(2, 4), (2, 3), (2, 5)], [(14, 4), (14, 3), (14, 5)], drive)
    assert scene.run(60.0) is not None


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("door_m", [2.0, 1.2])
def test_three_go_in_and_three_go_out(drive, door_m):
    west, east = [(2, 4), (2, 3), (2, 5)], [(14, 4), (14, 3), (14, 5)]
    scene = stage(two_rooms(door_m), west + east, east + west, drive)
    assert scene.run(400.0) is not None


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("body", [(8.0, 4.0), (8.0, 4.4), (8.1, 3.7), (7.6, 4.1), (8.0, 3.5)])
def test_a_dead_body_in_a_door_is_passed(drive, body):
    scene = stage(two_rooms(), [(2.0, 4.0), body], [(14.0, 4.0), None], drive)
    assert scene.run(60.0) is not None
    assert scene.place(1) == body


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
def test_a_door_that_a_dead_body_bars_is_avoided_if_there_is_another(drive):
    on = hall(16.0, 8.0, [(8, 0, 8, 1.5), (8, 2.7, 8, 6), (8, 7.2, 8, 8)])
    body = (8.0, 2.1)
    scene = stage(on, [(2.0, 2.1), body], [(14.0, 2.1), None], drive)
    assert scene.run(200.0) is not None


def test_a_door_that_is_barred_for_good_leaves_the_robot_stuck_until_it_is_free():
    on = two_rooms(1.2)
    scene = stage(on, [(2.0, 4.0), (8.0, 4.0)], [(14.0, 4.0), None])
    assert scene.run(100.0) is None
    assert scene.walkers[0].stuck
    scene.walkers[1] = walker(on)
    scene.walkers[1].head_for((10.0, 7.0))
    assert scene.run(120.0) is not None
    assert not scene.walkers[0].stuck


@pytest.mark.slow
@pytest.mark.parametrize("off_m", [0.0, 0.1])
@pytest.mark.parametrize("speed_mps", [0.02, 0.1])
def test_slow_robots_get_past_each_other_without_being_taken_for_stuck_on_the_way(speed_mps, off_m):
    on = two_rooms()
    scene = stage(on, [(6.0, 4.0), (10.0, 4.0 + off_m)], [(10.0, 4.0), (6.0, 4.0)], speed_mps=speed_mps)
    seen = set()
    for _ in range(int(30.0 / speed_mps)):
        scene.tick()
        seen.add(any(own.stuck for own in scene.walkers))
    assert seen == {False}
    assert scene.run(20.0 * 8.0 / speed_mps) is not None


def test_who_finds_its_goal_taken_has_arrived_before_it():
    scene = stage(hall(10.0, 6.0), [(2.0, 3.0), (7.0, 3.0)], [(7.0, 3.05), None])
    assert scene.run(20.0) is not None
    assert math.dist(scene.place(0), (7.0, 3.0)) < 0.5 + PARAMETERS.arrival_m


@pytest.mark.slow
def test_three_robots_cross_the_laboratory():
    on = ground_of("laboratory", 1.5, 0.1)
    _, _, places, _ = floor("laboratory")
    goals = [(7.6, 2.0), (7.5, 0.4), (7.5, 3.6)]
    scene = stage(on, places["starts"], goals, speed_mps=0.1)
    assert scene.run(500.0) is not None


@pytest.mark.soak
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("seed", range(soak_count(10)))
def test_nobody_is_held_up_for_ever_in_a_crowd(drive, seed):
    on = two_rooms()
    draw = np.random.default_rng(seed)
    free = np.flatnonzero(on.grid.free)

    def place():
        return on.grid.centre_m(int(draw.choice(free)))

    starts = []
    while len(starts) < 6:
        start = place()
        if all(math.dist(start, other) > 0.8 for other in starts):
            starts.append(start)
    scene = stage(on, starts, [place() for _ in starts], drive)
    since = [0] * 6
    for tick in range(8000):
        scene.tick()
        for robot, own in enumerate(scene.walkers):
            if own.arrived:
                own.head_for(place())
                since[robot] = tick
            assert tick - since[robot] < 5000, (robot, scene.place(robot), own.goal_m)


# ---------------------------------------------------------------- what happens to robots


@pytest.mark.parametrize("to", [(3.0, 7.0), (12.0, 1.0)])
def test_a_robot_that_is_put_elsewhere_plans_anew(to):
    on = hall(16.0, 8.0, [(5, 0, 5, 6), (10, 2, 10, 8)])
    scene = stage(on, [(1.0, 1.0)], [(15.0, 7.0)])
    for _ in range(60):
        scene.tick()
    plans = scene.walkers[0].plans
    x, y = scene.place(0)
    heading = float(scene.fleet.observed[0][2])
    assert scene.fleet.carry(0, Carry((x, y, heading), (*to, heading)), unaware=False)
    assert scene.run(60.0) is not None
    assert scene.walkers[0].plans > plans
    assert scene.least_clearance_m >= 0.24


def test_a_robot_that_is_carried_away_from_its_goal_goes_back():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(6.0, 4.0)])
    assert scene.run(20.0) is not None
    x, y = scene.place(0)
    assert scene.fleet.carry(0, Carry((x, y, 0.0), (14.0, 1.0, 0.0)), unaware=False)
    for _ in range(20):
        scene.tick()
    assert not scene.walkers[0].arrived
    assert scene.run(60.0) is not None
    assert math.dist(scene.place(0), (6.0, 4.0)) <= PARAMETERS.arrival_m


def test_a_robot_that_was_frozen_goes_on():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)])
    for _ in range(30):
        scene.tick()
    scene.fleet.freeze(0, True)
    for _ in range(300):
        scene.tick()
    assert scene.walkers[0].stuck
    scene.fleet.freeze(0, False)
    assert scene.run(60.0) is not None
    assert not scene.walkers[0].stuck


def test_a_slow_robot_is_given_longer_before_it_counts_as_stuck():
    on = two_rooms()
    for speed_mps, patience_s in ((1.0, 4.0), (0.02, 25.0)):
        scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)], speed_mps=speed_mps)
        scene.fleet.freeze(0, True)
        stuck = []
        for _ in range(round(10 * patience_s) + 30):
            scene.tick()
            stuck.append(scene.walkers[0].stuck)
        assert not any(stuck[: round(10 * patience_s) - 1])
        assert stuck[-1]


def test_a_robot_whose_order_was_lost_is_given_it_again():
    on = two_rooms()
    scene = stage(on, [(2.0, 4.0)], [(14.0, 4.0)])
    for _ in range(30):
        scene.tick()
    scene.stand(0)
    assert scene.run(60.0) is not None


# ---------------------------------------------------------------- the parts


def test_what_lies_beside_or_behind_is_not_in_the_way():
    assert in_the_way((0, 0), (10, 0), (3, 0.4), 0.5)
    assert not in_the_way((0, 0), (10, 0), (3, 0.6), 0.5)
    assert not in_the_way((0, 0), (10, 0), (-0.3, 0), 0.5)
    assert not in_the_way((0, 0), (2, 0), (3, 0), 0.5)
    assert in_the_way((0, 0), (2, 0), (2.4, 0), 0.5)
    assert not in_the_way((1, 1), (1, 1), (1, 1), 0.5)


def test_a_body_is_passed_on_the_side_with_more_room():
    on = two_rooms()
    here, place = (6.5, 4.0), (10.0, 4.0)
    for body, sign in (((8.0, 4.2), -1), ((8.0, 3.8), 1)):
        way = way_round(on, here, place, body, True)
        assert way is not None
        assert all(sign * (y - body[1]) > 0.5 for _, y in way)
    right, left = (way_round(on, here, place, (8.0, 4.0), side) for side in (True, False))
    assert all(y < 3.5 for _, y in right)
    assert all(y > 4.5 for _, y in left)
    assert way_round(two_rooms(1.2), here, place, (8.0, 4.0), True) is None
    assert way_round(on, here, here, (8.0, 4.0), True) is None


def test_who_makes_way_goes_off_the_line_or_back_but_never_through_the_other():
    room = hall(10.0, 6.0)
    place = retreat(room, (5.0, 3.0), (3.5, 3.0))
    assert place is not None
    assert abs(place[1] - 3.0) > 0.5
    corridor = hall(16.0, 1.2)
    back = retreat(corridor, (8.0, 0.6), (6.8, 0.6))
    assert back is not None
    assert back[0] > 9.0
    assert retreat(hall(3.0, 1.2), (2.7, 0.6), (2.0, 0.6)) is None


@pytest.mark.parametrize("seed", range(20))
def test_who_is_near_is_known_at_every_step_of_a_way_between_pictures(seed):
    random = np.random.default_rng(seed)
    near, here, met = Near(1.5), np.array([10.0, 10.0]), 0
    for tick in range(400):
        if tick % 25 == 0:
            places = random.uniform(0.0, 20.0, (60, 2)).tolist()
            seen = tuple(Sighting(number, *place) for number, place in enumerate(places)) if tick % 100 else ()
            course = random.uniform(-1.0, 1.0, 2)
        here += random.choice([0.0, 0.3, 3.0], p=[0.1, 0.88, 0.02]) * course
        here = np.clip(here, 0.0, 20.0)
        x, y = here.tolist()
        expected = [each for each in seen if (each.x_m - x) ** 2 + (each.y_m - y) ** 2 < 2.25]
        assert near.look(Observation(x, y, 0.0, 1.0, False, False, Seen((), seen))) == expected
        met += len(expected)
    assert met > 40


def test_others_far_off_cost_no_scan():
    on = two_rooms()
    own = walker(on)
    own.head_for((14.0, 4.0))

    class Blind:
        def sees(self, points_m):
            raise AssertionError("not asked")

        def ranges_m(self):
            raise AssertionError("not asked")

    far = (Sighting(1, 7.0, 4.0), Sighting(2, 2.0, 7.0), Sighting(3, 1.0, 4.0), Sighting(4, 3.0, 5.2))
    orders = [
        own.step(Observation(2.0 + 0.1 * k, 4.0, 0.0, 1.0, False, False, Seen((), far), Blind())) for k in range(30)
    ]
    assert orders[0] == GoTo(14.0, 4.0)
    assert orders[1:] == [None] * 29
    near = (Sighting(1, 6.2, 4.0),)
    with pytest.raises(AssertionError, match="not asked"):
        own.step(Observation(5.0, 4.0, 0.0, 1.0, False, False, Seen((), near), Blind()))
