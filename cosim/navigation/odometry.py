"""The errors of a tick's odometry: those that robots' senses make, and those that particles are moved with.

The way w that a tick's odometry tells is wrong by a share, its heading by an angle:

    share = g slip u,    angle = g turn v sqrt(w),    u, v uniform in [-1, 1) and new every tick,

where g is 1, or w / at if the errors grow with the speed. What adds up over a metre has the variance slip^2 w / 3 and
turn^2 / 3, times g^2: it grows with the way, however often a filter is updated, and to turn on the spot errs nothing.
The odometry motion model (:mod:`cosim.navigation.localization.motion`) is of another kind: its variances grow with the
square of the way from one update to the next, and so with the way between updates.
"""

import math
from typing import Final

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.jit import njit
from cosim.navigation.localization.motion import DRIFT, Pose, wrapped
from cosim.randomness import philox_words

_WORD: Final = 2.0**-31


@njit(cache=True)
def tick_errors(way: float, slip: float, turn: float, at: float, u: float, v: float) -> tuple[float, float]:
    """Return the share of *way* (m) and the angle (rad) by which a tick's odometry is wrong.

    *slip* and *turn* (rad) are the greatest errors, the latter that of a way of one metre; *at* (m) is the way at which
    they are, 0 if at any; *u* and *v* are uniform in [-1, 1).
    """
    more = way / at if at > 0.0 else 1.0
    # with the root, what adds up over a metre has the same spread whatever the ticks
    return more * slip * u, more * turn * v * math.sqrt(way)


@njit(cache=True)
def drift_particles(
    poses: Floats, before: Pose, after: Pose, errors: Floats, step: int, key_0: int, key_1: int
) -> None:
    """Move *poses* (n, 3) in place as odometry has moved in a tick, each with its own errors.

    *errors* (3,) are slip, turn and at. Each pose goes the way that is told less its error: to first order the way that
    the senses, with that error, would have told so. The errors of particle i depend on the key, the *step* and i only.
    """
    dx, dy = after[0] - before[0], after[1] - before[1]
    way = math.sqrt(dx * dx + dy * dy)
    for i in range(poses.shape[0]):
        a, b, _, _ = philox_words(step, step >> 32, i, DRIFT, key_0, key_1)
        share, error = tick_errors(way, errors[0], errors[1], errors[2], a * _WORD - 1.0, b * _WORD - 1.0)
        angle = before[2] - poses[i, 2] + error
        cos, sin = (1.0 - share) * elementary.cos(angle), (1.0 - share) * elementary.sin(angle)
        poses[i, 0] += cos * dx + sin * dy
        poses[i, 1] += cos * dy - sin * dx
        poses[i, 2] = wrapped(after[2] - angle)
