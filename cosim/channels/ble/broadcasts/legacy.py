"""Payloads for everyone by legacy advertising: in each event an ADV_NONCONN_IND on all three primary channels.

The payload is in it, so whoever hears one of them has all of it. Nothing tells that it is the same as in the event
before, so it is heard again, and the host is not told again.
"""

from typing import Final

from cosim.channels.ble.bits.pdu import MAX_ADVERTISING_DATA
from cosim.channels.ble.broadcasts.events import Step, nonconnectable
from cosim.channels.ble.broadcasts.sets import PayloadSet
from cosim.channels.ble.broadcasts.structures import OVERHEAD, structure
from cosim.channels.ble.packets import Sent

LONGEST_LEGACY: Final = MAX_ADVERTISING_DATA - OVERHEAD
"""Octets of the longest payload."""


class LegacySet(PayloadSet):
    """A payload by legacy advertising."""

    def plan(self) -> list[Step]:
        """Return the packets of an event: all events are alike."""
        payload = self.outgoing.payload
        return nonconnectable(self.speaker.station.address, structure(payload), len(payload))

    def ended(self, packet: Sent, last: bool) -> None:
        """Have those who hear *packet* have the payload."""
        for listener, judgement in self.heard_by(packet):
            self.arrive(listener.address, judgement)
