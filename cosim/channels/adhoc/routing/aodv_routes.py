"""The routing table of AODV (RFC 3561, sections 6.1, 6.2 and 6.11), and what keeps it free of loops.

Where the RFC can be read in more than one way, what is done here never lets the sequence number of an entry decrease,
and increments it whenever the route ends, by a break, an error or its age: other readings have loops (van Glabbeek,
Höfner, Tan, Portmann, "Sequence numbers do not guarantee loop freedom: AODV can yield routing loops", MSWiM 2013).
A route to a neighbour that was merely heard keeps the number, but answers no request and ends without an increment:
so no robot's number of another is ever more than one ahead of that robot's own, whose next request is new to all.
"""

from dataclasses import dataclass, field
from typing import Final

from cosim.machine import Address
from cosim.units import Time

MASK: Final = 0xFFFFFFFF
_HALF: Final = 1 << 31


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
    """The routes that one robot knows; every query is about the instant of the last ``age``."""

    def __init__(self, owner: Address, delete_period: Time) -> None:
        """An ended route is remembered for *delete_period* ns; there is never a route to the *owner*."""
        self._owner = owner
        self._delete_period = delete_period
        self._routes: dict[Address, Route] = {}
        self._soonest: Time | None = None
        """Instant before which no route ends."""

    def age(self, now: Time) -> None:
        """End routes whose time has come, and forget those that ended long ago."""
        if self._soonest is None or now < self._soonest:
            return
        for destination, route in list(self._routes.items()):
            if route.active and route.until <= now:
                self.end(destination, route.until)
            if not route.active and route.until <= now:
                del self._routes[destination]
        self._soonest = min((route.until for route in self._routes.values()), default=None)

    def get(self, destination: Address) -> Route | None:
        """Return the entry of *destination*, active or not."""
        return self._routes.get(destination)

    def active(self, destination: Address) -> Route | None:
        """Return the route that payloads to *destination* take."""
        route = self._routes.get(destination)
        return route if route is not None and route.active else None

    def through(self, next_hop: Address) -> list[Address]:
        """Return the destinations of the active routes over *next_hop*."""
        return [each for each, route in self._routes.items() if route.active and route.next_hop == next_hop]

    def destinations(self) -> list[Address]:
        """Return the destinations of all active routes."""
        return [each for each, route in self._routes.items() if route.active]

    def offer(self, destination: Address, next_hop: Address, hops: int, sequence: int, until: Time) -> bool:
        """Take a route to *destination* if it is newer, or as new and shorter or in place of none (6.2, 6.7)."""
        if destination == self._owner:
            return False
        route = self._routes.get(destination)
        if route is None:
            self._routes[destination] = Route(next_hop, hops, sequence, True, until)
        elif (
            route.sequence is None
            or newer(sequence, route.sequence)
            or (sequence == route.sequence and (not route.active or hops < route.hops + (not route.known)))
        ):
            route.next_hop, route.hops, route.sequence, route.known = next_hop, hops, sequence, True
            route.active, route.until = True, until
        else:
            return False
        self._note(until)
        return True

    def hear(self, neighbour: Address, until: Time) -> None:
        """Take a route of one hop to a *neighbour* that has just been heard; its sequence number stays as it is."""
        route = self._routes.get(neighbour)
        if route is None:
            self._routes[neighbour] = Route(neighbour, 1, None, False, until)
        elif route.active and route.hops == 1:
            route.until = max(route.until, until)
        else:
            route.known = route.known and route.active
            route.next_hop, route.hops, route.active, route.until = neighbour, 1, True, until
        self._note(until)

    def learn(self, destination: Address, sequence: int) -> None:
        """Take over a *sequence* number that the destination itself has sent, unless a newer one is known."""
        route = self._routes.get(destination)
        if route is not None and (route.sequence is None or not newer(route.sequence, sequence)):
            route.sequence, route.known = sequence, True

    def prolong(self, destination: Address, until: Time) -> None:
        """Prolong an active route to *until* at least."""
        route = self.active(destination)
        if route is not None:
            route.until = max(route.until, until)

    def keep(self, destination: Address, until: Time) -> None:
        """Remember an ended route to *until* at least."""
        route = self._routes.get(destination)
        if route is not None and not route.active:
            route.until = max(route.until, until)

    def end(self, destination: Address, now: Time, reported: int | None = None) -> None:
        """End the active route to *destination*; its sequence number becomes the *reported* one if that is newer."""
        route = self._routes[destination]
        if route.sequence is not None:
            if reported is not None and newer(reported, route.sequence):
                route.sequence = reported
            elif route.known:
                route.sequence = route.sequence + 1 & MASK
        route.active, route.until = False, now + self._delete_period

    def _note(self, until: Time) -> None:
        self._soonest = until if self._soonest is None else min(self._soonest, until)
