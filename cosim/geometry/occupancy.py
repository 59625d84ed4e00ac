"""Occupancy grids as geometry: the outline of the solid cells, as few long segments."""

from typing import Final

import numpy as np

from cosim.arrays import Bools, Floats, Int32s

_BAND: Final = 1 << 22
"""The number of cells whose edges are looked for at once: what that takes is many times a large grid."""


def outline(occupied: Bools, most: int | None = None) -> Floats:
    """Return the boundary between the cells that are *occupied*, shape (ny, nx), and those that are not.

    Cell (iy, ix) is the unit square from (ix, iy) to (ix + 1, iy + 1), row 0 at the bottom. The result, shape (n, 4),
    holds axis-aligned segments x1, y1, x2, y2 with whole coordinates; edges in a row are one segment. What lies beyond
    the grid counts as occupied, so that the outline of an open grid is closed. Raise ValueError if n > *most*.
    """
    cells = np.asarray(occupied, np.bool_)
    lying = _runs(cells, most)
    standing = _runs(cells.T, None if most is None else most - len(lying))
    segments = np.empty((len(lying) + len(standing), 4))
    segments[: len(lying)] = lying[:, (1, 0, 2, 0)]
    segments[len(lying) :] = standing[:, (0, 1, 0, 2)]
    return segments


def _runs(cells: Bools, most: int | None) -> Int32s:
    """Return (y, first x, x after the last) of every run of edges between a row of *cells* and the next, shape (n, 3).

    Edge y lies below row y.
    """
    ny, nx = cells.shape
    rows = max(1, _BAND // (nx + 1))
    found, count = [np.empty((0, 3), np.int32)], 0
    for first in range(0, ny + 1, rows):
        last = min(first + rows, ny + 1)
        band = np.ones((last - first + 1, nx), np.bool_)  # from the row below the first edge to that above the last
        band[max(0, 1 - first) : ny + 1 - first] = cells[max(0, first - 1) : last]
        edges = np.zeros((last - first, nx + 2), np.bool_)
        np.not_equal(band[1:], band[:-1], out=edges[:, 1:-1])
        ends = edges[:, 1:] != edges[:, :-1]  # a run begins, ends, and so on
        count += int(np.count_nonzero(ends)) // 2
        if most is not None and count > most:
            raise ValueError("the outline has more segments than it may have")
        y, x = np.nonzero(ends)
        found.append(np.stack((y[::2] + first, x[::2], x[1::2]), axis=1).astype(np.int32))
    return np.concatenate(found)
