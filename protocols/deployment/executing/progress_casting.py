"""Who does what in a play that is under way: who is lost, who stands where, who has taken over from whom."""

import math
from collections.abc import Iterable

from cosim.machine import Address
from protocols.deployment.executing.recovery import Length, substitute
from protocols.deployment.tasks.crew import Crew
from protocols.deployment.tasks.facts import Record
from protocols.deployment.tasks.plan import Go, Place, Task


class Casting:
    """The robots of a crew, as far as a plan has to do with them."""

    def __init__(self, record: Record, crew: Crew, length: Length, draft: bool) -> None:
        self._crew, self._length = crew, length
        self._reserve = set(crew.robots) - set(record.plan.robots) if draft else set[Address]()
        """Robots that may take over: those that the plan makes no use of, and that have not taken over yet."""
        self._roles: dict[Address, Address] = {}
        """Who has taken over from a lost robot, outside deployments."""
        self.lost: set[Address] = set()
        self._bodies_m: dict[Address, Place] = {}
        """Where the lost ones were last, if that is known."""
        self.stands_m: dict[Address, Place] = dict.fromkeys(crew.robots, crew.base_m) | record.starts_m
        """Where a robot has been ordered to, and arrived at, last."""

    def role(self, robot: Address) -> Address:
        """Return who plays the part of *robot* now."""
        while robot in self._roles:
            robot = self._roles[robot]
        return robot

    def lose(self, robot: Address, place_m: Place | None) -> None:
        """Note that a robot is lost; its body may stand in the way of who is to take its place."""
        self.lost.add(robot)
        if place_m is not None:
            self._bodies_m[robot] = place_m

    def find(self, robot: Address) -> None:
        """Note that a robot is lost no more."""
        self.lost.discard(robot)
        self._bodies_m.pop(robot, None)

    def covered(self, robot: Address, place_m: Place) -> bool:
        """Return whether a lost robot's body stands where *robot* would stand at a place."""
        radius_m = self._crew.radius_m(robot)
        return any(
            math.dist(place_m, body_m) < radius_m + self._crew.radius_m(other)
            for other, body_m in self._bodies_m.items()
        )

    def draft(self, place_m: Place) -> Address | None:
        """Return the spare robot that has the shortest way to a place, and take it; None: there is none."""
        return self._take([Task(name="draft", act=Go(robot=0, place_m=place_m))])

    def recast(self, robot: Address, leaves: Iterable[Task]) -> bool:
        """Give the part of *robot*, whose leaves are left, to a spare one; return whether there was one."""
        spare = self._take(leaves)
        if spare is not None:
            self._roles[robot] = spare
        return spare is not None

    def _take(self, leaves: Iterable[Task]) -> Address | None:
        spare = substitute(leaves, self._reserve - self.lost, self.stands_m, self._crew, self._length)
        self._reserve.discard(-1 if spare is None else spare)
        return spare
