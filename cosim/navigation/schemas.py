"""Motor schemas: small vector fields whose weighted sum is the motion (Arkin, IJRR 8(4), 1989, pp. 92-112).

Each schema is a pure function of what the robot perceives now and returns a vector in the robot's frame F_i; a vector
of length 1 means full speed. The potential field of Sgorbissa and Arkin (section 6, algorithm 1) is the sum

    gain_goal * move_to_goal + gain_avoid * avoid_obstacles + gain_robot * avoid_robots + gain_noise * noise

which is clipped where it becomes a motion, and not normalised before. It knows local minima: in front of an obstacle
that lies across the way to the goal, and in every dead end that points to the goal, the sum is zero.

An obstacle at the distance d repels with 0 beyond the sphere of influence S, with (S - d) / (S - M) between S and the
safety margin M, and overwhelmingly within M. The sum over the readings of a scan is weighted with pi / n for n beams:
it then approximates an integral over the directions, half of that of |sin|. So the field of a wall does not depend on
the number of beams, and a wall that the robot's flank stands on repels with 1. (MissionLab, where every reading is an
obstacle of its own, has no weight: its gain for n beams is ours divided by n / pi.)
"""

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.randomness import Draws

Vector: TypeAlias = tuple[float, float]

OVERWHELMING: Final = 1e5
"""Value of an infinite repulsion (MissionLab's GT_INFINITY): more than all other schemas together."""
NOWHERE: Final = 1e-9
"""Length below which a sum is rounding and has no direction."""
_COINCIDENT_M: Final = 1e-5
_DEGREES: Final = 360


def beam_directions(count: int) -> Floats:
    """Return the unit vectors (count, 2) of a ring of beams: beam k looks along the angle 2 pi k / count in F_i."""
    angles = (2.0 * np.pi * np.arange(count) / count).tolist()
    return np.array([(elementary.cos(angle), elementary.sin(angle)) for angle in angles]).reshape(-1, 2)


@njit(cache=True)
def repulsion(distance_m: float, sphere_m: float, margin_m: float) -> float:
    """Return how strongly an obstacle repels: 0 beyond the sphere, 1 just outside the margin, overwhelming within.

    Distances are from the robot's centre to the obstacle's surface, so the margin includes the robot's radius.
    Source: Arkin 1989, avoid-static-obstacle, with gain 1.
    """
    if distance_m >= sphere_m:
        return 0.0
    if distance_m <= margin_m:
        return OVERWHELMING
    return (sphere_m - distance_m) / (sphere_m - margin_m)


@njit(cache=True)
def avoid_obstacles(ranges_m: Floats, beams: Floats, sphere_m: float, margin_m: float) -> Vector:
    """Return the repulsion of all that the scan *ranges_m* (n,) has hit along *beams* (n, 2), weighted with pi / n.

    A beam that has hit nothing reads infinity; one that reads NaN counts as such.
    """
    x, y = 0.0, 0.0
    for k in range(ranges_m.shape[0]):
        if ranges_m[k] < sphere_m:
            strength = repulsion(ranges_m[k], sphere_m, margin_m)
            x -= strength * beams[k, 0]
            y -= strength * beams[k, 1]
    weight = math.pi / max(ranges_m.shape[0], 1)
    return weight * x, weight * y


@njit(cache=True)
def move_to_goal(to_goal_x_m: float, to_goal_y_m: float) -> Vector:
    """Return the unit vector towards a goal that lies so far off, or (0, 0) at the goal (MissionLab's MOVE_TO_GOAL)."""
    distance = elementary.hypot(to_goal_x_m, to_goal_y_m)
    if not distance > 0.0:
        return 0.0, 0.0
    return to_goal_x_m / distance, to_goal_y_m / distance


def avoid_robots(x_m: float, y_m: float, robots_m: Sequence[Vector], sphere_m: float, margin_m: float) -> Vector:
    """Return the sum of the repulsions of *robots_m*, the places of the others' centres, on a robot at (x, y).

    Sphere and margin are distances between centres. A robot that seems to stand at the very same place pushes along +y.
    Source: MissionLab's AVOID_ROBOT, with the overwhelming repulsion of obstacles within the margin.
    """
    sum_x, sum_y = 0.0, 0.0
    for robot_x, robot_y in robots_m:
        away_x, away_y = x_m - robot_x, y_m - robot_y
        distance = math.hypot(away_x, away_y)
        if distance >= sphere_m:
            continue
        strength = OVERWHELMING if distance <= margin_m else (sphere_m - distance) / (sphere_m - margin_m)
        if distance < _COINCIDENT_M:
            sum_y += strength
        else:
            sum_x += strength * away_x / distance
            sum_y += strength * away_y / distance
    return sum_x, sum_y


def noise(draws: Draws, step: int, persistence: int, purpose: int = 0) -> Vector:
    """Return a unit vector of random direction for motion step *step*, the same for *persistence* steps in a row.

    The direction is a whole number of degrees in F_i. It depends on *draws*, the step and the *purpose* only, not on
    what was drawn before. Source: MissionLab's NOISE, which holds it in a fixed frame too, not in the robot's.
    """
    angle = math.radians(draws.below(_DEGREES, step // persistence, purpose=purpose))
    return elementary.cos(angle), elementary.sin(angle)


@njit(cache=True)
def potential_field(
    ranges_m: Floats, beams: Floats, field: Floats, to_goal_x_m: float, to_goal_y_m: float, x: float, y: float
) -> Vector:
    """Return goal and obstacles as one weighted sum, added to the vector (x, y) of all other schemas.

    *field* holds the gain of the goal, the gain of obstacles, their sphere and their margin (metres), in this order.
    """
    goal_x, goal_y = move_to_goal(to_goal_x_m, to_goal_y_m)
    wall_x, wall_y = avoid_obstacles(ranges_m, beams, field[2], field[3])
    return x + field[0] * goal_x + field[1] * wall_x, y + field[0] * goal_y + field[1] * wall_y


# ---------------------------------------------------------------- from a sum to a motion


@njit(cache=True)
def direction(x: float, y: float) -> Vector:
    """Return the unit vector along (x, y), for a robot whose steps all have one length; (0, 0) if there is none."""
    length = elementary.hypot(x, y)
    if not NOWHERE < length < math.inf:
        return 0.0, 0.0
    return x / length, y / length


@njit(cache=True)
def clipped(x: float, y: float) -> Vector:
    """Return (x, y), cut to length 1 where it is longer: the velocity as a share of the greatest one."""
    length = elementary.hypot(x, y)
    if not NOWHERE < length < math.inf:
        return 0.0, 0.0
    return (x, y) if length <= 1.0 else (x / length, y / length)


def speed_and_turn(
    share_x: float, share_y: float, heading_rad: float, most_mps: float, most_turn_radps: float, tick_s: float
) -> tuple[float, float]:
    """Return speed (m/s) and rate of turn (rad/s) for one tick, under limits, of a robot that must face its way.

    It turns towards the vector as fast as it may, at most so far that it faces it at the tick's end, and drives at the
    vector's length times *most_mps*, times the cosine of the angle that is still to turn; it stands while it turns by
    more than a right angle. A vector longer than 1 counts as 1.
    """
    length = min(math.hypot(share_x, share_y), 1.0)
    if length <= NOWHERE:
        return 0.0, 0.0
    error = math.remainder(elementary.atan2(share_y, share_x) - heading_rad, math.tau)
    turn = min(max(error / tick_s, -most_turn_radps), most_turn_radps)
    return most_mps * length * max(elementary.cos(error), 0.0), turn
