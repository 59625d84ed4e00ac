"""Robots that are deployed already make room for one that leaps past them, then come back (paper 004, section 5).

This follows the robots' statuses, not the facts: which robots stand aside is forgotten when a host dies, and its
successor finds it out again.
"""

from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeAlias

from cosim.machine import Address
from protocols.deployment.executing.progress import Deploying, Progress
from protocols.deployment.executing.tree import State
from protocols.deployment.planning.augmenting import ExecutiveParameters, in_the_way
from protocols.deployment.tasks.crew import Crew, Ways
from protocols.deployment.tasks.orders import Halt, Retreat, Whereabouts
from protocols.deployment.tasks.plan import Go, Place

_CORNERS: Final = 16
"""Number of corners of the passing robot's way that an order to step aside names."""
_CLEAR: Final = 1.5  # otherwise it would dither
"""Factor of the distance at which a robot steps aside beyond which it comes back."""


class _Step(Enum):
    """State of a deployed robot that is not at its post."""

    ASIDE = "aside"
    DOUBTED = "doubted"
    """It may be aside: a predecessor may have ordered that."""
    COMING_BACK = "back"


class Passing:
    """A robot on its way past others."""

    def __init__(self, robot: Address, radius_m: float, stops_m: Sequence[Place], ways: Ways) -> None:
        self.robot, self.radius_m, self.here_m = robot, radius_m, stops_m[0]
        self._stops_m, self._ways = stops_m, ways

    @cached_property
    def way(self) -> list[Place]:
        """Rest of its way, its later places included."""
        # looked up only if the robot is near one that may have to make room
        legs = [self._ways.way(self.radius_m, a, b) or [b] for a, b in pairwise(self._stops_m)]
        return [self.here_m, *(place for leg in legs for place in leg)]


Request: TypeAlias = tuple[str, Retreat | Go | Halt]
"""A deployment's name, and what one of its robots is to do."""


class MakingRoom:
    """The robots that stand aside, and those that are to."""

    def __init__(self, crew: Crew, ways: Ways, parameters: ExecutiveParameters) -> None:
        self._crew, self._ways, self._parameters = crew, ways, parameters
        self._steps: dict[Address, _Step] = {}

    @property
    def away(self) -> Collection[Address]:
        """Robots that are not at their posts."""
        return self._steps.keys()

    def back(self, robot: Address) -> None:
        """Note that a robot is at its post again, or does something else."""
        self._steps.pop(robot, None)

    def doubt(self, robots: Collection[Address]) -> None:
        """Note that *robots* may stand aside: the host that ordered them has died."""
        self._steps |= dict.fromkeys(robots, _Step.DOUBTED)

    def requests(self, progress: Progress, places: Mapping[Address, Whereabouts]) -> list[Request]:
        """Return which robots are to step aside now, and which to come back."""
        requests = list[Request]()
        standing = set[Address]()
        busy = progress.errands().keys() if self._steps or any(d.leaping for d in progress.deployments.values()) else ()
        posted = _posted(progress) if self._steps or busy else {}
        for name, deploying in progress.deployments.items():
            node = progress.tree.get(name)
            if node is None or not (deploying.leaping or self._steps):
                continue
            moving = [robot for robot in deploying.posts if robot in busy and robot in places]
            if node.state is not State.RUNNING or not deploying.leaping:
                moving = []
            passing = [self._passing(robot, deploying, places[robot]) for robot in moving]
            for robot in deploying.posts:
                if robot in busy or robot in progress.lost or posted.get(robot) != name:
                    continue
                standing.add(robot)
                request: Retreat | Go | Halt | None = self._request(robot, deploying.stands_m[robot], passing)
                # its post is no longer wanted: do not send it back there
                if node.state is State.TERMINATED and isinstance(request, Go):
                    request = Halt(robot=robot)
                    self.back(robot)
                if request is not None:
                    requests.append((name, request))
        for robot in [robot for robot in self._steps if robot not in standing]:
            self.back(robot)
        return requests

    def _passing(self, robot: Address, deploying: Deploying, at: Whereabouts) -> Passing:
        """Return a robot of a deployment that moves, with the places that it has still to pass."""
        stops_m = deploying.ahead_m(robot) or [deploying.post_m(robot)]
        return Passing(robot, self._crew.radius_m(robot), [(at.x_m, at.y_m), *stops_m], self._ways)

    def _request(self, robot: Address, post_m: Place, passing: list[Passing]) -> Retreat | Go | None:
        step = self._steps.get(robot)
        factor = _CLEAR if step is _Step.ASIDE else 1.0
        other = next((other for other in passing if self._hinders(robot, post_m, other, factor)), None)
        if other is not None and step is not _Step.ASIDE:
            self._steps[robot] = _Step.ASIDE
            return Retreat(robot=robot, post_m=post_m, passing=other.robot, way_m=tuple(other.way[:_CORNERS]))
        if other is None and step in {_Step.ASIDE, _Step.DOUBTED}:
            self._steps[robot] = _Step.COMING_BACK
            return Go(robot=robot, place_m=post_m)
        return None

    def _hinders(self, robot: Address, post_m: Place, other: Passing, factor: float) -> bool:
        dx, dy = other.here_m[0] - post_m[0], other.here_m[1] - post_m[1]
        if dx * dx + dy * dy > (factor * self._parameters.near_m) ** 2:
            return False
        radius_m, passing_m = self._crew.radius_m(robot), other.radius_m
        beside_m = (factor - 1.0) * (radius_m + passing_m) + factor * self._parameters.aside_m
        return in_the_way(other.way, passing_m, post_m, radius_m, beside_m)


def _posted(progress: Progress) -> dict[Address, str]:
    """Return the last deployment in which each robot has a post."""
    # later entries replace earlier ones: a robot has left the posts of deployments before
    return {
        robot: name
        for name, deploying in progress.deployments.items()
        if progress.tree.get(name) is not None
        for robot in deploying.posts
        if robot in deploying.stands_m
    }
