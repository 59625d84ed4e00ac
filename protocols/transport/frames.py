"""The frames of transports on the wire: parts of messages, acknowledgements of them, and publications.

Every frame is big-endian: magic, kind, author, destination, the author's incarnation, the body of its kind, and a
CRC-16 (see ``protocols.wire``). The paper (004) has "a TCP/IP socket" between executive and robots, and prints no
formats.
"""

from binascii import crc_hqx
from functools import lru_cache
from struct import Struct, error
from typing import Final, NamedTuple, TypeAlias

from cosim.errors import LocalProtocolError, WireError
from cosim.machine import Address
from cosim.units import MS, Time
from protocols.wire import CRC_BYTES, CRC_START, seal

MAGIC: Final = 0x4C
ALL: Final[Address] = 0xFF
"""Destination of publications on the wire: no robot has that address."""
INCARNATIONS: Final = 1 << 32
"""Bound of the numbers of incarnations: milliseconds of 49 days."""
WINDOW: Final = 32
"""Number of parts beyond the first gap that an acknowledgement reports."""
MOST_PARTS: Final = 0xFFFF
"""Greatest number of parts of one message."""
MOST_OCTETS: Final = 0xFFFF
SEQUENCE: Final = 1 << 32
"""Bound of the numbers of parts: a robot that sends 100 a second from boot to death counts for more than a year."""

_HEAD: Final = Struct(">BBBBI")
_PART: Final = Struct(">IIHH")
_ACK: Final = Struct(">III")
_PUBLICATION: Final = Struct(">BI")
_PART_KIND: Final = 1
_ACK_KIND: Final = 2
_PUBLICATION_KIND: Final = 3
_LAYOUTS: Final = {_PART_KIND: _PART, _ACK_KIND: _ACK, _PUBLICATION_KIND: _PUBLICATION}
PART_OVERHEAD: Final = _HEAD.size + _PART.size + CRC_BYTES
"""Bytes of a part beyond its payload."""
PUBLICATION_OVERHEAD: Final = _HEAD.size + _PUBLICATION.size + CRC_BYTES
"""Bytes of a publication beyond its payload."""
LEAST_OCTETS: Final = max(PART_OVERHEAD + 1, _HEAD.size + _ACK.size + CRC_BYTES)
"""Bytes of the shortest frame that is of use."""


class Part(NamedTuple):
    """Part of a message: the *number*-th, from 0, that its author has for this destination in this incarnation."""

    number: int
    oldest: int
    """The first part of the oldest message that its author has not given up: no part before it comes any more."""
    place: int
    """Position of the part in its message, from 0."""
    parts: int
    """Number of parts of the message, one at least."""
    payload: bytes


class Ack(NamedTuple):
    """What has arrived of the parts that the destination has sent in its incarnation *of*."""

    of: int
    next: int
    """All parts with smaller numbers have arrived, or are no longer wanted."""
    beyond: int
    """Bit i: part ``next + 1 + i`` has arrived as well."""


class Publication(NamedTuple):
    """A value for all who receive it: of each *topic* only the latest counts, that with the greatest *number*."""

    topic: int
    number: int
    payload: bytes


Body: TypeAlias = Part | Ack | Publication


class Frame(NamedTuple):
    """A body with its author, its destination, and the incarnation of its author."""

    author: Address
    destination: Address
    """``ALL`` for publications."""
    incarnation: int
    """When the author was booted: milliseconds of its clock, mod 2**32."""
    body: Body


def incarnation_of(start: Time) -> int:
    """Return the number of the incarnation that begins at *start*."""
    return start // MS % INCARNATIONS


def encode(frame: Frame) -> bytes:
    """Return *frame* as bytes; raise LocalProtocolError for values that no frame can have."""
    author, destination, incarnation, body = frame
    try:
        match body:
            case Part(number, oldest, place, parts, payload):
                kind, packed = _PART_KIND, _PART.pack(number, oldest, place, parts) + payload
            case Ack(of, following, beyond):
                kind, packed = _ACK_KIND, _ACK.pack(of, following, beyond)
            case Publication(topic, number, payload):
                kind, packed = _PUBLICATION_KIND, _PUBLICATION.pack(topic, number) + payload
        data = _HEAD.pack(MAGIC, kind, author, destination, incarnation) + packed
    except error as wrong:
        raise LocalProtocolError(f"{frame} does not fit into a frame: {wrong}") from None
    if not _sound(frame):
        raise LocalProtocolError(f"{frame} means nothing")
    return seal(data)


@lru_cache(maxsize=16)  # all who hear a broadcast decode the same bytes
def decode(data: bytes) -> Frame:
    """Return the frame that *data* is; raise WireError for bytes that are no frame of a transport."""
    if len(data) < _HEAD.size + CRC_BYTES:
        raise WireError("too short for a head")
    if crc_hqx(data, CRC_START):  # as protocols.wire.check: bytes that end with their CRC have the CRC 0
        raise WireError("the CRC does not fit")
    magic, kind, author, destination, incarnation = _HEAD.unpack_from(data)
    if magic != MAGIC:
        raise WireError(f"magic {magic:#x}")
    frame = Frame(author, destination, incarnation, _body(kind, data[_HEAD.size : -CRC_BYTES]))
    if not _sound(frame):
        raise WireError(f"a frame of kind {kind} that means nothing")
    return frame


def _body(kind: int, data: bytes) -> Body:
    layout = _LAYOUTS.get(kind)
    if layout is None:
        raise WireError(f"kind {kind}")
    if len(data) < layout.size or (kind == _ACK_KIND and len(data) > layout.size):
        raise WireError(f"{len(data)} bytes in a frame of kind {kind}")
    rest = data[layout.size :]
    if kind == _PART_KIND:
        number, oldest, place, parts = layout.unpack_from(data)
        return Part(number, oldest, place, parts, rest)
    if kind == _PUBLICATION_KIND:
        topic, number = layout.unpack_from(data)
        return Publication(topic, number, rest)
    return Ack(*layout.unpack(data))


def _sound(frame: Frame) -> bool:
    """Return whether a frame with such values can mean anything."""
    body = frame.body
    if isinstance(body, Publication):
        return frame.author != ALL == frame.destination
    if ALL in (frame.author, frame.destination) or frame.author == frame.destination:
        return False
    if isinstance(body, Ack):
        return True
    begins = body.number - body.place
    return body.place < body.parts and begins >= 0 and body.oldest <= body.number
