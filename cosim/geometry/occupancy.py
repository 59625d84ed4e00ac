"""Occupancy grids as geometry: the outline of the solid cells, as few long segments."""

from typing import Any, TypeAlias

import numpy as np

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]


def outline(occupied: Bools) -> Floats:
    """Return the boundary between the cells that are *occupied*, shape (ny, nx), and those that are not.

    Cell (iy, ix) is the unit square from (ix, iy) to (ix + 1, iy + 1), row 0 at the bottom. The result, shape (n, 4),
    holds axis-aligned segments x1, y1, x2, y2 with whole coordinates; edges in a row are one segment. What lies beyond
    the grid counts as occupied, so that the outline of an open grid is closed.
    """
    solid = np.pad(np.asarray(occupied, np.bool_), 1, constant_values=True)
    lying = _runs(solid[1:, :] != solid[:-1, :])  # row r of the difference lies at y = r, columns shifted by the pad
    standing = _runs((solid[:, 1:] != solid[:, :-1]).T)
    horizontal = np.stack((lying[:, 1] - 1, lying[:, 0], lying[:, 2] - 1, lying[:, 0]), axis=1)
    vertical = np.stack((standing[:, 0], standing[:, 1] - 1, standing[:, 0], standing[:, 2] - 1), axis=1)
    return np.concatenate((horizontal, vertical)).astype(np.float64)


def _runs(edges: Bools) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Return (row, first column, column after the last) of every run of True in a row, shape (n, 3)."""
    padded = np.pad(edges, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    row, start = np.nonzero(change == 1)
    _, stop = np.nonzero(change == -1)
    return np.stack((row, start, stop), axis=1)
