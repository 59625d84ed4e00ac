"""Value iteration: what it costs to reach a goal, from everywhere at once (paper 004, section 6).

    V(x) <- min over the eight neighbours n of x { V(n) + |x n| * price(n) },    V(goal) = 0

(W. Burgard et al., IEEE Trans. Robotics 21(3), 2005, with the price of a cell in place of its occupancy.) A step costs
its length, 1 or the square root of 2 cells, times the *price* of the cell that it enters, at least 1: a price that
grows towards obstacles keeps ways off them. No step cuts a corner, see :func:`cosim.geometry.planning.open_steps`.

The iteration converges to one fixed point, whatever the order of its updates: the costs of the cheapest ways. So
:func:`values` searches from the goals (:mod:`cosim.geometry.grid_search`, with the price as factor of the cell that is
left); it is tested against the iteration as it is printed. "It computes the distance from arbitrary starting locations,
hence is capable of recovering from unanticipated motions": a robot that has been pushed off its way needs no new plan.
"""

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int64s, Singles
from cosim.geometry.grid_search import costs
from cosim.geometry.grids import Cell
from cosim.geometry.planning import in_view, open_steps
from cosim.jit import njit

_DIAGONAL: Final = math.sqrt(2.0)


def values(free: Bools, price: Singles, goals: npt.ArrayLike) -> Floats:
    """Return the cost, in cells, of the cheapest way from each cell to one of *goals*, shape (ny, nx); inf without one.

    *free* and *price* have the shape (ny, nx); *goals* are numbers of cells, of which those that are not free are left
    out. Raise ValueError for prices below 1 or of another shape, LookupError for a goal off the grid.
    """
    known, factor, cells = _checked(free, price, goals)
    return costs(known, cells[known.flat[cells]], factor)


def _checked(free: Bools, price: Singles, goals: npt.ArrayLike) -> tuple[Bools, Singles, Int64s]:
    cells = np.asarray(goals, np.int64).reshape(-1)
    if price.shape != free.shape or not (np.asarray(price)[free] >= 1.0).all():
        raise ValueError(f"prices of shape {price.shape}, not all >= 1, do not fit a grid of shape {free.shape}")
    for cell in cells.tolist():
        if not 0 <= cell < free.size:
            raise LookupError(f"cell {cell} is off the grid of {free.shape[1]} x {free.shape[0]} cells")
    return np.ascontiguousarray(free), np.ascontiguousarray(price, np.float32), cells


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def cheapest_way(free: Bools, price: Singles, value: Floats, start: Cell) -> Any:
    """Return the cells of a cheapest way from *start* to a goal, both included; of several always the same.

    Each step leads to the neighbour over which the value came about. Empty where no way leads.
    """
    nx = free.shape[1]
    way, count = np.empty(free.size, np.int32), 0
    iy, ix = start // nx, start % nx
    if not value[iy, ix] < np.inf:
        return way[:0]
    way[0], count = start, 1
    while value[iy, ix] > 0.0:
        ix, iy = _next(free, price, value, ix, iy)
        way[count] = iy * nx + ix
        count += 1
    return way[:count].copy()


@njit(cache=True)
def _next(free: Bools, price: Singles, value: Floats, ix: int, iy: int) -> tuple[int, int]:
    best, to_x, to_y = np.inf, ix, iy
    steps = open_steps(free, free, ix, iy)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if steps >> (3 * dy + dx + 4) & 1 and value[iy + dy, ix + dx] < value[iy, ix]:
                length = _DIAGONAL if dx != 0 and dy != 0 else 1.0
                cost = value[iy + dy, ix + dx] + length * price[iy + dy, ix + dx]
                if cost < best - 1e-9:  # rounding does not choose
                    best, to_x, to_y = cost, ix + dx, iy + dy
    return to_x, to_y


@njit(cache=True)
def ahead(free: Bools, price: Singles, value: Floats, start: Cell, reach: float) -> tuple[Cell, float]:
    """Return the last cell of the cheapest way that *start* sees all the way to, within *reach* cells; and the length
    of the whole way, in cells, inf without one.

    For sight see :func:`cosim.geometry.planning.in_view`. It is the next cell at least, if that is not the goal.
    """
    nx = free.shape[1]
    iy, ix = start // nx, start % nx
    if not value[iy, ix] < np.inf:
        return start, np.inf
    seen, length, looking = start, 0.0, True
    while value[iy, ix] > 0.0:
        x, y = _next(free, price, value, ix, iy)
        length += _DIAGONAL if x != ix and y != iy else 1.0
        ix, iy = x, y
        if looking:
            cell = iy * nx + ix
            off = elementary.hypot(ix - start % nx, iy - start // nx)
            if (off <= reach and in_view(free, start, cell)) or seen == start:
                seen = cell
            else:
                looking = False
    return seen, length
