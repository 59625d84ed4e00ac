"""Shifts between frames, and observations in a frame that is corrected now and then.

With every correction of its pose estimate a robot seems to move at once, with all that it sees, though nothing has
moved. So such a frame is good for places, but not for motion, which is derived from odometry (:class:`Located`).
"""

import math
from typing import NamedTuple, Self

import cosim.elementary as elementary
from cosim.navigation.localization.motion import Pose
from cosim.observation import Observation


class Shift(NamedTuple):
    """A shift from one frame to another: a turn counter-clockwise, then a translation."""

    x_m: float = 0.0
    y_m: float = 0.0
    turned_rad: float = 0.0

    @classmethod
    def between(cls, before: Pose, after: Pose) -> Self:
        """Return the shift that takes the pose *before* in one frame to the pose *after* in the other."""
        turned = math.remainder(after[2] - before[2], math.tau)
        cos, sin = elementary.cos(turned), elementary.sin(turned)
        return cls(after[0] - cos * before[0] + sin * before[1], after[1] - sin * before[0] - cos * before[1], turned)

    def pose(self, pose: Pose) -> Pose:
        """Return *pose* in the other frame."""
        return *self.point(pose[0], pose[1]), math.remainder(pose[2] + self.turned_rad, math.tau)

    def point(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a point in the other frame."""
        cos, sin = elementary.cos(self.turned_rad), elementary.sin(self.turned_rad)
        return self.x_m + cos * x_m - sin * y_m, self.y_m + sin * x_m + cos * y_m

    def back(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a point of the other frame in this one."""
        cos, sin = elementary.cos(self.turned_rad), elementary.sin(self.turned_rad)
        dx, dy = x_m - self.x_m, y_m - self.y_m
        return cos * dx + sin * dy, cos * dy - sin * dx


class Located(Observation):
    """An observation in a frame that is corrected while the robot drives: its places count, their changes do not."""

    odometry: Pose | None = None
    """The same pose by odometry, which has no corrections, but errs a little at every tick."""

    @classmethod
    def of(cls, observation: Observation, odometry: Pose) -> Self:
        """Return *observation* with *odometry*, the robot's pose before it was corrected."""
        located = cls._make(observation)
        located.odometry = odometry
        return located


def step(before: Pose, after: Pose) -> Pose:
    """Return how far *after* is ahead of *before*, how far to its left, and how far turned."""
    cos, sin = elementary.cos(before[2]), elementary.sin(before[2])
    dx, dy = after[0] - before[0], after[1] - before[1]
    return cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(after[2] - before[2], math.tau)


def start(after: Pose, gone: Pose) -> Pose:
    """Return the pose from which a step as of :func:`step` leads to *after*."""
    heading = after[2] - gone[2]
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    return after[0] - cos * gone[0] + sin * gone[1], after[1] - sin * gone[0] - cos * gone[1], heading
