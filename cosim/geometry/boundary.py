"""Outlines of obstacles for a point robot: closed loops to walk along, and what of them a point can see.

The robot is a point, the obstacles are grown by its radius (``inflated``). Their outlines are disjoint simple loops: an
obstacle is walked around on its outside, an enclosure (the walls around a room) on its inside. A ``Boundary`` holds the
edges of all loops in the order in which they are walked, the obstacle at the right hand if the robot turns left where
it meets one ("local direction left"), else at its left. A place on it is an edge and the metres along that edge.

Sight: the points of a base segment P-Q that an apex C does not see lie in the shadows of the edges that reach into the
triangle C P Q. A shadow is an interval of fractions of the base; the kernels here cast and join shadows. A kernel that
looks from C at P-Q reads nothing but the parts of edges inside that triangle, so a robot learns nothing of what is out
of sight. Floating point: a shadow narrower than ``SLACK_M`` at the base's beginning is none (the line C-P may graze a
corner that lies behind the sweep), and a robot that touches an edge looks from ``CLEAR_M`` beside it.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

import cosim.elementary as elementary
from cosim.arrays import Floats, Int32s, Int64s
from cosim.geometry.segments import SegmentGrid, cells_near, packed_walls, segment_grid, unpacked
from cosim.jit import njit

PackedBoundary: TypeAlias = tuple[Floats, Int32s, Int64s, float]
"""Numbers and members of the grid, links (3, n), and the side."""

CLEAR_M: Final = 1e-6
"""Distance between an edge and the eye of a robot that touches it."""
SLACK_M: Final = 1e-7
"""Length below which a shadow, the rest of an edge or a gap between two places is rounding."""
_DEEP_M: Final = 1.0
"""Depth inside an obstacle up to which a point is moved to the nearest place of its boundary."""
_NARROW: Final = 0.05
"""Half the angle of the narrowest corner (sine) whose both sides the eye keeps its distance from."""


class Boundary(NamedTuple):
    """Edges of closed loops in walking order; row *e* of ``grid.walls_m`` is edge *e*."""

    grid: SegmentGrid
    following: Int64s
    """The edge after each edge, (n,)."""
    preceding: Int64s
    """The edge before each edge, (n,)."""
    loop: Int64s
    """The number of each edge's loop, (n,): obstacles first, in the order given, then enclosures."""
    side: float
    """1.0 if the obstacle is on the right of a walker (local direction left), else -1.0."""


def boundary(
    obstacles: Sequence[npt.ArrayLike], enclosures: Sequence[npt.ArrayLike] = (), *, left: bool = True
) -> Boundary:
    """Return the boundary of polygons, each an array of vertices (k, 2) in metres, in any orientation.

    Free space is outside of all *obstacles* and inside of the *enclosures*. Loops must be simple and must not touch
    each other; *left* is the local direction. Repeated vertices are dropped. Raise ValueError for a loop that
    encloses nothing.
    """
    edges, following, loop = [], [], []
    first = 0
    for number, vertices in enumerate((*obstacles, *enclosures)):
        ring = _tidy(np.asarray(vertices, dtype=np.float64))
        anticlockwise = _area(ring) > 0.0
        # the free side is to the left of who turns left: obstacles clockwise, enclosures against the clock
        if anticlockwise != (left == (number >= len(obstacles))):
            ring = ring[::-1]
        ahead = np.roll(ring, -1, axis=0)
        size = len(ring)
        edges.append(np.hstack((ring, ahead)))
        following.append(first + (np.arange(size) + 1) % size)
        loop.append(np.full(size, number))
        first += size
    grid = segment_grid(np.concatenate(edges) if edges else ())
    after = np.concatenate([np.zeros(0, np.int64), *following]).astype(np.int64)
    before = np.empty_like(after)
    before[after] = np.arange(first)
    loops = np.concatenate([np.zeros(0, np.int64), *loop]).astype(np.int64)
    return Boundary(grid, after, before, loops, 1.0 if left else -1.0)


def packed_boundary(loops: Boundary) -> PackedBoundary:
    """Return *loops* in parts (``unpacked_boundary``): a kernel gets them ten times faster than as named tuples."""
    links = np.stack((loops.following, loops.preceding, loops.loop))
    return *packed_walls(loops.grid), links, loops.side


@njit(cache=True)
def unpacked_boundary(numbers: Floats, members: Int32s, links: Int64s, side: float) -> Boundary:
    """Return the boundary of :func:`packed_boundary`; a kernel for kernels."""
    return Boundary(unpacked(numbers, members), links[0], links[1], links[2], side)


def _tidy(ring: Floats) -> Floats:
    """Return *ring* without vertices that repeat the one before, within SLACK_M."""
    if ring.ndim == 2 and ring.shape[1] == 2:
        ring = ring[elementary.hypots(*(ring - np.roll(ring, 1, axis=0)).T) > SLACK_M]
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or _area(ring) == 0.0:
        raise ValueError(f"a loop of the shape {ring.shape} encloses nothing")
    return ring


def _area(ring: Floats) -> float:
    (x, y), (x_next, y_next) = ring.T, np.roll(ring, -1, axis=0).T
    return float((x * y_next - x_next * y).sum()) / 2.0


def inflated(walls_m: npt.ArrayLike, radius_m: float, quad_segs: int = 4) -> tuple[list[Floats], list[Floats]]:
    """Grow *walls_m*, rows of x1, y1, x2, y2, by *radius_m*; return the loops of obstacles and those of enclosures.

    A quarter circle becomes *quad_segs* edges, all outside of the circle: a disc of that radius at any place of a loop
    touches no wall. So loops run up to ``radius_m (1 / cos(pi / (4 quad_segs)) - 1)`` farther out, 2 % by default.
    Gaps that the disc does not fit through are closed. For set-up only (shapely).
    """
    walls = np.asarray(walls_m, dtype=np.float64).reshape(-1, 2, 2)
    reach = radius_m / elementary.cos(math.pi / (4 * quad_segs))
    grown = shapely.union_all(shapely.buffer(shapely.linestrings(walls), reach, quad_segs=quad_segs))
    parts = [part for part in shapely.get_parts(grown) if not part.is_empty]
    obstacles = [_vertices(part.exterior) for part in parts]
    return obstacles, [_vertices(ring) for part in parts for ring in part.interiors]


def _vertices(ring: shapely.LinearRing) -> Floats:
    """Return the vertices of a ring, to 2**-40 m: the last bits depend on the C library's sines."""
    return np.asarray(np.round(np.asarray(ring.coords)[:-1] * 2.0**40) * 2.0**-40)


def visible_stretches(loops: Boundary, x_m: float, y_m: float, radius_m: float) -> Floats:
    """Return what a point in free space sees of the boundary within a radius: rows (edge, from_m, to_m) along edges.

    A row is a stretch of an edge without a gap; an edge has as many rows as it has visible stretches.
    """
    _, _, x, y = stand_clear(loops, float(x_m), float(y_m))
    return _stretches(loops, x, y, float(radius_m))


# ---------------------------------------------------------------- places


@njit(cache=True)
def edge_length(loops: Boundary, edge: int) -> float:
    """Return the length of an edge in metres; a kernel for kernels."""
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    return elementary.hypot(x2 - x1, y2 - y1)


@njit(cache=True)
def point_at(loops: Boundary, edge: int, along_m: float) -> tuple[float, float]:
    """Return the point *along_m* metres along an edge; a kernel for kernels."""
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    f = min(along_m / elementary.hypot(x2 - x1, y2 - y1), 1.0)
    return (x2, y2) if f == 1.0 else (x1 + f * (x2 - x1), y1 + f * (y2 - y1))


@njit(cache=True)
def free_height(loops: Boundary, edge: int, x: float, y: float) -> float:
    """Return how far to the free side of an edge's line a point is, in metres; a kernel for kernels."""
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    return float(loops.side * ((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1)) / elementary.hypot(x2 - x1, y2 - y1))


@njit(cache=True)
def convex(loops: Boundary, edge: int) -> bool:
    """Return whether the obstacle's corner at the end of an edge has less than 180 degrees; a kernel for kernels."""
    _, _, x, y = loops.grid.walls_m[loops.following[edge]]
    return free_height(loops, edge, x, y) < 0.0


@njit(cache=True)
def nearest_place(loops: Boundary, x: float, y: float, limit_m: float) -> tuple[int, float, float]:
    """Return the edge, the metres along it and the distance of the nearest place within a limit, or edge -1.

    A kernel for kernels.
    """
    grid = loops.grid
    found, along, best = -1, 0.0, limit_m * limit_m
    low_x, high_x, low_y, high_y = cells_near(grid, x, y, x, y, limit_m)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            edge = grid.member[slot]
            x1, y1, x2, y2 = grid.walls_m[edge]
            wx, wy = x2 - x1, y2 - y1
            square = wx * wx + wy * wy
            f = min(max(((x - x1) * wx + (y - y1) * wy) / square, 0.0), 1.0)
            rx, ry = x - (x1 + f * wx), y - (y1 + f * wy)
            if rx * rx + ry * ry < best:
                found, along, best = edge, f * math.sqrt(square), rx * rx + ry * ry
    return found, along, math.sqrt(best)


@njit(cache=True)
def stand_clear(loops: Boundary, x: float, y: float) -> tuple[float, float, float, float]:
    """Return the place of a robot and that of its eye, two points in metres; a kernel for kernels.

    In free space both are (x, y). A point inside an obstacle, up to a metre deep, stands at the nearest place of the
    boundary. The eye of a robot at the boundary is CLEAR_M beside it.
    """
    edge, along, distance = nearest_place(loops, x, y, _DEEP_M)
    if edge < 0:
        return x, y, x, y
    length = edge_length(loops, edge)
    corner = -1  # the edge that ends at the nearest corner
    if along < 2 * CLEAR_M / _NARROW:
        corner = loops.preceding[edge]
    elif along > length - 2 * CLEAR_M / _NARROW:
        corner = edge
    outside = free_height(loops, edge, x, y) > 0.0
    if corner >= 0:
        one, two = free_height(loops, corner, x, y), free_height(loops, loops.following[corner], x, y)
        outside = max(one, two) > 0.0 if convex(loops, corner) else min(one, two) > 0.0
    if outside and distance >= CLEAR_M:
        return x, y, x, y
    px, py = point_at(loops, edge, along)
    if corner < 0:
        nx, ny = _normal(loops, edge)
        return px, py, px + CLEAR_M * nx, py + CLEAR_M * ny
    ax, ay = _normal(loops, corner)
    bx, by = _normal(loops, loops.following[corner])
    size = max(elementary.hypot(ax + bx, ay + by), 1e-9)
    nx, ny = (ax + bx) / size, (ay + by) / size
    away = CLEAR_M / max(nx * ax + ny * ay, _NARROW)
    return px, py, px + away * nx, py + away * ny


@njit(cache=True)
def _normal(loops: Boundary, edge: int) -> tuple[float, float]:
    """Return the unit vector from an edge into free space."""
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    scale = loops.side / elementary.hypot(x2 - x1, y2 - y1)
    return -scale * (y2 - y1), scale * (x2 - x1)


# ---------------------------------------------------------------- sight


@njit(cache=True)
def within(cx: float, cy: float, radius_m: float, px: float, py: float, qx: float, qy: float) -> tuple[float, float]:
    """Return the interval of fractions of P-Q inside the disc about C, empty as (1, 0); a kernel for kernels."""
    dx, dy, ex, ey = qx - px, qy - py, px - cx, py - cy
    square, half = dx * dx + dy * dy, dx * ex + dy * ey
    if square == 0.0:
        return (0.0, 1.0) if ex * ex + ey * ey <= radius_m * radius_m else (1.0, 0.0)
    root = half * half - square * (ex * ex + ey * ey - radius_m * radius_m)
    if root < 0.0:
        return 1.0, 0.0
    low, high = max((-half - math.sqrt(root)) / square, 0.0), min((-half + math.sqrt(root)) / square, 1.0)
    return (low, high) if low <= high else (1.0, 0.0)


@njit(cache=True)
def _shadow(
    cx: float, cy: float, px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """Return the fractions of the base P-Q that a-b hides from C, empty as (2, -1)."""
    px, py, qx, qy = px - cx, py - cy, qx - cx, qy - cy
    ax, ay, bx, by = ax - cx, ay - cy, bx - cx, by - cy
    area = px * qy - py * qx
    sign = 1.0 if area >= 0.0 else -1.0
    # three linear functions, all >= 0 in the triangle: from the leg C-P, from the leg C-Q, from the base
    leg_p_a, leg_p_b = sign * (px * ay - py * ax), sign * (px * by - py * bx)
    leg_q_a, leg_q_b = sign * (ax * qy - ay * qx), sign * (bx * qy - by * qx)
    base_a, base_b = sign * area - leg_p_a - leg_q_a, sign * area - leg_p_b - leg_q_b
    if (leg_p_a <= 0.0 and leg_p_b <= 0.0) or (leg_q_a <= 0.0 and leg_q_b <= 0.0) or (base_a <= 0.0 and base_b <= 0.0):
        return 2.0, -1.0
    low, high = 0.0, 1.0
    for one, two in ((leg_p_a, leg_p_b), (leg_q_a, leg_q_b), (base_a, base_b)):
        if one < 0.0:
            low = max(low, one / (one - two))
        elif two < 0.0:
            high = min(high, one / (one - two))
    if low >= high:
        return 2.0, -1.0
    p_low, q_low = leg_p_a + low * (leg_p_b - leg_p_a), leg_q_a + low * (leg_q_b - leg_q_a)
    p_high, q_high = leg_p_a + high * (leg_p_b - leg_p_a), leg_q_a + high * (leg_q_b - leg_q_a)
    one = p_low / (p_low + q_low) if p_low + q_low > 0.0 else 0.0
    two = p_high / (p_high + q_high) if p_high + q_high > 0.0 else 0.0
    return min(one, two), max(one, two)


@njit(cache=True)
def seen_until(loops: Boundary, cx: float, cy: float, px: float, py: float, qx: float, qy: float, own: int) -> float:
    """Return the fraction up to which C sees P-Q without a gap, given that it sees P; a kernel for kernels.

    Edge *own*, on which the base lies, casts no shadow on it (-1: none).
    """
    grid = loops.grid
    width = elementary.hypot(qx - px, qy - py)
    best = 1.0
    low_x, high_x = min(cx, px, qx), max(cx, px, qx)
    low_y, high_y = min(cy, py, qy), max(cy, py, qy)
    i_x, j_x, i_y, j_y = cells_near(grid, low_x, low_y, high_x, high_y, SLACK_M)
    for iy in range(i_y, j_y):
        for slot in range(grid.first[iy * grid.nx + i_x], grid.first[iy * grid.nx + j_x]):
            edge = grid.member[slot]
            ax, ay, bx, by = grid.walls_m[edge]
            if max(ax, bx) < low_x or min(ax, bx) > high_x or max(ay, by) < low_y or min(ay, by) > high_y:
                continue
            if edge == own:
                continue
            low, high = _shadow(cx, cy, px, py, qx, qy, ax, ay, bx, by)
            if low < best and high * width > SLACK_M:
                best = low
    return best


@njit(cache=True)
def shadows(
    loops: Boundary, cx: float, cy: float, px: float, py: float, qx: float, qy: float, own: int
) -> tuple[Floats, Floats]:
    """Return the beginnings and ends, as fractions, of all shadows on P-Q as seen from C; a kernel for kernels."""
    grid = loops.grid
    low_x, high_x = min(cx, px, qx), max(cx, px, qx)
    low_y, high_y = min(cy, py, qy), max(cy, py, qy)
    i_x, j_x, i_y, j_y = cells_near(grid, low_x, low_y, high_x, high_y, SLACK_M)
    size = 0
    for iy in range(i_y, j_y):
        size += grid.first[iy * grid.nx + j_x] - grid.first[iy * grid.nx + i_x]
    begin, end = np.empty(size), np.empty(size)
    count = 0
    for iy in range(i_y, j_y):
        for slot in range(grid.first[iy * grid.nx + i_x], grid.first[iy * grid.nx + j_x]):
            edge = grid.member[slot]
            ax, ay, bx, by = grid.walls_m[edge]
            if max(ax, bx) < low_x or min(ax, bx) > high_x or max(ay, by) < low_y or min(ay, by) > high_y:
                continue
            if edge != own:
                low, high = _shadow(cx, cy, px, py, qx, qy, ax, ay, bx, by)
                if low <= high:
                    begin[count], end[count] = low, high
                    count += 1
    return begin[:count], end[:count]


@njit(cache=True)
def last_seen(loops: Boundary, cx: float, cy: float, px: float, py: float, qx: float, qy: float) -> float:
    """Return the largest fraction of P-Q that C sees, or 0; a kernel for kernels."""
    begin, end = shadows(loops, cx, cy, px, py, qx, qy, -1)
    slack = SLACK_M / max(elementary.hypot(qx - px, qy - py), SLACK_M)
    best, changed = 1.0, True
    while changed and best > 0.0:
        changed = False
        for i in range(begin.shape[0]):
            if begin[i] < best <= end[i] + slack:
                best, changed = begin[i], True
    return best


@njit(cache=True)
def _stretches(loops: Boundary, cx: float, cy: float, radius: float) -> Floats:
    found = [(0.0, 0.0, 0.0) for _ in range(0)]
    for edge in range(loops.following.shape[0]):
        if free_height(loops, edge, cx, cy) < SLACK_M:
            continue
        x1, y1, x2, y2 = loops.grid.walls_m[edge]
        length = edge_length(loops, edge)
        low, high = within(cx, cy, radius, x1, y1, x2, y2)
        if (high - low) * length <= SLACK_M:
            continue
        begin, end = shadows(loops, cx, cy, x1, y1, x2, y2, edge)
        order = np.argsort(begin)
        for i in range(order.shape[0] + 1):
            stop = high if i == order.shape[0] else min(begin[order[i]], high)
            if (stop - low) * length > SLACK_M:
                found.append((float(edge), low * length, stop * length))
            if i < order.shape[0]:
                low = max(low, end[order[i]])
    rows = np.empty((len(found), 3))
    for i in range(len(found)):
        rows[i, 0], rows[i, 1], rows[i, 2] = found[i]
    return rows
