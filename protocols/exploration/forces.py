"""The forces on one robot (paper 001, equations 3 and 4), and which frontiers it sees: kernels over the maps' words.

Grids of bytes have the shape of a frontier grid (:mod:`cosim.geometry.marking`): (ny, a multiple of 8).
"""

import math
from typing import Final, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bytes, Int32s
from cosim.geometry.planning import in_view
from cosim.jit import njit
from cosim.navigation.frontier_fields import WORD, Vector, strength_of, sum_of_obstacles, words_within
from protocols.mapping.belief import Evidence

Forces: TypeAlias = tuple[float, float, float, float]

_BYTE: Final = np.uint64(255)
_WIDTH: Final = np.uint64(8)


@njit(cache=True)
def attract(
    frontier: Bytes,
    ignored: Bytes,
    vain: Bytes,
    path: Bytes,
    only_path: bool,
    left: float,
    low: float,
    cell_m: float,
    x: float,
    y: float,
    reach_m: float,
    result: Bytes,
) -> None:
    """Set *result* to what attracts a robot at (x, y), as far as *reach_m*; farther off it keeps what it held.

    The *path* attracts, and unless *only_path*, the frontiers that are neither *ignored* nor *vain*.
    """
    words, own, seen = frontier.view(np.uint64), ignored.view(np.uint64), vain.view(np.uint64)
    laid, drawing = path.view(np.uint64), result.view(np.uint64)
    ny, nx = words.shape
    row, column, reach = (y - low) / cell_m - 0.5, (x - left) / cell_m - 0.5, reach_m / cell_m
    first, last = max(math.floor(column - reach), 0) // 8, min(math.floor(column + reach) // 8 + 1, nx)
    for iy in range(max(math.ceil(row - reach), 0), min(math.floor(row + reach) + 1, ny)):
        for word in range(first, last):
            drawn = np.uint64(0) if only_path else words[iy, word] & ~(own[iy, word] | seen[iy, word])
            drawing[iy, word] = drawn | laid[iy, word]


@njit(cache=True)
def _sum_of_attractions(
    frontier: Bytes,
    ignored: Bytes,
    vain: Bytes,
    path: Bytes,
    laid: bool,
    only_path: bool,
    left: float,
    low: float,
    cell_m: float,
    x: float,
    y: float,
    reach_m: float,
) -> Vector:
    """Return ``sum_of_frontiers`` over what :func:`attract` draws, without drawing it.

    Unless it is *laid*, *path* holds nothing and is not read: most of the time goes into fetching empty words.
    """
    words, own, seen = frontier.view(np.uint64), ignored.view(np.uint64), vain.view(np.uint64)
    ways = path.view(np.uint64) if laid else words
    u, v, reach = (x - left) / cell_m - 0.5, (y - low) / cell_m - 0.5, reach_m / cell_m
    sum_u, sum_v = 0.0, 0.0
    left_most, right_most = words_within(u, 0.0, reach, words.shape[1])
    for iy in range(max(math.ceil(v - reach), 0), min(math.floor(v + reach) + 1, words.shape[0])):
        row, way, some = words[iy, left_most:right_most], ways[iy, left_most:right_most], np.uint64(0)
        for word in range(row.size):
            some |= row[word] | way[word]
        if some == 0:  # most rows hold nothing
            continue
        dv = iy - v
        for word in range(left_most, right_most):
            if words[iy, word] | ways[iy, word] == 0:
                continue
            drawn, ix = ways[iy, word] if laid else np.uint64(0), WORD * word
            if not only_path:
                drawn |= words[iy, word] & ~(own[iy, word] | seen[iy, word])
            while drawn:  # the lowest byte of a word is its first cell (little-endian)
                if drawn & _BYTE:
                    strength = strength_of(ix - u, dv, reach)
                    sum_u += strength * (ix - u)
                    sum_v += strength * dv
                drawn, ix = drawn >> _WIDTH, ix + 1
    scale = 1.0 / (cell_m * cell_m)
    return scale * sum_u, scale * sum_v


@njit(cache=True)
def forces(
    frontier: Bytes,
    ignored: Bytes,
    vain: Bytes,
    path: Bytes,
    laid: bool,
    only_path: bool,
    evidence: Evidence,
    left: float,
    low: float,
    cell_m: float,
    x: float,
    y: float,
    frontier_m: float,
    obstacle_m: float,
    in_sight: bool,
) -> Forces:
    """Return the fields at (x, y) of what attracts (:func:`attract`) and of what repels, each with gain 1.

    Both point to their cells. *laid* is whether *path* holds any. Lengths in metres, the grid's lower left corner at
    (left, low).
    """
    fx, fy = _sum_of_attractions(frontier, ignored, vain, path, laid, only_path, left, low, cell_m, x, y, frontier_m)
    ox, oy = sum_of_obstacles(evidence, left, low, cell_m, x, y, obstacle_m, in_sight)
    return fx, fy, ox, oy


@njit(cache=True)
def seen_frontiers(
    frontier: Bytes,
    without: Bytes,
    vain: Bytes,
    evidence: Evidence,
    through: bool,
    cell: int,
    reach: float,
    found: Int32s,
) -> int:
    """Return how many frontiers are in sight of *cell* within *reach* (cells); list as many in *found* as it can hold.

    Sight only passes cells that are known to be empty, and with *through* frontiers as well; see
    :func:`cosim.geometry.planning.in_view`. Frontiers that are in *without* or *vain* do not count.
    """
    words, own, other = frontier.view(np.uint64), without.view(np.uint64), vain.view(np.uint64)
    ny, nx = evidence.shape
    iy, ix, most = cell // nx, cell % nx, int(reach)
    y0, y1, x0, x1 = max(iy - most, 0), min(iy + most + 1, ny), max(ix - most, 0), min(ix + most + 1, nx)
    clear = evidence[y0:y1, x0:x1] < 0
    if through:
        clear |= frontier[y0:y1, x0:x1] != 0
    width, here, count = x1 - x0, (iy - y0) * (x1 - x0) + ix - x0, 0
    clear[iy - y0, ix - x0] = True
    for y in range(y0, y1):
        for word in range(x0 // 8, (x1 - 1) // 8 + 1):
            if words[y, word] & ~(own[y, word] | other[y, word]) == 0:
                continue
            for x in range(max(8 * word, x0), min(8 * word + 8, x1)):
                asked = frontier[y, x] != 0 and without[y, x] == 0 and vain[y, x] == 0
                if not asked or (y - iy) ** 2 + (x - ix) ** 2 > reach * reach or count == found.shape[0]:
                    continue
                before = clear[y - y0, x - x0]
                clear[y - y0, x - x0] = True
                if in_view(clear, here, (y - y0) * width + x - x0):
                    found[count] = y * nx + x
                    count += 1
                clear[y - y0, x - x0] = before
    return count


@njit(cache=True)
def any_left(frontier: Bytes, ignored: Bytes, vain: Bytes) -> bool:
    """Return whether there is a frontier that is neither *ignored* nor *vain*."""
    words, own, other = frontier.view(np.uint64), ignored.view(np.uint64), vain.view(np.uint64)
    for iy in range(words.shape[0]):
        for word in range(words.shape[1]):
            if words[iy, word] & ~(own[iy, word] | other[iy, word]) != 0:
                return True
    return False


@njit(cache=True)
def take_back(
    path: Bytes,
    cells: Int32s,
    count: int,
    nx: int,
    left: float,
    low: float,
    cell_m: float,
    x: float,
    y: float,
    reach_m: float,
    goal_m: float,
) -> int:
    """Remove the cells that are within *reach_m* of (x, y) from a path; return how many are left.

    ``cells[:count]`` are those of the path; the last, its goal, is removed within *goal_m*.
    """
    kept = 0
    for k in range(count):
        cell = int(cells[k])
        iy, ix = cell // nx, cell % nx
        away = elementary.hypot(left + (ix + 0.5) * cell_m - x, low + (iy + 0.5) * cell_m - y)
        if away <= (goal_m if k == count - 1 else reach_m):
            path[iy, ix] = 0
        else:
            cells[kept] = cells[k]
            kept += 1
    return kept
