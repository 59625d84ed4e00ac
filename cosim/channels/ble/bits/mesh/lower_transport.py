"""The lower transport layer of Bluetooth Mesh: access messages, whole or in segments (Mesh Profile 1.0, 3.5.2).

    SEG 0, AKF 1 bit, AID 6 bits | upper transport PDU, 5 to 15 octets
    SEG 1, AKF 1 bit, AID 6 bits | SZMIC 1 bit, SeqZero 13 bits, SegO 5 bits, SegN 5 bits | segment, 1 to 12 octets

All segments but the last are full. SeqZero are the lower bits of the sequence number of the first of them.
"""

from typing import Final, NamedTuple, TypeAlias

from cosim.errors import WireError

MOST_WHOLE: Final = 15
"""Octets of the longest upper transport PDU that is not segmented."""
LEAST_WHOLE: Final = 5
SEGMENT_OCTETS: Final = 12
"""Octets of each segment but the last."""
MOST_SEGMENTS: Final = 32
SEQ_ZEROS: Final = 1 << 13
_HEADER_OCTETS: Final = 4
_IDS: Final = 1 << 6


class Whole(NamedTuple):
    """An unsegmented access message."""

    upper: bytes
    """The upper transport PDU."""
    key: int | None = None
    """AID: tells the application's key that encrypts it; None (AKF 0) for that of the device."""


class Segment(NamedTuple):
    """A segment of an access message."""

    seq_zero: int
    number: int
    """SegO, from 0 on."""
    last: int
    """SegN: number of the last one."""
    data: bytes
    key: int | None = None
    """AID: tells the application's key that encrypts it; None (AKF 0) for that of the device."""
    long_mic: bool = False
    """SZMIC: True if TransMIC has 64 bits, not 32."""


LowerPdu: TypeAlias = Whole | Segment


def _fault(pdu: LowerPdu) -> str | None:
    """Return why *pdu* is none, or None."""
    if isinstance(pdu, Whole):
        fits = LEAST_WHOLE <= len(pdu.upper) <= MOST_WHOLE
        return None if fits else f"an unsegmented message of {len(pdu.upper)} octets"
    if pdu.number > pdu.last:
        return f"segment {pdu.number} of 0 to {pdu.last}"
    least = 1 if pdu.number == pdu.last else SEGMENT_OCTETS
    return None if least <= len(pdu.data) <= SEGMENT_OCTETS else f"a segment of {len(pdu.data)} octets"


def encode_lower(pdu: LowerPdu) -> bytes:
    """Return the octets of *pdu*; raise ValueError for what does not fit."""
    if pdu.key is not None and not 0 <= pdu.key < _IDS:
        raise ValueError(f"AID {pdu.key}")
    if fault := _fault(pdu):
        raise ValueError(fault)
    key = 0 if pdu.key is None else 0x40 | pdu.key
    if isinstance(pdu, Whole):
        return bytes([key]) + pdu.upper
    if not 0 <= pdu.seq_zero < SEQ_ZEROS or pdu.number < 0 or pdu.last >= MOST_SEGMENTS:
        raise ValueError(f"SeqZero {pdu.seq_zero}, segment {pdu.number} of 0 to {pdu.last}")
    word = pdu.long_mic << 23 | pdu.seq_zero << 10 | pdu.number << 5 | pdu.last
    return bytes([0x80 | key]) + word.to_bytes(3, "big") + pdu.data


def decode_lower(octets: bytes) -> LowerPdu:
    """Return the access message, or the segment of one, in *octets*; raise WireError, and nothing else, if none."""
    if not octets:
        raise WireError("no lower transport PDU")
    key = octets[0] & _IDS - 1 if octets[0] & 0x40 else None
    pdu: LowerPdu = Whole(octets[1:], key)
    if octets[0] & 0x80:
        if len(octets) < _HEADER_OCTETS:
            raise WireError("a segment that is cut off")
        word = int.from_bytes(octets[1:_HEADER_OCTETS], "big")
        data = octets[_HEADER_OCTETS:]
        pdu = Segment(word >> 10 & SEQ_ZEROS - 1, word >> 5 & 31, word & 31, data, key, bool(word >> 23))
    if fault := _fault(pdu):
        raise WireError(fault)
    return pdu


def segments(upper: bytes, sequence: int, key: int | None = None) -> list[LowerPdu]:
    """Return an *upper* transport PDU, whole if it fits, else in segments, the first of which has number *sequence*.

    Raise ValueError if it is too long.
    """
    if len(upper) <= MOST_WHOLE:
        return [Whole(upper, key)]
    parts = [upper[at : at + SEGMENT_OCTETS] for at in range(0, len(upper), SEGMENT_OCTETS)]
    if len(parts) > MOST_SEGMENTS:
        raise ValueError(f"a message of {len(upper)} octets")
    return [Segment(sequence % SEQ_ZEROS, at, len(parts) - 1, part, key) for at, part in enumerate(parts)]
