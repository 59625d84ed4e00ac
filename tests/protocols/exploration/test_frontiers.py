"""Yamauchi's frontiers against components of a graph."""

import networkx as nx
import numpy as np
import pytest

from protocols.exploration.targets import yamauchi_frontiers

AROUND = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


def slow_frontiers(evidence):
    """Return the sets of cells of all groups, however small."""
    rows, columns = evidence.shape
    graph = nx.Graph()
    for iy in range(rows):
        for ix in range(columns):
            beside = [(iy + dy, ix + dx) for dy, dx in AROUND if 0 <= iy + dy < rows and 0 <= ix + dx < columns]
            if evidence[iy, ix] < 0 and any(evidence[cell] == 0 for cell in beside):
                graph.add_node((iy, ix))
                graph.add_edges_from(((iy, ix), cell) for cell in beside if cell in graph)
    return [{iy * columns + ix for iy, ix in group} for group in nx.connected_components(graph)]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("least", [1, 4])
def test_frontiers_are_the_components_of_empty_cells_beside_the_unknown(seed, least):
    draw = np.random.default_rng(seed)
    evidence = draw.choice(np.array([-3, 0, 5], np.int8), (17, 23), p=(0.4, 0.1, 0.5))
    expected = sorted(sorted(group) for group in slow_frontiers(evidence) if len(group) >= least)
    frontiers = yamauchi_frontiers(evidence, least)
    assert len(expected) > 2
    assert [cells.tolist() for cells in frontiers] == expected


def test_small_groups_are_dropped_and_the_edge_of_the_grid_is_no_frontier():
    evidence = np.full((6, 9), -1, np.int8)
    assert yamauchi_frontiers(evidence, 1) == []
    evidence[0, 0] = 0  # a corner: three empty cells beside it
    evidence[4, 6] = 0  # eight
    assert [len(cells) for cells in yamauchi_frontiers(evidence, 3)] == [3, 8]
    (cells,) = yamauchi_frontiers(evidence, 4)
    assert cells.tolist() == [32, 33, 34, 41, 43, 50, 51, 52]


def test_an_unknown_map_has_none():
    assert yamauchi_frontiers(np.zeros((5, 5), np.int8), 0) == []
