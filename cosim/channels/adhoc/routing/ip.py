"""IPv4 and UDP, as far as routed networks of robots need them (RFC 791, RFC 768): no options, no fragments.

Robot n has the address 10.0.(n div 250).(1 + n mod 250). A packet to all in reach goes to 255.255.255.255.
"""

from functools import lru_cache
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
_UDP: Final = Struct(">HHHH")
_PER_BLOCK: Final = 250


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


def ip_of(address: Address) -> int:
    """Return the IPv4 address of a robot as a number of 32 bits."""
    return ALL if address == BROADCAST else NET | address // _PER_BLOCK << 8 | 1 + address % _PER_BLOCK


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
    source, destination, ttl, port, number, data = datagram
    length = _IP.size + _UDP.size + len(data)
    fields = (0x45, 0, length, number & 0xFFFF, 0, ttl, UDP)
    addresses = ip_of(source), ip_of(destination)
    header = _IP.pack(*fields, checksum(_IP.pack(*fields, 0, *addresses)), *addresses)
    return header + _UDP.pack(port, port, _UDP.size + len(data), 0) + data  # 0: no checksum, the FCS has one


@lru_cache(maxsize=64)  # a packet to all is decoded once, not once by every robot that it reaches
def decode(packet: bytes) -> Datagram:
    """Return the datagram in *packet*; raise WireError for what ``encode`` would not have made."""
    if len(packet) < _IP.size + _UDP.size:
        raise WireError(f"{len(packet)} octets are no UDP datagram")
    version, _, length, number, fragment, ttl, protocol, _, source, destination = _IP.unpack_from(packet)
    if version != 0x45 or protocol != UDP or fragment or length != len(packet) or checksum(packet[: _IP.size]):
        raise WireError("an IPv4 header that no robot sends")
    port, to_port, udp_length, _ = _UDP.unpack_from(packet, _IP.size)
    if to_port != port or udp_length != length - _IP.size:
        raise WireError("a UDP header that no robot sends")
    data = packet[_IP.size + _UDP.size :]
    return Datagram(robot_of(source), robot_of(destination), ttl, port, number, data)


def checksum(header: bytes) -> int:
    """Return the Internet checksum (RFC 1071) of an even number of octets; 0 over a header that contains its own."""
    octets = int.from_bytes(header, "big")
    total = octets % 0xFFFF or (0xFFFF if octets else 0)  # the sum of words of 16 bits, carries added to it again
    return 0xFFFF - total
