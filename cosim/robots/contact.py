"""Discs that move at once, each at constant velocity: how much each way is cut so that none enters another or a wall.

Ways are cut, never turned: a body that would touch ends its tick at contact. Of two bodies only those that move towards
the other are cut, so that a follower does not slow its leader. Every cut can spoil or save other pairs; the pairs are
gone through until nothing changes, after ``ROUNDS`` rounds with cuts to zero, which ends after as many rounds as there
are bodies. A shorter way along the same line is still free of walls.
"""

import math
from typing import Final

import numpy as np

from cosim.arrays import Floats, Int32s, Int64s
from cosim.geometry.segments import SegmentGrid, cells_near, free_fraction, unpacked
from cosim.jit import njit
from cosim.robots.table import DX, DY, GUIDED, PART, RADIUS, ROOM, X, Y

ROUNDS: Final = 100
WALL_SLACK_M: Final = 1e-7
"""Depth to which a body may seem to be inside a wall that it slides along; more than ``grids.TOUCH_M``."""
LOOK_WAYS: Final = 24.0
"""Range within which walls are looked for, in ways of the present tick, so that later ticks need not look again."""
AGAIN_WAYS: Final = 4.0
"""Room, in ways of a tick, below which walls are checked one by one, and ticks until room is looked for again."""
BODY_SLACK_M: Final = 1e-9
"""Overlap that two bodies may seem to have that pass in touch."""
CELL_SLACK: Final = 1e-6
"""Share by which cells are wider than they need to be, more than rounding loses."""
LEAST_SIDE_M: Final = 1e-3
"""Least side of a cell, where all discs are points at rest."""
FEW: Final = 16
"""The most discs of which all pairs are looked at every time: cells would cost more than they save."""


@njit(cache=True)
def cut(table: Floats, pairs: Int64s, wall_numbers: Floats, wall_members: Int32s) -> None:
    """Write to the row PART which fraction, 0 to 1, of its way (DX, DY) each disc can go; see ``table``.

    Discs that do not overlap before do not overlap at any time of the tick; but guided ones are not cut, and may enter
    others. *pairs* are all, or at least those of :func:`pairs_near`. The walls come from :func:`packed_walls`.
    """
    for i in range(table.shape[1]):
        table[PART, i] = 1.0
        dx, dy = table[DX, i], table[DY, i]
        if (dx != 0.0 or dy != 0.0) and not table[GUIDED, i]:
            way = math.sqrt(dx * dx + dy * dy)
            if table[ROOM, i] >= table[RADIUS, i] + way:
                table[ROOM, i] -= way
            else:
                grid = unpacked(wall_numbers, wall_members)
                table[PART, i], table[ROOM, i] = _free_of_walls(
                    grid, table[X, i], table[Y, i], dx, dy, table[RADIUS, i], way, table[ROOM, i]
                )
    _keep_apart(table, pairs)


@njit(cache=True, borrows=True)
def _free_of_walls(
    grid: SegmentGrid, x: float, y: float, dx: float, dy: float, radius: float, way: float, room: float
) -> tuple[float, float]:
    """Return which fraction of the way is free of walls, and the room that is left then."""
    if room >= 0.0:
        room = _clearance(grid, x, y, radius + LOOK_WAYS * way)
        if room >= radius + AGAIN_WAYS * way:
            return 1.0, room - way
        room = -AGAIN_WAYS
    return free_fraction(grid, x, y, dx, dy, radius, WALL_SLACK_M), room + 1.0


@njit(cache=True, borrows=True)
def _clearance(grid: SegmentGrid, x: float, y: float, limit: float) -> float:
    """Return the distance of a point from the nearest wall, at most *limit*."""
    best = limit * limit
    low_x, high_x, low_y, high_y = cells_near(grid, x, y, x, y, limit)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            x1, y1, x2, y2 = grid.walls_m[grid.member[slot]]
            wx, wy = x2 - x1, y2 - y1
            square = wx * wx + wy * wy
            u = min(max(((x - x1) * wx + (y - y1) * wy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            rx, ry = x - (x1 + u * wx), y - (y1 + u * wy)
            best = min(best, rx * rx + ry * ry)
    return math.sqrt(best)


@njit(cache=True, borrows=True)
def _keep_apart(table: Floats, pairs: Int64s) -> None:
    """Cut the ways of *pairs* until no disc enters another."""
    for turn in range(ROUNDS + table.shape[1] + 1):
        settled = True
        for k in range(pairs.shape[0]):
            if _could_touch(table, pairs[k, 0], pairs[k, 1]):
                settled &= not _part(table, pairs[k, 0], pairs[k, 1], turn >= ROUNDS)
        if settled:
            break


@njit(cache=True, borrows=True)
def _part(table: Floats, i: int, j: int, at_once: bool) -> bool:
    """Cut the ways of two discs of which one enters the other, to nothing if *at_once*; return whether one was cut."""
    rx, ry, reach = table[X, i] - table[X, j], table[Y, i] - table[Y, j], table[RADIUS, i] + table[RADIUS, j]
    ix, iy = table[PART, i] * table[DX, i], table[PART, i] * table[DY, i]
    jx, jy = table[PART, j] * table[DX, j], table[PART, j] * table[DY, j]
    if not _enters(rx, ry, ix - jx, iy - jy, reach - BODY_SLACK_M):
        return False
    cut_i = not table[GUIDED, i] and table[PART, i] * (rx * table[DX, i] + ry * table[DY, i]) < 0.0
    cut_j = not table[GUIDED, j] and table[PART, j] * (rx * table[DX, j] + ry * table[DY, j]) > 0.0
    if not (cut_i or cut_j):  # a guided disc enters one that does not come towards it
        return False
    kept = 0.0 if at_once else _kept(rx, ry, ix, iy, jx, jy, reach, cut_i, cut_j)
    if cut_i:
        table[PART, i] *= kept
    if cut_j:
        table[PART, j] *= kept
    return True


@njit(cache=True, borrows=True)
def _could_touch(table: Floats, i: int, j: int) -> bool:
    rx, ry = table[X, i] - table[X, j], table[Y, i] - table[Y, j]
    ways = abs(table[DX, i]) + abs(table[DY, i]) + abs(table[DX, j]) + abs(table[DY, j])
    reach = table[RADIUS, i] + table[RADIUS, j] + ways
    near: bool = rx * rx + ry * ry < reach * reach
    return near


def all_pairs(discs: int) -> Int64s:
    """Return the pairs i < j of a number of discs, shape (count, 2), rising."""
    return np.stack(np.triu_indices(discs, 1), axis=1)


@njit(cache=True)
def pairs_near(table: Floats) -> Int64s:
    """Return the pairs i < j, shape (count, 2), rising, that could touch with their full ways."""
    discs = table.shape[1]
    found, count = np.empty((discs, 2), np.int64), 0
    low_x, low_y, side, nx, ny = _cells(table)
    cell, first, member = _sorted_into_cells(table, low_x, low_y, side, nx, ny)
    for i in range(discs):
        begin, ix, iy = count, cell[i] % nx, cell[i] // nx
        for row in range(max(iy - 1, 0), min(iy + 2, ny)):
            for slot in range(first[row * nx + max(ix - 1, 0)], first[row * nx + min(ix + 2, nx)]):
                j = member[slot]
                if j <= i or not _could_touch(table, i, j):
                    continue
                if count == len(found):
                    found = np.concatenate((found, np.empty_like(found)))
                at = count
                while at > begin and found[at - 1, 1] > j:
                    found[at, 0], found[at, 1] = i, found[at - 1, 1]
                    at -= 1
                found[at, 0], found[at, 1] = i, j
                count += 1
    return found[:count]


@njit(cache=True, borrows=True)
def _cells(table: Floats) -> tuple[float, float, float, int, int]:
    """Return the lower corner, the side and the numbers of square cells of which only next ones hold who could touch.

    There are about as many as discs, or fewer.
    """
    low_x, low_y, high_x, high_y, reach = math.inf, math.inf, -math.inf, -math.inf, 0.0
    for i in range(table.shape[1]):
        low_x, high_x = min(low_x, table[X, i]), max(high_x, table[X, i])
        low_y, high_y = min(low_y, table[Y, i]), max(high_y, table[Y, i])
        reach = max(reach, table[RADIUS, i] + abs(table[DX, i]) + abs(table[DY, i]))
    width, height = max(high_x - low_x, 0.0), max(high_y - low_y, 0.0)
    side = max(2.0 * reach * (1.0 + CELL_SLACK), max(width, height) / math.sqrt(table.shape[1] + 1.0), LEAST_SIDE_M)
    return low_x, low_y, side, int(width / side) + 1, int(height / side) + 1


@njit(cache=True)
def _sorted_into_cells(
    table: Floats, low_x: float, low_y: float, side: float, nx: int, ny: int
) -> tuple[Int64s, Int64s, Int64s]:
    """Return the cell c = iy * nx + ix of each disc, and what is in each: ``member[first[c]:first[c + 1]]``."""
    discs = table.shape[1]
    cell, first, member = np.empty(discs, np.int64), np.zeros(nx * ny + 1, np.int64), np.empty(discs, np.int64)
    for i in range(discs):
        cell[i] = int((table[Y, i] - low_y) / side) * nx + int((table[X, i] - low_x) / side)
        first[cell[i]] += 1
    for c in range(1, nx * ny + 1):  # where each cell ends: it is filled from there
        first[c] += first[c - 1]
    for i in range(discs):
        first[cell[i]] -= 1
        member[first[cell[i]]] = i
    return cell, first, member


@njit(cache=True)
def _enters(rx: float, ry: float, wx: float, wy: float, reach: float) -> bool:
    """Return whether a point that goes from r to r + w gets nearer to the origin and within *reach* of it."""
    inward = rx * wx + ry * wy
    if inward >= 0.0:
        return False
    s = min(1.0, -inward / (wx * wx + wy * wy))
    nearest_x, nearest_y = rx + s * wx, ry + s * wy
    return nearest_x * nearest_x + nearest_y * nearest_y < reach * reach


@njit(cache=True)
def _kept(
    rx: float,
    ry: float,
    ix: float,
    iy: float,
    jx: float,
    jy: float,
    reach: float,
    cut_i: bool,
    cut_j: bool,
) -> float:
    """Bisect for the fraction of the ways i and j, of those that are cut, with which the pair does not overlap."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        part_i, part_j = middle if cut_i else 1.0, middle if cut_j else 1.0
        if _enters(rx, ry, part_i * ix - part_j * jx, part_i * iy - part_j * jy, reach):
            high = middle
        else:
            low = middle
    return low
