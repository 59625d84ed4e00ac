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
from typing import Any, Final, TypeAlias

import numpy as np

from cosim.jit import njit
from cosim.navigation.schemas import Vector

Counts: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
Corner: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

_VISITS: Final = 10.0
"""So many visits of every cell of the window push with about 1."""
_FARTHEST_CELLS: Final = 1e15
"""Cells farther off are not counted: their numbers would not be exact."""


@njit(cache=True)
def avoid_past(
    visits: Counts, corner: Corner, x_m: float, y_m: float, cells_per_m: float, horizon: int, mark: int, ceiling: float
) -> Vector:
    """Return the push away from where the robot has been, and count the cells around (x, y) in *visits*.

    *visits* (n, n) is indexed by column and row; *corner* (2,) is the cell of F_i that ``visits[0, 0]`` stands for.
    Both are changed in place. *horizon* and *mark* are cells, each less than n / 2. A place that is not finite, or too
    far off for whole cells, pushes with (0, 0) and is not counted.
    """
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
    push = _push(visits, i, j, horizon, ceiling)
    for k in range(i - mark, i + mark + 1):
        for m in range(j - mark, j + mark + 1):
            visits[k, m] += 1
    return push


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
    scale = magnitude / math.hypot(less_x, less_y)
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


class Past:
    """Where a robot has been, as counts of visits on a square map that follows it."""

    def __init__(
        self, side_cells: int, cells_per_m: float, horizon_cells: int, mark_cells: int, ceiling: float
    ) -> None:
        """Make an empty map; raise ValueError if horizon or mark reach beyond half its side."""
        if not 2 * max(horizon_cells, mark_cells) < side_cells:
            raise ValueError(f"a map of {side_cells} cells is too small for {horizon_cells} and {mark_cells} cells")
        self.visits: Counts = np.zeros((side_cells, side_cells), np.int32)
        self.corner: Corner = np.full(2, -(side_cells // 2), np.int64)
        self._cells_per_m = float(cells_per_m)
        self._horizon, self._mark, self._ceiling = horizon_cells, mark_cells, float(ceiling)

    def push(self, x_m: float, y_m: float) -> Vector:
        """Return the push on a robot at (x, y), and remember that it is there; see :func:`avoid_past`."""
        push: Vector = avoid_past(
            self.visits, self.corner, x_m, y_m, self._cells_per_m, self._horizon, self._mark, self._ceiling
        )
        return push

    def clear(self) -> None:
        """Forget everything."""
        self.visits.fill(0)
