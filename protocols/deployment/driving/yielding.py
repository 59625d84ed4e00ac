"""Making way: where a robot goes so that another can pass (paper 004, section 5).

"The robots move away (roughly perpendicular to the route of the moving robot), wait until the robot has passed, then
move back into position." Ours go to the nearest place, by the way to it, that is far enough off the other's route.
Where there is room this is beside the route; otherwise it is along the corridor, in the next door or round the corner.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.planning import PlanningGrid
from cosim.geometry.value_iteration import values
from cosim.jit import njit
from protocols.deployment.tasks.plan import Place
from protocols.motion.floor import Blocker, Floor, snapped

_AMPLE_M: Final = 0.1
"""Distance from the way of the robot that passes, beyond a touch and the margins."""
_BESIDE_M: Final = 1.5
"""Largest cost of a place beside the way, where the other can drive round, that is preferred to one off the way."""
_FARTHEST_M: Final = 25.0
"""Longest way that a robot goes out of the way of another."""


class Refuge(NamedTuple):
    """A place out of another robot's way."""

    place_m: Place
    cost_m: float
    """Cost of the way to it."""


def in_the_way(at: Place, radius_m: float, way: Sequence[Place], other_m: float, margin_m: float) -> bool:
    """Return whether a body of *radius_m* at a place would be touched by one of *other_m* that follows a *way*."""
    if not way:
        return False
    line = np.asarray(way, np.float64).reshape(-1, 2)
    return bool(_off_way(line, np.array([at], np.float64))[0] < radius_m + other_m + margin_m)


def refuge(
    floor: Floor,
    radius_m: float,
    me: Place,
    way: Sequence[Place],
    other_m: float,
    blockers: Sequence[Blocker],
    farthest_m: float = _FARTHEST_M,
) -> Refuge | None:
    """Return the nearest place where a body is out of the *way* of another, of radius *other_m*; None without one.

    *way* is that of the other's centre, from where it is; *blockers* are the bodies near by, the other included, as
    obstacles. The refuge is *me* itself if that is off the way. Where nothing near is off the way, it is as far beside
    the way as the body gets, if the other finds a way round it there.
    """
    grid, price = floor.grid(radius_m)
    need_m = radius_m + other_m + 2.0 * floor.parameters.margin_m + _AMPLE_M
    line = np.asarray(way, np.float64).reshape(-1, 2)
    if not len(line) or float(_off_way(line, np.array([me], np.float64))[0]) >= need_m:
        return Refuge(me, 0.0)
    free = floor.free_among(radius_m, blockers)
    start = snapped(PlanningGrid(grid.origin_m, grid.cell_m, free), me)
    if start < 0:
        return None
    cost = values(free, price, [start])
    cells = np.flatnonzero(cost.ravel() * grid.cell_m < farthest_m)
    nx = free.shape[1]
    centres = np.stack((cells % nx, cells // nx), axis=1) * grid.cell_m + (np.array(grid.origin_m) + 0.5 * grid.cell_m)
    off = _off_way(line, np.ascontiguousarray(centres))
    clear = off >= need_m
    hugging = cells[np.where(cost.ravel()[cells] * grid.cell_m < _BESIDE_M, off, -1.0).argmax()]
    beside = grid.centre_m(int(hugging))
    # where the other can drive round the body, the body need not go farther
    if floor.field_among(other_m, way[-1], [Blocker(*beside, radius_m)]).cost_m(way[0]) < math.inf:
        nearer = clear & (cost.ravel()[cells] <= cost.flat[hugging])
        if not nearer.any():
            return Refuge(beside, float(cost.flat[hugging]) * grid.cell_m)
    if not clear.any():
        return None
    best = cells[clear][cost.ravel()[cells[clear]].argmin()]
    return Refuge(grid.centre_m(int(best)), float(cost.flat[best]) * grid.cell_m)


@njit(cache=True)
def _off_way(line: Floats, points: Floats) -> Any:
    """Return the distances of *points* (n, 2) from the line through the rows of *line* (m, 2), in metres."""
    off = np.full(points.shape[0], np.inf)
    for k in range(max(line.shape[0] - 1, 1)):
        px, py = line[k]
        wx, wy = line[min(k + 1, line.shape[0] - 1)] - line[k]
        square = wx * wx + wy * wy
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - px, points[i, 1] - py
            u = min(max((dx * wx + dy * wy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            off[i] = min(off[i], elementary.hypot(dx - u * wx, dy - u * wy))
    return off


def off_way_m(at: Place, way: Sequence[Place]) -> float:
    """Return the distance of a place from a way, metres; inf if the way is empty."""
    if not way:
        return math.inf
    return float(_off_way(np.asarray(way, np.float64).reshape(-1, 2), np.array([at], np.float64))[0])
