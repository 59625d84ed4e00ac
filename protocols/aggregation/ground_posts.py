"""Posts: as few places as possible from which the whole floor is seen, and the rooms that they belong to.

This is an art gallery problem with a range. Candidates stand on a lattice in the free cells; of these the one that sees
most of what no post sees yet becomes a post, again and again (the greedy set cover; V. Chvatal, Mathematics of
Operations Research 4(3), 1979), room by room. To be seen are the points of a lattice, and points along both sides of
every wall. Then a finer lattice is checked, and what is missed there gets posts of its own.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import scipy.ndimage

from cosim.arrays import Bools, Floats, Int64s
from cosim.geometry.planning import PlanningGrid, cost_to_go
from cosim.geometry.segments import SegmentGrid, clearance, in_sight
from cosim.jit import njit

DOORS_M: Final = 2.2
"""Width below which a passage divides rooms."""
CANDIDATES: Final = 4.0
"""Camera range divided by the distance between candidates."""
SMALL: Final = 16.0
"""Side of a square as large as a room divided by the distance between candidates, where that is smaller."""
SAMPLES: Final = 10.0
"""The same quotient for the points that are to be seen."""
SHARE: Final = 0.95
"""Share of the range within which the first posts see; else points between their coarse lattice cost more posts."""
BESIDE_M: Final = 1e-4
"""Distance of the points beside a wall from it."""
NONE: Final = -1


# ---------------------------------------------------------------- rooms


def rooms_of_cells(grid: PlanningGrid, walls: SegmentGrid, middles_m: list[tuple[float, float]]) -> Int64s:
    """Return the number of the room that each cell of *grid* belongs to, -1 for none; shape (ny, nx).

    A room is what is joined to its middle by nothing narrower than a door. If a floor is too narrow for that, or rooms
    are parts of one space, a cell belongs to the nearest middle.
    """
    shape = grid.free.shape
    ny, nx = shape
    rooms = np.full(shape, NONE, np.int64)
    if not middles_m:
        return rooms
    middles = [grid.cell_at(*middle) for middle in middles_m]
    centres = np.array([grid.centre_m(cell) for cell in range(nx * ny)])
    wide = (clearance(walls, centres, DOORS_M) >= 0.5 * DOORS_M).reshape(shape) & grid.free
    parts, _ = scipy.ndimage.label(wide)
    if not all(parts.flat[cell] for cell in middles):
        return _nearest(grid.free, grid.free, middles)
    core = np.isin(parts, [parts.flat[cell] for cell in middles])
    rooms[:] = _nearest(core, core, middles)
    # what the doors' width has taken away at walls and in corners comes back, as long as it lies in the room's sight
    reach = math.ceil(DOORS_M / grid.cell_m)
    away, at = scipy.ndimage.distance_transform_edt(parts == 0, return_indices=True)
    near = (away <= reach) & grid.free
    grown: Int64s = np.where(near, rooms[at[0], at[1]], NONE)
    return grown


def _nearest(free: Bools, kept: Bools, middles: list[int]) -> Int64s:
    """Return the number of the middle that is nearest to each cell by *free* ways, -1 where there is none."""
    costs = np.array([cost_to_go(free, [cell]) for cell in middles])
    nearest = costs.argmin(axis=0)
    return np.where(np.isfinite(costs.min(axis=0)) & kept, nearest, NONE).astype(np.int64)


# ---------------------------------------------------------------- what is to be seen


def lattice(bounds_m: tuple[float, float, float, float], apart_m: float) -> Floats:
    """Return points at most *apart_m* metres from each other along x and y that cover a rectangle, shape (n, 2)."""
    x, y, x_max, y_max = bounds_m
    nx, ny = (max(1, math.ceil((extent) / apart_m)) for extent in (x_max - x, y_max - y))
    xs = x + (np.arange(nx) + 0.5) * (x_max - x) / nx
    ys = y + (np.arange(ny) + 0.5) * (y_max - y) / ny
    return np.stack((np.tile(xs, ny), np.repeat(ys, nx)), axis=1)


def beside(walls_m: Floats, apart_m: float) -> Floats:
    """Return points along both sides of *walls_m*, shape (n, 4), and off their corners, shape (m, 2)."""
    points = []
    for x1, y1, x2, y2 in walls_m.tolist():
        length = math.hypot(x2 - x1, y2 - y1)
        if length <= 2.0 * BESIDE_M:
            continue
        dx, dy = (x2 - x1) / length, (y2 - y1) / length
        along = np.linspace(BESIDE_M, length - BESIDE_M, 2 + math.ceil(length / apart_m))
        for side in (BESIDE_M, -BESIDE_M):
            points.append(np.stack((x1 + along * dx - side * dy, y1 + along * dy + side * dx), axis=1))
    return np.concatenate(points) if points else np.zeros((0, 2))


# ---------------------------------------------------------------- the cover


def posts_of(
    grid: PlanningGrid, walls: SegmentGrid, rooms: Int64s, solid: Callable[[Floats], Bools], camera_m: float
) -> list[int]:
    """Return the cells of the posts from which all points that are not *solid* are seen, in order; room by room.

    They lie in the largest part of the *grid* that is joined by ways. A point that no place there sees is left out.
    """
    parts, _ = scipy.ndimage.label(grid.free)
    counts = np.bincount(parts.ravel(), minlength=2)
    inside = parts == 1 + int(counts[1:].argmax())
    coarse = _samples(grid, walls, camera_m / SAMPLES, solid)
    near = 3.0 * max(camera_m / SAMPLES, grid.cell_m)
    at = views_from(grid, inside, walls, coarse, near)
    known = at >= 0
    posts = _room_by_room(grid, walls, rooms, inside, coarse[known], rooms.flat[at[known]], SHARE * camera_m)
    fine_m = min(camera_m / SAMPLES, grid.cell_m) / 2.0
    fine = _samples(grid, walls, fine_m, solid)
    # what lies between the points of the lattice is as near to a post as they are, but for this
    range_m = camera_m - math.sqrt(0.5) * fine_m
    missed = fine[_unseen(walls, _centres(grid, posts), fine, range_m)]
    at = views_from(grid, inside, walls, missed, range_m)
    more = np.unique(at[at >= 0])
    if len(more):
        seen_by = _views(walls, _centres(grid, more), missed[at >= 0], range_m)
        posts = [*posts, *more[_greedy(*seen_by, int((at >= 0).sum()))].tolist()]
    return _in_order(grid, rooms, posts)


def _room_by_room(
    grid: PlanningGrid, walls: SegmentGrid, rooms: Int64s, inside: Bools, samples: Floats, of: Int64s, range_m: float
) -> list[int]:
    """Return posts that see all *samples*, shape (n, 2), that candidates in the same room (numbers *of*) see."""
    posts: list[int] = []
    for room in np.unique(of).tolist():
        cells = np.flatnonzero(inside & (rooms == room))
        apart_m = min(range_m / CANDIDATES, math.sqrt(len(cells)) * grid.cell_m / SMALL)
        stride = max(1, math.floor(apart_m / grid.cell_m))
        rows, columns = np.divmod(cells, inside.shape[1])
        own = cells[(rows % stride == stride // 2) & (columns % stride == stride // 2)]
        wanted = samples[of == room]
        first, member = _views(walls, _centres(grid, own), wanted, range_m)
        posts.extend(own[_greedy(first, member, len(wanted))].tolist())
    return posts


def views_from(grid: PlanningGrid, inside: Bools, walls: SegmentGrid, points_m: Floats, range_m: float) -> Int64s:
    """Return for each of *points_m*, shape (n, 2), the nearest cell *inside* whose centre sees it, -1 if none does."""
    x_m, y_m = grid.origin_m
    return _views_from(inside, walls, points_m, x_m, y_m, grid.cell_m, range_m)


def _samples(grid: PlanningGrid, walls: SegmentGrid, apart_m: float, solid: Callable[[Floats], Bools]) -> Floats:
    """Return the points that are to be seen, about *apart_m* from each other."""
    (x_m, y_m), (ny, nx) = grid.origin_m, grid.free.shape
    bounds_m = x_m, y_m, x_m + nx * grid.cell_m, y_m + ny * grid.cell_m
    points = np.concatenate((lattice(bounds_m, apart_m), beside(walls.walls_m, apart_m)))
    ok = (points > bounds_m[:2]).all(axis=1) & (points < bounds_m[2:]).all(axis=1)
    points = points[ok]
    return points[~solid(points)]


def _centres(grid: PlanningGrid, cells: Sequence[int] | Int64s) -> Floats:
    return np.array([grid.centre_m(int(cell)) for cell in cells], np.float64).reshape(-1, 2)


def _in_order(grid: PlanningGrid, rooms: Int64s, posts: list[int]) -> list[int]:
    """Return *posts* room by room, those outside rooms at the end; within a room in nearest-neighbour order."""
    ordered: list[int] = []
    for room in sorted({int(rooms.flat[post]) for post in posts}, key=lambda room: (room < 0, room)):
        left = [(*grid.centre_m(post), post) for post in sorted(set(posts)) if rooms.flat[post] == room]
        x, y = grid.centre_m(ordered[-1]) if ordered else grid.origin_m
        while left:
            nearest = min(left, key=lambda other: (math.hypot(other[0] - x, other[1] - y), other[2]))
            left.remove(nearest)
            x, y, post = nearest
            ordered.append(post)
    return ordered


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _views(walls: SegmentGrid, candidates: Floats, samples: Floats, reach: float) -> tuple[Int64s, Int64s]:
    """Return what each candidate sees: ``member[first[k]:first[k + 1]]``."""
    first = np.zeros(candidates.shape[0] + 1, np.int64)
    member = np.empty(max(16, samples.shape[0]), np.int64)
    count = 0
    for k in range(candidates.shape[0]):
        x, y = candidates[k, 0], candidates[k, 1]
        for m in range(samples.shape[0]):
            dx, dy = samples[m, 0] - x, samples[m, 1] - y
            if dx * dx + dy * dy > reach * reach or not in_sight(walls, x, y, samples[m, 0], samples[m, 1]):
                continue
            if count == member.shape[0]:
                more = np.empty(2 * count, np.int64)
                more[:count] = member
                member = more
            member[count] = m
            count += 1
        first[k + 1] = count
    return first, member[:count]


@njit(cache=True)
def _greedy(first: Int64s, member: Int64s, samples: int) -> Int64s:
    """Return a subset of the candidates that sees all that any of them sees, without a superfluous one."""
    count = first.shape[0] - 1
    times = np.zeros(samples, np.int64)
    gain = first[1:] - first[:-1]
    picked = np.empty(count, np.int64)
    size = 0
    while True:
        best, most = -1, 0
        for k in range(count):
            if gain[k] <= most:
                continue
            fresh = 0
            for slot in range(first[k], first[k + 1]):
                fresh += times[member[slot]] == 0
            gain[k] = fresh  # gains never grow: a candidate that was worse than the best need not be counted again
            if fresh > most:
                best, most = k, fresh
        if best < 0:
            break
        for slot in range(first[best], first[best + 1]):
            times[member[slot]] += 1
        picked[size] = best
        size += 1
    kept = 0
    for at in range(size):
        needless = True
        for slot in range(first[picked[at]], first[picked[at] + 1]):
            needless &= times[member[slot]] > 1
        if needless:
            for slot in range(first[picked[at]], first[picked[at] + 1]):
                times[member[slot]] -= 1
        else:
            picked[kept] = picked[at]
            kept += 1
    return picked[:kept].copy()


@njit(cache=True)
def _unseen(walls: SegmentGrid, posts: Floats, samples: Floats, reach: float) -> Bools:
    missed = np.ones(samples.shape[0], np.bool_)
    last = 0  # neighbours are seen from the same post, mostly
    for m in range(samples.shape[0]):
        x, y = samples[m, 0], samples[m, 1]
        for at in range(posts.shape[0]):
            k = (last + at) % posts.shape[0]
            dx, dy = posts[k, 0] - x, posts[k, 1] - y
            if dx * dx + dy * dy <= reach * reach and in_sight(walls, posts[k, 0], posts[k, 1], x, y):
                missed[m] = False
                last = k
                break
    return missed


@njit(cache=True)
def _views_from(
    inside: Bools, walls: SegmentGrid, points: Floats, x_m: float, y_m: float, cell: float, reach: float
) -> Int64s:
    found = np.full(points.shape[0], -1, np.int64)
    ny, nx = inside.shape
    for m in range(points.shape[0]):
        px, py = points[m, 0], points[m, 1]
        best = reach * reach
        low_x, high_x = max(int((px - reach - x_m) / cell), 0), min(int((px + reach - x_m) / cell) + 1, nx)
        low_y, high_y = max(int((py - reach - y_m) / cell), 0), min(int((py + reach - y_m) / cell) + 1, ny)
        for iy in range(low_y, high_y):
            for ix in range(low_x, high_x):
                cx, cy = x_m + (ix + 0.5) * cell, y_m + (iy + 0.5) * cell
                square = (cx - px) ** 2 + (cy - py) ** 2
                if square < best and inside[iy, ix] and in_sight(walls, cx, cy, px, py):
                    best, found[m] = square, iy * nx + ix
    return found
