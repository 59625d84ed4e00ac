"""Values against networkx's Dijkstra with the same prices, and the iteration as printed; ways cost what they say."""

import math
from itertools import pairwise, product

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.geometry.planning import in_view
from cosim.geometry.value_iteration import ahead, cheapest_way, values

DIAGONAL = math.sqrt(2)


def random_floor(seed, ny=13, nx_=17):
    draw = np.random.default_rng(seed)
    free = draw.random((ny, nx_)) >= draw.uniform(0.0, 0.45)
    price = np.asarray(1.0 + draw.choice([0.0, 1.0]) * draw.exponential(2.0, (ny, nx_)), np.float32)
    goals = draw.integers(0, free.size, draw.integers(1, 4))
    return free, price, goals


def graph(free, price):
    """Return the steps from the rules, one cell at a time: an edge costs its length times the entered cell's price."""
    steps = nx.DiGraph()
    steps.add_nodes_from(map(tuple, np.argwhere(free).tolist()))
    for y, x in steps:
        for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            past = {(y + dy, x + dx), (y + dy, x), (y, x + dx)}
            if past <= set(steps):
                steps.add_edge((y, x), (y + dy, x + dx), cost=math.hypot(dx, dy) * float(price[y + dy, x + dx]))
    return steps


def printed(free, price, goals):
    """Return the values by the iteration as it is printed: all cells at once, from their neighbours, until it rests."""
    ny, nx_ = free.shape
    value = np.full((ny + 2, nx_ + 2), math.inf)
    open_, cost = np.pad(free, 1), np.pad(price.astype(float), 1)
    inner = slice(1, ny + 1), slice(1, nx_ + 1)
    rows, columns = np.divmod(goals, nx_)
    own = np.zeros_like(open_)
    own[rows + 1, columns + 1] = open_[rows + 1, columns + 1]
    value[own] = 0.0
    while True:
        new = value.copy()
        for dy, dx in product((-1, 0, 1), repeat=2):
            rows, columns = slice(1 + dy, ny + 1 + dy), slice(1 + dx, nx_ + 1 + dx)
            steps = open_[inner] & open_[rows, columns] & open_[rows, inner[1]] & open_[inner[0], columns]
            ways = value[rows, columns] + math.hypot(dx, dy) * cost[rows, columns]
            new[inner] = np.where(steps, np.minimum(new[inner], ways), new[inner])
        if np.array_equal(new, value):
            return value[inner]
        value = new


@given(st.integers(0, 10_000))
def test_values_are_those_of_networkx(seed):
    free, price, goals = random_floor(seed, 8, 9)
    steps = graph(free, price)
    sources = {divmod(int(goal), free.shape[1]) for goal in goals} & set(steps)
    expected = np.full(free.shape, math.inf)
    if sources:
        found = nx.multi_source_dijkstra_path_length(steps.reverse(), sources, weight="cost")
        for cell, cost in found.items():
            expected[cell] = cost
    assert np.allclose(values(free, price, goals), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_the_iteration_as_it_is_printed_comes_to_rest_at_the_values(seed):
    free, price, goals = random_floor(seed, 40, 30)
    assert np.allclose(printed(free, price, goals), values(free, price, goals), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_way_costs_its_value_and_cuts_no_corner(seed):
    free, price, goals = random_floor(seed)
    value = values(free, price, goals)
    steps = graph(free, price)
    for start in range(free.size):
        way = [divmod(int(cell), free.shape[1]) for cell in cheapest_way(free, price, value, start)]
        if not math.isfinite(value.flat[start]):
            assert way == []
            continue
        assert value[way[-1]] == 0.0
        assert sum(steps.edges[a, b]["cost"] for a, b in pairwise(way)) == pytest.approx(value[way[0]], abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_ahead_lies_on_the_way_in_sight_and_in_reach(seed):
    free, price, goals = random_floor(seed)
    value = values(free, price, goals)
    for start in np.flatnonzero(np.isfinite(value)).tolist():
        way = cheapest_way(free, price, value, start).tolist()
        seen, length = ahead(free, price, value, start, 5.0)
        cells = [divmod(cell, free.shape[1]) for cell in way]
        assert length == pytest.approx(sum(math.dist(a, b) for a, b in pairwise(cells)))
        at = way.index(seen)
        assert at >= min(1, len(way) - 1)
        if at > 1:
            assert in_view(free, start, seen)
            assert math.dist(cells[at], cells[0]) <= 5.0
        if at + 1 < len(way):
            next_seen = in_view(free, start, way[at + 1]) and math.dist(cells[at + 1], cells[0]) <= 5.0
            assert not next_seen


def test_dear_cells_are_gone_round():
    free, price = np.ones((5, 9), np.bool_), np.ones((5, 9), np.float32)
    price[1:4, 4] = 50.0
    way = cheapest_way(free, price, values(free, price, [2 * 9 + 8]), 2 * 9)
    assert {int(cell) // 9 for cell in way if cell % 9 == 4} <= {0, 4}


def test_a_goal_that_is_not_free_is_not_reached_and_one_off_the_grid_is_refused():
    free, price = np.ones((3, 4), np.bool_), np.ones((3, 4), np.float32)
    free[1, 1] = False
    assert np.isinf(values(free, price, [5])).all()
    with pytest.raises(LookupError, match="cell 12"):
        values(free, price, [12])


@pytest.mark.parametrize("price", [np.full((3, 4), 0.5, np.float32), np.ones((4, 3), np.float32)])
def test_prices_below_one_or_of_another_shape_are_refused(price):
    with pytest.raises(ValueError, match="prices"):
        values(np.ones((3, 4), np.bool_), price, [0])
