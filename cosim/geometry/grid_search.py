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
"""Factors of 1 in all cells."""
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
    ny, nx = free.shape
    return np.ascontiguousarray(cost.reshape(ny + 2, nx + 2)[1:-1, 1:-1])


def cheapest_way(
    free: Bools, ends: Bools, price: Singles, start: Cell, goal: Cell, estimate: Estimate, diagonal: float = DIAGONAL
) -> Int32s | None:
    """Return the cells of a way from *start* to the first of *ends* that is final, both included; None if none leads.

    *free*, *ends* and *price* have the shape (ny, nx). The estimate is that of the rest to *goal*, a cell; without an
    estimate *goal* has no meaning. The way is a cheapest one if the estimate is never too much.
    """
    last, _, before = _searched(free, ends, None, price, np.array([start]), goal, estimate, diagonal, True)
    return _unwound(before, last, free.shape[1] + 2) if last >= 0 else None


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
    factors = _ALIKE if factor is None else factor
    prices = np.zeros(free.shape, np.float32) if price is None else price
    links = _LINKS
    while True:
        found = _search(free, ends, factors, prices, starts, goal, int(estimate), diagonal, stop, links)
        if found[0] != _FULL:
            return found
        links *= 2


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _search(
    free: Bools,
    ends: Bools,
    factor: Singles,
    price: Singles,
    starts: Int64s,
    goal: int,
    estimate: int,
    diagonal: float,
    stop: bool,
    links: int,
) -> tuple[int, Floats, Int32s]:
    """Return the cheapest of *ends* (-1: none; all cells are expanded without *stop*), costs, and cells before.

    All are of the grid with a border of one cell, flat. -2: there are not enough *links* for the queue.
    One bucket after the other is emptied. If no estimate is too much, a cell is left again within a bucket only.
    """
    state, prices, dearest = _bordered(free, ends, price)
    factors, steepest = _weights(factor)
    nx = free.shape[1]
    wide, goal_x, goal_y = nx + 2, goal % nx + 1, goal // nx + 1
    slices, first = _buckets(dearest + (steepest - 1.0) * DIAGONAL, estimate)
    held, after, count = np.empty(links, np.int32), np.empty(links, np.int32), np.array([_NONE, 0, 0])
    cost, before = np.full(state.size, np.inf), np.empty(state.size, np.int32)
    bucket = 0
    for start in starts:
        origin = (start // nx + 1) * wide + start % nx + 1
        if cost[origin] > 0.0:
            cost[origin], before[origin] = 0.0, origin
            state[origin] |= _WAITING
            bucket = int(slices * _estimate(origin % wide, origin // wide, goal_x, goal_y, estimate))
            _put(first, held, after, count, bucket, origin)
    last, best = -1, np.inf
    while count[_LISTED] > 0 and bucket <= best * slices:
        cell = _taken(first, held, after, count, bucket)
        if cell == _NONE:
            bucket += 1
            continue
        if not state[cell] & _WAITING:
            continue  # it was listed twice
        state[cell] ^= _WAITING
        if stop and state[cell] & _END:
            if cost[cell] < best:
                last, best = cell, cost[cell]
        elif state[cell] & _PASSED or before[cell] == cell:
            if count[_USED] + 8 > links:
                return _FULL, cost, before
            steps, x, y = _steps(state, cell, wide), cell % wide, cell // wide
            times = factors[cell] if factors.size else 1.0
            for k in range(8):
                to = cell + _UP[k] * wide + _RIGHT[k]
                length = cost[cell] + (diagonal if k >= _SLANTED else 1.0) * times + prices[to]
                if not steps >> k & 1 or length >= cost[to]:
                    continue
                promise = length + _estimate(x + _RIGHT[k], y + _UP[k], goal_x, goal_y, estimate)
                if promise < best:
                    cost[to], before[to] = length, cell
                    state[to] |= _WAITING
                    _put(first, held, after, count, max(int(promise * slices), bucket), to)
    return last, cost, before


@njit(cache=True)
def _bordered(free: Bools, ends: Bools, price: Singles) -> tuple[Bytes, Singles, float]:
    """Return flags and prices of cells, flat, with a border that no way enters, and the greatest finite price."""
    ny, nx = free.shape
    state, prices = np.zeros((ny + 2, nx + 2), np.uint8), np.zeros((ny + 2, nx + 2), np.float32)
    dearest = 0.0
    for iy in range(ny):
        for ix in range(nx):
            passed = _ENTERED | _PASSED if free[iy, ix] else 0
            state[iy + 1, ix + 1] = passed | (_ENTERED | _END if ends[iy, ix] else 0)
            prices[iy + 1, ix + 1] = price[iy, ix]
            if dearest < price[iy, ix] < np.inf:
                dearest = float(price[iy, ix])
    return state.ravel(), prices.ravel(), dearest


@njit(cache=True)
def _weights(factor: Singles) -> tuple[Singles, float]:
    """Return the factors, flat, with a border, and the greatest finite one; nothing, and 1, where all are 1."""
    ny, nx = factor.shape
    factors, steepest = np.zeros((ny + 2, nx + 2) if factor.size else (0, 0), np.float32), 1.0
    for iy in range(ny):
        for ix in range(nx):
            factors[iy + 1, ix + 1] = factor[iy, ix]
            if steepest < factor[iy, ix] < np.inf:
                steepest = float(factor[iy, ix])
    return factors.ravel(), steepest


@njit(cache=True)
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


@njit(cache=True)
def _estimate(x: int, y: int, goal_x: int, goal_y: int, estimate: int) -> float:
    if estimate == _NO_ESTIMATE:
        return 0.0
    way_x, way_y = float(abs(x - goal_x)), float(abs(y - goal_y))
    if estimate == _OCTILE:
        return max(way_x, way_y) + (DIAGONAL - 1.0) * min(way_x, way_y)
    return math.sqrt(way_x * way_x + way_y * way_y)


@njit(cache=True)
def _buckets(dearest: float, estimate: int) -> tuple[float, Int32s]:
    """Return how many buckets there are to one unit of cost, and a ring of them, empty: the first link of each.

    It holds promises up to that of a step from the bucket that is being emptied.
    """
    rise, slices, ring = dearest + _RISE, float(_SLICES[estimate]), 1
    while rise * slices > _MOST_BUCKETS:
        slices *= 0.5
    while ring < rise * slices + 2.0:
        ring *= 2
    return slices, np.full(ring, _NONE, np.int32)


@njit(cache=True)
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


@njit(cache=True)
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
def _unwound(before: Int32s, last: int, wide: int) -> Int32s:
    """Return the way to a cell of the grid with its border, in cells of the grid without."""
    count, cell = 1, last
    while cell != before[cell]:
        cell = before[cell]
        count += 1
    way = np.empty(count, np.int32)
    cell = last
    for k in range(count - 1, -1, -1):
        way[k] = (cell // wide - 1) * (wide - 2) + cell % wide - 1
        cell = before[cell]
    return way
