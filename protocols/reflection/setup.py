"""What the machines of a run know beforehand: each its own task in its own frame, and some common numbers.

The explorers' targets are given, or drawn in the middle of rooms (paper 000, section 6).
"""

from typing import NamedTuple, TypeAlias

import cosim.elementary as elementary
from cosim.errors import UserError
from cosim.geometry.boundary import Boundary
from cosim.randomness import Draws
from cosim.units import Time
from protocols.reflection.parameters import Parameters
from protocols.transport.links import MOST_ROBOTS

Point: TypeAlias = tuple[float, float]
Pose: TypeAlias = tuple[float, float, float]
"""Place of a frame's origin in the world, metres, and the angle by which its x axis is turned, radians."""

ROOM, ALONG, ACROSS = range(3)
"""Purposes of draws."""


class Task(NamedTuple):
    """The task of one robot; places in its own frame, metres."""

    goals_m: tuple[Point, ...]
    """Goals, to be reached in this order."""
    patrol_m: tuple[Point, ...]
    """Way points of a helper; a single one is a post."""
    objects_m: tuple[tuple[Point, ...], ...]
    """Goals of all robots, if they are objects: only to answer whether the robot sees one, and where."""
    loops: Boundary | None = None
    """Walls for VisBug, in the robot's own frame and grown by its radius; it only uses those that it sees."""


class Setup(NamedTuple):
    """What is known of a run before it begins."""

    size: int
    """Number of robots in the team, the paper's M."""
    tick: Time
    steps_m: tuple[float, ...]
    """Length of each robot's motion step."""
    radius_m: float
    """Radius of the largest body."""
    tasks: tuple[Task, ...]
    targets_m: tuple[tuple[Point, ...], ...]
    """The truth for the referee: the targets of each explorer, in the world's frame."""
    piconet: int = MOST_ROBOTS
    """The most robots of a piconet."""


def into_frame(place_m: Point, frame: Pose) -> Point:
    """Return a place of the world in *frame*."""
    x, y, heading = frame
    dx, dy = place_m[0] - x, place_m[1] - y
    cos, sin = elementary.cos(heading), elementary.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx


def targets(parameters: Parameters, seed: int) -> tuple[tuple[Point, ...], ...]:
    """Return the targets of each explorer, in the world's frame, metres; raise UserError where there are none.

    *seed* is that of the run, which chooses the set if the parameters do not.
    """
    if parameters.targets is not None:
        if len(parameters.targets) != parameters.explorers:
            raise UserError(
                f"protocol.parameters.targets: {len(parameters.targets)} lists, expected one for each of the "
                f"{parameters.explorers} explorers"
            )
        return parameters.targets
    if parameters.explorers and len(parameters.rooms) < 2:
        raise UserError("protocol.parameters.rooms: expected at least two rooms, or targets")
    return tuple(
        drawn(parameters, seed if parameters.target_set is None else parameters.target_set, explorer)
        for explorer in range(parameters.explorers)
    )


def drawn(parameters: Parameters, target_set: int, explorer: int) -> tuple[Point, ...]:
    """Return random targets: rooms are equally likely, but no target lies in the room of the one before.

    A set only depends on its number and the explorer's: every team, algorithm and channel has the same targets.
    """
    draws = Draws(target_set, "reflection", "targets", explorer)
    rooms = parameters.rooms
    spread = parameters.target_spread_m
    found: list[Point] = []
    room = -1
    for number in range(parameters.target_count):
        if room < 0:
            room = draws.below(len(rooms), number, ROOM)
        else:
            room = (room + 1 + draws.below(len(rooms) - 1, number, ROOM)) % len(rooms)
        x, y = rooms[room]
        dx, dy = (spread * (2.0 * draws.uniform(number, purpose) - 1.0) for purpose in (ALONG, ACROSS))
        found.append((x + dx, y + dy))
    return tuple(found)
