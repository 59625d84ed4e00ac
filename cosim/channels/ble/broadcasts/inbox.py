"""The messages of Bluetooth Mesh that come to a node: put together, and each taken once (Mesh Profile 1.0, 3.5.3).

A message is known by its source and its number, which is the sequence number of its only, or first, network PDU. Of a
source only what is newer than the newest whole message counts (replay protection, 3.8.8), and of messages in segments
only the newest: so a message that another one has overtaken is lost. To all nodes nothing is acknowledged: a message of
which a segment is missing never comes.
"""

from dataclasses import dataclass, field
from typing import Final

from cosim.channels.ble.bits.mesh.lower_transport import SEQ_ZEROS, Segment, Whole, decode_lower
from cosim.channels.ble.bits.mesh.network import NetworkPdu
from cosim.channels.ble.bits.mesh.upper_transport import decode_upper
from cosim.units import S, Time

INCOMPLETE: Final[Time] = 10 * S
"""Time without a new segment after which a message that is not whole is forgotten (3.5.3.4: at least 10 s)."""


@dataclass(slots=True)
class _Message:
    """A message of which segments are missing."""

    number: int
    last: int
    """Number of its last segment."""
    parts: dict[int, bytes] = field(default_factory=dict)
    """Its segments, by number."""
    forgotten: Time = 0


class Inbox:
    """What has come to one node."""

    def __init__(self) -> None:
        self._newest: dict[int, int] = {}
        """Number of the newest whole message, by source."""
        self._open: dict[int, _Message] = {}
        """The message that is being put together, by source."""

    def take(self, pdu: NetworkPdu, now: Time) -> bytes | None:
        """Return the user's payload that *pdu* completes; None if it is none, not whole, or not new.

        Raise WireError, and nothing else, for what is no message of a user.
        """
        if pdu.control:
            return None
        part = decode_lower(pdu.transport)
        number = pdu.sequence if isinstance(part, Whole) else _first(pdu.sequence, part)
        if number <= self._newest.get(pdu.source, -1):
            return None
        upper = part.upper if isinstance(part, Whole) else self._put_together(pdu.source, number, part, now)
        if upper is None:
            return None
        self._newest[pdu.source] = number
        return decode_upper(upper)

    def forget(self) -> None:
        """Forget what is not whole: the device is off. What has come is remembered."""
        self._open.clear()

    def _put_together(self, source: int, number: int, part: Segment, now: Time) -> bytes | None:
        """Return the message that *part*, of *source*, completes, if any."""
        message = self._open.get(source)
        if message is None or message.number < number or message.forgotten <= now:
            message = self._open[source] = _Message(number, part.last)
        if (message.number, message.last) != (number, part.last):
            return None
        if part.number not in message.parts:
            message.parts[part.number] = part.data
            message.forgotten = now + INCOMPLETE
        if len(message.parts) <= message.last:
            return None
        del self._open[source]
        return b"".join(message.parts[at] for at in range(message.last + 1))


def _first(sequence: int, part: Segment) -> int:
    """Return the number of the message of which *part*, in the network PDU *sequence*, is a segment."""
    return sequence - (sequence - part.seq_zero) % SEQ_ZEROS
