"""VFH+: histograms and choices against the paper's equations in plain Python, and what it reports and remembers."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.navigation.status import Status
from cosim.navigation.vfh import (
    BINARY,
    MASKED,
    NO_DIRECTION,
    PRIMARY,
    Vfh,
    VfhParameters,
    add_reading,
    best_candidate,
    mask_histogram,
    turn_limit,
    update_binary,
    vfh_numbers,
)

OPEN = (math.inf,) * 32
EAST = (50.0, 0.0)


def scan_of(beams=32, **hits):
    """Return a scan that hits what is named: beam_3=0.7."""
    scan = [math.inf] * beams
    for name, distance in hits.items():
        scan[int(name.removeprefix("beam_"))] = distance
    return tuple(scan)


# ---------------------------------------------------------------- the paper in plain Python


class Paper:
    """Equations 2 to 11 of the paper, sector by sector, for the readings of a scan."""

    def __init__(self, own):
        self.own = own
        self.count = own.sectors
        self.alpha = 360 / own.sectors
        self.binary = [0] * own.sectors
        self.heading = self.previous = None  # degrees

    def choose(self, ranges, goal, goal_m):
        """Return primary, binary and masked histogram and the direction in degrees, or None."""
        own = self.own
        window = min(own.window_m, goal_m + own.reach_m)
        cells = [(d, 360 * k / len(ranges)) for k, d in enumerate(ranges) if d <= window]
        primary = [sum(self.enlarged(k, *cell) for cell in cells) for k in range(self.count)]
        for k, value in enumerate(primary):
            if value > own.high_threshold:
                self.binary[k] = 1
            if value < own.low_threshold:
                self.binary[k] = 0
        masked = self.masked(cells)
        costs = {c: self.cost(c, goal) for c in self.candidates(masked, goal)}
        self.previous = min(costs, key=costs.get) % 360 if costs else self.previous
        return primary, list(self.binary), masked, self.previous if costs else None

    def enlarged(self, k, d, beta):
        own = self.own
        b = (own.near_magnitude - 1) / own.window_m**2
        gamma = math.degrees(math.asin(own.reach_m / d)) if d > own.reach_m else 90
        return own.near_magnitude - b * d * d if apart(k * self.alpha, beta) <= gamma + 1e-7 else 0

    def masked(self, cells):
        turn = self.own.turning_radius_m
        if not turn or self.heading is None:
            return list(self.binary)
        theta, right, left = math.radians(self.heading), 180, 180
        for d, beta in cells:
            x, y = d * math.cos(math.radians(beta)), d * math.sin(math.radians(beta))
            off = (beta - self.heading + 180) % 360 - 180
            to_right = math.dist((x, y), (turn * math.sin(theta), -turn * math.cos(theta)))
            to_left = math.dist((x, y), (-turn * math.sin(theta), turn * math.cos(theta)))
            if off <= 0 and to_right < turn + self.own.reach_m:
                right = min(right, -off)
            if off >= 0 and to_left < turn + self.own.reach_m:
                left = min(left, off)
        offs = [(k * self.alpha - self.heading + 180) % 360 - 180 for k in range(self.count)]
        return [
            int(block or not -right - 1e-7 <= off <= left + 1e-7) for block, off in zip(self.binary, offs, strict=True)
        ]

    def candidates(self, masked, goal):
        if not any(masked):
            return [goal]
        found = []
        n, most = self.count, self.own.wide_sectors
        for k_right in range(n):
            if masked[k_right] or not masked[k_right - 1]:
                continue
            k_left = k_right
            while not masked[(k_left + 1) % n]:
                k_left += 1
            if k_left - k_right <= most:
                found.append((k_right + k_left) / 2 * self.alpha)
                continue
            c_right, c_left = (k_right + most / 2) * self.alpha, (k_left - most / 2) * self.alpha
            found += [c_right, c_left]
            found += [g for g in (goal - 360, goal, goal + 360, goal + 720) if c_right <= g <= c_left]
        return found

    def cost(self, c, goal):
        own = self.own
        cost = own.goal_weight * apart(c, goal)
        cost += 0 if self.heading is None else own.heading_weight * apart(c, self.heading)
        return cost + (0 if self.previous is None else own.previous_weight * apart(c, self.previous))


def apart(one, two):
    """Return the angle between two directions, all in degrees."""
    return abs((one - two + 180) % 360 - 180)


@pytest.mark.slow
@pytest.mark.parametrize("turning_radius_m", [0.0, 0.6])
@pytest.mark.parametrize("shape", [{}, {"sectors": 120, "wide_sectors": 25, "low_threshold": 1.5, "window_m": 2.2}])
@pytest.mark.parametrize("seed", range(5))
def test_histograms_and_choices_are_those_of_the_paper(seed, shape, turning_radius_m):
    own = VfhParameters(turning_radius_m=turning_radius_m, **shape)
    navigator, paper = Vfh(own), Paper(own)
    draw = np.random.default_rng(seed)
    x, y, chosen = 0.0, 0.0, 0
    ranges = np.where(draw.random(32) < 0.3, draw.uniform(0.3, 2, 32), 4)
    for step in range(40):
        ranges = np.clip(ranges + draw.normal(0, 0.1, 32), 0.1, 4)
        ranges[draw.random(32) < 0.02] = draw.choice([0.2, 0.9, 1.1])
        ranges[draw.random(32) < 0.06] = draw.choice([3, math.inf, math.nan])
        goal_m, goal = draw.uniform(0.2, 3), draw.uniform(-180, 180)
        place = (x + goal_m * math.cos(math.radians(goal)), y + goal_m * math.sin(math.radians(goal)))
        primary, binary, masked, direction = paper.choose(ranges.tolist(), goal % 360, goal_m)
        dx, dy, status = navigator.steer(x, y, place, ranges)
        assert navigator.histograms[PRIMARY] == pytest.approx(primary, abs=1e-9), step
        assert navigator.histograms[BINARY].tolist() == binary, step
        assert navigator.histograms[MASKED].tolist() == masked, step
        if direction is None:
            assert (dx, dy, status) == (0.0, 0.0, Status.STUCK)
        else:
            assert apart(math.degrees(math.atan2(dy, dx)), direction) < 1e-6, step
            chosen += 1
        way = direction if direction is not None and draw.random() < 0.7 else draw.uniform(-180, 180)
        paper.heading = way  # it may be carried off its way
        x, y = x + 0.1 * math.cos(math.radians(way)), y + 0.1 * math.sin(math.radians(way))
    assert chosen > 10


# ---------------------------------------------------------------- stage 1: the primary histogram


def primary_of(distance_m, angle_rad=0.0, **parameters):
    primary = np.zeros(parameters.get("sectors", 72))
    add_reading(distance_m, angle_rad, vfh_numbers(VfhParameters(**parameters)), primary)
    return primary


def test_a_reading_weighs_a_at_the_robot_and_1_at_the_edge_of_the_window():
    assert primary_of(0.0, near_magnitude=7).max() == 7
    assert primary_of(1.5).max() == pytest.approx(1)
    assert primary_of(0.75).max() == pytest.approx(10 - 9 / 4)
    assert not primary_of(1.5001).any()
    assert not primary_of(math.inf).any()
    assert not primary_of(math.nan).any()


def test_a_reading_is_enlarged_by_the_radius_and_the_safety_distance():
    wide = {"robot_radius_m": 0.4, "safety_m": 0.1}
    assert np.flatnonzero(primary_of(1.0, **wide)).tolist() == [*range(7), *range(66, 72)], "30 degrees, with the ends"
    assert np.flatnonzero(primary_of(1.01, **wide)).tolist() == [*range(6), *range(67, 72)]
    assert np.flatnonzero(primary_of(1.0, math.pi, **wide)).tolist() == list(range(30, 43))
    assert np.flatnonzero(primary_of(0.5, **wide)).tolist() == [*range(19), *range(54, 72)], "a half plane"
    assert np.flatnonzero(primary_of(0.3, **wide)).tolist() == [*range(19), *range(54, 72)]


def test_readings_of_a_wall_leave_no_gap_between_them():
    # 32 beams on a wall all around at the window's edge: 0.29 m from reading to reading, enlarged by 0.35 m
    navigator = Vfh(VfhParameters())
    navigator.steer(0, 0, EAST, (1.5,) * 32)
    assert (navigator.histograms[PRIMARY] > 0.99).all()


# ---------------------------------------------------------------- stage 2: hysteresis


def test_between_the_thresholds_a_sector_stays_as_it_is():
    binary = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    update_binary(np.array([3.9, 3.9, 4.0, 4.0, 6.0, 6.0, 6.1, 6.1]), 4.0, 6.0, binary)
    assert binary.tolist() == [0, 0, 0, 1, 0, 1, 1, 1]


def test_an_obstacle_blocks_when_it_comes_nearer_than_where_it_ceases_to():
    navigator = Vfh(VfhParameters())
    blocked = []
    for step, distance in enumerate((1.3, 1.1, 0.95, 1.1, 1.19, 1.25, 1.1)):
        navigator.steer(0.1 * step, 0, EAST, scan_of(beam_0=distance))
        blocked.append(bool(navigator.histograms[BINARY, 0]))
    assert blocked == [False, False, True, True, True, False, False]


# ---------------------------------------------------------------- stage 3: the mask


def test_an_obstacle_beside_the_heading_ends_the_turn_to_its_side_only():
    own = vfh_numbers(VfhParameters(turning_radius_m=0.5))
    # 0.6 m to the side: 0.1 m from the middle of the turn to that side
    assert turn_limit(0.6, math.pi / 2, own, math.pi) == math.pi / 2
    assert turn_limit(0.6, math.pi / 2, own, 1.0) == 1.0, "a nearer one has ended it before"
    assert turn_limit(1.34, math.pi / 2, own, math.pi) == math.pi / 2
    assert turn_limit(1.36, math.pi / 2, own, math.pi) == math.pi, "0.86 m from the middle is beyond 0.5 + 0.35"
    assert turn_limit(1.51, 1.2, vfh_numbers(VfhParameters(turning_radius_m=2)), math.pi) == math.pi, "off the window"


def test_the_mask_blocks_what_lies_beyond_the_limits():
    masked = np.zeros(8)
    mask_histogram(np.array([0.0, 0, 0, 1, 0, 0, 0, 0]), math.pi / 2, math.pi / 4, math.pi, masked)
    assert masked.tolist() == [1, 0, 0, 1, 0, 0, 1, 1]  # sector 6 is half a turn off: to the right


def test_a_robot_that_turns_at_once_is_not_masked():
    post = scan_of(beam_28=0.7)  # half right, ahead
    ways = []
    for turning_radius_m in (0.0, 0.5):
        navigator = Vfh(VfhParameters(turning_radius_m=turning_radius_m))
        navigator.steer(-0.1, 0, (0, -9), OPEN)
        dx, dy, _ = navigator.steer(0, 0, (0, -9), post)
        ways.append(math.degrees(math.atan2(dy, dx)))
        assert navigator.histograms[MASKED, 54] == (turning_radius_m > 0), "to the right, beyond the post"
    assert ways[0] == pytest.approx(-120), "-80 is free, and s_max / 2 from there"
    assert ways[1] > -45


def test_without_a_heading_nothing_is_masked():
    navigator = Vfh(VfhParameters(turning_radius_m=0.5))
    navigator.steer(0, 0, EAST, scan_of(beam_28=0.7))
    assert (navigator.histograms[MASKED] == navigator.histograms[BINARY]).all()


# ---------------------------------------------------------------- stage 4: candidates


def choice(free, goal, heading=NO_DIRECTION, previous=NO_DIRECTION, **parameters):
    """Return the best candidate where the sectors *free* (first, last) of 72 are."""
    masked = np.ones(72)
    for first, last in free:
        masked[np.arange(first, last + 1) % 72] = 0
    return best_candidate(
        masked, float(goal), float(heading), float(previous), vfh_numbers(VfhParameters(**parameters))
    )


def test_a_narrow_opening_is_passed_in_its_middle():
    assert choice([(10, 20)], 11) == 15
    assert choice([(10, 15)], 40) == 12.5
    assert choice([(68, 75)], 0) == 71.5
    assert choice([(5, 5)], 30) == 5
    assert choice([(10, 26)], 11) == 18, "s_max sectors from border to border: both rules agree"


def test_a_wide_opening_is_passed_along_its_borders_or_straight_to_the_goal():
    assert choice([(10, 40)], 0) == 18
    assert choice([(10, 40)], 50) == 32
    assert choice([(10, 40)], 18.3) == 18.3
    assert choice([(10, 40)], 17.9) == 18
    assert choice([(60, 90)], 5.5) == 5.5
    assert choice([(60, 90)], 72.0) == 0
    assert choice([(10, 40)], 11, wide_sectors=4) == 12


def test_of_two_openings_the_one_of_less_cost_is_taken():
    openings = [(10, 12), (20, 22)]
    assert choice(openings, 15) == 11
    assert choice(openings, 17) == 21
    assert choice(openings, 13, heading=21) == 11, "5 x 2 + 2 x 10 = 30, and 5 x 8 = 40"
    assert choice(openings, 15.5, heading=21) == 21, "5 x 4.5 + 2 x 10 = 42.5, and 5 x 5.5 = 27.5"
    assert choice(openings, 15.5, previous=21) == 21
    assert choice(openings, 15.5, previous=21, previous_weight=0) == 11
    assert choice(openings, 16.5, heading=21, previous=11) == 21
    assert choice(openings, 16.5, heading=21, previous=11, previous_weight=2.9) == 11


def test_without_obstacles_the_goal_is_the_direction_and_where_all_is_blocked_there_is_none():
    assert choice([(0, 71)], 33.3, heading=3) == 33.3
    assert choice([(0, 71)], -1.5) == 70.5
    assert math.isnan(choice([], 33.3))
    assert choice([(1, 71)], 36) == 36, "one blocked sector leaves one opening"


def test_of_equal_candidates_the_right_one_is_taken():
    assert choice([(10, 12), (20, 22)], 16) == 11
    assert choice([(66, 68), (76, 78)], 0) == 67
    assert choice([(30, 32), (40, 42)], 36, heading=36, previous=36) == 31


def test_the_weights_let_the_robot_turn_to_the_goal_in_the_end():
    for weights in ((4.0, 2.0, 2.0), (5.0, 5.0, 0.0), (5.0, 2.0, 3.5)):
        with pytest.raises(ValidationError, match=r"is not > .*, heading_weight \+ previous_weight"):
            VfhParameters(**dict(zip(("goal_weight", "heading_weight", "previous_weight"), weights, strict=True)))
    assert VfhParameters(goal_weight=4.01).goal_weight == 4.01


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"low_threshold": 6.1}, "is not >= 6.1, low_threshold"),
        ({"high_threshold": 10.0}, "and < 10.0, near_magnitude"),
        ({"window_m": 0.35}, "is not > 0.35, robot_radius_m"),
        ({"wide_sectors": 72}, "is not < 72, sectors"),
    ],
)
def test_numbers_that_contradict_each_other_are_errors(wrong, message):
    with pytest.raises(ValidationError, match=message):
        VfhParameters(**wrong)


# ---------------------------------------------------------------- what is reported and remembered


def test_where_all_directions_are_blocked_the_robot_stays_and_is_stuck_until_a_way_opens():
    navigator = Vfh(VfhParameters())
    assert navigator.steer(0, 0, EAST, (0.6,) * 32) == (0.0, 0.0, Status.STUCK)
    opened = (0.6,) * 20 + (math.inf,) * 12
    dx, dy, status = navigator.steer(0, 0, EAST, opened)
    assert status is Status.UNDERWAY
    assert math.hypot(dx, dy) == pytest.approx(1)
    assert dy < -0.5


def test_stuck_is_reported_when_progress_stops_and_taken_back_when_it_goes_on():
    navigator = Vfh(VfhParameters(patience=5))
    assert navigator.steer(0.0, 0.0, (9.0, 0.0), OPEN).status is Status.UNDERWAY
    wobble = [navigator.steer(0.05 * (k % 2), 0.01 * k, (9.0, 0.0), OPEN).status for k in range(6)]
    assert wobble == [Status.UNDERWAY] * 4 + [Status.STUCK] * 2
    assert navigator.steer(0.2, 0.0, (9.0, 0.0), OPEN).status is Status.UNDERWAY


def test_at_the_goal_the_robot_stays():
    assert Vfh(VfhParameters()).steer(1.0, 2.0, (1.07, 2.07), OPEN) == (0.0, 0.0, Status.ARRIVED)
    assert Vfh(VfhParameters()).steer(1.0, 2.0, (1.08, 2.07), OPEN).status is Status.UNDERWAY


def test_who_has_begun_to_pass_on_one_side_goes_on_there():
    ahead = scan_of(beam_31=0.7, beam_0=0.7, beam_1=0.7)
    ways = []
    for y in (1.0, -1.0):
        navigator = Vfh(VfhParameters())
        navigator.steer(0, 0, (0, 50 * y), OPEN)
        _, dy, _ = navigator.steer(0, 0, EAST, ahead)
        ways.append(dy)
    assert ways[0] > 0 > ways[1]


def test_a_restart_forgets_the_progress_and_the_choice_but_no_obstacle():
    navigator = Vfh(VfhParameters(patience=3))
    ahead = scan_of(beam_31=0.7, beam_0=0.7, beam_1=0.7)
    statuses = [navigator.steer(0, 0, (0, 50), scan_of(beam_16=0.95)).status]
    statuses += [navigator.steer(0.1 * k, 0, (0, 50), scan_of(beam_16=1.1)).status for k in (1, 2, 3)]
    assert statuses == [Status.UNDERWAY] * 3 + [Status.STUCK]
    navigator.restart()
    first = navigator.steer(0.4, 0, EAST, tuple(map(min, ahead, scan_of(beam_16=1.1))))
    assert first.status is Status.UNDERWAY
    assert first.dy < 0, "not up, where it was going"
    assert navigator.histograms[BINARY, 36] == 1, "still blocked, by the hysteresis"


def test_tuples_arrays_and_scans_of_any_length_are_taken():
    tuples, arrays = Vfh(VfhParameters()), Vfh(VfhParameters())
    for step, beams in enumerate((8, 32, 64, 0, 16)):
        scan = tuple(0.4 + 0.5 * (k % 5) for k in range(beams))
        taken = tuples.steer(0.1 * step, 0, EAST, scan)
        assert taken == arrays.steer(0.1 * step, 0, EAST, np.array(scan))
        assert (tuples.histograms[PRIMARY].max() > 0) == (beams > 0)


def test_a_bump_is_forgotten_after_some_steps():
    navigator = Vfh(VfhParameters(bump_steps=5))
    ways = [navigator.steer(0, 0, EAST, OPEN)[:2] for _ in range(4)]
    assert ways[:3] == [(1.0, 0.0)] * 3
    assert ways[3][0] < 1e-9, "the half plane ahead is blocked"
    ways = [navigator.steer(0.1 * (k % 2), 0, EAST, OPEN)[0] for k in range(1, 6)]
    assert max(ways[:4]) < 0.8
    assert ways[4] == 1.0
