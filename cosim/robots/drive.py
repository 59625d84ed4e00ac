"""How a body chooses its motion for one tick: speeds under limits, and an approach that ends exactly on its goal.

Within a tick the velocity is constant, so everything counts in ways per tick: a way u, at most the speed limit's way,
that changes from tick to tick by at most h = a T^2. From u a body can stop after u, then u - h, u - 2h and so on down
to 0. The greatest u from which it stops within a distance D follows in closed form: m ways are together
m u - h m (m - 1) / 2, hence u = D / m + h (m - 1) / 2 for the least m with D <= h m (m + 1) / 2. A body that takes this
u tick after tick brakes by exactly h a tick at the end, and its last way ends on the goal. Angles are treated alike.
"""

import math
from typing import Final

from cosim.jit import njit

LAND_M: Final = 1e-9
"""A body that would end a tick as near to its goal as this ends it there."""
ALIGNED_RAD: Final = 1e-9
"""A heading as near to the goal's bearing as this needs no turn."""
_ROUNDING: Final = 1e-9
"""By which share of h a change of the way may exceed it, so that rounding costs no tick."""


@njit(cache=True)
def braking_way(distance: float, change: float) -> float:
    """Return the greatest way of the next tick from which one can stop within *distance*, losing *change* a tick."""
    ticks = max(1.0, math.ceil((math.sqrt(1.0 + 8.0 * distance / change) - 1.0) / 2.0))
    return distance / ticks + change * (ticks - 1.0) / 2.0


@njit(cache=True)
def approach(distance: float, last: float, most: float, change: float) -> float:
    """Return the next way towards a goal *distance* ahead; *last* was the way before, negative if it led back."""
    return max(min(braking_way(distance, change), most, last + change), last - change)


@njit(cache=True)
def towards(wanted: float, last: float, change: float) -> float:
    """Return the way nearest to *wanted* that differs from *last* by no more than *change*."""
    slack = change * (1.0 + _ROUNDING)
    if abs(wanted - last) <= slack:
        return wanted
    return last + change if wanted > last else last - change


@njit(cache=True)
def wrapped(angle: float) -> float:
    """Return *angle* (radians) in [-pi, pi]; an angle that lies there already is not changed."""
    if -math.pi <= angle <= math.pi:
        return angle
    return math.atan2(math.sin(angle), math.cos(angle))


@njit(cache=True)
def chord(heading: float, way: float, turn: float) -> tuple[float, float]:
    """Return the straight way (x, y) that joins the ends of an arc of length *way* that begins along *heading*."""
    half = 0.5 * turn
    length = way if half == 0.0 else way * math.sin(half) / half
    return length * math.cos(heading + half), length * math.sin(heading + half)
