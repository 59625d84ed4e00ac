"""Fields of frontiers and obstacles against sums over all cells, and lines of sight against clipped segments."""

import math

import numpy as np
import pytest

from cosim.navigation.frontier_fields import sum_of_frontiers, sum_of_obstacles

CELL = 0.1
ORIGIN = (-1.3, 2.1)


def slow_sum(chosen, place, reach_m):
    """Return the sum over the cells *chosen* as the paper's formula has it, for a place in cells."""
    total = np.zeros(2)
    for iy, ix in np.argwhere(chosen):
        way = CELL * (np.array((ix + 0.5, iy + 0.5)) - place)
        distance = math.hypot(*way)
        if distance <= reach_m:
            total += way / distance / max(distance, CELL / 2) ** 2
    return total


def metres(place):
    return ORIGIN[0] + CELL * place[0], ORIGIN[1] + CELL * place[1]


def seen(occupied, place):
    """Return which of the *occupied* cells have no other one between them and *place*."""
    result = np.zeros(occupied.shape, bool)
    corner = np.argwhere(occupied)[:, ::-1]
    own = np.floor(place)
    for iy, ix in np.argwhere(occupied):
        way = np.array((ix + 0.5, iy + 0.5)) - place
        times = np.sort(np.stack(((corner - place) / way, (corner + 1 - place) / way)), axis=0)
        inside = np.minimum(times[1].min(axis=1), 1.0) - np.maximum(times[0].max(axis=1), 0.0)
        other = (corner != (ix, iy)).any(axis=1) & (corner != own).any(axis=1)
        result[iy, ix] = not (other & (inside > 0)).any()
    return result


@pytest.mark.parametrize("seed", range(8))
def test_frontiers_within_reach_attract_with_the_inverse_square(seed):
    draw = np.random.default_rng(seed)
    chosen = draw.random((37, 43)) < 0.1
    frontier = np.zeros((37, 48), np.uint8)
    frontier[:, :43] = chosen
    place = draw.uniform(-6, (49, 43))  # also off the grid
    reach_m = draw.uniform(0.3, 6.0)
    expected = slow_sum(chosen, place, reach_m)
    assert np.hypot(*expected) > 0
    assert sum_of_frontiers(frontier, *ORIGIN, CELL, *metres(place), reach_m) == pytest.approx(expected, rel=1e-9)


def test_reach_is_to_the_centre_of_a_cell():
    frontier = np.zeros((1, 16), np.uint8)
    frontier[0, 9] = 1
    robot = metres((1.5, 0.5))
    assert sum_of_frontiers(frontier, *ORIGIN, CELL, *robot, 0.8 + 1e-9) == pytest.approx((1 / 0.64, 0.0))
    assert sum_of_frontiers(frontier, *ORIGIN, CELL, *robot, 0.8 - 1e-9) == (0.0, 0.0)


def test_nearer_than_half_a_cell_counts_as_half_a_cell():
    cells = np.zeros((2, 8), np.int8)
    cells[0, 2] = 1
    for offset, strength in ((0.2, 400.0), (0.5, 400.0), (1.0, 100.0)):
        robot = metres((2.5, 0.5 + offset))
        expected = pytest.approx((0.0, -strength), abs=1e-6)
        assert sum_of_frontiers(cells.view(np.uint8), *ORIGIN, CELL, *robot, 1.0) == expected
        assert sum_of_obstacles(cells, *ORIGIN, CELL, *robot, 1.0, False) == expected
    assert sum_of_frontiers(cells.view(np.uint8), 0.0, 0.0, 1.0, 2.5, 0.5, 1.0) == (0.0, 0.0)
    assert sum_of_obstacles(cells, 0.0, 0.0, 1.0, 2.5, 0.5, 1.0, False) == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(8))
def test_obstacles_within_reach_count_and_in_sight_only_those_that_no_other_hides(seed):
    draw = np.random.default_rng(seed)
    evidence = draw.choice(np.array([-5, 0, 3], np.int8), (37, 43), p=(0.5, 0.3, 0.2))
    place = draw.uniform(-1, (44, 38))
    robot, reach_m = metres(place), draw.uniform(0.6, 1.5)
    occupied = evidence > 0
    everything = slow_sum(occupied, place, reach_m)
    visible = slow_sum(occupied & seen(occupied, place), place, reach_m)
    assert np.abs(everything - visible).max() > 1
    assert sum_of_obstacles(evidence, *ORIGIN, CELL, *robot, reach_m, False) == pytest.approx(everything, rel=1e-9)
    assert sum_of_obstacles(evidence, *ORIGIN, CELL, *robot, reach_m, True) == pytest.approx(visible, rel=1e-9)


def test_a_line_of_sight_passes_between_cells_that_meet_at_a_corner():
    evidence = np.zeros((5, 5), np.int8)
    evidence[3, 3] = evidence[2, 1] = evidence[1, 2] = 1
    hidden = evidence.copy()
    hidden[2, 2] = 1
    place = (1.5, 1.5)
    chosen = evidence > 0
    at = (*ORIGIN, CELL, *metres(place), 1.0)
    assert sum_of_obstacles(evidence, *at, True) == pytest.approx(slow_sum(chosen, place, 1.0))
    chosen[3, 3], chosen[2, 2] = False, True
    assert sum_of_obstacles(hidden, *at, True) == pytest.approx(slow_sum(chosen, place, 1.0))


def test_an_obstacle_in_the_robots_own_cell_hides_nothing():
    evidence = np.zeros((5, 5), np.int8)
    evidence[1, 1] = evidence[1, 3] = 1
    place = (1.6, 1.5)
    expected = pytest.approx(slow_sum(evidence > 0, place, 1.0), abs=1e-9)
    assert sum_of_obstacles(evidence, *ORIGIN, CELL, *metres(place), 1.0, True) == expected
