"""A searcher's way to its host, or, when that has failed, to the closest of the others (paper 002, section VI.A)."""

import math

from cosim.machine import Address, Command
from cosim.observation import Observation
from cosim.units import Time
from protocols.aggregation.meeting import Meeting
from protocols.aggregation.membership import Membership
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.touring import Legs


class Pursuit:
    """How one searcher gets into contact with a host."""

    def __init__(self, parameters: Parameters, membership: Membership, legs: Legs, speed_mps: float) -> None:
        self._parameters = parameters
        self._membership = membership
        self._legs = legs
        self._speed_mps = speed_mps
        self._meeting: Meeting | None = None
        self._tried: set[Address] = set()
        """Hosts that were not where they should be, since the last that was."""

    @property
    def host(self) -> Address | None:
        """Whom the searcher is heading for; None if it knows of none."""
        return None if self._meeting is None else self._meeting.host

    def to_own_host(self, now: Time) -> None:
        """Head for the own host from now on."""
        host = self._membership.host
        self._meeting = None
        if host is not None:
            self._meeting = Meeting(self._parameters, host, self._membership.courses.get(host), now)

    def to_another(self, now: Time) -> None:
        """Head for the closest host that has not been tried yet; when all have been, wander until one is heard."""
        if self.host is not None:
            self._tried.add(self.host)
        courses = self._membership.courses
        left = [host for host in sorted(courses) if host not in self._tried]
        self._meeting = None
        if left:
            closest = min(left, key=lambda host: self._way_to(host, now))
            self._meeting = Meeting(self._parameters, closest, courses[closest], now)

    def heard(self, now: Time) -> None:
        """Begin to wait anew: the own host has been heard."""
        self._tried.clear()
        if self._meeting is not None:
            self._meeting.heard(now)

    def joined(self) -> None:
        """Forget who was tried: another host has been found."""
        self._tried.clear()

    def failed(self, observation: Observation, now: Time) -> bool:
        """Return whether the host that is headed for has failed, as it seems to who hears nothing of it."""
        return self._meeting is not None and self._meeting.failed(observation, now)

    def step(self, observation: Observation, now: Time) -> Command | None:
        """Return the next order on the way to where the host is to be met; about the floor if none is known of."""
        meeting = self._meeting
        if meeting is None:
            return self._legs.wander(observation)
        course = self._membership.courses.get(meeting.host)
        if course is not None:
            meeting.update(course)
        goal_m = meeting.goal_m(observation, self._speed_mps, self._legs.way_m, now)
        return self._legs.wander(observation) if goal_m is None else self._legs.approach(goal_m, observation)

    def _way_to(self, host: Address, now: Time) -> float:
        """Return how far it is to where a host is now by its plan; inf if no way leads there."""
        way_m = self._legs.way_m(self._membership.courses[host].place(now))
        return math.inf if way_m is None else way_m
