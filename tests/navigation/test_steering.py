"""Navigators in a small world of walls: where the field stalls, who gets out, and what is reported on the way."""

import math
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.navigation.status import Status
from cosim.navigation.steering import AvoidPast, AvoidPastParameters, PotentialField, PotentialFieldParameters
from cosim.randomness import Draws
from tests.navigation.small_world import STEP_M, SmallWorld, outline, post

OPEN = (math.inf,) * 32
CANYON = SmallWorld(outline((1.0, 1.0), (3.0, 1.0), (3.0, -1.0), (1.0, -1.0)))
"""Open towards the start at (0, 0); the goal at (5, 0) lies behind its end."""
POST = SmallWorld(post(2.0, 0.0, 0.3))


def field(seed=0, **parameters):
    return PotentialField(PotentialFieldParameters(**parameters), Draws(seed, "noise"))


def past(seed=0, **parameters):
    return AvoidPast(AvoidPastParameters(**parameters), Draws(seed, "noise"))


# ---------------------------------------------------------------- where a field stalls


def test_straight_in_front_of_a_post_the_field_stalls_without_noise():
    places, status = POST.run(field(noise_gain=0.0), (0.0, 0.0), (4.0, 0.0), 150)
    assert status is Status.STUCK
    assert np.abs(places[:, 1]).max() < 1e-6, "nothing leads to either side"
    assert 1.0 < places[-50:, 0].min() < places[-50:, 0].max() < 1.7 - POST.radius_m + 1e-9


def test_noise_leads_around_the_post():
    sides = []
    for seed in range(40):
        places, status = POST.run(field(seed), (0.0, 0.0), (4.0, 0.0), 150)
        assert status is Status.ARRIVED, seed
        sides.append(places[np.abs(places[:, 0] - 2.0).argmin(), 1] > 0.0)
    assert 5 < sum(sides) < 35, "on either side of it"


def test_without_obstacles_the_way_is_straight_and_ends_at_the_goal():
    places, status = SmallWorld([]).run(field(noise_gain=0.0), (0.0, 0.0), (3.0, 4.0), 60)
    assert status is Status.ARRIVED
    assert len(places) - 1 == 49, "5 m, of which the last 0.1 m are arrival"
    assert np.abs(places @ [0.8, -0.6]).max() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_in_a_canyon_the_potential_field_stalls_for_good(seed):
    places, status = CANYON.run(field(seed), (0.0, 0.0), (5.0, 0.0), 3000)
    assert status is Status.STUCK
    inside = places[100:]
    assert (inside[:, 0] > 1.0).all()
    assert (inside[:, 0] < 3.0).all()
    assert (np.abs(inside[:, 1]) < 1.0).all()


@pytest.mark.slow
def test_with_avoid_past_every_one_of_100_gets_out_of_the_canyon(record_property):
    # straight ahead would be 49 steps; around the ends of the walls the way is 1.41 m + 2 m + 2.24 m, less the arrival
    times = []
    for seed in range(100):
        places, status = CANYON.run(past(seed), (0.0, 0.0), (5.0, 0.0), 1000)
        assert status is Status.ARRIVED, seed
        times.append(len(places) - 1)
    assert min(times) >= 55, "nobody goes through a wall"
    record_property("steps of 100 robots out of a canyon by Avoid Past", sum(times))


def test_it_is_the_past_that_leads_out():
    gainless, plain = past(past_gain=0.0, patience=50), field()
    for k in range(9):
        assert gainless.steer(0.1 * k, 0.1 * k, (5.0, 0.0), OPEN) == plain.steer(0.1 * k, 0.1 * k, (5.0, 0.0), OPEN)
    _, status = CANYON.run(past(past_gain=0.0), (0.0, 0.0), (5.0, 0.0), 2000)
    assert status is Status.STUCK


@pytest.mark.parametrize("radius_m", [0.2, 0.25])
@pytest.mark.parametrize("door_m", [0.9, 1.0, 1.2])
@pytest.mark.parametrize("start", [(-2.0, 0.0), (-2.0, 0.8), (-1.5, -0.9)])
def test_the_defaults_lead_through_an_office_door(start, door_m, radius_m):
    half = door_m / 2
    world = SmallWorld([(0.0, -4.0, 0.0, -half), (0.0, half, 0.0, 4.0)], radius_m)
    for seed in range(5):
        places, status = world.run(field(seed), start, (2.0, 0.0), 80)
        assert status is Status.ARRIVED, seed
        crossing = np.abs(places[:, 0]).argmin()
        assert abs(places[crossing, 1]) <= half - radius_m + STEP_M


@pytest.mark.parametrize("off_m", [-0.1, 0.0, 0.1])
def test_the_jambs_of_a_narrow_door_leave_a_way_free_between_their_margins(off_m):
    world = SmallWorld([(0.0, -4.0, 0.0, -0.45), (0.0, 0.45, 0.0, 4.0)], beams=64)
    dx, _, _ = field().steer(-0.15, off_m, (2.0, off_m), world.scan(-0.15, off_m))
    assert dx > 0.8, "on towards the goal, not from one jamb to the other"


def test_a_body_held_by_a_wall_end_that_no_beam_sees_frees_itself():
    # the wall points at the robot along an angle half way between two of eight beams
    angle = math.pi / 8
    away = (math.cos(angle), math.sin(angle))
    world = SmallWorld([(0.21 * away[0], 0.21 * away[1], 2 * away[0], 2 * away[1])], beams=8)
    assert world.scan(0.0, 0.0) == (math.inf,) * 8
    goal = (4 * away[0], 4 * away[1])
    places, _ = world.run(field(noise_gain=0.0, avoid_margin_m=0.2), (0.0, 0.0), goal, 40)
    assert np.hypot(*places[:3].T).max() < 0.02, "held"
    assert np.hypot(*places.T).max() > 0.09, "and free"


def test_a_command_may_act_two_ticks_late_before_the_robot_counts_as_held():
    navigator = field(noise_gain=0.0)
    steers = [navigator.steer(0.0, 0.0, (5.0, 0.0), OPEN)[:2] for _ in range(4)]
    assert steers[:3] == [(1.0, 0.0)] * 3 != steers[1:]


def test_who_is_told_to_stay_is_not_held():
    still = field(goal_gain=0.0, noise_gain=0.0)
    for _ in range(10):
        assert still.steer(0.0, 0.0, (5.0, 0.0), OPEN)[:2] == (0.0, 0.0)


# ---------------------------------------------------------------- what is reported


@pytest.mark.parametrize("make", [field, past])
def test_stuck_is_reported_when_progress_stops_and_taken_back_when_it_goes_on(make):
    navigator = make(patience=5, progress_m=0.1)
    assert navigator.steer(0.0, 0.0, (9.0, 0.0), OPEN).status is Status.UNDERWAY
    wobble = [navigator.steer(0.05 * (k % 2), 0.01 * k, (9.0, 0.0), OPEN).status for k in range(6)]
    assert wobble == [Status.UNDERWAY] * 4 + [Status.STUCK] * 2
    assert navigator.steer(0.2, 0.0, (9.0, 0.0), OPEN).status is Status.UNDERWAY


def test_going_back_and_forth_is_no_progress():
    navigator = field(patience=5)
    navigator.steer(3.0, 0.0, (9.0, 0.0), OPEN)
    statuses = [navigator.steer(0.2 * k, 0.0, (9.0, 0.0), OPEN).status for k in range(7)]
    assert statuses[-1] is Status.STUCK, "nearer with every step, but it has been nearer before"


def test_a_stuck_robot_still_steers():
    navigator = field(patience=1)
    steers = [navigator.steer(0.0, 0.01 * k, (9.0, 0.0), OPEN) for k in range(4)]
    assert steers[-1].status is Status.STUCK
    assert math.hypot(*steers[-1][:2]) == pytest.approx(1.0)


@pytest.mark.parametrize("make", [field, past])
def test_at_the_goal_the_robot_stays(make):
    assert make().steer(1.0, 2.0, (1.07, 2.07), OPEN) == (0.0, 0.0, Status.ARRIVED)
    assert make().steer(1.0, 2.0, (1.08, 2.07), OPEN).status is Status.UNDERWAY
    assert make(arrival_m=0.2).steer(1.0, 2.0, (1.08, 2.07), OPEN).status is Status.ARRIVED


@pytest.mark.parametrize("make", [field, past])
def test_a_restart_forgets_all_but_the_number_of_the_step(make):
    gains = {"noise_gain": 0.0, "patience": 3}
    navigator, fresh = make(**gains), make(**gains)
    for k in range(8):
        navigator.steer(0.1 * k, 0.1 * k * k, (9.0, 0.0), OPEN)
    assert navigator.steer(0.2, 0.3, (9.0, 0.0), OPEN).status is Status.STUCK
    navigator.restart()
    places = [(0.2, 0.1 * k) for k in range(3)]
    again, first = ([n.steer(*place, (-9.0, 3.0), OPEN) for place in places] for n in (navigator, fresh))
    assert again == first


# ---------------------------------------------------------------- what counts for a step


def test_every_step_of_the_step_drive_has_length_one():
    world, navigator = CANYON, past(noise_gain=0.3)
    x, y = 0.0, 0.0
    for _ in range(200):
        dx, dy, _ = navigator.steer(x, y, (5.0, 0.0), world.scan(x, y))
        assert math.hypot(dx, dy) == pytest.approx(1.0)
        x, y = world.move(x, y, STEP_M * dx, STEP_M * dy)


def test_the_speed_drive_slows_down_before_a_wall_and_comes_to_rest():
    world = SmallWorld([(2.0, -5.0, 2.0, 5.0)])
    navigator = field(drive="speed", noise_gain=0.0, avoid_gain=2.0)
    x, y, speeds = 0.0, 0.0, []
    for _ in range(120):
        dx, dy, _ = navigator.steer(x, y, (5.0, 0.0), world.scan(x, y))
        speeds.append(math.hypot(dx, dy))
        x, y = world.move(x, y, STEP_M * dx, STEP_M * dy)
    assert speeds[:10] == pytest.approx([1.0] * 10)
    assert max(speeds) <= 1.0 + 1e-12
    assert speeds[-1] < 1e-3, "at rest where goal and wall balance"
    braking = speeds[12:]
    assert all(later <= sooner + 1e-9 for sooner, later in pairwise(braking))
    assert 0.3 < 2.0 - x < 0.8


def test_in_the_speed_drive_a_weak_sum_is_slow():
    steer = field(drive="speed", noise_gain=0.0, goal_gain=0.25).steer(0.0, 0.0, (3.0, 4.0), OPEN)
    assert steer[:2] == pytest.approx((0.15, 0.2))


@pytest.mark.parametrize("make", [field, past])
def test_scans_may_be_tuples_lists_or_arrays_and_change_their_length(make):
    draw = np.random.default_rng(5)
    scans = [draw.uniform(0.35, 1.5, count) for count in (32, 32, 16, 64, 32, 0)]
    by_form = [
        [navigator.steer(0.1 * k, 0.0, (9.0, 1.0), form(scan)) for k, scan in enumerate(scans)]
        for form, navigator in ((tuple, make()), (np.ndarray.tolist, make()), (np.asarray, make()))
    ]
    assert by_form[0] == by_form[1] == by_form[2]
    assert len({steer[:2] for steer in by_form[0]}) == len(scans)


def test_noise_of_a_step_is_the_same_whatever_came_before():
    only_noise = {"goal_gain": 0.0, "noise_gain": 1.0, "noise_persistence": 4}
    one, two, other = field(7, **only_noise), field(7, **only_noise), field(8, **only_noise)
    near = (0.4,) * 5 + (math.inf,) * 27
    for k in range(20):
        one.steer(0.1 * k, 0.0, (9.0, 0.0), near, [(0.1 * k, 0.7)])
        two.steer(0.0, 0.2 * k, (0.0, -9.0), OPEN)
        other.steer(0.0, 0.2 * k, (0.0, -9.0), OPEN)
    two.restart()
    steps = [[n.steer(5.0 + k, 0.0, (99.0, 0.0), OPEN)[:2] for k in range(12)] for n in (one, two, other)]
    assert steps[0] == steps[1] != steps[2]
    assert [len(set(steps[0][k : k + 4])) for k in (0, 4, 8)] == [1, 1, 1]


def test_robots_in_sight_are_kept_away_from():
    towards, sightings = (9.0, 1.0), [(0.7, 0.2)]
    alone, watched = (field(noise_gain=0.0).steer(0.0, 0.0, towards, OPEN, seen) for seen in ([], sightings))
    careless = field(noise_gain=0.0, robot_gain=0.0).steer(0.0, 0.0, towards, OPEN, sightings)
    assert alone == careless
    assert watched.dy < -0.05
    close = field(noise_gain=0.0).steer(0.0, 0.0, towards, OPEN, [(0.3, 0.4)])
    assert close[:2] == pytest.approx((-0.6, -0.8), abs=1e-4), "within the margin only away from it"


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_the_field_does_not_depend_on_how_the_frame_is_turned(quarters):
    world, plain, turned = CANYON, field(noise_gain=0.0), field(noise_gain=0.0)
    cos, sin = round(math.cos(quarters * math.pi / 2)), round(math.sin(quarters * math.pi / 2))

    def turn(x, y):
        return cos * x - sin * y, sin * x + cos * y

    x, y = 0.0, 0.2
    for _ in range(25):
        scan = world.scan(x, y)
        step = plain.steer(x, y, (5.0, 0.3), scan)
        shift = 8 * quarters
        other = turned.steer(*turn(x, y), turn(5.0, 0.3), scan[-shift:] + scan[:-shift])
        assert other[:2] == pytest.approx(turn(step.dx, step.dy), abs=1e-9)
        x, y = world.move(x, y, STEP_M * step.dx, STEP_M * step.dy)


@pytest.mark.parametrize(
    ("kind", "wrong", "words"),
    [
        (PotentialFieldParameters, {"avoid_margin_m": 0.8}, "is not < 0.8, avoid_sphere_m"),
        (PotentialFieldParameters, {"robot_sphere_m": 0.4}, "is not < 0.4, robot_sphere_m"),
        (AvoidPastParameters, {"horizon_m": 0.02}, "less than a cell"),
        (AvoidPastParameters, {"side_m": 1.0}, "is not > twice horizon_m"),
        (AvoidPastParameters, {"mark_m": 15.0}, "is not > twice"),
        (AvoidPastParameters, {"side_m": 5000.0}, "makes 50000 cells a side, at most 4096"),
        (AvoidPastParameters, {"avoid_margin_m": 0.9}, "is not < 0.8, avoid_sphere_m"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(kind, wrong, words):
    with pytest.raises(ValidationError, match=words):
        kind(**wrong)
