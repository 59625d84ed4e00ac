"""Hits at the mean: sums by cell against NumPy's means, fits against a search, and walls on the edges of cells."""

import math

import numpy as np
import pytest

from cosim.geometry.marking import DOUBTFUL, add_hits, mark_scan, most_changes
from cosim.geometry.segments import segment_grid
from cosim.navigation.schemas import beam_directions
from cosim.navigation.slam import MapGrid, Slam, SlamParameters, find_nearest, means_fit
from cosim.randomness import Draws
from tests.navigation.slam_scene import (
    BEAMS,
    CELL_M,
    ORIGIN_M,
    RANGE_M,
    ROOM,
    SHAPE,
    box,
    course,
    drive,
    off,
    scan,
    slam_at,
)

STRAY = math.log(0.05)
EDGES = segment_grid([*box(0.0, 0.0, 4.0, 3.0), *box(1.4, 1.2, 0.6, 0.5)])
"""A room whose walls, and those of a block in it, are in whole tenths of a metre: on the edges of cells."""
AROUND = course([(0.7, 0.7), (3.3, 0.7), (3.3, 2.3), (0.7, 2.3), (0.7, 0.8)])


def means_of(points, shape, origin_m, cell_m):
    """Return how many of *points* (m, 2; metres) fell in each cell, and their mean there, by NumPy alone."""
    places = (points - origin_m) / cell_m
    cells = np.floor(places).astype(int)
    on = ((cells >= 0) & (cells < shape[::-1])).all(axis=1)
    flat = np.ravel_multi_index((cells[on, 1], cells[on, 0]), shape)
    size = shape[0] * shape[1]
    counts = np.bincount(flat, minlength=size)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(flat, places[on, axis], size) / counts for axis in (0, 1)]
    return counts.reshape(shape), np.stack(means, axis=-1).reshape(*shape, 2)


def kept_means(sums):
    """Return the same of what is kept, *sums* (ny, nx, 3)."""
    up, across = np.mgrid[: sums.shape[0], : sums.shape[1]] + 0.5
    with np.errstate(invalid="ignore"):
        means = sums[..., :2] / sums[..., 2:] + np.stack((across, up), axis=-1)
    return sums[..., 2], means


def assert_same_means(sums, points, origin_m):
    counts, means = kept_means(sums)
    expected = means_of(points, sums.shape[:2], origin_m, CELL_M)
    assert (counts == expected[0]).all()
    assert np.isnan(means).any()
    assert means == pytest.approx(expected[1], abs=1e-5, nan_ok=True)


# ---------------------------------------------------------------- sums


def test_hits_of_random_scans_are_summed_by_cell():
    draw, shape, origin_m = np.random.default_rng(1), (37, 29), (-1.3, 0.4)
    sums, evidence = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.int8)
    frontier = np.zeros((37, 32), np.uint8)
    changed = np.empty(most_changes(RANGE_M, CELL_M), np.int32)
    struck, points = np.zeros(shape, bool), []
    for _ in range(20):
        place, angles = draw.uniform(origin_m, (1.6, 4.1)), draw.uniform(0.0, math.tau, 40)
        ways, ranges = np.stack((np.cos(angles), np.sin(angles)), axis=1), draw.uniform(0.0, 1.5 * RANGE_M, 40)
        ranges[::7] = np.nan
        add_hits(sums, *origin_m, CELL_M, *place, ranges, ways, RANGE_M)
        mark_scan(
            evidence,
            frontier,
            *origin_m,
            CELL_M,
            *place,
            ranges,
            ways,
            RANGE_M,
            *DOUBTFUL,
            np.empty((0, 3)),
            changed,
            True,
        )
        struck |= evidence > 0
        near = ranges < RANGE_M
        points.append(place + ranges[near, np.newaxis] * ways[near])
    assert_same_means(sums, np.concatenate(points), origin_m)
    assert (sums[struck, 2] > 0).all()  # what is occupied has a mean
    before = sums.copy()
    add_hits(sums, *origin_m, CELL_M, -1.4, 1.0, np.full(1, 0.3), np.array([[1.0, 0.0]]), RANGE_M)
    assert (sums == before).all()  # from off the grid nothing is marked


class Remembering(Slam):
    """Remembers all hits of each particle, point by point; who is copied is told by poses, which no two share."""

    def __init__(self, start, **own):
        grid = MapGrid(SHAPE, ORIGIN_M, CELL_M)
        super().__init__(grid, start, beam_directions(BEAMS), Draws(3, "slam"), SlamParameters(hit="mean", **own))
        self.points = [[] for _ in self.poses]
        self.copies = 0

    def _resample(self):
        before = self.poses.copy()
        assert len(np.unique(before, axis=0)) == len(before)
        super()._resample()
        parents = [int(np.flatnonzero((before == pose).all(axis=1))[0]) for pose in self.poses]
        self.copies += len(parents) - len(set(parents))
        self.points = [list(self.points[parent]) for parent in parents]

    def _update(self, ranges, beams):
        super()._update(ranges, beams)
        for points, (x, y, heading) in zip(self.points, self.poses, strict=True):
            cos, sin = math.cos(heading), math.sin(heading)
            ends = (ranges[:, np.newaxis] * beams)[ranges < RANGE_M]
            points.append(ends @ np.array([[cos, sin], [-sin, cos]]) + (x, y))


def test_the_means_of_a_particle_go_with_its_map_when_particles_are_drawn_anew():
    slam = Remembering((0.8, 1.2, 0.3), particles=6, power=1.0, resample_below=1.0)
    drive(slam, ROOM, course([(0.8, 1.2), (2.6, 1.4), (2.5, 2.4)]), 2)
    assert slam.copies > 3
    for sums, points in zip(slam.hits, slam.points, strict=True):
        assert_same_means(sums, np.concatenate(points), ORIGIN_M)
    slam.hits[0] = np.nan
    assert not np.isnan(slam.hits[1:]).any()  # no sums are shared


def test_at_the_centre_no_sums_are_kept():
    slam = slam_at((0.8, 1.2, 0.3))
    slam.observe((0.0, 0.0, 0.0), scan(ROOM, (0.8, 1.2, 0.3), 0.0))
    assert slam.hits is None


# ---------------------------------------------------------------- the fit


def test_ends_are_compared_with_the_mean_nearest_to_the_centre_of_their_cell():
    draw, (left, low) = np.random.default_rng(4), (-3, 5)
    evidence = draw.choice(np.array([-5, 0, 7], np.int8), (40, 30), p=[0.6, 0.35, 0.05])
    evidence[:, 12:] = -5
    sums = draw.uniform(-0.5, 0.5, (40, 30, 3)).astype(np.float32)
    sums[..., 2] = 4
    sums[..., :2] *= 4
    nearest = np.empty((25, 25, 2), np.float32)
    reach = 3
    find_nearest(evidence, sums, left, low, reach, nearest)
    up, across = np.nonzero(evidence > 0)
    means = np.stack((across + 0.5 - left, up + 0.5 - low), axis=1) + sums[up, across, :2] / 4
    pose, sigma = (12.2, 11.9, 0.8), 1.0
    ends = draw.uniform(-8.0, 8.0, (400, 2))
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    places = ends @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    centres = np.floor(places) + 0.5
    chosen = means[np.argmin(((centres[:, np.newaxis] - means) ** 2).sum(axis=2), axis=1)]
    expected = np.maximum(-((places - chosen) ** 2).sum(axis=1) / (2 * sigma**2), STRAY)
    on = ((places > 0.0) & (places < 25.0)).all(axis=1)
    assert on.sum() > 300
    assert 0.1 < (expected[on] == STRAY).mean() < 0.9
    for end, value in zip(ends[on], expected[on], strict=True):
        assert means_fit(nearest, *pose, end[np.newaxis], 1, sigma, STRAY) == pytest.approx(value, abs=1e-5)
    some = ends[on]
    assert means_fit(nearest, *pose, some, 200, sigma, STRAY) == pytest.approx(expected[on][:200].sum(), rel=1e-6)
    means_fit(nearest, 0.0, 40.0, 0.0, ends, 400, sigma, STRAY)  # beyond the rim, which takes all


# ---------------------------------------------------------------- walls on the edges of cells


def median_error_m(shift_m, **own):
    """Return the median over six drives of the median error (m) on maps with cells that are shifted by so much."""
    grid, errors_m = MapGrid((60, 70), (-1.0 + shift_m, -1.0 + shift_m), CELL_M), []
    for seed in range(6):
        slam = Slam(grid, AROUND[0], beam_directions(BEAMS), Draws(seed, "slam"), SlamParameters(**own))
        found, _ = drive(slam, EDGES, AROUND, seed, noise_m=0.02)
        errors_m.append(float(np.median(off(found, AROUND))))
    return float(np.median(errors_m))


def test_where_walls_are_in_their_cells_matters_to_centres_and_not_to_means():
    at_edges, at_centres = (median_error_m(shift, hit="mean", sigma_m=0.05) for shift in (0.0, 0.05))
    assert at_edges == pytest.approx(at_centres, abs=0.005)
    assert max(at_edges, at_centres) < 0.015
    assert median_error_m(0.0) - median_error_m(0.05) > 0.03


def creep_m(seed, **own):
    """Return how far off (m) the estimate and odometry are after twelve rounds in a corner of a room."""
    walls = segment_grid(
        [*box(0.0, 0.0, 5.0, 4.5)[:2], (5.0, 4.5, 2.6, 4.5), (1.4, 4.5, 0.0, 4.5), (0.0, 4.5, 0.0, 0.0)]
    )
    poses = course([(2.5, 2.5), *[(3.6, 0.8), (4.2, 0.9), (4.1, 1.4), (3.5, 1.3)] * 12], 0.25)
    slam = slam_at(poses[0], seed, particles=30, power=0.03, **own)
    found, dead = drive(slam, walls, poses, seed, noise=0.01, noise_m=0.02)
    return off(found, poses)[-20:].mean(), off(dead, poses)[-20:].mean()


def test_walls_that_are_seen_from_one_side_only_creep_away_from_a_robot_with_centres_and_hardly_with_means():
    by_centres, by_odometry = creep_m(1)
    by_means, _ = creep_m(1, hit="mean", sigma_m=0.05)
    assert by_centres > 2.0 * by_odometry
    assert by_means < 0.5 * by_odometry
