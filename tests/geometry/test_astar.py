"""Costs and ways by scipy's shortest paths of a graph made from the rules, clearance by all pairs of cells."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse

from cosim.geometry.astar import (
    astar,
    clearance_cost,
    costs_from,
    in_sight,
    lookouts,
    nearest,
    nearest_frontier,
    passable_cells,
)
from cosim.geometry.planning import in_view, obstacle_distance

DIAGONAL = math.sqrt(2)
READINGS = ("octile", "printed")
NY, NX = 13, 17


def picture(*rows):
    """Return the signs of a drawing, its last row being row 0."""
    return np.array([list(row) for row in reversed(rows)])


def flat(grid):
    """Return that nothing costs extra."""
    return np.zeros(grid.shape, np.float32)


def scene(seed):
    """Return passable cells, ends (a few passable themselves), extra costs, and a start with some way to go."""
    draw = np.random.default_rng(seed)
    passable = draw.random((NY, NX)) >= draw.uniform(0.1, 0.35)
    ends = draw.random((NY, NX)) < 0.06
    extra = (draw.random((NY, NX)) * draw.choice([0.0, 1.0, 6.0])).astype(np.float32)
    lengths = graph(passable, ends, flat(passable), -1, DIAGONAL)
    _, part = scipy.sparse.csgraph.connected_components(lengths, connection="strong")
    start = int(draw.choice(np.flatnonzero(part == np.bincount(part).argmax())))
    return passable, ends, extra, start


def graph(passable, ends, extra, start, diagonal):
    """Return the steps as a sparse matrix, from the rules: one cell at a time, without the code under test."""
    ny, nx = passable.shape
    costs = scipy.sparse.dok_array((passable.size, passable.size))
    for y in range(ny):
        for x in range(nx):
            if not (passable[y, x] or y * nx + x == start):
                continue
            for to_y in range(max(y - 1, 0), min(y + 2, ny)):
                for to_x in range(max(x - 1, 0), min(x + 2, nx)):
                    slanted = to_x != x and to_y != y
                    past = not slanted or (passable[y, to_x] and passable[to_y, x])
                    if (to_x, to_y) != (x, y) and past and (passable[to_y, to_x] or ends[to_y, to_x]):
                        step = diagonal if slanted else 1.0
                        costs[y * nx + x, to_y * nx + to_x] = step + float(extra[to_y, to_x])
    return costs.tocsr()


def cheapest(costs, start):
    return scipy.sparse.csgraph.dijkstra(costs, indices=start)


def cost_of(way, costs, start):
    """Return what a way costs, having seen that it begins at the start and that each step is one of the graph."""
    assert way[0] == start
    steps = [costs[a, b] for a, b in pairwise(way.tolist())]
    assert all(steps)
    return sum(steps)


def diagonal_of(reading):
    return DIAGONAL if reading == "octile" else 1.0


# ---------------------------------------------------------------- costs and ways


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("seed", range(6))
def test_costs_are_those_of_the_shortest_paths_of_the_same_graph(seed, reading):
    passable, ends, extra, start = scene(seed)
    expected = cheapest(graph(passable, ends, extra, start, diagonal_of(reading)), start)
    assert 50 < np.isfinite(expected).sum() < passable.size
    result = costs_from(passable, extra, start, ends, reading)
    assert result.shape == passable.shape
    np.testing.assert_allclose(result.ravel(), expected, rtol=1e-12)
    without = cheapest(graph(passable, np.zeros_like(ends), extra, start, diagonal_of(reading)), start)
    np.testing.assert_allclose(costs_from(passable, extra, start, reading=reading).ravel(), without, rtol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_an_octile_way_is_a_cheapest_one(seed):
    passable, _, extra, start = scene(seed)
    for goal in np.random.default_rng(seed).integers(0, passable.size, 12).tolist():
        ends = np.arange(passable.size).reshape(passable.shape) == goal
        costs = graph(passable, ends, extra, start, DIAGONAL)
        expected = cheapest(costs, start)[goal]
        way = astar(passable, extra, start, goal)
        assert (way is None) == math.isinf(expected)
        if way is not None:
            assert way[-1] == goal
            assert cost_of(way, costs, start) == pytest.approx(expected, rel=1e-12)


def test_a_printed_way_is_at_most_a_root_of_two_dearer_and_sometimes_is_dearer():
    dearer = found = 0
    for seed in range(8):
        passable, _, extra, start = scene(seed)
        extra *= 0.2
        costs = graph(passable, passable, extra, start, 1.0)
        expected = cheapest(costs, start)
        for goal in np.flatnonzero(np.isfinite(expected) & passable.ravel()).tolist()[::5]:
            way = astar(passable, extra, start, goal, "printed")
            assert way is not None
            assert way[-1] == goal
            cost = cost_of(way, costs, start)
            assert expected[goal] - 1e-9 <= cost <= DIAGONAL * expected[goal] + 1e-6
            dearer += cost > expected[goal] + 1e-6
            found += 1
    assert found > 100
    assert dearer > 3, "the straight line is no admissible estimate"


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("seed", range(6))
def test_the_nearest_goal_is_the_one_of_the_cheapest_way(seed, reading):
    passable, goals, extra, start = scene(seed)
    goals.flat[start] = False
    costs = graph(passable, goals, extra, start, diagonal_of(reading))
    expected = cheapest(costs, start)[goals.ravel()].min()
    way = nearest(passable, extra, start, goals, reading)
    assert way is not None
    assert goals.flat[way[-1]]
    assert not goals.flat[way[:-1]].any(), "it ends at the first goal"
    assert cost_of(way, costs, start) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dear", [0.0, 40.0, 1e7])
def test_ways_are_cheapest_whatever_the_range_of_costs_and_the_size_of_the_queue(dear, monkeypatch):
    """Wide ranges need more buckets than there are, many cells more links than there are at first."""
    draw = np.random.default_rng(11)
    passable = draw.random((30, 40)) >= 0.1
    extra = (draw.random((30, 40)) * dear).astype(np.float32)
    start, goal = np.flatnonzero(passable)[[0, -1]].tolist()
    costs = graph(passable, flat(passable), extra, start, DIAGONAL)
    expected = cheapest(costs, start)
    monkeypatch.setattr("cosim.geometry.grid_search._LINKS", 16)
    np.testing.assert_allclose(costs_from(passable, extra, start).ravel(), expected, rtol=1e-12)
    assert cost_of(astar(passable, extra, start, goal), costs, start) == pytest.approx(expected[goal], rel=1e-12)
    far = np.zeros_like(passable)
    far[-1] = passable[-1]
    way = nearest(passable, extra, start, far)
    assert cost_of(way, costs, start) == pytest.approx(expected[far.ravel()].min(), rel=1e-12)


def test_a_cell_that_costs_infinitely_much_is_not_entered():
    extra = flat(np.ones((2, 3)))
    extra[:, 1] = math.inf
    assert astar(np.ones((2, 3), bool), extra, 0, 2) is None
    extra[1, 1] = 0.0
    assert astar(np.ones((2, 3), bool), extra, 0, 2).tolist() == [0, 4, 2]


def test_a_detour_is_made_where_it_is_cheaper():
    free = np.ones((2, 5), bool)
    extra = flat(free)
    extra[0, 2] = 0.8
    assert astar(free, extra, 0, 4).tolist() == [0, 1, 2, 3, 4], "4.8 against 2 + 2 sqrt 2"
    extra[0, 2] = 0.9
    assert astar(free, extra, 0, 4).tolist() == [0, 1, 7, 3, 4]


def test_as_printed_the_detour_costs_no_more_but_promises_less():
    free = np.ones((2, 5), bool)
    extra = flat(free)
    extra[0, 2] = 0.2
    assert astar(free, extra, 0, 4, "printed").tolist() == [0, 1, 2, 3, 4], "4.2; the detour of 4 promises 2 + sqrt 5"
    extra[0, 2] = 0.3
    assert astar(free, extra, 0, 4, "printed").tolist() == [0, 1, 7, 3, 4]
    assert costs_from(free, extra, 0, reading="printed")[0, 4] == 4


def test_a_way_may_begin_and_end_where_it_could_not_pass():
    signs = picture("..#g", "s#..", "..#.")
    passable, start, goal = signs == ".", 4, 11
    assert astar(passable, flat(signs), start, goal) is None
    passable[0, 2] = True
    assert astar(passable, flat(signs), start, goal).tolist() == [4, 0, 1, 2, 7, 11]
    assert astar(passable, flat(signs), goal, start).tolist() == [11, 7, 2, 1, 0, 4]
    assert astar(passable, flat(signs), goal, goal).tolist() == [goal]
    assert nearest(passable, flat(signs), start, np.zeros_like(passable)) is None


def test_no_way_leads_over_an_end_or_cuts_its_corner():
    passable = picture("..", "..") == "."
    passable[0, 1] = False
    ends = ~passable
    assert costs_from(passable, flat(ends), 0, ends).tolist() == [[0, 1], [1, 2]]
    passable, ends = np.array([[True, False, True]]), np.array([[False, True, False]])
    assert costs_from(passable, flat(ends), 0, ends).tolist() == [[0, 1, math.inf]]


def test_a_cell_off_the_grid_and_costs_that_do_not_fit_are_errors():
    free = np.ones((2, 3), bool)
    for cell in (-1, 6):
        for search in (
            lambda cell: astar(free, flat(free), cell, 0),
            lambda cell: astar(free, flat(free), 0, cell),
            lambda cell: nearest(free, flat(free), cell, free),
            lambda cell: nearest_frontier(free, free, flat(free), cell, free),
            lambda cell: costs_from(free, flat(free), cell),
        ):
            with pytest.raises(LookupError, match=f"cell {cell} is off the grid of 3 x 2"):
                search(cell)
    with pytest.raises(ValueError, match=r"shape \(3, 2\) do not fit a grid of shape \(2, 3\)"):
        astar(free, flat(free.T), 0, 1)


# ---------------------------------------------------------------- the nearest frontier


def goal_of(signs, reading="octile", extra=None):
    """Return the sign of the cell where the way to the nearest frontier, a letter but s, ends."""
    clear = (signs == ".") | (signs == "s")
    frontier = np.char.isalpha(signs) & (signs != "s")
    start = int(np.flatnonzero(signs == "s")[0])
    way = nearest_frontier(clear, clear, flat(signs) if extra is None else extra, start, frontier, reading)
    return None if way is None else str(signs.flat[way[-1]])


@pytest.mark.parametrize("reading", READINGS)
def test_a_frontier_in_sight_is_preferred_however_far(reading):
    assert goal_of(picture("g.......s#h", "..........."), reading) == "g"
    assert goal_of(picture("........s#h", "..........."), reading) == "h", "there is no other"
    assert goal_of(picture("g.#.....s#h", "..........."), reading) == "h", "nor one that is seen"


@pytest.mark.parametrize("reading", READINGS)
def test_a_frontier_without_a_way_is_passed_over(reading):
    signs = picture("s..a", "#...", "g...")
    clear, frontier = signs != "#", np.isin(signs, ["a", "g"])
    passable = clear & ~frontier
    passable[1:, 2] = passable[1, 3] = False
    assert nearest_frontier(passable, clear, flat(signs), 8, signs == "a", reading) is None
    assert nearest_frontier(passable, clear, flat(signs), 8, frontier, reading).tolist() == [8, 9, 5, 1, 0]


def test_nearest_is_by_the_way_or_as_printed_by_the_straight_line():
    signs = picture("g...s..h")
    dear = flat(signs)
    dear[:, 5:] = 2.0
    assert goal_of(signs, "octile", dear) == "g"
    assert goal_of(signs, "printed", dear) == "h"


def test_columns_that_pad_a_frontier_are_left_out():
    free = np.ones((2, 3), bool)
    frontier = np.zeros((2, 8), np.uint8)
    frontier[:, 3:] = 1
    assert nearest_frontier(free, free, flat(free), 0, frontier) is None
    frontier[1, 2] = 1
    assert nearest_frontier(free, free, flat(free), 0, frontier).tolist()[-1] == 5


def test_targets_in_sight_are_those_with_a_clear_line():
    draw = np.random.default_rng(4)
    clear = draw.random((NY, NX)) >= 0.2
    targets = ~clear & (draw.random((NY, NX)) < 0.5)
    cell = int(np.flatnonzero(clear)[len(clear) // 2])
    seen = in_sight(clear, cell, targets)
    through = clear | targets
    assert seen.ravel().tolist() == [bool(targets.flat[k] and in_view(through, cell, k)) for k in range(targets.size)]
    assert 2 < seen.sum() < targets.sum()
    clear.flat[cell] = False
    assert (in_sight(clear, cell, targets) == seen).all(), "wherever one stands one sees from there"


@pytest.mark.parametrize("reach", [1.0, 2.5])
def test_lookouts_have_a_target_in_sight_and_reach(reach):
    draw = np.random.default_rng(5)
    clear = draw.random((NY, NX)) >= 0.25
    passable = clear & (draw.random((NY, NX)) < 0.8)
    targets = ~clear & (draw.random((NY, NX)) < 0.2)
    through = clear | targets
    expected = np.zeros_like(clear)
    for a in np.flatnonzero(passable).tolist():
        for b in np.flatnonzero(targets).tolist():
            near = math.dist(divmod(a, NX), divmod(b, NX)) <= reach
            expected.flat[a] |= near and in_view(through, a, b)
    result = lookouts(passable, clear, targets, reach)
    assert (result == expected).all()
    assert 5 < result.sum() < passable.sum()


# ---------------------------------------------------------------- what obstacles cost


def distance_to_squares(occupied):
    """Return the distances of the centres from the nearest occupied square or the outside, by all pairs."""
    ny, nx = occupied.shape
    y, x = np.mgrid[0:ny, 0:nx]
    result = np.minimum.reduce([x + 0.5, y + 0.5, nx - x - 0.5, ny - y - 0.5])
    for row, column in np.argwhere(occupied).tolist():
        off_x, off_y = np.maximum(abs(x - column) - 0.5, 0), np.maximum(abs(y - row) - 0.5, 0)
        result = np.minimum(result, np.hypot(off_x, off_y))
    return result


@pytest.mark.parametrize(("range_cells", "most"), [(3.0, 5.0), (4.7, 2.0), (0.6, 1.0)])
def test_clearance_costs_fall_linearly_with_the_distance(range_cells, most):
    occupied = np.random.default_rng(8).random((21, 24)) < 0.02
    occupied[5:9, 5:10] = True
    distance = distance_to_squares(occupied)
    cost = clearance_cost(occupied, range_cells, most)
    assert cost.dtype == np.float32
    expected = np.interp(distance, [0.5, range_cells], [most, 0.0])
    np.testing.assert_allclose(cost, expected, atol=1e-5)
    assert (cost == 0).any()
    assert (cost[distance == 0.5] == most).all()


def test_distances_beyond_the_reach_are_not_told():
    occupied = np.random.default_rng(9).random((25, 25)) < 0.01
    distance = distance_to_squares(occupied)
    expected = np.where(distance <= 2.5, distance, np.inf)
    np.testing.assert_allclose(obstacle_distance(occupied, 2.5), expected, rtol=1e-6)
    assert np.isinf(expected).any()


def test_a_robot_passes_where_all_is_known_to_be_empty_and_it_fits():
    draw = np.random.default_rng(10)
    evidence = draw.choice([-9, 0, 9], (20, 22), p=[0.9, 0.08, 0.02]).astype(np.int8)
    assert (passable_cells(evidence, 0.5) == (evidence < 0)).all()
    expected = (evidence < 0) & (distance_to_squares(evidence > 0) >= 1.5 - 1e-9)
    assert (passable_cells(evidence, 1.5) == expected).all()
    assert expected.any()


def test_measures_that_make_no_cost_are_errors():
    for range_cells, most in ((0.5, 1.0), (3.0, -1.0), (math.nan, 1.0)):
        with pytest.raises(ValueError, match=r"is not > 0\.5, or the most"):
            clearance_cost([[False]], range_cells, most)
