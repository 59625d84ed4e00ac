"""Cheapest ways over square cells: one search for fields of costs, prices, goals and estimates.

A step leads to one of eight neighbours; a diagonal one needs the cells on both of its sides free too (no corner is
cut). It costs

    length * factor(cell that is left) + price(cell that is entered)

with the length 1, or that of a diagonal step; factors are at least 1, prices at least 0. Ways begin at any of several
cells and lead over free ones. An *end* may be entered without being free, and is not left. This serves the wavefront
(:mod:`cosim.geometry.planning`, lengths alone), value iteration (factors) and A* (prices, and an estimate of what is
left).

Cells that promise about the same cost wait in one bucket (R. B. Dial, Communications of the ACM 12(11), 1969), from
which the last one is taken first. No step costs less than 1, so that without an estimate the cells of a bucket of 1
cannot shorten each other's ways, and no heap is needed. A cell that is reached more cheaply after it has been left is
left again (P. E. Hart, N. J. Nilsson and B. Raphael, IEEE Trans. Systems Science and Cybernetics 4(2), 1968). So costs
do not depend on the order of the search. It ends when no bucket is left that promises less than the way found.
Cells are numbered ``cell = iy * nx + ix`` as in :mod:`cosim.geometry.grids`.
"""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from cosim.arrays import Bools, Bytes, Floats, Int32s, Int64s, Singles
from cosim.geometry.grids import Cell
from cosim.jit import njit

DIAGONAL: Final = math.sqrt(2.0)


class Estimate(IntEnum):
    """Lower or other estimate of the cost from a cell to the goal."""

    NONE = 0  # Dijkstra's algorithm
    OCTILE = 1  # length of the way without obstacles
    STRAIGHT = 2  # straight line


_NO_ESTIMATE, _OCTILE = int(Estimate.NONE), int(Estimate.OCTILE)
_SLICES: Final = (1, 4, 1024)
"""Buckets to one unit of cost, for each estimate. Without one, the cells of a bucket of 1 cannot shorten each other's
ways; with the straight line, order decides, and is kept to a thousandth."""
_MOST_BUCKETS: Final = 1 << 16
"""Largest number of buckets to a ring; wider ones are used where it would take more."""
_RISE: Final = 1.0 + 2.0 * DIAGONAL
"""Greatest rise of what a cell promises over the cell from which it is entered, without prices."""
_LINKS: Final = 1 << 17
"""Number of links of a queue; a search that needs more begins again with twice as many."""
_ALIKE: Final = np.empty((0, 0), np.float32)
"""Factors of 1, or prices of 0, in all cells."""
_NONE, _FULL = -1, -2
"""No link, and too few of them."""
_SPARE, _USED, _LISTED = range(3)
"""Counters of a queue."""
_ENTERED, _PASSED, _END, _WAITING = 1, 2, 4, 8
"""Flags of a cell: it may be entered, it may be left, it is an end, and it is to be expanded."""
_UP: Final = np.array([0, 0, -1, 1, -1, -1, 1, 1])
_RIGHT: Final = np.array([-1, 1, 0, 0, -1, 1, -1, 1])
_SLANTED: Final = 4
"""Number of the first diagonal step."""


def costs(
    free: Bools,
    starts: Int64s,
    factor: Singles | None = None,
    price: Singles | None = None,
    ends: Bools | None = None,
    diagonal: float = DIAGONAL,
    stop: bool = False,
) -> Floats:
    """Return the cost of the cheapest way from one of *starts*, cells of the grid, to each cell; inf where none leads.

    *free*, *factor*, *price* and *ends* have the shape (ny, nx), as the result has. With *stop* the search ends at the
    cheapest of *ends*: then only costs up to its own are told, and what costs more is too much or inf.
    """
    nothing = np.zeros(free.shape, np.bool_) if ends is None else ends
    _, cost, _ = _searched(free, nothing, factor, price, starts, -1, Estimate.NONE, diagonal, stop)
    return cost.reshape(free.shape)


def cheapest_way(
    free: Bools, ends: Bools, price: Singles, start: Cell, goal: Cell, estimate: Estimate, diagonal: float = DIAGONAL
) -> Int32s | None:
    """Return the cells of a way from *start* to the first of *ends* that is final, both included; None if none leads.

    *free*, *ends* and *price* have the shape (ny, nx). The estimate is that of the rest to *goal*, a cell; without an
    estimate *goal* has no meaning. The way is a cheapest one if the estimate is never too much.
    """
    last, _, before = _searched(free, ends, None, price, np.array([start]), goal, estimate, diagonal, True)
    return _unwound(before, last) if last >= 0 else None


def _searched(
    free: Bools,
    ends: Bools,
    factor: Singles | None,
    price: Singles | None,
    starts: Int64s,
    goal: Cell,
    estimate: Estimate,
    diagonal: float,
    stop: bool,
) -> tuple[int, Floats, Int32s]:
    """Return what :func:`_search` finds with as many links as it needs."""
    factors, prices = (_ALIKE if each is None else each for each in (factor, price))
    rise = _greatest(prices, 0.0) + (_greatest(factors, 1.0) - 1.0) * DIAGONAL
    links = _LINKS
    while True:
        found = _search(free, ends, factors, prices, rise, starts, goal, int(estimate), diagonal, stop, links)
        if found[0] != _FULL:
            return found
        links *= 2


def _greatest(weights: Singles, least: float) -> float:
    """Return the greatest finite one of the *weights*, or *least* if there is none above it."""
    greatest = float(weights.max(initial=least))
    return greatest if greatest < math.inf else float(weights[weights < math.inf].max(initial=least))


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _search(
    free: Bools,
    ends: Bools,
    factor: Singles,
    price: Singles,
    rise: float,
    starts: Int64s,
    goal: int,
    estimate: int,
    diagonal: float,
    stop: bool,
    links: int,
) -> tuple[int, Floats, Int32s]:
    """Return the cheapest of *ends* (-1: none; all cells are expanded without *stop*), costs, and cells before, flat.

    *rise* is by how much prices and factors make a step dearer at most. -2: there are not enough *links* for the queue.
    One bucket after the other is emptied. If no estimate is too much, a cell is left again within a bucket only.
    """
    state, factors, prices = _bordered(free, ends), factor.ravel(), price.ravel()
    nx = free.shape[1]
    wide, goal_x, goal_y = nx + 2, goal % nx, goal // nx
    slices, first = _buckets(rise, estimate)
    held, after, count = np.empty(links, np.int32), np.empty(links, np.int32), np.array([_NONE, 0, 0])
    cost, before = np.full(free.size, np.inf), np.empty(free.size, np.int32)
    bucket, last, best = 0, -1, np.inf
    for start in starts:
        if cost[start] > 0.0:
            cost[start], before[start] = 0.0, start
            x, y, at = _place(start, nx)
            state[at] |= _WAITING
            bucket = int(slices * _estimate(x, y, goal_x, goal_y, estimate))
            _put(first, held, after, count, bucket, start)
    while count[_LISTED] > 0 and bucket <= best * slices:
        cell = _taken(first, held, after, count, bucket)
        if cell == _NONE:
            bucket += 1
            continue
        x, y, at = _place(cell, nx)
        if not state[at] & _WAITING:
            continue  # it was listed twice
        state[at] ^= _WAITING
        if stop and state[at] & _END:
            last, best = (cell, cost[cell]) if cost[cell] < best else (last, best)
        elif state[at] & _PASSED or before[cell] == cell:
            if count[_USED] + 8 > links:
                return _FULL, cost, before
            steps, times = _steps(state, at, wide), factors[cell] if factors.size else 1.0
            for k in range(8):
                if not steps >> k & 1:
                    continue
                # an unsigned index is not asked whether it counts from the end
                to = np.uint64(cell + _UP[k] * nx + _RIGHT[k])
                length = cost[cell] + (diagonal if k >= _SLANTED else 1.0) * times
                length += prices[to] if prices.size else 0.0
                promise = length + _estimate(x + _RIGHT[k], y + _UP[k], goal_x, goal_y, estimate)
                if length < cost[to] and promise < best:
                    cost[to], before[to] = length, cell
                    state[np.uint64(at + _UP[k] * wide + _RIGHT[k])] |= _WAITING
                    _put(first, held, after, count, max(int(promise * slices), bucket), int(to))
    return last, cost, before


@njit(cache=True, borrows=True)
def _place(cell: int, nx: int) -> tuple[int, int, int]:
    """Return the column and the row of a cell, and its number where there is a border."""
    x, y = cell % nx, cell // nx
    return x, y, (y + 1) * (nx + 2) + x + 1


@njit(cache=True)
def _bordered(free: Bools, ends: Bools) -> Bytes:
    """Return flags of cells, flat, with a border of one cell that no way enters."""
    ny, nx = free.shape
    state = np.zeros((ny + 2, nx + 2), np.uint8)
    for iy in range(ny):
        for ix in range(nx):
            state[iy + 1, ix + 1] = free[iy, ix] * (_ENTERED | _PASSED) | ends[iy, ix] * (_ENTERED | _END)
    return state.ravel()


@njit(cache=True, borrows=True)
def _steps(state: Bytes, cell: int, wide: int) -> int:
    """Return the steps from a cell to those that may be entered: bit k is that by _UP[k] and _RIGHT[k].

    As :func:`cosim.geometry.planning.open_steps`: a slanted one leads past two cells that may be passed.
    """
    left, right, below, above = state[cell - 1], state[cell + 1], state[cell - wide], state[cell + wide]
    steps = (left & 1) | (right & 1) << 1 | (below & 1) << 2 | (above & 1) << 3
    steps |= ((below & left) >> 1 & state[cell - wide - 1] & 1) << 4
    steps |= ((below & right) >> 1 & state[cell - wide + 1] & 1) << 5
    steps |= ((above & left) >> 1 & state[cell + wide - 1] & 1) << 6
    steps |= ((above & right) >> 1 & state[cell + wide + 1] & 1) << 7
    return int(steps)


@njit(cache=True, borrows=True)
def _estimate(x: int, y: int, goal_x: int, goal_y: int, estimate: int) -> float:
    if estimate == _NO_ESTIMATE:
        return 0.0
    way_x, way_y = float(abs(x - goal_x)), float(abs(y - goal_y))
    if estimate == _OCTILE:
        return max(way_x, way_y) + (DIAGONAL - 1.0) * min(way_x, way_y)
    return math.sqrt(way_x * way_x + way_y * way_y)


@njit(cache=True)
def _buckets(rise: float, estimate: int) -> tuple[float, Int32s]:
    """Return how many buckets there are to one unit of cost, and a ring of them, empty: the first link of each.

    It holds promises up to that of a step from the bucket that is being emptied.
    """
    most, slices, ring = rise + _RISE, float(_SLICES[estimate]), 1
    while most * slices > _MOST_BUCKETS:
        slices *= 0.5
    while ring < most * slices + 2.0:
        ring *= 2
    return slices, np.full(ring, _NONE, np.int32)


@njit(cache=True, borrows=True)
def _put(first: Int32s, held: Int32s, after: Int32s, count: Int64s, bucket: int, cell: int) -> None:
    """Put a cell before those of a bucket: a link holds a cell and the number of the next link."""
    at, link = bucket & (first.size - 1), count[_SPARE]
    if link == _NONE:
        link = count[_USED]
        count[_USED] += 1
    else:
        count[_SPARE] = after[link]
    held[link], after[link], first[at] = cell, first[at], link
    count[_LISTED] += 1


@njit(cache=True, borrows=True)
def _taken(first: Int32s, held: Int32s, after: Int32s, count: Int64s, bucket: int) -> int:
    """Return the cell that was put last into a bucket, and take it away; _NONE if the bucket is empty."""
    at = bucket & (first.size - 1)
    link = first[at]
    if link == _NONE:
        return _NONE
    first[at], after[link], count[_SPARE] = after[link], count[_SPARE], link
    count[_LISTED] -= 1
    cell: int = held[link]
    return cell


@njit(cache=True)
def _unwound(before: Int32s, last: int) -> Int32s:
    """Return the cells of the way to a cell."""
    count, cell = 1, last
    while cell != before[cell]:
        cell = before[cell]
        count += 1
    way = np.empty(count, np.int32)
    cell = last
    for k in range(count - 1, -1, -1):
        way[k] = cell
        cell = before[cell]
    return way
