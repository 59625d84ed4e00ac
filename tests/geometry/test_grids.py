"""Coverage cells against shapely, distances against networkx, outlines against unions of squares."""

import networkx as nx
import numpy as np
import pytest
import shapely

from cosim.geometry.grids import EAST, NORTH, OFFSETS, SOUTH, WEST, coverage_grid, distances
from cosim.world.maps import outline


def nowhere(points):
    return np.zeros(len(points), bool)


ROOM = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]


def random_floor(seed):
    draw = np.random.default_rng(seed)
    walls = draw.uniform(0, 6, (7, 4))
    walls[:, 2:] = walls[:, :2] + draw.normal(0, 1.0, (7, 2))
    return np.concatenate((walls, ROOM))


@pytest.mark.parametrize("seed", range(8))
def test_cells_and_steps_are_those_where_the_disc_fits(seed):
    walls = random_floor(seed)
    geometry = shapely.MultiLineString(list(walls.reshape(-1, 2, 2)))
    grid = coverage_grid((0, 0, 6, 4), 0.5, 0.2, walls, lambda points: points[:, 0] > 5)
    assert (grid.nx, grid.ny) == (12, 8)
    for cell in range(96):
        x, y = grid.centre_m(cell)
        assert grid.free[cell] == (x <= 5 and geometry.distance(shapely.Point(x, y)) >= 0.2)
        for direction, (dx, dy) in enumerate(OFFSETS):
            way = shapely.LineString([(x, y), (x + 0.5 * dx, y + 0.5 * dy)])
            possible = grid.free[cell] and x + 0.5 * dx <= 5 and geometry.distance(way) >= 0.2
            assert grid.steps[cell, direction] == (cell + dx + 12 * dy if possible else -1)


def test_a_body_as_wide_as_the_passage_passes():
    walls = [*ROOM, (0, 1.2, 6, 1.2), (0, 1.6, 6, 1.6)]  # cells of 0.4: row 3 lies between 1.2 and 1.6
    grid = coverage_grid((0, 0, 6, 4), 0.4, 0.2, walls, nowhere)
    row = np.arange(15) + 3 * 15
    assert grid.free[row].all()
    assert (grid.steps[row[:-1], EAST] == row[1:]).all()
    assert not coverage_grid((0, 0, 6, 4), 0.4, 0.2001, walls, nowhere).free[row].any()


def test_only_what_the_starts_lead_to_is_reachable():
    walls = [*ROOM, (2, 0, 2, 4)]
    east = coverage_grid((0, 0, 6, 4), 0.5, 0.2, walls, nowhere)
    west = coverage_grid((0, 0, 6, 4), 0.5, 0.2, walls, nowhere, starts_m=[(1.1, 1.1)])
    x = west.centres_m()[:, 0]
    assert east.reachable.tolist() == (x > 2).tolist()  # the larger room, without starts
    assert west.reachable.tolist() == (x < 2).tolist()
    both = coverage_grid((0, 0, 6, 4), 0.5, 0.2, walls, nowhere, starts_m=[(1.1, 1.1), (5, 3)])
    assert both.reachable.all()


def test_a_start_off_the_grid_is_an_error_and_so_is_a_floor_without_cells():
    with pytest.raises(LookupError, match="off the grid"):
        coverage_grid((0, 0, 6, 4), 0.5, 0.2, ROOM, nowhere, starts_m=[(7, 1)])
    with pytest.raises(ValueError, match="no cell of 5 m"):
        coverage_grid((0, 0, 6, 4), 5, 0.2, ROOM, nowhere)
    with pytest.raises(ValueError, match="not both > 0"):
        coverage_grid((0, 0, 6, 4), 0.5, 0.0, ROOM, nowhere)


@pytest.mark.parametrize("seed", range(6))
def test_distances_are_the_shortest_ways(seed):
    grid = coverage_grid((0, 0, 6, 4), 0.25, 0.12, random_floor(seed), nowhere)
    graph = nx.Graph((cell, goal) for cell, goals in enumerate(grid.steps.tolist()) for goal in goals if goal >= 0)
    graph.add_nodes_from(range(len(grid.free)))
    sources = np.flatnonzero(grid.free)[[0, -1]].tolist()
    expected = nx.multi_source_dijkstra_path_length(graph, set(sources), weight=None)
    assert distances(grid.steps, sources).tolist() == [expected.get(cell, -1) for cell in range(len(grid.free))]


def test_steps_lead_back():
    grid = coverage_grid((0, 0, 6, 4), 0.25, 0.12, random_floor(3), nowhere)
    for there, back in ((NORTH, SOUTH), (EAST, WEST)):
        cells = np.flatnonzero(grid.steps[:, there] >= 0)
        assert len(cells)
        assert (grid.steps[grid.steps[cells, there], back] == cells).all()


@pytest.mark.parametrize("seed", range(8))
def test_an_outline_is_the_boundary_of_the_free_cells(seed):
    occupied = np.random.default_rng(seed).random((9, 13)) < 0.1 * (seed + 1)
    segments = outline(occupied)
    rows, columns = np.nonzero(~occupied)
    free = shapely.union_all(shapely.box(columns, rows, columns + 1, rows + 1))
    assert shapely.union_all(shapely.linestrings(segments.reshape(-1, 2, 2))).equals(free.boundary)
    assert np.hypot(*(segments[:, 2:] - segments[:, :2]).T).sum() == pytest.approx(free.length)


def test_edges_in_a_row_are_one_segment():
    occupied = np.zeros((4, 6), bool)
    occupied[1:3, 2:5] = True
    assert len(outline(occupied)) == 8  # the block and the edge of the grid
    assert [2.0, 1.0, 5.0, 1.0] in outline(occupied).tolist()
