"""L2CAP messages cut into data PDUs and put together again (Core v5.0, Vol 3 Part A, 3.1 and 7.2; Vol 6 Part B, 2.4.1).

A message is a header of four octets, its length and its channel, both least significant octet first, and the
information. Its first fragment has LLID 2, the others LLID 1.
"""

from struct import Struct
from typing import Final, NamedTuple

from cosim.channels.ble.bits.pdu import Llid
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.phy import Phy
from cosim.errors import WireError
from cosim.units import US, Time

_HEADER: Final = Struct("<HH")
HEADER_OCTETS: Final = _HEADER.size
LONGEST_INFORMATION: Final = 65_535
ATTRIBUTES: Final = 0x0004
"""The channel of the attribute protocol."""
LEAST_OCTETS: Final = 27
"""Payload that every device can send and receive, and the longest one until lengths have been exchanged."""
MOST_OCTETS: Final = 251
LEAST_TIME: Final[Time] = 328 * US
"""connMaxTxTime until lengths have been exchanged: a packet of 27 octets with a message integrity check on LE 1M."""
LEAST_TIME_CODED: Final[Time] = 2_704 * US
"""The same on LE Coded, S = 8."""
MOST_TIME: Final[Time] = 2_120 * US
MOST_TIME_CODED: Final[Time] = 17_040 * US
MIC_OCTETS: Final = 4
"""The message integrity check, for which lengths in time leave room, encrypted or not."""


class Message(NamedTuple):
    """An L2CAP message."""

    channel: int
    information: bytes


def longest_payload(phy: Phy, octets: int, time: Time) -> int:
    """Return the longest payload of a data PDU, without its MIC, by connEffectiveMaxTxOctets and -Time; at least 27."""
    room = (time - phy.air_time(0)) // phy.octet - MIC_OCTETS
    return max(LEAST_OCTETS, min(octets, room, MOST_OCTETS))


def fragments(message: Message, longest: int, token: object = None) -> list[Fragment]:
    """Return *message* in fragments of at most *longest* octets; the last one has the *token*.

    Raise ValueError if the information is longer than 65535 octets, or *longest* is not from 27 to 251.
    """
    if not LEAST_OCTETS <= longest <= MOST_OCTETS:
        raise ValueError(f"data PDUs of {longest} octets")
    if len(message.information) > LONGEST_INFORMATION:
        raise ValueError(f"a message of {len(message.information)} octets")
    data = _HEADER.pack(len(message.information), message.channel) + message.information
    starts = range(0, len(data), longest)
    return [
        Fragment(
            Llid.CONTINUATION if start else Llid.START,
            data[start : start + longest],
            token if start == starts[-1] else None,
        )
        for start in starts
    ]


class Reassembly:
    """The message that comes in over one link."""

    def __init__(self) -> None:
        self._data = b""
        self._complete = True

    def take(self, fragment: Fragment) -> Message | None:
        """Take a data fragment, and return the message that it completes, if any.

        Raise WireError, and nothing else, for one that continues no message, that begins one before the last was
        complete, or that is longer than its message; it is dropped, with what has come of the message before.
        """
        begins, cut = fragment.llid is Llid.START, not self._complete
        if fragment.llid is Llid.CONTROL or begins == cut:
            self._data, self._complete = b"", True
            raise WireError("a fragment that does not belong to the message before")
        self._data += fragment.payload
        self._complete = False
        if len(self._data) < HEADER_OCTETS:
            return None
        length, channel = _HEADER.unpack_from(self._data)
        missing = HEADER_OCTETS + length - len(self._data)
        if missing > 0:
            return None
        data, self._data, self._complete = self._data, b"", True
        if missing < 0:
            raise WireError(f"{len(data)} octets of a message of {HEADER_OCTETS + length}")
        return Message(channel, data[HEADER_OCTETS:])
