"""Bug2 in continuous geometry: along the line to the goal, around any obstacle in the way, and on.

Lumelsky and Stepanov's algorithm as Lumelsky prints it ("Sensing, Intelligence, Motion", Wiley 2006, section 3.3): the
M-line is the segment from the start S to the goal T. The robot follows it until an obstacle's boundary crosses it, at
the hit point H, then walks along the boundary in its local direction until it meets the M-line nearer to T than H where
the way towards T is free, the leave point L. If it comes to H again, T cannot be reached.

Exactness. Every decision is about an edge that crosses the M-line, and which side of it the ends of an edge are on is
computed alike for two edges with a common corner (an end on the line counts as to its left). So crossings alternate
along every loop and along the M-line; whether the way towards T is free at a crossing is a sign (from the M-line's
main side to the other, or back), not a matter of tolerance. Two crossings are ordered by their distances from S, those
of two neighbouring edges by whether their corner is convex. A boundary in step with rounding cannot be left at a point
where it was hit, and no crossing is overlooked between two positions of the robot: there is no false "unreachable".

A search is a row of numbers (``SIZE``); the kernels here are shared with VisBug-21, whose intermediate targets lie on
the path of Bug2. The row knows places: on the M-line (free, or at a leave point), or on the boundary.
"""

from typing import Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.boundary import (
    CLEAR_M,
    SLACK_M,
    Boundary,
    convex,
    edge_length,
    free_height,
    point_at,
    stand_clear,
)
from cosim.geometry.segments import cells_near, in_sight
from cosim.jit import njit
from cosim.navigation.status import ARRIVED, STUCK, UNDERWAY, UNREACHABLE, Status

Point: TypeAlias = tuple[float, float]


class Move(NamedTuple):
    """The answer to one motion step: go straight to (x_m, y_m), and hand *memory* in again at the next step."""

    x_m: float
    y_m: float
    status: Status
    memory: Floats


class Path(NamedTuple):
    """A whole way: its corners (n, 2) in metres, its length and how it ended."""

    points_m: Floats
    length_m: float
    status: Status


# The columns of a search: S, T, the unit vector S-T, |ST|; the place: on the M-line LINE metres from S (EDGE: the edge
# that was left there, or -1), or, with WALKING, on the edge EDGE, ALONG metres from its beginning; the edge of the last
# hit point; how far from S the M-line was last met nearer to T than that (X); the status.
S_X, S_Y, T_X, T_Y, U_X, U_Y, TOTAL, WALKING, EDGE, ALONG, LINE, HIT, LAST, STATUS = range(14)
SIZE: Final = 14

NOTHING, LEFT, CLOSED, GOAL = 0, 1, 2, 3
"""Results of a stretch of boundary: nothing, a leave point, the hit point again, the goal."""
_WAITING: Final = 20
"""Number of steps in a row that were not gone after which a robot is stuck."""
_AWAY_M: Final = 1e-6
"""Distance from its target within which a robot has arrived."""

_BESIDE_M: Final = 40 * CLEAR_M
"""Distance from an eye within which every place is seen: that of an eye beside a narrow corner."""

# columns of Bug2's memory behind the search: where the robot was sent, from where, and for how many steps in vain
_ASKED_X, _ASKED_Y, _FROM_X, _FROM_Y, _IDLE = range(SIZE, SIZE + 5)


def bug2_step(
    loops: Boundary, position_m: Point, goal_m: Point, memory: Floats | None, *, step_m: float, near_m: float
) -> Move:
    """Return the next motion step of Bug2: *step_m* metres along its path, less where it turns by more than 60 degrees.

    Begin with *memory* None; another goal than the memory's begins a new search. The robot feels what it touches: of
    the loops only what lies on the way of this step matters. *position_m* need not be where the last step led: the
    robot goes straight back to its path if it sees that place, and else begins again from where it is. Then the next
    search is convergent again, unless the robot is moved without end. Inside an obstacle (less than a metre deep) it
    counts as standing at the nearest place of the boundary. Nothing is raised for any finite numbers.
    """
    known = memory if memory is not None else np.empty(0)
    x, y, status, after = _bug2_step(loops, known, *map(float, (*position_m, *goal_m, step_m, near_m)))
    return Move(x, y, Status(status), after)


def bug2_path(loops: Boundary, start_m: Point, goal_m: Point, *, limit: int = 1_000_000) -> Path:
    """Return the whole path of Bug2, exact: its corners, length and outcome (arrived or unreachable).

    Loops that cross each other may hold it for ever: after *limit* corners the outcome is UNDERWAY.
    """
    points, status = _bug2_path(loops, limit, *map(float, (*start_m, *goal_m)))
    length = float(elementary.hypots(*np.diff(points, axis=0).T).sum())
    return Path(points, length, Status(status))


def crossings(loops: Boundary, start_m: Point, goal_m: Point) -> Floats:
    """Return where the loops cross the M-line, in its order.

    Rows (edge, metres along it, metres from S, 1 where the way towards T is free and else 0).
    """
    row = new_search(loops, *map(float, (*start_m, *goal_m)))
    found = [(edge, *crossing(loops, row, edge)) for edge in range(len(loops.following))]
    kept = sorted((line, edge, along, kind) for edge, kind, line, along in found if kind and 0 <= line <= row[TOTAL])
    return np.array([(edge, along, line, kind > 0) for line, edge, along, kind in kept]).reshape(-1, 4)


# ---------------------------------------------------------------- the M-line


@njit(cache=True)
def new_search(loops: Boundary, x: float, y: float, goal_x: float, goal_y: float) -> Floats:
    """Return the row of a search from (x, y), or beside the boundary if that touches it; a kernel for kernels."""
    row = np.zeros(SIZE)
    begin_search(loops, row, x, y, goal_x, goal_y)
    return row


@njit(cache=True)
def begin_search(loops: Boundary, row: Floats, x: float, y: float, goal_x: float, goal_y: float) -> None:
    """Make *row* a search from (x, y), see :func:`new_search`."""
    _, _, x, y = stand_clear(loops, x, y)
    total = elementary.hypot(goal_x - x, goal_y - y)
    row[:SIZE] = 0.0
    row[S_X], row[S_Y], row[T_X], row[T_Y], row[TOTAL] = x, y, goal_x, goal_y, total
    row[U_X], row[U_Y] = ((goal_x - x) / total, (goal_y - y) / total) if total > 0.0 else (1.0, 0.0)
    row[EDGE] = row[HIT] = -1


@njit(cache=True)
def off_line(row: Floats, x: float, y: float) -> float:
    """Return how far left of the M-line a point is, in metres; a kernel for kernels."""
    return float(row[U_X] * (y - row[S_Y]) - row[U_Y] * (x - row[S_X]))


@njit(cache=True)
def line_point(row: Floats, line: float) -> tuple[float, float]:
    """Return the point of the M-line *line* metres from S; a kernel for kernels."""
    if line >= row[TOTAL]:
        return row[T_X], row[T_Y]
    return row[S_X] + line * row[U_X], row[S_Y] + line * row[U_Y]


@njit(cache=True)
def place_point(loops: Boundary, row: Floats) -> tuple[float, float]:
    """Return the point of the search's place; a kernel for kernels."""
    if row[WALKING]:
        return point_at(loops, int(row[EDGE]), row[ALONG])
    return line_point(row, row[LINE])


@njit(cache=True)
def crossing(loops: Boundary, row: Floats, edge: int) -> tuple[int, float, float]:
    """Return how an edge crosses the line through S and T: 1 at a leave point, -1 at a hit point, 0 not at all.

    And where, in metres from S and in metres along the edge. A kernel for kernels.
    """
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    off_1, off_2 = off_line(row, x1, y1), off_line(row, x2, y2)
    if (off_1 >= 0.0) == (off_2 >= 0.0):
        return 0, 0.0, 0.0
    f = off_1 / (off_1 - off_2)
    line_1 = row[U_X] * (x1 - row[S_X]) + row[U_Y] * (y1 - row[S_Y])
    line_2 = row[U_X] * (x2 - row[S_X]) + row[U_Y] * (y2 - row[S_Y])
    # from the main half-plane to the other: the free side of the edge is that of T
    kind = 1 if (off_1 >= 0.0) == (loops.side > 0.0) else -1
    return kind, line_1 + f * (line_2 - line_1), f * elementary.hypot(x2 - x1, y2 - y1)


@njit(cache=True)
def beyond(loops: Boundary, edge: int, kind: int, line: float, other: int, other_line: float) -> bool:
    """Return whether an edge's crossing, *line* metres from S, is nearer to T than another's; a kernel for kernels."""
    corner = -1
    if loops.following[edge] == other:
        corner = edge
    elif loops.following[other] == edge:
        corner = other
    if corner < 0 or abs(line - other_line) > CLEAR_M:
        return line > other_line
    # between the two lies the inside of their corner: the obstacle's if convex, so first a hit and then a leave
    return (kind > 0) == convex(loops, corner)


@njit(cache=True)
def next_hit(loops: Boundary, row: Floats, until: float) -> tuple[int, float, float]:
    """Return the first hit point of the M-line after the search's place, at most *until* metres from S.

    Its edge (-1: none), metres from S, metres along the edge. A hit at T itself is none. A kernel for kernels.
    """
    grid = loops.grid
    px, py = line_point(row, row[LINE])
    qx, qy = line_point(row, until)
    left = int(row[EDGE])
    found, best, at = -1, min(until, row[TOTAL] - SLACK_M), 0.0
    low_x, high_x, low_y, high_y = cells_near(grid, min(px, qx), min(py, qy), max(px, qx), max(py, qy), SLACK_M)
    for iy in range(low_y, high_y):
        for slot in range(grid.first[iy * grid.nx + low_x], grid.first[iy * grid.nx + high_x]):
            edge = grid.member[slot]
            kind, line, along = crossing(loops, row, edge)
            if kind < 0 and line <= best:
                after = beyond(loops, edge, kind, line, left, row[LINE]) if left >= 0 else line >= row[LINE] - SLACK_M
                if after:
                    found, best, at = edge, line, along
    return found, best, at


# ---------------------------------------------------------------- the boundary


@njit(cache=True)
def hit(row: Floats, edge: int, line: float, along: float) -> None:
    """Put the search's place on the boundary at a hit point; a kernel for kernels."""
    row[WALKING], row[EDGE], row[ALONG] = 1.0, edge, along
    row[HIT], row[LAST] = edge, line


@njit(cache=True)
def walk(loops: Boundary, row: Floats, edge: int, begin: float, end: float, entered: bool) -> int:
    """Take the search's place from *begin* to *end* metres along an edge, or to what is met between; return which.

    The beginning itself counts only if the edge has just been entered. A kernel for kernels.
    """
    row[EDGE], row[ALONG] = edge, end
    x1, y1, x2, y2 = loops.grid.walls_m[edge]
    length = elementary.hypot(x2 - x1, y2 - y1)
    goal = ((row[T_X] - x1) * (x2 - x1) + (row[T_Y] - y1) * (y2 - y1)) / length
    if begin - SLACK_M <= goal <= end + SLACK_M and abs(free_height(loops, edge, row[T_X], row[T_Y])) <= SLACK_M:
        row[WALKING], row[EDGE], row[LINE] = 0.0, -1.0, row[TOTAL]
        return GOAL
    kind, line, along = crossing(loops, row, edge)
    if kind == 0 or along > end or not (along > begin or (entered and along == begin)):
        return NOTHING
    last = int(row[HIT])
    if edge == last:
        return CLOSED
    if line > row[TOTAL] or not beyond(loops, edge, kind, line, last, crossing(loops, row, last)[1]):
        return NOTHING
    row[LAST] = line
    if kind < 0:
        return NOTHING
    row[WALKING], row[LINE] = 0.0, line
    return LEFT


# ---------------------------------------------------------------- Bug2


@njit(cache=True)
def _next_corner(loops: Boundary, row: Floats, until: float) -> None:
    """Take the search's place to the next corner of Bug2's path; on the M-line at most *until* metres from S."""
    if not row[WALKING]:
        edge, line, along = next_hit(loops, row, until)
        if edge >= 0:
            hit(row, edge, line, along)
            return
        row[EDGE], row[LINE] = -1.0, until
        if until >= row[TOTAL]:
            row[STATUS] = ARRIVED
        return
    edge, begin, entered = int(row[EDGE]), row[ALONG], False
    if begin >= edge_length(loops, edge):
        edge, begin, entered = loops.following[edge], 0.0, True
    event = walk(loops, row, edge, begin, edge_length(loops, edge), entered)
    if event == CLOSED:
        row[ALONG] = crossing(loops, row, edge)[2]
        row[STATUS] = UNREACHABLE
    elif event == GOAL:
        row[STATUS] = ARRIVED


@njit(cache=True)
def _bug2_path(loops: Boundary, limit: int, x: float, y: float, goal_x: float, goal_y: float) -> tuple[Floats, int]:
    row = new_search(loops, x, y, goal_x, goal_y)
    points = [(row[S_X], row[S_Y])]
    while row[STATUS] == UNDERWAY and len(points) <= limit:
        _next_corner(loops, row, row[TOTAL])
        points.append(place_point(loops, row))
    rows = np.empty((len(points), 2))
    for i in range(len(points)):
        rows[i, 0], rows[i, 1] = points[i]
    return rows, int(row[STATUS])


@njit(cache=True)
def waited(memory: Floats, at: int, x: float, y: float) -> int:
    """Count in *memory* the steps in a row that were asked for and not gone, and return STUCK or UNDERWAY.

    Its columns from *at* on: where the robot was sent, from where, the count. A kernel for kernels.
    """
    asked = elementary.hypot(memory[at] - memory[at + 2], memory[at + 1] - memory[at + 3])
    gone = elementary.hypot(x - memory[at + 2], y - memory[at + 3])
    memory[at + 4] = memory[at + 4] + 1.0 if gone <= 0.1 * asked else 0.0
    return STUCK if memory[at + 4] >= _WAITING else UNDERWAY


@njit(cache=True)
def sees_place(loops: Boundary, x: float, y: float, to_x: float, to_y: float) -> bool:
    """Return whether the eye at (x, y) sees a place, which may lie on the boundary; a kernel for kernels."""
    distance = elementary.hypot(to_x - x, to_y - y)
    if distance <= _BESIDE_M:
        return True
    f = 1.0 - CLEAR_M / distance
    return in_sight(loops.grid, x, y, x + f * (to_x - x), y + f * (to_y - y))


@njit(cache=True)
def _bug2_step(
    loops: Boundary, known: Floats, x: float, y: float, goal_x: float, goal_y: float, step: float, near: float
) -> tuple[float, float, int, Floats]:
    memory = np.zeros(SIZE + 5)
    status = UNDERWAY
    _, _, eye_x, eye_y = stand_clear(loops, x, y)
    if known.shape[0] and known[T_X] == goal_x and known[T_Y] == goal_y:
        memory[:] = known
        status = waited(memory, _ASKED_X, x, y)
    else:
        begin_search(loops, memory, x, y, goal_x, goal_y)
    if not sees_place(loops, eye_x, eye_y, *place_point(loops, memory)):
        begin_search(loops, memory, x, y, goal_x, goal_y)
    if elementary.hypot(goal_x - x, goal_y - y) <= near:
        status = ARRIVED
    memory[_FROM_X], memory[_FROM_Y] = x, y
    to_x, to_y, left, ahead_x, ahead_y = x, y, step, 0.0, 0.0
    while status != ARRIVED and left > SLACK_M:
        place_x, place_y = place_point(loops, memory)
        if elementary.hypot(place_x - to_x, place_y - to_y) > _AWAY_M:
            if bends(ahead_x, ahead_y, place_x - to_x, place_y - to_y):
                break
            if ahead_x == 0.0 and ahead_y == 0.0:
                ahead_x, ahead_y = place_x - to_x, place_y - to_y
            to_x, to_y, left = stride(to_x, to_y, place_x, place_y, left)
        elif memory[STATUS]:
            status = UNREACHABLE if memory[STATUS] == UNREACHABLE else status
            break
        else:
            _next_corner(loops, memory, min(memory[LINE] + left, memory[TOTAL]))
    memory[_ASKED_X], memory[_ASKED_Y] = to_x, to_y
    return to_x, to_y, status, memory


@njit(cache=True)
def stride(x: float, y: float, to_x: float, to_y: float, left: float) -> tuple[float, float, float]:
    """Return where *left* metres towards a place lead, at most to it, and what is left then; a kernel for kernels."""
    way = elementary.hypot(to_x - x, to_y - y)
    if way <= left:
        return to_x, to_y, left - way
    return x + left / way * (to_x - x), y + left / way * (to_y - y), 0.0


@njit(cache=True)
def bends(ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the way turns by more than 60 degrees from direction a to b (a = 0: no); a kernel for kernels."""
    return 2.0 * (ax * bx + ay * by) < elementary.hypot(ax, ay) * elementary.hypot(bx, by)
