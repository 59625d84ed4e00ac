"""Avoiding the past: a robot that is pushed away from where it has been leaves a dead end (Balch and Arkin, ICRA 1993).

The memory is a square map of counts around the robot. Every step the robot is pushed to the side where it has been
less often, the more strongly the more often it has been near, and then counts the cells around it as visited. In front
of a local minimum of the potential field the counts grow until the push outweighs the attraction of the goal.

As in MissionLab's AVOID_PAST (after Balch and Arkin; reference algorithms 5.2), with h cells of horizon around the
robot's cell (i, j): the direction is that of

    (sum of visits over k < i  -  sum over k > i,    the same in the other axis),

the magnitude the sum of all visits in the window divided by 40 h^2 (about a tenth of the mean), at most a ceiling. When
window or marks would leave the map, its content is shifted so that the robot is in the middle; what falls off is
forgotten, and what comes in is new ground. A new goal clears the map.
"""

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.navigation.schemas import Vector

Counts: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
Corner: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

_PER_M, _HORIZON, _MARK, _CEILING, _GAIN, _NUMBERS = range(6)
_VISITS: Final = 10.0
"""Number of visits of every cell of the window that push with about 1."""
_FARTHEST_CELLS: Final = 1e15
"""Distance of the farthest cells that are counted: numbers of others would not be exact."""


class Past(NamedTuple):
    """Where a robot has been, and how that pushes it: what :func:`avoid_past` reads and writes."""

    visits: Counts
    """(n, n), a count for every cell of a square map that follows the robot, by column and row."""
    corner: Corner
    """(2,), the cell of F_i that ``visits[0, 0]`` counts."""
    numbers: Floats
    """The settings, packed; see :func:`empty_past`."""


def empty_past(
    side_cells: int, cells_per_m: float, horizon_cells: int, mark_cells: int, ceiling: float, gain: float
) -> Past:
    """Return the past of a robot that has been nowhere; raise ValueError if horizon or mark reach beyond half the map.

    *ceiling* is the greatest length of the push before its weight, *gain*.
    """
    if not 2 * max(horizon_cells, mark_cells) < side_cells:
        raise ValueError(f"a map of {side_cells} cells is too small for {horizon_cells} and {mark_cells} cells")
    numbers = np.empty(_NUMBERS)
    numbers[:] = cells_per_m, horizon_cells, mark_cells, ceiling, gain
    return Past(np.zeros((side_cells, side_cells), np.int32), np.full(2, -(side_cells // 2), np.int64), numbers)


@njit(cache=True)
def avoid_past(visits: Counts, corner: Corner, numbers: Floats, x_m: float, y_m: float) -> Vector:
    """Return the push away from where the robot has been, and count the cells around (x, y) in *visits*.

    The first three are those of a :class:`Past`; *visits* and *corner* are changed in place. A place that is not
    finite, or too far off for whole cells, pushes with (0, 0) and is not counted.
    """
    cells_per_m, horizon, mark = numbers[_PER_M], int(numbers[_HORIZON]), int(numbers[_MARK])
    n = visits.shape[0]
    farthest_m = _FARTHEST_CELLS / cells_per_m
    if not (abs(x_m) < farthest_m and abs(y_m) < farthest_m):  # also for NaN
        return 0.0, 0.0
    cell_x, cell_y = math.floor(x_m * cells_per_m), math.floor(y_m * cells_per_m)
    reach = max(horizon, mark)
    i, j = cell_x - corner[0], cell_y - corner[1]
    if i < reach or j < reach or i >= n - reach or j >= n - reach:
        _shift(visits, i - n // 2, j - n // 2)
        corner[0], corner[1] = cell_x - n // 2, cell_y - n // 2
        i, j = n // 2, n // 2
    push_x, push_y = _push(visits, i, j, horizon, numbers[_CEILING])
    for k in range(i - mark, i + mark + 1):
        for m in range(j - mark, j + mark + 1):
            visits[k, m] += 1
    return numbers[_GAIN] * push_x, numbers[_GAIN] * push_y


@njit(cache=True)
def _push(visits: Counts, i: int, j: int, horizon: int, ceiling: float) -> Vector:
    less_x, less_y, count = 0, 0, 0
    for k in range(i - horizon, i + horizon + 1):
        before, after = 0, 0
        for m in range(j - horizon, j):
            before += visits[k, m]
        for m in range(j + 1, j + horizon + 1):
            after += visits[k, m]
        column = before + after + visits[k, j]
        count += column
        less_y += before - after
        if k < i:
            less_x += column
        elif k > i:
            less_x -= column
    if less_x == 0 and less_y == 0:
        return 0.0, 0.0
    magnitude = min(count / (4.0 * horizon * horizon * _VISITS), ceiling)
    scale = magnitude / elementary.hypot(less_x, less_y)
    return scale * less_x, scale * less_y


@njit(cache=True)
def _shift(visits: Counts, by_x: int, by_y: int) -> None:
    """Move the content by so many cells towards the first column and row; cells that come in are 0."""
    n = visits.shape[0]
    old = visits.copy()
    for k in range(n):
        for m in range(n):
            a, b = k + by_x, m + by_y
            visits[k, m] = old[a, b] if 0 <= a < n and 0 <= b < n else 0
