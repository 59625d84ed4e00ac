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

A cell that is reached more cheaply after it has been left is left again, as in the paper of 1968. Of cells that promise
the same cost, that nearer to the goal is looked at first: its estimate counts for a billionth more, and by so much may
a way be dearer than the cheapest.
Cells are numbered ``cell = iy * nx + ix`` as in :mod:`cosim.geometry.grids`.
"""

import math
from typing import Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.geometry.grids import Cell
from cosim.geometry.planning import Bools, Floats, Ints, Singles, grown, in_view, obstacle_distance, open_steps
from cosim.jit import njit

Reading: TypeAlias = Literal["octile", "printed"]

_DIAGONAL: Final = math.sqrt(2.0)
_EAGER: Final = 1.0 + 1e-9
"""What an estimate is multiplied by, so that of equal cells the one nearer to the goal is looked at first."""
_BESIDE: Final = 0.5
"""How far the centre of a cell is from an obstacle beside it, in cells."""
_NOWHERE: Final = -1
"""The place of a cell that is not in the queue."""
_BLIND, _OCTILE, _STRAIGHT = range(3)
"""Estimates of what is left: none (Dijkstra's algorithm), and those of the readings."""


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


def astar(passable: Bools, extra: Singles, start: Cell, goal: Cell, reading: Reading = "octile") -> Ints | None:
    """Return the cells of a way from *start* to *goal*, both included, or None if there is none.

    *passable* and *extra* have the shape (ny, nx). Raise LookupError if start or goal is off the grid.
    """
    _check_cell(passable, goal)
    ends = np.zeros(passable.shape, np.bool_)
    ends.flat[goal] = True
    return _way(passable, ends, extra, start, goal, reading)


def nearest(
    passable: Bools, extra: Singles, start: Cell, goals: npt.ArrayLike, reading: Reading = "octile"
) -> Ints | None:
    """Return the cells of a cheapest way from *start* to the cheapest of *goals*, shape (ny, nx), or None.

    Dijkstra's algorithm up to the first goal: of the *reading*, only the lengths of the steps matter. Columns of
    *goals* beyond the grid's are left out. Raise LookupError for a start off the grid.
    """
    return _way(passable, _mask(goals, passable), extra, start, -1, reading)


def nearest_frontier(
    passable: Bools, clear: Bools, extra: Singles, start: Cell, frontier: npt.ArrayLike, reading: Reading = "octile"
) -> Ints | None:
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
    _, cost, _ = _search(passable, mask, extra, start, -1, _BLIND, _diagonal(reading), False)
    return np.asarray(cost).reshape(passable.shape)


def _way(passable: Bools, ends: Bools, extra: Singles, start: Cell, goal: Cell, reading: Reading) -> Ints | None:
    """Return a way to the first of *ends* that is final; the search is blind with *goal* -1."""
    _check(passable, extra, start)
    estimate = _BLIND if goal < 0 else _OCTILE if reading == "octile" else _STRAIGHT
    last, _, before = _search(passable, ends, extra, start, goal, estimate, _diagonal(reading), True)
    return _unwound(before, start, last) if last >= 0 else None


def _diagonal(reading: Reading) -> float:
    return _DIAGONAL if reading == "octile" else 1.0


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
) -> tuple[int, Floats, Ints]:
    """Return the first of *ends* that is final (-1: none; all are looked at without *stop*), costs, cells before.

    The queue is a binary heap of cells, by cost so far and estimate; ``place`` says where in it a cell is.
    """
    nx, enterable, prices = free.shape[1], free | ends, extra.ravel()
    goal_x, goal_y = goal % nx, goal // nx
    cost, before = np.full(free.size, np.inf), np.empty(free.size, np.int32)
    heap, keys, place = np.empty(free.size, np.int32), np.empty(free.size), np.full(free.size, _NOWHERE, np.int32)
    cost[start], before[start] = 0.0, start
    heap[0], keys[0], place[start], size = start, 0.0, 0, 1
    while size > 0:
        cell, size = heap[0], size - 1
        _take_first(heap, keys, place, size)
        iy, ix = cell // nx, cell % nx
        if stop and ends[iy, ix]:
            return cell, cost, before
        if not free[iy, ix] and cell != start:
            continue
        steps = open_steps(free, enterable, ix, iy)
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if not steps >> (3 * dy + dx + 4) & 1:
                    continue
                to = cell + dy * nx + dx
                length = cost[cell] + (diagonal if dx != 0 and dy != 0 else 1.0) + prices[to]
                if length >= cost[to]:
                    continue
                cost[to], before[to] = length, cell
                if place[to] == _NOWHERE:
                    place[to] = size
                    size += 1
                key = length + _EAGER * _estimate(ix + dx, iy + dy, goal_x, goal_y, estimate)
                _put(heap, keys, place, to, key)
    return -1, cost, before


@njit(cache=True)
def _estimate(x: int, y: int, goal_x: int, goal_y: int, estimate: int) -> float:
    if estimate == _BLIND:
        return 0.0
    way_x, way_y = float(abs(x - goal_x)), float(abs(y - goal_y))
    if estimate == _STRAIGHT:
        return math.sqrt(way_x * way_x + way_y * way_y)
    return max(way_x, way_y) + (_DIAGONAL - 1.0) * min(way_x, way_y)


@njit(cache=True)
def _put(heap: Ints, keys: Floats, place: Ints, cell: int, key: float) -> None:
    """Put a cell into a heap at its place, which is vacant or has held itself or a dearer one, or above it."""
    at = place[cell]
    while at > 0 and keys[(at - 1) >> 1] > key:
        above = (at - 1) >> 1
        heap[at], keys[at] = heap[above], keys[above]
        place[heap[at]] = at
        at = above
    heap[at], keys[at], place[cell] = cell, key, at


@njit(cache=True)
def _take_first(heap: Ints, keys: Floats, place: Ints, size: int) -> None:
    """Take the first cell away from a heap, of which *size* are left.

    The gap sinks to the bottom before the last cell fills it: on the way no jump depends on a key, for the processor to
    guess wrong.
    """
    place[heap[0]] = _NOWHERE
    if size == 0:
        return
    cell, key, at, below = heap[size], keys[size], 0, 1
    keys[size] = np.inf
    while below < size:
        below += int(keys[below + 1] < keys[below])
        heap[at], keys[at] = heap[below], keys[below]
        place[heap[at]] = at
        at, below = below, 2 * below + 1
    place[cell] = at
    _put(heap, keys, place, cell, key)


@njit(cache=True)
def _unwound(before: Ints, start: int, last: int) -> Ints:
    count, cell = 1, last
    while cell != start:
        cell = before[cell]
        count += 1
    way = np.empty(count, np.int32)
    cell = last
    for k in range(count - 1, -1, -1):
        way[k] = cell
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
