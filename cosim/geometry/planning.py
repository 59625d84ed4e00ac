"""Ways over a floor of square cells: the wavefront planner, and way points that see each other.

A grid of booleans marks the cells in which the centre of a robot may be: obstacles are grown by the robot's radius, so
that the robot is a point. A step leads to one of eight neighbours and costs its length, 1 or the square root of 2
cells; a diagonal step needs the cells on both of its sides free too (no corner is cut). The wavefront is the field of
the costs of the shortest ways to the nearest goal; steepest descent in it is a shortest way: a numerical navigation
function (Barraquand, Langlois and Latombe, IEEE Trans. Systems, Man, and Cybernetics 22(2), 1992), with the eight steps
of the driver ``wavefront`` of Player.

No step is shorter than a cell. So the cells whose cost lies in [i, i + 1), a wave, cannot shorten each other's ways:
the search of :mod:`cosim.geometry.grid_search` takes one wave after the other, and needs no heap.

Where the centres of free cells have a clearance c, steps and lines of sight between centres have at least c less half a
cell's diagonal.
Cells are numbered ``cell = iy * nx + ix`` as in :mod:`cosim.geometry.grids`; row 0 is at the bottom.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats, Int32s, Singles
from cosim.geometry.grid_search import costs
from cosim.geometry.grids import TOUCH_M, Cell
from cosim.geometry.segments import clearance, segment_grid
from cosim.jit import njit

Point: TypeAlias = tuple[float, float]

_DIAGONAL: Final = math.sqrt(2.0)


# ---------------------------------------------------------------- free cells


def grown(occupied: npt.ArrayLike, radius_cells: float) -> Bools:
    """Return in which cells the centre of a disc of *radius_cells* would make it overlap a cell that is *occupied*.

    Both have the shape (ny, nx). What lies beyond the grid is occupied. To touch is allowed.
    """
    overlapped: Bools = _squares_within(occupied, radius_cells) < radius_cells * radius_cells - TOUCH_M
    return overlapped | np.asarray(occupied, np.bool_)


def obstacle_distance(occupied: npt.ArrayLike, reach_cells: float) -> Singles:
    """Return how far the centre of each cell is from the nearest cell that is *occupied*, in cells, shape (ny, nx).

    It is 0 inside, 0.5 beside one, and inf where it is more than *reach_cells*. What lies beyond the grid is occupied.
    """
    return np.sqrt(_squares_within(occupied, reach_cells))


def _squares_within(occupied: npt.ArrayLike, reach_cells: float) -> Singles:
    solid = np.pad(np.asarray(occupied, np.bool_), 1, constant_values=True)
    return np.ascontiguousarray(_squares(solid, float(reach_cells))[1:-1, 1:-1])


@dataclass(frozen=True, eq=False)
class PlanningGrid:
    """Cells of *cell_m* metres in which a robot's centre may be; (0, 0) has its lower left corner at *origin_m*."""

    origin_m: Point
    cell_m: float
    free: Bools
    """Shape (ny, nx)."""

    def cell_at(self, x_m: float, y_m: float) -> Cell:
        """Return the cell that holds a point; raise LookupError if the point is off the grid."""
        ny, nx = map(int, self.free.shape)
        ix = math.floor((x_m - self.origin_m[0]) / self.cell_m)
        iy = math.floor((y_m - self.origin_m[1]) / self.cell_m)
        if not (0 <= ix < nx and 0 <= iy < ny):
            raise LookupError(f"({x_m}, {y_m}) is off the grid")
        return iy * nx + ix

    def centre_m(self, cell: Cell) -> Point:
        """Return the centre of *cell* in metres."""
        iy, ix = divmod(cell, self.free.shape[1])
        return self.origin_m[0] + (ix + 0.5) * self.cell_m, self.origin_m[1] + (iy + 0.5) * self.cell_m

    def plan(self, start_m: Point, goals_m: Sequence[Point], snap_m: float = 0.0) -> list[Point] | None:
        """Return the way points of a shortest way from *start_m* to the nearest of *goals_m*, or None if none leads.

        The start is left out; the last way point is the goal itself. The cell of each sees that of the next, see
        :func:`in_view`. Start and goal may be off the centres of their cells, the legs there by as much off the line.
        A start or goal where the robot does not fit is replaced by the centre of the nearest free cell that is at most
        *snap_m* away, which is then a way point; without such a cell there is no way from or to it. With a *snap_m* of
        at most the radius by which obstacles have been grown, no place snaps to the other side of a wall.

        Raise LookupError if the start or a goal is off the grid.
        """
        ends: dict[Cell, Point] = {}
        for goal_m in goals_m:
            cell = self._snapped(goal_m, snap_m)
            if cell >= 0:
                ends.setdefault(cell, goal_m if cell == self.cell_at(*goal_m) else self.centre_m(cell))
        start = self._snapped(start_m, snap_m)
        path = descent(self.free, cost_to_go(self.free, list(ends), start), start) if start >= 0 else None
        if path is None:
            return None
        cells = way_points(self.free, path).tolist()
        points = [self.centre_m(cell) for cell in cells[1:-1]]
        if start != self.cell_at(*start_m):
            points.insert(0, self.centre_m(start))
        return [*points, ends[cells[-1]]]

    def _snapped(self, point_m: Point, snap_m: float) -> Cell:
        """Return the cell of a point if it is free, else the nearest free one within *snap_m*, or -1."""
        cell = self.cell_at(*point_m)
        x, y = ((point_m[axis] - self.origin_m[axis]) / self.cell_m for axis in (0, 1))
        return cell if self.free.flat[cell] else int(nearest_free(self.free, x, y, snap_m / self.cell_m))


def occupancy_planning_grid(
    occupied: npt.ArrayLike, cell_m: float, radius_m: float, origin_m: Point = (0.0, 0.0)
) -> PlanningGrid:
    """Return where the centre of a robot of *radius_m* may be on a map of cells, shape (ny, nx), of *cell_m* metres.

    Raise ValueError if a measure is not positive.
    """
    _check_measures(cell_m, radius_m)
    return PlanningGrid(origin_m, cell_m, ~grown(occupied, radius_m / cell_m))


def wall_planning_grid(
    bounds_m: tuple[float, float, float, float],
    cell_m: float,
    radius_m: float,
    walls_m: npt.ArrayLike,
    forbidden: Callable[[Floats], Bools] | None = None,
) -> PlanningGrid:
    """Return where the centre of a robot of *radius_m* may be among walls, as cells of *cell_m* metres.

    *bounds_m* is x_min, y_min, x_max, y_max; what is left of it beyond the last whole cell is in no cell. *walls_m* has
    the shape (n, 4). *forbidden* returns for points (n, 2) which of them are occupied, unknown or outside.

    Raise ValueError if no cell fits into the bounds, a measure is not positive, or the radius is less than half the
    diagonal of a cell: there might be free cells side by side with a wall between them.
    """
    _check_measures(cell_m, radius_m)
    if 2.0 * radius_m < _DIAGONAL * cell_m:
        raise ValueError(f"radius {radius_m} m is less than half the diagonal of a cell of {cell_m} m")
    x, y, x_max, y_max = bounds_m
    nx, ny = (math.floor(extent / cell_m + 1e-9) for extent in (x_max - x, y_max - y))
    if nx < 1 or ny < 1:
        raise ValueError(f"no cell of {cell_m} m fits into a floor of {x_max - x} m x {y_max - y} m")
    centres_x, centres_y = np.meshgrid(x + (np.arange(nx) + 0.5) * cell_m, y + (np.arange(ny) + 0.5) * cell_m)
    centres = np.stack((centres_x.ravel(), centres_y.ravel()), axis=1)
    free = clearance(segment_grid(walls_m), centres, radius_m + 2 * TOUCH_M) >= radius_m - TOUCH_M
    if forbidden is not None:
        free &= ~forbidden(centres)
    return PlanningGrid((x, y), cell_m, free.reshape(ny, nx))


def _check_measures(cell_m: float, radius_m: float) -> None:
    if not (cell_m > 0 and radius_m > 0):
        raise ValueError(f"cell {cell_m} m and radius {radius_m} m are not both > 0")


# ---------------------------------------------------------------- the field and the ways in it


def cost_to_go(free: Bools, goals: npt.ArrayLike, start: Cell | None = None) -> Floats:
    """Return the length in cells of the shortest way from each cell to the nearest of *goals*, shape (ny, nx).

    It is inf where no way leads and where the cell is not *free*, shape (ny, nx). *goals* are numbers of cells; one
    that is not free cannot be reached. With a *start*, a cell, the field is made as far as :func:`descent` from there
    needs it: where it is more than at the start, it is too much or inf. Raise LookupError for a goal off the grid.
    """
    cells = np.asarray(goals, np.int64).reshape(-1)
    for cell in cells.tolist():
        _check_cell(free, cell)
    known = np.ascontiguousarray(free)
    starts = np.zeros(known.shape, np.bool_)
    if start is not None:
        starts.flat[start] = known.flat[start]
    return costs(known, cells[known.flat[cells]], ends=starts, stop=True)


def descent(free: Bools, cost: Floats, start: Cell) -> Int32s | None:
    """Return the cells of a shortest way from *start* to a goal, both included, or None if there is none.

    *cost* is the field of :func:`cost_to_go` on the same grid. Of several shortest ways always the same is returned.
    Raise LookupError for a start off the grid.
    """
    _check_cell(free, start)
    return _descent(free, cost, start) if math.isfinite(cost.flat[start]) else None


def way_points(free: Bools, path: Int32s) -> Int32s:
    """Return those cells of a *path* (n,), of :func:`descent`, that suffice: each sees the next, see :func:`in_view`.

    First and last are kept. The next way point is the last before the first one that the present one does not see.
    """
    return _way_points(free, path)


def _check_cell(free: Bools, cell: Cell) -> None:
    if not 0 <= cell < free.size:
        raise LookupError(f"cell {cell} is off the grid of {free.shape[1]} x {free.shape[0]} cells")


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _squares(solid: Bools, reach: float) -> Singles:
    """Return the squares of the distances of centres from the nearest solid cell, inf beyond *reach*.

    Of a row's solid cells the nearest to a column is the nearest to all cells of that column: so the squares along rows
    are found first, and what is added to them from row to row then (A. Meijster, J. B. T. M. Roerdink and
    W. H. Hesselink, "A general algorithm for computing distance transforms in linear time", 2000).
    """
    ny, nx = solid.shape
    most, cells = reach * reach, math.floor(reach + 0.5)
    along, result = _squares_along(solid, cells), np.full((ny, nx), np.inf, np.float32)
    for iy in range(ny):
        row = result[iy]
        for ky in range(max(iy - cells, 0), min(iy + cells + 1, ny)):
            other, off = along[ky], max(abs(ky - iy) - 0.5, 0.0)
            square = np.float32(off * off)  # multiples of a quarter: nothing is rounded
            for ix in range(nx):
                row[ix] = min(row[ix], other[ix] + square)
        for ix in range(nx):
            row[ix] = row[ix] if row[ix] <= most else np.float32(np.inf)
    return result


@njit(cache=True)
def _squares_along(solid: Bools, cells: int) -> Singles:
    """Return the squares of the distances from the nearest solid cell of the same row; inf where *cells* are none."""
    ny, nx = solid.shape
    squares = np.full((ny, nx), np.inf, np.float32)
    for iy in range(ny):
        for right in (False, True):
            since = cells + 1
            for k in range(nx):
                ix = k if right else nx - 1 - k
                since = 0 if solid[iy, ix] else since + 1
                if since <= cells:
                    off = np.float32(max(since - 0.5, 0.0))
                    squares[iy, ix] = min(squares[iy, ix], off * off)
    return squares


@njit(cache=True)
def open_steps(free: Bools, enterable: Bools, ix: int, iy: int) -> int:
    """Return the steps from a cell to *enterable* ones, past *free* ones only: bit 3 dy + dx + 4 is the step (dx, dy).

    Free cells are enterable; where no others are, pass them twice. No corner of those others is cut either.
    """
    ny, nx = free.shape
    below, above, left, right = iy > 0, iy + 1 < ny, ix > 0, ix + 1 < nx
    steps = 0
    if below and enterable[iy - 1, ix]:
        steps |= 1 << 1
    if left and enterable[iy, ix - 1]:
        steps |= 1 << 3
    if right and enterable[iy, ix + 1]:
        steps |= 1 << 5
    if above and enterable[iy + 1, ix]:
        steps |= 1 << 7
    if below and free[iy - 1, ix]:
        if left and free[iy, ix - 1] and enterable[iy - 1, ix - 1]:
            steps |= 1 << 0
        if right and free[iy, ix + 1] and enterable[iy - 1, ix + 1]:
            steps |= 1 << 2
    if above and free[iy + 1, ix]:
        if left and free[iy, ix - 1] and enterable[iy + 1, ix - 1]:
            steps |= 1 << 6
        if right and free[iy, ix + 1] and enterable[iy + 1, ix + 1]:
            steps |= 1 << 8
    return steps


@njit(cache=True)
def _descent(free: Bools, cost: Floats, start: int) -> Int32s:
    nx = free.shape[1]
    path = np.empty(free.size, np.int32)
    path[0], count = start, 1
    iy, ix = start // nx, start % nx
    while cost[iy, ix] > 0.0:
        steepest, to_x, to_y = 0.0, ix, iy
        steps = open_steps(free, free, ix, iy)
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if steps >> (3 * dy + dx + 4) & 1:
                    length = _DIAGONAL if dx != 0 and dy != 0 else 1.0
                    slope = (cost[iy, ix] - cost[iy + dy, ix + dx]) / length
                    if slope > steepest + 1e-9:  # rounding does not choose
                        steepest, to_x, to_y = slope, ix + dx, iy + dy
        ix, iy = to_x, to_y
        path[count] = iy * nx + ix
        count += 1
    return path[:count].copy()


@njit(cache=True)
def in_view(free: Bools, a: Cell, b: Cell) -> bool:
    """Return whether all cells that the line between the centres of the cells *a* and *b* meets are free.

    A line through a corner meets all four cells there. Symmetric. Whole numbers decide exactly by which side the line
    leaves a cell.
    """
    nx = free.shape[1]
    iy, ix = a // nx, a % nx
    way_x, way_y = abs(b % nx - ix), abs(b // nx - iy)
    step_x, step_y = (1 if b % nx > ix else -1), (1 if b // nx > iy else -1)
    gone_x, gone_y = 0, 0
    while free[iy, ix]:
        if gone_x == way_x and gone_y == way_y:
            return True
        ahead = (1 + 2 * gone_x) * way_y - (1 + 2 * gone_y) * way_x
        if ahead == 0 and not (free[iy, ix + step_x] and free[iy + step_y, ix]):
            return False
        if ahead <= 0:
            ix, gone_x = ix + step_x, gone_x + 1
        if ahead >= 0:
            iy, gone_y = iy + step_y, gone_y + 1
    return False


@njit(cache=True)
def _way_points(free: Bools, path: Int32s) -> Int32s:
    kept = np.empty(path.shape[0], np.int32)
    kept[0], count, last = path[0], 1, 0
    for k in range(1, path.shape[0]):
        if k > last + 1 and not in_view(free, path[last], path[k]):
            last = k - 1
            kept[count] = path[last]
            count += 1
    if path.shape[0] > 1:
        kept[count] = path[-1]
        count += 1
    return kept[:count].copy()


@njit(cache=True)
def nearest_free(free: Bools, x: float, y: float, reach: float) -> int:
    """Return the free cell whose centre is nearest to a point (in cells) and at most *reach* cells away, or -1."""
    ny, nx = free.shape
    best, cell = reach * reach, -1
    for iy in range(max(int(y - reach - 1.0), 0), min(int(y + reach + 1.0) + 1, ny)):
        for ix in range(max(int(x - reach - 1.0), 0), min(int(x + reach + 1.0) + 1, nx)):
            square = (ix + 0.5 - x) ** 2 + (iy + 0.5 - y) ** 2
            if free[iy, ix] and (square < best or (cell < 0 and square <= best)):
                best, cell = square, iy * nx + ix
    return cell
