"""What is known of the floor: a map of cells, marked by scans and by the reports of other robots.

The arithmetic is in :mod:`cosim.geometry.marking`. A map covers the floor's extent, and begins without a known cell.
"""

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from cosim.arrays import Bools, Bytes, Floats, Int32s
from cosim.geometry.grids import Cell
from cosim.geometry.marking import EMPTY, OCCUPIED, Weights, mark_scan, merge_cells, most_changes
from cosim.geometry.planning import Point

Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]


# The paper's "adjacent" may be either. A beam does not pass a corner: where two walls meet, an unknown cell behind the
# corner would be a frontier that no robot ever sees.
_DIAGONAL: Final = False
"""True if an unknown cell is a frontier when it only has a corner in common with an empty one."""


class Frame(NamedTuple):
    """The grid of all maps of a run: cell (0, 0) has its lower left corner at *origin_m*."""

    origin_m: Point
    cell_m: float
    nx: int
    ny: int

    def cell_at(self, place_m: Point) -> Cell:
        """Return the cell that holds a place; the nearest one for a place off the map."""
        ix = math.floor((place_m[0] - self.origin_m[0]) / self.cell_m)
        iy = math.floor((place_m[1] - self.origin_m[1]) / self.cell_m)
        return min(max(iy, 0), self.ny - 1) * self.nx + min(max(ix, 0), self.nx - 1)

    def centre_m(self, cell: Cell) -> Point:
        """Return the centre of a cell."""
        iy, ix = divmod(int(cell), self.nx)
        return self.origin_m[0] + (ix + 0.5) * self.cell_m, self.origin_m[1] + (iy + 0.5) * self.cell_m


def frame_of(bounds_m: tuple[float, float, float, float], cell_m: float) -> Frame:
    """Return the frame of maps of a floor: its extent and one cell around it, as walls may stand on its edge."""
    x_min, y_min, x_max, y_max = bounds_m
    nx, ny = (math.ceil((high - low) / cell_m - 1e-9) + 2 for low, high in ((x_min, x_max), (y_min, y_max)))
    return Frame((x_min - cell_m, y_min - cell_m), cell_m, nx, ny)


class Belief:
    """One map, of one robot or of a team that shares it."""

    def __init__(self, frame: Frame, weights: Weights, range_m: float) -> None:
        """Begin without a known cell; scans reach *range_m*."""
        self.frame = frame
        self.evidence = np.zeros((frame.ny, frame.nx), np.int8)
        self.frontier: Bytes = np.zeros((frame.ny, (frame.nx + 7) // 8 * 8), np.uint8)
        self.vain: Bytes = np.zeros_like(self.frontier)
        """Frontiers that a robot has looked at from near by, and that are frontiers all the same."""
        self.version = 0
        """Number of changes so far."""
        self._weights = weights
        self._range_m = range_m
        self._changed = np.empty(most_changes(range_m, frame.cell_m), np.int32)

    def mark(self, place_m: Point, ranges_m: Floats, directions: Floats, bodies: Floats) -> Int32s:
        """Mark a scan; return the cells that have changed (a view that holds until the next scan)."""
        (left, low), cell_m = self.frame.origin_m, self.frame.cell_m
        count = mark_scan(
            self.evidence,
            self.frontier,
            left,
            low,
            cell_m,
            *place_m,
            ranges_m,
            directions,
            self._range_m,
            *self._weights,
            bodies,
            self._changed,
            _DIAGONAL,
        )
        self.version += count > 0
        return self._changed[:count]

    def merge(self, cells: Int32s, occupied: Bools, newer: Bools) -> None:
        """Take over another robot's states of cells that are unknown here, and of others where they are *newer*."""
        states = np.where(occupied, OCCUPIED, EMPTY).astype(np.uint8)
        scratch = np.empty(len(cells), np.int32)
        weight = self._weights.hit
        self.version += merge_cells(self.evidence, self.frontier, cells, states, newer, weight, scratch, _DIAGONAL) > 0

    def occupied(self, cells: Int32s) -> Bools:
        """Return which of *cells* are occupied."""
        return self.evidence.reshape(-1)[cells] > 0
