"""Which discs could touch: cells and what compares all pairs name the same, in the same order."""

import numpy as np
import pytest

from cosim.robots.contact import pairs_near
from cosim.robots.table import DX, DY, RADIUS, ROWS, X, Y


def all_pairs(table):
    """Return the pairs i < j, rising, nearer than their radii and all that either goes along x and y."""
    reach = table[RADIUS] + np.abs(table[DX]) + np.abs(table[DY])
    square = np.subtract.outer(table[X], table[X]) ** 2 + np.subtract.outer(table[Y], table[Y]) ** 2
    return np.argwhere(np.triu(square < np.add.outer(reach, reach) ** 2, 1))


@pytest.mark.parametrize("side_m", [0.0, 0.5, 10.0, 300.0])
@pytest.mark.parametrize("count", [0, 1, 2, 16, 30, 200])
def test_the_pairs_are_those_that_comparing_all_finds(side_m, count):
    stream = np.random.default_rng(count)
    for widest_m in (0.0, 0.3, 5.0):
        table = np.zeros((ROWS, count))
        table[[X, Y]] = stream.uniform(-side_m, side_m / 2, (2, count))
        table[[DX, DY]] = stream.uniform(-0.1, 0.1, (2, count))
        table[RADIUS] = stream.uniform(0.0, widest_m, count)
        assert pairs_near(table).tolist() == all_pairs(table).tolist()


def test_discs_in_a_lattice_as_wide_as_their_reach_touch_their_neighbours_only():
    line_m = np.arange(20.0)
    table = np.zeros((ROWS, 400))
    table[X], table[Y] = (each.ravel() for each in np.meshgrid(line_m, line_m))
    table[RADIUS] = 0.5
    assert len(pairs_near(table)) == 0  # less than their reach is asked for
    table[RADIUS] = 0.5 + 1e-9
    assert len(pairs_near(table)) == 2 * 20 * 19
