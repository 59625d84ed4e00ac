"""A robot's radios: messages to be sent are encoded, counted and queued; those received are counted and decoded.

The energy is that which Feeney and Nilsson measured on a 2.4 GHz 802.11 card at 2 Mb/s ("Investigating the energy
consumption of a wireless network interface in an ad hoc networking environment", INFOCOM 2001, Table 1): linear in the
payload's bytes, with a constant that holds the MAC's own frames. Idling is left out.
"""

from typing import Final

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Event, LinkCommand, Outgoing, Reception
from protocols.aggregation.counters import Counters
from protocols.aggregation.frames import decode, encode
from protocols.aggregation.messages import Message
from protocols.wire import BadBytes

SHORT: Final = 0
"""Number of the radio within a sub-team."""
SEND_J: Final = (454e-6, 1.9e-6)
"""Energy of sending a unicast: joules per frame, and per byte."""
BROADCAST_J: Final = (266e-6, 1.9e-6)
RECEIVE_J: Final = (356e-6, 0.5e-6)
HEAR_J: Final = (56e-6, 0.5e-6)
"""Energy of receiving a broadcast."""


class Radio:
    """What one robot sends and receives."""

    def __init__(
        self, me: Address, counters: Counters, outbox: list[Outgoing | LinkCommand], events: list[Event]
    ) -> None:
        """Fill the machine's *outbox* and *events*."""
        self.me = me
        self._outbox = outbox
        self._counters = counters
        self._events = events

    def send(self, message: Message, destination: Address = BROADCAST, radio: int = SHORT) -> None:
        """Send *message* to one robot, or to all in reach, by one of the robot's radios."""
        data, counters = encode(self.me, message), self._counters
        counters.frames += 1
        counters.payload_bytes += len(data)
        frame_j, octet_j = BROADCAST_J if destination == BROADCAST else SEND_J
        counters.radio_j += frame_j + octet_j * len(data)
        self._outbox.append(Outgoing(destination, data, None, radio))

    def receive(self, data: bytes, reception: Reception) -> tuple[Address, Message] | None:
        """Return sender and message; None for the robot's own frames, and None with an event for bad bytes."""
        frame_j, octet_j = HEAR_J if reception.broadcast else RECEIVE_J
        self._counters.radio_j += frame_j + octet_j * len(data)
        try:
            heard = decode(data)
        except WireError:
            self._events.append(BadBytes(reception.source, len(data)))
            return None
        return None if heard[0] == self.me else heard
