"""Costs of ways against scipy's shortest paths, sight and growth against shapely, and way points that keep clear."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse
import shapely

from cosim.geometry.planning import (
    PlanningGrid,
    cost_to_go,
    descent,
    grown,
    in_view,
    occupancy_planning_grid,
    wall_planning_grid,
    way_points,
)

DIAGONAL = math.sqrt(2)


def random_grid(seed, ny=17, nx=23):
    draw = np.random.default_rng(seed)
    return draw.random((ny, nx)) >= draw.uniform(0.1, 0.45)


def picture(*rows):
    """Return the free cells of a drawing, its last row being row 0."""
    return np.array([[sign != "#" for sign in row] for row in reversed(rows)])


def graph(free):
    """Return the steps as a sparse matrix, from the rules: one cell at a time, without the code under test."""
    ny, nx = free.shape
    lengths = scipy.sparse.dok_array((free.size, free.size))
    for y, x in np.argwhere(free).tolist():
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if 0 <= x + dx < nx and 0 <= y + dy < ny and free[y + dy, x + dx] and free[y, x + dx] and free[y + dy, x]:
                lengths[y * nx + x, (y + dy) * nx + x + dx] = math.hypot(dx, dy)
    return lengths.tocsr()


def assert_equal_costs(cost, expected):
    reached = np.isfinite(expected)
    assert (np.isfinite(cost).ravel() == reached).all()
    assert np.abs(cost.ravel()[reached] - expected[reached]).max() < 1e-9


def squares(cells):
    rows, columns = np.nonzero(cells)
    return shapely.box(columns, rows, columns + 1, rows + 1)


def centre(cell, nx):
    return cell % nx + 0.5, cell // nx + 0.5


# ---------------------------------------------------------------- costs and ways


@pytest.mark.parametrize("goal_count", [1, 4])
@pytest.mark.parametrize("seed", range(8))
def test_costs_are_those_of_the_shortest_paths_of_the_same_graph(seed, goal_count):
    free = random_grid(seed)
    lengths = graph(free)
    _, part = scipy.sparse.csgraph.connected_components(lengths, directed=False)
    largest = np.flatnonzero(part == np.bincount(part).argmax())
    goals = np.random.default_rng(seed).choice(largest, goal_count, replace=False)
    expected = scipy.sparse.csgraph.dijkstra(lengths, directed=False, indices=goals).min(axis=0)
    assert np.isfinite(expected).sum() > 50
    assert_equal_costs(cost_to_go(free, goals), expected)


@pytest.mark.slow
def test_costs_are_right_where_waves_are_long_too():
    free = np.kron(random_grid(5, 12, 12), np.ones((10, 10), bool))
    goal = int(np.flatnonzero(free)[0])
    expected = scipy.sparse.csgraph.dijkstra(graph(free), directed=False, indices=goal)
    assert np.isfinite(expected).sum() > 3000
    assert_equal_costs(cost_to_go(free, [goal]), expected)


def test_what_cannot_be_reached_costs_infinity_and_has_no_way():
    free = picture("..#..", "..#..")
    cost = cost_to_go(free, [0])
    assert np.isinf(cost).tolist() == [[False, False, True, True, True]] * 2
    assert descent(free, cost, 4) is None
    assert descent(free, cost, 2) is None, "not from inside a wall either"
    assert np.isinf(cost_to_go(free, [2])).all(), "a goal in a wall is not reached"
    assert np.isinf(cost_to_go(free, [])).all()


def test_no_corner_is_cut():
    assert cost_to_go(picture(".#", ".."), [0])[1, 0] == 1
    assert cost_to_go(picture("..", ".."), [0])[1, 1] == DIAGONAL
    assert cost_to_go(picture("#.", ".."), [0])[1, 1] == 2
    assert cost_to_go(picture("..", ".#"), [0])[1, 1] == 2
    assert np.isinf(cost_to_go(picture("#.", ".#"), [0])[1, 1])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_descent_is_a_way_of_that_cost_to_a_goal(seed):
    free = random_grid(seed)
    nx = free.shape[1]
    lengths = graph(free)
    lengths = lengths + lengths.T
    goals = np.flatnonzero(free)[[3, -3]].tolist()
    cost = cost_to_go(free, goals)
    for start in np.flatnonzero(np.isfinite(cost)).tolist():
        path = descent(free, cost, start)
        assert path is not None
        assert path[0] == start
        assert path[-1] in goals
        steps = [lengths[a, b] for a, b in pairwise(path.tolist())]
        assert all(steps), "each is a step of the graph"
        assert sum(steps) == pytest.approx(cost[start // nx, start % nx], abs=1e-9)


@pytest.mark.parametrize("goal_count", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_field_that_ends_at_a_start_has_the_same_ways_from_there(seed, goal_count):
    free = random_grid(seed)
    goals = np.random.default_rng(seed).choice(np.flatnonzero(free), goal_count, replace=False)
    whole, cut_short = cost_to_go(free, goals), 0
    for start in range(free.size):
        field = cost_to_go(free, goals, start)
        known = whole <= whole.flat[start] if free.flat[start] else np.ones_like(free)
        assert np.array_equal(field[known], whole[known])
        assert (field[~known] >= whole[~known]).all()
        cut_short += int(np.isinf(field).sum() > np.isinf(whole).sum())
        one, other = descent(free, field, start), descent(free, whole, start)
        assert (one is None) == (other is None)
        assert one is None or one.tolist() == other.tolist()
    assert cut_short > 10


def test_a_cell_off_the_grid_is_an_error():
    free = np.ones((2, 3), bool)
    for cell in (-1, 6):
        with pytest.raises(LookupError, match=f"cell {cell} is off the grid of 3 x 2"):
            cost_to_go(free, [cell])
        with pytest.raises(LookupError, match=f"cell {cell} is off"):
            descent(free, cost_to_go(free, [0]), cell)


# ---------------------------------------------------------------- sight and way points


@pytest.mark.parametrize("seed", range(4))
def test_cells_see_each_other_where_all_squares_on_the_line_are_free(seed):
    free = np.random.default_rng(seed).random((9, 13)) >= 0.12
    blocked = shapely.STRtree(squares(~free))
    draw, seen = np.random.default_rng(100 + seed), 0
    for a, b in draw.integers(0, free.size, (400, 2)).tolist():
        line = shapely.LineString([centre(a, 13), centre(b, 13)])
        expected = len(blocked.query(line, predicate="intersects")) == 0
        assert in_view(free, a, b) == in_view(free, b, a) == expected, (a, b)
        seen += expected
    assert 40 < seen < 360


def test_a_line_through_a_corner_meets_the_cells_on_both_sides():
    assert in_view(picture("..", ".."), 0, 3)
    assert not in_view(picture("#.", ".."), 0, 3)
    assert not in_view(picture("..", ".#"), 0, 3)
    assert not in_view(picture("..", "#."), 0, 0), "nor does a blocked cell see itself"


@pytest.mark.parametrize("seed", range(6))
def test_way_points_see_the_next_one_and_make_the_way_no_longer(seed):
    free = np.kron(random_grid(seed, 8, 9), np.ones((4, 4), bool))
    nx = free.shape[1]
    goal = int(np.flatnonzero(free)[-1])
    cost, fewer = cost_to_go(free, [goal]), 0
    for start in np.flatnonzero(np.isfinite(cost)).tolist()[::7]:
        path = descent(free, cost, start)
        kept = way_points(free, path).tolist()
        assert kept[0] == start
        assert kept[-1] == goal
        at = [path.tolist().index(cell) for cell in kept]
        assert at == sorted(set(at)), "a part of the path, in its order"
        for a, b in pairwise(at):
            assert in_view(free, path[a], path[b])
            assert b == len(path) - 1 or not in_view(free, path[a], path[b + 1])
        length = sum(math.dist(centre(a, nx), centre(b, nx)) for a, b in pairwise(kept))
        assert length <= cost.flat[start] + 1e-9
        fewer += len(kept) < len(path)
    assert fewer


# ---------------------------------------------------------------- where a robot fits


@pytest.mark.parametrize("radius", [0.3, 0.5, 1.0, 1.5, 2.2, 3.7])
def test_cells_are_grown_over_where_the_disc_would_overlap(radius):
    occupied = np.random.default_rng(7).random((19, 24)) < 0.02
    occupied[4:9, 6:12] = True
    beyond = shapely.box(-9, -9, 33, 28).difference(shapely.box(0, 0, 24, 19))
    solid = shapely.union_all([*squares(occupied), beyond])
    shapely.prepare(solid)
    result = grown(occupied, radius)
    assert result.shape == occupied.shape
    for y in range(19):
        for x in range(24):
            assert result[y, x] == (shapely.distance(solid, shapely.Point(x + 0.5, y + 0.5)) < radius - 1e-7), (x, y)


def test_a_grid_of_walls_is_free_where_the_disc_fits():
    walls = np.random.default_rng(3).uniform(0, 6, (6, 4))
    geometry = shapely.MultiLineString(list(walls.reshape(-1, 2, 2)))
    grid = wall_planning_grid((1, -1, 6.3, 4), 0.25, 0.3, walls, lambda points: points[:, 0] > 5)
    assert grid.free.shape == (20, 21)
    for cell in range(grid.free.size):
        x, y = grid.centre_m(cell)
        assert grid.cell_at(x, y) == cell
        assert grid.free.flat[cell] == (x <= 5 and geometry.distance(shapely.Point(x, y)) >= 0.3)


def test_measures_that_make_no_grid_are_errors():
    with pytest.raises(ValueError, match="half the diagonal"):
        wall_planning_grid((0, 0, 4, 4), 0.5, 0.35, [])
    with pytest.raises(ValueError, match="no cell of 5 m"):
        wall_planning_grid((0, 0, 4, 4), 5, 9, [])
    for cell_m, radius_m in ((0, 0.2), (0.1, 0)):
        with pytest.raises(ValueError, match="not both > 0"):
            wall_planning_grid((0, 0, 4, 4), cell_m, radius_m, [])
        with pytest.raises(ValueError, match="not both > 0"):
            occupancy_planning_grid([[False]], cell_m, radius_m)


# ---------------------------------------------------------------- plans in metres

ROOMS = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0), (3, 0, 3, 2.5), (3, 3.4, 3, 4)]
"""Two rooms of 3 m x 4 m, and a door of 0.9 m between them."""


def rooms(radius_m=0.35):
    return wall_planning_grid((0, 0, 6, 4), 0.1, radius_m, ROOMS)


def test_a_plan_leads_through_the_door_and_keeps_clear_of_the_walls():
    start, goal = (1.03, 0.71), (5.02, 0.64)
    plan = rooms().plan(start, [goal])
    assert plan is not None
    assert plan[-1] == goal
    assert start not in plan
    assert 2 <= len(plan) <= 5
    way = shapely.LineString([start, *plan])
    walls = shapely.MultiLineString([(wall[:2], wall[2:]) for wall in ROOMS])
    assert way.distance(walls) >= 0.35 - 0.05 * DIAGONAL
    assert way.crosses(shapely.LineString([(3, 2.5), (3, 3.4)]))
    around = math.dist(start, (3, 2.85)) + math.dist((3, 2.85), goal)
    assert way.length < 1.1 * around, "8 neighbours make at most 8 % too much, and sight takes most of that away"


def test_a_robot_too_wide_for_the_door_has_no_plan():
    assert rooms(0.46).plan((1, 1), [(5, 1)]) is None
    assert rooms(0.46).plan((1, 1), [(2, 3)]) == [(2, 3)]


def test_a_plan_leads_to_the_nearest_goal_along_the_way():
    behind_the_wall, in_the_room = (3.4, 0.6), (0.6, 3.4)
    assert rooms().plan((2.6, 0.6), [behind_the_wall, in_the_room])[-1] == in_the_room
    assert rooms().plan((3.6, 0.6), [in_the_room, behind_the_wall]) == [behind_the_wall]
    assert rooms().plan((3.6, 0.6), []) is None
    assert rooms().plan((1, 1), [(1, 1)]) == [(1, 1)]


def test_who_stands_too_near_to_a_wall_begins_at_the_nearest_free_cell():
    at_the_wall = (2.8, 1.04)
    assert rooms().plan(at_the_wall, [(1, 1)]) is None
    plan = rooms().plan(at_the_wall, [(1, 1)], snap_m=0.3)
    assert plan == [pytest.approx((2.65, 1.05)), (1, 1)]
    assert rooms().plan(at_the_wall, [(1, 1)], snap_m=0.14) is None, "that is 0.1503 m away"
    assert rooms().plan((1, 1), [at_the_wall], snap_m=0.3) == [pytest.approx((2.65, 1.05))]
    assert rooms().plan((1, 1), [at_the_wall, (0.9, 3)], snap_m=0.1) == [(0.9, 3)]


def test_a_plan_on_a_map_of_cells_is_told_in_its_frame():
    occupied = ~picture(".....", "..#..", "..#..", "..#..")
    grid = occupancy_planning_grid(occupied, 2.0, 1.0, (-10.0, 5.0))
    assert (grid.free == ~occupied).all()
    plan = grid.plan((-9.5, 5.5), [(-0.5, 6.5)])
    assert plan == [(-7.0, 12.0), (-3.0, 12.0), (-0.5, 6.5)]


def test_a_point_off_the_grid_is_an_error():
    grid = PlanningGrid((0.0, 0.0), 0.5, np.ones((2, 2), bool))
    for point in ((-0.01, 0.5), (0.5, 1.01), (1.0, 0.5), (0.5, -0.01)):
        with pytest.raises(LookupError, match="off the grid"):
            grid.plan((0.5, 0.5), [point])
        with pytest.raises(LookupError, match="off the grid"):
            grid.plan(point, [(0.5, 0.5)])
