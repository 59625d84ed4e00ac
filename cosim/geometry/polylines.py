"""Lines from point to point, and rows of points, in plain floats: for the few points of a way, not for clouds of them.

Points are pairs (x, y) in metres. Sums are exact but for the last rounding, so that their order has no meaning.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

from cosim.geometry.planning import Point


def middle(points_m: Sequence[Point]) -> Point:
    """Return the mean of at least one point; raise ZeroDivisionError if there is none."""
    return math.fsum(x for x, _ in points_m) / len(points_m), math.fsum(y for _, y in points_m) / len(points_m)


def length_m(points_m: Sequence[Point]) -> float:
    """Return the length in metres of the line through *points_m*; 0 for a single point, or for none."""
    return math.fsum(math.dist(a, b) for a, b in pairwise(points_m))


def cut(points_m: Sequence[Point], most_m: float) -> tuple[Point, ...]:
    """Return the first *most_m* metres of the line through *points_m*: at least its first point, at most all of it.

    The last point is the place *most_m* metres along the line, or its end. Raise IndexError if there is no point.
    """
    kept = [points_m[0]]
    left_m = most_m
    for a, b in pairwise(points_m):
        if left_m <= 0.0:
            break
        leg_m = math.dist(a, b)
        if leg_m >= left_m:
            share = left_m / leg_m
            kept.append((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
            break
        kept.append(b)
        left_m -= leg_m
    return tuple(kept)


def off_m(point_m: Point, a_m: Point, b_m: Point) -> float:
    """Return how far a point is from the segment from a to b, in metres; a and b may be the same."""
    dx, dy, px, py = b_m[0] - a_m[0], b_m[1] - a_m[1], point_m[0] - a_m[0], point_m[1] - a_m[1]
    square = dx * dx + dy * dy
    share = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return math.hypot(px - share * dx, py - share * dy)
