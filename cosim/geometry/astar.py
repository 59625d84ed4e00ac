"""Ways through the known part of a map: A* with a cost for being near to obstacles, and ways to the nearest frontier.

A step enters one of eight neighbours and never cuts a corner, see :func:`cosim.geometry.planning.open_steps`. It
costs its length and the *extra* cost of the entered cell, not negative, see :func:`clearance_cost`. Ways lead over
*passable* cells; a goal need not be passable (a frontier's cell is unknown): it is entered and not left. Nor need the
start be. Two readings of "length" and of the estimate that guides the search:

- ``octile``: steps are 1 or the square root of 2 cells long; the estimate is the length of the way without obstacles.
  It is never too much and differs between neighbours by at most a step (P. E. Hart, N. J. Nilsson and B. Raphael, IEEE
  Trans. Systems Science and Cybernetics 4(2), 1968): the way found is a cheapest one.
- ``printed``: the reading of section 3.6 of paper 001. Every step is 1 long, a diagonal one too; the estimate is the
  straight line. It may be too much, as the paper says; with four neighbours it would not be, so the paper's steps are
  eight. No straight line is longer than the square root of 2 times the way of the fewest steps, so a way found costs at
  most that many times the cheapest.

A cell that is reached more cheaply after it has been left is left again, as in the paper of 1968. Cells that promise
about the same cost wait in one bucket (R. B. Dial, Communications of the ACM 12(11), 1969), from which the last one is
taken first; the search ends when no bucket is left that promises less than the way found.
Cells are numbered ``cell = iy * nx + ix`` as in :mod:`cosim.geometry.grids`.
"""

import math
from typing import Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Bytes, Floats, Int32s, Int64s, Singles
from cosim.geometry.grids import Cell
from cosim.geometry.planning import grown, in_view, obstacle_distance
from cosim.jit import njit

Reading: TypeAlias = Literal["octile", "printed"]

_DIAGONAL: Final = math.sqrt(2.0)
_BESIDE: Final = 0.5
"""How far the centre of a cell is from an obstacle beside it, in cells."""
_BLIND, _OCTILE, _STRAIGHT = range(3)
"""Estimates of what is left: none (Dijkstra's algorithm), and those of the readings."""
_SLICES: Final = (1, 4, 1024)
"""Buckets to one unit of cost, for each of the estimates. Without one, cells of a bucket of 1 cannot shorten each
other's ways; with that of ``printed``, order decides, and is kept to a thousandth."""
_MOST_BUCKETS: Final = 1 << 16
"""Buckets are wider rather than more."""
_RISE: Final = 1.0 + 2.0 * _DIAGONAL
"""By less than this, and the extra cost, a cell promises more than that from which it is entered."""
_LINKS: Final = 1 << 17
"""So many a queue has; a search that needs more begins anew with twice as many."""
_NONE, _FULL = -1, -2
"""No link, and too few of them."""
_SPARE, _USED, _LISTED = range(3)
"""What a queue counts."""
_ENTERED, _PASSED, _END, _WAITING = 1, 2, 4, 8
"""What a cell is: it may be entered, it may be left, it is an end, and it is to be looked at."""
_UP: Final = np.array([0, 0, -1, 1, -1, -1, 1, 1])
_RIGHT: Final = np.array([-1, 1, 0, 0, -1, 1, -1, 1])
_SLANTED: Final = 4
"""From this step on they are diagonal."""


# ---------------------------------------------------------------- where to go, and what it costs


def passable_cells(evidence: npt.ArrayLike, radius_cells: float) -> Bools:
    """Return the cells known to be empty in which a disc of *radius_cells* overlaps no occupied one, shape (ny, nx).

    *evidence*, shape (ny, nx), is negative where a cell is empty and positive where it is occupied. The disc may
    overlap unknown cells; what lies beyond the grid is occupied.
    """
    known = np.asarray(evidence)
    return np.ascontiguousarray((known < 0) & ~grown(known > 0, radius_cells))


def clearance_cost(occupied: npt.ArrayLike, range_cells: float, most: float) -> Singles:
    """Return what it costs to enter each cell, beside its length: *most* beside an obstacle, 0 from *range_cells* on.

    It falls linearly with the distance between the cell's centre and the nearest *occupied* cell, shape (ny, nx); what
    lies beyond the grid is occupied. Raise ValueError if *most* is negative or *range_cells* is not more than half a
    cell, the distance of a cell beside an obstacle.
    """
    if not (range_cells > _BESIDE and most >= 0.0):
        raise ValueError(f"range {range_cells} cells is not > {_BESIDE}, or the most, {most}, is not >= 0")
    nearness = (range_cells - obstacle_distance(occupied, range_cells)) / (range_cells - _BESIDE)
    return np.asarray(most * np.clip(nearness, 0.0, 1.0), np.float32)


def in_sight(clear: Bools, cell: Cell, targets: npt.ArrayLike) -> Bools:
    """Return those *targets*, shape (ny, nx), that *cell* sees over cells that are *clear* or targets themselves.

    Sight is that of :func:`cosim.geometry.planning.in_view`: no line meets any other cell. Clear are the cells known to
    be empty; so sight ends at the first unknown cell, which is a frontier itself.
    """
    wanted = _mask(targets, clear)
    through = clear | wanted
    through.flat[cell] = True
    return _in_sight(through, cell, wanted)


def lookouts(passable: Bools, clear: Bools, targets: npt.ArrayLike, reach_cells: float) -> Bools:
    """Return the *passable* cells that have one of *targets* in sight within *reach_cells* (centre to centre).

    These are the goals of a robot too wide for the targets themselves, frontiers beside a wall. For sight and *clear*
    see :func:`in_sight`.
    """
    wanted = _mask(targets, clear)
    return _lookouts(passable, clear | wanted, wanted, float(reach_cells))


# ---------------------------------------------------------------- ways


def astar(passable: Bools, extra: Singles, start: Cell, goal: Cell, reading: Reading = "octile") -> Int32s | None:
    """Return the cells of a way from *start* to *goal*, both included, or None if there is none.

    *passable* and *extra* have the shape (ny, nx). Raise LookupError if start or goal is off the grid.
    """
    _check_cell(passable, goal)
    ends = np.zeros(passable.shape, np.bool_)
    ends.flat[goal] = True
    return _way(passable, ends, extra, start, goal, reading)


def nearest(
    passable: Bools, extra: Singles, start: Cell, goals: npt.ArrayLike, reading: Reading = "octile"
) -> Int32s | None:
    """Return the cells of a cheapest way from *start* to the cheapest of *goals*, shape (ny, nx), or None.

    Dijkstra's algorithm up to the first goal: of the *reading*, only the lengths of the steps matter. Columns of
    *goals* beyond the grid's are left out. Raise LookupError for a start off the grid.
    """
    return _way(passable, _mask(goals, passable), extra, start, -1, reading)


def nearest_frontier(
    passable: Bools, clear: Bools, extra: Singles, start: Cell, frontier: npt.ArrayLike, reading: Reading = "octile"
) -> Int32s | None:
    """Return a way from *start* to the nearest cell of *frontier*, shape (ny, nx), if possible one in sight, or None.

    Those in sight of the start (:func:`in_sight`) have the absolute preference of paper 001, section 3.6; a frontier to
    which no way leads is none. The paper does not say how "nearest" is measured. ``octile`` takes the frontier of the
    cheapest way. ``printed`` takes the one nearest in a straight line, and goes there by :func:`astar`: its estimate
    needs a goal. Raise LookupError for a start off the grid.
    """
    _check_cell(passable, start)
    goals = _mask(frontier, passable)
    seen = in_sight(clear, start, goals)
    if reading == "octile":
        way = nearest(passable, extra, start, seen) if seen.any() else None
        return way if way is not None else nearest(passable, extra, start, goals)
    reached = goals & np.isfinite(costs_from(passable, extra, start, goals, reading))
    cells = np.flatnonzero(seen & reached if (seen & reached).any() else reached)
    if not len(cells):
        return None
    nx = passable.shape[1]
    squares = (cells % nx - start % nx) ** 2 + (cells // nx - start // nx) ** 2
    return astar(passable, extra, start, int(cells[squares.argmin()]), reading)


def costs_from(
    passable: Bools,
    extra: Singles,
    start: Cell,
    ends: npt.ArrayLike | None = None,
    reading: Reading = "octile",
) -> Floats:
    """Return the cost of the cheapest way from *start* to each cell, shape (ny, nx), inf where none leads.

    *ends*, shape (ny, nx), may be entered although they are not passable; no way leads over them. Columns beyond the
    grid's are left out. This is what value iteration over the same steps converges to (the costs V of W. Burgard,
    M. Moors, C. Stachniss and F. E. Schneider, IEEE Trans. Robotics 21(3), 2005). Raise LookupError for a start off the
    grid.
    """
    _check(passable, extra, start)
    mask = np.zeros(passable.shape, np.bool_) if ends is None else _mask(ends, passable)
    _, cost, _ = _searched(passable, mask, extra, start, -1, _BLIND, reading, False)
    ny, nx = passable.shape
    return np.ascontiguousarray(np.asarray(cost).reshape(ny + 2, nx + 2)[1:-1, 1:-1])


def _way(passable: Bools, ends: Bools, extra: Singles, start: Cell, goal: Cell, reading: Reading) -> Int32s | None:
    """Return a way to the first of *ends* that is final; the search is blind with *goal* -1."""
    _check(passable, extra, start)
    estimate = _BLIND if goal < 0 else _OCTILE if reading == "octile" else _STRAIGHT
    last, _, before = _searched(passable, ends, extra, start, goal, estimate, reading, True)
    return _unwound(before, last, passable.shape[1] + 2) if last >= 0 else None


def _searched(
    free: Bools, ends: Bools, extra: Singles, start: Cell, goal: Cell, estimate: int, reading: Reading, stop: bool
) -> tuple[int, Floats, Int32s]:
    """Return what :func:`_search` finds with as many links as it needs."""
    diagonal, links = (_DIAGONAL if reading == "octile" else 1.0), _LINKS
    while True:
        found = _search(free, ends, extra, start, goal, estimate, diagonal, stop, links)
        if found[0] != _FULL:
            return found
        links *= 2


def _mask(cells: npt.ArrayLike, grid: Bools) -> Bools:
    return np.ascontiguousarray(np.asarray(cells)[:, : grid.shape[1]], np.bool_)


def _check(passable: Bools, extra: Singles, start: Cell) -> None:
    _check_cell(passable, start)
    if extra.shape != passable.shape:
        raise ValueError(f"extra costs of shape {extra.shape} do not fit a grid of shape {passable.shape}")


def _check_cell(grid: Bools, cell: Cell) -> None:
    if not 0 <= cell < grid.size:
        raise LookupError(f"cell {cell} is off the grid of {grid.shape[1]} x {grid.shape[0]} cells")


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _search(
    free: Bools,
    ends: Bools,
    extra: Singles,
    start: int,
    goal: int,
    estimate: int,
    diagonal: float,
    stop: bool,
    links: int,
) -> tuple[int, Floats, Int32s]:
    """Return the cheapest of *ends* (-1: none; all cells are looked at without *stop*), costs, and cells before.

    All are of the grid with a border of one cell, flat. -2: there are not enough *links* for the queue.
    One bucket after the other is emptied. A cell that is reached more cheaply after it has been left is left again; if
    no estimate is too much that happens within a bucket only.
    """
    state, prices, dearest = _bordered(free, ends, extra)
    nx = free.shape[1]
    wide, goal_x, goal_y = nx + 2, goal % nx + 1, goal // nx + 1
    origin = (start // nx + 1) * wide + start % nx + 1
    slices, first = _buckets(dearest, estimate)
    held, after, count = np.empty(links, np.int32), np.empty(links, np.int32), np.array([_NONE, 0, 0])
    cost, before = np.full(state.size, np.inf), np.empty(state.size, np.int32)
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
        elif state[cell] & _PASSED or cell == origin:
            if count[_USED] + 8 > links:
                return _FULL, cost, before
            steps, x, y = _steps(state, cell, wide), cell % wide, cell // wide
            for k in range(8):
                to = cell + _UP[k] * wide + _RIGHT[k]
                length = cost[cell] + (diagonal if k >= _SLANTED else 1.0) + prices[to]
                if not steps >> k & 1 or length >= cost[to]:
                    continue
                promise = length + _estimate(x + _RIGHT[k], y + _UP[k], goal_x, goal_y, estimate)
                if promise < best:
                    cost[to], before[to] = length, cell
                    state[to] |= _WAITING
                    _put(first, held, after, count, max(int(promise * slices), bucket), to)
    return last, cost, before


@njit(cache=True)
def _bordered(free: Bools, ends: Bools, extra: Singles) -> tuple[Bytes, Singles, float]:
    """Return what cells are and what they cost, flat, with a border that nobody enters, and the greatest cost."""
    ny, nx = free.shape
    state, prices = np.zeros((ny + 2, nx + 2), np.uint8), np.zeros((ny + 2, nx + 2), np.float32)
    dearest = 0.0
    for iy in range(ny):
        for ix in range(nx):
            passed = _ENTERED | _PASSED if free[iy, ix] else 0
            state[iy + 1, ix + 1] = passed | (_ENTERED | _END if ends[iy, ix] else 0)
            prices[iy + 1, ix + 1] = extra[iy, ix]
            if dearest < extra[iy, ix] < np.inf:
                dearest = float(extra[iy, ix])
    return state.ravel(), prices.ravel(), dearest


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
    if estimate == _BLIND:
        return 0.0
    way_x, way_y = float(abs(x - goal_x)), float(abs(y - goal_y))
    if estimate == _STRAIGHT:
        return math.sqrt(way_x * way_x + way_y * way_y)
    return max(way_x, way_y) + (_DIAGONAL - 1.0) * min(way_x, way_y)


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
    """Put a cell before those of a bucket: a link holds a cell, and says which is the next one."""
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


@njit(cache=True)
def _in_sight(through: Bools, cell: int, targets: Bools) -> Bools:
    seen = np.zeros_like(targets)
    ny, nx = targets.shape
    for iy in range(ny):
        for ix in range(nx):
            if targets[iy, ix]:
                seen[iy, ix] = in_view(through, cell, iy * nx + ix)
    return seen


@njit(cache=True)
def _lookouts(passable: Bools, through: Bools, targets: Bools, reach: float) -> Bools:
    ny, nx = targets.shape
    found = np.zeros_like(targets)
    cells = int(reach)
    for iy in range(ny):
        for ix in range(nx):
            if not targets[iy, ix]:
                continue
            for y in range(max(iy - cells, 0), min(iy + cells + 1, ny)):
                for x in range(max(ix - cells, 0), min(ix + cells + 1, nx)):
                    near = (x - ix) ** 2 + (y - iy) ** 2 <= reach * reach
                    if near and passable[y, x] and not found[y, x]:
                        found[y, x] = in_view(through, iy * nx + ix, y * nx + x)
    return found
