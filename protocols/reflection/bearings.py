"""From one robot's frame into another's, by the directions in which the two see each other (paper 000, Fig. 4).

Let F_i and F_j be the frames of two robots that see each other, a_ij the direction in which i sees j (in F_i) and a_ji
that in which j sees i (in F_j). Both lie on one line and look opposite ways, so F_j is turned against F_i by

    theta_ji = 180 + a_ij - a_ji        (degrees; the paper writes it for 2 and 1, and swaps the indices of alpha)

and what j tells relative to itself, turned by theta_ji and put where i sees j, is in F_i. No robot's pose is needed.
"""

import math
from typing import Final, TypeAlias

Point: TypeAlias = tuple[float, float]

FULL_TURN: Final = 2.0 * math.pi


def turn_between(alpha_ij_rad: float, alpha_ji_rad: float) -> float:
    """Return theta_ji, by which F_j is turned against F_i, in radians in [0, 2 pi) (paper 000, section 3.1)."""
    return (math.pi + alpha_ij_rad - alpha_ji_rad) % FULL_TURN


def from_peer(offset_m: Point, peer_m: Point, turn_rad: float) -> Point:
    """Return a place in F_i that j tells as an offset from itself along the axes of F_j.

    *peer_m* is where i sees j, *turn_rad* is theta_ji.
    """
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    x, y = offset_m
    return peer_m[0] + cos * x - sin * y, peer_m[1] + sin * x + cos * y
