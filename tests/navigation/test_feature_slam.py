"""SLAM by features: against a batch solution, against what is unobservable, and whether it knows how wrong it is."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from cosim.navigation.feature_slam import (
    FeatureSlam,
    FeatureSlamParameters,
    Measured,
    Way,
    _placed,
    associated,
    begun,
    cholesky,
    corrected,
    correction,
    expected,
    forward,
    further,
    grown,
    measured,
    moved,
    product,
    widened,
)
from cosim.navigation.features import extract
from cosim.navigation.schemas import beam_directions
from tests.navigation.feature_scene import BEAMS, ROOMS, ROUND, SLIP, TURN_RAD, driven, nees, odometry, ring, ticks
from tests.tiers import soak_count

RING = beam_directions(BEAMS)
SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)])
"""Corners of a room."""
SIDES = [(0.0, 4.0), (math.pi / 2, 3.0), (math.pi, 0.0), (-math.pi / 2, 0.0)]
"""Alpha and r of its walls, about the origin."""


def turned(angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def of_the_room(pose, draw=None):
    """Return its four walls and four corners as measured from *pose*, each with an error of its own."""
    values = [(math.remainder(a - pose[2], math.tau), r - pose[:2] @ (math.cos(a), math.sin(a))) for a, r in SIDES]
    values = np.array([*values, *((SQUARE - pose[:2]) @ turned(pose[2]))])
    blocks = np.array([[[1e-5, 5e-6], [5e-6, 4e-5]]] * 4 + [[[2e-4, 5e-5], [5e-5, 1e-4]]] * 4)
    covariance = np.zeros((16, 16))
    for k, block in enumerate(blocks):
        covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
        if draw is not None:
            values[k] += np.linalg.cholesky(block) @ draw.normal(size=2)
    feet = np.array([(r * math.cos(a), r * math.sin(a)) for a, r in values[:4]])
    along = np.array([(-math.sin(a), math.cos(a)) for a, _ in values[:4]])
    ends = np.concatenate((np.stack((feet + 0.2 * along, feet + along), axis=1), np.zeros((4, 2, 2))))
    facing = np.array([0.0] * 4 + [math.pi / 4, 3 * math.pi / 4, -3 * math.pi / 4, -math.pi / 4]) - pose[2]
    return Measured(values, np.arange(8) < 4, covariance, ends, facing)


def ways(poses, draw=None):
    """Return what odometry tells between *poses* (n, 3): ways of 20 ticks each."""
    found = []
    for before, now in itertools.pairwise(poses):
        share = np.linspace(0.0, 1.0, 21)[:, None]
        path = before + share * (now - before)
        told = path if draw is None else odometry(path, draw)
        relative = np.column_stack(((told[:, :2] - told[0, :2]) @ turned(told[0, 2]), told[:, 2] - told[0, 2]))
        way = Way()
        for x, y, turn in relative[1:].tolist():
            way = further(way, x, y, turn, SLIP, TURN_RAD)
        found.append(way)
    return found


AROUND = np.array(
    [
        (1, 1, 0.2),
        (1.6, 1.2, 0.4),
        (2.4, 1.5, 0.9),
        (2.6, 2.1, 2.0),
        (2, 2.3, 3.0),
        (1.3, 2, 3.6),
        (1, 1.4, 4.6),
        (1.2, 0.8, 5.9),
    ]
)


def run_known(poses, told, scans, first_estimates=True, start=0.0):
    """Return the belief of a filter that is told which feature is which landmark; *start* is its first covariance."""
    everything, belief = np.arange(8), begun(tuple(poses[0]))
    belief.covariance[:] = start
    belief = grown(belief, scans[0], None, (everything[:0], everything[:0]), everything, 0)
    for way, seen in zip(told, scans[1:], strict=True):
        belief = moved(belief, way)
        pairs = everything, everything
        said = correction(belief, seen, *expected(belief, first_estimates), pairs)
        belief = corrected(belief, said, pairs, 1, first_estimates)
    return belief


def batch(poses, told, scans, anchors):
    """Return the last pose and landmarks of least squares over all poses at once, and their covariance.

    Walls are relative to *anchors* (8, 2) as the filter's are, so that both can be compared; all else is written anew.
    """
    count = len(told)
    odometers = [np.linalg.inv(np.linalg.cholesky(way.covariance + 1e-12 * np.eye(3))) for way in told]
    scanners = [np.linalg.inv(np.linalg.cholesky(seen.covariance)) for seen in scans]

    def residuals(unknown):
        every = np.concatenate(([poses[0]], unknown[: 3 * count].reshape(-1, 3)))
        landmarks = unknown[3 * count :].reshape(-1, 2)
        out = []
        for k, way in enumerate(told):
            relative = turned(every[k, 2]).T @ (every[k + 1, :2] - every[k, :2])
            off = (
                *(relative - (way.x_m, way.y_m)),
                math.remainder(every[k + 1, 2] - every[k, 2] - way.turn_rad, math.tau),
            )
            out.append(odometers[k] @ off)
        for pose, seen, scanner in zip(every, scans, scanners, strict=True):
            off = np.empty((len(seen.values), 2))
            for k, (a, b) in enumerate(landmarks[: len(off)]):
                if k < 4:
                    r = b - (pose[:2] - anchors[k]) @ (math.cos(a), math.sin(a))
                    off[k] = math.remainder(seen.values[k, 0] - a + pose[2], math.tau), seen.values[k, 1] - r
                else:
                    off[k] = seen.values[k] - turned(pose[2]).T @ ((a, b) - pose[:2])
            out.append(scanner @ off.ravel())
        return np.concatenate(out)

    walls = [(a, r - anchors[k] @ (math.cos(a), math.sin(a))) for k, (a, r) in enumerate(SIDES)]
    begin = np.concatenate((np.array(poses[1:]).ravel(), np.ravel(walls), SQUARE.ravel()))
    found = least_squares(residuals, begin, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    covariance = np.linalg.inv(found.jac.T @ found.jac)[3 * (count - 1) :, 3 * (count - 1) :]
    return found.x[3 * (count - 1) :], covariance


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("first_estimates", [True, False])
def test_the_filter_agrees_with_a_batch_solution(seed, first_estimates):
    draw = np.random.default_rng(seed)
    told, scans = ways(AROUND, draw), [of_the_room(pose, draw) for pose in AROUND]
    belief = run_known(AROUND, told, scans, first_estimates)
    found, covariance = batch(AROUND, told, scans, belief.anchors_m)
    off = belief.mean - found
    angles = [2, 3, 5, 7, 9]
    off[angles] -= math.tau * np.rint(off[angles] / math.tau)
    spread = np.sqrt(np.diag(covariance))
    assert np.abs(off / spread).max() < 0.3  # a third of the standard deviation that is left
    assert np.sqrt(np.diag(belief.covariance)) == pytest.approx(spread, rel=0.05)
    assert belief.covariance / np.outer(spread, spread) == pytest.approx(covariance / np.outer(spread, spread), abs=0.1)


def test_new_landmarks_take_over_the_errors_that_their_features_share_with_others():
    """Of features that err together some are known and others are new, as corners and their walls are."""
    everything, draw = np.arange(8), np.random.default_rng(4)
    told, first, seen = ways(AROUND[:2], draw), of_the_room(AROUND[0], draw), of_the_room(AROUND[1])
    mixing = np.eye(16) + 0.3 * draw.normal(size=(16, 16))
    covariance = mixing @ seen.covariance @ mixing.T
    errors = (np.linalg.cholesky(covariance) @ draw.normal(size=16)).reshape(-1, 2)
    seen = seen._replace(values=seen.values + errors, covariance=covariance)
    known, new = everything[:5], everything[5:]
    few = Measured(
        first.values[:5], first.walls[:5], first.covariance[:10, :10], first.ends_m[:5], first.facing_rad[:5]
    )
    belief = moved(grown(begun(tuple(AROUND[0])), few, None, (known[:0], known[:0]), known, 0), told[0])
    said = correction(belief, seen, *expected(belief), (known, known))
    belief = corrected(belief, said, (known, known), 1)
    belief = grown(belief, seen, said, (known, known), new, 1)
    found, stated = batch(AROUND[:2], told, [few, seen], belief.anchors_m)
    off = belief.mean - found
    off[[2, 3, 5, 7, 9]] -= math.tau * np.rint(off[[2, 3, 5, 7, 9]] / math.tau)
    spread = np.sqrt(np.diag(stated))
    assert np.abs(off / spread).max() < 0.1
    assert belief.covariance / np.outer(spread, spread) == pytest.approx(stated / np.outer(spread, spread), abs=0.05)


def unobservable(belief):
    """Return how pose and landmarks change (3 + 2 m, 3) if all is shifted and turned about the origin."""
    x, y = belief.place_m
    rows = [(1.0, 0.0, -y), (0.0, 1.0, x), (0.0, 0.0, 1.0)]
    for wall, (a, b), anchor in zip(belief.walls, belief.first, belief.anchors_m, strict=True):
        normal = math.cos(a), math.sin(a)
        rows += (
            [(0.0, 0.0, 1.0), (*normal, normal[1] * anchor[0] - normal[0] * anchor[1])]
            if wall
            else [(1.0, 0.0, -b), (0.0, 1.0, a)]
        )
    return np.array(rows)


def test_first_estimates_learn_nothing_of_where_the_whole_map_lies():
    draw = np.random.default_rng(3)
    told, scans = ways(AROUND, draw), [of_the_room(pose, draw) for pose in AROUND]
    left = {}
    for first_estimates in (True, False):
        known = run_known(AROUND, told, scans, first_estimates)
        shift = unobservable(begun(tuple(AROUND[0]))) * (0.3, 0.3, 0.2)
        unsure = run_known(AROUND, told, scans, first_estimates, shift @ shift.T)
        assert first_estimates == (unsure.mean == pytest.approx(known.mean, abs=1e-9))
        shift = unobservable(unsure) * (0.3, 0.3, 0.2)
        left[first_estimates] = float(np.abs(unsure.covariance - known.covariance - shift @ shift.T).max())
    assert left[True] < 1e-9
    assert left[False] > 1e-5


def test_derivatives_are_those_of_what_is_expected_and_of_where_new_landmarks_come():
    belief = run_known(AROUND[:2], ways(AROUND[:2]), [of_the_room(pose) for pose in AROUND[:2]])
    _, slopes = expected(belief, first_estimates=False)
    for landmark in range(8):
        columns = [0, 1, 2, 3 + 2 * landmark, 4 + 2 * landmark]
        for k, column in enumerate(columns):
            step = np.zeros(len(belief.mean))
            step[column] = 1e-6
            ahead, back = (
                expected(belief.__class__(**{**vars(belief), "mean": belief.mean + sign * step}))[0] for sign in (1, -1)
            )
            assert (ahead - back)[landmark] / 2e-6 == pytest.approx(slopes[landmark, :, k], abs=1e-6)


def test_a_new_landmark_has_the_errors_of_the_pose_and_of_its_measurement():
    draw, pose = np.random.default_rng(5), np.array((1.2, 0.9, 0.4))
    true, spread = of_the_room(pose), np.array((0.02, 0.03, 0.02))
    belief = begun(tuple(pose))
    belief.covariance[:] = np.diag(spread**2)
    everything = np.arange(8)
    stated = grown(belief, true, None, (everything[:0], everything[:0]), everything, 0)
    found = []
    for _ in range(1500):
        off = spread * draw.normal(size=3)
        noisy = of_the_room(pose, draw)
        at = begun(tuple(pose + off))
        # the same anchors: those are constants
        landmarks, anchors, _ = _placed(at, noisy.walls, noisy.values, true.ends_m)
        for k in range(4):
            a = landmarks[k, 0]
            landmarks[k, 1] += (anchors[k] - stated.anchors_m[k]) @ (math.cos(a), math.sin(a))
        found.append((*off, *(landmarks - stated.landmarks).ravel()))
    found = np.array(found)
    angles = [3, 5, 7, 9]
    found[:, angles] -= math.tau * np.rint(found[:, angles] / math.tau)
    scale = np.sqrt(np.diag(stated.covariance))
    assert np.cov(found.T) / np.outer(scale, scale) == pytest.approx(
        stated.covariance / np.outer(scale, scale), abs=0.13
    )


def test_a_ways_covariance_is_that_of_the_robots_odometry():
    path = ticks([(0.0, 0.0), (0.6, 0.0), (0.6, 0.5)])
    told = [odometry(path, np.random.default_rng(seed))[-1] for seed in range(1500)]
    way = Way()
    for x, y, turn in path[1:].tolist():
        way = further(way, x, y, turn, SLIP, TURN_RAD)
    scale = np.sqrt(np.diag(way.covariance))
    assert np.cov(np.array(told).T) / np.outer(scale, scale) == pytest.approx(
        way.covariance / np.outer(scale, scale), abs=0.12
    )


@pytest.mark.parametrize("more", [0.5, 3.0])
def test_errors_of_odometry_that_grow_with_the_speed_are_those_of_other_errors_at_one_speed(more):
    """Ticks of 3 cm, of which the errors are told for another way."""
    grown, plain = Way(), Way()
    for k in range(1, 9):
        pose = 0.03 * k, 0.0, 0.0
        grown = further(grown, *pose, SLIP, TURN_RAD, 0.03 / more)
        plain = further(plain, *pose, more * SLIP, more * TURN_RAD)
    assert grown.covariance == pytest.approx(plain.covariance)


def test_corners_are_measured_with_the_errors_that_they_share_with_their_walls():
    draw = np.random.default_rng(1)
    ranges = ring(ROOMS, (2.0, 1.5, 0.3), 0.0, draw)
    scan = extract(ranges, RING, FeatureSlamParameters().features)
    seen = measured(scan, 0.01)
    count = len(scan.lines)
    assert len(scan.corners_m) >= 2
    whitener = np.linalg.cholesky(seen.covariance)
    drawn = []
    for _ in range(2000):
        errors = [np.linalg.cholesky(line.covariance) @ draw.normal(size=2) for line in scan.lines]
        lines = [
            line._replace(alpha_rad=line.alpha_rad + a, r_m=line.r_m + r)
            for line, (a, r) in zip(scan.lines, errors, strict=True)
        ]
        corners = [crossing(lines[a], lines[b]) + 0.01 * draw.normal(size=2) for a, b in scan.sides]
        drawn.append(np.concatenate((np.ravel(errors), (np.array(corners) - scan.corners_m).ravel())))
    white = np.linalg.solve(whitener, np.array(drawn).T)
    assert np.cov(white) == pytest.approx(np.eye(2 * (count + len(scan.corners_m))), abs=0.15)


def crossing(one, other):
    """Return where two lines meet, by another way than the library's."""
    normals = np.array([(math.cos(line.alpha_rad), math.sin(line.alpha_rad)) for line in (one, other)])
    return np.linalg.solve(normals, (one.r_m, other.r_m))


# ---------------------------------------------------------------- association


def known_room():
    everything = np.arange(8)
    belief = grown(
        begun(tuple(AROUND[0])), of_the_room(AROUND[0]), None, (everything[:0], everything[:0]), everything, 0
    )
    return widened(belief, of_the_room(AROUND[0]), (everything, everything))


def test_features_are_the_landmarks_that_they_are():
    belief = moved(known_room(), ways(AROUND[:2])[0])
    pairs, new = associated(belief, of_the_room(AROUND[1], np.random.default_rng(1)), FeatureSlamParameters())
    assert pairs[0].tolist() == pairs[1].tolist() == list(range(8))
    assert not len(new)


def test_a_corner_that_is_open_the_other_way_is_another_one():
    belief, seen = known_room(), of_the_room(AROUND[0])
    seen.facing_rad[5] += math.pi / 2
    pairs, new = associated(belief, seen, FeatureSlamParameters())
    assert 5 not in pairs[0].tolist()
    assert new.tolist() == [5]


def test_a_wall_goes_on_only_for_a_while():
    for away, is_new in ((2.5, False), (3.0, True)):
        belief, seen = known_room(), of_the_room(AROUND[0])
        a = seen.values[1, 0]
        seen.ends_m[1] += away * np.array((-math.sin(a), math.cos(a)))
        pairs, new = associated(belief, seen, FeatureSlamParameters())
        assert (1 in new.tolist()) == is_new
        assert (1 in pairs[0].tolist()) != is_new


def test_between_a_landmark_and_a_new_one_a_feature_counts_for_nothing():
    for deviations, known, is_new in ((2.0, True, False), (4.5, False, False), (8.0, False, True)):
        belief, seen = known_room(), of_the_room(AROUND[0])
        seen.values[6, 0] += deviations * math.sqrt(2.0 * seen.covariance[12, 12])  # the map's error is as large
        pairs, new = associated(belief, seen, FeatureSlamParameters())
        assert (6 in pairs[0].tolist()) == known
        assert (6 in new.tolist()) == is_new


def test_a_pair_that_contradicts_all_others_is_given_up():
    belief = known_room()
    belief.covariance[:3, :3] += np.diag((0.1, 0.1, 0.1)) ** 2  # by itself, anything may be right
    seen = of_the_room(AROUND[0])
    seen.values[6] += 0.1
    pairs, _ = associated(belief, seen, FeatureSlamParameters())
    assert pairs[0].tolist() == [0, 1, 2, 3, 4, 5, 7]
    assert 6 in associated(belief, seen, FeatureSlamParameters(joint=1e6))[0][0].tolist()


# ---------------------------------------------------------------- drives


def slam_on(poses, **own):
    return FeatureSlam(tuple(poses[0].tolist()), RING, FeatureSlamParameters(**own))


def consistency(runs, corners, **own):
    """Return the mean of the poses' normalised squared errors over *runs* at each update, and errors (runs, u) in m."""
    poses = ticks(corners)
    found = [driven(slam_on(poses, **own), ROOMS, poses, seed) for seed in range(runs)]
    updates = min(len(errors) for errors, _, _ in found)
    squared = np.array([nees(errors, covariances)[:updates] for errors, covariances, _ in found])
    return squared.mean(axis=0)[1:], np.array([np.hypot(*errors[:updates, :2].T) for errors, _, _ in found])


@pytest.mark.slow
def test_on_a_short_drive_the_error_is_what_the_filter_says():
    mean, off = consistency(4, ROUND[:3])
    assert 1.2 < mean.mean() < 5.5  # 3, of four runs whose updates go together
    assert off.max() < 0.06


@pytest.mark.soak
def test_fifty_runs_of_fifty_metres_are_consistent(record_property):
    runs = max(soak_count(50), 2)
    mean, off = consistency(runs, ROUND)
    low, high = chi2.ppf([0.025, 0.975], 3 * runs) / runs
    within = np.mean((mean >= low) & (mean <= high))
    print(
        f"{runs} runs: NEES {mean.mean():.2f}, within {low:.2f} to {high:.2f} in {within:.3f}; error {off.mean():.4f} m"
    )
    record_property("drives of 50 m by features", runs)
    assert within >= 0.9
    assert off.max() < 0.15


def test_waiting_lowers_the_covariance():
    poses = ticks(ROUND[:2])
    slam = slam_on(poses)
    driven(slam, ROOMS, poses, 1)
    draw, told = np.random.default_rng(9), tuple(odometry(poses, np.random.default_rng(1))[-1].tolist())
    spreads, covariances = [], []
    for _ in range(300):
        updates = slam.updates
        found = slam.observe(told, ring(ROOMS, poses[-1], told[2], draw))
        if slam.updates > updates:
            spreads.append(found.spread_m)
            covariances.append(slam.belief.covariance[:3, :3])
    before, after = covariances[0], covariances[-1]
    assert len(spreads) == 30
    assert np.linalg.eigvalsh(before - after).min() > -1e-12  # in no direction it knows less
    assert spreads[-1] < 0.99 * spreads[0]  # what is left is the errors of the landmarks
    assert after[2, 2] < 0.8 * before[2, 2]
    assert (np.diff(spreads) <= 1e-9).all()


def test_the_state_stays_as_small_as_it_is_to_be():
    poses = ticks(ROUND[:4])
    for most in (8, 100):
        slam, largest = slam_on(poses, most_landmarks=most), 0
        draw = np.random.default_rng(2)
        for pose, own in zip(poses[::3], odometry(poses[::3], draw), strict=True):
            slam.observe(tuple(own.tolist()), ring(ROOMS, pose, own[2], draw))
            largest = max(largest, len(slam.belief.first))
        assert largest == 8 if most == 8 else largest > 10
        assert slam.belief.covariance.shape == 2 * (3 + 2 * len(slam.belief.first),)


def test_a_landmark_seen_but_once_is_forgotten():
    slam = slam_on(ticks(ROUND[:2]), lone_updates=5)
    seen = of_the_room(AROUND[0])
    slam.update(seen)
    assert len(slam.belief.first) == 8
    none = Measured(np.zeros((0, 2)), np.zeros(0, np.bool_), np.zeros((0, 0)), np.zeros((0, 2, 2)), np.zeros(0))
    for left in (8, 8, 8, 8, 0):
        slam.update(none)
        assert len(slam.belief.first) == left


def test_a_scan_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="beams"):
        slam_on(AROUND).observe((0.0, 0.0, 0.0), np.zeros(59))


def test_products_and_triangles_are_those_of_linear_algebra():
    draw = np.random.default_rng(0)
    left, right = draw.normal(size=(4, 6)), draw.normal(size=(6, 3))
    assert product(left, right) == pytest.approx(left @ right)
    square = left @ left.T
    lower = cholesky(square)
    assert lower == pytest.approx(np.linalg.cholesky(square))
    assert forward(lower, left) == pytest.approx(np.linalg.solve(lower, left))
