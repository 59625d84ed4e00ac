"""A robot that is taken up and put elsewhere, and what goes along with it."""

import math
from typing import NamedTuple, TypeAlias

Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""


class Carry(NamedTuple):
    """The rigid motion of the plane that brings a body from one pose to another."""

    before: Pose
    after: Pose

    def pose(self, x_m: float, y_m: float, heading_rad: float) -> Pose:
        """Return where a pose gets that is carried along."""
        turn = self.after[2] - self.before[2]
        cos, sin = math.cos(turn), math.sin(turn)
        dx, dy = x_m - self.before[0], y_m - self.before[1]
        return self.after[0] + cos * dx - sin * dy, self.after[1] + sin * dx + cos * dy, heading_rad + turn
