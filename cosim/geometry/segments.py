"""Walls as line segments: lines of sight, ray casts, and how near a disc comes to them.

Walls are rows x1, y1, x2, y2 (metres) of an array. A ``SegmentGrid`` sorts them into square cells, so that a query
looks only at the walls near it; a wall is listed in every cell that it meets or almost meets, so rounding loses none.
Whether a line passes a wall's end is decided by orientations that two walls with a common corner compute alike: no
sight line slips through between them.

Walls are closed sets. A sight line is open: it is blocked where it touches a wall, also a wall's end, but not by a wall
that meets it only at one of its own two ends.

Where the walls crossed are *counted*, each is to count once, also where a line meets the joint of two pieces of one
wall. There a line counts as shifted to its right by less than any distance (right when looking the way x grows, or else
y: the same both ways). So of two pieces in a row one is crossed; of a corner that the line only touches both sides or
none; a wall along the line is not; and a closed outline is crossed an even number of times between points outside it.
"""

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s, Int64s
from cosim.jit import njit

MISS: Final = 2.0
"""Value for no hit where a hit is a fraction of a way, 0 to 1."""
_PAD: Final = 1e-6
"""Overlap of neighbouring cells, as a share of a cell."""


class SegmentGrid(NamedTuple):
    """Walls, and the walls of each cell c = iy * nx + ix of a grid over them: ``member[first[c]:first[c + 1]]``."""

    walls_m: Floats
    x_m: float
    y_m: float
    cell_m: float
    nx: int
    ny: int
    first: Int32s
    member: Int32s


def segment_grid(walls_m: npt.ArrayLike) -> SegmentGrid:
    """Sort *walls_m*, shape (n, 4), into a grid of about as many cells; raise ValueError for another shape."""
    walls = np.ascontiguousarray(walls_m, dtype=np.float64)
    if walls.size == 0:
        walls = walls.reshape(0, 4)
    if walls.ndim != 2 or walls.shape[1] != 4 or not np.isfinite(walls).all():
        raise ValueError(f"walls are finite rows of x1, y1, x2, y2, not an array of shape {walls.shape}")
    if not len(walls):
        return SegmentGrid(walls, 0.0, 0.0, 1.0, 1, 1, np.zeros(2, np.int32), np.zeros(0, np.int32))
    low = np.minimum(walls[:, :2], walls[:, 2:]).min(axis=0)
    width, height = (np.maximum(walls[:, :2], walls[:, 2:]).max(axis=0) - low).tolist()
    cell = max(math.sqrt(width * height / len(walls)), max(width, height) / 256, 1e-3)
    nx, ny = int((width + 2 * _PAD * cell) / cell) + 1, int((height + 2 * _PAD * cell) / cell) + 1
    x, y = float(low[0]) - _PAD * cell, float(low[1]) - _PAD * cell
    first = np.zeros(nx * ny + 1, np.int32)
    _list_members(walls, x, y, cell, nx, ny, first, np.zeros(0, np.int32))
    first = np.concatenate((np.zeros(1, np.int32), np.cumsum(first[:-1], dtype=np.int32)))
    member = np.zeros(int(first[-1]), np.int32)
    _list_members(walls, x, y, cell, nx, ny, first.copy(), member)
    return SegmentGrid(walls, x, y, cell, nx, ny, first, member)


PackedWalls: TypeAlias = tuple[Floats, Int32s]
"""A grid of walls as two arrays, numbers and members."""


def packed_walls(grid: SegmentGrid) -> PackedWalls:
    """Return *grid* as two arrays, numbers and members: a kernel gets them faster than eight fields (``unpacked``)."""
    numbers = np.concatenate(([grid.x_m, grid.y_m, grid.cell_m], grid.walls_m.ravel()))
    sizes = np.array([grid.nx, grid.ny], np.int32)
    return numbers, np.concatenate((sizes, grid.first, grid.member))


@njit(cache=True)
def unpacked(numbers: Floats, members: Int32s) -> SegmentGrid:
    """Return the grid of :func:`packed_walls`; a kernel for kernels."""
    nx, ny = members[0], members[1]
    first_end = 2 + nx * ny + 1
    return SegmentGrid(
        numbers[3:].reshape((numbers.shape[0] - 3) // 4, 4),
        numbers[0],
        numbers[1],
        numbers[2],
        nx,
        ny,
        members[2:first_end],
        members[first_end:],
    )


def sees(grid: SegmentGrid, a_m: npt.ArrayLike, b_m: npt.ArrayLike) -> Bools:
    """Return for each row of *a_m* and *b_m*, both (n, 2), whether no wall meets the open segment between them.

    A wall that is touched blocks, even at its end; a wall that only reaches up to a or b does not.
    """
    return _sees(grid, _points(a_m), _points(b_m))


def ray_casts(grid: SegmentGrid, origins_m: npt.ArrayLike, angles_rad: npt.ArrayLike, range_m: float) -> Floats:
    """Return the distances (n,) from *origins_m* (n, 2) along *angles_rad* (n,) to a wall, at most *range_m*."""
    angles = np.ascontiguousarray(angles_rad, dtype=np.float64)
    return _ray_casts(grid, _points(origins_m), angles, float(range_m))


def ring_casts(grid: SegmentGrid, place_m: tuple[float, float], beams: Floats, range_m: float) -> Floats:
    """Return the distances (n,) from a place to a wall, at most *range_m*, along a ring of *beams* (n, 2).

    Beam k is the unit vector at the angle 2 pi k / n. From the end of a wall, that wall may not be seen.
    """
    first = np.empty(len(beams))
    scan_walls(grid, *place_m, 0.0, range_m * beams, range_m, first)
    return np.minimum(first, 1.0) * range_m


def clearance(grid: SegmentGrid, points_m: npt.ArrayLike, limit_m: float) -> Floats:
    """Return the distances (n,) of *points_m* (n, 2) from the nearest wall, in metres, at most *limit_m*."""
    points = _points(points_m)
    return _swept_clearance(grid, points, points, float(limit_m))


def swept_clearance(grid: SegmentGrid, p_m: npt.ArrayLike, q_m: npt.ArrayLike, limit_m: float) -> Floats:
    """Return the distances (n,) of the segments from *p_m* to *q_m*, both (n, 2), from the walls, at most *limit_m*."""
    return _swept_clearance(grid, _points(p_m), _points(q_m), float(limit_m))


def _points(points_m: npt.ArrayLike) -> Floats:
    return np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)


# ---------------------------------------------------------------- kernels


@njit(cache=True, borrows=True)
def _index(value: float, cells: int) -> int:
    return int(min(max(math.floor(value), 0.0), cells - 1.0))


@njit(cache=True, borrows=True)
def _list_members(
    walls: Floats, x: float, y: float, cell: float, nx: int, ny: int, slot: Int32s, member: Int32s
) -> None:
    """Count the walls of each cell in *slot*, or with a *member* to fill, write each wall to its cells' next slots."""
    half = (0.5 + _PAD) * cell
    for wall in range(walls.shape[0]):
        x1, y1, x2, y2 = walls[wall]
        ex, ey = x2 - x1, y2 - y1
        for iy in range(_index((min(y1, y2) - y) / cell - _PAD, ny), _index((max(y1, y2) - y) / cell + _PAD, ny) + 1):
            for ix in range(
                _index((min(x1, x2) - x) / cell - _PAD, nx), _index((max(x1, x2) - x) / cell + _PAD, nx) + 1
            ):
                off = ex * (y + (iy + 0.5) * cell - y1) - ey * (x + (ix + 0.5) * cell - x1)
                if abs(off) <= half * (abs(ex) + abs(ey)):
                    if member.shape[0]:
                        member[slot[iy * nx + ix]] = wall
                    slot[iy * nx + ix] += 1


@njit(cache=True, borrows=True)
def _meets(
    ax: float, ay: float, dx: float, dy: float, cx: float, cy: float, ex: float, ey: float, open_ends: bool
) -> float:
    """Return the fraction s at which a + s d, s in 0..1, first meets the wall from c to e, or MISS.

    With *open_ends* s must lie strictly between 0 and 1; along a wall it is then the middle of the common piece.
    """
    side_c = dx * (cy - ay) - dy * (cx - ax)
    side_e = dx * (ey - ay) - dy * (ex - ax)
    if (side_c > 0.0 and side_e > 0.0) or (side_c < 0.0 and side_e < 0.0):
        return MISS
    if side_c == side_e:  # both 0: the wall lies on the line
        square = dx * dx + dy * dy
        if square == 0.0:
            return MISS
        one = ((cx - ax) * dx + (cy - ay) * dy) / square
        two = ((ex - ax) * dx + (ey - ay) * dy) / square
        low, high = max(min(one, two), 0.0), min(max(one, two), 1.0)
        if low > high:
            return MISS
        s = 0.5 * (low + high) if open_ends else low
    else:
        s = ((cx - ax) * (ey - cy) - (cy - ay) * (ex - cx)) / (side_e - side_c)
    if open_ends:
        return s if 0.0 < s < 1.0 else MISS
    return s if 0.0 <= s <= 1.0 else MISS


@njit(cache=True, borrows=True)
def _clip(start: float, way: float, low: float, high: float, span: tuple[float, float]) -> tuple[float, float]:
    """Cut the *span* of fractions s to those where start + s way lies between low and high."""
    if way == 0.0:
        return span if low <= start <= high else (1.0, 0.0)
    one, two = (low - start) / way, (high - start) / way
    return max(span[0], min(one, two)), min(span[1], max(one, two))


@njit(cache=True, borrows=True)
def _first_hit(grid: SegmentGrid, ax: float, ay: float, dx: float, dy: float, open_ends: bool) -> float:
    """Return the fraction at which the way a + s d first meets a wall, or MISS, visiting cells in order of the way."""
    cell = grid.cell_m
    span = _clip(ax, dx, grid.x_m, grid.x_m + grid.nx * cell, (0.0, 1.0))
    s, end = _clip(ay, dy, grid.y_m, grid.y_m + grid.ny * cell, span)
    if s > end:
        return MISS
    ix = _index((ax + s * dx - grid.x_m) / cell, grid.nx)
    iy = _index((ay + s * dy - grid.y_m) / cell, grid.ny)
    best = MISS
    while True:
        at = iy * grid.nx + ix
        for slot in range(grid.first[at], grid.first[at + 1]):
            x1, y1, x2, y2 = grid.walls_m[grid.member[slot]]
            best = min(best, _meets(ax, ay, dx, dy, x1, y1, x2, y2, open_ends))
        next_x = (grid.x_m + (ix + (1 if dx > 0.0 else 0)) * cell - ax) / dx if dx != 0.0 else math.inf
        next_y = (grid.y_m + (iy + (1 if dy > 0.0 else 0)) * cell - ay) / dy if dy != 0.0 else math.inf
        if best <= min(next_x, next_y) or min(next_x, next_y) > end:
            return best
        if next_x < next_y:
            ix += 1 if dx > 0.0 else -1
        else:
            iy += 1 if dy > 0.0 else -1
        if not (0 <= ix < grid.nx and 0 <= iy < grid.ny):
            return best


@njit(cache=True)
def _sees(grid: SegmentGrid, a: Floats, b: Floats) -> Bools:
    clear = np.empty(a.shape[0], np.bool_)
    for i in range(a.shape[0]):
        clear[i] = in_sight(grid, a[i, 0], a[i, 1], b[i, 0], b[i, 1])
    return clear


@njit(cache=True, borrows=True)
def in_sight(grid: SegmentGrid, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether no wall meets the open segment from a to b (metres); a kernel for kernels, see :func:`sees`."""
    return _first_hit(grid, ax, ay, bx - ax, by - ay, True) == MISS


@njit(cache=True)
def scan_walls(grid: SegmentGrid, x: float, y: float, angle: float, ways: Floats, limit: float, first: Floats) -> None:
    """Write at which fraction of each of the *ways* (n, 2) from a point a wall is met first, or inf; for kernels.

    All ways are *limit* long, and way k points to *angle* + 2 pi k / n: of each wall, only those are cast that it can
    meet, which takes a small part of the time of casting each ray.
    """
    first[:] = math.inf
    looked_at = np.zeros(grid.walls_m.shape[0], np.bool_)  # a long wall is listed in many cells
    low_x, high_x, low_y, high_y = cells_near(grid, x, y, x, y, limit)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            wall = grid.member[slot]
            if looked_at[wall]:
                continue
            looked_at[wall] = True
            x1, y1, x2, y2 = grid.walls_m[wall]
            if _to_segment(x, y, x1, y1, x2, y2)[0] > limit * limit * (1.0 + _PAD):
                continue
            start = elementary.atan2(y1 - y, x1 - x)
            turn = elementary.atan2(y2 - y, x2 - x) - start
            turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
            if abs(turn) > math.pi - _PAD:  # the point is on the wall, or so near that its side is not known
                start, turn = -math.pi, 2.0 * math.pi
            k, count = beams_between(min(start, start + turn) - angle, abs(turn), ways.shape[0])
            for _ in range(count):
                hit = _meets(x, y, ways[k, 0], ways[k, 1], x1, y1, x2, y2, False)
                if hit < first[k] and hit <= 1.0:
                    first[k] = hit
                k = k + 1 if k + 1 < ways.shape[0] else 0


@njit(cache=True, borrows=True)
def beams_between(start: float, width: float, beams: int) -> tuple[int, int]:
    """Return the first beam of a ring, and the number of them, that lie in an angle, and one more at either side.

    The angle goes from *start* on counter-clockwise for *width* (radians); beam 0 is at 0. A kernel for kernels.
    """
    apart = 2.0 * math.pi / beams
    return int(math.floor(start / apart) - 1.0) % beams, min(int(width / apart) + 4, beams)


@njit(cache=True)
def _ray_casts(grid: SegmentGrid, origins: Floats, angles: Floats, limit: float) -> Floats:
    distance = np.empty(angles.shape[0])
    for i in range(angles.shape[0]):
        dx, dy = limit * elementary.cos(angles[i]), limit * elementary.sin(angles[i])
        distance[i] = limit * min(1.0, _first_hit(grid, origins[i, 0], origins[i, 1], dx, dy, False))
    return distance


@njit(cache=True, borrows=True)
def _to_segment(px: float, py: float, cx: float, cy: float, ex: float, ey: float) -> tuple[float, float]:
    """Return the squared distance of p from the segment c-e, and the fraction of the segment that is nearest."""
    wx, wy = ex - cx, ey - cy
    square = wx * wx + wy * wy
    u = 0.0
    if square > 0.0:
        u = min(max(((px - cx) * wx + (py - cy) * wy) / square, 0.0), 1.0)
    rx, ry = px - (cx + u * wx), py - (cy + u * wy)
    return rx * rx + ry * ry, u


@njit(cache=True, borrows=True)
def closest_approach(
    px: float, py: float, qx: float, qy: float, cx: float, cy: float, ex: float, ey: float
) -> tuple[float, float]:
    """Return the squared distance (m2) between the segments p-q and c-e, and the fraction of p-q that is nearest.

    Of several nearest fractions the first end's is returned, else a crossing's.
    """
    best, s = _to_segment(px, py, cx, cy, ex, ey)
    crossing = _meets(px, py, qx - px, qy - py, cx, cy, ex, ey, False)
    if crossing != MISS and best > 0.0:
        return 0.0, crossing
    s = 0.0
    for other, fraction in (
        _to_segment(cx, cy, px, py, qx, qy),
        _to_segment(ex, ey, px, py, qx, qy),
        (_to_segment(qx, qy, cx, cy, ex, ey)[0], 1.0),
    ):
        if other < best:
            best, s = other, fraction
    return best, s


@njit(cache=True)
def _swept_clearance(grid: SegmentGrid, p: Floats, q: Floats, limit: float) -> Floats:
    distance = np.empty(p.shape[0])
    for i in range(p.shape[0]):
        distance[i] = room_along(grid, p[i, 0], p[i, 1], q[i, 0], q[i, 1], limit)
    return distance


@njit(cache=True, borrows=True)
def room_along(grid: SegmentGrid, px: float, py: float, qx: float, qy: float, limit: float) -> float:
    """Return the distance of the segment p-q from the walls, at most *limit*; see :func:`swept_clearance`."""
    best = limit * limit
    low_x, high_x, low_y, high_y = cells_near(grid, px, py, qx, qy, limit)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            x1, y1, x2, y2 = grid.walls_m[grid.member[slot]]
            best = min(best, closest_approach(px, py, qx, qy, x1, y1, x2, y2)[0])
    return math.sqrt(best)


@njit(cache=True, borrows=True)
def cells_near(
    grid: SegmentGrid, px: float, py: float, qx: float, qy: float, limit: float
) -> tuple[int, int, int, int]:
    """Return the half-open ranges of columns and rows (ix, ix, iy, iy) that hold all walls within *limit* of p-q."""
    low_x, high_x = (min(px, qx) - limit - grid.x_m) / grid.cell_m, (max(px, qx) + limit - grid.x_m) / grid.cell_m
    low_y, high_y = (min(py, qy) - limit - grid.y_m) / grid.cell_m, (max(py, qy) + limit - grid.y_m) / grid.cell_m
    if high_x < 0.0 or high_y < 0.0 or low_x > grid.nx or low_y > grid.ny:
        return 0, 0, 0, 0
    return _index(low_x, grid.nx), _index(high_x, grid.nx) + 1, _index(low_y, grid.ny), _index(high_y, grid.ny) + 1


@njit(cache=True, borrows=True)
def free_fraction(grid: SegmentGrid, x: float, y: float, dx: float, dy: float, radius: float, slack: float) -> float:
    """Return which fraction of the way d a disc at (x, y) can go without coming nearer to a wall than *radius*.

    A way that stays *slack* short of the radius, or comes no nearer than the disc stands, is free: a disc that touches
    a wall can slide along it. A way that is not free ends at contact. Distances in metres.
    """
    fraction = 1.0
    low_x, high_x, low_y, high_y = cells_near(grid, x, y, x + dx, y + dy, radius)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            x1, y1, x2, y2 = grid.walls_m[grid.member[slot]]
            qx, qy = x + fraction * dx, y + fraction * dy
            square, s = closest_approach(x, y, qx, qy, x1, y1, x2, y2)
            if square < (radius - slack) ** 2 and s > 0.0:
                fraction *= _contact(x, y, s * (qx - x), s * (qy - y), x1, y1, x2, y2, radius) * s
    return fraction


@njit(cache=True, borrows=True)
def _contact(
    x: float, y: float, dx: float, dy: float, cx: float, cy: float, ex: float, ey: float, radius: float
) -> float:
    """Bisect for the fraction of the way d, on which the distance to c-e falls all the time, where it is *radius*."""
    low, high = 0.0, 1.0
    for _ in range(48):
        middle = 0.5 * (low + high)
        if _to_segment(x + middle * dx, y + middle * dy, cx, cy, ex, ey)[0] >= radius * radius:
            low = middle
        else:
            high = middle
    return low


# ---------------------------------------------------------------- walls crossed

_BLOCK: Final = 64
"""Number of walls in a batch: four of them at a time, in the registers of the processor."""


@njit(cache=True)
def crossed_weights(walls: Floats, weight: Int64s, points: Floats) -> Int64s:
    """Return for each two *points* (m, 2) the sum, (m, m), of *weight* (n,) of the *walls* (n, 4) between them.

    A wall counts if the line between the points crosses it, from one of its sides to the other, see the top of the
    module. Symmetric, 0 on the diagonal. All walls are compared with all pairs: without a branch and without a cell to
    find that is faster than a grid up to some ten thousand walls. A kernel for kernels.
    """
    total = np.zeros((points.shape[0], points.shape[0]), np.int64)
    for first in range(0, walls.shape[0], _BLOCK):
        _cross_block(walls[first : first + _BLOCK], weight[first : first + _BLOCK], points, total)
    return total


@njit(cache=True)
def _cross_block(walls: Floats, weight: Int64s, points: Floats, total: Int64s) -> None:
    """Add the weights of the crossed ones of a few *walls* to *total*."""
    count, size = points.shape[0], walls.shape[0]
    cx, cy, ex, ey = walls[:, 0].copy(), walls[:, 1].copy(), walls[:, 2].copy(), walls[:, 3].copy()
    low_x, high_x = min(cx.min(), ex.min()), max(cx.max(), ex.max())
    low_y, high_y = min(cy.min(), ey.min()), max(cy.max(), ey.max())
    left = np.empty((count, size), np.int64)
    for i in range(count):
        x, y = points[i]
        for k in range(size):
            left[i, k] = (ex[k] - cx[k]) * (y - cy[k]) - (ey[k] - cy[k]) * (x - cx[k]) >= 0.0
    for i in range(count):
        ax, ay = points[i]
        from_cx, from_cy, from_ex, from_ey = cx - ax, cy - ay, ex - ax, ey - ay
        for j in range(i + 1, count):
            bx, by = points[j]
            if max(ax, bx) < low_x or min(ax, bx) > high_x or max(ay, by) < low_y or min(ay, by) > high_y:
                continue
            sign = -1.0 if bx < ax or (bx == ax and by < ay) else 1.0  # which side is which has to be so both ways
            dx, dy = sign * (bx - ax), sign * (by - ay)
            found = 0
            for k in range(size):
                side_c = dx * from_cy[k] - dy * from_cx[k]
                side_e = dx * from_ey[k] - dy * from_ex[k]
                crossed = ((side_c >= 0.0) != (side_e >= 0.0)) & (left[i, k] != left[j, k])
                found += weight[k] if crossed else 0
            total[i, j] += found
            total[j, i] += found


@njit(cache=True, borrows=True)
def crossed_weight(walls: Floats, weight: Int64s, ax: float, ay: float, bx: float, by: float) -> int:
    """Return what :func:`crossed_weights` does of two points, of which a has the lower number. A kernel for kernels."""
    sign = -1.0 if bx < ax or (bx == ax and by < ay) else 1.0  # which side is which has to be so both ways
    dx, dy = sign * (bx - ax), sign * (by - ay)
    found = 0
    for k in range(walls.shape[0]):
        cx, cy, ex, ey = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        side_c = dx * (cy - ay) - dy * (cx - ax)
        side_e = dx * (ey - ay) - dy * (ex - ax)
        left_a = (ex - cx) * (ay - cy) - (ey - cy) * (ax - cx) >= 0.0
        left_b = (ex - cx) * (by - cy) - (ey - cy) * (bx - cx) >= 0.0
        found += weight[k] if ((side_c >= 0.0) != (side_e >= 0.0)) & (left_a != left_b) else 0
    return found
