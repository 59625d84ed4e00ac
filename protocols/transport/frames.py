"""What couriers say to each other on the wire: parts of letters, acknowledgements of them, and news.

Every frame is big-endian: magic, kind, author, destination, the author's life, the body of its kind, and a CRC-16 (see
``protocols.wire``). The paper (004) has "a TCP/IP socket" between executive and robots, and prints no formats.
"""

from struct import Struct, error
from typing import Final, NamedTuple, TypeAlias

from cosim.errors import LocalProtocolError, WireError
from cosim.machine import Address
from cosim.units import MS, Time
from protocols.wire import CRC_BYTES, check, seal

MAGIC: Final = 0x4C
ALL: Final[Address] = 0xFF
"""The destination of news on the wire: no robot has that address."""
LIVES: Final = 1 << 32
"""Lives are smaller: milliseconds of 49 days."""
WINDOW: Final = 32
"""How many parts an acknowledgement tells of, beyond those without a gap."""
MOST_PARTS: Final = 0xFFFF
"""Parts of one letter are not more."""
MOST_OCTETS: Final = 0xFFFF
SEQUENCE: Final = 1 << 32
"""Numbers of parts are smaller: a robot that tells 100 a second from boot to death counts for more than a year."""

_HEAD: Final = Struct(">BBBBI")
_PART: Final = Struct(">IIHH")
_ACK: Final = Struct(">III")
_NEWS: Final = Struct(">BI")
_PART_KIND: Final = 1
_ACK_KIND: Final = 2
_NEWS_KIND: Final = 3
PART_OVERHEAD: Final = _HEAD.size + _PART.size + CRC_BYTES
"""Bytes of a part beyond what it carries."""
NEWS_OVERHEAD: Final = _HEAD.size + _NEWS.size + CRC_BYTES
"""Bytes of news beyond what they say."""
LEAST_OCTETS: Final = max(PART_OVERHEAD + 1, _HEAD.size + _ACK.size + CRC_BYTES)
"""Bytes of the shortest frame that is of use."""


class Part(NamedTuple):
    """Part of a letter: the *number*-th, from 0, that its author has for this destination in this life."""

    number: int
    oldest: int
    """The first part of the oldest letter that its author still stands by: nothing before it comes any more."""
    place: int
    """Which part of its letter it is, from 0."""
    parts: int
    """How many parts the letter has, one at least."""
    payload: bytes


class Ack(NamedTuple):
    """What has arrived of the parts that the destination has sent in its life *of*."""

    of: int
    next: int
    """All parts with smaller numbers have arrived, or are no longer wanted."""
    beyond: int
    """Bit i: part ``next + 1 + i`` has arrived as well."""


class Bulletin(NamedTuple):
    """News, which anybody may hear: of each *topic* only the latest counts, that with the greatest *number*."""

    topic: int
    number: int
    payload: bytes


Message: TypeAlias = Part | Ack | Bulletin


class Frame(NamedTuple):
    """A message with its address: who says it to whom, and in which life of its author."""

    author: Address
    destination: Address
    """``ALL`` for news."""
    life: int
    """When the author was booted: milliseconds of its clock, mod 2**32."""
    message: Message


def life_of(start: Time) -> int:
    """Return the life that begins at *start*."""
    return start // MS % LIVES


def encode(frame: Frame) -> bytes:
    """Return *frame* as bytes; raise LocalProtocolError for what no frame can say."""
    author, destination, life, message = frame
    try:
        match message:
            case Part(number, oldest, place, parts, payload):
                kind, body = _PART_KIND, _PART.pack(number, oldest, place, parts) + payload
            case Ack(of, following, beyond):
                kind, body = _ACK_KIND, _ACK.pack(of, following, beyond)
            case Bulletin(topic, number, payload):
                kind, body = _NEWS_KIND, _NEWS.pack(topic, number) + payload
        data = _HEAD.pack(MAGIC, kind, author, destination, life) + body
    except error as wrong:
        raise LocalProtocolError(f"{frame} does not fit into a frame: {wrong}") from None
    if not _sound(frame):
        raise LocalProtocolError(f"{frame} means nothing")
    return seal(data)


def decode(data: bytes) -> Frame:
    """Return the frame that *data* is; raise WireError for bytes that are none of ours."""
    check(data)
    if len(data) < _HEAD.size + CRC_BYTES:
        raise WireError("too short for a head")
    magic, kind, author, destination, life = _HEAD.unpack_from(data)
    if magic != MAGIC:
        raise WireError(f"magic {magic:#x}")
    frame = Frame(author, destination, life, _message(kind, data[_HEAD.size : -CRC_BYTES]))
    if not _sound(frame):
        raise WireError(f"a frame of kind {kind} that means nothing")
    return frame


def _message(kind: int, body: bytes) -> Message:
    layout = {_PART_KIND: _PART, _ACK_KIND: _ACK, _NEWS_KIND: _NEWS}.get(kind)
    if layout is None:
        raise WireError(f"kind {kind}")
    if len(body) < layout.size or (kind == _ACK_KIND and len(body) > layout.size):
        raise WireError(f"{len(body)} bytes in a frame of kind {kind}")
    rest = body[layout.size :]
    if kind == _PART_KIND:
        number, oldest, place, parts = layout.unpack_from(body)
        return Part(number, oldest, place, parts, rest)
    if kind == _NEWS_KIND:
        topic, number = layout.unpack_from(body)
        return Bulletin(topic, number, rest)
    return Ack(*layout.unpack(body))


def _sound(frame: Frame) -> bool:
    """Return whether a frame with such values can mean anything."""
    message = frame.message
    if isinstance(message, Bulletin):
        return frame.author != ALL == frame.destination
    if ALL in (frame.author, frame.destination) or frame.author == frame.destination:
        return False
    if isinstance(message, Ack):
        return True
    begins = message.number - message.place
    return message.place < message.parts and begins >= 0 and message.oldest <= message.number
