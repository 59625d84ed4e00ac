"""The parts of Monte Carlo localisation, each against its formula, a tree search or plain geometry."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import cKDTree

from cosim.navigation.localization.likelihood import (
    beam_probability,
    beam_scores,
    field_addends,
    field_scores,
    grid_range,
    known_map,
    random_poses,
    surface,
)
from cosim.navigation.localization.localizer import LocalizationParameters, enough
from cosim.navigation.localization.motion import (
    MOVE,
    Motion,
    fill_uniform,
    four_normals,
    move_particles,
    odometry_motion,
    scatter_particles,
    wrapped,
)
from cosim.navigation.localization.resampling import (
    Recovery,
    clusters,
    independent,
    kld_size,
    low_variance,
    pose_bins,
)
from cosim.navigation.schemas import beam_directions
from cosim.randomness import Draws
from tests.navigation.localization.room import CELL_M, ORIGIN_M, room, room_map, scan, slab_ranges, squares

NO_BEAM = np.empty((0, 2))
KEY = Draws(6, "test").key


# ---------------------------------------------------------------- draws


def test_normal_draws_are_normal_independent_and_reproducible():
    numbers = np.array([four_normals(3, i, MOVE, *KEY) for i in range(2000)])
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(numbers.T) - np.eye(4)).max() < 5 / math.sqrt(2000)
    assert four_normals(3, 7, MOVE, *KEY) == tuple(numbers[7])
    assert four_normals(4, 7, MOVE, *KEY) != tuple(numbers[7])


def test_uniform_draws_equal_those_of_the_stream():
    numbers = np.empty(20)
    fill_uniform(numbers, 2**33 + 5, 4, *KEY)
    draws = Draws(6, "test")
    assert numbers.tolist() == [draws.uniform(2**33 + 5, i, purpose=4) for i in range(20)]


# ---------------------------------------------------------------- motion


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ((1.0, 2.0, 0.0), (2.0, 2.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 3.0), (0.0, 1.0, -3.0), (math.pi / 2 - 3.0, 1.0, 1.5 * math.pi - 3.0)),
        ((0.0, 0.0, 0.3), (0.006, 0.006, 1.0), (0.0, 0.006 * math.sqrt(2), 0.7)),  # too short for a direction
    ],
)
def test_odometry_is_a_turn_a_way_and_a_turn(before, after, expected):
    assert odometry_motion(before, after) == pytest.approx(expected)


ALPHAS = np.array([0.02, 0.01, 0.004, 0.008])


@pytest.mark.parametrize(
    ("motion", "turns"),
    [
        (Motion(0.5, 1.0, -0.8), (0.5, 0.8)),
        (Motion(math.pi - 0.2, 1.5, -math.pi), (0.2, 0.0)),  # backwards: turns count from pi
    ],
)
def test_particles_move_with_the_moments_of_the_formulas(motion, turns):
    n = 20_000
    poses = np.tile([3.0, -2.0, 1.0], (n, 1))
    move_particles(poses, *motion, ALPHAS, 9, *KEY)
    dx, dy = poses[:, 0] - 3.0, poses[:, 1] + 2.0
    first = np.remainder(np.arctan2(dy, dx) - 1.0 - motion.first_rad + np.pi, math.tau) - np.pi
    way = np.hypot(dx, dy) - motion.way_m
    second = np.remainder(poses[:, 2] - np.arctan2(dy, dx) - motion.second_rad + np.pi, math.tau) - np.pi
    a1, a2, a3, a4 = ALPHAS
    expected = (
        a1 * turns[0] ** 2 + a2 * motion.way_m**2,
        a3 * motion.way_m**2 + a4 * (turns[0] ** 2 + turns[1] ** 2),
        a1 * turns[1] ** 2 + a2 * motion.way_m**2,
    )
    for errors, variance in zip((first, way, second), expected, strict=True):
        assert abs(errors.mean()) < 5 * math.sqrt(variance / n)
        assert errors.var() == pytest.approx(variance, rel=5 * math.sqrt(2 / n))
    assert np.abs(np.corrcoef([first, way, second]) - np.eye(3)).max() < 5 / math.sqrt(n)
    assert poses[:, 2].min() >= -np.pi
    assert poses[:, 2].max() < np.pi


def test_without_noise_all_particles_move_as_odometry():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, math.pi / 2]])
    move_particles(poses, *odometry_motion((5.0, 5.0, 0.0), (6.0, 7.0, 0.5)), np.zeros(4), 1, *KEY)
    assert poses == pytest.approx(np.array([[1.0, 2.0, 0.5], [-1.0, 2.0, math.pi / 2 + 0.5]]))


def test_a_start_scatters_particles_about_the_pose():
    poses = np.empty((5000, 3))
    scatter_particles(poses, 1.0, -2.0, 3.0, np.array([0.3, 0.2]), 1, *KEY)
    off = poses - (1.0, -2.0, 3.0)
    off[:, 2] = np.remainder(off[:, 2] + np.pi, math.tau) - np.pi
    for column, sigma in zip(off.T, (0.3, 0.3, 0.2), strict=True):
        assert stats.kstest(column / sigma, "norm").pvalue > 1e-3


def test_wrapped_angles_lie_from_minus_pi_to_below_pi():
    assert wrapped(math.pi) == -math.pi
    assert wrapped(7.0) == pytest.approx(7.0 - math.tau)
    assert wrapped(np.nextafter(-math.pi, -4.0)) < math.pi


# ---------------------------------------------------------------- the map and the likelihood field


def test_distances_equal_those_of_a_tree_search():
    occupied = room()
    edge = surface(occupied)
    assert not edge[10, 42]  # inside the pillar
    assert edge[8:13, 40:46].sum() == 30 - 12
    known = room_map()
    centres = np.stack(np.meshgrid(np.arange(60), np.arange(40)), axis=2).reshape(-1, 2) * CELL_M
    distance, _ = cKDTree(centres[edge.ravel()]).query(centres)
    assert known.distance_m.ravel() == pytest.approx(distance, abs=1e-5)


def test_what_lies_at_the_edge_of_the_map_goes_on_beyond_it():
    solid = np.ones((5, 6), bool)
    assert not surface(solid).any()
    solid[2, 0] = False
    assert np.argwhere(surface(solid)).tolist() == [[1, 0], [1, 1], [2, 1], [3, 0], [3, 1]]


@pytest.mark.parametrize("radius_m", [0.0, 0.2, 0.55])
def test_standing_are_all_cells_that_a_body_can_have_its_centre_in(radius_m):
    occupied = room()
    standing = set(room_map(radius_m).standing.tolist())
    low, high = squares(occupied)
    points = np.random.default_rng(1).uniform(ORIGIN_M, np.add(ORIGIN_M, (6.0, 4.0)), (1500, 2))
    off = np.maximum(np.maximum(low - points[:, np.newaxis], points[:, np.newaxis] - high), 0.0)
    clearance = np.hypot(off[..., 0], off[..., 1]).min(axis=1)
    index = ((points - ORIGIN_M) / CELL_M).astype(int)
    inside = np.array([iy * 60 + ix in standing for ix, iy in index])
    assert inside[(clearance >= radius_m) & (clearance > 0)].all()
    assert not inside[clearance < radius_m - 1.5 * CELL_M].any()
    assert not inside[clearance == 0].any()


def test_a_map_that_nobody_can_stand_on_is_refused():
    with pytest.raises(ValueError, match="no cell is free"):
        room_map(3.0)
    with pytest.raises(ValueError, match="shapes"):
        known_map(room(), np.ones((3, 3), bool), ORIGIN_M, CELL_M)


def test_a_map_without_obstacles_has_no_finite_distance():
    empty = known_map(np.zeros((4, 5), bool), np.ones((4, 5), bool), ORIGIN_M, CELL_M, 0.3)
    assert len(empty.standing) == 20
    assert np.isinf(empty.distance_m).all()
    assert grid_range(empty.occupied, empty.distance_m, empty.frame, -0.8, 2.2, 1.0, 0.0, 8.0) == 8.0


@pytest.mark.parametrize("cubes", [True, False])
def test_field_scores_equal_the_formula_beam_by_beam(cubes):
    known = room_map()
    addends = field_addends(known.distance_m, 0.5, 0.5, 0.2, 8.0, 0.6, cubes)
    draw = np.random.default_rng(2)
    poses = np.concatenate((draw.uniform((-1, 2), (5, 6), (6, 2)), draw.uniform(-3, 3, (6, 1))), axis=1)
    ends = draw.uniform(-3, 3, (40, 2))
    scores = np.empty(6)
    field_scores(poses, ends, addends, known.frame, scores)
    iy, ix = np.nonzero(surface(room()))
    tree = cKDTree(np.stack((ix, iy), axis=1) * CELL_M)
    off_map = 0
    for (x, y, heading), score in zip(poses, scores, strict=True):
        total = 0.0
        for along, across in ends:
            column = math.floor((x + along * math.cos(heading) - across * math.sin(heading) + 1.0) / CELL_M)
            row = math.floor((y + along * math.sin(heading) + across * math.cos(heading) - 2.0) / CELL_M)
            inside = 0 <= column < 60 and 0 <= row < 40
            off_map += not inside
            d = min(tree.query((column * CELL_M, row * CELL_M))[0], 0.6) if inside else 0.6
            p = 0.5 * math.exp(-(d**2) / (2 * 0.2**2)) + 0.5 / 8.0
            total += p**3 if cubes else math.log(p)
        assert score == pytest.approx(total, rel=1e-5)
    assert off_map > 10


def test_random_poses_are_uniform_where_a_robot_can_stand():
    known = room_map()
    poses = np.empty((4000, 3))
    addends = field_addends(known.distance_m, 0.5, 0.5, 0.2, 8.0, 2.0, True)
    random_poses(poses, 1, known.standing, 60, known.frame, NO_BEAM, addends, 1, *KEY)
    place = (poses[:, :2] - ORIGIN_M) / CELL_M
    index = place.astype(int)
    cells = index[:, 1] * 60 + index[:, 0]
    assert np.isin(cells, known.standing).all()
    rank = np.searchsorted(known.standing, cells)
    assert stats.kstest((rank + 0.5) / len(known.standing), "uniform").pvalue > 1e-3
    for part in (*(place - index).T, poses[:, 2] / math.tau + 0.5):
        assert stats.kstest(part, "uniform").pvalue > 1e-3


def test_the_best_of_many_random_poses_fits_best():
    known = room_map()
    ranges = scan((0.53, 3.02, 0.7))
    ends = ranges[:, np.newaxis] * beam_directions(60)
    addends = field_addends(known.distance_m, 0.5, 0.5, 0.2, 8.0, 2.0, True)
    many, best, scores = np.empty((400, 3)), np.empty((4, 3)), np.empty(400)
    random_poses(many, 1, known.standing, 60, known.frame, ends, addends, 1, *KEY)
    random_poses(best, 100, known.standing, 60, known.frame, ends, addends, 1, *KEY)
    field_scores(many, ends, addends, known.frame, scores)
    expected = many.reshape(4, 100, 3)[np.arange(4), scores.reshape(4, 100).argmax(axis=1)]
    assert best.tolist() == expected.tolist()


# ---------------------------------------------------------------- the beam model


def test_ranges_in_the_grid_equal_those_to_the_cells_squares():
    known, occupied = room_map(), room()
    draw = np.random.default_rng(3)
    for x, y in draw.uniform(ORIGIN_M, np.add(ORIGIN_M, (6.0, 4.0)), (60, 2)):
        angle = draw.uniform(0, math.tau)
        way = np.array([math.cos(angle), math.sin(angle)])
        found = grid_range(occupied, known.distance_m, known.frame, x, y, *way, 2.5)
        assert found == pytest.approx(slab_ranges(occupied, x, y, way[np.newaxis], 2.5)[0], abs=1e-6)
    for way, expected in (((1.0, 0.0), 3.0 - 0.03), ((0.0, -1.0), 2.98 - 2.1)):  # read off the plan
        found = grid_range(occupied, known.distance_m, known.frame, 0.03, 2.98, *way, 8.0)
        assert found == pytest.approx(expected, abs=1e-6)


def test_a_beam_has_the_probability_of_its_four_causes():
    model = np.array([0.5, 0.05, 0.06, 0.4, 0.2, 0.1, 8.0])
    assert beam_probability(3.0, 3.0, model) == pytest.approx(0.5 + 0.4 / 8)
    assert beam_probability(3.3, 3.0, model) == pytest.approx(0.5 * math.exp(-0.09 / 0.08) + 0.4 / 8)
    assert beam_probability(2.0, 3.0, model) == pytest.approx(
        0.5 * math.exp(-1 / 0.08) + 0.05 * 0.1 * math.exp(-0.2) + 0.4 / 8
    )
    assert beam_probability(8.0, 8.0, model) == pytest.approx(0.5 + 0.06)


@pytest.mark.parametrize("cubes", [True, False])
def test_beam_scores_sum_over_beams_as_the_body_is_turned(cubes):
    known = room_map()
    pose, beams = (0.53, 3.02, 0.7), beam_directions(12)
    true = scan(pose, 12, 2.0)
    read = np.minimum(true + np.linspace(-0.2, 0.3, 12), 2.0)
    model, scores = np.array([0.5, 0.05, 0.06, 0.4, 0.2, 0.1, 2.0]), np.empty(1)
    beam_scores(np.array([pose]), read, beams, known.occupied, known.distance_m, known.frame, model, cubes, scores)
    p = [beam_probability(*pair, model) for pair in zip(read, true, strict=True)]
    assert scores[0] == pytest.approx(sum(q**3 for q in p) if cubes else sum(map(math.log, p)), rel=1e-4)


# ---------------------------------------------------------------- how many particles, and which


@pytest.mark.parametrize(
    ("error", "z", "sizes"),
    [(0.05, 0.99, (20, 131, 588, 1129, 5303)), (0.01, 3.0, (527, 1363, 4208, 7332, 29958))],
)
def test_kld_sizes_are_those_of_the_table(error, z, sizes):
    assert kld_size([2, 10, 50, 100, 500], error, z).tolist() == list(sizes)
    assert kld_size([0, 1], error, z).tolist() == [math.inf, math.inf]


def test_kld_sampling_stops_as_soon_as_it_has_enough():
    own = LocalizationParameters(least_particles=30, most_particles=2000)
    bins = np.arange(2000) % 50  # after 50 draws all of 50 bins are occupied
    assert enough(bins, own) == 588
    assert enough(np.zeros(2000, int), own) == 2000  # one bin asks for as many as there may be
    assert enough(np.arange(2000) % 2, own) == 30
    assert enough(np.arange(2000), own) == 2000


def test_low_variance_resampling_keeps_counts_within_one():
    draw = np.random.default_rng(4)
    for count in (7, 300, 500):
        weights = draw.exponential(size=300) ** 3
        weights[::7] = 0.0
        chosen = low_variance(weights, count, draw.random())
        expected = count * weights / weights.sum()
        times = np.bincount(chosen, minlength=300)
        assert times.sum() == count
        assert (times >= np.floor(expected - 1e-9)).all()
        assert (times <= np.ceil(expected + 1e-9)).all()


def test_low_variance_resampling_is_unbiased():
    weights = np.array([0.1, 0.25, 0.05, 0.6])
    times = sum(np.bincount(low_variance(weights, 3, (k + 0.5) / 1000), minlength=4) for k in range(1000)) / 1000
    assert times == pytest.approx(3 * weights, abs=2e-3)


def test_independent_resampling_draws_by_weight():
    weights = 2 * np.array([0.1, 0.25, 0.0, 0.05, 0.6])
    chosen = independent(weights, (np.arange(2000) + 0.5) / 2000)
    assert np.bincount(chosen, minlength=5).tolist() == [200, 500, 0, 100, 1200]
    weights = np.array([0.0, 0.25, 0.25, 0.0, 0.5])
    assert independent(weights, np.array([0.0, 0.5, 1.0 - 2.0**-53])).tolist() == [1, 4, 4]  # none without a weight


def test_bins_cut_the_plane_and_close_the_circle():
    poses = np.array(
        [[0.1, 0.1, 0.01], [0.4, 0.4, 0.1], [-0.1, 0.1, 0.01], [0.1, 0.6, 0.01], [0.1, 0.1, -0.01], [0.1, 0.1, 6.29]]
    )
    bins = pose_bins(poses, 0.5, 36)
    assert bins[0] == bins[1] == bins[5]
    assert len(np.unique(bins)) == 4


def test_clusters_are_bins_that_touch():
    chain = [(0.5 * k, -0.5 * k, 3.0 + 0.1 * k) for k in range(6)]  # over the seam of headings
    far = [(5.0, 5.0, 0.0), (5.0, 5.5, 0.2), (5.0, 5.0, 0.4), (5.0, 6.6, 0.2)]
    poses = np.add(chain + far, (0.01, 0.01, 0.001))
    label = clusters(pose_bins(poses, 0.5, 36), 36)
    assert len(set(label[:6])) == 1
    assert len(set(label[6:9])) == 1
    assert len({label[0], label[6], label[9]}) == 3


def test_clusters_equal_a_plain_flood():
    poses = np.random.default_rng(5).uniform((0, 0, -np.pi), (4, 4, np.pi), (60, 3))
    cells = [(int(x // 0.5), int(y // 0.5), int(h // (math.tau / 12)) % 12) for x, y, h in poses]
    label = clusters(pose_bins(poses, 0.5, 12), 12)

    def touch(a, b):
        return max(abs(a[0] - b[0]), abs(a[1] - b[1]), min((a[2] - b[2]) % 12, (b[2] - a[2]) % 12)) <= 1

    group = list(range(60))
    for _ in range(60):
        for i in range(60):
            group[i] = min(group[j] for j in range(60) if touch(cells[i], cells[j]))
    same = np.equal.outer(group, group)
    assert (np.equal.outer(label, label) == same).all()
    assert 1 < len(set(group)) < 60


def test_recovery_averages_are_plain_means_first_and_forget_by_their_rates_then():
    recovery = Recovery(0.1, 0.5)
    assert recovery.probability == 0.0
    fits = np.random.default_rng(7).uniform(0.1, 1.0, 14)
    for fit in fits:
        recovery.note(fit)
    slow, fast = fits[:10].mean(), fits[:2].mean()
    for fit in fits[10:]:
        slow = 0.9 * slow + 0.1 * fit
    for fit in fits[2:]:
        fast = 0.5 * fast + 0.5 * fit
    assert recovery.slow == pytest.approx(slow)
    assert recovery.fast == pytest.approx(fast)
    recovery.note(0.01)
    assert recovery.probability == pytest.approx(1 - (0.5 * fast + 0.005) / (0.9 * slow + 0.001))
    recovery.note(9.0)
    assert recovery.probability == 0.0
    recovery.restart()
    assert recovery == Recovery(0.1, 0.5)


def test_without_rates_there_is_no_recovery():
    recovery = Recovery(0.0, 0.0)
    for fit in (1.0, 0.1, 0.01):
        recovery.note(fit)
        assert recovery.probability == 0.0
