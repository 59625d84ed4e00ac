"""Kernels on wall segments against shapely: random scenes, and lattices where lines meet ends and run along walls."""

import math

import numpy as np
import pytest
import shapely

from cosim.geometry.segments import clearance, free_fraction, ray_casts, ring_casts, sees, segment_grid, swept_clearance
from cosim.navigation.schemas import beam_directions


def scene(seed):
    """Walls, two sets of points, and the walls as a shapely geometry; odd seeds lie on a lattice."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 60))
    walls = draw.uniform(-5, 5, (count, 4))
    walls[:, 2:] = walls[:, :2] + draw.normal(0, 2, (count, 2))
    points = draw.uniform(-8, 8, (2, 80, 2))
    if seed % 2:
        walls, points = np.round(walls), np.round(points)
        walls = walls[(walls[:, :2] != walls[:, 2:]).any(axis=1)]  # shapely leaves out lines without length
    return walls, *points, shapely.MultiLineString(list(walls.reshape(-1, 2, 2)))


SEEDS = range(24)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wall_that_meets_the_open_sight_line_blocks_it(seed):
    walls, a, b, geometry = scene(seed)
    ends = shapely.multipoints(np.stack((a, b), axis=1))
    meeting = shapely.intersection(shapely.linestrings(np.stack((a, b), axis=1)), geometry)
    expected = shapely.is_empty(shapely.difference(meeting, ends)) | (a == b).all(axis=1)
    assert sees(segment_grid(walls), a, b).tolist() == expected.tolist()


@pytest.mark.parametrize("seed", SEEDS)
def test_clearance_is_the_distance_to_the_nearest_wall_up_to_the_limit(seed):
    walls, a, _, geometry = scene(seed)
    expected = np.minimum(shapely.distance(shapely.points(a), geometry), 2.5)
    np.testing.assert_allclose(clearance(segment_grid(walls), a, 2.5), expected, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_swept_clearance_is_the_distance_between_way_and_walls(seed):
    walls, a, b, geometry = scene(seed)
    expected = np.minimum(shapely.distance(shapely.linestrings(np.stack((a, b), axis=1)), geometry), 1.5)
    np.testing.assert_allclose(swept_clearance(segment_grid(walls), a, b, 1.5), expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(0, 24, 2))
def test_a_ray_ends_at_the_first_wall(seed):
    walls, a, _, geometry = scene(seed)
    angles = np.random.default_rng(seed).uniform(-4, 4, len(a))
    far = a + 6.0 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    hits = shapely.intersection(shapely.linestrings(np.stack((a, far), axis=1)), geometry)
    expected = np.nan_to_num(shapely.distance(shapely.points(a), hits), nan=6.0)
    np.testing.assert_allclose(ray_casts(segment_grid(walls), a, angles, 6.0), expected, atol=1e-9)


def test_no_sight_line_slips_through_a_corner_of_two_walls():
    draw = np.random.default_rng(5)
    for corner in draw.uniform(-1, 1, (200, 2)):
        x, y = corner.tolist()
        walls = [(x - 3, y + 1, x, y), (x, y, x + 3, y + 1)]
        away = np.array((draw.uniform(-0.5, 0.5), 4.0))
        assert not sees(segment_grid(walls), [corner - away], [corner + away])[0]


def test_a_wall_that_only_reaches_up_to_an_observer_does_not_blind_it():
    grid = segment_grid([(0, 0, 0, 5)])
    assert sees(grid, [(0, 0), (0, 0), (-1, 0), (0, -1)], [(3, 1), (0, 3), (1, 0), (0, 6)]).tolist() == [
        True,
        *[False] * 3,
    ]


def test_a_wall_without_length_is_a_point_that_blocks():
    grid = segment_grid([(1, 1, 1, 1)])
    assert sees(grid, [(0, 0), (0, 0)], [(2, 2), (2, 2.1)]).tolist() == [False, True]
    assert clearance(grid, [(1, 3)], 5.0)[0] == 2.0


def test_without_walls_everything_is_clear():
    grid = segment_grid([])
    assert sees(grid, [(0, 0)], [(9, 9)])[0]
    assert clearance(grid, [(0, 0)], 2.0)[0] == 2.0
    assert ray_casts(grid, [(0, 0)], [1.0], 7.0)[0] == 7.0


@pytest.mark.parametrize("walls", [[1.0, 2.0], [[0, 0, math.nan, 1]], [[0, 0, 1]]])
def test_what_is_not_walls_is_refused(walls):
    with pytest.raises(ValueError, match="rows of x1, y1, x2, y2"):
        segment_grid(walls)


@pytest.mark.parametrize("seed", range(12))
def test_a_disc_goes_as_far_as_contact(seed):
    walls, a, b, geometry = scene(2 * seed)
    grid = segment_grid(walls)
    met = 0
    for start, end in zip(a, b, strict=True):
        if geometry.distance(shapely.Point(start)) < 0.3:
            continue
        part = free_fraction(grid, *start, *(end - start), 0.3, 1e-7)
        gone = shapely.LineString([start, start + part * (end - start)]).distance(geometry)
        assert gone >= 0.3 - 2e-7
        if part < 1.0:
            met += 1
            assert gone == pytest.approx(0.3, abs=2e-7)
    assert met


def test_a_disc_in_touch_slides_along_the_wall_and_leaves_it():
    grid = segment_grid([(0, 0, 10, 0)])
    ways = [(3, 0), (-2, 0), (1, 1), (0, -0.1), (3, -0.1)]
    assert [free_fraction(grid, 5.0, 0.2 - 1e-16, *way, 0.2, 1e-7) for way in ways] == [1, 1, 1, 0, 0]
    assert free_fraction(grid, 5.0, 0.1, 0.0, 1.0, 0.2, 1e-7) == 1.0  # even if it should be inside, it gets out


@pytest.mark.parametrize("beams", [1, 7, 360])
def test_a_ring_of_beams_meets_what_each_of_them_meets(beams):
    draw = np.random.default_rng(beams)
    walls, angles = draw.uniform(0.0, 10.0, (40, 4)), 2.0 * np.pi * np.arange(beams) / beams
    walls[:8] = [[x, 0, x, 10] for x in range(1, 9)]
    grid, ring = segment_grid(walls), beam_directions(beams)
    places = [(1.0, 5.0), (-3.0, 4.0), *draw.uniform(0.0, 10.0, (20, 2)).tolist()]  # on a wall, off the grid
    for place in places:
        expected = ray_casts(grid, np.tile(place, (beams, 1)), angles, 4.0)
        assert ring_casts(grid, tuple(place), ring, 4.0).tolist() == expected.tolist()
