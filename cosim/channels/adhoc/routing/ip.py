"""IPv4 and UDP, as far as routed networks of robots need them (RFC 791, RFC 768): no options, no fragments.

Robot n has the address 10.0.(n div 250).(1 + n mod 250). A packet to all in reach goes to 255.255.255.255.
"""

from functools import cache
from struct import Struct
from typing import Final, NamedTuple

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address

NET: Final = 10 << 24
ALL: Final = 0xFFFFFFFF
UDP: Final = 17
PAYLOAD_PORT: Final = 50_000
"""Port of the payloads of hosts."""
AODV_PORT: Final = 654
OLSR_PORT: Final = 698
HEADER_OCTETS: Final = 28
"""Length of the headers of IPv4 and UDP."""
_IP: Final = Struct(">BBHHHBBHII")
_HEADERS: Final = Struct(f"{_IP.format}HHHH")
_FIRST: Final = 0x45
"""The first octet of IPv4 without options."""
_PER_BLOCK: Final = 250
_KNOWN: Final = 1024
"""The most packets of which the datagram is remembered."""
_known: dict[bytes, "Datagram"] = {}


class Datagram(NamedTuple):
    """A UDP datagram in an IPv4 packet."""

    source: Address
    destination: Address
    """Receiver; BROADCAST for all in reach."""
    ttl: int
    port: int
    """Port of both sender and receiver."""
    number: int
    """Identification field, mod 65536, which identifies a packet together with its source."""
    data: bytes


@cache
def ip_of(address: Address) -> int:
    """Return the IPv4 address of a robot as a number of 32 bits."""
    return ALL if address == BROADCAST else NET | address // _PER_BLOCK << 8 | 1 + address % _PER_BLOCK


@cache
def robot_of(ip: int) -> Address:
    """Return the robot with the IPv4 address *ip*; raise WireError if there is none."""
    if ip == ALL:
        return BROADCAST
    block, place = ip >> 8 & 0xFF, ip & 0xFF
    if ip & 0xFFFF0000 != NET or not 1 <= place <= _PER_BLOCK:
        raise WireError(f"{ip:#010x} is no address of a robot")
    return block * _PER_BLOCK + place - 1


def encode(datagram: Datagram) -> bytes:
    """Return the packet of *datagram*."""
    if datagram.number > 0xFFFF:
        datagram = datagram._replace(number=datagram.number & 0xFFFF)
    source, destination, ttl, port, number, data = datagram
    length = HEADER_OCTETS + len(data)
    one, other = ip_of(source), ip_of(destination)
    rest = checksum((_FIRST << 8) + length + number + (ttl << 8 | UDP) + one + other)
    udp = port, port, length - _IP.size, 0  # 0: no checksum, the FCS has one
    packet = _HEADERS.pack(_FIRST, 0, length, number, 0, ttl, UDP, rest, one, other, *udp) + data
    _remember(packet, datagram)
    return packet


def _remember(packet: bytes, datagram: Datagram) -> None:
    if len(_known) == _KNOWN:
        _known.clear()
    _known[packet] = datagram


def decode(packet: bytes) -> Datagram:
    """Return the datagram in *packet*; raise WireError for what ``encode`` would not have made.

    It has been encoded here or decoded for another robot lately, mostly: then it is known.
    """
    datagram = _known.get(packet)
    if datagram is None:
        datagram = _decoded(packet)
        _remember(packet, datagram)
    return datagram


def _decoded(packet: bytes) -> Datagram:
    if len(packet) < HEADER_OCTETS:
        raise WireError(f"{len(packet)} octets are no UDP datagram")
    fields = _HEADERS.unpack_from(packet)
    first, service, length, number, fragment, ttl, protocol, rest, one, other, port, to_port, udp_length, _ = fields
    if first != _FIRST or protocol != UDP or fragment or length != len(packet):
        raise WireError("an IPv4 header that no robot sends")
    if checksum((_FIRST << 8 | service) + length + number + (ttl << 8 | UDP) + rest + one + other):
        raise WireError("an IPv4 header with a wrong checksum")
    if to_port != port or udp_length != length - _IP.size:
        raise WireError("a UDP header that no robot sends")
    return Datagram(robot_of(one), robot_of(other), ttl, port, number, packet[HEADER_OCTETS:])


def checksum(total: int) -> int:
    """Return the Internet checksum (RFC 1071) of numbers of 16, 32 or more bits of which *total* is the sum.

    It is 0 if the checksum is among them.
    """
    return 0xFFFF - (total % 0xFFFF or (0xFFFF if total else 0))  # their words added up, and carries to that again
