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

The search itself is :mod:`cosim.geometry.grid_search`.
Cells are numbered ``cell = iy * nx + ix`` as in :mod:`cosim.geometry.grids`.
"""

from typing import Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats, Int32s, Singles
from cosim.geometry.grid_search import DIAGONAL, Estimate, cheapest_way, costs
from cosim.geometry.grids import Cell
from cosim.geometry.planning import grown, in_view, obstacle_distance
from cosim.jit import njit

Reading: TypeAlias = Literal["octile", "printed"]

_BESIDE: Final = 0.5
"""Distance between the centre of a cell and an obstacle beside it, in cells."""


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
    mask = None if ends is None else _mask(ends, passable)
    return costs(passable, np.array([start]), price=extra, ends=mask, diagonal=_diagonal(reading))


def _way(passable: Bools, ends: Bools, extra: Singles, start: Cell, goal: Cell, reading: Reading) -> Int32s | None:
    """Return a way to the first of *ends* that is final; the search is blind with *goal* -1."""
    _check(passable, extra, start)
    estimate = Estimate.NONE if goal < 0 else Estimate.OCTILE if reading == "octile" else Estimate.STRAIGHT
    return cheapest_way(passable, ends, extra, start, goal, estimate, _diagonal(reading))


def _diagonal(reading: Reading) -> float:
    """Return the length of a diagonal step."""
    return DIAGONAL if reading == "octile" else 1.0


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
