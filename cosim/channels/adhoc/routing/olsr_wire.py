"""OLSR packets as bytes (RFC 3626, sections 3.3, 6.1, 9.1 and 18.3).

A packet is a header of four octets (length, packet number) and messages. A message is a header of twelve octets and a
body. Bodies of HELLO and TC are decoded here. Those of MID and HNA are not: robots have one interface, and no other
network behind them. Like any unknown kind they are passed on as they are.

Times are one octet, 16 a + b, for (1 + a / 16) 2^b times C = 1/16 s.
"""

from collections.abc import Mapping, Sequence
from struct import Struct
from typing import Final, NamedTuple

from cosim.channels.adhoc.routing.ip import ip_of, robot_of
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address
from cosim.units import S, Time

HELLO: Final = 1
TC: Final = 2

UNSPEC_LINK: Final = 0
ASYM_LINK: Final = 1
SYM_LINK: Final = 2
LOST_LINK: Final = 3
NOT_NEIGH: Final = 0
SYM_NEIGH: Final = 1
MPR_NEIGH: Final = 2

WILL_NEVER: Final = 0
WILL_DEFAULT: Final = 3
WILL_ALWAYS: Final = 7

SHORTEST: Final = S // 16
"""Shortest time that can be encoded, C."""
LONGEST: Final = (SHORTEST * 31 // 16) << 15
"""Longest time that can be encoded, 3968 s."""
_PACKET: Final = Struct(">HH")
_MESSAGE: Final = Struct(">BBHIBBH")
_HELLO: Final = Struct(">HBB")
_LINK: Final = Struct(">BBH")
_TC: Final = Struct(">HH")
_ADDRESS_OCTETS: Final = 4


class Message(NamedTuple):
    """One message with its header."""

    kind: int
    validity: Time
    """Vtime: time for which its contents are valid."""
    origin: Address
    ttl: int
    hops: int
    """Number of hops that it has made."""
    number: int
    """Message sequence number, which identifies a message together with *origin*."""
    body: bytes


class Hello(NamedTuple):
    """The body of a HELLO."""

    interval: Time
    """Htime: longest time until the next HELLO."""
    willingness: int
    links: Mapping[int, Sequence[Address]]
    """Neighbours by link code."""


class Tc(NamedTuple):
    """The body of a TC: robots that can be reached over its origin."""

    ansn: int
    """Sequence number of the set; a set with a greater one replaces it."""
    neighbours: Sequence[Address]


def link_code(link: int, neighbour: int) -> int:
    """Return the code of a type of link and a type of neighbour (6.1.1)."""
    return neighbour << 2 | link


def link_types(code: int) -> tuple[int, int] | None:
    """Return types of link and neighbour; None for a code to be ignored: unknown, or a contradiction (6.1.1)."""
    link, neighbour = code & 3, code >> 2
    if neighbour > MPR_NEIGH or (link == SYM_LINK and neighbour == NOT_NEIGH):
        return None
    return link, neighbour


def encode_time(time: Time) -> int:
    """Return the octet for *time*, rounded up; raise ValueError if there is none (18.3)."""
    if not SHORTEST <= time <= LONGEST:
        raise ValueError(f"{time} ns is not in {SHORTEST}..{LONGEST}")
    b = (time // SHORTEST).bit_length() - 1
    a = -(-16 * (time - (SHORTEST << b)) // (SHORTEST << b))
    return (a << 4 | b) if a < 16 else b + 1


def decode_time(octet: int) -> Time:
    """Return the time that an octet stands for."""
    return SHORTEST // 16 * (16 + (octet >> 4)) << (octet & 15)


def encode_packet(number: int, messages: Sequence[Message]) -> bytes:
    """Return the packet with *messages*."""
    parts = []
    for kind, validity, origin, ttl, hops, message_number, body in messages:
        size = _MESSAGE.size + len(body)
        parts.append(_MESSAGE.pack(kind, encode_time(validity), size, ip_of(origin), ttl, hops, message_number))
        parts.append(body)
    data = b"".join(parts)
    return _PACKET.pack(_PACKET.size + len(data), number) + data


def decode_packet(data: bytes) -> tuple[int, list[Message]]:
    """Return the number of the packet and its messages; raise WireError if *data* is no packet."""
    if len(data) < _PACKET.size:
        raise WireError(f"{len(data)} octets are no OLSR packet")
    length, number = _PACKET.unpack_from(data)
    if length != len(data):
        raise WireError(f"a packet of {len(data)} octets that claims {length}")
    messages, at = [], _PACKET.size
    while at < len(data):
        if at + _MESSAGE.size > len(data):
            raise WireError("a message header that is cut off")
        kind, validity, size, origin, ttl, hops, message_number = _MESSAGE.unpack_from(data, at)
        if size < _MESSAGE.size or at + size > len(data):
            raise WireError(f"a message of {size} octets at {at} of {len(data)}")
        body = data[at + _MESSAGE.size : at + size]
        messages.append(Message(kind, decode_time(validity), _robot(origin), ttl, hops, message_number, body))
        at += size
    return number, messages


def encode_hello(hello: Hello) -> bytes:
    """Return the body of a HELLO."""
    parts = [_HELLO.pack(0, encode_time(hello.interval), hello.willingness)]
    for code, addresses in hello.links.items():
        parts.append(_LINK.pack(code, 0, _LINK.size + _ADDRESS_OCTETS * len(addresses)))
        parts.append(_encode_addresses(addresses))
    return b"".join(parts)


def decode_hello(body: bytes) -> Hello:
    """Return the HELLO of *body*; raise WireError if it makes no sense."""
    if len(body) < _HELLO.size:
        raise WireError(f"{len(body)} octets are no HELLO")
    _, interval, willingness = _HELLO.unpack_from(body)
    if willingness > WILL_ALWAYS:
        raise WireError(f"willingness {willingness} is not in 0..{WILL_ALWAYS}")
    links: dict[int, list[Address]] = {}
    at = _HELLO.size
    while at < len(body):
        if at + _LINK.size > len(body):
            raise WireError("a link message that is cut off")
        code, _, size = _LINK.unpack_from(body, at)
        if size < _LINK.size or at + size > len(body):
            raise WireError(f"a link message of {size} octets at {at} of {len(body)}")
        links.setdefault(code, []).extend(_decode_addresses(body[at + _LINK.size : at + size]))
        at += size
    return Hello(decode_time(interval), willingness, links)


def encode_tc(tc: Tc) -> bytes:
    """Return the body of a TC."""
    return _TC.pack(tc.ansn, 0) + _encode_addresses(tc.neighbours)


def decode_tc(body: bytes) -> Tc:
    """Return the TC of *body*; raise WireError if it makes no sense."""
    if len(body) < _TC.size:
        raise WireError(f"{len(body)} octets are no TC")
    return Tc(_TC.unpack_from(body)[0], _decode_addresses(body[_TC.size :]))


def newer(one: int, other: int) -> bool:
    """Return whether sequence number *one* comes after *other*, though both wrap around at 65536 (section 19)."""
    half = 1 << 15
    return (one > other and one - other <= half) or (other > one and other - one > half)


def _encode_addresses(addresses: Sequence[Address]) -> bytes:
    return b"".join(ip_of(address).to_bytes(_ADDRESS_OCTETS, "big") for address in addresses)


def _decode_addresses(data: bytes) -> list[Address]:
    if len(data) % _ADDRESS_OCTETS:
        raise WireError(f"{len(data)} octets are no addresses")
    starts = range(0, len(data), _ADDRESS_OCTETS)
    return [_robot(int.from_bytes(data[at : at + _ADDRESS_OCTETS], "big")) for at in starts]


def _robot(ip: int) -> Address:
    if (address := robot_of(ip)) == BROADCAST:
        raise WireError("all robots at once are no node")
    return address
