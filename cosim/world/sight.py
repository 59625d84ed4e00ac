"""Lines of sight between all pairs of robots, and the walls that cross them, computed once a tick."""

from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats, Int32s, Int64s
from cosim.geometry.segments import (
    PackedWalls,
    SegmentGrid,
    crossed_weights,
    in_sight,
    unpacked,
)
from cosim.jit import njit

LOSS_UNIT_DB: Final = 2.0**-20
"""Unit in which losses of walls are added up, about a millionth of a dB."""


def lines_of_sight(walls: PackedWalls, positions_m: npt.ArrayLike, range_m: float) -> Bools:
    """Return which robots see each other, shape (n, n), symmetric, False for oneself.

    *positions_m* has the shape (n, 2). Two robots see each other if they are at most *range_m* (may be infinite) apart
    and no wall meets the line between their centres; bodies do not hide each other.
    """
    positions = np.ascontiguousarray(positions_m, dtype=np.float64).reshape(-1, 2)
    seen = np.zeros((len(positions), len(positions)), np.bool_)
    _look_at_pairs(*walls, positions, float(range_m), seen)  # numba is slow to hand out an array of its own
    return seen


def look_again(walls: PackedWalls, positions_m: Floats, range_m: float, seen: Bools) -> bool:
    """Make *seen* (n, n), where it is out of date, what :func:`lines_of_sight` returns; return whether it was.

    For callers at every tick: mostly robots see the same ones as before. *positions_m* is an array (n, 2).
    """
    changed: bool = _look_at_pairs(*walls, positions_m, range_m, seen)
    return changed


def wall_losses_db(walls: SegmentGrid, loss_db: npt.ArrayLike, positions_m: npt.ArrayLike) -> Floats:
    """Return what the walls between each two robots cost, in dB, shape (n, n), symmetric, 0 on the diagonal.

    *loss_db*, of the shape (walls,), is what each wall costs a line that crosses it, to a millionth of a dB, and
    *positions_m* has the shape (n, 2). For lines that meet a wall's end see the top of
    :mod:`cosim.geometry.segments`. Raise ValueError if there is not one loss for each wall.
    """
    positions = np.ascontiguousarray(positions_m, dtype=np.float64).reshape(-1, 2)
    crossed = crossed_weights(walls.walls_m, loss_units(walls, loss_db), positions)
    return crossed.astype(np.float64) * LOSS_UNIT_DB


def loss_units(walls: SegmentGrid, loss_db: npt.ArrayLike) -> Int64s:
    """Return losses in whole ``LOSS_UNIT_DB``, shape (walls,): their sum depends on no order.

    Raise ValueError if there is not one loss for each wall.
    """
    losses = np.asarray(loss_db, dtype=np.float64)
    if losses.shape != (len(walls.walls_m),):
        raise ValueError(f"{len(walls.walls_m)} walls have losses of shape {losses.shape}")
    return np.rint(losses / LOSS_UNIT_DB).astype(np.int64)


def seen_by_each(seen: Bools) -> list[tuple[int, ...]]:
    """Return for each robot the numbers of the others that it sees, in order, from the matrix *seen* (n, n)."""
    observers, others = np.nonzero(seen)
    ends = np.searchsorted(observers, np.arange(len(seen) + 1)).tolist()
    seen_others = others.tolist()
    return [tuple(seen_others[begin:end]) for begin, end in pairwise(ends)]


@njit(cache=True)
def _look_at_pairs(numbers: Floats, members: Int32s, positions: Floats, limit: float, seen: Bools) -> bool:
    """Write which robots see each other; return whether that has changed."""
    walls = unpacked(numbers, members)
    robots = positions.shape[0]
    changed = False
    for i in range(robots):
        for j in range(i + 1, robots):
            dx, dy = positions[j, 0] - positions[i, 0], positions[j, 1] - positions[i, 1]
            clear = dx * dx + dy * dy <= limit * limit and in_sight(
                walls, positions[i, 0], positions[i, 1], positions[j, 0], positions[j, 1]
            )
            if clear != seen[i, j]:
                seen[i, j] = seen[j, i] = clear
                changed = True
    return changed
