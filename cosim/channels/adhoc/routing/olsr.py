"""OLSR, the optimised link state routing protocol (RFC 3626): every robot knows a way to every other at all times.

Robots list in HELLOs the neighbours that they hear, and so learn of robots up to two hops away. Each chooses relays
among its neighbours and lists them in its HELLOs. Relays list in TCs, for all robots, those that have chosen them. From
that, each robot computes routes with the fewest hops. TCs are repeated by relays of their last hop only.

Payloads to one robot go from hop to hop; if there is no route at that moment they are dropped. Payloads to all go as
TCs do: repeated once by relays of the last hop (or, if so set, by all robots).

Left out: MID and HNA (sections 5 and 12), as robots have one interface and no other network behind them; the additional
HELLOs that 8.5 permits, and the early TCs that 9.3 recommends, upon changes; HELLOs that list only a part of the
neighbours, so that the refresh interval matters for the hold time only.
"""

from typing import ClassVar, Final, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.base import Delivery, Queues, Unsent, counts
from cosim.channels.adhoc.routing.flooding import NUMBERS, Repeats, Seen
from cosim.channels.adhoc.routing.ip import OLSR_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.channels.adhoc.routing.olsr_graph import RoutingEntry, routing_table
from cosim.channels.adhoc.routing.olsr_neighbours import Hysteresis, Neighbourhood
from cosim.channels.adhoc.routing.olsr_wire import (
    HELLO,
    LONGEST,
    SHORTEST,
    TC,
    WILL_DEFAULT,
    WILL_NEVER,
    Hello,
    Message,
    Tc,
    decode_hello,
    decode_packet,
    decode_tc,
    encode_hello,
    encode_packet,
    encode_tc,
    newer,
)
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Outcome
from cosim.protocol import Metric
from cosim.randomness import Draws
from cosim.settings import Count, Seconds, Settings, error_at
from cosim.units import Time, from_seconds, to_seconds

EVERYWHERE: Final = 255
"""TTL of a TC."""
PACKET_OCTETS: Final = 1472
"""Most octets of messages in one packet: what an Ethernet frame holds without IPv4 and UDP."""
_MESSAGE_OCTETS: Final = 12
_FIRST, _JITTER = 0, 2
"""Purposes of draws; 1 is that of repeated payloads."""


class OlsrSettings(Settings):
    """Parameters of OLSR; defaults are those of RFC 3626, section 18."""

    kind: Literal["olsr"] = "olsr"
    hello_interval_s: Seconds = Field(default=2.0, gt=0, description="s between HELLOs, less the jitter")
    refresh_interval_s: Seconds = Field(
        default=2.0, gt=0, description="s, longest time between two HELLOs that list a neighbour"
    )
    tc_interval_s: Seconds = Field(default=5.0, gt=0, description="s between TCs, less the jitter")
    neighb_hold_s: Seconds | None = Field(
        default=None, gt=0, description="s for which a HELLO is valid; 3 refresh intervals if not given"
    )
    top_hold_s: Seconds | None = Field(
        default=None, gt=0, description="s for which a TC is valid; 3 TC intervals if not given"
    )
    dup_hold_s: Seconds = Field(default=30.0, gt=0, description="s for which a message is remembered")
    maxjitter_s: Seconds | None = Field(
        default=None, ge=0, description="s, greatest jitter; a quarter of the HELLO interval if not given"
    )
    willingness: int = Field(default=WILL_DEFAULT, ge=0, le=7, description="to forward for others: 0 never, 7 always")
    tc_redundancy: Literal[0, 1, 2] = Field(
        default=0, description="TCs list: 0 those who have chosen this relay, 1 its own relays too, 2 all neighbours"
    )
    mpr_coverage: Count = Field(
        default=1, ge=1, description="relays to every robot two hops away, if there are so many"
    )
    hysteresis: bool = Field(
        default=False,
        description="whether links prove themselves by packets that arrive and are lost (section 14); needs jitter, as "
        "a HELLO that comes later than announced counts as lost",
    )
    hyst_threshold_high: float = Field(default=0.8, ge=0, le=1, description="quality above which a link is taken up")
    hyst_threshold_low: float = Field(default=0.3, ge=0, le=1, description="quality below which a link is dropped")
    hyst_scaling: float = Field(default=0.5, gt=0, lt=1, description="weight of the latest packet in the quality")
    use_mac_feedback: bool = Field(
        default=False, description="whether a payload that is not acknowledged breaks the link (section 13)"
    )
    mpr_broadcasts: bool = Field(
        default=True, description="whether payloads to all are repeated by relays only, not by all robots"
    )
    payload_ttl: int = Field(default=35, ge=1, le=255, description="hops that a payload makes at most")
    payload_jitter_s: Seconds = Field(
        default=0.01, ge=0, description="s, a payload to all is repeated within that time, uniformly distributed"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        durations = {
            "hello_interval_s": self.hello_interval,
            "neighb_hold_s": self.hold,
            "top_hold_s": self.topology_hold,
        }
        for field, time in durations.items():
            if not SHORTEST <= time <= LONGEST:
                fits = f"{to_seconds(SHORTEST):g}..{to_seconds(LONGEST):g}"
                raise error_at((field,), to_seconds(time), f"is not in {fits}, which messages can tell")
        if self.jitter >= min(self.hello_interval, from_seconds(self.tc_interval_s)):
            raise error_at(("maxjitter_s",), to_seconds(self.jitter), "is not below the intervals of messages")
        if self.hyst_threshold_high < self.hyst_threshold_low:
            raise error_at(
                ("hyst_threshold_high",),
                self.hyst_threshold_high,
                f"is not >= {self.hyst_threshold_low}, hyst_threshold_low",
            )
        return self

    @property
    def hello_interval(self) -> Time:
        """Interval between HELLOs, ns."""
        return from_seconds(self.hello_interval_s)

    @property
    def hold(self) -> Time:
        """NEIGHB_HOLD_TIME, ns."""
        return from_seconds(3 * self.refresh_interval_s if self.neighb_hold_s is None else self.neighb_hold_s)

    @property
    def topology_hold(self) -> Time:
        """TOP_HOLD_TIME, ns."""
        return from_seconds(3 * self.tc_interval_s if self.top_hold_s is None else self.top_hold_s)

    @property
    def jitter(self) -> Time:
        """MAXJITTER, ns."""
        return from_seconds(self.hello_interval_s / 4 if self.maxjitter_s is None else self.maxjitter_s)


class Topology:
    """The contents of TCs: which robots are reached over which (sections 4.4 and 9.5)."""

    def __init__(self) -> None:
        self._tuples: dict[tuple[Address, Address], tuple[int, Time]] = {}
        self._due: Time | None = None
        self.version = 0
        """Number of changes of ``pairs``."""

    def update(self, origin: Address, tc: Tc, until: Time, now: Time) -> None:
        """Take a TC of *origin* that is valid to *until*; ignore one that is older than what is known."""
        self.advance(now)
        numbers = [number for (last, _), (number, _) in self._tuples.items() if last == origin]
        if any(newer(number, tc.ansn) for number in numbers):
            return
        for key in [key for key, (number, _) in self._tuples.items() if key[0] == origin and newer(tc.ansn, number)]:
            del self._tuples[key]
        for destination in tc.neighbours:
            self._tuples[origin, destination] = tc.ansn, until
        self._settle()

    def advance(self, now: Time) -> None:
        """Drop what has expired until *now*."""
        if self._due is not None and now >= self._due:
            self._tuples = {key: each for key, each in self._tuples.items() if each[1] > now}
            self._settle()

    def pairs(self) -> list[tuple[Address, Address]]:
        """Return all pairs (origin of a TC, robot that it reaches)."""
        return list(self._tuples)

    def _settle(self) -> None:
        self.version += 1
        self._due = min((until for _, until in self._tuples.values()), default=None)


class _Sent(NamedTuple):
    """A payload that the station is about to send."""

    neighbour: Address
    token: int | None
    """Token of the host."""


class Olsr(Queues):
    """The OLSR router of one robot; its numbers start anywhere, so that a reboot does not repeat them."""

    metrics: ClassVar[tuple[Metric, ...]] = counts(
        "control_packets",
        "control_octets",
        "links_broken",
        "payloads_forwarded",
        "payloads_unrouted",
        "packets_malformed",
    )

    def __init__(self, address: Address, settings: OlsrSettings, draws: Draws, now: Time = 0) -> None:
        super().__init__(address)
        self._settings = settings
        self._draws = draws
        hysteresis = Hysteresis(settings.hyst_threshold_high, settings.hyst_threshold_low, settings.hyst_scaling)
        self._neighbours = Neighbourhood(
            address, settings.hold, settings.mpr_coverage, hysteresis if settings.hysteresis else None
        )
        self._topology = Topology()
        self._messages_seen = Seen(from_seconds(settings.dup_hold_s))
        self._payloads_seen = Seen(from_seconds(settings.dup_hold_s))
        self._repeats = Repeats(from_seconds(settings.payload_jitter_s), draws, address)
        words = draws.words(now, address, _FIRST)
        self._number, self._message_number, self._packet_number, self._ansn = (word % NUMBERS for word in words)
        self._drawn = 0
        self._hello_at = now + self._jitter()
        self._tc_at = now + self._jitter()
        self._advertised: frozenset[Address] = frozenset()  # by the last TC
        self._told_until: Time = now
        self._queue: list[Message] = []  # of others, to be forwarded
        self._queue_at: Time | None = None
        self._table: dict[Address, RoutingEntry] = {}
        self._table_of = (-1, -1)
        self._sent: dict[int, _Sent] = {}
        self._tokens = 0
        self._counts = dict.fromkeys((metric.name for metric in self.metrics), 0)

    # ------------------------------------------------------------ payloads

    def send(self, destination: Address, payload: bytes, token: int | None, now: Time) -> None:
        """Send *payload* on its way.

        Its fate is DELIVERED when the next hop has acknowledged it, UNACKNOWLEDGED if that has not, NO_ROUTE if there
        is none; SENT if it is to all; QUEUE_FULL if the station has no room, TOO_LONG if no IPv4 packet holds it;
        DELIVERED if it is for this robot itself.
        """
        if self._settled(destination, payload, token):
            return
        ttl, number = self._settings.payload_ttl, self._number
        self._number = (number + 1) % NUMBERS
        datagram = Datagram(self._address, destination, ttl, PAYLOAD_PORT, number, payload)
        if destination == BROADCAST:
            self._hop(BROADCAST, encode(datagram), token)
        else:
            self._route(datagram, token, now)

    def receive(self, packet: bytes, hop: Address, now: Time) -> bool:
        """Take a payload or an OLSR packet; bytes that make no sense are counted and dropped."""
        try:
            datagram = decode(packet)
            if datagram.source == self._address:
                return False
            if datagram.source == BROADCAST:
                raise WireError("all robots at once are no source")
            if datagram.port == OLSR_PORT:
                self._control(datagram, hop, now)
            elif datagram.port == PAYLOAD_PORT:
                self._payload(datagram, hop, now)
            else:
                raise WireError(f"nobody listens at port {datagram.port}")
        except WireError:
            self._counts["packets_malformed"] += 1
        return True

    def hop_done(self, token: int, acknowledged: bool, now: Time) -> None:
        """Note the fate of a payload; with MAC feedback a failure breaks the link (section 13)."""
        if (sent := self._sent.pop(token, None)) is None:
            return
        if sent.neighbour == BROADCAST:
            self._report_fate(sent.token, Outcome.SENT)
            return
        self._report_fate(sent.token, Outcome.DELIVERED if acknowledged else Outcome.UNACKNOWLEDGED)
        if not acknowledged and self._settings.use_mac_feedback:
            self._counts["links_broken"] += self._neighbours.broken(sent.neighbour, now)
            self._tell_routes(now)

    def hop_refused(self, token: int, now: Time) -> None:
        """Report that a payload has not been on the air; that breaks no link."""
        if (sent := self._sent.pop(token, None)) is not None:
            self._counts["payloads_unrouted"] += 1
            self._report_fate(sent.token, Outcome.QUEUE_FULL)

    def _payload(self, datagram: Datagram, hop: Address, now: Time) -> None:
        source, destination, ttl = datagram.source, datagram.destination, datagram.ttl
        if destination == self._address:
            self._deliveries.append(Delivery(source, datagram.data, False))
        elif destination != BROADCAST:
            if ttl <= 1:
                self._counts["payloads_unrouted"] += 1
            else:
                self._counts["payloads_forwarded"] += 1
                self._route(datagram._replace(ttl=ttl - 1), None, now)
        elif self._payloads_seen.first((source, datagram.number), now):
            self._deliveries.append(Delivery(source, datagram.data, True))
            self._neighbours.advance(now)
            if ttl > 1 and (hop in self._neighbours.selectors or not self._settings.mpr_broadcasts):
                self._counts["payloads_forwarded"] += 1
                self._repeats.add(encode(datagram._replace(ttl=ttl - 1)), now)

    def _route(self, datagram: Datagram, token: int | None, now: Time) -> None:
        if (route := self.routes(now).get(datagram.destination)) is not None:
            self._hop(route.next_hop, encode(datagram), token)
            return
        self._counts["payloads_unrouted"] += 1
        if datagram.source == self._address:
            self._unsent.append(Unsent(datagram.destination, len(datagram.data), Outcome.NO_ROUTE))
        self._report_fate(token, Outcome.NO_ROUTE)

    def _hop(self, neighbour: Address, packet: bytes, token: int | None) -> None:
        self._tokens += 1
        self._sent[self._tokens] = _Sent(neighbour, token)
        self._hops.append(Packet(neighbour, packet, self._tokens))

    # ------------------------------------------------------------ messages

    def _control(self, datagram: Datagram, hop: Address, now: Time) -> None:
        if datagram.source != hop:
            raise WireError(f"{hop} puts an OLSR packet of {datagram.source} on the air")  # none makes two hops
        number, messages = decode_packet(datagram.data)
        self._neighbours.packet(hop, number, now)
        self._neighbours.advance(now)
        for message in messages:
            if message.ttl == 0 or message.origin == self._address:
                continue
            if self._messages_seen.has((message.origin, message.number), now):
                continue
            if message.kind == HELLO:
                if message.origin != hop:
                    raise WireError(f"{hop} puts a HELLO of {message.origin} on the air")
                self._neighbours.hello(hop, decode_hello(message.body), message.validity, number, now)
                continue
            if hop not in self._neighbours.willingness:  # sections 9.5 and 3.4.1: only from symmetric neighbours
                continue
            if message.kind == TC:
                self._topology.update(message.origin, decode_tc(message.body), now + message.validity, now)
            self._forward(message, hop, now)
        self._tell_routes(now)

    def _forward(self, message: Message, hop: Address, now: Time) -> None:
        """Have *message* repeated by the rules of section 3.4.1."""
        self._messages_seen.first((message.origin, message.number), now)
        if hop in self._neighbours.selectors and message.ttl > 1:
            self._queue.append(message._replace(ttl=message.ttl - 1, hops=min(message.hops + 1, 255)))
            if self._queue_at is None:
                self._queue_at = now + self._jitter()

    def wake(self, now: Time) -> None:
        """Send HELLO, TC and what is to be forwarded, together if any of it is due (section 3.5)."""
        self._hops += self._repeats.due(now)
        hello, tc = now >= self._hello_at, now >= self._tc_at
        if not hello and not tc and (self._queue_at is None or now < self._queue_at):
            return
        self._neighbours.advance(now)
        messages = []
        if hello:
            messages.append(self._hello(now))
            self._hello_at = now + self._settings.hello_interval - self._jitter()
        if tc:
            messages += self._tc(now)
            self._tc_at = now + from_seconds(self._settings.tc_interval_s) - self._jitter()
        messages += self._queue
        self._queue, self._queue_at = [], None
        self._emit(messages)
        self._tell_routes(now)

    def _hello(self, now: Time) -> Message:
        settings = self._settings
        body = encode_hello(Hello(settings.hello_interval, settings.willingness, self._neighbours.links(now)))
        return self._message(HELLO, settings.hold, 1, body)

    def _tc(self, now: Time) -> list[Message]:
        """Return the TC that is due (section 9.3): none if there is nothing to advertise, and nothing to withdraw."""
        settings, known = self._settings, self._neighbours
        advertised = known.selectors
        if settings.willingness != WILL_NEVER and settings.tc_redundancy:  # section 15.1
            advertised = advertised | known.mprs if settings.tc_redundancy == 1 else frozenset(known.willingness)
        if advertised != self._advertised:
            self._advertised = advertised
            self._ansn = (self._ansn + 1) % NUMBERS
        if advertised:
            self._told_until = now + settings.topology_hold
        elif now >= self._told_until:
            return []
        return [self._message(TC, settings.topology_hold, EVERYWHERE, encode_tc(Tc(self._ansn, sorted(advertised))))]

    def _message(self, kind: int, validity: Time, ttl: int, body: bytes) -> Message:
        self._message_number = (self._message_number + 1) % NUMBERS
        return Message(kind, validity, self._address, ttl, 0, self._message_number, body)

    def _emit(self, messages: list[Message]) -> None:
        while messages:
            count, octets = 0, 0
            for message in messages:
                octets += _MESSAGE_OCTETS + len(message.body)
                if count and octets > PACKET_OCTETS:
                    break
                count += 1
            data = encode_packet(self._packet_number, messages[:count])
            messages = messages[count:]
            packet = encode(Datagram(self._address, BROADCAST, 1, OLSR_PORT, self._number, data))
            self._packet_number = (self._packet_number + 1) % NUMBERS
            self._number = (self._number + 1) % NUMBERS
            self._counts["control_packets"] += 1
            self._counts["control_octets"] += len(packet)
            self._hops.append(Packet(BROADCAST, packet))

    def wake_at(self) -> Time | None:
        """Return when the next message or repeated payload is to be sent."""
        times = self._hello_at, self._tc_at, self._queue_at, self._repeats.due_at()
        return min(time for time in times if time is not None)

    def _jitter(self) -> Time:
        self._drawn += 1
        return self._draws.below(self._settings.jitter + 1, self._drawn, self._address, _JITTER)

    # ------------------------------------------------------------ what is known

    def routes(self, now: Time) -> dict[Address, RoutingEntry]:
        """Return the routing table."""
        known = self._neighbours
        known.advance(now)
        self._topology.advance(now)
        if self._table_of != (version := (known.version, self._topology.version)):
            self._table_of = version
            self._table = routing_table(
                self._address, known.willingness, known.reach, known.selectors, self._topology.pairs()
            )
            if self._watch is not None:
                self._watch.take_all(self._table, now)
        return self._table

    def _tell_routes(self, now: Time) -> None:
        """Tell who watches of routes, where they may be others than before, and all that has expired is forgotten."""
        if self._watch is not None:
            self.routes(now)

    def relays(self, now: Time) -> frozenset[Address]:
        """Return the robots that this one has chosen as its multipoint relays."""
        self._neighbours.advance(now)
        return self._neighbours.mprs

    def summary(self) -> dict[str, float]:
        """Return packets and octets of OLSR sent (IPv4 and UDP included), and numbers of payloads, by fate."""
        return dict(self._counts)
