"""A robot's radios: messages to be sent are encoded, counted and queued; those received are counted and decoded.

The energy is that which Feeney and Nilsson measured on a 2.4 GHz 802.11 card at 2 Mb/s ("Investigating the energy
consumption of a wireless network interface in an ad hoc networking environment", INFOCOM 2001, Table 1): linear in the
payload's bytes, with a constant that holds the MAC's own frames. Idling is left out.

Where radios need links, the host of the only sub-team is the master of a piconet, and its searchers are slaves. Nothing
is sent without a link: hosts repeat what they say with their heartbeats, and searchers answer these.
"""

from typing import Final

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Event, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.units import Time
from protocols.aggregation.counters import Counters
from protocols.aggregation.frames import decode, encode
from protocols.aggregation.messages import Message
from protocols.aggregation.parameters import Parameters
from protocols.transport.links import Links
from protocols.wire import BadBytes

SHORT: Final = 0
"""Number of the radio within a sub-team."""
SEND_J: Final = (454e-6, 1.9e-6)
"""Energy of sending a unicast: joules per frame, and per byte."""
BROADCAST_J: Final = (266e-6, 1.9e-6)
RECEIVE_J: Final = (356e-6, 0.5e-6)
HEAR_J: Final = (56e-6, 0.5e-6)
"""Energy of receiving a broadcast."""


def links_of(parameters: Parameters, size: int, me: Address, start: Time) -> Links | None:
    """Return the part of robot *me* in the piconet of a team of *size*; None if the radio needs no links."""
    return None if parameters.links is None else Links.of_star(me, size, parameters.links, start)


class Radio:
    """What one robot sends and receives."""

    def __init__(
        self,
        me: Address,
        counters: Counters,
        outbox: list[Outgoing | LinkCommand],
        events: list[Event],
        links: Links | None = None,
    ) -> None:
        """Fill the machine's *outbox* and *events*; send over *links* if the radio needs any."""
        self.me = me
        self._links = links
        self._outbox = outbox
        self._counters = counters
        self._events = events

    def send(self, message: Message, destination: Address = BROADCAST, radio: int = SHORT) -> None:
        """Send *message* to one robot, or to all in reach, by one of the robot's radios; not if that lacks a link."""
        if not self._linked(destination):
            return
        data, counters = encode(self.me, message), self._counters
        counters.frames += 1
        counters.payload_bytes += len(data)
        frame_j, octet_j = BROADCAST_J if destination == BROADCAST else SEND_J
        counters.radio_j += frame_j + octet_j * len(data)
        self._outbox.append(Outgoing(destination, data, None, radio))

    def _linked(self, destination: Address) -> bool:
        """Return whether there is a link on the way to *destination*, if the radio needs any."""
        if self._links is None:
            return True
        hop = self._links.audience if destination == BROADCAST else self._links.hop(destination)
        return hop is not None

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

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Take an event of a link, if there are links; return whether anything has come of it."""
        if self._links is None:
            return False
        self._links.link(event, now)
        return self._command()

    def keep_links(self, now: Time) -> None:
        """Have robots without a link paged when that is due, if there are links."""
        if self._links is not None:
            self._links.tick((), now)
            self._command()

    def _command(self) -> bool:
        commands = [] if self._links is None else self._links.drain()
        self._outbox += commands
        return bool(commands)
