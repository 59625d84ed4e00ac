"""The messages of AODV to the bit (RFC 3561, section 5): route request, reply, error, and acknowledgement of a reply.

Reserved bits, and the flags J and R of multicast, are sent as 0 and ignored. No robot sends extensions (section 9) or
routes to subnets (a prefix size), so both are refused.
"""

from functools import lru_cache
from struct import Struct
from typing import Final, NamedTuple, TypeAlias

from cosim.channels.adhoc.routing.ip import ip_of, robot_of
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address

MOST_DESTINATIONS: Final = 255
"""Greatest number of destinations in one route error, by the width of DestCount."""
_RREQ, _RREP, _RERR, _RREP_ACK = 1, 2, 3, 4
_REQUEST: Final = Struct(">BBBBIIIII")
_REPLY: Final = Struct(">BBBBIIII")
_ERROR: Final = Struct(">BBBB")
_PAIR: Final = Struct(">II")
_GRATUITOUS, _ONLY, _UNKNOWN = 0x20, 0x10, 0x08
_ACK: Final = 0x40
_NO_DELETE: Final = 0x80


class Rreq(NamedTuple):
    """A route request (section 5.1), 24 octets."""

    hops: int
    """Hops from the originator to the robot that has sent this."""
    number: int
    """RREQ ID, 32 bits, which identifies a request together with the originator."""
    destination: Address
    sequence: int | None
    """Newest sequence number of the destination that is known on the way; None: none is (flag U)."""
    originator: Address
    originator_sequence: int
    gratuitous: bool = False
    """Flag G: a robot that answers for the destination informs the destination too."""
    destination_only: bool = False
    """Flag D: only the destination may answer."""


class Rrep(NamedTuple):
    """A route reply (section 5.2), 20 octets; broadcast by its destination it is a hello (section 6.9)."""

    hops: int
    """Hops from the robot that has sent this to the destination."""
    destination: Address
    sequence: int
    """Sequence number of the destination."""
    originator: Address
    """Robot whose request it answers."""
    lifetime_ms: int
    """Time for which the route may be used, ms."""
    ack: bool = False
    """Flag A: the receiver has to acknowledge it."""


class Rerr(NamedTuple):
    """A route error (section 5.3), 4 octets and 8 for every destination."""

    unreachable: tuple[tuple[Address, int], ...]
    """Destinations, at least one, and their sequence numbers."""
    no_delete: bool = False
    """Flag N: a local repair has found another way, so the route may still be used."""


class RrepAck(NamedTuple):
    """The acknowledgement of a route reply (section 5.4), 2 octets."""


Message: TypeAlias = Rreq | Rrep | Rerr | RrepAck


def encode_message(message: Message) -> bytes:
    """Return the octets of *message*."""
    match message:
        case Rreq():
            flags = _GRATUITOUS * message.gratuitous | _ONLY * message.destination_only
            flags |= _UNKNOWN * (message.sequence is None)
            destination = ip_of(message.destination), message.sequence or 0
            originator = ip_of(message.originator), message.originator_sequence
            return _REQUEST.pack(_RREQ, flags, 0, message.hops, message.number, *destination, *originator)
        case Rrep():
            destination, originator_ip = (ip_of(message.destination), message.sequence), ip_of(message.originator)
            flags, to = _ACK * message.ack, (originator_ip, message.lifetime_ms)
            return _REPLY.pack(_RREP, flags, 0, message.hops, *destination, *to)
        case Rerr():
            head = _ERROR.pack(_RERR, _NO_DELETE * message.no_delete, 0, len(message.unreachable))
            return head + b"".join(_PAIR.pack(ip_of(robot), number) for robot, number in message.unreachable)
        case RrepAck():
            return bytes((_RREP_ACK, 0))


@lru_cache(maxsize=64)  # a robot's hellos are the same again and again
def decode_message(data: bytes) -> Message:
    """Return the message of *data*; raise WireError if it is none, or one about no robot."""
    kind = data[0] if data else 0
    if kind == _RREQ and len(data) == _REQUEST.size:
        _, flags, _, hops, number, destination, sequence, originator, own = _REQUEST.unpack(data)
        asked, known = _robot(destination), None if flags & _UNKNOWN else sequence
        return Rreq(hops, number, asked, known, _robot(originator), own, bool(flags & _GRATUITOUS), bool(flags & _ONLY))
    if kind == _RREP and len(data) == _REPLY.size:
        _, flags, prefix, hops, destination, sequence, originator, lifetime = _REPLY.unpack(data)
        if prefix & 0x1F:
            raise WireError(f"a route to a subnet (prefix size {prefix & 0x1F})")
        return Rrep(hops, _robot(destination), sequence, _robot(originator), lifetime, bool(flags & _ACK))
    if kind == _RERR and len(data) > _ERROR.size and len(data) == _ERROR.size + _PAIR.size * data[3]:
        pairs = _PAIR.iter_unpack(data[_ERROR.size :])
        return Rerr(tuple((_robot(ip), number) for ip, number in pairs), bool(data[1] & _NO_DELETE))
    if kind == _RREP_ACK and len(data) == 2:
        return RrepAck()
    raise WireError(f"{len(data)} octets of type {kind} are no message of AODV")


def _robot(ip: int) -> Address:
    robot = robot_of(ip)
    if robot == BROADCAST:
        raise WireError("a route to all")
    return robot
