"""The odometry motion model: how particles move when a robot's odometry has.

Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, section 5.4, as Nav2's differential motion model has it. The way
between two poses is a turn by rot1, a straight way trans and a turn by rot2. Each particle goes

    rot1 - N(0, a1 r1^2 + a2 trans^2),  trans - N(0, a3 trans^2 + a4 r1^2 + a4 r2^2),  rot2 - N(0, a1 r2^2 + a2 trans^2)

where the second argument is a variance and r is the least of |rot| and |pi - rot|, so that to drive backwards is no
turn. A way shorter than 1 cm has no direction: rot1 is 0, all of the turn is rot2. (So a filter must not be updated in
every tick of a slow robot; that is what the least distance of an update is for.)

All random numbers of a particle filter are pure functions of a key, a step, a particle and a purpose, by Philox
(:mod:`cosim.randomness`): they do not depend on what was drawn before, nor on how many.
"""

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.randomness import philox_words

Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""
Quad: TypeAlias = tuple[float, float, float, float]

SCATTER, MOVE, PICK, CHANCE, PLACE, DRIFT = range(1, 7)
"""Purposes of draws: a start, a motion, resampling, whether a pose is injected and where, and the motion of a tick."""

_NO_WAY_M: Final = 0.01
_TURN: Final = 2.0 * math.pi
_WORD: Final = 2.0**-32


# ---------------------------------------------------------------- random numbers


@njit(cache=True)
def four_normals(step: int, particle: int, purpose: int, key_0: int, key_1: int) -> Quad:
    """Return four independent standard normal numbers (Box and Muller, of 32-bit words: none beyond 6.8)."""
    a, b, c, d = philox_words(step, step >> 32, particle, purpose, key_0, key_1)
    first = math.sqrt(-2.0 * elementary.log((a + 0.5) * _WORD))
    second = math.sqrt(-2.0 * elementary.log((c + 0.5) * _WORD))
    along, across = _TURN * _WORD * b, _TURN * _WORD * d
    return (
        first * elementary.cos(along),
        first * elementary.sin(along),
        second * elementary.cos(across),
        second * elementary.sin(across),
    )


@njit(cache=True)
def fill_uniform(numbers: Floats, step: int, purpose: int, key_0: int, key_1: int) -> None:
    """Set *numbers* (n,) to uniform ones in [0, 1) with 53 random bits each."""
    for i in range(numbers.shape[0]):
        a, b, _, _ = philox_words(step, step >> 32, i, purpose, key_0, key_1)
        numbers[i] = ((a << 21) | (b >> 11)) * 2.0**-53


# ---------------------------------------------------------------- motion


class Motion(NamedTuple):
    """A way between two poses: a turn, a straight way, another turn."""

    first_rad: float
    way_m: float
    second_rad: float


def odometry_motion(before: Pose, after: Pose) -> Motion:
    """Return the motion between two poses of odometry; its turns are from -pi to pi."""
    dx, dy = after[0] - before[0], after[1] - before[1]
    way = math.hypot(dx, dy)
    first = math.remainder(elementary.atan2(dy, dx) - before[2], _TURN) if way >= _NO_WAY_M else 0.0
    return Motion(first, way, math.remainder(after[2] - before[2] - first, _TURN))


@njit(cache=True)
def wrapped(angle: float) -> float:
    """Return an angle (rad) as one from -pi to below pi."""
    turned: float = (angle + math.pi) % _TURN - math.pi
    return turned if turned < math.pi else -math.pi


@njit(cache=True)
def move_particles(
    poses: Floats, first: float, way: float, second: float, alphas: Floats, step: int, key_0: int, key_1: int
) -> None:
    """Move *poses* (n, 3) in place by a :class:`Motion`, each with its own errors; *alphas* (4,) are a1 to a4.

    The errors of particle i depend on the key, the *step* and i only.
    """
    turn_1 = min(abs(wrapped(first)), abs(wrapped(math.pi - first)))
    turn_2 = min(abs(wrapped(second)), abs(wrapped(math.pi - second)))
    of_first = math.sqrt(alphas[0] * turn_1**2 + alphas[1] * way**2)
    of_way = math.sqrt(alphas[2] * way**2 + alphas[3] * (turn_1**2 + turn_2**2))
    of_second = math.sqrt(alphas[0] * turn_2**2 + alphas[1] * way**2)
    for i in range(poses.shape[0]):
        a, b, c, _ = four_normals(step, i, MOVE, key_0, key_1)
        heading = poses[i, 2] + first - of_first * a
        gone = way - of_way * b
        poses[i, 0] += gone * elementary.cos(heading)
        poses[i, 1] += gone * elementary.sin(heading)
        poses[i, 2] = wrapped(heading + second - of_second * c)


@njit(cache=True)
def scatter_particles(
    poses: Floats, x: float, y: float, heading: float, spread: Floats, step: int, key_0: int, key_1: int
) -> None:
    """Set *poses* (n, 3) to normal ones about a pose; *spread* (2,) are standard deviations in metres and radians."""
    for i in range(poses.shape[0]):
        a, b, c, _ = four_normals(step, i, SCATTER, key_0, key_1)
        poses[i, 0] = x + spread[0] * a
        poses[i, 1] = y + spread[0] * b
        poses[i, 2] = wrapped(heading + spread[1] * c)


# ---------------------------------------------------------------- means


@njit(cache=True)
def mean_pose(poses: Floats, weights: Floats) -> tuple[float, float, float, float, float]:
    """Return the mean of *poses* (n, 3) by *weights* (n,), whose sum is 1, and how far they spread.

    x and y in metres, cosine and sine of the headings, whose length is less than 1 where headings differ, and the
    standard deviation of places in metres.
    """
    x = y = cos = sin = square = 0.0
    for i in range(weights.shape[0]):
        x += weights[i] * poses[i, 0]
        y += weights[i] * poses[i, 1]
        cos += weights[i] * elementary.cos(poses[i, 2])
        sin += weights[i] * elementary.sin(poses[i, 2])
    for i in range(weights.shape[0]):
        dx, dy = poses[i, 0] - x, poses[i, 1] - y
        square += weights[i] * (dx * dx + dy * dy)
    return x, y, cos, sin, math.sqrt(square)


def place_covariance(poses: Floats, weights: Floats) -> tuple[float, float, float]:
    """Return the covariance of the places of *poses* (n, 3) by *weights* (n,), whose sum is 1: xx, xy and yy, m^2."""
    x, y = poses[:, 0], poses[:, 1]
    dx, dy = x - float((weights * x).sum()), y - float((weights * y).sum())
    return float((weights * dx * dx).sum()), float((weights * dx * dy).sum()), float((weights * dy * dy).sum())


def turned_back(beams: Floats, angle_rad: float) -> Floats:
    """Return unit vectors *beams* (n, 2) turned clockwise: those of a body's heading, in the body's frame."""
    cos, sin = elementary.cos(angle_rad), elementary.sin(angle_rad)
    along, across = beams[:, 0], beams[:, 1]
    return np.stack((along * cos + across * sin, across * cos - along * sin), axis=1)
