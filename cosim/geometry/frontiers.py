"""Frontiers as Yamauchi has them: groups of empty cells beside the unknown, to be driven to.

B. Yamauchi, "A frontier-based approach for autonomous exploration", Proc. IEEE CIRA 1997, pp. 146-151: adjacent cells
between the empty and the unknown form a region, and a region of about a robot's size or more is a frontier. That cells
are adjacent also diagonally is our reading. (The schemas have another definition: see ``marking``.)
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy import ndimage

from cosim.arrays import Int32s

Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]


class Frontier(NamedTuple):
    """A group of cells, ascending, and that of them which is nearest to their mean (of equal ones the lowest)."""

    cells: Int32s
    centroid: int


def yamauchi_frontiers(evidence: Evidence, least_cells: int) -> list[Frontier]:
    """Return the frontiers of at least *least_cells* cells in *evidence* (ny, nx), by their lowest cells.

    Cells are numbered ``iy * nx + ix``. What lies beyond the grid is not unknown: no frontier is there.
    """
    nx = evidence.shape[1]
    unknown = np.pad(evidence == 0, 1)
    rows = unknown[:-2] | unknown[1:-1] | unknown[2:]
    beside = rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
    group, _ = ndimage.label((evidence < 0) & beside, structure=np.ones((3, 3), np.int8))
    cells = np.flatnonzero(group).astype(np.int32)
    of_cell = group.ravel()[cells]
    order = np.argsort(of_cell, kind="stable")
    starts = np.flatnonzero(np.diff(of_cell[order])) + 1
    groups = [part for part in np.split(cells[order], starts) if len(part) >= max(least_cells, 1)]
    return [Frontier(part, _nearest_to_mean(part, nx)) for part in groups]


def _nearest_to_mean(cells: Int32s, nx: int) -> int:
    iy, ix = np.divmod(cells.astype(np.int64), nx)
    n = len(cells)
    # whole numbers, n times too large: equal distances are equal
    square = (n * ix - ix.sum()) ** 2 + (n * iy - iy.sum()) ** 2
    return int(cells[np.argmin(square)])
