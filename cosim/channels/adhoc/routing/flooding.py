"""Flooding: every robot repeats every payload once, whatever its destination.

There are no routes, and no packets but those with payloads. A payload is identified by its source and the number in its
IPv4 header, so a second copy is neither delivered nor repeated. One that is for a single robot is flooded too; it is
delivered there only, and not repeated there.
"""

from heapq import heappop, heappush
from typing import ClassVar, Final, Literal

from pydantic import Field

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.base import Delivery, Queues, counts
from cosim.channels.adhoc.routing.ip import PAYLOAD_PORT, Datagram, decode, encode
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Outcome
from cosim.protocol import Metric
from cosim.randomness import Draws
from cosim.settings import Seconds, Settings
from cosim.units import Time, from_seconds

NUMBERS: Final = 1 << 16
"""Number of values of the IPv4 identification field."""
_NUMBER, _JITTER = 0, 1
"""Purposes of draws."""


class FloodingSettings(Settings):
    """Parameters of flooding."""

    kind: Literal["flooding"] = "flooding"
    ttl: int = Field(default=35, ge=1, le=255, description="hops that a payload makes at most")
    jitter_s: Seconds = Field(
        default=0.01, ge=0, description="s, a payload is repeated within that time, uniformly distributed"
    )
    dup_hold_s: Seconds = Field(
        default=30.0, gt=0, description="s for which a payload is remembered; its number returns after 65536 payloads"
    )


class Seen:
    """The packets that have been here lately, each remembered for the same time."""

    def __init__(self, hold: Time) -> None:
        self._hold = hold
        self._until: dict[tuple[Address, int], Time] = {}  # in the order in which they expire

    def has(self, key: tuple[Address, int], now: Time) -> bool:
        """Return whether *key* is still known."""
        return self._until.get(key, now) > now

    def first(self, key: tuple[Address, int], now: Time) -> bool:
        """Return whether *key* is new, and remember it from now on; *now* never goes back."""
        while self._until and next(iter(self._until.values())) <= now:
            del self._until[next(iter(self._until))]
        if key in self._until:
            return False
        self._until[key] = now + self._hold
        return True


class Repeats:
    """Packets to all that wait for their jitter to pass, to be repeated."""

    def __init__(self, jitter: Time, draws: Draws, address: Address) -> None:
        self._jitter = jitter
        self._draws = draws
        self._address = address
        self._waiting: list[tuple[Time, int, bytes]] = []
        self._count = 0

    def add(self, packet: bytes, now: Time) -> None:
        """Have *packet* repeated within the jitter."""
        delay = self._draws.below(self._jitter + 1, self._count, self._address, _JITTER)
        heappush(self._waiting, (now + delay, self._count, packet))
        self._count += 1

    def due(self, now: Time) -> list[Packet]:
        """Drain what is to be sent now."""
        hops = []
        while self._waiting and self._waiting[0][0] <= now:
            hops.append(Packet(BROADCAST, heappop(self._waiting)[2]))
        return hops

    def due_at(self) -> Time | None:
        """Return when the next one is to be sent."""
        return self._waiting[0][0] if self._waiting else None


class Flooding(Queues):
    """The router of one robot that floods; its numbers start anywhere, so that a reboot does not repeat them."""

    metrics: ClassVar[tuple[Metric, ...]] = counts("payloads_forwarded", "packets_malformed")

    def __init__(self, address: Address, settings: FloodingSettings, draws: Draws, now: Time = 0) -> None:
        super().__init__(address)
        self._ttl = settings.ttl
        self._number = draws.below(NUMBERS, now, address, _NUMBER)
        self._seen = Seen(from_seconds(settings.dup_hold_s))
        self._repeats = Repeats(from_seconds(settings.jitter_s), draws, address)
        self._forwarded = self._malformed = 0

    def send(self, destination: Address, payload: bytes, token: int | None, now: Time) -> None:
        """Put *payload* on the air, whatever its destination.

        Its fate is SENT once it has been on the air; QUEUE_FULL if the station has no room; TOO_LONG if no IPv4 packet
        holds it; DELIVERED if it is for this robot itself.
        """
        if self._settled(destination, payload, token):
            return
        packet = encode(Datagram(self._address, destination, self._ttl, PAYLOAD_PORT, self._number, payload))
        self._number = (self._number + 1) % NUMBERS
        self._hops.append(Packet(BROADCAST, packet, token))

    def receive(self, packet: bytes, hop: Address, now: Time) -> bool:
        """Deliver a payload that is new and meant for this robot, and have it repeated if others may want it."""
        try:
            datagram = decode(packet)
            if datagram.port != PAYLOAD_PORT or datagram.source == BROADCAST:
                raise WireError(f"port {datagram.port}, source {datagram.source}: no payload of a robot")
        except WireError:
            self._malformed += 1
            return False
        source, destination, ttl = datagram.source, datagram.destination, datagram.ttl
        if source == self._address or not self._seen.first((source, datagram.number), now):
            return False
        if destination in (BROADCAST, self._address):
            self._deliveries.append(Delivery(source, datagram.data, destination == BROADCAST))
        if destination != self._address and ttl > 1:
            self._repeats.add(encode(datagram._replace(ttl=ttl - 1)), now)
        return True

    def hop_done(self, token: int, acknowledged: bool, now: Time) -> None:
        """Report that an own payload has been on the air."""
        self._report_fate(token, Outcome.SENT)

    def hop_refused(self, token: int, now: Time) -> None:
        """Report that an own payload has not been on the air."""
        self._report_fate(token, Outcome.QUEUE_FULL)

    def wake(self, now: Time) -> None:
        """Repeat what has waited long enough."""
        due = self._repeats.due(now)
        self._forwarded += len(due)
        self._hops += due

    def wake_at(self) -> Time | None:
        """Return when something is to be repeated."""
        return self._repeats.due_at()

    def summary(self) -> dict[str, float]:
        """Return the numbers of payloads repeated for others, and of packets that made no sense."""
        return {"payloads_forwarded": self._forwarded, "packets_malformed": self._malformed}
