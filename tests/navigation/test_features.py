"""Lines and corners of scans, against the walls that were scanned."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from cosim.geometry.segments import clearance, segment_grid
from cosim.navigation.features import (
    FeatureParameters,
    Line,
    corner_slopes,
    extract,
    fit_line,
    intersection,
    sandwich,
    squared_distance,
)
from cosim.navigation.schemas import beam_directions
from tests.navigation.feature_scene import BEAMS, NOISE_M, RANGE_M, ROOMS, ring
from tests.navigation.slam_scene import TWO_ROOMS, box

OWN = FeatureParameters(range_m=RANGE_M, sigma_m=NOISE_M)
RING = beam_directions(BEAMS)


def seen_from(walls, pose, draw=None, noise_m=NOISE_M):
    draw = np.random.default_rng(0) if draw is None else draw
    return extract(ring(walls, pose, 0.0, draw, noise_m=noise_m), RING, OWN)


def wall_lines(walls, pose):
    """Return alpha and r of all walls (w, 2), from *pose*."""
    rows = walls.walls_m
    way = rows[:, 2:] - rows[:, :2]
    normal = np.stack((-way[:, 1], way[:, 0]), axis=1) / np.hypot(*way.T)[:, None]
    r = (normal * (rows[:, :2] - pose[:2])).sum(axis=1)
    normal[r < 0.0] *= -1.0
    return np.stack((np.arctan2(normal[:, 1], normal[:, 0]) - pose[2], np.abs(r)), axis=1)


def places(walls, count, seed, high):
    """Return poses at random places that are free."""
    draw, found = np.random.default_rng(seed), []
    while len(found) < count:
        place = draw.uniform((0.3, 0.3), high)
        if clearance(walls, [place], 1.0)[0] > 0.3:
            found.append((*place, draw.uniform(-math.pi, math.pi)))
    return found


def distances(walls, poses, seed):
    """Return squared Mahalanobis distances of all lines and of all corners from the nearest true ones."""
    draw = np.random.default_rng(seed)
    of_lines, of_corners = [], []
    for pose in poses:
        seen, truth = seen_from(walls, pose, draw), wall_lines(walls, pose)
        for line in seen.lines:
            off = [(math.remainder(line.alpha_rad - a, math.tau), line.r_m - r) for a, r in truth]
            of_lines.append(min(squared_distance(*both, line.covariance) for both in off))
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        away = np.concatenate((walls.walls_m[:, :2], walls.walls_m[:, 2:])) - pose[:2]
        ends = np.stack((cos * away[:, 0] + sin * away[:, 1], cos * away[:, 1] - sin * away[:, 0]), axis=1)
        for number, corner in enumerate(seen.corners_m):
            covariance = seen.corner_covariance(number)
            of_corners.append(min(squared_distance(*(corner - end), covariance) for end in ends))
    return np.array(of_lines), np.array(of_corners)


@pytest.mark.parametrize(("walls", "high"), [(TWO_ROOMS, (8.1, 5.8)), (ROOMS, (11.7, 7.7))])
def test_errors_of_lines_and_corners_are_what_their_covariances_say(walls, high):
    lines, corners = distances(walls, places(walls, 120, 1, high), 2)
    for found, most in ((lines, 1.1), (corners, 1.25)):
        found = found[found < 30.0]  # one in a thousand is no wall
        low, above = chi2.ppf([0.001, 0.999], 2 * len(found)) / (2 * len(found))
        assert low < found.mean() / 2 < max(above, most)
    assert (lines > 30.0).mean() < 0.004
    assert (corners > 30.0).mean() < 0.01
    assert (lines > chi2.ppf(0.95, 2)).mean() < 0.07
    assert (corners > chi2.ppf(0.95, 2)).mean() < 0.09
    assert len(lines) > 350
    assert len(corners) > 100


def test_a_fits_error_has_the_covariance_that_is_stated():
    draw, theta = np.random.default_rng(3), np.linspace(-0.7, 1.1, 40)
    beams = np.stack((np.cos(theta), np.sin(theta)), axis=1)
    truth = 0.2, 1.5
    errors, stated = [], []
    for _ in range(1000):
        line, chi_square = fit_line(truth[1] / np.cos(theta - truth[0]) + draw.normal(0, 0.03, 40), beams, 0.03)
        errors.append((line.alpha_rad - truth[0], line.r_m - truth[1], chi_square))
        stated.append(line.covariance)
    errors, stated = np.array(errors), np.mean(stated, axis=0)
    scale = np.sqrt(np.diag(stated))
    assert np.cov(errors[:, :2].T) / np.outer(scale, scale) == pytest.approx(stated / np.outer(scale, scale), abs=0.12)
    assert abs(errors[:, :2].mean(axis=0) / np.sqrt(np.diag(stated))).max() < 0.1
    assert errors[:, 2].mean() == pytest.approx(38, rel=0.03)


def test_walls_without_noise_are_found_where_they_are():
    seen = seen_from(ROOMS, (2.0, 1.6, 0.4), noise_m=0.0)
    truth = wall_lines(ROOMS, (2.0, 1.6, 0.4))
    for line in seen.lines:
        off = np.array([(math.remainder(line.alpha_rad - a, math.tau), line.r_m - r) for a, r in truth])
        assert np.abs(off).max(axis=1).min() < 1e-9
        on = line.ends_m @ (math.cos(line.alpha_rad), math.sin(line.alpha_rad))
        assert on == pytest.approx(line.r_m)
    assert len(seen.lines) >= 5  # the door parts the fourth wall
    # the corners of the room that are within range
    cos, sin = math.cos(0.4), math.sin(0.4)
    in_map = seen.corners_m @ np.array([[cos, sin], [-sin, cos]]) + (2.0, 1.6)
    assert in_map[np.lexsort(in_map.round(6).T)] == pytest.approx(np.array([(0, 3), (4, 3)]), abs=1e-9)


def test_a_shallow_corner_parts_two_walls_and_a_straight_wall_is_one():
    bent = segment_grid([(-2.0, 1.0, 0.0, 1.5), (0.0, 1.5, 2.0, 1.0)])
    assert len(seen_from(bent, (0.0, 0.0, 0.0)).lines) == 2
    flat = segment_grid([(-2.0, 1.0, 2.0, 1.0)])
    for seed in range(20):
        ranges = ring(flat, (0.0, 0.0, 0.0), 0.0, np.random.default_rng(seed))
        (line,) = extract(ranges, RING, OWN.model_copy(update={"split_m": 0.05})).lines  # noise splits it
        assert line.alpha_rad == pytest.approx(math.pi / 2, abs=0.01)


def test_a_piece_is_not_bent_around_what_is_no_wall():
    angles = np.linspace(0, 2 * math.pi, 41)
    disc = np.stack((1.5 + 0.6 * np.cos(angles), 0.6 * np.sin(angles)), axis=1)
    walls = segment_grid(np.concatenate((disc[:-1], disc[1:]), axis=1))
    own = OWN.model_copy(update={"split_m": 1.0})
    found = ring(walls, (0.0, 0.0, 0.0), 0.0, np.random.default_rng(1))
    assert not extract(found, RING, own).lines


def test_ends_of_the_range_do_not_pull_a_wall_closer():
    flat = segment_grid([(-5.0, 2.3, 5.0, 2.3)])  # most of what is seen is at the end of the range
    found = []
    for seed in range(200):
        for line in seen_from(flat, (0.0, 0.0, 0.0), np.random.default_rng(seed)).lines:
            found.append((line.r_m - 2.3) / math.sqrt(line.covariance[1, 1]))
    assert len(found) > 150
    assert abs(np.mean(found)) < 0.2


def test_beams_that_meet_nothing_or_nan_part_a_wall():
    flat = segment_grid([(-2.0, 1.0, 2.0, 1.0)])
    ranges = ring(flat, (0.0, 0.0, 0.0), 0.0, np.random.default_rng(1))
    ranges[88:93] = math.nan
    assert len(extract(ranges, RING, OWN).lines) == 2
    assert not extract(np.full(BEAMS, np.inf), RING, OWN).lines
    assert not extract(np.full(BEAMS, np.nan), RING, OWN).lines


def test_a_closed_room_has_all_its_corners_wherever_the_ring_begins():
    room = segment_grid(box(-1.2, -1.0, 2.4, 2.0))
    for turn in np.linspace(0, math.tau, 13):
        seen = seen_from(room, (0.1, 0.1, turn))
        assert len(seen.lines) == 4
        assert len(seen.corners_m) >= 3  # the ring is cut at one


def test_derivatives_of_a_corner_are_those_of_the_intersection():
    one, other = (Line(a, r, np.eye(2), np.zeros((2, 2))) for a, r in ((0.3, 1.2), (1.5, 0.8)))
    numbers = np.array([0.3, 1.2, 1.5, 0.8])

    def at(values):
        return np.array(
            intersection(
                one._replace(alpha_rad=values[0], r_m=values[1]), other._replace(alpha_rad=values[2], r_m=values[3])
            )
        )

    slopes = np.stack([(at(numbers + d) - at(numbers - d)) / 2e-6 for d in 1e-6 * np.eye(4)], axis=1)
    assert corner_slopes(one, other) == pytest.approx(slopes, abs=1e-6)
    matrix = np.random.default_rng(0).normal(size=(4, 4))
    assert sandwich(slopes, matrix) == pytest.approx(slopes @ matrix @ slopes.T)
