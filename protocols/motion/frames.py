"""Frames in which one place has two names, and observations whose frame is corrected now and then.

Who takes itself to be where a filter has it finds, with every correction, that it and all that it sees have moved at
once, though nothing has. So a place may be told in such a frame, but no motion: that is worked out from what does not
know of the correction, see :class:`Located`.
"""

import math
from typing import NamedTuple, Self

from cosim.navigation.localization.motion import Pose
from cosim.observation import Observation


class Shift(NamedTuple):
    """From one frame to another: turned counter-clockwise, then moved."""

    x_m: float = 0.0
    y_m: float = 0.0
    turned_rad: float = 0.0

    @classmethod
    def between(cls, before: Pose, after: Pose) -> Self:
        """Return the shift by which a pose in one frame is another one in the other."""
        turned = math.remainder(after[2] - before[2], math.tau)
        cos, sin = math.cos(turned), math.sin(turned)
        return cls(after[0] - cos * before[0] + sin * before[1], after[1] - sin * before[0] - cos * before[1], turned)

    def pose(self, pose: Pose) -> Pose:
        """Return a pose in the other frame."""
        return *self.point(pose[0], pose[1]), math.remainder(pose[2] + self.turned_rad, math.tau)

    def point(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a point in the other frame."""
        cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
        return self.x_m + cos * x_m - sin * y_m, self.y_m + sin * x_m + cos * y_m

    def back(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a point of the other frame in this one."""
        cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
        dx, dy = x_m - self.x_m, y_m - self.y_m
        return cos * dx + sin * dy, cos * dy - sin * dx


class Located(Observation):
    """An observation in a frame that is corrected while the robot drives: places count, but not what they change by."""

    odometry: Pose | None = None
    """The same pose as odometry has it, which knows of no correction, but errs by a little at every tick."""

    @classmethod
    def told(cls, observation: Observation, odometry: Pose) -> Self:
        """Return *observation*, the robot's pose being *odometry* before it was corrected."""
        located = cls._make(observation)
        located.odometry = odometry
        return located


def step(before: Pose, after: Pose) -> Pose:
    """Return how far *after* is ahead of *before*, how far to the left, and how far it is turned."""
    cos, sin = math.cos(before[2]), math.sin(before[2])
    dx, dy = after[0] - before[0], after[1] - before[1]
    return cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(after[2] - before[2], math.tau)


def start(after: Pose, gone: Pose) -> Pose:
    """Return the pose from which a step as of :func:`step` leads to *after*."""
    heading = after[2] - gone[2]
    cos, sin = math.cos(heading), math.sin(heading)
    return after[0] - cos * gone[0] + sin * gone[1], after[1] - sin * gone[0] - cos * gone[1], heading
