"""Payloads for everyone by flooding, as nodes of Bluetooth Mesh do it (Mesh Profile 1.0, 3.4 and 4.2.19 to 4.2.20).

A payload becomes a network PDU, or several, each of which is advertised in an event of its own a number of times. Who
hears one that is not in its message cache takes it, and repeats it with a TTL that is one less, unless that was below
2 before. A node has one queue, for its own PDUs and those that it repeats: the events of one are over before those of
the next begin (as of Zephyr and NimBLE). The random delay before the first event is also what the specification
recommends before a repetition (3.4.6.3).
"""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

from cosim.channels.ble.bits.mesh.bearer import decode_bearer, encode_bearer
from cosim.channels.ble.bits.mesh.lower_transport import SEGMENT_OCTETS, encode_lower, segments
from cosim.channels.ble.bits.mesh.network import ALL_NODES, NetworkPdu, decode_network, encode_network
from cosim.channels.ble.bits.mesh.upper_transport import OPCODE, encode_upper
from cosim.channels.ble.bits.pdu import Undirected, decode_advertising
from cosim.channels.ble.broadcasts.events import Events, Speaker, Step, nonconnectable
from cosim.channels.ble.broadcasts.inbox import Inbox
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.settings import MeshSettings
from cosim.errors import WireError
from cosim.machine import Address, Outcome, Outgoing, Reception

_KEY: Final = 0
"""AID: that of the one application."""


class Queued(NamedTuple):
    """A network PDU that a node has still to send."""

    pdu: NetworkPdu
    length: int
    """Octets of the user's payload in it."""
    outgoing: Outgoing | None = None
    """The payload, of which this is a part; None if it is another node's."""
    first: bool = False
    """True if this is the first part of the node's own payload."""
    last: bool = False


def element(address: Address) -> int:
    """Return the address in the mesh of the robot *address*."""
    return 1 + address


def parts(address: Address, ttl: int, sequence: int, outgoing: Outgoing) -> Iterator[Queued]:
    """Yield the network PDUs in which the robot *address* sends a payload to all nodes, numbered from *sequence* on."""
    begin, size = len(OPCODE), len(outgoing.payload)
    lower = segments(encode_upper(outgoing.payload), sequence, _KEY)
    for turn, each in enumerate(lower):
        at = turn * SEGMENT_OCTETS
        length = size if len(lower) == 1 else min(at + SEGMENT_OCTETS, begin + size) - max(at, begin)
        pdu = NetworkPdu(ttl, sequence + turn, element(address), ALL_NODES, encode_lower(each))
        yield Queued(pdu, max(0, length), outgoing, turn == 0, turn == len(lower) - 1)


class Advertised(Events):
    """A network PDU that *node* sends."""

    def __init__(self, node: "Node", number: int, queued: Queued) -> None:
        """*number* counts what the node sends."""
        self._node, self._queued = node, queued
        super().__init__(node.speaker, number, *node.settings.transmits(queued.outgoing is None))

    @property
    def again(self) -> bool:
        """Whether the PDU has been on the air before."""
        return self._event > 0 or self._queued.outgoing is None

    def plan(self) -> list[Step]:
        """Return the packets of an event: all events are alike."""
        data = encode_bearer(encode_network(self._queued.pdu))
        return nonconnectable(self.speaker.station.address, data, self._queued.length)

    def begun(self) -> None:
        """Note when a payload is on the air first."""
        if self._queued.first and not self.again:
            self._hosts.payloads.begin(self._queued.outgoing, self._start)

    def ended(self, packet: Sent, last: bool) -> None:
        """Have the nodes that hear *packet* take it."""
        for listener, judgement in self.heard_by(packet):
            listener.take(packet, judgement.power_dbm)

    def over(self) -> None:
        """Have the node go on."""
        self._node.sent(self._queued)


class Node:
    """The node of *speaker*."""

    def __init__(self, speaker: Speaker, settings: MeshSettings) -> None:
        self.speaker = speaker
        self.settings = settings
        self._kernel, _, self._hosts, _ = speaker.environment
        self._address = speaker.station.address
        self._queue: deque[Queued] = deque()
        self._under_way: Advertised | None = None
        self._held = self._relayed = 0
        """Own payloads, and PDUs of others, that are not over."""
        self._sent = 0
        self._sequence = 0
        self._cache: dict[tuple[int, int, int], None] = {}
        """What has come lately, the oldest first: IVI, source and sequence number of network PDUs."""
        self._inbox = Inbox()
        speaker.station.take = self._take

    @property
    def held(self) -> int:
        """The number of own payloads that are not over."""
        return self._held

    def send(self, outgoing: Outgoing) -> None:
        """Send a payload to everyone, after all that waits."""
        queued = list(parts(self._address, self.settings.ttl, self._sequence, outgoing))
        self._sequence += len(queued)
        self._held += 1
        self._queue += queued
        self._next()

    def flush(self) -> list[Outgoing]:
        """Take out, and return, the own payloads of which nothing has been on the air."""
        flushed = [each.outgoing for each in self._queue if each.first and each.outgoing is not None]
        gone = {id(outgoing) for outgoing in flushed}
        self._queue = deque(each for each in self._queue if id(each.outgoing) not in gone)
        self._held -= len(flushed)
        return flushed

    def cancel(self) -> None:
        """Forget what is to be sent, and what is not whole: the device is off."""
        if self._under_way is not None:
            self._under_way.cancel()
        self._under_way = None
        self._queue.clear()
        self._cache.clear()
        self._inbox.forget()
        self._held = self._relayed = 0

    def sent(self, queued: Queued) -> None:
        """Go on with the next: all events of *queued* are over."""
        self._under_way = None
        if queued.outgoing is None:
            self._relayed -= 1
        elif queued.last:
            self._held -= 1
            self._hosts.over(self._address, queued.outgoing, Outcome.SENT)
        self._next()

    def _next(self) -> None:
        if self._queue and self._under_way is None:
            number, self._sent = self._sent, self._sent + 1
            self._under_way = Advertised(self, number, self._queue.popleft())

    def _take(self, packet: Sent, power_dbm: float | None) -> None:
        """Take a *packet* that has come, and repeat it, unless it is known."""
        heard = decode_advertising(packet.pdu)
        assert isinstance(heard, Undirected)
        try:
            pdu = decode_network(decode_bearer(heard.data))
            known = pdu.ivi, pdu.source, pdu.sequence
            if pdu.source == element(self._address) or known in self._cache:
                return
            self._remember(known)
            payload = self._inbox.take(pdu, self._kernel.now)
        except WireError:
            return
        if payload is not None:
            self._hosts.arrive((self._address, payload, Reception(pdu.source - element(0), True, power_dbm)))
        if self.settings.relay and pdu.ttl >= 2 and self._relayed < self.settings.relay_buffers:
            self._relayed += 1
            self._queue.append(Queued(pdu._replace(ttl=pdu.ttl - 1), packet.length))
            self._next()

    def _remember(self, known: tuple[int, int, int]) -> None:
        while len(self._cache) >= self.settings.cache:
            del self._cache[next(iter(self._cache))]
        self._cache[known] = None
