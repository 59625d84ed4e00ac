"""Tours: the order in which cells are to be covered, its cost, its division among a team, and their assignment.

Two cells that follow each other in a tour need not be neighbours: the robot drives a shortest path between them, over
cells that are free and reachable, covered or not. Steps are assumed to work both ways.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from cosim.arrays import Int32s
from cosim.errors import LocalProtocolError
from cosim.geometry.grids import Cell, CoverageGrid, nearest_of

Tour: TypeAlias = tuple[Cell, ...]
"""Cells in the order in which they are to be covered."""
Costs: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]


def nearest(grid: CoverageGrid, source: Cell, targets: Sequence[Cell]) -> Cell | None:
    """Return the target with the shortest drive from *source*, or None if there is no way to any."""
    return nearest_of(grid.steps, source, targets)[0]


def drive_costs(grid: CoverageGrid, order: Sequence[Cell]) -> Costs:
    """Return the steps from each cell of *order* to the next, shape (len(order) - 1,).

    Where there is no way the cost is more than that of all possible drives together: :func:`split` cuts there first.
    """
    if len(order) < 2:
        return np.empty(0, np.int64)
    cells = np.array(order, np.int32)
    costs = np.ones(len(order) - 1, np.int64)
    for apart in np.flatnonzero((grid.steps[cells[:-1]] != cells[1:, None]).all(axis=1)).tolist():
        costs[apart] = nearest_of(grid.steps, order[apart], order[apart + 1 : apart + 2])[1]
    possible = costs >= 0
    return np.where(possible, costs, costs[possible].sum() + 1)


def split(order: Sequence[Cell], costs: Costs, team: int) -> tuple[Tour, ...]:
    """Cut *order* into *team* contiguous parts whose greatest cost is as small as can be, and which are nearly equal.

    *costs* are the drives between successive cells, as of :func:`drive_costs`; the drive at a cut is not made. No part
    is empty if there are cells enough. Raise LocalProtocolError if there is no team.
    """
    if team < 1:
        raise LocalProtocolError(f"a tour cannot be split among {team} robots")
    count = min(team, len(order))
    if count == 0:
        return ((),) * team
    reached = np.concatenate((np.zeros(1, np.int64), np.cumsum(costs)))
    bound = _least_bound(reached, count)
    cuts = [0]
    # a part that stops at its even share leaves less than that, on average, to those after it
    for after in range(count - 1, 0, -1):
        here = reached[cuts[-1]]
        share = min(bound, (reached[-1] - here) // (after + 1))
        cuts.append(min(int(np.searchsorted(reached, here + share, "right")), len(order) - after))
    cuts.append(len(order))
    parts = tuple(tuple(order[a:b]) for a, b in pairwise(cuts))
    return parts + ((),) * (team - count)


def _least_bound(reached: Costs, count: int) -> int:
    """Return the smallest cost that *count* parts need not exceed, by bisection."""
    low, high = 0, int(reached[-1])
    while low < high:
        middle = (low + high) // 2
        if _fits(reached, count, middle):
            high = middle
        else:
            low = middle + 1
    return low


def _fits(reached: Costs, count: int, bound: int) -> bool:
    start = 0
    for _ in range(count):
        start = int(np.searchsorted(reached, reached[start] + bound, "right"))
        if start == reached.size:
            return True
    return False


def assign(parts: Sequence[Tour], starts: Sequence[Cell], distances: Callable[[Cell], Int32s]) -> tuple[Tour, ...]:
    """Give each robot at most one part, so that the drives from *starts* to the parts' first cells are least in sum.

    *distances* returns the steps from a cell to all cells, shape (cells,), -1 where there is no way. As few parts as
    possible go to robots that cannot reach them. Returns a tour for each start, which may be empty. Raise
    LocalProtocolError if there are more parts than robots.
    """
    if len(parts) > len(starts):
        raise LocalProtocolError(f"{len(parts)} parts for {len(starts)} robots")
    work = [part for part in parts if part]
    firsts = [part[0] for part in work]
    drives = np.array([distances(start)[firsts] for start in starts], np.int64).reshape(len(starts), len(firsts))
    drives = np.where(drives >= 0, drives, drives.max(initial=0) * len(starts) + 1)
    if len(work) == len(starts):
        given = dict(enumerate(least_sum(drives.tolist())))
    else:
        given = {robot: part for part, robot in enumerate(least_sum(drives.T.tolist()))}
    return tuple(work[given[robot]] if robot in given else () for robot in range(len(starts)))


def least_sum(costs: Sequence[Sequence[int]]) -> list[int]:
    """Return the column of each row, no two the same, so that the sum of *costs* is least; no more rows than columns.

    Shortest augmenting paths (Crouse, "On implementing 2D rectangular assignment algorithms", IEEE Transactions on
    Aerospace and Electronic Systems 52, 2016). Of several such assignments it is that of scipy.optimize, which does the
    same, but takes longer to load than the rest of a run to begin.
    """
    columns = len(costs[0]) if costs else 0
    row_dual, column_dual = [0] * len(costs), [0] * columns
    column_of, row_of, before = [-1] * len(costs), [-1] * columns, [-1] * columns
    for row in range(len(costs)):
        length: dict[int, int] = {}  # of the shortest way from this row to a column
        left = list(reversed(range(columns)))
        passed, reached, here = [row], 0, row
        while True:
            for column in left:
                through = reached + costs[here][column] - row_dual[here] - column_dual[column]
                if column not in length or through < length[column]:
                    length[column], before[column] = through, here
            reached = min(length[column] for column in left)
            nearest = [at for at, column in enumerate(left) if length[column] == reached]
            free = [at for at in nearest if row_of[left[at]] < 0]
            at = free[-1] if free else nearest[0]
            end, left[at] = left[at], left[-1]
            left.pop()
            if free:
                break
            here = row_of[end]
            passed.append(here)
        row_dual[row] += reached
        for other in passed[1:]:
            row_dual[other] += reached - length[column_of[other]]
        for column in length.keys() - left:
            column_dual[column] -= reached - length[column]
        while end >= 0:  # each row on the way back takes the next one's column, and this row the last
            row_of[end] = here = before[end]
            column_of[here], end = end, column_of[here]
    return column_of
