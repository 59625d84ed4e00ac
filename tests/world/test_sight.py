"""Who sees whom, and through which walls a signal goes: against shapely."""

import numpy as np
import pytest
import shapely

from cosim.geometry.segments import packed_walls, sees, segment_grid
from cosim.world.maps import outline
from cosim.world.sight import lines_of_sight, look_again, seen_by_each, wall_losses_db


def test_robots_see_each_other_within_range_where_no_wall_stands_between():
    walls = segment_grid([(2, -1, 2, 0.5)])
    positions = [(0, 0), (1, 0), (3, 0), (0, 3)]
    assert seen_by_each(lines_of_sight(packed_walls(walls), positions, 3.0)) == [(1, 3), (0,), (), (0,)]
    assert seen_by_each(lines_of_sight(packed_walls(walls), positions, np.inf)) == [(1, 3), (0, 3), (3,), (0, 1, 2)]


def test_all_pairs_are_as_one_by_one():
    draw = np.random.default_rng(4)
    walls = segment_grid(draw.uniform(0, 9, (12, 4)))
    positions = draw.uniform(0, 9, (15, 2))
    seen = lines_of_sight(packed_walls(walls), positions, np.inf)
    first, second = np.triu_indices(15, 1)
    assert (seen == seen.T).all()
    assert not seen.diagonal().any()
    assert seen[first, second].tolist() == sees(walls, positions[first], positions[second]).tolist()
    assert 0 < seen.sum() < 15 * 14


# ---------------------------------------------------------------- walls crossed


def scene(seed):
    """Walls, what they cost and robots that stand on none of them; odd seeds lie on a lattice, where ends are met."""
    draw = np.random.default_rng([7, seed])
    count = int(draw.integers(1, 200))
    walls = draw.uniform(-6, 6, (count, 4))
    walls[:, 2:] = walls[:, :2] + draw.normal(0, 3, (count, 2))
    positions = draw.uniform(-8, 8, (40, 2))
    if seed % 2:
        walls, positions = np.round(walls), np.unique(np.round(positions), axis=0)
        walls = walls[: 1 + count // 8]
    on_walls = shapely.intersects(shapely.points(positions), shapely.MultiLineString(list(walls.reshape(-1, 2, 2))))
    return walls, draw.uniform(0, 12, len(walls)), draw.permutation(positions[~on_walls])[:24]


def crossed_to_the_right(a, b, walls, losses):
    """What shapely says of the line from a to b, both ends moved to its right by a little."""
    if tuple(a) > tuple(b):
        a, b = b, a
    along = (b - a) / np.hypot(*(b - a))
    aside = 1e-6 * np.array((along[1], -along[0]))
    line = shapely.LineString([a + aside, b + aside])
    return losses[shapely.intersects(line, shapely.linestrings(walls.reshape(-1, 2, 2)))].sum()


@pytest.mark.parametrize("seed", range(12))
def test_each_wall_that_the_line_crosses_is_paid_once(seed):
    walls, losses, positions = scene(seed)
    got = wall_losses_db(segment_grid(walls), losses, positions)
    assert (got == got.T).all()
    assert not got.diagonal().any()
    expected = [
        crossed_to_the_right(positions[i], positions[j], walls, losses) if i != j else 0.0
        for i in range(len(positions))
        for j in range(len(positions))
    ]
    # every loss is kept to 2**-21 dB
    np.testing.assert_allclose(got.ravel(), expected, atol=len(walls) * 2.0**-21)
    assert len(positions) > 4
    assert got.any()


def test_a_line_through_the_joint_of_two_pieces_pays_for_one():
    whole, pieces = segment_grid([(-3, 0, 3, 0)]), segment_grid([(-3, 0, 0, 0), (0, 0, 3, 0)])
    around = np.array([(0, 2), (0, -2), (1.5, 3), (-1.5, -3), (-2, 1), (2, -1)])
    once = wall_losses_db(whole, [4.5], around)
    assert (wall_losses_db(pieces, [4.5, 4.5], around) == once).all()
    assert once[0, 1] == once[2, 3] == once[4, 5] == 4.5


def test_the_bend_of_a_wall_costs_once_from_the_inside_to_the_outside():
    grid = segment_grid([(0, 0, 4, 0), (0, 0, 0, 4)])
    assert wall_losses_db(grid, [10.0, 10.0], [(2, 2), (-2, -2)])[0, 1] == 10.0
    # a line that only touches it pays for both sides, or for none
    assert wall_losses_db(grid, [10.0, 10.0], [(-2, 2), (2, -2)])[0, 1] in (0.0, 20.0)


def test_walls_along_the_line_and_beyond_its_ends_are_free():
    grid = segment_grid([(1, 0, 2, 0), (-2, -1, -2, 1), (6, -1, 6, 1), (4, 2, 4, 5)])
    assert not wall_losses_db(grid, [9.0] * 4, [(0, 0), (5, 0)]).any()


def test_robots_in_one_place_and_floors_without_walls_cost_nothing():
    assert not wall_losses_db(segment_grid([(0, -1, 0, 1)]), [9.0], [(0.5, 0), (0.5, 0)]).any()
    assert not wall_losses_db(segment_grid([]), [], [(0, 0), (5, 0)]).any()
    assert wall_losses_db(segment_grid([]), [], []).shape == (0, 0)


def test_more_walls_than_are_looked_at_together_are_all_paid():
    x = np.arange(1.0, 300.0)
    grid = segment_grid(np.stack((x, -np.ones(299), x, np.ones(299)), axis=1))
    got = wall_losses_db(grid, np.full(299, 0.25), [(0, 0), (300, 0), (64.5, 0)])
    assert got[0].tolist() == [0.0, 299 / 4, 64 / 4]
    assert got[1, 2] == 235 / 4


@pytest.mark.parametrize("seed", range(6))
def test_the_solid_cells_of_a_map_cost_once_a_body_at_half_a_side(seed):
    draw = np.random.default_rng([8, seed])
    occupied = draw.random((14, 14)) < 0.25
    free = np.argwhere(~occupied)
    positions = free[draw.choice(len(free), 24, replace=False)][:, ::-1] + draw.uniform(0.1, 0.9, (24, 2))
    walls = outline(occupied)
    got = wall_losses_db(segment_grid(walls), np.full(len(walls), 0.5), positions)
    solid = shapely.union_all([shapely.box(x, y, x + 1, y + 1) for y, x in np.argwhere(occupied).tolist()])
    for i in range(24):
        for j in range(i):
            inside = shapely.intersection(shapely.LineString([positions[i], positions[j]]), solid)
            assert got[i, j] == (0 if inside.is_empty else len(shapely.get_parts(inside)))
    assert got.max() >= 3


def test_walls_and_losses_are_as_many():
    with pytest.raises(ValueError, match=r"2 walls have losses of shape \(3,\)"):
        wall_losses_db(segment_grid([(0, 0, 1, 1), (1, 0, 2, 1)]), [1.0, 2.0, 3.0], [(0, 0), (1, 1)])


def test_looking_again_tells_news_and_nothing_else() -> None:
    walls = packed_walls(segment_grid([[5.0, -1.0, 5.0, 1.0]]))
    seen = np.zeros((3, 3), np.bool_)
    apart = np.array([[0.0, 0.0], [3.0, 0.0], [9.0, 0.0]])
    for positions, news in ((apart, True), (apart + 0.1, False), (apart + np.array([0.0, 2.0]), True), (apart, True)):
        assert look_again(walls, positions, 8.0, seen) is news
        assert seen.tolist() == lines_of_sight(walls, positions, 8.0).tolist()
        assert not look_again(walls, positions, 8.0, seen)
