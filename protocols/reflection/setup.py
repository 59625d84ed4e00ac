"""What the machines of a run know beforehand: each robot its own task in its own frame, and all some common numbers."""

import math
from typing import NamedTuple, TypeAlias

from cosim.geometry.boundary import Boundary
from cosim.units import Time

Point: TypeAlias = tuple[float, float]
Pose: TypeAlias = tuple[float, float, float]
"""Where a frame's origin lies in the world, metres, and by how much its x axis is turned, radians."""


class Task(NamedTuple):
    """What one robot is to do; places in its own frame, metres."""

    goals_m: tuple[Point, ...]
    """To be reached in this order."""
    patrol_m: tuple[Point, ...]
    """Way points of a helper; a single one is a post."""
    objects_m: tuple[tuple[Point, ...], ...]
    """Where everybody's goals are, if they are objects: only to answer whether the robot sees one, and where."""
    loops: Boundary | None = None
    """What VisBug walks along, in the robot's own frame and grown by its radius; of it, it uses only what it sees."""


class Setup(NamedTuple):
    """What is known of a run before it begins."""

    size: int
    """Robots in the team, the paper's M."""
    tick: Time
    steps_m: tuple[float, ...]
    """Length of each robot's motion step."""
    radius_m: float
    """Radius of the largest body."""
    tasks: tuple[Task, ...]
    targets_m: tuple[tuple[Point, ...], ...]
    """The truth for the referee: the targets of each explorer, in the world's frame."""


def into_frame(place_m: Point, frame: Pose) -> Point:
    """Return a place of the world, as who has *frame* names it."""
    x, y, heading = frame
    dx, dy = place_m[0] - x, place_m[1] - y
    cos, sin = math.cos(heading), math.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx
