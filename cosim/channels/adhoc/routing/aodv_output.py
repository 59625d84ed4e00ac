"""The output of an AODV router: packets for its station, some held back at random, and payloads for its host."""

from heapq import heappop, heappush
from typing import ClassVar, NamedTuple

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv_search import Carried
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Message, Rrep, encode_message
from cosim.channels.adhoc.routing.base import Queues, counts
from cosim.channels.adhoc.routing.ip import AODV_PORT, Datagram, encode
from cosim.machine import BROADCAST, Address
from cosim.protocol import Metric
from cosim.randomness import Draws
from cosim.units import Time

_FIRST, _JITTER = 1, 2
"""Purposes of draws."""


class Watch(NamedTuple):
    """The purpose of a packet whose fate the station reports: the token of its hop."""

    neighbour: Address
    carried: Carried | None
    reply: bool
    """True if it is a route reply."""


class Output(Queues):
    """The packets, payloads and fates of one robot's router."""

    metrics: ClassVar[tuple[Metric, ...]] = counts(
        "packets_malformed",
        "control_packets",
        "control_octets",
        "route_requests",
        "route_errors",
        "links_broken",
        "payloads_forwarded",
        "payloads_unrouted",
    )

    def __init__(self, address: Address, settings: AodvSettings, draws: Draws, now: Time) -> None:
        super().__init__(address)
        self.address = address
        self.settings = settings
        self.times = settings.times()
        self.counts = dict.fromkeys((metric.name for metric in self.metrics), 0)
        self._draws = draws
        self._drawn = 0
        self._identification, self._request_id, *_ = draws.words(now, address, _FIRST)
        self._held: list[tuple[Time, int, Packet]] = []
        """Broadcasts that wait for their jitter to pass."""
        self._hello_at: Time | None = None
        """Instant at which the next hello is due."""
        self._due: Time | None = None
        """Instant before which nothing is due; what has come to be due later since ``wake`` has not moved it."""

    def summary(self) -> dict[str, float]:
        """Return what it has counted, by metric name."""
        return {name: float(count) for name, count in self.counts.items()}

    def _draw(self, bound: Time) -> Time:
        """Return a random time from 0 to *bound*."""
        self._drawn += 1
        return self._draws.below(bound + 1, self._drawn, self.address, _JITTER)

    def _datagram(self, destination: Address, ttl: int, port: int, data: bytes) -> Datagram:
        self._identification = self._identification + 1 & 0xFFFF
        return Datagram(self.address, destination, ttl, port, self._identification, data)

    def _put(
        self, neighbour: Address, packet: bytes, now: Time, watch: Watch | None = None, held: bool = False
    ) -> None:
        """Leave *packet* for the station, or after a random time if it is to be *held* back."""
        only_failure = watch is not None and (watch.carried is None or watch.carried.token is None)
        sent = Packet(neighbour, packet, watch, only_failure)
        after = self._draw(self.times.jitter) if held and self.times.jitter else 0
        if after:
            heappush(self._held, (now + after, self._drawn, sent))
            self._expect(now + after)
        else:
            self._hops.append(sent)
        if neighbour == BROADCAST and self._hello_at is not None:
            self._plan_hello(self._next_hello(now + after))

    def _next_hello(self, last: Time) -> Time:
        """Return when the next hello is due after a broadcast: a little early, or two clocks could collide for ever."""
        return max(last + self.times.hello - self._draw(self.times.jitter), last + 1)

    def _send_message(self, message: Message, neighbour: Address, now: Time, ttl: int = 1, held: bool = False) -> None:
        packet = encode(self._datagram(neighbour, ttl, AODV_PORT, encode_message(message)))
        self.counts["control_packets"] += 1
        self.counts["control_octets"] += len(packet)
        watched = neighbour != BROADCAST and self.settings.use_mac_feedback
        self._put(neighbour, packet, now, Watch(neighbour, None, isinstance(message, Rrep)) if watched else None, held)

    def _plan_hello(self, at: Time) -> None:
        self._hello_at = at
        self._expect(at)

    def _expect(self, at: Time) -> None:
        """Note that something will be due *at* that instant."""
        if self._due is None or at < self._due:
            self._due = at

    def _release(self, now: Time) -> None:
        while self._held and self._held[0][0] <= now:
            self._hops.append(heappop(self._held)[2])
