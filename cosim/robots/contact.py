"""Discs that move at once, each at constant velocity: how much each way is cut so that none enters another or a wall.

Ways are cut, never turned: a body that would touch ends its tick at contact. Of two bodies only those that move towards
the other are cut, so that a follower does not slow its leader. Every cut can spoil or save other pairs; the pairs are
gone through until nothing changes, after ``ROUNDS`` rounds with cuts to zero, which ends after as many rounds as there
are bodies. A shorter way along the same line is still free of walls.
"""

from typing import Any, Final, TypeAlias

import numpy as np

from cosim.geometry.segments import SegmentGrid, free_fraction
from cosim.jit import njit

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]

ROUNDS: Final = 100
WALL_SLACK_M: Final = 1e-7
"""By how much a body may seem to be inside a wall that it slides along; more than ``grids.TOUCH_M``."""
BODY_SLACK_M: Final = 1e-9
"""By how much two bodies may seem to overlap that pass in touch."""


@njit(cache=True)
def fractions(grid: SegmentGrid, x: Floats, y: Floats, dx: Floats, dy: Floats, radius: Floats) -> Floats:
    """Return which fraction, 0 to 1, of its way (dx, dy) each disc can go; all arrays (n,), in metres.

    Discs that do not overlap before do not overlap at any time of the tick.
    """
    bodies = x.shape[0]
    part = np.ones(bodies)
    for i in range(bodies):
        if dx[i] != 0.0 or dy[i] != 0.0:
            part[i] = free_fraction(grid, x[i], y[i], dx[i], dy[i], radius[i], WALL_SLACK_M)
    near = _near(x, y, dx, dy, radius)
    for turn in range(ROUNDS + bodies + 1):
        settled = True
        for k in range(near.shape[0]):
            i, j = near[k]
            rx, ry, reach = x[i] - x[j], y[i] - y[j], radius[i] + radius[j]
            wx, wy = part[i] * dx[i] - part[j] * dx[j], part[i] * dy[i] - part[j] * dy[j]
            if _enters(rx, ry, wx, wy, reach - BODY_SLACK_M):
                settled = False
                cut_i = part[i] * (rx * dx[i] + ry * dy[i]) < 0.0
                cut_j = part[j] * (rx * dx[j] + ry * dy[j]) > 0.0
                kept = _kept(
                    rx, ry, part[i] * dx[i], part[i] * dy[i], part[j] * dx[j], part[j] * dy[j], reach, cut_i, cut_j
                )
                if turn >= ROUNDS:
                    kept = 0.0
                if cut_i:
                    part[i] *= kept
                if cut_j:
                    part[j] *= kept
        if settled:
            break
    return part


@njit(cache=True)
def _near(x: Floats, y: Floats, dx: Floats, dy: Floats, radius: Floats) -> Any:
    """Return the pairs i < j, shape (n, 2), that could touch with their full ways."""
    bodies = x.shape[0]
    span = radius + np.hypot(dx, dy)
    pairs = [(0, 0) for _ in range(0)]
    for i in range(bodies):
        for j in range(i + 1, bodies):
            rx, ry, reach = x[i] - x[j], y[i] - y[j], span[i] + span[j]
            if rx * rx + ry * ry < reach * reach:
                pairs.append((i, j))
    found = np.empty((len(pairs), 2), np.int64)
    for k in range(len(pairs)):
        found[k, 0], found[k, 1] = pairs[k]
    return found


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
