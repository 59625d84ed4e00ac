"""Rendezvous of a searcher with a host: where to head for, and when the host is suspected.

The radio serves when the host is in reach; else the camera, if it sees the host; else the place that follows from the
host's last plan (paper 002, sections IV and V). A host from which nothing is received for a time, close to its place,
is suspected; then the searcher heads for the closest of the others (section VI.A).
"""

import math
from collections.abc import Callable
from typing import Final

from cosim.geometry.planning import Point
from cosim.machine import Address, Command
from cosim.observation import Observation
from cosim.units import S, Time, from_seconds
from protocols.aggregation.course import Course, interception
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.roster import Membership
from protocols.aggregation.touring import Motion

REPLAN: Final[Time] = 5 * S
"""Interval after which the meeting with a moving host is predicted again."""


class Approach:
    """The approach to one host."""

    def __init__(self, parameters: Parameters, host: Address, course: Course | None, now: Time) -> None:
        """Head for *host*; without a *course* of it, the host is expected here."""
        self.host = host
        self.course = course
        self._vision_m = parameters.vision_m
        self._close_m = parameters.close_share * parameters.short_m
        self._patience = from_seconds(parameters.suspect_s)
        self._longest = from_seconds(parameters.meet_s)
        self._rounds = parameters.interception_rounds
        self._since = now
        self._close_since: Time | None = None
        self._planned: Time | None = None
        self._goal_m: Point | None = None

    def update(self, course: Course) -> None:
        """Head for the host's place by a new plan."""
        if course != self.course:
            self.course, self._planned = course, None

    def seen_m(self, observation: Observation) -> Point | None:
        """Return the place at which the camera sees the host; None if it does not."""
        for address, x, y in observation.sightings:
            if address == self.host:
                near = math.hypot(x - observation.x_m, y - observation.y_m) <= self._vision_m
                return (x, y) if near else None
        return None

    def goal_m(
        self, observation: Observation, speed_mps: float, way_m: Callable[[Point], float | None], now: Time
    ) -> Point | None:
        """Return the place to go to; None if nothing is known of the host."""
        seen = self.seen_m(observation)
        if seen is not None:
            self._planned = None
            return seen
        if self.course is None:
            return None
        if self._planned is None or now - self._planned >= REPLAN:
            here = observation.x_m, observation.y_m
            self._planned = now
            self._goal_m = interception(self.course, now, here, speed_mps, way_m, self._rounds)
        return self._goal_m

    def failed(self, observation: Observation, now: Time) -> bool:
        """Return whether the host is suspected now; to be asked while there is no contact with it."""
        expected = self.seen_m(observation) or (None if self.course is None else self.course.place(now))
        here = observation.x_m, observation.y_m
        if expected is not None and math.dist(expected, here) > self._close_m:
            self._close_since = None
            return now - self._since >= self._longest
        if self._close_since is None:
            self._close_since = now
        return now - self._close_since >= self._patience

    def heard(self, now: Time) -> None:
        """Restart the time-outs, as the host has been heard."""
        self._since, self._close_since = now, None


class Rendezvous:
    """One searcher's ways into contact with its host or another."""

    def __init__(self, parameters: Parameters, membership: Membership, motion: Motion, speed_mps: float) -> None:
        self._parameters = parameters
        self._membership = membership
        self._motion = motion
        self._speed_mps = speed_mps
        self._approach: Approach | None = None
        self._tried: set[Address] = set()
        """Hosts that were not found at their places since the last that was."""

    @property
    def host(self) -> Address | None:
        """The host that the searcher is heading for; None if it knows none."""
        return None if self._approach is None else self._approach.host

    def to_own_host(self, now: Time) -> None:
        """Head for the own host from now on."""
        host = self._membership.host
        self._approach = None
        if host is not None:
            self._approach = Approach(self._parameters, host, self._membership.courses.get(host), now)

    def to_another(self, now: Time) -> None:
        """Head for the closest host that has not been tried yet; when all have been, wander until one is heard."""
        if self.host is not None:
            self._tried.add(self.host)
        courses = self._membership.courses
        left = [host for host in sorted(courses) if host not in self._tried]
        self._approach = None
        if left:
            closest = min(left, key=lambda host: self._way_to(host, now))
            self._approach = Approach(self._parameters, closest, courses[closest], now)

    def heard(self, now: Time) -> None:
        """Restart the time-outs, as the own host has been heard."""
        self._tried.clear()
        if self._approach is not None:
            self._approach.heard(now)

    def joined(self) -> None:
        """Forget the hosts that were tried, as another host has been found."""
        self._tried.clear()

    def failed(self, observation: Observation, now: Time) -> bool:
        """Return whether the host that the searcher is heading for is suspected now."""
        return self._approach is not None and self._approach.failed(observation, now)

    def step(self, observation: Observation, now: Time) -> Command | None:
        """Return the next order on the way to the host; wander about the floor if nothing is known of one."""
        approach = self._approach
        if approach is None:
            return self._motion.wander(observation)
        course = self._membership.courses.get(approach.host)
        if course is not None:
            approach.update(course)
        goal_m = approach.goal_m(observation, self._speed_mps, self._motion.way_m, now)
        return self._motion.wander(observation) if goal_m is None else self._motion.approach(goal_m, observation)

    def _way_to(self, host: Address, now: Time) -> float:
        """Return the length of the way to a host's present place by its plan, metres; inf if no way leads there."""
        way_m = self._motion.way_m(self._membership.courses[host].place(now))
        return math.inf if way_m is None else way_m
