"""The readings of the robots' sensors: kernels over a table of all robots' poses and one of the sensors' parameters.

For what they model see :mod:`cosim.robots.senses`, which alone calls them.
"""

import math
from typing import Final, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s, Int64s
from cosim.geometry.segments import SegmentGrid, in_sight, scan_walls, unpacked
from cosim.jit import njit
from cosim.randomness import philox_words

Room: TypeAlias = tuple[Floats, Floats, Floats, Int32s]
"""Arguments of all kernels: poses, limits, and the packed walls."""

_SIGHT_PURPOSE: Final = 1
_DRIFT_PURPOSE: Final = 2
_SCAN_PURPOSE: Final = 3

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
TICK: Final = 12  # when all were asked last


@njit(cache=True)
def _uniform(limits: Floats, tick: int, link: int, purpose: int) -> tuple[float, float]:
    """Return two numbers in [-1, 1)."""
    words = philox_words(tick & 0xFFFFFFFF, tick >> 32, link, purpose, int(limits[KEY]), int(limits[KEY + 1]))
    return words[0] * 2.0**-31 - 1.0, words[1] * 2.0**-31 - 1.0


@njit(cache=True)
def sense(
    poses: Floats,
    limits: Floats,
    numbers: Floats,
    members: Int32s,
    rows: Floats,
    tick: int,
    moved: bool,
    pairs: Int64s,
    places: Floats,
) -> int:
    """Do :func:`_locate`, and :func:`_see` if there is room for a picture; return how many have been seen in all."""
    limits[TICK] = tick
    _locate(poses, limits, rows, tick, moved)
    if not pairs.shape[0]:
        return 0
    return _see(poses, limits, unpacked(numbers, members), tick, pairs, places)


@njit(cache=True)
def _locate(poses: Floats, limits: Floats, rows: Floats, tick: int, moved: bool) -> None:
    """Write where robots are, and where they take themselves to be: exactly, or, if *moved*, from how they moved."""
    for i in range(poses.shape[0]):
        x, y, heading = rows[i, 0], rows[i, 1], rows[i, 2]
        pose = poses[i]
        if moved:
            dx, dy = x - pose[X], y - pose[Y]
            way = math.sqrt(dx * dx + dy * dy)
            slip, turn = _uniform(limits, tick, i, _DRIFT_PURPOSE)
            # with the root, what adds up over a metre has the same spread whatever the ticks
            error = limits[TURN] * turn * math.sqrt(way)
            angle = pose[OWN_HEADING] - pose[HEADING] + error
            cos, sin = elementary.cos(angle), elementary.sin(angle)
            stretch = 1.0 + limits[SLIP] * slip
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


@njit(cache=True)
def _to_world(pose: Floats, x: float, y: float) -> tuple[float, float]:
    angle = pose[HEADING] - pose[OWN_HEADING]
    cos, sin = elementary.cos(angle), elementary.sin(angle)
    dx, dy = x - pose[OWN_X], y - pose[OWN_Y]
    return pose[X] + cos * dx - sin * dy, pose[Y] + sin * dx + cos * dy


@njit(cache=True)
def _hidden(poses: Floats, i: int, j: int, x: float, y: float) -> bool:
    """Return whether another body than those of *i* and *j* is between robot *i* and a point."""
    ax, ay = poses[i, X], poses[i, Y]
    dx, dy = x - ax, y - ay
    square = dx * dx + dy * dy
    for k in range(poses.shape[0]):
        if k in (i, j) or square == 0.0:
            continue
        cx, cy = poses[k, X] - ax, poses[k, Y] - ay
        part = min(1.0, max(0.0, (cx * dx + cy * dy) / square))
        ex, ey = cx - part * dx, cy - part * dy
        if ex * ex + ey * ey < poses[k, RADIUS] * poses[k, RADIUS]:
            return True
    return False


@njit(cache=True)
def _looks_at(poses: Floats, limits: Floats, grid: SegmentGrid, i: int, j: int, x: float, y: float) -> bool:
    """Return whether robot *i* sees a point of the world, which is robot *j* (or none, -1)."""
    if poses[i, BLIND] > 0.0:
        return False
    dx, dy = x - poses[i, X], y - poses[i, Y]
    if dx * dx + dy * dy > limits[RANGE] * limits[RANGE]:
        return False
    half_field = limits[HALF_FIELD]
    if half_field < math.pi and abs(_wrapped(elementary.atan2(dy, dx) - poses[i, HEADING])) > half_field:
        return False
    if limits[OCCLUDE] > 0.0 and _hidden(poses, i, j, x, y):
        return False
    return in_sight(grid, poses[i, X], poses[i, Y], x, y)


@njit(cache=True)
def _see(poses: Floats, limits: Floats, grid: SegmentGrid, tick: int, pairs: Int64s, places: Floats) -> int:
    """Write whom each robot sees, and where, in its own frame: robot by robot; return how many that are."""
    at = 0
    errors = limits[DISTANCE_ERROR] > 0.0 or limits[BEARING_ERROR] > 0.0
    square = limits[RANGE] * limits[RANGE]
    for i in range(poses.shape[0]):
        own_turn = poses[i, OWN_HEADING] - poses[i, HEADING]
        cos, sin = elementary.cos(own_turn), elementary.sin(own_turn)
        for j in range(poses.shape[0]):
            x, y = poses[j, X], poses[j, Y]
            dx, dy = x - poses[i, X], y - poses[i, Y]
            # most are too far away in a large team: to ask that here saves a call that costs fifty times as much
            if dx * dx + dy * dy > square or i == j or not _looks_at(poses, limits, grid, i, j, x, y):
                continue
            if errors:
                far, aside = _uniform(limits, tick, i << 16 | j, _SIGHT_PURPOSE)
                stretch = 1.0 + limits[DISTANCE_ERROR] * far
                half = elementary.atan2(poses[j, RADIUS], math.sqrt(dx * dx + dy * dy))
                turn = own_turn + half * limits[BEARING_ERROR] * aside
                cos, sin = stretch * elementary.cos(turn), stretch * elementary.sin(turn)
            pairs[at] = i * poses.shape[0] + j
            places[0, at] = poses[i, OWN_X] + cos * dx - sin * dy
            places[1, at] = poses[i, OWN_Y] + sin * dx + cos * dy
            at += 1
    return at


@njit(cache=True)
def in_region(
    poses: Floats, limits: Floats, numbers: Floats, members: Int32s, i: int, points: Floats, seen: Bools, count: int
) -> None:
    """Write which of the first *count* points (x, y, x, y...) of the frame of robot *i* it sees."""
    grid = unpacked(numbers, members)
    for k in range(count):
        x, y = _to_world(poses[i], points[2 * k], points[2 * k + 1])
        seen[k] = _looks_at(poses, limits, grid, i, -1, x, y)


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
    x, y = _to_world(poses[i], x, y)
    seen = 2 if _looks_at(poses, limits, grid, i, -1, x, y) else 0
    if count > 1:
        x, y = _to_world(poses[i], other_x, other_y)
        seen += 1 if _looks_at(poses, limits, grid, i, -1, x, y) else 0
    return seen


@njit(cache=True)
def scan(poses: Floats, limits: Floats, numbers: Floats, members: Int32s, i: int, ranges: Floats) -> None:
    """Write how far off each beam of robot *i*, in turn of its own frame, seems to meet a wall or body; inf if none."""
    limit = limits[BEAM_RANGE]
    count = ranges.shape[0]
    angle, apart = poses[i, HEADING] - poses[i, OWN_HEADING], 2.0 * math.pi / count
    ways = np.empty((count, 2))
    for k in range(count):
        ways[k, 0], ways[k, 1] = limit * elementary.cos(angle + k * apart), limit * elementary.sin(angle + k * apart)
    scan_walls(unpacked(numbers, members), poses[i, X], poses[i, Y], ways, limit, ranges)
    _scan_bodies(poses, i, ways, limit, ranges)
    for k in range(count):
        ranges[k] *= limit
    if limits[RANGE_NOISE] > 0.0 or limits[FALSE_RETURNS] > 0.0:
        _misread(limits, i, ranges)


@njit(cache=True)
def _misread(limits: Floats, i: int, ranges: Floats) -> None:
    """Put noise on the finite *ranges* of robot *i*, or false returns in place of any; the same all through a tick."""
    limit, tick = limits[BEAM_RANGE], int(limits[TICK])
    for k in range(ranges.shape[0]):
        a, b, c, d = philox_words(tick, tick >> 32, i << 16 | k, _SCAN_PURPOSE, int(limits[KEY]), int(limits[KEY + 1]))
        if c * 2.0**-32 < limits[FALSE_RETURNS]:
            ranges[k] = d * 2.0**-32 * limit
        elif ranges[k] < math.inf:
            # Box and Muller
            normal = math.sqrt(-2.0 * elementary.log((a + 1) * 2.0**-32)) * elementary.cos(2.0 * math.pi * b * 2.0**-32)
            told = max(ranges[k] + limits[RANGE_NOISE] * normal, 0.0)
            ranges[k] = told if told <= limit else math.inf


@njit(cache=True)
def _scan_bodies(poses: Floats, i: int, ways: Floats, limit: float, first: Floats) -> None:
    """Lower the fractions at which the *ways* from robot *i* meet something where they meet a body before."""
    for j in range(poses.shape[0]):
        cx, cy, radius = poses[j, X] - poses[i, X], poses[j, Y] - poses[i, Y], poses[j, RADIUS]
        outside = cx * cx + cy * cy - radius * radius
        if j == i or outside > limit * (limit + 2.0 * radius):
            continue
        for k in range(ways.shape[0]):
            along = cx * ways[k, 0] + cy * ways[k, 1]
            rest = along * along - limit * limit * outside
            if along > 0.0 and rest >= 0.0:
                part = max(0.0, (along - math.sqrt(rest)) / (limit * limit))
                if part <= 1.0 and part < first[k]:
                    first[k] = part
