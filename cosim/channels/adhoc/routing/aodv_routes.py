"""The routing table of AODV (RFC 3561, sections 6.1, 6.2 and 6.11), and what keeps it free of loops.

Where the RFC can be read in more than one way, what is done here never lets the sequence number of an entry decrease,
and increments it whenever the route ends, by a break, an error or its age: other readings have loops (van Glabbeek,
Höfner, Tan, Portmann, "Sequence numbers do not guarantee loop freedom: AODV can yield routing loops", MSWiM 2013).
A route to a neighbour that was merely heard keeps the number, but answers no request and ends without an increment:
so no robot's number of another is ever more than one ahead of that robot's own, whose next request is new to all.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from cosim.channels.adhoc.routing.watch import RouteWatch
from cosim.machine import Address
from cosim.units import Time

MASK: Final = 0xFFFFFFFF
_HALF: Final = 1 << 31
ENOUGH: Final = 64
"""Number of routes below which those that are over need not be forgotten."""


def newer(one: int, other: int) -> bool:
    """Return whether the sequence number *one* is newer than *other*: signed arithmetic of 32 bits (section 6.1)."""
    return 0 < (one - other & MASK) < _HALF


@dataclass(slots=True)
class Route:
    """An entry of the table (section 6.2)."""

    next_hop: Address
    hops: int
    """Hops to the destination; of a route that has ended, the last known."""
    sequence: int | None
    """Newest sequence number of the destination that is known here; None: none is."""
    known: bool
    """True if the route is as new as that; it is not if its destination was merely heard."""
    until: Time
    """Instant at which an active route ends, or an ended one is forgotten."""
    active: bool = True
    precursors: set[Address] = field(default_factory=set)
    """Neighbours that get an error when the route breaks."""


class RouteTable:
    """The routes that one robot knows; every query is about the instant of the last ``age``.

    Nothing is searched for routes whose time has come: each is brought to that instant when it is asked for.
    """

    def __init__(self, owner: Address, delete_period: Time) -> None:
        """An ended route is remembered for *delete_period* ns; there is never a route to the *owner*."""
        self._owner = owner
        self._delete_period = delete_period
        self._routes: dict[Address, Route] = {}
        self._now: Time = 0
        self._short: set[Address] = set()
        """Destinations whose routes were over when they were taken; they last until the next ``age``."""
        self._enough = ENOUGH
        """Number of entries at which those that are over are looked for and forgotten."""
        self.watch: RouteWatch | None = None
        """Who is told of active routes."""

    def age(self, now: Time) -> None:
        """End routes whose time has come, and forget those that ended long ago."""
        self._now = now
        if self._short:
            self._short.clear()

    def get(self, destination: Address) -> Route | None:
        """Return the entry of *destination*, active or not."""
        route = self._routes.get(destination)
        if route is None or route.until > self._now or destination in self._short:
            return route
        if route.active:
            self._end(destination, route, route.until)
            if route.until > self._now:
                return route
        del self._routes[destination]
        return None

    def active(self, destination: Address) -> Route | None:
        """Return the route that payloads to *destination* take."""
        route = self._routes.get(destination)
        if route is not None and route.until <= self._now:
            route = self.get(destination)
        return route if route is not None and route.active else None

    def through(self, next_hop: Address) -> list[Address]:
        """Return the destinations of the active routes over *next_hop*."""
        over = [each for each, route in self._routes.items() if route.next_hop == next_hop]
        return [each for each in over if self.active(each)]

    def destinations(self) -> list[Address]:
        """Return the destinations of all active routes."""
        return [each for each in list(self._routes) if self.active(each)]

    def offer(self, destination: Address, next_hop: Address, hops: int, sequence: int, until: Time) -> bool:
        """Take a route to *destination* if it is newer, or as new and shorter or in place of none (6.2, 6.7)."""
        if destination == self._owner:
            return False
        route = self.get(destination)
        if route is None:
            self._add(destination, Route(next_hop, hops, sequence, True, until))
        elif (
            route.sequence is None
            or newer(sequence, route.sequence)
            or (sequence == route.sequence and (not route.active or hops < route.hops + (not route.known)))
        ):
            route.next_hop, route.hops, route.sequence, route.known = next_hop, hops, sequence, True
            route.active, route.until = True, until
            self._tell(destination, route)
        else:
            return False
        if until <= self._now:
            self._short.add(destination)
        return True

    def hear(self, neighbour: Address, until: Time, sequence: int | None = None) -> None:
        """Take a route of one hop to a *neighbour* that has just been heard.

        Its number stays as it is, unless it has said its *sequence* number itself, and no newer one is known.
        """
        route = self._routes.get(neighbour)
        if route is not None and route.until <= self._now:
            route = self.get(neighbour)
        if route is None:
            route = Route(neighbour, 1, None, False, until)
            self._add(neighbour, route)
        elif route.active and route.hops == 1:
            if until > route.until:
                route.until = until
        else:
            route.known = route.known and route.active
            route.next_hop, route.hops, route.active, route.until = neighbour, 1, True, until
            self._tell(neighbour, route)
        if route.until <= self._now:
            self._short.add(neighbour)
        known = route.sequence
        if sequence is not None and (known is None or known == sequence or not newer(known, sequence)):
            route.sequence, route.known = sequence, True

    def prolong(self, destinations: Iterable[Address], until: Time) -> None:
        """Prolong those of the routes to *destinations* that are active to *until* at least."""
        for destination in destinations:
            route = self.active(destination)
            if route is not None and until > route.until:
                route.until = until

    def keep(self, destination: Address, until: Time) -> None:
        """Remember an ended route to *until* at least."""
        route = self.get(destination)
        if route is not None and not route.active:
            route.until = max(route.until, until)

    def end(self, destination: Address, now: Time, reported: int | None = None) -> None:
        """End the active route to *destination*; its sequence number becomes the *reported* one if that is newer."""
        route = self.active(destination)
        assert route is not None
        self._end(destination, route, now, reported)

    def settle(self, now: Time) -> None:
        """Tell who watches of routes that are over; the table notices when they are asked for."""
        if self.watch is not None:
            for destination, route in self._routes.items():
                if route.active and route.until <= now:
                    self.watch.end(destination, route.until)

    def _end(self, destination: Address, route: Route, at: Time, reported: int | None = None) -> None:
        if self.watch is not None:
            self.watch.end(destination, at)
        if route.sequence is not None:
            if reported is not None and newer(reported, route.sequence):
                route.sequence = reported
            elif route.known:
                route.sequence = route.sequence + 1 & MASK
        route.active, route.until = False, at + self._delete_period

    def _add(self, destination: Address, route: Route) -> None:
        if len(self._routes) >= self._enough:
            for each in list(self._routes):
                self.get(each)
            self._enough = max(ENOUGH, 2 * len(self._routes))
        self._routes[destination] = route
        self._tell(destination, route)

    def _tell(self, destination: Address, route: Route) -> None:
        """Tell who watches of a route that is another than before."""
        if self.watch is not None:
            self.watch.take(destination, route.next_hop, route.hops, self._now)
