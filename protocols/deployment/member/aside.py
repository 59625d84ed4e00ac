"""How a robot that stands in another's way makes room, waits until that has passed, and comes back.

"When it starts approaching, the robots move away (roughly perpendicular to the route of the moving robot), wait until
the robot has passed, then move back into position" (paper 004, section 5).
"""

import math
from collections.abc import Sequence
from typing import Final

from cosim.machine import Address
from cosim.units import Time, from_seconds
from protocols.deployment.driving.mover import Mover
from protocols.deployment.member.others import Others
from protocols.deployment.messages.messages import Aside
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.tasks.plan import Place
from protocols.motion.floor import Floor

CORNERS: Final = 8
"""So much of its way a robot tells who is to step aside."""


class Aloof:
    """One robot's absence from its post, if it is away."""

    def __init__(self, parameters: MemberParameters, mover: Mover) -> None:
        self._parameters = parameters
        self._mover = mover
        self._passing: Address | None = None
        self._post_m: Place = (0.0, 0.0)
        self._since: Time = 0
        self._nearest_m = math.inf
        self._returning = False
        self._ordered = False
        self._taken: Time | None = None
        """Since when somebody stands at its post."""

    @property
    def away(self) -> bool:
        """Whether it is away from its post."""
        return self._passing is not None

    def withdraw(self, passing: Address, post_m: Place, way: Sequence[Place], now: Time, ordered: bool) -> None:
        """Leave *post_m* for *passing*, whose way is *way*; who is *ordered* to will be ordered back as well."""
        self._passing, self._post_m, self._since = passing, post_m, now
        self._nearest_m, self._returning, self._ordered, self._taken = math.inf, False, ordered, None
        self._mover.retreat(way[0], way)

    def forget(self) -> None:
        """Be wherever it is: there is something else to do."""
        self._passing = None

    def step(self, here: Place, others: Others, now: Time) -> None:
        """Come back once who was to pass has passed, or has not for too long."""
        if self._passing is None:
            return
        if self._returning:
            self._return(others, now)
            return
        away_m = math.dist(others.place_m(self._passing), self._post_m)
        self._nearest_m = min(self._nearest_m, away_m)
        passed = not self._ordered and self._nearest_m < self._parameters.near_m and away_m > self._parameters.away_m
        if passed or now - self._since > from_seconds(self._parameters.aside_s):
            self._returning = True
            self._mover.go(self._post_m)

    def _return(self, others: Others, now: Time) -> None:
        """End when it has come back, or when somebody who has nothing to do stays at its post: that is taken."""
        blocker = self._mover.blocked_by
        taken = (
            blocker is not None
            and others.idle(blocker)
            and math.dist(others.place_m(blocker), self._post_m) < self._parameters.taken_m
        )
        if not taken:
            self._taken = None
            if self._mover.state in ("arrived", "idle"):
                self._passing = None
        elif self._taken is None:
            self._taken = now
        elif now - self._taken > from_seconds(self._parameters.taken_s):
            self._mover.halt()
            self._passing = None


class Asking:
    """Whom one robot, that has somewhere to go, asks to step aside: who stands in its way, and has nothing to do."""

    def __init__(self, parameters: MemberParameters, floor: Floor, me: Address, radius_m: float, mover: Mover) -> None:
        self._patience = from_seconds(parameters.ask_s)
        self._near_m = parameters.ask_m
        self._floor = floor
        self._me = me
        self._radius_m = radius_m
        self._mover = mover
        self._asked: dict[Address, Time] = {}
        """When it has asked others."""

    def step(self, here: Place, others: Others, now: Time) -> list[tuple[Address, Aside]]:
        """Return the request that is due, if one is, with whom it is for; the same again after a while."""
        other, goal = self._mover.blocked_by, self._mover.wants_m
        if other is None or goal is None or not others.idle(other):
            return []
        if math.dist(here, others.place_m(other)) > self._near_m:
            return []
        last = self._asked.get(other)
        if last is not None and 0 <= now - last < self._patience:
            return []
        self._asked[other] = now
        way = self._floor.way(self._radius_m, here, goal) or [goal]
        return [(other, Aside(robot=self._me, from_m=here, way_m=tuple(way[:CORNERS])))]
