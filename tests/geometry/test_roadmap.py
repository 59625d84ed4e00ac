"""Ways over a roadmap: lines of sight against shapely, lengths against a visibility graph of all cells, by scipy."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse.csgraph
import shapely

from cosim.geometry.planning import PlanningGrid, cost_to_go, in_view
from cosim.geometry.roadmap import corners, line_is_free, roadmap


def random_grid(seed, ny=13, nx=17):
    draw = np.random.default_rng(seed)
    return PlanningGrid((1.0, -2.0), 0.5, draw.random((ny, nx)) >= draw.uniform(0.1, 0.35))


def solid(free):
    """Return the cells that are not free as one geometry, in cells."""
    rows, columns = np.nonzero(~free)
    walls = shapely.union_all(shapely.box(columns, rows, columns + 1, rows + 1))
    shapely.prepare(walls)
    return walls


def walked(grid, start, way):
    points = [start, *way]
    cells = [tuple((p[axis] - grid.origin_m[axis]) / grid.cell_m for axis in (0, 1)) for p in points]
    lines = [shapely.LineString(pair) for pair in pairwise(cells)]
    return sum(math.dist(a, b) for a, b in pairwise(points)), lines


@pytest.mark.parametrize("seed", range(4))
def test_a_line_is_free_where_shapely_finds_that_it_touches_no_solid_cell(seed):
    grid = random_grid(seed)
    free = grid.free
    ny, nx = free.shape
    walls = solid(free)
    draw = np.random.default_rng(seed)
    ends = draw.uniform((0, 0, 0, 0), (nx, ny, nx, ny), (600, 4))
    ends[::3, 2:] = ends[::3, :2] + draw.uniform(-2, 2, (200, 2))
    answers = [line_is_free(free, *row) for row in ends.tolist()]
    inside = (ends >= 0).all(axis=1) & (ends[:, 2] < nx) & (ends[:, 3] < ny)
    lines = shapely.linestrings(ends.reshape(-1, 2, 2))
    assert answers == (inside & ~shapely.intersects(walls, lines)).tolist()
    assert 40 < sum(answers) < 400


def test_a_line_between_centres_is_free_where_the_cells_see_each_other():
    free = random_grid(3).free
    nx = free.shape[1]
    cells = np.flatnonzero(free).tolist()[::3]
    for a in cells:
        for b in cells:
            centres = a % nx + 0.5, a // nx + 0.5, b % nx + 0.5, b // nx + 0.5
            assert line_is_free(free, *centres) == in_view(free, a, b), centres


def test_a_line_along_or_across_one_axis_is_answered_too():
    free = np.array([[True, True, True], [True, False, True]])
    assert line_is_free(free, 0.1, 0.2, 2.9, 0.2)
    assert line_is_free(free, 0.5, 1.9, 0.5, 0.0)
    assert not line_is_free(free, 0.1, 1.2, 2.9, 1.2)
    assert line_is_free(free, 2.5, 0.5, 2.5, 0.5)
    assert not line_is_free(free, -0.1, 0.5, 1.5, 0.5)
    assert not line_is_free(free, 1.5, 0.5, 1.5, 2.0), "the grid ends at 2"


def test_ways_bend_at_the_corners_of_what_is_not_free():
    free = np.ones((5, 6), bool)
    free[2, 2:4] = False
    assert corners(free).tolist() == [[1.5, 1.5], [4.5, 1.5], [1.5, 3.5], [4.5, 3.5]]
    free[:, 0] = False
    assert len(corners(free)) == 4, "a straight wall has none"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_ways_are_free_and_hardly_longer_than_the_shortest_among_all_cells(seed):
    grid = random_grid(seed)
    free, nx = grid.free, grid.free.shape[1]
    cells = np.flatnonzero(free)
    centres = np.stack((cells % nx + 0.5, cells // nx + 0.5), axis=1)
    walls = solid(free)
    graph = np.zeros((len(cells), len(cells)))
    for k in range(len(cells)):
        lines = shapely.linestrings(np.stack((np.repeat(centres[k : k + 1], k, 0), centres[:k]), axis=1))
        graph[k, :k] = ~shapely.intersects(walls, lines) * np.hypot(*(centres[:k] - centres[k]).T)
    shortest = scipy.sparse.csgraph.dijkstra(graph, directed=False) * grid.cell_m
    found = roadmap(grid, 1000)
    assert found is not None
    places = [grid.centre_m(int(cell)) for cell in cells]
    lengths = found.lengths_m(np.array(places))
    assert (np.isfinite(lengths) == np.isfinite(shortest)).all()
    reached = np.isfinite(shortest)
    assert (lengths[reached] >= shortest[reached] - 1e-9).all()
    apart = reached & (shortest > 0.0)
    assert (lengths[reached] <= shortest[reached] + 2.0 * grid.cell_m).all()
    assert (lengths[apart] / shortest[apart]).mean() < 1.02
    straight = graph + graph.T > 0
    assert np.abs(lengths[straight] - shortest[straight]).max() < 1e-9
    for a, b in np.random.default_rng(seed).integers(len(cells), size=(60, 2)).tolist():
        way = found.way(places[a], places[b])
        assert (way is not None) == np.isfinite(shortest[a, b]) == found.joined(places[a], places[b])
        assert found.length_m(places[a], places[b]) == pytest.approx(lengths[a, b])
        if way is not None:
            length, lines = walked(grid, places[a], way)
            assert length == pytest.approx(lengths[a, b], abs=1e-9)
            assert way[-1] == places[b]
            assert not shapely.intersects(walls, lines).any()


@pytest.mark.parametrize("seed", range(6))
def test_a_way_is_found_wherever_the_wavefront_finds_one_and_is_hardly_longer(seed):
    grid = random_grid(seed, 30, 30)
    found = roadmap(grid, 1000)
    assert found is not None
    cells = np.flatnonzero(grid.free).tolist()
    goal = cells[seed * 7]
    cost = cost_to_go(grid.free, [goal]).ravel()
    for cell in cells:
        length = found.length_m(grid.centre_m(cell), grid.centre_m(goal))
        assert math.isfinite(length) == math.isfinite(cost[cell])
        assert not length > (cost[cell] + 2.0) * grid.cell_m


def test_a_grid_with_too_many_corners_has_no_roadmap():
    grid = random_grid(1)
    count = len(corners(grid.free))
    assert roadmap(grid, count - 1) is None
    assert roadmap(grid, count) is not None


def test_an_open_grid_needs_no_nodes():
    found = roadmap(PlanningGrid((0.0, 0.0), 1.0, np.ones((3, 4), bool)), 0)
    assert found is not None
    assert found.way((0.2, 0.3), (3.7, 2.9)) == [(3.7, 2.9)]
    assert found.length_m((0.0, 0.0), (3.0, 2.0)) == pytest.approx(math.hypot(3, 2))
    assert found.open((0.0, 0.0), (3.9, 2.9))
