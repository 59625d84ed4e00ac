"""Grids over a floor: coverage cells and the steps between them.

A coverage grid cuts the floor into square cells of a robot's footprint. A cell is *free* if the body, a disc, stands at
its centre with no wall inside it; a *step* between the centres of two neighbours is possible if the disc can be moved
along it. To touch a wall exactly is allowed: distances may fall short of the radius by ``TOUCH_M``, which is more than
rounding loses and less than the slack that the motion of bodies allows. Cells are numbered ``cell = iy * nx + ix``;
directions are north, east, south, west (y up), numbered 0 to 3.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats, Int32s
from cosim.geometry.segments import SegmentGrid, room_along, segment_grid
from cosim.jit import njit

Cell: TypeAlias = int

NORTH, EAST, SOUTH, WEST = 0, 1, 2, 3
OFFSETS: Final = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""(dx, dy) in cells of each direction."""
TOUCH_M: Final = 1e-9
"""Depth to which a body that touches a wall may seem to be inside it."""


@dataclass(frozen=True)
class CoverageGrid:
    """Cells of *cell_m* metres; cell (0, 0) has its lower left corner at *origin_m*."""

    origin_m: tuple[float, float]
    cell_m: float
    nx: int
    ny: int
    steps: Int32s
    """Shape (nx * ny, 4): the cell that a step in each direction leads to, or -1 where the body does not fit."""
    free: Bools
    """Shape (nx * ny,): true if the body fits into the cell."""
    reachable: Bools
    """Shape (nx * ny,): true if some robot of the team can drive there, cell by cell."""

    def centre_m(self, cell: Cell) -> tuple[float, float]:
        """Return the centre of *cell* in metres."""
        iy, ix = divmod(cell, self.nx)
        return self.origin_m[0] + (ix + 0.5) * self.cell_m, self.origin_m[1] + (iy + 0.5) * self.cell_m

    def cell_at(self, x_m: float, y_m: float) -> Cell:
        """Return the cell that holds a point; raise LookupError if the point is off the grid."""
        ix = int((x_m - self.origin_m[0]) // self.cell_m)
        iy = int((y_m - self.origin_m[1]) // self.cell_m)
        if not (0 <= ix < self.nx and 0 <= iy < self.ny):
            raise LookupError(f"({x_m}, {y_m}) is off the grid")
        return iy * self.nx + ix

    def centres_m(self) -> Floats:
        """Return the centres of all cells in metres, shape (nx * ny, 2)."""
        return _centres(self.origin_m, self.cell_m, self.nx, self.ny)


def coverage_grid(
    bounds_m: tuple[float, float, float, float],
    cell_m: float,
    radius_m: float,
    walls_m: npt.ArrayLike,
    forbidden: Callable[[Floats], Bools],
    starts_m: npt.ArrayLike = (),
) -> CoverageGrid:
    """Cut the floor into cells of *cell_m* and find out where a disc of *radius_m* can stand and step.

    *bounds_m* is x_min, y_min, x_max, y_max; what is left of it beyond the last whole cell is in no cell. *walls_m* has
    the shape (n, 4). *forbidden* returns for points (n, 2) which of them are occupied, unknown or outside. Reachable is
    what can be stepped to from the cells that hold *starts_m* (n, 2), as far as they are free; without starts, the
    largest set of cells that can be stepped to from each other (of equal ones that with the lowest cell).

    Raise ValueError if no cell fits into the bounds or a measure is not positive, LookupError if a start is off the
    grid.
    """
    if not (cell_m > 0 and radius_m > 0):
        raise ValueError(f"cell {cell_m} m and radius {radius_m} m are not both > 0")
    x, y, x_max, y_max = bounds_m
    nx, ny = (math.floor(extent / cell_m + 1e-9) for extent in (x_max - x, y_max - y))
    if nx < 1 or ny < 1:
        raise ValueError(f"no cell of {cell_m} m fits into a floor of {x_max - x} m x {y_max - y} m")
    centres = _centres((x, y), cell_m, nx, ny)
    free = ~forbidden(centres)
    steps = np.full((nx * ny, 4), -1, np.int32)
    _find_steps(segment_grid(walls_m), centres, nx, radius_m, cell_m, free, np.zeros(nx * ny), steps)
    result = CoverageGrid((x, y), cell_m, nx, ny, steps, free, np.zeros(nx * ny, np.bool_))
    points = np.asarray(starts_m, dtype=np.float64).reshape(-1, 2).tolist()
    sources = [cell for cell in (result.cell_at(*point) for point in points) if free[cell]]
    result.reachable[:] = (distances(steps, sources) >= 0) if points else _largest(steps, free)
    return result


def distances(steps: Int32s, sources: npt.ArrayLike) -> Int32s:
    """Return the fewest *steps* (n, 4) from the nearest cell of *sources* to each cell, -1 where there is no way."""
    return _flooded(steps, sources, ())[0]


def nearest_of(steps: Int32s, source: Cell, targets: npt.ArrayLike) -> tuple[Cell | None, int]:
    """Return that of *targets* to which the fewest *steps* (n, 4) lead from *source*, and their number.

    Without a way to any it is None, and -1.
    """
    distance, found = _flooded(steps, [source], targets)
    return (None, -1) if found < 0 else (found, int(distance[found]))


def _flooded(steps: Int32s, sources: npt.ArrayLike, targets: npt.ArrayLike) -> tuple[Int32s, Cell]:
    distance, queue = np.full(len(steps), -1, np.int32), np.empty(len(steps), np.int32)
    cells, ends = (np.asarray(each, np.int32).reshape(-1) for each in (sources, targets))
    return distance, _flood(np.ascontiguousarray(steps, np.int32), cells, ends, queue, distance)


def _centres(origin_m: tuple[float, float], cell_m: float, nx: int, ny: int) -> Floats:
    x = origin_m[0] + (np.arange(nx) + 0.5) * cell_m
    y = origin_m[1] + (np.arange(ny) + 0.5) * cell_m
    return np.stack((np.tile(x, ny), np.repeat(y, nx)), axis=1)


def _largest(steps: Int32s, free: Bools) -> Bools:
    best = np.zeros(len(free), np.bool_)
    left = free.copy()
    while np.count_nonzero(left) > np.count_nonzero(best):
        found = distances(steps, [int(np.argmax(left))]) >= 0
        left &= ~found
        if np.count_nonzero(found) > np.count_nonzero(best):
            best = found
    return best


@njit(cache=True, borrows=True)
def _find_steps(
    grid: SegmentGrid,
    centres: Floats,
    nx: int,
    radius: float,
    cell_m: float,
    free: Bools,
    rooms: Floats,
    steps: Int32s,
) -> None:
    """Leave *free* only cells that a disc of *radius* fits into, and write where it can step; (n,) and (n, 4)."""
    least, limit, roomy = radius - TOUCH_M, radius + 2.0 * TOUCH_M, radius + 1.01 * cell_m
    for cell in range(centres.shape[0]):
        if free[cell]:
            x, y = centres[cell, 0], centres[cell, 1]
            rooms[cell] = room_along(grid, x, y, x, y, roomy)
            free[cell] = rooms[cell] >= least
        if not free[cell]:
            continue
        for back in range(2):  # to the cells in the south and in the west; a step there is as possible as a step back
            goal = cell - 1 if back else cell - nx
            if goal < 0 or (back and cell % nx == 0) or not free[goal]:
                continue
            # a wall that a step comes near to is not far from where it ends
            x, y = centres[cell, 0], centres[cell, 1]
            goal_x, goal_y = centres[goal, 0], centres[goal, 1]
            if rooms[cell] >= roomy or room_along(grid, goal_x, goal_y, x, y, limit) >= least:
                steps[cell, WEST if back else SOUTH] = goal
                steps[goal, EAST if back else NORTH] = cell


@njit(cache=True, borrows=True)
def _flood(steps: Int32s, sources: Int32s, targets: Int32s, queue: Int32s, distance: Int32s) -> Cell:
    """Write the *distance* of each cell from the *sources*, until one of *targets* is reached; return that, or -1."""
    head = tail = 0
    for source in sources:
        if distance[source] < 0:
            distance[source] = 0
            queue[tail] = source
            tail += 1
    while head < tail:
        cell: Cell = queue[head]
        head += 1
        for target in targets:
            if cell == target:
                return cell
        for direction in range(4):
            goal = steps[cell, direction]
            if goal >= 0 and distance[goal] < 0:
                distance[goal] = distance[cell] + 1
                queue[tail] = goal
                tail += 1
    return -1
