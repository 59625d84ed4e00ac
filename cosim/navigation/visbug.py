"""VisBug-21 in continuous geometry: Bug2 for a robot that sees, and cuts the corners of Bug2's path.

Lumelsky and Skewis, "Incorporating range sensing in the robot navigation function", IEEE Trans. Systems, Man, and
Cybernetics 20(5), 1990; Lumelsky, "Sensing, Intelligence, Motion", Wiley 2006, section 3.6. The robot sees up to the
radius of vision, in line of sight. At every point it computes the intermediate target T_i, the farthest place that it
can tell to lie on the path that Bug2 would take, and moves straight towards it. Compute T_i-21, by the book's steps:

1. If T is visible, T_i = T.
2. From T_i on the M-line: the end Q of what is seen of the M-line without a gap. If an obstacle crosses there, H = Q.
3. From T_i on a boundary: the end of what is seen of it without a gap, in the local direction. Meets it the M-line
   nearer to T than H (X), with the way towards T free (L), go on with 2. Meets it H again, T is unreachable.
4. If from the main half-plane a point of the M-line nearer to T than Q (or X) is seen, take the nearest to T; go to 2.

Whenever the robot stands at T_i on an obstacle, it sees the whole edge ahead of it, so "walking along the boundary"
(the book's S2) is moving towards the next T_i. As every T_i lies on Bug2's path, in its order, and the robot moves
straight, |C T_i| plus the rest of Bug2's path never grows by a decision: for steps of any length the way is not longer
than Bug2's. Sight errs, where it is a matter of rounding, to the side of not seeing, which costs no correctness.
"""

from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int32s, Int64s
from cosim.geometry.boundary import (
    CLEAR_M,
    SLACK_M,
    Boundary,
    edge_length,
    free_height,
    last_seen,
    point_at,
    seen_until,
    stand_clear,
    unpacked_boundary,
    within,
)
from cosim.jit import njit
from cosim.navigation.bug2 import (
    ALONG,
    CLOSED,
    EDGE,
    GOAL,
    HIT,
    LAST,
    LEFT,
    LINE,
    NOTHING,
    SIZE,
    STATUS,
    T_X,
    T_Y,
    TOTAL,
    U_X,
    U_Y,
    WALKING,
    Move,
    Path,
    Point,
    begin_search,
    bends,
    crossing,
    hit,
    line_point,
    next_hit,
    off_line,
    place_point,
    sees_place,
    stride,
    waited,
    walk,
)
from cosim.navigation.status import ARRIVED, UNDERWAY, UNREACHABLE, Status

_AT_M: Final = 1e-6
"""Distance within which a robot is at its intermediate target."""
_ASIDE_M: Final = 1e-5
"""Distance from the M-line beyond which a robot is in a half-plane, not on the line."""
_BACK: Final = 16
"""Number of edges along which a robot looks back for a place that it sees, once it has lost its target."""

# The memory: the search whose place is T_i; the search as it was seen from where the last step began; where the robot
# was sent, from where, for how many steps in vain; how often a search began again because the robot was moved.
_SEEN: Final = SIZE
_ASKED_X: Final = 2 * SIZE
_ASKED_Y, _FROM_X, _FROM_Y, _IDLE, LOST = range(_ASKED_X + 1, _ASKED_X + 6)
MEMORY: Final = _ASKED_X + 6
"""Number of numbers in the memory; number :data:`LOST` counts how often a displaced robot began again."""


def visbug_step(
    loops: Boundary,
    position_m: Point,
    goal_m: Point,
    memory: Floats | None,
    *,
    vision_m: float,
    step_m: float,
    near_m: float,
) -> Move:
    """Return the next motion step of VisBug-21: *step_m* metres towards the intermediate targets.

    Begin with *memory* None; another goal than the memory's begins a new search. The status is ARRIVED within *near_m*
    of the goal, UNREACHABLE once that is proved, STUCK when 20 steps in a row were not gone (the answer still has a
    direction). A step that reaches its target goes on to the next one, its length measured around the corner, but ends
    early at a corner of more than 60 degrees; where the outline of an obstacle is round, the straight way to its end
    cuts into the outline by at most step_m^2 / (8 radius). Of the loops only what is within *vision_m* and in line of
    sight from the way of this step is used.

    *position_m* need not be where the last step led. If the robot still sees its T_i, or the one before this step, or
    a place up to 16 edges back along the boundary that it walks along, it goes on from there, and nothing is lost:
    these lie on the same Bug2 path. Else it begins again from where it is; the new search is convergent by itself, so
    the goal is reached, or proved unreachable, once the robot is no longer moved out of sight of its path. Inside an
    obstacle (less than a metre deep) it counts as standing at the nearest place of the boundary. Nothing is raised for
    finite numbers.
    """
    known = memory if memory is not None else np.empty(0)
    numbers = map(float, (*position_m, *goal_m, vision_m, step_m, near_m))
    x, y, status, after = visbug_kernel(loops, known, *numbers)
    return Move(x, y, Status(status), after)


def visbug_path(
    loops: Boundary, start_m: Point, goal_m: Point, *, vision_m: float, step_m: float, limit: int = 1_000_000
) -> tuple[Path, Floats]:
    """Return the whole path of VisBug-21 with steps of *step_m*, and its intermediate targets (n, 2) in order.

    The path ends at the goal, or where that is proved unreachable, or after *limit* steps (status UNDERWAY). The
    targets are those of every place at which the robot looked.
    """
    memory: Floats | None = None
    points, targets = [start_m], [start_m]
    status = Status.UNDERWAY
    while status in (Status.UNDERWAY, Status.STUCK) and len(points) <= limit:
        x, y, status, memory = visbug_step(
            loops, points[-1], goal_m, memory, vision_m=vision_m, step_m=step_m, near_m=_AT_M
        )
        points.append((x, y))
        targets.append(target_of(loops, memory))
    rows = np.array(points)
    return Path(rows, float(elementary.hypots(*np.diff(rows, axis=0).T).sum()), status), np.array(targets)


def target_of(loops: Boundary, memory: Floats) -> Point:
    """Return the intermediate target T_i that *memory* holds, in metres."""
    x, y = place_point(loops, memory)
    return float(x), float(y)


@njit(cache=True)
def visbug_packed(
    numbers: Floats,
    members: Int32s,
    links: Int64s,
    side: float,
    memory: Floats,
    begun: bool,
    x: float,
    y: float,
    goal_x: float,
    goal_y: float,
    vision: float,
    step: float,
    near: float,
) -> tuple[float, float, int]:
    """Do what :func:`visbug_kernel` does, for callers at every tick, with the loops of ``packed_boundary``.

    Numba is slow to pass anything but arrays in, and to hand arrays out. *memory* (MEMORY,) is changed in place, and
    means nothing unless *begun*.
    """
    loops = unpacked_boundary(numbers, members, links, side)
    known = memory if begun else memory[:0]
    to_x, to_y, status, after = visbug_kernel(loops, known, x, y, goal_x, goal_y, vision, step, near)
    memory[:] = after
    return to_x, to_y, status


@njit(cache=True)
def visbug_kernel(
    loops: Boundary,
    known: Floats,
    x: float,
    y: float,
    goal_x: float,
    goal_y: float,
    vision: float,
    step: float,
    near: float,
) -> tuple[float, float, int, Floats]:
    """Do what :func:`visbug_step` does, for kernels; *known* is empty at the beginning."""
    memory = np.zeros(MEMORY)
    status = UNDERWAY
    if known.shape[0] and known[T_X] == goal_x and known[T_Y] == goal_y:
        memory[:] = known
        status = waited(memory, _ASKED_X, x, y)
        if elementary.hypot(x - memory[_ASKED_X], y - memory[_ASKED_Y]) > _AT_M:
            _find_target(loops, memory, x, y, vision)
    else:
        begin_search(loops, memory, x, y, goal_x, goal_y)
    memory[_FROM_X], memory[_FROM_Y] = x, y
    to_x, to_y = x, y
    if elementary.hypot(goal_x - x, goal_y - y) <= near:
        status = ARRIVED
    else:
        if memory[STATUS] == UNDERWAY:
            _look(loops, memory, x, y, vision)
        memory[_SEEN : _SEEN + SIZE] = memory[:SIZE]
        to_x, to_y = _go(loops, memory, x, y, vision, step)
        if memory[STATUS] == UNREACHABLE:
            status = UNREACHABLE
    memory[_ASKED_X], memory[_ASKED_Y] = to_x, to_y
    return to_x, to_y, status, memory


@njit(cache=True)
def _go(loops: Boundary, memory: Floats, x: float, y: float, vision: float, step: float) -> tuple[float, float]:
    """Return where one step leads, looking again wherever an intermediate target is reached."""
    ahead_x = ahead_y = 0.0
    fresh = True
    while step > SLACK_M and memory[STATUS] == UNDERWAY:
        place_x, place_y = place_point(loops, memory)
        if elementary.hypot(place_x - x, place_y - y) > SLACK_M:
            if bends(ahead_x, ahead_y, place_x - x, place_y - y):
                break
            if ahead_x == 0.0 and ahead_y == 0.0:
                ahead_x, ahead_y = place_x - x, place_y - y
            x, y, step = stride(x, y, place_x, place_y, step)
            fresh = False
        elif fresh or (not memory[WALKING] and memory[LINE] >= memory[TOTAL]):
            break
        else:
            _look(loops, memory, x, y, vision)
            fresh = True
    return x, y


@njit(cache=True)
def _find_target(loops: Boundary, memory: Floats, x: float, y: float, vision: float) -> None:
    """Give a robot that is not where it was sent a target that it sees: its own, an earlier one, or a new search's."""
    _, _, eye_x, eye_y = stand_clear(loops, x, y)
    if _in_view(loops, memory, eye_x, eye_y, vision):
        return
    memory[:SIZE] = memory[_SEEN : _SEEN + SIZE]
    for _ in range(_BACK):
        if _in_view(loops, memory, eye_x, eye_y, vision):
            return
        if not memory[WALKING] or not _step_back(loops, memory):
            break
    begin_search(loops, memory, x, y, memory[T_X], memory[T_Y])
    memory[LOST] += 1.0


@njit(cache=True)
def _in_view(loops: Boundary, row: Floats, eye_x: float, eye_y: float, vision: float) -> bool:
    """Return whether the search's place is seen, or not far beyond what is seen on a way that is clear."""
    px, py = place_point(loops, row)
    distance = elementary.hypot(px - eye_x, py - eye_y)
    if distance > 2.0 * vision:
        return False
    share = min(vision / max(distance, SLACK_M), 1.0)
    return sees_place(loops, eye_x, eye_y, eye_x + share * (px - eye_x), eye_y + share * (py - eye_y))


@njit(cache=True)
def _step_back(loops: Boundary, row: Floats) -> bool:
    """Take the search's place back to the beginning of its edge, but not behind the hit point."""
    edge = int(row[EDGE])
    if edge == int(row[HIT]) and crossing(loops, row, edge)[2] <= row[ALONG]:
        return False
    row[EDGE] = loops.preceding[edge]
    row[ALONG] = edge_length(loops, int(row[EDGE]))
    return True


# ---------------------------------------------------------------- Compute T_i-21


@njit(cache=True)
def _look(loops: Boundary, row: Floats, x: float, y: float, vision: float) -> None:
    """Move the intermediate target as far as a robot at (x, y) sees to (Compute T_i-21)."""
    stand_x, stand_y, eye_x, eye_y = stand_clear(loops, x, y)
    goal_x, goal_y = row[T_X], row[T_Y]
    # step 1
    if elementary.hypot(goal_x - eye_x, goal_y - eye_y) <= vision and sees_place(loops, eye_x, eye_y, goal_x, goal_y):
        row[WALKING], row[EDGE], row[LINE] = 0.0, -1.0, row[TOTAL]
        return
    for _ in range(4 * loops.following.shape[0] + 4):
        place_x, place_y = place_point(loops, row)
        there = elementary.hypot(place_x - stand_x, place_y - stand_y) <= _AT_M
        if row[WALKING]:
            event = _along_boundary(loops, row, stand_x, stand_y, eye_x, eye_y, vision)
            if event == CLOSED:
                row[STATUS] = UNREACHABLE
            if event in (CLOSED, GOAL):
                return
            ahead = event == LEFT
        else:
            ahead = _along_line(loops, row, there, eye_x, eye_y, vision)
        if not ahead and not _shortcut(loops, row, eye_x, eye_y, vision):
            return


@njit(cache=True)
def _along_line(loops: Boundary, row: Floats, there: bool, eye_x: float, eye_y: float, vision: float) -> bool:
    """Move the target along the M-line as far as it is seen (step 2); return whether an obstacle was hit."""
    px, py = line_point(row, row[LINE])
    _, high = within(eye_x, eye_y, vision, px, py, row[T_X], row[T_Y])
    if high == 0.0:
        return False
    until = row[LINE] + high * (row[TOTAL] - row[LINE])
    edge, line, along = next_hit(loops, row, until)
    end = line if edge >= 0 else until
    qx, qy = line_point(row, end)
    if not there and abs(off_line(row, eye_x, eye_y)) > SLACK_M:
        seen = row[LINE] + seen_until(loops, eye_x, eye_y, px, py, qx, qy, -1) * (end - row[LINE])
        if seen < end - SLACK_M:
            if seen > row[LINE] + 2 * SLACK_M:
                row[EDGE], row[LINE] = -1.0, seen
            return False
    if edge >= 0:
        hit(row, edge, line, along)
    elif end > row[LINE] + 2 * SLACK_M:
        row[EDGE], row[LINE] = -1.0, end
    return edge >= 0


@njit(cache=True)
def _along_boundary(
    loops: Boundary, row: Floats, stand_x: float, stand_y: float, eye_x: float, eye_y: float, vision: float
) -> int:
    """Move the target along the boundary as far as it is seen, or to what is met there (step 3); return what is met."""
    for _ in range(loops.following.shape[0] + 1):
        edge, begin, entered = int(row[EDGE]), row[ALONG], False
        px, py = point_at(loops, edge, begin)
        there = elementary.hypot(px - stand_x, py - stand_y) <= _AT_M
        if begin >= edge_length(loops, edge):
            edge, begin, entered = loops.following[edge], 0.0, True
        length = edge_length(loops, edge)
        end = _seen_of(loops, edge, begin, there, eye_x, eye_y, vision)
        if end <= begin + SLACK_M and end < length:
            return NOTHING
        event = walk(loops, row, edge, begin, end, entered)
        if event != NOTHING or end < length:
            return event
    return NOTHING


@njit(cache=True)
def _seen_of(loops: Boundary, edge: int, begin: float, there: bool, eye_x: float, eye_y: float, vision: float) -> float:
    """Return how far along an edge it is seen without a gap from *begin*, in metres; all of it by who is *there*."""
    if not there and free_height(loops, edge, eye_x, eye_y) <= SLACK_M:
        return begin
    length = edge_length(loops, edge)
    px, py = point_at(loops, edge, begin)
    qx, qy = point_at(loops, edge, length)
    _, high = within(eye_x, eye_y, vision, px, py, qx, qy)
    if high < 1.0:
        qx, qy = px + high * (qx - px), py + high * (qy - py)
    reach = length - begin
    if high == 0.0 or reach == 0.0:
        return begin
    seen = high if there else high * seen_until(loops, eye_x, eye_y, px, py, qx, qy, edge)
    return length if seen * reach >= reach - SLACK_M else begin + seen * reach


@njit(cache=True)
def _shortcut(loops: Boundary, row: Floats, eye_x: float, eye_y: float, vision: float) -> bool:
    """Move the target to the point of the M-line nearest to T that is seen from the main half-plane (step 4)."""
    if loops.side * off_line(row, eye_x, eye_y) <= _ASIDE_M:
        return False
    line = row[LAST] if row[WALKING] else row[LINE]
    px, py = line_point(row, line)
    low, high = within(eye_x, eye_y, vision, px, py, row[T_X], row[T_Y])
    begin, end = line + low * (row[TOTAL] - line), line + high * (row[TOTAL] - line)
    if end <= begin + CLEAR_M:
        return False
    ends = (*line_point(row, begin), *line_point(row, end))
    seen = begin + last_seen(loops, eye_x, eye_y, *ends) * (end - begin)
    if seen <= begin + 2 * CLEAR_M:
        return False
    # the line counts as running a little to its right, see crossing(): beside a wall along it that may be solid
    px, py = line_point(row, seen - SLACK_M)
    if not sees_place(loops, eye_x, eye_y, px + CLEAR_M * row[U_Y], py - CLEAR_M * row[U_X]):
        return False
    row[WALKING], row[EDGE], row[LINE] = 0.0, -1.0, seen
    return True
