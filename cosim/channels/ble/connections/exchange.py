"""One connection event, packet by packet (Core v5.0, Vol 6 Part B, 4.5.1, 4.5.6).

The central sends at the anchor, the peripheral answers T_IFS after the end of each of its packets, whatever the CRC
said, and the central goes on T_IFS later. The event ends

- with a packet that was not heard (access address or header missed),
- with the second packet in a row that one end heard with a wrong CRC,
- when neither end has more: MD = 0 in both last packets. After an answer with a wrong CRC the central goes on only if
  its own MD was 1, as NimBLE does,
- when another exchange would not end, with T_IFS after it, by the instant until which there is time.

The central counts on an empty answer, or on the packet that the peripheral has to send again. The peripheral sends what
fits, or an empty packet. In an event's first exchange the central, too, sends an empty packet where a new one does not
fit, so that the connection lives on. PDUs have to be cut such that exchanges fit at all.
"""

from collections.abc import Callable
from enum import Enum, IntEnum
from typing import NamedTuple

from cosim.channels.ble.bits.pdu import DataPdu
from cosim.channels.ble.connections.arq import EMPTY, Arq, Fragment, Heard
from cosim.channels.ble.phy import T_IFS, Phy
from cosim.errors import LocalProtocolError
from cosim.units import Time


def exchange_time(down: Phy, octets_down: int, up: Phy, octets_up: int) -> Time:
    """Return the time in ns from the start of a packet with *octets_down* to when the one after its answer may start.

    *down* and *up* are the PHYs of the central's and of the peripheral's packets.
    """
    return down.air_time(octets_down) + T_IFS + up.air_time(octets_up) + T_IFS


class Side(IntEnum):
    """An end of a connection."""

    CENTRAL = 0
    PERIPHERAL = 1


class Reception(Enum):
    """What the other end made of a packet."""

    HEARD = "heard"
    MISSED = "missed"
    """Access address or header not recognised, or nobody listened."""
    BAD_CRC = "bad_crc"


class Packet(NamedTuple):
    """A packet on the air."""

    start: Time
    air: Time
    sender: Side
    pdu: DataPdu

    @property
    def end(self) -> Time:
        """The end of its last bit."""
        return self.start + self.air


class ConnectionEvent:
    """One event, from its *anchor* on, with time for it *until* then; *ends* and *phys* by the side that sends.

    Whoever runs it tells what became of each ``packet`` until there is none. *listening*: whether the peripheral is
    there to hear the first one.
    """

    def __init__(
        self, ends: tuple[Arq, Arq], phys: tuple[Phy, Phy], anchor: Time, until: Time, listening: bool = True
    ) -> None:
        self.anchor = anchor
        self.packet: Packet | None = None
        """What is on the air; None once the event has ended, or if it has no time at all."""
        self.anchored = False
        """True if the peripheral has heard the first packet, whatever the CRC said."""
        self.last_heard: list[Time | None] = [None, None]
        """End of the last packet with a right CRC that each side has heard."""
        self.quiet = False
        """True if the last packet with a right CRC that the peripheral has heard had MD = 0."""
        self._ends, self._phys = ends, phys
        self.listening = listening
        """True if the peripheral is there to hear the first packet."""
        self._until = until
        self._more = [True, True]  # MD that each side has last sent, as far as the central knows
        self._wrong = [0, 0]  # packets in a row that each side heard with a wrong CRC
        self._before: Packet | None = None  # the packet that has ended, if another one may follow it
        self._begin(anchor)

    def ended(self, reception: Reception, room: bool = True) -> Heard:
        """Take what the other end made of the packet on the air, at its end, and put the next one on the air."""
        heard = self.hear(reception, room)
        self.go_on()
        return heard

    def hear(self, reception: Reception, room: bool = True) -> Heard:
        """Take what the other end made of the packet on the air, at its end.

        *room*: whether that end has room for what is new. Raise LocalProtocolError without a packet on the air.
        """
        packet = self.packet
        if packet is None:
            raise LocalProtocolError("no packet is on the air")
        receiver = Side(1 - packet.sender)
        self.packet, heard = None, Heard()
        if reception is Reception.MISSED or (packet.sender is Side.CENTRAL and not self.listening):
            return heard
        self.anchored = True
        if reception is Reception.HEARD:
            self._wrong[receiver] = 0
            self.last_heard[receiver] = packet.end
            heard = self._ends[receiver].receive(packet.pdu, room)
        else:
            self._wrong[receiver] += 1
        self._note(packet, reception)
        if self._wrong[receiver] < 2:
            self._before = packet
        return heard

    def go_on(self) -> None:
        """Put the next packet on the air, if the event has not ended with the one before."""
        packet, self._before = self._before, None
        if packet is None:
            return
        if packet.sender is Side.CENTRAL:
            self._answer(packet.end + T_IFS)
        elif any(self._more):
            self._begin(packet.end + T_IFS)

    def _note(self, packet: Packet, reception: Reception) -> None:
        if packet.sender is Side.CENTRAL:
            self._more[Side.CENTRAL] = packet.pdu.more
            if reception is Reception.HEARD:
                self.quiet = not packet.pdu.more
        else:
            self._more[Side.PERIPHERAL] = packet.pdu.more and reception is Reception.HEARD

    def _answer(self, start: Time) -> None:
        """Put the peripheral's packet on the air at *start*."""
        fragment = self._ends[Side.PERIPHERAL].next()
        if start + self._air(Side.PERIPHERAL, fragment) + T_IFS > self._until:
            fragment = EMPTY  # one that is sent again fits: the central has counted on it
        self._send(Side.PERIPHERAL, start, fragment)

    def _begin(self, start: Time) -> None:
        """Put the central's packet on the air at *start*, if there is time for it and the answer."""
        end, answer = self._ends[Side.CENTRAL], self._ends[Side.PERIPHERAL].sent or EMPTY
        rest = T_IFS + self._air(Side.PERIPHERAL, answer) + T_IFS
        fragments = [end.next()]
        if start == self.anchor and end.sent is None:
            fragments.append(EMPTY)
        for fragment in fragments:
            if start + self._air(Side.CENTRAL, fragment) + rest <= self._until:
                self._send(Side.CENTRAL, start, fragment)
                return

    def _send(self, side: Side, start: Time, fragment: Fragment) -> None:
        self.packet = Packet(start, self._air(side, fragment), side, self._ends[side].send(fragment))

    def _air(self, side: Side, fragment: Fragment) -> Time:
        return self._phys[side].air_time(len(fragment.payload))


def run_event(event: ConnectionEvent, heard: Callable[[Packet], Reception]) -> list[tuple[Packet, Reception, Heard]]:
    """Run a whole *event*; *heard* says what the other end makes of each packet. Return them in order."""
    packets = []
    while (packet := event.packet) is not None:
        reception = heard(packet)
        packets.append((packet, reception, event.ended(reception)))
    return packets
