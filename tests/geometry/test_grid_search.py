"""The search under the wavefront, value iteration and A*: factors, prices and ends together, and what it leaves out."""

import heapq
import math
from itertools import product

import numpy as np
import pytest

from cosim.geometry.grid_search import DIAGONAL, Estimate, _searched, costs


def by_heap(free, starts, factor, price, ends, diagonal):
    """Return the costs by Dijkstra's algorithm from the heap of the standard library."""
    ny, nx = free.shape
    found = np.full(free.shape, math.inf)
    heap = [(0.0, *divmod(int(start), nx)) for start in starts]
    for _, y, x in heap:
        found[y, x] = 0.0
    begun = {(y, x) for _, y, x in heap}
    while heap:
        cost, y, x = heapq.heappop(heap)
        if cost > found[y, x] or not (free[y, x] or (y, x) in begun) or (ends[y, x] and not free[y, x]):
            continue
        for dy, dx in product((-1, 0, 1), repeat=2):
            to = y + dy, x + dx
            if (dy or dx) and 0 <= to[0] < ny and 0 <= to[1] < nx and (free[to] or ends[to]):
                slanted = bool(dy and dx)
                if slanted and not (free[y, x + dx] and free[y + dy, x]):
                    continue
                length = cost + (diagonal if slanted else 1.0) * float(factor[y, x]) + float(price[to])
                if length < found[to]:
                    found[to] = length
                    heapq.heappush(heap, (length, *to))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_costs_are_to_the_last_bit_those_of_a_heap(seed):
    draw = np.random.default_rng(seed)
    shape = tuple(draw.integers(1, 25, 2))
    free, ends = draw.random(shape) < 0.8, draw.random(shape) < 0.05
    factor = (1.0 + draw.random(shape) * draw.choice([0, 3, 50])).astype(np.float32)
    price = (draw.random(shape) * draw.choice([0, 3, 50])).astype(np.float32)
    starts = np.flatnonzero(free & ~ends)[: seed % 4]
    diagonal = draw.choice([1.0, DIAGONAL])
    found = costs(free, starts, factor, price, ends, diagonal)
    assert np.array_equal(found, by_heap(free, starts, factor, price, ends, diagonal))


def test_without_factors_and_prices_ways_cost_their_lengths():
    found = costs(np.ones((3, 3), np.bool_), np.array([0, 0]))
    assert found.tolist() == [[0, 1, 2], [1, DIAGONAL, 1 + DIAGONAL], [2, 1 + DIAGONAL, 2 * DIAGONAL]]
    assert np.isinf(costs(np.ones((3, 3), np.bool_), np.array([], np.int64))).all()


@pytest.mark.parametrize(("estimate", "diagonal"), [(Estimate.OCTILE, DIAGONAL), (Estimate.STRAIGHT, 1.0)])
def test_the_search_goes_straight_to_a_goal_in_the_open(estimate, diagonal):
    passable = np.ones((60, 60), bool)
    goal = 60 * 40 + 50
    ends = np.arange(passable.size).reshape(passable.shape) == goal
    looked_at = {}
    for each in (Estimate.NONE, estimate):
        last, cost, _ = _searched(passable, ends, None, None, np.array([0]), goal, each, diagonal, True)
        assert last == goal
        looked_at[each] = np.isfinite(cost).sum()
    assert looked_at[estimate] < 51 * 8, "a way of 51 cells and their neighbours"
    assert looked_at[Estimate.NONE] > 2000
