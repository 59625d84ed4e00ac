"""The readings of the robots' sensors: kernels over a table of all robots' poses and one of the sensors' parameters.

For what they model see :mod:`cosim.robots.senses`, which alone calls them.
"""

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s, Int64s
from cosim.geometry.segments import SegmentGrid, beams_between, in_sight, scan_walls, unpacked
from cosim.jit import njit
from cosim.navigation.odometry import tick_errors
from cosim.randomness import philox_words

Room: TypeAlias = tuple[Floats, Floats, Floats, Int32s]
"""Arguments of all kernels: poses, limits, and the packed walls."""

_SIGHT_PURPOSE: Final = 1
_DRIFT_PURPOSE: Final = 2
_SCAN_PURPOSE: Final = 3

_PAD: Final = 1e-9
"""Share by which cells are wider than they need to be, more than rounding loses."""

# columns of the table of poses: the truth, what the robot knows of itself, its frame and its body
X: Final = 0
Y: Final = 1
HEADING: Final = 2
OWN_X: Final = 3
OWN_Y: Final = 4
OWN_HEADING: Final = 5
SPEED: Final = 6
ARRIVED: Final = 7
BLOCKED: Final = 8
FRAME_X: Final = 9
FRAME_Y: Final = 10
FRAME_TURN: Final = 11
RADIUS: Final = 12
BLIND: Final = 13
COLUMNS: Final = 14

# columns of the row that says what the sensors are like
RANGE: Final = 0
HALF_FIELD: Final = 1
OCCLUDE: Final = 2
DISTANCE_ERROR: Final = 3
BEARING_ERROR: Final = 4
BEAM_RANGE: Final = 5
SLIP: Final = 6
TURN: Final = 7
RANGE_NOISE: Final = 8
FALSE_RETURNS: Final = 9
KEY: Final = 10  # and 11: the key of the draws, two words of 32 bits
ERRS_AT: Final = 12  # a tick's way at which odometry errs as said; 0: at any


@njit(cache=True)
def _uniform(limits: Floats, tick: int, link: int, purpose: int) -> tuple[float, float]:
    """Return two numbers in [-1, 1)."""
    words = philox_words(tick & 0xFFFFFFFF, tick >> 32, link, purpose, int(limits[KEY]), int(limits[KEY + 1]))
    return words[0] * 2.0**-31 - 1.0, words[1] * 2.0**-31 - 1.0


@njit(cache=True)
def locate(poses: Floats, limits: Floats, rows: Floats, tick: int, moved: bool) -> None:
    """Write where robots are, and where they take themselves to be: exactly, or, if *moved*, from how they moved."""
    for i in range(poses.shape[0]):
        x, y, heading = rows[i, 0], rows[i, 1], rows[i, 2]
        pose = poses[i]
        if moved:
            dx, dy = x - pose[X], y - pose[Y]
            way = math.sqrt(dx * dx + dy * dy)
            slip, turn = _uniform(limits, tick, i, _DRIFT_PURPOSE)
            share, error = tick_errors(way, limits[SLIP], limits[TURN], limits[ERRS_AT], slip, turn)
            angle = pose[OWN_HEADING] - pose[HEADING] + error
            cos, sin = elementary.cos(angle), elementary.sin(angle)
            stretch = 1.0 + share
            pose[OWN_X] += stretch * (cos * dx - sin * dy)
            pose[OWN_Y] += stretch * (sin * dx + cos * dy)
            pose[OWN_HEADING] = _wrapped(heading + angle)
        else:
            cos, sin = elementary.cos(pose[FRAME_TURN]), elementary.sin(pose[FRAME_TURN])
            dx, dy = x - pose[FRAME_X], y - pose[FRAME_Y]
            pose[OWN_X], pose[OWN_Y] = cos * dx + sin * dy, cos * dy - sin * dx
            pose[OWN_HEADING] = _wrapped(heading - pose[FRAME_TURN])
        pose[X], pose[Y], pose[HEADING] = x, y, heading
        pose[SPEED], pose[ARRIVED], pose[BLOCKED] = rows[i, 3], rows[i, 4], rows[i, 5]


@njit(cache=True)
def _wrapped(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


# ---------------------------------------------------------------- who is near


class Cells(NamedTuple):
    """Robots, sorted by the square cell that they are in: ``member[first[c]:first[c + 1]]``, c = iy * nx + ix."""

    first: Int64s
    member: Int64s
    x_m: float
    y_m: float
    side_m: float
    nx: int
    ny: int


@njit(cache=True)
def _sorted_into_cells(poses: Floats, reach: float) -> Cells:
    """Return cells in which all that lies within *reach* of a robot, its body at least, is in the next cells to its.

    There are about as many cells as robots, or fewer, and the robots of each are in order.
    """
    count = poses.shape[0]
    low_x, low_y, high_x, high_y, widest = math.inf, math.inf, -math.inf, -math.inf, 0.0
    for i in range(count):
        low_x, high_x = min(low_x, poses[i, X]), max(high_x, poses[i, X])
        low_y, high_y = min(low_y, poses[i, Y]), max(high_y, poses[i, Y])
        widest = max(widest, poses[i, RADIUS])
    side = max((reach + widest) * (1.0 + _PAD), max(high_x - low_x, high_y - low_y) / math.sqrt(count))
    nx, ny = int((high_x - low_x) / side) + 1, int((high_y - low_y) / side) + 1
    first, member, cell = np.zeros(nx * ny + 1, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    for i in range(count):
        cell[i] = int((poses[i, Y] - low_y) / side) * nx + int((poses[i, X] - low_x) / side)
        first[cell[i]] += 1
    for c in range(1, nx * ny + 1):  # where each cell ends: it is filled from there, and the last robot goes first
        first[c] += first[c - 1]
    for i in range(count - 1, -1, -1):
        first[cell[i]] -= 1
        member[first[cell[i]]] = i
    return Cells(first, member, low_x, low_y, side, nx, ny)


@njit(cache=True)
def _cells_about(cells: Cells, x: float, y: float) -> tuple[int, int, int, int]:
    """Return the half-open ranges of columns and rows of the cell of a robot and of the next ones."""
    ix, iy = int((x - cells.x_m) / cells.side_m), int((y - cells.y_m) / cells.side_m)
    return max(ix - 1, 0), min(ix + 2, cells.nx), max(iy - 1, 0), min(iy + 2, cells.ny)


# ---------------------------------------------------------------- pictures


@njit(cache=True)
def see(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Int32s,
    tick: int,
    ends: Int64s,
    others: Int64s,
    places: Floats,
) -> int:
    """Write whom each robot sees, and where, in its own frame; return how many that are in all.

    Robot i sees ``others[ends[i]:ends[i + 1]]``, in order, *ends* (n + 1,); *places* (2, k) are where. If *others* (k,)
    has room for fewer than there are, what is written means nothing.
    """
    count = poses.shape[0]
    grid, cells = unpacked(numbers, members), _sorted_into_cells(poses, limits[RANGE])
    found = np.empty((others.shape[0], 2), np.int64)
    ends[:] = 0
    at = 0
    for j in range(count):  # whoever sees j, so that those whom one robot sees are found in order
        low_x, high_x, low_y, high_y = _cells_about(cells, poses[j, X], poses[j, Y])
        for iy in range(low_y, high_y):
            for slot in range(cells.first[iy * cells.nx + low_x], cells.first[iy * cells.nx + high_x]):
                i = cells.member[slot]
                if i != j and _sees_robot(poses, limits, grid, cells, i, j):
                    if at < others.shape[0]:
                        found[at, 0], found[at, 1] = i, j
                        ends[i + 1] += 1
                    at += 1
    if at <= others.shape[0]:
        _sort_by_observer(found, at, ends, others)
        for i in range(count):
            _place(poses, limits, tick, i, others, ends[i], ends[i + 1], places)
    return at


@njit(cache=True)
def _sees_robot(poses: Floats, limits: Floats, grid: SegmentGrid, cells: Cells, i: int, j: int) -> bool:
    x, y = poses[j, X], poses[j, Y]
    if not _looks_at(poses, limits, grid, i, x, y):
        return False
    if limits[OCCLUDE] > 0.0:
        low_x, high_x, low_y, high_y = _cells_about(cells, poses[i, X], poses[i, Y])
        for iy in range(low_y, high_y):
            for slot in range(cells.first[iy * cells.nx + low_x], cells.first[iy * cells.nx + high_x]):
                k = cells.member[slot]
                if k not in (i, j) and _hides(poses, k, i, x, y):
                    return False
    return True


@njit(cache=True)
def _looks_at(poses: Floats, limits: Floats, grid: SegmentGrid, i: int, x: float, y: float) -> bool:
    """Return whether robot *i* would see a point of the world if there were no bodies."""
    dx, dy = x - poses[i, X], y - poses[i, Y]
    if dx * dx + dy * dy > limits[RANGE] * limits[RANGE] or poses[i, BLIND] > 0.0:
        return False
    half_field = limits[HALF_FIELD]
    if half_field < math.pi and abs(_wrapped(elementary.atan2(dy, dx) - poses[i, HEADING])) > half_field:
        return False
    return in_sight(grid, poses[i, X], poses[i, Y], x, y)


@njit(cache=True)
def _hides(poses: Floats, k: int, i: int, x: float, y: float) -> bool:
    """Return whether the body of robot *k* is between robot *i* and a point."""
    ax, ay = poses[i, X], poses[i, Y]
    dx, dy, cx, cy = x - ax, y - ay, poses[k, X] - ax, poses[k, Y] - ay
    square = dx * dx + dy * dy
    if square == 0.0:
        return False
    part = min(1.0, max(0.0, (cx * dx + cy * dy) / square))
    ex, ey = cx - part * dx, cy - part * dy
    hides: bool = ex * ex + ey * ey < poses[k, RADIUS] * poses[k, RADIUS]
    return hides


@njit(cache=True)
def _sort_by_observer(found: Int64s, count: int, ends: Int64s, others: Int64s) -> None:
    """Sort the first *count* pairs *found* by the observer; *ends* has how many each has, then where they end."""
    for i in range(1, ends.shape[0]):
        ends[i] += ends[i - 1]
    at = ends.copy()
    for k in range(count):
        i = found[k, 0]
        others[at[i]] = found[k, 1]
        at[i] += 1


@njit(cache=True)
def _place(
    poses: Floats, limits: Floats, tick: int, i: int, others: Int64s, begin: int, end: int, places: Floats
) -> None:
    """Write where robot *i* sees those *others* from *begin* to *end*."""
    errors = limits[DISTANCE_ERROR] > 0.0 or limits[BEARING_ERROR] > 0.0
    own_turn = poses[i, OWN_HEADING] - poses[i, HEADING]
    cos, sin = elementary.cos(own_turn), elementary.sin(own_turn)
    for k in range(begin, end):
        j = others[k]
        dx, dy = poses[j, X] - poses[i, X], poses[j, Y] - poses[i, Y]
        if errors:
            far, aside = _uniform(limits, tick, i << 16 | j, _SIGHT_PURPOSE)
            stretch = 1.0 + limits[DISTANCE_ERROR] * far
            half = elementary.atan2(poses[j, RADIUS], math.sqrt(dx * dx + dy * dy))
            turn = own_turn + half * limits[BEARING_ERROR] * aside
            cos, sin = stretch * elementary.cos(turn), stretch * elementary.sin(turn)
        places[0, k] = poses[i, OWN_X] + cos * dx - sin * dy
        places[1, k] = poses[i, OWN_Y] + sin * dx + cos * dy


# ---------------------------------------------------------------- points in sight


@njit(cache=True)
def in_region(
    poses: Floats, limits: Floats, numbers: Floats, members: Int32s, i: int, points: Floats, seen: Bools, count: int
) -> None:
    """Write which of the first *count* points (x, y, x, y...) of the frame of robot *i* it sees."""
    grid = unpacked(numbers, members)
    for k in range(count):
        seen[k] = _sees_point(poses, limits, grid, i, points[2 * k], points[2 * k + 1])


@njit(cache=True)
def few_in_region(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Int32s,
    i: int,
    count: int,
    x: float,
    y: float,
    other_x: float,
    other_y: float,
) -> int:
    """Return 2 if robot *i* sees (x, y) of its frame, and 1 more if *count* is 2 and it sees the other point."""
    grid = unpacked(numbers, members)
    seen = 2 if _sees_point(poses, limits, grid, i, x, y) else 0
    if count > 1:
        seen += 1 if _sees_point(poses, limits, grid, i, other_x, other_y) else 0
    return seen


@njit(cache=True)
def _sees_point(poses: Floats, limits: Floats, grid: SegmentGrid, i: int, own_x: float, own_y: float) -> bool:
    x, y = _to_world(poses[i], own_x, own_y)
    return _sees_place(poses, limits, grid, i, x, y)


@njit(cache=True)
def sees_mark(poses: Floats, limits: Floats, numbers: Floats, members: Int32s, i: int, x: float, y: float) -> bool:
    """Return whether robot *i* sees the place (x, y) of the world from where it truly is."""
    seen: bool = _sees_place(poses, limits, unpacked(numbers, members), i, x, y)
    return seen


@njit(cache=True)
def _sees_place(poses: Floats, limits: Floats, grid: SegmentGrid, i: int, x: float, y: float) -> bool:
    if not _looks_at(poses, limits, grid, i, x, y):
        return False
    if limits[OCCLUDE] > 0.0:
        for k in range(poses.shape[0]):
            if k != i and _hides(poses, k, i, x, y):
                return False
    return True


@njit(cache=True)
def _to_world(pose: Floats, x: float, y: float) -> tuple[float, float]:
    angle = pose[HEADING] - pose[OWN_HEADING]
    cos, sin = elementary.cos(angle), elementary.sin(angle)
    dx, dy = x - pose[OWN_X], y - pose[OWN_Y]
    return pose[X] + cos * dx - sin * dy, pose[Y] + sin * dx + cos * dy


# ---------------------------------------------------------------- scans


@njit(cache=True)
def scan(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Int32s,
    tick: int,
    robots: Int64s,
    ways: Floats,
    turned: Floats,
    ranges: Floats,
) -> None:
    """Write how far off each beam of each of *robots* seems to meet a wall or body, *ranges* (robots, beams); else inf.

    Beams are in turn of the robot's own frame. *ways* (beams, 2) are kept from call to call: those of a frame that is
    *turned* (1,) so far, NaN for none.
    """
    limit, count = limits[BEAM_RANGE], ways.shape[0]
    grid, cells = unpacked(numbers, members), _sorted_into_cells(poses, limit)
    apart = 2.0 * math.pi / count
    for row in range(robots.shape[0]):
        i, first = robots[row], ranges[row]
        angle = poses[i, HEADING] - poses[i, OWN_HEADING]
        if angle != turned[0]:  # all who know the world's frame have the same, at all ticks
            turned[0] = angle
            for k in range(count):
                way = angle + k * apart
                ways[k, 0], ways[k, 1] = limit * elementary.cos(way), limit * elementary.sin(way)
        scan_walls(grid, poses[i, X], poses[i, Y], angle, ways, limit, first)
        _scan_bodies(poses, cells, i, angle, ways, limit, first)
        for k in range(count):
            first[k] *= limit
        if limits[RANGE_NOISE] > 0.0 or limits[FALSE_RETURNS] > 0.0:
            _misread(limits, tick, i, first)


@njit(cache=True)
def _scan_bodies(poses: Floats, cells: Cells, i: int, angle: float, ways: Floats, limit: float, first: Floats) -> None:
    """Lower the fractions at which the *ways* from robot *i* meet something where they meet a body before."""
    low_x, high_x, low_y, high_y = _cells_about(cells, poses[i, X], poses[i, Y])
    for iy in range(low_y, high_y):
        for slot in range(cells.first[iy * cells.nx + low_x], cells.first[iy * cells.nx + high_x]):
            j = cells.member[slot]
            cx, cy, radius = poses[j, X] - poses[i, X], poses[j, Y] - poses[i, Y], poses[j, RADIUS]
            outside = cx * cx + cy * cy - radius * radius
            if j == i or outside > limit * (limit + 2.0 * radius):
                continue
            half = elementary.atan2(radius, math.sqrt(outside)) if outside > 0.0 else math.pi
            k, count = beams_between(elementary.atan2(cy, cx) - half - angle, 2.0 * half, ways.shape[0])
            for _ in range(count):
                along = cx * ways[k, 0] + cy * ways[k, 1]
                rest = along * along - limit * limit * outside
                if along > 0.0 and rest >= 0.0:
                    part = max(0.0, (along - math.sqrt(rest)) / (limit * limit))
                    if part <= 1.0 and part < first[k]:
                        first[k] = part
                k = k + 1 if k + 1 < ways.shape[0] else 0


@njit(cache=True)
def _misread(limits: Floats, tick: int, i: int, ranges: Floats) -> None:
    """Put noise on the finite *ranges* of robot *i*, or false returns in place of any; the same all through a tick."""
    limit = limits[BEAM_RANGE]
    for k in range(ranges.shape[0]):
        a, b, c, d = philox_words(tick, tick >> 32, i << 16 | k, _SCAN_PURPOSE, int(limits[KEY]), int(limits[KEY + 1]))
        if c * 2.0**-32 < limits[FALSE_RETURNS]:
            ranges[k] = d * 2.0**-32 * limit
        elif ranges[k] < math.inf:
            # Box and Muller
            normal = math.sqrt(-2.0 * elementary.log((a + 1) * 2.0**-32)) * elementary.cos(2.0 * math.pi * b * 2.0**-32)
            told = max(ranges[k] + limits[RANGE_NOISE] * normal, 0.0)
            ranges[k] = told if told <= limit else math.inf
