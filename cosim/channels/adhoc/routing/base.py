"""The contract of a router: packets and time in, packets and time out; it has no radio, no clock and no map.

A router stands between a host and its station. The host hands over payloads for a robot, or for all. The station hands
over packets that have arrived, and reports whether a neighbour has acknowledged one. The channel drains what the router
leaves, and wakes it at ``wake_at``. All that a router knows of the network it has from bytes that it has received.
"""

from typing import Any, ClassVar, Final, NamedTuple, Protocol

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.ip import HEADER_OCTETS
from cosim.channels.adhoc.routing.watch import RouteWatch
from cosim.machine import Address, Outcome
from cosim.protocol import Metric
from cosim.units import Time

MOST_OCTETS: Final = 0xFFFF - HEADER_OCTETS
"""Longest payload: what one IPv4 packet holds."""
COUNTS: Final = (
    Metric("control_packets", "1", "packets of the routing protocol sent, those of others repeated included"),
    Metric("control_octets", "1", "octets of these packets, IPv4 and UDP headers included"),
    Metric("route_requests", "1", "searches for a route, each repetition counted (RREQ)"),
    Metric("route_errors", "1", "reports that destinations have become unreachable (RERR)"),
    Metric("links_broken", "1", "times that a neighbour was found to be gone"),
    Metric("payloads_forwarded", "1", "packets with a payload sent on for another robot"),
    Metric("payloads_unrouted", "1", "payloads given up for want of a route, at whichever robot"),
    Metric("packets_malformed", "1", "packets that made no sense, and were dropped"),
)
"""What routers count; each kind of router counts some of these."""


def counts(*names: str) -> tuple[Metric, ...]:
    """Return those of ``COUNTS`` with these *names*, in the order of *names*."""
    known = {metric.name: metric for metric in COUNTS}
    return tuple(known[name] for name in names)


class Delivery(NamedTuple):
    """A payload that has arrived at the host."""

    source: Address
    """Robot that has sent it, however many hops away."""
    payload: bytes
    broadcast: bool


class Unsent(NamedTuple):
    """A payload of the host that has never been on the air."""

    destination: Address
    length: int
    why: Outcome
    """Reason: NO_ROUTE or TOO_LONG."""


class Router(Protocol):
    """One robot's router."""

    metrics: ClassVar[tuple[Metric, ...]]
    """The metrics that ``summary`` returns."""

    def send(self, destination: Address, payload: bytes, token: int | None, now: Time) -> None:
        """Bring *payload* to *destination*, or to all (BROADCAST); its fate is reported if it has a *token*."""

    def receive(self, packet: bytes, hop: Address, now: Time) -> bool:
        """Take a packet that *hop* has put on the air; bytes that make no sense are counted and dropped.

        Return False if that has left nothing to drain, and ``wake_at`` is not earlier than it was.
        """

    def hop_done(self, token: Any, acknowledged: bool, now: Time) -> None:
        """Note the fate of a packet with a *token*."""

    def hop_refused(self, token: Any, now: Time) -> None:
        """Note that the station had no room for a packet: it is lost, and the link is as it was."""

    def wake(self, now: Time) -> None:
        """Do what is due; harmless if nothing is."""

    def wake_at(self) -> Time | None:
        """Return an instant before which nothing is due if nothing comes in; None if nothing ever is.

        It is asked after every packet, so it is kept, not searched for, and may be too early for what has been put off
        since: ``wake`` then does nothing, and it is a later one.
        """

    @property
    def left(self) -> bool:
        """True if one of the four that follow has something to drain."""

    def hops(self) -> list[Packet]:
        """Drain packets for the station."""

    def deliveries(self) -> list[Delivery]:
        """Drain payloads for the host."""

    def fates(self) -> list[tuple[int, Outcome]]:
        """Drain the fates of payloads: DELIVERED to the next hop, SENT to all, or why not.

        That is NO_ROUTE, UNACKNOWLEDGED by the next hop, QUEUE_FULL or TOO_LONG.
        """

    def unsent(self) -> list[Unsent]:
        """Drain the host's payloads, with a token or without, that it could not send at all."""

    def be_watched(self, watch: RouteWatch | None) -> None:
        """Tell *watch*, which knows of none yet, of all routes from now on; None: no longer."""

    def settle(self, now: Time) -> None:
        """Tell who watches of routes that are over, which is not noticed before they are wanted."""

    def summary(self) -> dict[str, float]:
        """Return what it has counted, by metric name."""


class Queues:
    """What a router leaves for its station and its host, until they drain it."""

    def __init__(self, address: Address) -> None:
        self._address = address
        self._hops: list[Packet] = []
        self._deliveries: list[Delivery] = []
        self._fates: list[tuple[int, Outcome]] = []
        self._unsent: list[Unsent] = []
        self._watch: RouteWatch | None = None

    def be_watched(self, watch: RouteWatch | None) -> None:
        """Tell *watch* of all routes from now on."""
        self._watch = watch

    def settle(self, now: Time) -> None:
        """Tell of routes that are over: most routers notice that themselves."""

    @property
    def left(self) -> bool:
        """True if there is something to drain."""
        return bool(self._deliveries or self._hops or self._fates or self._unsent)

    def hops(self) -> list[Packet]:
        """Drain packets for the station."""
        hops, self._hops = self._hops, []
        return hops

    def deliveries(self) -> list[Delivery]:
        """Drain payloads for the host."""
        deliveries, self._deliveries = self._deliveries, []
        return deliveries

    def fates(self) -> list[tuple[int, Outcome]]:
        """Drain the fates of payloads."""
        fates, self._fates = self._fates, []
        return fates

    def unsent(self) -> list[Unsent]:
        """Drain payloads of the host that it could not send at all."""
        unsent, self._unsent = self._unsent, []
        return unsent

    def _report_fate(self, token: int | None, outcome: Outcome) -> None:
        if token is not None:
            self._fates.append((token, outcome))

    def _settled(self, destination: Address, payload: bytes, token: int | None) -> bool:
        """Return whether *payload* needs no radio: no packet holds it (TOO_LONG), or it is for this robot."""
        if len(payload) > MOST_OCTETS:
            self._unsent.append(Unsent(destination, len(payload), Outcome.TOO_LONG))
            self._report_fate(token, Outcome.TOO_LONG)
            return True
        if destination == self._address:
            self._deliveries.append(Delivery(destination, payload, False))
            self._report_fate(token, Outcome.DELIVERED)
            return True
        return False
