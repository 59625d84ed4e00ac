"""Getting past a body that stands in the way: round it where there is room, else out of its way."""

import math
from typing import Final

from cosim.geometry.planning import Point
from cosim.geometry.polylines import length_m, off_m
from protocols.aggregation.ground import Ground

SLACKS_M: Final = (0.3, 0.2, 0.12, 0.06, 0.02)
"""So much more than a touch a robot keeps from a body that it goes round, if there is room for it."""
MOST_WALL_M: Final = 0.1
"""It keeps half of that from walls, at most this."""
NEARER_M: Final = 0.3
DIRECTIONS: Final = 16
AWAY_M: Final = (1.0, 2.0, 3.5)
"""So far it goes out of another's way."""
PAST: Final = 0.3
"""What a metre away from the other one counts, against a metre away from its line."""


def way_round(ground: Ground, here: Point, place: Point, body: Point, right: bool) -> list[Point] | None:
    """Return way points past a *body* on the way from *here* to *place*, on the side that has more room.

    Of two alike it is the *right*, or else the left, unless the other one is much nearer. None if there is too little
    room on both sides between it and the walls. The points lie beside and behind the body; the way from the last to
    *place* is not looked at.
    """
    for slack in SLACKS_M:
        sides = (_past(ground, here, place, body, slack, 1.0), _past(ground, here, place, body, slack, -1.0))
        first, second = sides if right else sides[::-1]
        if first and second:
            return first if length_m([here, *first]) <= length_m([here, *second]) + NEARER_M else second
        if first or second:
            return first or second
    return None


def _past(ground: Ground, here: Point, place: Point, body: Point, slack_m: float, side: float) -> list[Point] | None:
    """Return the way points on one side, 1 for the right, as far from the body as *slack_m* more than a touch."""
    dx, dy = place[0] - here[0], place[1] - here[1]
    distance = math.hypot(dx, dy)
    if distance == 0.0:
        return None
    dx, dy = dx / distance, dy / distance
    side_x, side_y = side * dy, -side * dx
    room = 2.0 * ground.radius_m + slack_m
    wall_m = min(0.5 * slack_m, MOST_WALL_M)
    beside = body[0] + room * side_x, body[1] + room * side_y
    before = beside[0] - room * dx, beside[1] - room * dy
    behind = beside[0] + room * dx, beside[1] + room * dy
    if not ground.fits(beside, behind, wall_m):
        return None
    if (before[0] - here[0]) * dx + (before[1] - here[1]) * dy <= 0.0:
        # already beside it, or too near for a way before it
        clear = off_m(body, here, beside) >= min(2.0 * ground.radius_m, math.dist(here, body)) - 1e-6
        return [beside, behind] if clear and ground.fits(here, beside) else None
    if ground.fits(here, before) and ground.fits(before, beside, wall_m):
        return [before, beside, behind]
    return None


def retreat(ground: Ground, here: Point, other: Point) -> Point | None:
    """Return where to go, in sight, to be out of the way of an *other* robot that comes towards *here* and passes on.

    That is off the line from it through *here*, or, where nothing leads off it, farther along. None if one can only
    stay.
    """
    dx, dy = here[0] - other[0], here[1] - other[1]
    apart = math.hypot(dx, dy)
    dx, dy = (dx / apart, dy / apart) if apart > 0.0 else (1.0, 0.0)
    room = 2.0 * ground.radius_m + SLACKS_M[0]
    best, most = None, PAST * apart + 0.1
    for k in range(DIRECTIONS):
        angle = 2.0 * math.pi * k / DIRECTIONS
        for way in AWAY_M:
            there = here[0] + way * math.cos(angle), here[1] + way * math.sin(angle)
            off_x, off_y = there[0] - other[0], there[1] - other[1]
            along, across = off_x * dx + off_y * dy, abs(off_x * dy - off_y * dx)
            if math.hypot(off_x, off_y) < min(apart + 0.5 * way, room + apart) or not ground.fits(here, there):
                continue
            worth = min(across, room) + PAST * min(along, 4.0 * room) - 0.01 * way
            if worth > most:
                best, most = there, worth
    return best


def in_the_way(here: Point, place: Point, body: Point, room_m: float) -> bool:
    """Return whether a *body* is nearer than *room_m* to the way from *here* to *place*, and not behind."""
    dx, dy = place[0] - here[0], place[1] - here[1]
    if (body[0] - here[0]) * dx + (body[1] - here[1]) * dy <= 0.0:
        return False
    return off_m(body, here, place) < room_m
