"""Bodies: exact arrival, limits, the time that a distance takes, and crowds that never overlap nor enter a wall."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from cosim.errors import LocalProtocolError
from cosim.geometry.segments import clearance, segment_grid
from cosim.machine import Drive, GoTo
from cosim.observation import Seen
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.units import MS, S

TICK = 100 * MS
OPEN = segment_grid([])


def alone(walls=OPEN, start=(0.0, 0.0), heading=0.0, **body):
    return Fleet([BodySettings(**body)], [start], walls, TICK, headings_rad=[heading])


def drive(fleet, command, most=3000):
    """Observations of body 0 at every tick from the one at which it sets out, until it arrives."""
    fleet.apply([(0, command)])
    fleet.step()
    seen = fleet.observations()
    while not seen[-1].arrived:
        assert len(seen) < most
        fleet.step()
        seen += fleet.observations()[:1]
    return seen


def trapezoid(distance, speed, acceleration):
    """Time to go *distance* from rest to rest."""
    if distance >= speed**2 / acceleration:
        return distance / speed + speed / acceleration
    return 2 * math.sqrt(distance / acceleration)


@pytest.mark.parametrize("kind", ["grid", "differential"])
@pytest.mark.parametrize("seed", range(60))
def test_a_distance_takes_the_time_of_the_trapezoid_and_ends_exactly_on_the_goal(kind, seed):
    draw = np.random.default_rng(seed)
    speed, acceleration, distance = draw.uniform(0.1, 2), draw.uniform(0.2, 3), draw.uniform(0.01, 5)
    bearing = draw.uniform(-3, 3)
    goal = GoTo(distance * math.cos(bearing), distance * math.sin(bearing))
    fleet = alone(speed_mps=speed, acceleration_mps2=acceleration, drive=kind, heading=bearing)
    seen = drive(fleet, goal)
    assert (seen[-1].x_m, seen[-1].y_m) == (goal.x_m, goal.y_m)
    assert 0.1 * (len(seen) - 1) == pytest.approx(trapezoid(distance, speed, acceleration), abs=0.1)
    speeds = [observation.speed_mps for observation in seen] + [0.0]
    assert max(speeds) <= speed * (1 + 1e-9)
    assert min(speeds) >= 0
    assert max(abs(b - a) for a, b in pairwise(speeds)) <= 0.1 * acceleration * (1 + 1e-6)


@pytest.mark.parametrize("ticks", [1, 2, 3, 5, 8])
def test_a_way_of_whole_braking_ticks_takes_no_tick_more(ticks):
    # h, 2h, ..., n h, ..., 2h, h with h = a T^2 = 0.01 m is n^2 h in 2n - 1 ticks
    seen = drive(alone(speed_mps=5.0), GoTo(0.01 * ticks**2, 0))
    assert len(seen) - 1 == 2 * ticks - 1


@pytest.mark.parametrize("angle", [0.3, -2.0, 3.0, math.pi, -math.pi / 2])
def test_a_differential_drive_turns_on_the_spot_then_goes_straight(angle):
    seen = drive(alone(drive="differential"), GoTo(2 * math.cos(angle), 2 * math.sin(angle)))
    turning = [o for o in seen if (o.x_m, o.y_m) == (0, 0)]
    turns = np.diff([o.heading_rad for o in turning])
    assert np.abs(turns).max() <= 2.0 * 0.1 * (1 + 1e-9)
    assert np.abs(np.diff([0, *turns, 0])).max() <= 4.0 * 0.01 * (1 + 1e-6)
    assert 0.1 * (len(turning) - 1) == pytest.approx(trapezoid(abs(angle), 2.0, 4.0), abs=0.1001)
    for o in seen[len(turning) :]:
        assert math.atan2(o.y_m, o.x_m) == pytest.approx(math.atan2(math.sin(angle), math.cos(angle)), abs=1e-9)


def test_a_grid_drive_needs_no_time_to_turn():
    fleet = alone()
    ways = [len(drive(fleet, GoTo(*goal))) for goal in ((1, 0), (1, 1), (0, 1), (0, 0))]
    assert len(set(ways)) == 1
    assert fleet.observations()[0].heading_rad == -math.pi / 2


def test_a_goal_behind_a_moving_body_is_reached_after_a_stop():
    fleet = alone(speed_mps=2.0)
    fleet.apply([(0, GoTo(9, 0))])
    for _ in range(20):
        fleet.step()
    seen = drive(fleet, GoTo(0, 0))
    assert (seen[-1].x_m, seen[-1].y_m) == (0, 0)
    assert max(o.x_m for o in seen) > seen[0].x_m + 1.5  # v^2 / 2a = 2 m to stop, less half a tick
    assert max(abs(b.speed_mps - a.speed_mps) for a, b in pairwise(seen)) <= 0.1 * (1 + 1e-6)


@pytest.mark.parametrize("ahead", [0.5, 0.19])  # 0.19 m is the way of a tick of braking: there, but too fast
@pytest.mark.parametrize("kind", ["grid", "differential"])
def test_a_goal_too_near_to_stop_at_is_overrun_and_come_back_to(kind, ahead):
    fleet = alone(speed_mps=2.0, drive=kind)
    fleet.apply([(0, GoTo(9, 0))])
    for _ in range(30):
        fleet.step()
    goal = GoTo(fleet.pose_at(0, fleet.time + TICK)[0] + ahead, 0)
    seen = drive(fleet, goal)
    assert (seen[-1].x_m, seen[-1].y_m) == (goal.x_m, 0)
    assert max(o.x_m for o in seen) > goal.x_m + 1
    assert max(abs(b.speed_mps - a.speed_mps) for a, b in pairwise(seen)) <= 0.1 * (1 + 1e-6)


@pytest.mark.parametrize("kind", ["grid", "differential"])
@pytest.mark.parametrize("seed", range(20))
def test_changes_of_mind_never_break_the_limits(kind, seed):
    draw = np.random.default_rng(seed)
    fleet, last = alone(drive=kind), np.zeros(2)
    for tick in range(300):
        if draw.random() < 0.15:
            goal = draw.uniform(-1, 1, 2)
            fleet.apply([(0, GoTo(*goal) if draw.random() < 0.6 else Drive(*draw.uniform(-2, 2, 2)))])
        fleet.step()
        x, y, heading = fleet.pose_at(0, fleet.time)
        observation = fleet.observations()[0]
        assert (observation.x_m, observation.y_m) == (x, y)
        next_x, next_y, next_heading = fleet.pose_at(0, fleet.time + TICK)
        velocity = np.array([next_x - x, next_y - y]) / 0.1
        turn = math.remainder(next_heading - heading, math.tau) / 0.1
        assert np.hypot(*velocity) <= 0.5 * (1 + 1e-9), tick
        assert abs(turn) <= 2.0 * (1 + 1e-9)
        # the length of the velocity changes by the acceleration; its direction turns with the body
        assert abs(np.hypot(*velocity) - np.hypot(*last)) <= 0.1 * (1 + 1e-6) + 0.5 * (1 - math.sin(0.1) / 0.1)
        last = velocity
    seen = drive(fleet, GoTo(0.25, -0.5))
    assert (seen[-1].x_m, seen[-1].y_m) == (0.25, -0.5)


def test_drive_follows_the_arc():
    fleet = alone(acceleration_mps2=100.0, turn_acceleration_radps2=100.0)
    fleet.apply([(0, Drive(0.5, 0.5))])  # a circle of 1 m around (0, 1)
    for tick in range(60):
        fleet.step()
        x, y, heading = fleet.pose_at(0, fleet.time)
        np.testing.assert_allclose((x, y), (math.sin(0.05 * tick), 1 - math.cos(0.05 * tick)), atol=1e-12)
        assert math.remainder(heading - 0.05 * tick, math.tau) == pytest.approx(0, abs=1e-12)


def test_between_ticks_a_body_moves_at_constant_velocity():
    fleet = alone()
    fleet.apply([(0, GoTo(3, 4))])
    for _ in range(4):
        fleet.step()
    begin, middle, end = (np.array(fleet.pose_at(0, fleet.time + part * TICK // 4)) for part in (0, 1, 4))
    np.testing.assert_allclose(middle, begin + (end - begin) / 4, atol=1e-15)
    fleet.step()
    assert fleet.pose_at(0, fleet.time) == pytest.approx(tuple(end), abs=0)
    for time in (fleet.time - 1, fleet.time + TICK + 1):
        with pytest.raises(LocalProtocolError, match="pose at"):
            fleet.pose_at(0, time)


def test_time_counts_ticks_in_nanoseconds_from_the_start():
    fleet = Fleet([BodySettings()], [(0, 0)], OPEN, TICK, start=3 * S)
    fleet.step()
    fleet.step()
    assert fleet.time == 3 * S + 2 * TICK


def test_a_step_tells_the_way_of_the_interval_that_it_ends():
    fleet = Fleet([BodySettings(), BodySettings(speed_mps=0.3)], [(0, 0), (0, 5)], OPEN, TICK)
    fleet.apply([(0, GoTo(3, 4)), (1, GoTo(0, 6))])
    ways = [fleet.step() for _ in range(120)]
    assert ways[0] == 0.0  # they set out
    assert ways[1] == pytest.approx(2 * 0.01)  # h = a T^2 each
    assert sum(ways) == pytest.approx(5 + 1)
    assert ways[-1] == 0.0


def test_a_body_rests_when_it_stays_until_the_next_tick():
    fleet = alone()
    assert fleet.rests(0)
    fleet.apply([(0, GoTo(0.02, 0))])  # h, then h: it lands at the second tick after the one at which it sets out
    rests = []
    for _ in range(4):
        fleet.step()
        rests.append(fleet.rests(0))
    assert rests == [False, False, True, True]


def test_positions_outlive_the_next_step():
    fleet = alone()
    fleet.apply([(0, GoTo(9, 0))])
    for _ in range(10):
        fleet.step()
        before, x = fleet.positions_m, fleet.observations()[0].x_m
        fleet.step()
        assert before[0, 0] == x
        assert fleet.positions_m[0, 0] == fleet.observations()[0].x_m > x


def test_a_body_that_has_nowhere_to_go_has_arrived():
    fleet = alone()
    assert fleet.observations()[0].arrived
    fleet.apply([(0, GoTo(1, 0))])
    assert not fleet.observations()[0].arrived
    fleet.apply([(0, Drive(0, 0))])
    assert fleet.observations()[0].arrived
    assert len(drive(fleet, GoTo(0, 0))) == 2  # to where it stands: one tick


def test_observations_carry_who_is_visible():
    fleet = Fleet([BodySettings()] * 2, [(0, 0), (1, 0)], OPEN, TICK)
    assert [o.visible for o in fleet.observations([Seen((1,)), Seen((0,))])] == [(1,), (0,)]
    assert [o.visible for o in fleet.observations()] == [(), ()]


@pytest.mark.parametrize("command", [GoTo(math.nan, 0), GoTo(0, math.inf), Drive(math.nan, 0)])
def test_a_command_that_is_not_finite_is_our_own_misuse(command):
    with pytest.raises(LocalProtocolError, match="not finite"):
        alone().apply([(0, command)])


def test_a_wall_stops_a_body_at_contact_and_it_says_so():
    fleet = alone(segment_grid([(1, -1, 1, 1)]))
    fleet.apply([(0, GoTo(2, 0))])
    blocked = []
    for _ in range(60):
        fleet.step()
        blocked.append(fleet.observations()[0].blocked)
    observation = fleet.observations()[0]
    assert observation.x_m == pytest.approx(0.8, abs=1e-6)
    assert observation.speed_mps == pytest.approx(0, abs=1e-6)
    assert not observation.arrived
    assert blocked[-1]
    assert not any(blocked[:10])
    seen = drive(fleet, GoTo(0.8, 0.7))  # it can slide along
    assert seen[-1].y_m == 0.7


def test_a_body_as_wide_as_the_passage_drives_through():
    walls = segment_grid([(1, 0.2, 3, 0.2), (1, -0.2, 3, -0.2)])
    assert drive(alone(walls), GoTo(4, 0))[-1].x_m == 4
    stuck = alone(walls, radius_m=0.2001)
    stuck.apply([(0, GoTo(4, 0))])
    for _ in range(100):
        stuck.step()
    assert stuck.observations()[0].x_m < 1.01


def test_bodies_in_touching_lanes_pass_each_other():
    fleet = Fleet([BodySettings()] * 2, [(0, 0), (4, 0.4)], OPEN, TICK)
    fleet.apply([(0, GoTo(4, 0)), (1, GoTo(0, 0.4))])
    for _ in range(100):
        fleet.step()
        assert not any(o.blocked for o in fleet.observations())
    assert all(o.arrived for o in fleet.observations())


def test_a_follower_does_not_slow_its_leader():
    bodies = [BodySettings(), BodySettings(speed_mps=2.0)]
    both = Fleet(bodies, [(1, 0), (0, 0)], OPEN, TICK)
    leader = Fleet(bodies[:1], [(1, 0)], OPEN, TICK)
    both.apply([(0, GoTo(9, 0)), (1, GoTo(8, 0))])
    leader.apply([(0, GoTo(9, 0))])
    held_up = 0
    for _ in range(150):
        both.step()
        leader.step()
        first, second = both.observations()
        assert first == leader.observations()[0]
        assert first.x_m - second.x_m >= 0.4 - 1e-8
        held_up += second.blocked
    assert held_up > 10


def test_bodies_that_meet_head_on_stop_in_touch():
    fleet = Fleet([BodySettings()] * 2, [(0, 0), (3, 0)], OPEN, TICK)
    fleet.apply([(0, GoTo(3, 0)), (1, GoTo(0, 0))])
    for _ in range(80):
        fleet.step()
    left, right = fleet.observations()
    assert (left.x_m, right.x_m) == pytest.approx((1.3, 1.7), abs=1e-6)
    assert left.blocked
    assert right.blocked


def test_a_long_column_closes_up_behind_a_blocked_leader():
    # the cuts travel back one body a round: more bodies than rounds
    places = np.stack((0.40005 * np.arange(130), np.zeros(130)), axis=1)
    fleet = Fleet(
        [BodySettings()] * 130, places, segment_grid([(places[-1, 0] + 0.2, -1, places[-1, 0] + 0.2, 1)]), TICK
    )
    fleet.apply([(body, GoTo(99, 0)) for body in range(130)])
    for _ in range(20):
        fleet.step()
        assert np.diff(fleet.positions_m[:, 0]).min() >= 0.4 - 1e-8
    assert np.diff(fleet.positions_m[-90:, 0]).max() <= 0.4 + 1e-6


def crowd(seed, size):
    """A fleet of mixed bodies among random walls in a room, close together."""
    draw = np.random.default_rng(seed)
    walls = draw.uniform(0, 6, (8, 4))
    walls[:, 2:] = walls[:, :2] + draw.normal(0, 0.8, (8, 2))
    walls = np.concatenate((walls, [(0, 0, 6, 0), (6, 0, 6, 6), (6, 6, 0, 6), (0, 6, 0, 0)]))
    grid = segment_grid(walls)
    bodies, starts = [], np.empty((0, 2))
    while len(bodies) < size:
        body = BodySettings(
            radius_m=draw.uniform(0.1, 0.35),
            speed_mps=draw.uniform(0.2, 5.0),
            acceleration_mps2=draw.uniform(1.0, 20.0),
            drive=draw.choice(["grid", "differential"]),
        )
        place = draw.uniform(0, 6, 2)
        radii = np.array([other.radius_m for other in bodies])
        apart = np.hypot(*(starts - place).T) - radii if bodies else np.ones(1)
        if clearance(grid, [place], 1.0)[0] > body.radius_m and (apart > body.radius_m).all():
            bodies.append(body)
            starts = np.vstack((starts, place))
    return draw, walls, Fleet(bodies, starts, grid, TICK)


def check_crowd(seed, size, ticks):
    """Drive a crowd at random; return how often one was blocked."""
    draw, walls, fleet = crowd(seed, size)
    geometry = shapely.MultiLineString(list(walls.reshape(-1, 2, 2)))
    radii = fleet.radii_m
    reach = radii[:, None] + radii[None, :] - 1e9 * np.eye(size)
    blocked = 0
    for _ in range(ticks):
        for body in np.flatnonzero(draw.random(size) < 0.05).tolist():
            goal, speeds = draw.uniform(0, 6, 2), draw.uniform(-5, 5, 2)
            fleet.apply([(body, GoTo(*goal) if draw.random() < 0.7 else Drive(*speeds))])
        fleet.step()
        blocked += sum(o.blocked for o in fleet.observations())
        poses = np.array(
            [[fleet.pose_at(i, fleet.time + part * TICK // 8)[:2] for i in range(size)] for part in range(9)]
        )
        ways = shapely.linestrings(poses[(0, 8), :, :].transpose(1, 0, 2))
        assert (shapely.distance(ways, geometry) >= radii - 2e-7).all()
        apart = np.hypot(*(poses[:, :, None] - poses[:, None, :]).transpose(3, 0, 1, 2))
        assert (apart >= reach - 1e-8).all()
    return blocked


@pytest.mark.parametrize("seed", range(4))
def test_a_crowd_never_overlaps_nor_enters_a_wall(seed):
    assert check_crowd(seed, 8, 30) > 0


@pytest.mark.parametrize("seed", range(100, 112))
def test_a_dense_crowd_never_overlaps_nor_enters_a_wall(seed):
    assert check_crowd(seed, 24, 200) > 100
