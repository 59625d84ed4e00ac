"""Lines of sight between all pairs of robots, computed once a tick."""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from cosim.geometry.segments import SegmentGrid, in_sight
from cosim.jit import njit

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]


def lines_of_sight(walls: SegmentGrid, positions_m: npt.ArrayLike, range_m: float) -> Bools:
    """Return which robots see each other, shape (n, n), symmetric, False for oneself.

    *positions_m* has the shape (n, 2). Two robots see each other if they are at most *range_m* (may be infinite) apart
    and no wall meets the line between their centres; bodies do not hide each other.
    """
    positions = np.ascontiguousarray(positions_m, dtype=np.float64).reshape(-1, 2)
    return _all_pairs(walls, positions, float(range_m))


def seen_by_each(seen: Bools) -> list[tuple[int, ...]]:
    """Return for each robot the numbers of the others that it sees, in order, from the matrix *seen* (n, n)."""
    return [tuple(other for other, visible in enumerate(row) if visible) for row in seen.tolist()]


@njit(cache=True)
def _all_pairs(walls: SegmentGrid, positions: Floats, limit: float) -> Bools:
    robots = positions.shape[0]
    seen = np.zeros((robots, robots), np.bool_)
    for i in range(robots):
        for j in range(i + 1, robots):
            dx, dy = positions[j, 0] - positions[i, 0], positions[j, 1] - positions[i, 1]
            if dx * dx + dy * dy <= limit * limit:
                clear = in_sight(walls, positions[i, 0], positions[i, 1], positions[j, 0], positions[j, 1])
                seen[i, j] = seen[j, i] = clear
    return seen
