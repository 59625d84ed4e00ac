"""Yielding: a robot that stands in another's way makes room, waits until that has passed, and comes back.

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
from protocols.deployment.messages.messages import YieldRequest
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.tasks.plan import Place
from protocols.motion.floor import Floor

CORNERS: Final = 8
"""Number of corners of its way that a yield request names."""


class Yielding:
    """The absence of one robot from its post while another passes."""

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
        """Time since which an idle robot stands at its post."""

    @property
    def away(self) -> bool:
        """True if the robot is away from its post."""
        return self._passing is not None

    def make_way(self, passing: Address, post_m: Place, way: Sequence[Place], now: Time, ordered: bool) -> None:
        """Leave *post_m* for robot *passing*, whose way is *way*; *ordered*: by the executive, not by that robot."""
        self._passing, self._post_m, self._since = passing, post_m, now
        self._nearest_m, self._returning, self._ordered, self._taken = math.inf, False, ordered, None
        self._mover.retreat(way[0], way)

    def forget(self) -> None:
        """Stay wherever the robot is: it has something else to do."""
        self._passing = None

    def step(self, here: Place, others: Others, now: Time) -> None:
        """Come back once the other robot has passed, or has not passed for too long."""
        if self._passing is None:
            return
        if self._returning:
            self._return(others, now)
            return
        away_m = math.dist(others.place_m(self._passing), self._post_m)
        self._nearest_m = min(self._nearest_m, away_m)
        # a robot that was ordered away is ordered back as well
        passed = not self._ordered and self._nearest_m < self._parameters.near_m and away_m > self._parameters.away_m
        if passed or now - self._since > from_seconds(self._parameters.aside_s):
            self._returning = True
            self._mover.go(self._post_m)

    def _return(self, others: Others, now: Time) -> None:
        """End when the robot has come back, or when an idle robot stays at its post."""
        blocker = self._mover.blocked_by
        # two robots that want the same post would push each other for ever: the one that stands there keeps it
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


class YieldRequests:
    """The yield requests of one robot that drives, to idle robots that stand in its way."""

    def __init__(self, parameters: MemberParameters, floor: Floor, me: Address, radius_m: float, mover: Mover) -> None:
        self._patience = from_seconds(parameters.ask_s)
        self._near_m = parameters.ask_m
        self._floor = floor
        self._me = me
        self._radius_m = radius_m
        self._mover = mover
        self._asked: dict[Address, Time] = {}
        """Time at which it has asked each other robot last."""

    def step(self, here: Place, others: Others, now: Time) -> list[tuple[Address, YieldRequest]]:
        """Return the request that is due, if there is one, with its recipient; repeat requests after a while."""
        other, goal = self._mover.blocked_by, self._mover.wants_m
        if other is None or goal is None or not others.idle(other):
            return []
        if math.dist(here, others.place_m(other)) > self._near_m:
            return []
        # the first request may be lost, or may have come while the other had something to do
        last = self._asked.get(other)
        if last is not None and 0 <= now - last < self._patience:
            return []
        self._asked[other] = now
        way = self._floor.way(self._radius_m, here, goal) or [goal]
        return [(other, YieldRequest(robot=self._me, from_m=here, way_m=tuple(way[:CORNERS])))]
