"""Who sees whom."""

import numpy as np

from cosim.geometry.segments import sees, segment_grid
from cosim.world.sight import lines_of_sight, seen_by_each


def test_robots_see_each_other_within_range_where_no_wall_stands_between():
    walls = segment_grid([(2, -1, 2, 0.5)])
    positions = [(0, 0), (1, 0), (3, 0), (0, 3)]
    assert seen_by_each(lines_of_sight(walls, positions, 3.0)) == [(1, 3), (0,), (), (0,)]
    assert seen_by_each(lines_of_sight(walls, positions, np.inf)) == [(1, 3), (0, 3), (3,), (0, 1, 2)]


def test_all_pairs_are_as_one_by_one():
    draw = np.random.default_rng(4)
    walls = segment_grid(draw.uniform(0, 9, (12, 4)))
    positions = draw.uniform(0, 9, (15, 2))
    seen = lines_of_sight(walls, positions, np.inf)
    first, second = np.triu_indices(15, 1)
    assert (seen == seen.T).all()
    assert not seen.diagonal().any()
    assert seen[first, second].tolist() == sees(walls, positions[first], positions[second]).tolist()
    assert 0 < seen.sum() < 15 * 14
