"""A host's ways, one after the other: its announced course, its meetings, and its return to the other hosts.

A host keeps to the course that it has announced: it heads for the place where it is to be a little later. A body that
is faster than the plan arrives early and waits; so it is never far from its place, and catches up after a delay.
"""

from typing import Final

from cosim.geometry.planning import Point
from cosim.machine import Address, Command, Event
from cosim.observation import Observation
from cosim.protocol import Belief
from cosim.units import S, Time, from_seconds
from protocols.aggregation.course import Course, plan_of
from protocols.aggregation.events import Departed, Reconvened
from protocols.aggregation.frames import following
from protocols.aggregation.messages import Plan
from protocols.aggregation.neighbours import Neighbours
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.setup import Tours
from protocols.aggregation.strategies import Strategy
from protocols.aggregation.touring import Mover

AHEAD: Final[Time] = 4 * S
"""Time by which a host heads ahead of its place on the course, and the shortest interval between two goals."""


class Itinerary:
    """The ways of one host."""

    def __init__(
        self,
        parameters: Parameters,
        host: Address,
        strategy: Strategy,
        mover: Mover,
        neighbours: Neighbours,
        events: list[Event],
        here_m: Point,
        now: Time,
    ) -> None:
        """Stand still at first."""
        self.course = Course(now, 1.0, (here_m,))
        self.version = 0
        """Version of all plans that the searchers are to know, the other hosts' included; 0 before the first."""
        self.round = 0
        self.syncing = False
        self.astray = False
        self._host = host
        self._strategy = strategy
        self._mover = mover
        self._followed: Course | None = None
        """Course along which the body has been sent."""
        self._next: Time = 0
        self._neighbours = neighbours
        self._events = events
        self._meets = parameters.strategy == "mrp"
        self.integrates = parameters.strategy in ("mi", "mito", "random")
        self._static = parameters.strategy == "srp"
        self._reconvene = from_seconds(parameters.reconvene_s)
        self._sync = from_seconds(parameters.sync_s)

    def believed(self) -> Belief:
        """Return where the host goes now, and where its course ends, for who looks on."""
        way, end = self._mover.ahead_m, self.course.way_m[-1]
        return Belief(way_m=way, goal_m=end if way else None)

    @property
    def plan(self) -> Plan:
        """The present course as it is announced."""
        return plan_of(self.course, self._host, self.version)

    def renew(self) -> None:
        """Count a change of the plans."""
        self.version = following(self.version)

    def depart(self, here_m: Point, tours: Tours, now: Time) -> None:
        """Leave *here_m* at *now* on the way that the strategy chooses while the searchers are on their *tours*."""
        if self.astray:
            self._go(self._strategy.to(self._neighbours.centroid(here_m), here_m, now))
        else:
            self._go(self._strategy.course(here_m, tours, self.round, now))

    def step(self, observation: Observation, now: Time) -> Command | None:
        """Return the next order along the course, if there is a new one."""
        if self.course is not self._followed or (now >= self._next and self._mover.arrived):
            self._followed, self._next = self.course, now + AHEAD
            self._mover.head_for(self.course.place(now + AHEAD))
        return self._mover.step(observation)

    def due(self, now: Time) -> bool:
        """Return whether the period is over and the host waits for its searchers."""
        self.syncing = self._meets and now >= self.course.departed + self._reconvene
        return self.syncing

    def reconvened(self, missing: int, here_m: Point, now: Time) -> bool:
        """Go on if no searcher is *missing* or the wait has been long; return whether it does."""
        if missing and now < self.course.departed + self._reconvene + self._sync:
            return False
        self._events.append(Reconvened(self.round, missing))
        self.round += 1
        self.syncing = False
        self.depart(here_m, (), now)
        return True

    def go_back(self, here_m: Point, now: Time) -> None:
        """Head for the last middle of the other hosts, all of which are out of reach (paper 002, section VI.B).

        A host that has come to its static rally point stays there: section III.A.
        """
        ends_at = self.course.ends_at()
        if self.astray or (self._static and (ends_at is None or now >= ends_at)):
            return
        self.astray = True
        self.depart(here_m, (), now)

    def found_back(self, here_m: Point, tours: Tours, now: Time) -> None:
        """Go on as the strategy chooses, in reach again and within reach from now on."""
        self.astray = False
        self._strategy.return_to_reach()
        self.depart(here_m, tours, now)

    def _go(self, course: Course) -> None:
        self.course = course
        self.renew()
        self._events.append(Departed(self.version, course.length_m, self.astray))
