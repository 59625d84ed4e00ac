"""Packets of teams in several piconets: the source grows from 3 bits to piconet number + 3 bits.

The first byte is the source's name: the number of its piconet (5 bits) and its place there (3 bits, 0 for the master).
Type, kind and exchange follow, then the fields of the narrow form; addressees are names too. The roll call, one
synchronisation packet for each piconet, announces the names. Four more kinds of synchronisation packets form a
scatternet and dissolve it; in these robots go by their numbers, as names are not given yet. All but map messages fit a
DM1 packet (17 bytes).
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import Final, TypeAlias

from cosim.errors import WireError
from cosim.machine import Address
from protocols import wire
from protocols.pseudonet.messages import (
    MESSAGE_KINDS,
    Acknowledgement,
    Kind,
    Message,
    Missing,
    PacketType,
    marks_in,
    mask,
    message_layout,
    message_of,
    message_values,
    robots_of,
)
from protocols.pseudonet.topology import Directory, Piconet

ROBOTS: Final = 32
"""Number of robots whose numbers these packets can carry."""


class Order(IntEnum):
    """The purpose of a synchronisation packet, in the place of the message kind."""

    ASSIGNMENT = 0
    REPORT = 1
    ROLL = 2
    DISSOLUTION = 3
    WELCOME = 7


@dataclass(frozen=True, slots=True)
class Welcome:
    """From a master to a new slave: its piconet, the number of piconets, and the source of the hops."""

    piconet: int
    piconets: int
    root: Address
    """Coordinator, whose clock divides the time."""
    formation: int
    """Number of the coordinator's attempt, mod 256."""
    hop_address: int = 0
    hop_clock: int = 0


@dataclass(frozen=True, slots=True)
class Assignment:
    """From the coordinator to a designated master: one of its slaves, with what a page needs (BTCP: its FHS)."""

    piconet: int
    """Number of the piconet that the receiver is to form."""
    piconets: int
    root: Address
    formation: int
    count: int
    """Number of slaves that it is to have."""
    place: int
    """Place of this one among them, from 1."""
    slave: Address
    clock_offset: int
    """Ticks from the receiver's clock to the slave's, mod 2**28."""


@dataclass(frozen=True, slots=True)
class Census:
    """The members of one piconet: a report to the root, or the root's roll call."""

    roll_call: bool
    number: int
    """Number of the report (a later one replaces it) or of the roll call, mod 256."""
    exchange: int
    piconet: int
    piconets: int
    root: Address
    formation: int
    content: Piconet


@dataclass(frozen=True, slots=True)
class Dissolution:
    """The scatternet has lost a robot on which others depend: all robots leave, and it is formed again."""

    dead: tuple[Address, ...]


Control: TypeAlias = Welcome | Assignment | Census | Dissolution
WidePacket: TypeAlias = Message | Missing | Acknowledgement | Control

_HEAD: Final[wire.Layout] = (("source", 8), ("type", 2), ("kind", 3), ("exchange", 8))
_MESSAGES: Final[dict[Kind, wire.Layout]] = {kind: message_layout(_HEAD, kind, 8) for kind in MESSAGE_KINDS}
_MISSING: Final[wire.Layout] = (*_HEAD, ("robots", ROBOTS))
_SCATTERNET: Final[wire.Layout] = (("piconets", 5), ("root", 5), ("formation", 8))
_ORDERS: Final[dict[Order, wire.Layout]] = {
    Order.WELCOME: (*_HEAD, *_SCATTERNET, ("hop_address", 32), ("hop_clock", 28)),
    Order.ASSIGNMENT: (*_HEAD, *_SCATTERNET, ("count", 3), ("place", 3), ("slave", 5), ("clock_offset", 28)),
    Order.REPORT: (
        *_HEAD,
        *_SCATTERNET,
        ("number", 8),
        ("count", 3),
        ("master", 5),
        *((f"slave_{place}", 5) for place in range(1, 8)),
    ),
    Order.DISSOLUTION: (*_HEAD, ("dead", ROBOTS)),
}
_ORDERS[Order.ROLL] = _ORDERS[Order.REPORT]


def encode(packet: WidePacket, directory: Directory) -> bytes:
    """Return the bytes of *packet*; raise :exc:`WireError` for a value that does not fit, or a robot without a name."""
    match packet:
        case Message():
            addressee = 0 if packet.addressee is None else _name(packet.addressee, directory)
            values = message_values(packet) | {"source": _name(packet.source, directory), "addressee": addressee}
            layout = _message_layout(packet.kind, len(packet.marks))
            return wire.pack(layout, values)
        case Missing():
            values = _head(packet.source, PacketType.NEGATIVE_ACKNOWLEDGEMENT, Kind.STATE, packet.exchange, directory)
            return wire.pack(_MISSING, values | {"robots": mask(packet.robots)})
        case Acknowledgement():
            negative = PacketType.NEGATIVE_ACKNOWLEDGEMENT if packet.negative else PacketType.ACKNOWLEDGEMENT
            return wire.pack(_HEAD, _head(packet.source, negative, Kind.NONE, packet.exchange, directory))
    return _encode_control(packet)


@lru_cache(maxsize=1024)  # every robot decodes the same bytes
def decode(data: bytes, directory: Directory) -> WidePacket:
    """Return the packet that *data* encodes; raise :exc:`WireError` for anything that :func:`encode` does not make."""
    wire.check(data)
    if len(data) < wire.size(_HEAD):
        raise WireError(f"{len(data)} bytes where at least {wire.size(_HEAD)} were expected")
    try:
        packet = _decode(data, directory)
    except ValueError as error:  # a number that names no type, kind, action, verdict, reply or order
        raise WireError(str(error)) from None
    if encode(packet, directory) != data:
        raise WireError("a packet that nobody encodes so")
    return packet


class _Strangers(Directory):
    """The directory of a team that is not known: all names are given, and stand for themselves."""

    @cached_property
    def names(self) -> dict[Address, int]:
        """All names, each of itself."""
        return {name: name for name in range(1 << 8)}


_STRANGERS: Final = _Strangers(())


def decode_anonymous(data: bytes) -> dict[str, object]:
    """Return the packet that *data* encodes, without a directory, and the names in it as piconet.place.

    In the packet the source and the addressee of a message are names, 8 x piconet + place, not robots. Raise
    :exc:`WireError` for what is no packet in any team.
    """
    packet = decode(data, _STRANGERS)
    names = {part: getattr(packet, part, None) for part in ("source", "addressee")}
    return {"packet": packet, "names": {part: f"{n >> 3}.{n & 7}" for part, n in names.items() if n is not None}}


def _name(robot: Address, directory: Directory) -> int:
    if robot not in directory.names:
        raise WireError(f"robot {robot} has no name in this team")
    return directory.names[robot]


def _robot(name: int, directory: Directory) -> Address:
    if name not in directory.robots:
        raise WireError(f"nobody in this team is called {name // 8}.{name % 8}")
    return directory.robots[name]


def _head(source: Address, kind: PacketType, order: int, exchange: int, directory: Directory) -> dict[str, int]:
    return {"source": _name(source, directory), "type": kind, "kind": order, "exchange": exchange}


def _message_layout(kind: Kind, marks: int) -> wire.Layout:
    return message_layout(_HEAD, kind, 8, marks) if kind == Kind.MAP else _MESSAGES[kind]


def _encode_control(packet: Control) -> bytes:
    values: dict[str, int] = {"source": 0, "type": PacketType.SYNCHRONISATION, "exchange": 0}
    match packet:
        case Welcome():
            order = Order.WELCOME
            values |= {"hop_address": packet.hop_address, "hop_clock": packet.hop_clock}
        case Assignment():
            order = Order.ASSIGNMENT
            values |= {"count": packet.count, "place": packet.place, "slave": packet.slave}
            values["clock_offset"] = packet.clock_offset
        case Census(content=content):
            order = Order.ROLL if packet.roll_call else Order.REPORT
            if len(content.slaves) > 7:
                raise WireError(f"{len(content.slaves)} slaves in a piconet")
            slaves = content.slaves + (0,) * (7 - len(content.slaves))
            values |= {f"slave_{place}": slave for place, slave in enumerate(slaves, 1)}
            values |= {"number": packet.number, "count": len(content.slaves), "master": content.master}
            values["exchange"] = packet.exchange
        case Dissolution():
            order = Order.DISSOLUTION
            values["dead"] = mask(packet.dead)
    if not isinstance(packet, Dissolution):
        values |= {"source": 8 * packet.piconet, "piconets": packet.piconets}
        values |= {"root": packet.root, "formation": packet.formation}
    return wire.pack(_ORDERS[order], values | {"kind": order})


def _decode(data: bytes, directory: Directory) -> WidePacket:
    kind = data[1] >> 3 & 7
    match PacketType(data[1] >> 6):
        case PacketType.INFORMATION if kind in _MESSAGES:
            marks = marks_in(data, _MESSAGES[Kind(kind)]) if kind == Kind.MAP else 0
            values = wire.unpack(_message_layout(Kind(kind), marks), data)
            message = message_of(values, _robot(values["source"], directory), values.get("addressee"), marks)
            if message.addressee is not None:
                message = replace(message, addressee=_robot(message.addressee, directory))
            return message
        case PacketType.SYNCHRONISATION:
            return _decode_control(Order(kind), wire.unpack(_ORDERS[Order(kind)], data))
        case PacketType.NEGATIVE_ACKNOWLEDGEMENT if kind == Kind.STATE:
            values = wire.unpack(_MISSING, data)
            return Missing(_robot(values["source"], directory), values["exchange"], robots_of(values["robots"]))
        case PacketType.ACKNOWLEDGEMENT | PacketType.NEGATIVE_ACKNOWLEDGEMENT as packet_type:
            values = wire.unpack(_HEAD, data)
            negative = packet_type == PacketType.NEGATIVE_ACKNOWLEDGEMENT
            return Acknowledgement(_robot(values["source"], directory), values["exchange"], negative)
    raise WireError(f"no packet has type {data[1] >> 6} with kind {kind}")


def _decode_control(order: Order, values: dict[str, int]) -> Control:
    piconet = values["source"] // 8
    if order is Order.DISSOLUTION:
        return Dissolution(robots_of(values["dead"]))
    place = (piconet, values["piconets"], values["root"], values["formation"])
    if order is Order.WELCOME:
        return Welcome(*place, values["hop_address"], values["hop_clock"])
    if order is Order.ASSIGNMENT:
        return Assignment(*place, values["count"], values["place"], values["slave"], values["clock_offset"])
    slaves = tuple(values[f"slave_{place}"] for place in range(1, values["count"] + 1))
    content = Piconet(values["master"], slaves)
    return Census(order is Order.ROLL, values["number"], values["exchange"], *place, content)
