"""How far a disc goes along a circular arc until it touches something, in closed form.

The disc's centre starts at the origin, along x, on an arc of curvature k (1/m, to the left if positive): its points P
fulfil k P^2 = 2 y, also if k is 0. The disc touches a point or another disc where its centre is at the sum of the radii
from that one's centre, so on a circle about it; a wall, where it is on the edge of the wall grown by the radius: on one
of two lines along the wall, or on a circle about one of its ends. Where the arc meets such a circle it meets the line
through both meetings, k P^2 - 2 y - k (P^2 - 2 c P + c^2 - r^2) = 0, and this line meets the small circle of radius r:
so nothing is lost where the arc is almost straight. The way to P is 2 b / k, b = atan2(y, x) being half of what the
disc has turned, and almost straight it is P b / sin b.

Where a disc starts it is to touch nothing, so the first edge on its way is a contact.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit

X: Final = 0
Y: Final = 1
APART: Final = 2
"""Columns of the table of discs: the centre, and the distance of the centres at contact."""


@njit(cache=True, borrows=True)
def way_to_contact(
    x: float, y: float, heading: float, curvature: float, radius: float, walls: Floats, discs: Floats, most: float
) -> float:
    """Return how far a disc of *radius* goes from (x, y) along an arc until it touches something, at most *most*.

    It starts along *heading*, and turns *curvature* radians a metre, to the left if positive. *walls* (n, 4) are rows
    of x1, y1, x2, y2; *discs* (m, 3) are rows of a centre and of its distance from that of the moving disc at contact.
    The disc is to touch nothing where it starts. Metres and radians.
    """
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    for i in range(discs.shape[0]):
        dx, dy = discs[i, X] - x, discs[i, Y] - y
        reach = most + discs[i, APART]
        if dx * dx + dy * dy < reach * reach:
            most = min(most, _to_disc(cos * dx + sin * dy, cos * dy - sin * dx, discs[i, APART], curvature))
    for i in range(walls.shape[0]):
        ax, ay, bx, by = walls[i, 0] - x, walls[i, 1] - y, walls[i, 2] - x, walls[i, 3] - y
        reach = most + radius
        if min(ax, bx) < reach and max(ax, bx) > -reach and min(ay, by) < reach and max(ay, by) > -reach:
            px, py, qx, qy = cos * ax + sin * ay, cos * ay - sin * ax, cos * bx + sin * by, cos * by - sin * bx
            most = min(most, _to_disc(px, py, radius, curvature), _to_disc(qx, qy, radius, curvature))
            most = min(most, _to_sides(px, py, qx, qy, radius, curvature))
    return most


@njit(cache=True, borrows=True)
def _to_disc(cx: float, cy: float, apart: float, curvature: float) -> float:
    """Return the way from the origin to the first point of the arc that is *apart* from c; inf without one."""
    nx, ny = -curvature * cx, 1.0 - curvature * cy
    length = elementary.hypot(nx, ny)
    if length == 0.0:  # the arc's own centre: it is as far from everywhere
        return math.inf
    nx, ny = nx / length, ny / length
    off = nx * cx + ny * cy + 0.5 * curvature * (cx * cx + cy * cy - apart * apart) / length
    square = apart * apart - off * off
    if square < 0.0:
        return math.inf
    half = math.sqrt(square)
    px, py = cx - off * nx, cy - off * ny
    return min(_way_to(px + half * ny, py - half * nx, curvature), _way_to(px - half * ny, py + half * nx, curvature))


@njit(cache=True, borrows=True)
def _to_sides(px: float, py: float, qx: float, qy: float, radius: float, curvature: float) -> float:
    """Return the way to the first point of the arc that is *radius* beside the wall p-q; inf without one."""
    length = elementary.hypot(qx - px, qy - py)
    if length == 0.0:
        return math.inf
    tx, ty = (qx - px) / length, (qy - py) / length
    start, best = tx * px + ty * py, math.inf
    for side in (-1.0, 1.0):
        # the points of the line are e n + u t, n = (-ty, tx): k u^2 - 2 ty u + k e^2 - 2 e tx = 0
        e = tx * py - ty * px + side * radius
        last = curvature * e * e - 2.0 * e * tx
        square = ty * ty - curvature * last
        if square < 0.0:
            continue
        larger = ty + math.sqrt(square) if ty >= 0.0 else ty - math.sqrt(square)
        if curvature != 0.0:
            best = min(best, _on_side(larger / curvature, e, tx, ty, start, length, curvature))
        if larger != 0.0:
            best = min(best, _on_side(last / larger, e, tx, ty, start, length, curvature))
    return best


@njit(cache=True, borrows=True)
def _on_side(u: float, e: float, tx: float, ty: float, start: float, length: float, curvature: float) -> float:
    if not start <= u <= start + length:
        return math.inf
    return _way_to(u * tx - e * ty, u * ty + e * tx, curvature)


@njit(cache=True, borrows=True)
def _way_to(x: float, y: float, curvature: float) -> float:
    """Return the way along the arc to one of its points."""
    half = elementary.atan2(y, x)
    if x > 0.0:
        chord: float = elementary.hypot(x, y)
        return chord if half == 0.0 else chord * half / elementary.sin(half)
    return math.inf if curvature == 0.0 else 2.0 * abs(half) / abs(curvature)
