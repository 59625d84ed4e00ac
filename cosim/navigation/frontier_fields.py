"""Fields of frontiers and obstacles: sums over the cells of a map (Lau, equations 3 and 4; Reif and Wang, 1999).

Each cell within reach of the robot adds the unit vector from the robot to the cell's centre, divided by the square of
the distance in metres. A gain makes a force of it: ``gain * sum`` attracts (eq. 3), ``-gain * sum`` repels (eq. 4). The
paper does not say where a cell is; here it is at its centre. Nearer than half a cell counts as half a cell, so that no
field is infinite; the direction stays, and a robot at the very centre feels nothing of its own cell. The arrays are
those of ``cosim.geometry.marking``, the grid's lower left corner is at the origin (metres).
"""

import math
from typing import Any, Final, TypeAlias

import numpy as np

from cosim.arrays import Bytes
from cosim.jit import njit

Evidence: TypeAlias = np.ndarray[Any, np.dtype[np.int8]]
Vector: TypeAlias = tuple[float, float]

WORD: Final = 8
"""Number of cells in a word, which are read at once."""
_LEAST_SQUARE: Final = 0.25
"""Square of the least distance, in cells."""
_TIE: Final = 1e-9
"""Share of its length within which a line that meets two edges passes through a corner."""


@njit(cache=True)
def words_within(u: float, dv: float, reach: float, most: int) -> tuple[int, int]:
    """Return the first word, and the first beyond, of *most* in a row *dv* off that may have cells within *reach* of u.

    Lengths in cells; cell 0 has its centre at 0.
    """
    half = math.sqrt(max(reach * reach - dv * dv, 0.0))
    return max(math.floor(u - half), 0) // WORD, min(math.floor(u + half) // WORD + 1, most)


@njit(cache=True)
def strength_of(du: float, dv: float, reach: float) -> float:
    """Return by what the vector (du, dv) to a cell is multiplied in the sum: 0 beyond *reach*; lengths in cells."""
    square = du * du + dv * dv
    if not 0.0 < square <= reach * reach:
        return 0.0
    return 1.0 / (math.sqrt(square) * max(square, _LEAST_SQUARE))


@njit(cache=True)
def sum_of_frontiers(
    frontier: Bytes, origin_x: float, origin_y: float, cell_m: float, x: float, y: float, reach_m: float
) -> Vector:
    """Return the sum of the field (1 / m^2) of all cells that are not 0 in *frontier* and not farther than *reach_m*.

    *frontier* has the shape (ny, a multiple of 8) and 0 in the padding. Source: Lau, equation 3, with gain 1.
    """
    words = frontier.view(np.uint64)
    u, v, reach = (x - origin_x) / cell_m - 0.5, (y - origin_y) / cell_m - 0.5, reach_m / cell_m
    sum_u, sum_v = 0.0, 0.0
    for iy in range(max(math.ceil(v - reach), 0), min(math.floor(v + reach) + 1, words.shape[0])):
        dv = iy - v
        first, last = words_within(u, dv, reach, words.shape[1])
        for word in range(first, last):
            if words[iy, word] == 0:
                continue
            for ix in range(WORD * word, WORD * word + WORD):
                if frontier[iy, ix] != 0:
                    strength = strength_of(ix - u, dv, reach)
                    sum_u += strength * (ix - u)
                    sum_v += strength * dv
    scale = 1.0 / (cell_m * cell_m)
    return scale * sum_u, scale * sum_v


@njit(cache=True)
def sum_of_obstacles(
    evidence: Evidence,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    x: float,
    y: float,
    reach_m: float,
    in_sight: bool,
) -> Vector:
    """Return the sum of the field (1 / m^2) of all occupied cells not farther than *reach_m*; it points to them.

    With *in_sight* only those count to whose centre the line from the robot passes no other occupied cell; the cell in
    which the robot is hides nothing, and a line through a corner of cells passes between them. Source: Lau, equation 4
    without its sign, with gain 1; line of sight is what the paper proposes for larger reaches.
    """
    ny, nx = evidence.shape
    u, v, reach = (x - origin_x) / cell_m - 0.5, (y - origin_y) / cell_m - 0.5, reach_m / cell_m
    sum_u, sum_v = 0.0, 0.0
    for iy in range(max(math.ceil(v - reach), 0), min(math.floor(v + reach) + 1, ny)):
        dv = iy - v
        for ix in range(max(math.ceil(u - reach), 0), min(math.floor(u + reach) + 1, nx)):
            if evidence[iy, ix] > 0:
                strength = strength_of(ix - u, dv, reach)
                if strength > 0.0 and not (in_sight and _hidden(evidence, u, v, ix, iy)):
                    sum_u += strength * (ix - u)
                    sum_v += strength * dv
    scale = 1.0 / (cell_m * cell_m)
    return scale * sum_u, scale * sum_v


@njit(cache=True)
def _hidden(evidence: Evidence, u: float, v: float, goal_x: int, goal_y: int) -> bool:
    """Return whether an occupied cell lies between (u, v), where cell (0, 0) has its centre at (0, 0), and a goal.

    Source: J. Amanatides and A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
    """
    ny, nx = evidence.shape
    ix, iy = math.floor(u + 0.5), math.floor(v + 0.5)
    du, dv = goal_x - u, goal_y - v
    step_x, step_y = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
    every_x = 1.0 / abs(du) if du != 0.0 else math.inf
    every_y = 1.0 / abs(dv) if dv != 0.0 else math.inf
    next_x = (0.5 + step_x * (ix - u)) * every_x if du != 0.0 else math.inf
    next_y = (0.5 + step_y * (iy - v)) * every_y if dv != 0.0 else math.inf
    while ix != goal_x or iy != goal_y:
        across, along = next_x - next_y <= _TIE, next_y - next_x <= _TIE
        if min(next_x, next_y) >= 1.0:
            return False  # rounding at the goal's edge
        if across:
            ix += step_x
            next_x += every_x
        if along:
            iy += step_y
            next_y += every_y
        if ix == goal_x and iy == goal_y:
            return False
        if 0 <= ix < nx and 0 <= iy < ny and evidence[iy, ix] > 0:
            return True
    return False
