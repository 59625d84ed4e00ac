"""The dynamic window approach (D. Fox, W. Burgard and S. Thrun, IEEE Robotics and Automation 4(1), 1997).

Out of the speeds and rates of turn that a robot can reach by the next tick (the dynamic window) it takes the best of
those from which it can still stop (the admissible ones): hard constraints first, then the weighted sum of three soft
ones, facing its aim, being clear of obstacles, and getting on (paper 004, section 6).

*The hard constraint.* A command given at tick k acts from tick k + 1 to k + 2. It is admissible if the robot, having
obeyed it and then braking, turn and all, as hard as it can, touches nothing until it stands. That stop is rolled out
tick by tick, with the very arithmetic of the drive: ways per tick that change by at most h = a T^2 a tick, and straight
chords. On a straight way it is the textbook's v dt + v^2 / (2 a) <= free distance. If nothing is admissible the robot
brakes; so what it does then has been found free a tick ago, and it never is in a state from which it cannot stop. A
robot whose host dies brakes in just the same way.

*Other robots brake too.* Two robots choose at once, without knowing each other's choice. What both know are both
places, and both motions in the tick that has just ended. From these each foretells for both where they can be until
they stand if they brake from now on: a capsule about the stretch ahead, wide enough for the turn that is allowed
(``stray``: a robot that would stray farther from its direction may not turn so fast). If the two capsules are apart,
the middle line between them is the border; each admits only what stays on its own side of it. The line is symmetric, so
both take the same one without a word; what a robot does if it brakes instead lies within its capsule, so on its side
too. If the capsules overlap, both brake; and as what they do then has stayed on the two sides of an earlier border,
they do not touch. So two robots that do this never collide, whether they meet head-on, cross, follow, or one of them
stands still.

*Round corners* a robot is seen too late: where another robot may be behind the end of a wall, ahead, half of the
gap to it is the robot's (:func:`unseen_gap`).

*What differs from the article*, whose objective is sigma(alpha heading + beta dist + gamma velocity). Facing the aim:
the article turns the heading that the robot will have when it has braked against the direction of the aim from where it
will be then; here the heading is that one, but the direction is from where the command begins to act. Being clear: its
dist is the way along the arc of the command until the robot touches something; here it is how near the stopping path
comes to anything, up to ``clear``, so what is beside the robot counts like what is ahead. Getting on: its velocity is
the speed; here it is the part of it that leads to the aim. Nothing is smoothed over neighbouring commands (its sigma).
The hard constraint stands for its rule, v <= sqrt(2 dist a) and likewise for the rate of turn. The borders, the corners
and the turn that lands on the aim are ours. So a weight does not mean the same here and there.

*The article's own three terms* are chosen by a way ``ARC`` > 0. They are as just told, dist up to ``ARC``; its rule
holds beside the hard constraint, and other bodies are obstacles where they are now. Half a turn, the greatest way and
``ARC`` make each term one from 0 to 1; sigma is left out. A robot that stops on its aim faces it, and one that turns on
the spot meets nothing.
"""

import math
from typing import Any, Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.arcs import way_to_contact
from cosim.geometry.segments import SegmentGrid, cells_near, closest_approach
from cosim.jit import njit

# the row that says what a robot is like; ways and turns are per tick, changes per tick and tick
RADIUS: Final = 0
MOST_WAY: Final = 1
WAY_CHANGE: Final = 2
MOST_TURN: Final = 3
TURN_CHANGE: Final = 4
MARGIN: Final = 5
STRAY: Final = 6
CLEAR: Final = 7
FACING: Final = 8  # the weights of the soft constraints
KEEPING_CLEAR: Final = 9
GETTING_ON: Final = 10
ARC: Final = 11  # 0, or for the article's own terms the way along an arc beyond which obstacles do not matter
OWN: Final = 12

# the row that says where it is at this tick, how it moves until the next, and which way it has gone in the last tick
X: Final = 0
Y: Final = 1
HEADING: Final = 2
WAY: Final = 3
TURN: Final = 4
GONE_X: Final = 5
GONE_Y: Final = 6
STATE: Final = 7

# columns of the table of other robots: the place, the way of the last tick, the radius, the change of the way per tick
BODY_X: Final = 0
BODY_Y: Final = 1
BODY_GONE_X: Final = 2
BODY_GONE_Y: Final = 3
BODY_RADIUS: Final = 4
BODY_CHANGE: Final = 5
BODY_COLUMNS: Final = 6

_WAYS: Final = 5
_TURNS: Final = 9
"""Numbers of ways and of turns of the window that are tried, beside the turn that lands on the aim, and none."""
_STARTED: Final = 1.05
"""Largest number of changes of its way that a robot at rest makes before others see it move."""
_SAME_M: Final = 1e-6
_ROUNDING: Final = 1e-9


# ---------------------------------------------------------------- arithmetic of the drive, tick by tick


@njit(cache=True)
def towards(wanted: float, last: float, change: float) -> float:
    """Return the way nearest to *wanted* that differs from *last* by no more than *change*: as the drive does it."""
    if abs(wanted - last) <= change * (1.0 + _ROUNDING):
        return wanted
    return last + change if wanted > last else last - change


@njit(cache=True)
def chord(heading: float, way: float, turn: float) -> tuple[float, float]:
    """Return the straight way (x, y) of a tick that begins along *heading*."""
    half = 0.5 * turn
    length = way if half == 0.0 else way * elementary.sin(half) / half
    return length * elementary.cos(heading + half), length * elementary.sin(heading + half)


@njit(cache=True)
def braking_way(distance: float, change: float) -> float:
    """Return the greatest way of the next tick from which one can stop within *distance*, losing *change* a tick."""
    if distance <= 0.0:
        return 0.0
    ticks = max(1.0, math.ceil((math.sqrt(1.0 + 8.0 * distance / change) - 1.0) / 2.0))
    return distance / ticks + change * (ticks - 1.0) / 2.0


@njit(cache=True)
def stopping_m(way: float, change: float) -> float:
    """Return how far a robot comes that goes *way* in the next tick and then loses *change* a tick until it stands."""
    total = 0.0
    while way > 0.0:
        total += way
        way -= change
    return total


@njit(cache=True)
def _stop(x: float, y: float, heading: float, way: float, turn: float, own: Floats, path: Floats) -> tuple[int, float]:
    """Roll out a tick of *way* and *turn*, and braking, into the points of *path*; return how many, and the heading."""
    path[0, 0], path[0, 1] = x, y
    count = 1
    while (way != 0.0 or turn != 0.0) and count < path.shape[0]:
        dx, dy = chord(heading, way, turn)
        heading += turn
        if way != 0.0:
            x, y = x + dx, y + dy
            path[count, 0], path[count, 1] = x, y
            count += 1
        way = towards(0.0, way, own[WAY_CHANGE])
        turn = towards(0.0, turn, own[TURN_CHANGE])
    return count, heading


# ---------------------------------------------------------------- borders between robots


@njit(cache=True)
def _ahead(gone_x: float, gone_y: float, change: float) -> tuple[float, float]:
    """Return the way ahead (x, y) of a robot that has gone so far in the last tick, speeds up once more, and brakes."""
    gone = elementary.hypot(gone_x, gone_y)
    if gone < _ROUNDING:
        return 0.0, 0.0
    length = stopping_m(gone + change, change)
    return gone_x / gone * length, gone_y / gone * length


@njit(cache=True)
def _astray(gone: float, change: float, stray: float) -> float:
    """Return how far from the stretch ahead a robot may come that has gone so far in the last tick."""
    least = _STARTED * change
    return min(least + gone, max(stray, least))


@njit(cache=True)
def nearest_points(
    px: float, py: float, qx: float, qy: float, cx: float, cy: float, ex: float, ey: float
) -> tuple[float, float, float, float]:
    """Return the points of the segments p-q and c-e that are nearest to each other (the middle of several)."""
    _, s = closest_approach(px, py, qx, qy, cx, cy, ex, ey)
    ax, ay = px + s * (qx - px), py + s * (qy - py)
    wx, wy = ex - cx, ey - cy
    square = wx * wx + wy * wy
    u = 0.0
    if square > 0.0:
        u = min(max(((ax - cx) * wx + (ay - cy) * wy) / square, 0.0), 1.0)
    return ax, ay, cx + u * wx, cy + u * wy


@njit(cache=True)
def _border(own: Floats, state: Floats, body: Floats, line: Floats) -> bool:
    """Write the border between the robot and another: a normal and a bound; return False if both are to brake."""
    change, other_change = own[WAY_CHANGE], body[BODY_CHANGE]
    gone, other_gone = (
        elementary.hypot(state[GONE_X], state[GONE_Y]),
        elementary.hypot(body[BODY_GONE_X], body[BODY_GONE_Y]),
    )
    dx, dy = _ahead(state[GONE_X], state[GONE_Y], change)
    ex, ey = _ahead(body[BODY_GONE_X], body[BODY_GONE_Y], other_change)
    x, y, ox, oy = state[X], state[Y], body[BODY_X], body[BODY_Y]
    ax, ay, bx, by = nearest_points(x, y, x + dx, y + dy, ox, oy, ox + ex, oy + ey)
    astray, other_astray = _astray(gone, change, own[STRAY]), _astray(other_gone, other_change, own[STRAY])
    apart = elementary.hypot(bx - ax, by - ay)
    gap = apart - own[RADIUS] - body[BODY_RADIUS] - astray - other_astray
    if gap > 0.0 and apart > 0.0:
        line[0], line[1] = (bx - ax) / apart, (by - ay) / apart
        line[2] = line[0] * ax + line[1] * ay + max(astray + 0.5 * (gap - own[MARGIN]), 0.0)
        return True
    apart = elementary.hypot(ox - x, oy - y)
    if gone > _ROUNDING or other_gone > _ROUNDING or apart == 0.0:
        return False
    # both stand, so near that a start would be too much: they may part, and go along each other
    line[0], line[1] = (ox - x) / apart, (oy - y) / apart
    near = apart - own[RADIUS] - body[BODY_RADIUS] - own[MARGIN]
    line[2] = line[0] * x + line[1] * y + max(0.5 * near - _STARTED * max(change, other_change), 0.0)
    return True


# ---------------------------------------------------------------- what a stop comes near to


@njit(cache=True)
def _clearance(path: Floats, count: int, walls: Floats, points: Floats, enough: float) -> float:
    """Return how near the polyline of *count* points comes to walls and points, at most *enough*."""
    best = enough * enough
    for k in range(max(count - 1, 1)):
        px, py = path[k]
        qx, qy = path[min(k + 1, count - 1)]
        for wall in range(walls.shape[0]):
            x1, y1, x2, y2 = walls[wall]
            if (
                min(x1, x2) - max(px, qx) < enough
                and min(px, qx) - max(x1, x2) < enough
                and min(y1, y2) - max(py, qy) < enough
                and min(py, qy) - max(y1, y2) < enough
            ):
                best = min(best, closest_approach(px, py, qx, qy, x1, y1, x2, y2)[0])
        for point in range(points.shape[0]):
            best = min(best, _square_off(points[point, 0], points[point, 1], px, py, qx, qy))
    return math.sqrt(best)


@njit(cache=True)
def _square_off(x: float, y: float, px: float, py: float, qx: float, qy: float) -> float:
    """Return the squared distance of a point from the segment p-q."""
    wx, wy = qx - px, qy - py
    square = wx * wx + wy * wy
    u = 0.0
    if square > 0.0:
        u = min(max(((x - px) * wx + (y - py) * wy) / square, 0.0), 1.0)
    ex, ey = px + u * wx - x, py + u * wy - y
    return ex * ex + ey * ey


@njit(cache=True)
def _beyond(path: Floats, count: int, lines: Floats) -> bool:
    """Return whether a point of the polyline is beyond one of the borders."""
    for k in range(count):
        for i in range(lines.shape[0]):
            if lines[i, 0] * path[k, 0] + lines[i, 1] * path[k, 1] > lines[i, 2] + _ROUNDING:
                return True
    return False


@njit(cache=True)
def _strays(path: Floats, count: int, dx: float, dy: float, astray: float) -> bool:
    """Return whether a point of the polyline is farther than *astray* from the stretch d that begins where it does."""
    for k in range(1, count):
        x, y = path[0]
        if _square_off(path[k, 0], path[k, 1], x, y, x + dx, y + dy) > astray * astray:
            return True
    return False


@njit(cache=True)
def _wrapped(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


# ---------------------------------------------------------------- the choice


@njit(cache=True)
def choose(
    own: Floats, state: Floats, walls: Floats, points: Floats, bodies: Floats, aim_x: float, aim_y: float, most: float
) -> tuple[float, float, bool]:
    """Return the way and the turn of the tick after the next, to be commanded now, and whether they were chosen.

    *own* (12,) and *state* (7,) are rows as above; *walls* (n, 4) and *points* (m, 2) are what is not to be touched,
    as near as it can matter, see :func:`walls_near`; *bodies* (k, 6) the other robots. The robot faces its aim, and
    goes at most *most* metres a tick. If no command is admissible it brakes, 0 and 0. In metres, radians and ticks.
    """
    lines = np.empty((bodies.shape[0], 3))
    for i in range(bodies.shape[0]):
        if not _border(own, state, bodies[i], lines[i]):
            return 0.0, 0.0, False
    dx, dy = chord(state[HEADING], state[WAY], state[TURN])
    x, y, heading = state[X] + dx, state[Y] + dy, state[HEADING] + state[TURN]
    ahead_x, ahead_y = _ahead(dx, dy, own[WAY_CHANGE])
    astray = _astray(elementary.hypot(dx, dy), own[WAY_CHANGE], own[STRAY])
    path = np.empty((int(own[MOST_WAY] / own[WAY_CHANGE]) + 4, 2))
    path[0, 0], path[0, 1] = x, y
    enough = own[RADIUS] + max(own[CLEAR], own[MARGIN])
    near = _clearance(path, 1, walls, points, enough)
    need = min(own[RADIUS] + own[MARGIN], near) - _ROUNDING
    contact = min(own[RADIUS], near) - _ROUNDING
    discs = _discs(own, x, y, contact, points, bodies)
    low = max(state[WAY] - own[WAY_CHANGE], 0.0)
    high = max(min(state[WAY] + own[WAY_CHANGE], own[MOST_WAY], most), low)
    left = max(state[TURN] - own[TURN_CHANGE], -own[MOST_TURN])
    right = min(state[TURN] + own[TURN_CHANGE], own[MOST_TURN])
    best, best_way, best_turn, chosen = -math.inf, 0.0, 0.0, False
    ideal = _landing_turn(own, state, x, y, heading, aim_x, aim_y)
    for j in range(_TURNS + 2):
        turn = left + (right - left) * j / (_TURNS - 1) if j < _TURNS else ideal if j == _TURNS else 0.0
        turn = min(max(turn, left), right)
        for i in range(_WAYS):
            way = high - (high - low) * i / (_WAYS - 1)
            if i > 0 and high == low:
                break
            count, facing = _stop(x, y, heading, way, turn, own, path)
            worth = _worth(own, path, count, heading, way, turn, facing, aim_x, aim_y)
            if worth + own[KEEPING_CLEAR] <= best or _beyond(path, count, lines):
                continue
            if _strays(path, count, ahead_x, ahead_y, astray):
                continue
            room = _clearance(path, count, walls, points, enough)
            if room < need:
                continue
            if own[ARC] > 0.0:
                free = _free_way(own, x, y, heading, way, turn, contact, walls, discs)
                if not _can_brake(own, way, turn, free):
                    continue
                worth += own[KEEPING_CLEAR] * free / own[ARC]
            else:
                worth += own[KEEPING_CLEAR] * (room - own[RADIUS]) / max(enough - own[RADIUS], _ROUNDING)
            if worth > best:
                best, best_way, best_turn, chosen = worth, way, turn, True
    return best_way, best_turn, chosen


@njit(cache=True)
def _landing_turn(own: Floats, state: Floats, x: float, y: float, heading: float, aim_x: float, aim_y: float) -> float:
    """Return the turn of a robot that turns to its aim as fast as it may, and stops turning when it faces it."""
    error = _wrapped(elementary.atan2(aim_y - y, aim_x - x) - heading)
    sign = 1.0 if error > 0.0 else -1.0
    turn: float = sign * min(braking_way(abs(error), own[TURN_CHANGE]), own[MOST_TURN])
    return turn


@njit(cache=True)
def _worth(
    own: Floats,
    path: Floats,
    count: int,
    heading: float,
    way: float,
    turn: float,
    facing: float,
    aim_x: float,
    aim_y: float,
) -> float:
    """Return the worth of a command, but for what its being clear is worth: of facing the aim, and of getting on."""
    fox = own[ARC] > 0.0
    dx, dy = aim_x - path[count - 1 if fox else 0, 0], aim_y - path[count - 1 if fox else 0, 1]
    bearing = elementary.atan2(dy, dx)
    error = abs(_wrapped(bearing - facing))
    if fox and dx * dx + dy * dy < _SAME_M * _SAME_M:
        error = 0.0
    gain = way / own[MOST_WAY] * (1.0 if fox else elementary.cos(bearing - heading - 0.5 * turn))
    worth: float = own[FACING] * (1.0 - error / math.pi) + own[GETTING_ON] * gain
    return worth


# ---------------------------------------------------------------- the way along the arc


@njit(cache=True)
def _discs(own: Floats, x: float, y: float, contact: float, points: Floats, bodies: Floats) -> Any:
    """Return what an arc may meet beside walls, shape (n, 3), for :func:`way_to_contact`; nothing if none is asked."""
    if not own[ARC] > 0.0:
        return np.empty((0, 3))
    discs, count = np.empty((points.shape[0] + bodies.shape[0], 3)), points.shape[0]
    discs[:count, :2], discs[:count, 2] = points, contact
    for i in range(bodies.shape[0]):
        apart = elementary.hypot(bodies[i, BODY_X] - x, bodies[i, BODY_Y] - y) - _ROUNDING
        discs[count + i, 0], discs[count + i, 1] = bodies[i, BODY_X], bodies[i, BODY_Y]
        discs[count + i, 2] = min(own[RADIUS] + bodies[i, BODY_RADIUS], apart)
    return discs


@njit(cache=True)
def _free_way(
    own: Floats,
    x: float,
    y: float,
    heading: float,
    way: float,
    turn: float,
    contact: float,
    walls: Floats,
    discs: Floats,
) -> float:
    """Return the article's dist: the way along the arc of a command until the robot touches something, at most ARC."""
    free: float = own[ARC]
    if way > 0.0:
        free = way_to_contact(x, y, heading, turn / way, contact, walls, discs, free)
    return free


@njit(cache=True)
def _can_brake(own: Floats, way: float, turn: float, free: float) -> bool:
    """Return whether a command is admissible by the article: v <= sqrt(2 dist a), and likewise the rate of turn."""
    straight, turning = way * way <= 2.0 * free * own[WAY_CHANGE], turn * turn <= 2.0 * free * own[TURN_CHANGE]
    return bool(free >= own[ARC] or (straight and turning))


# ---------------------------------------------------------------- what is near


@njit(cache=True)
def walls_near(grid: SegmentGrid, x: float, y: float, reach: float) -> Any:
    """Return the walls within *reach* of a point, shape (n, 4), each once, in metres."""
    low_x, high_x, low_y, high_y = cells_near(grid, x, y, x, y, reach)
    members = np.empty(grid.member.shape[0], np.int32)
    count = 0
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            wall = grid.member[slot]
            x1, y1, x2, y2 = grid.walls_m[wall]
            if _square_off(x, y, x1, y1, x2, y2) <= reach * reach and not (members[:count] == wall).any():
                members[count] = wall
                count += 1
    found = np.empty((count, 4))
    for i in range(count):
        found[i] = grid.walls_m[members[i]]
    return found


@njit(cache=True)
def unknown_points(
    walls: Floats, bodies: Floats, x: float, y: float, ranges: Floats, reach: float, tolerance: float
) -> Any:
    """Return where a scan has met, within *reach*, what is neither a wall of the map nor a known body, shape (m, 2).

    Beam k looks along 2 pi k / n; *tolerance* is how far from a wall or a body (metres) a beam may seem to end on it.
    """
    found, count = np.empty((ranges.shape[0], 2)), 0
    for k in range(ranges.shape[0]):
        if not ranges[k] <= reach:
            continue
        angle = 2.0 * math.pi * k / ranges.shape[0]
        px, py = x + ranges[k] * elementary.cos(angle), y + ranges[k] * elementary.sin(angle)
        known = False
        for i in range(walls.shape[0]):
            x1, y1, x2, y2 = walls[i]
            known |= _square_off(px, py, x1, y1, x2, y2) <= tolerance * tolerance
        for i in range(bodies.shape[0]):
            off = elementary.hypot(px - bodies[i, BODY_X], py - bodies[i, BODY_Y])
            known |= off <= bodies[i, BODY_RADIUS] + tolerance
        if not known:
            found[count, 0], found[count, 1] = px, py
            count += 1
    return found[:count]


@njit(cache=True)
def unseen_gap(walls: Floats, x: float, y: float, heading: float) -> float:
    """Return how far ahead the nearest end of a wall is behind which a robot may be out of sight; inf without one.

    The end of a wall hides what is behind it if all walls that meet there lie on one side of the line to it.
    """
    nearest = math.inf
    ux, uy = elementary.cos(heading), elementary.sin(heading)
    for i in range(walls.shape[0]):
        for end in range(2):
            cx, cy = walls[i, 2 * end], walls[i, 2 * end + 1]
            dx, dy = cx - x, cy - y
            off = elementary.hypot(dx, dy)
            if off < nearest and dx * ux + dy * uy > 0.0 and _hides(walls, cx, cy, dx, dy):
                nearest = off
    return nearest


@njit(cache=True)
def _hides(walls: Floats, cx: float, cy: float, dx: float, dy: float) -> bool:
    left, right = False, False
    for i in range(walls.shape[0]):
        x1, y1, x2, y2 = walls[i]
        if _square_off(cx, cy, x1, y1, x2, y2) > _SAME_M * _SAME_M:
            continue
        for end in range(2):
            ex, ey = walls[i, 2 * end] - cx, walls[i, 2 * end + 1] - cy
            side = dx * ey - dy * ex
            left |= side > _SAME_M * _SAME_M
            right |= side < -_SAME_M * _SAME_M
    return left != right
