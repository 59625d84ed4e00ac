"""The acknowledgement scheme of a connection: sequence bits of one end, and what it has to send (Core v5.0, 4.5.9).

Each end counts what it sends (SN) and what it expects (NESN), both modulo 2. A packet whose SN is the receiver's NESN
is new, another one an old copy. A packet whose NESN is the receiver's SN does not acknowledge what that one has sent
last, which is therefore sent again, an empty packet too; another one does, and the next PDU follows. There is no limit
to repetitions. A packet with a wrong CRC changes nothing.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from cosim.channels.ble.bits.pdu import DataPdu, Llid


class Fragment(NamedTuple):
    """What a PDU carries: a fragment of an L2CAP message, or a control PDU."""

    llid: Llid
    payload: bytes
    token: object = None
    """In the last fragment of a message: what the sender knows the message by."""


class Heard(NamedTuple):
    """What a packet brought to the end that heard it."""

    new: Fragment | None = None
    """What it carried, if that is new and not empty."""
    acknowledged: Fragment | None = None
    """What it acknowledges, if that is not an empty packet."""


EMPTY: Final = Fragment(Llid.CONTINUATION, b"")

RECEIVED: Final[dict[tuple[int, int, int, int], tuple[bool, bool, int, int]]] = {
    # own SN, NESN; its SN, NESN: acknowledges, is new; own SN, NESN
    (0, 0, 0, 0): (False, True, 0, 1),
    (0, 0, 0, 1): (True, True, 1, 1),
    (0, 0, 1, 0): (False, False, 0, 0),
    (0, 0, 1, 1): (True, False, 1, 0),
    (0, 1, 0, 0): (False, False, 0, 1),
    (0, 1, 0, 1): (True, False, 1, 1),
    (0, 1, 1, 0): (False, True, 0, 0),
    (0, 1, 1, 1): (True, True, 1, 0),
    (1, 0, 0, 0): (True, True, 0, 1),
    (1, 0, 0, 1): (False, True, 1, 1),
    (1, 0, 1, 0): (True, False, 0, 0),
    (1, 0, 1, 1): (False, False, 1, 0),
    (1, 1, 0, 0): (True, False, 0, 1),
    (1, 1, 0, 1): (False, False, 1, 1),
    (1, 1, 1, 0): (True, True, 0, 0),
    (1, 1, 1, 1): (False, True, 1, 0),
}
"""What a packet with a right CRC does to the end that hears it."""


@dataclass(slots=True)
class Arq:
    """One end of a connection: its sequence bits, the PDU that waits for its acknowledgement, and its queues."""

    sn: int = 0
    """transmitSeqNum."""
    nesn: int = 0
    """nextExpectedSeqNum."""
    sent: Fragment | None = None
    """What has been sent and is not acknowledged."""
    control: deque[Fragment] = field(default_factory=deque)
    """Control PDUs; they go before data."""
    data: deque[Fragment] = field(default_factory=deque)
    repeats: bool = False
    """True if what was sent last, not an empty packet, had been sent before."""
    transmissions: int = 0
    """Packets sent that were not empty, repetitions included."""
    duplicates: int = 0
    """Old copies heard that were not empty."""

    def push(self, fragment: Fragment) -> None:
        """Append what is to be sent, a control PDU before all data."""
        (self.control if fragment.llid is Llid.CONTROL else self.data).append(fragment)

    @property
    def more(self) -> bool:
        """True if anything waits to be sent for the first time."""
        return bool(self.control or self.data)

    @property
    def busy(self) -> bool:
        """True if anything waits to be sent or acknowledged that is not an empty packet."""
        return self.more or (self.sent is not None and self.sent != EMPTY)

    def next(self) -> Fragment:
        """Return what is to be sent next: the same again, the head of the queues, or EMPTY."""
        if self.sent is not None:
            return self.sent
        return next((queue[0] for queue in (self.control, self.data) if queue), EMPTY)

    def send(self, fragment: Fragment) -> DataPdu:
        """Return the PDU that carries *fragment*, which is that of :meth:`next`, or EMPTY instead of a new one."""
        self.repeats = self.sent is not None and fragment != EMPTY
        if self.sent is None:
            self.sent = fragment
            if fragment != EMPTY:
                (self.control or self.data).popleft()
        self.transmissions += fragment != EMPTY
        return DataPdu(fragment.llid, self.nesn, self.sn, self.more, fragment.payload)

    def receive(self, pdu: DataPdu, room: bool = True) -> Heard:
        """Take a PDU with a right CRC; without *room*, what is new is left to be sent again."""
        acknowledges, new, sn, nesn = RECEIVED[self.sn, self.nesn, pdu.sn, pdu.nesn]
        full = bool(pdu.payload) or pdu.llid is not Llid.CONTINUATION
        acknowledged = None
        if acknowledges and self.sent is not None:  # a peer may acknowledge what was never sent
            acknowledged, self.sent, self.sn = self.sent, None, sn
        if room or not full:
            self.nesn = nesn
        self.duplicates += full and not new
        return Heard(
            Fragment(pdu.llid, pdu.payload) if new and full and room else None,
            None if acknowledged == EMPTY else acknowledged,
        )
