"""Motor schemas against closed forms: one obstacle, walls as integrals over the directions, the noise's draws."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from cosim.navigation.schemas import (
    OVERWHELMING,
    avoid_obstacles,
    avoid_robots,
    beam_directions,
    clipped,
    direction,
    move_to_goal,
    noise,
    potential_field,
    repulsion,
    speed_and_turn,
)
from cosim.randomness import Draws

S, M = 0.8, 0.3


def test_repulsion_starts_from_nothing_at_the_sphere_and_reaches_one_at_the_margin():
    assert repulsion(S, S, M) == 0.0
    assert repulsion(S - 1e-9, S, M) == pytest.approx(0.0, abs=1e-8)
    assert repulsion(M + 1e-9, S, M) == pytest.approx(1.0, abs=1e-8)
    assert repulsion((S + M) / 2, S, M) == pytest.approx(0.5)
    assert repulsion(10.0, S, M) == 0.0


def test_within_the_margin_repulsion_overwhelms():
    assert repulsion(M, S, M) == OVERWHELMING
    assert repulsion(0.0, S, M) == OVERWHELMING
    assert math.pi / 32 * OVERWHELMING > 100, "also one beam of many"


@pytest.mark.parametrize("beam", range(8))
def test_a_single_obstacle_pushes_straight_away_from_it(beam):
    ranges = np.full(8, math.inf)
    ranges[beam] = 0.5
    angle = 2 * math.pi * beam / 8 + math.pi
    push = avoid_obstacles(ranges, beam_directions(8), S, M)
    strength = math.pi / 8 * (0.8 - 0.5) / (0.8 - 0.3)
    assert push == pytest.approx((strength * math.cos(angle), strength * math.sin(angle)), abs=1e-12)


@pytest.mark.parametrize("sphere", [0.8, 1.5])
@pytest.mark.parametrize("count", [32, 128, 1024])
def test_a_long_wall_repels_by_an_integral_that_no_number_of_beams_changes(count, sphere):
    # a wall at the distance z along x: the integral over the angle a of (S - z / cos a) / (S - M) cos a, halved twice
    z = 0.4
    cosines = beam_directions(count)[:, 0]
    ranges = np.divide(z, cosines, out=np.full(count, math.inf), where=cosines > 1e-6)
    edge = math.acos(z / sphere)
    expected = (sphere * math.sin(edge) - z * edge) / (sphere - M)
    push = avoid_obstacles(ranges, beam_directions(count), sphere, M)
    # the sum is a Riemann sum of an integrand with a kink at each edge: an error of the order of the squared spacing
    assert push == pytest.approx((-expected, 0.0), abs=1.5 * (2 * math.pi / count) ** 2)


def test_a_half_ring_just_outside_the_margin_repels_with_one():
    beams = beam_directions(2002)  # none along y, where rounding would decide
    ranges = np.where(beams[:, 0] > 0.0, M + 1e-9, math.inf)
    assert avoid_obstacles(ranges, beams, S, M) == pytest.approx((-1.0, 0.0), abs=1e-5)


@pytest.mark.parametrize("ranges", [[math.inf] * 6, [math.nan] * 6, []])
def test_a_scan_that_has_hit_nothing_does_not_push(ranges):
    assert avoid_obstacles(np.array(ranges), beam_directions(len(ranges)), S, M) == (0.0, 0.0)


def test_a_beam_of_infinite_range_among_others_changes_nothing():
    ranges = np.array([0.5, math.inf, math.nan, 0.6])
    push = avoid_obstacles(ranges, beam_directions(4), S, M)
    assert push == pytest.approx((-math.pi / 4 * 0.6, math.pi / 4 * 0.4), abs=1e-12)


def test_the_goal_attracts_with_one_from_everywhere_but_the_goal():
    assert move_to_goal(3.0, -4.0) == pytest.approx((0.6, -0.8))
    assert move_to_goal(3e-9, -4e-9) == pytest.approx((0.6, -0.8))
    assert move_to_goal(0.0, 0.0) == (0.0, 0.0)


def test_robots_repel_along_the_line_between_centres():
    # 0.5 m off: (1.0 - 0.5) / (1.0 - 0.2); the ones that are 1 m and 2 m off do nothing
    push = avoid_robots(1.0, 2.0, [(1.3, 2.4), (2.0, 2.0), (3.0, 2.0)], 1.0, 0.2)
    assert push == pytest.approx((-0.6 * 0.625, -0.8 * 0.625))


def test_repulsions_of_several_robots_add_up():
    one, two, both = (
        avoid_robots(0.0, 0.0, robots, 1.0, 0.2) for robots in ([(0.5, 0.1)], [(-0.2, 0.6)], [(0.5, 0.1), (-0.2, 0.6)])
    )
    assert both == pytest.approx((one[0] + two[0], one[1] + two[1]))


def test_a_robot_within_the_margin_repels_with_all_force_and_one_at_the_same_place_along_y():
    assert avoid_robots(0.0, 0.0, [(0.2, 0.0)], 1.0, 0.2) == (-OVERWHELMING, 0.0)
    assert avoid_robots(0.0, 0.0, [(0.0, 0.0)], 1.0, 0.2) == (0.0, OVERWHELMING)


def test_noise_is_held_for_its_persistence_and_then_drawn_anew():
    drawn = [noise(Draws(1, "noise"), step, 10) for step in range(100)]
    blocks = [drawn[k : k + 10] for k in range(0, 100, 10)]
    assert all(len(set(block)) == 1 for block in blocks)
    assert len({block[0] for block in blocks}) > 5


def test_noise_of_a_step_depends_on_stream_step_and_purpose_only():
    draws = Draws(1, "noise", "r1")
    forward = [noise(draws, step, 3) for step in range(30)]
    backward = [noise(Draws(1, "noise", "r1"), step, 3) for step in reversed(range(30))]
    assert forward == backward[::-1]
    assert forward != [noise(Draws(1, "noise", "r2"), step, 3) for step in range(30)]
    assert forward != [noise(draws, step, 3, 1) for step in range(30)]


def test_noise_has_unit_length_and_whole_degrees_all_equally_likely():
    draws = Draws(3, "noise")
    drawn = np.array([noise(draws, step, 1) for step in range(20 * 360)])
    assert np.hypot(*drawn.T) == pytest.approx(1.0)
    degrees = np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0])) % 360
    whole = np.round(degrees).astype(int) % 360
    assert np.abs(np.exp(1j * np.radians(degrees)) - np.exp(1j * np.radians(whole))).max() < 1e-12
    counts = Counter(whole.tolist())
    assert len(counts) == 360
    assert stats.chisquare([counts[degree] for degree in range(360)]).pvalue > 1e-3


def test_the_field_is_the_weighted_sum_of_its_schemas():
    ranges = np.random.default_rng(2).uniform(0.2, 1.5, 32)
    wall = avoid_obstacles(ranges, beam_directions(32), 1.1, 0.25)
    field = np.array([0.7, 1.9, 1.1, 0.25])
    total = potential_field(ranges, beam_directions(32), field, -1.0, 1.0, 0.3, -0.4)
    half = math.sqrt(0.5)
    assert total == pytest.approx((0.3 - 0.7 * half + 1.9 * wall[0], -0.4 + 0.7 * half + 1.9 * wall[1]))


# ---------------------------------------------------------------- motions


@pytest.mark.parametrize("length", [1e-6, 0.3, 1.0, 7.0, 1e5])
def test_in_steps_of_one_length_only_the_direction_counts(length):
    assert direction(-0.6 * length, 0.8 * length) == pytest.approx((-0.6, 0.8))


@pytest.mark.parametrize("vector", [(0.0, 0.0), (1e-12, -1e-12), (math.nan, 1.0), (math.inf, 0.0)])
def test_a_sum_without_a_direction_lets_the_robot_stay(vector):
    assert direction(*vector) == (0.0, 0.0)
    assert clipped(*vector) == (0.0, 0.0)


def test_a_velocity_shrinks_with_the_sum_and_is_clipped_above_one():
    assert clipped(0.3, -0.4) == (0.3, -0.4)
    assert clipped(3e5, -4e5) == pytest.approx((0.6, -0.8))
    assert math.hypot(*clipped(1.0, 1.0)) == pytest.approx(1.0)


def test_speed_follows_the_vector_and_turns_stay_under_the_limit():
    assert speed_and_turn(0.0, 1.0, math.pi / 2, 0.5, 2.0, 0.1) == pytest.approx((0.5, 0.0))
    assert speed_and_turn(0.0, 0.4, math.pi / 2, 0.5, 2.0, 0.1) == pytest.approx((0.2, 0.0))
    assert speed_and_turn(0.0, 9.0, math.pi / 2, 0.5, 2.0, 0.1) == pytest.approx((0.5, 0.0)), "longer than 1"
    assert speed_and_turn(0.0, 1.0, 0.0, 0.5, 2.0, 0.1)[1] == 2.0, "to the left"
    assert speed_and_turn(0.0, -1.0, 0.0, 0.5, 2.0, 0.1)[1] == -2.0, "to the right"
    assert speed_and_turn(0.0, 0.0, 1.0, 0.5, 2.0, 0.1) == (0.0, 0.0)


def test_a_robot_turns_no_farther_than_to_its_way_and_the_short_way_round():
    _, turn = speed_and_turn(math.cos(0.1), math.sin(0.1), 0.0, 0.5, 2.0, 0.1)
    assert turn * 0.1 == pytest.approx(0.1)
    _, turn = speed_and_turn(math.cos(-3.1), math.sin(-3.1), 3.1, 0.5, 2.0, 0.1)
    assert turn * 0.1 == pytest.approx(2 * math.pi - 6.2)


def test_a_robot_stands_while_it_turns_by_more_than_a_right_angle():
    assert speed_and_turn(-1.0, 0.3, 0.0, 0.5, 2.0, 0.1)[0] == 0.0
    assert speed_and_turn(1.0, math.sqrt(3), 0.0, 0.5, 2.0, 0.1)[0] == pytest.approx(0.25), "cosine of 60 degrees"
