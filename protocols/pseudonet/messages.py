"""Pseudonet's packets (paper 003, section III.A, Fig. 3): four packet types, five message types, a CRC.

Every packet begins with a byte of source (3 bits), packet type (2 bits) and message kind (3 bits), followed by the
number of the exchange that it belongs to. All fit a DM1 packet (17 bytes), so that each is one Bluetooth packet.

An *information* packet carries a message. Each message holds its robot's place, its next action, and for all four
actions the verdict of the evaluation, that is why each failed: the list that the paper's case study sends (section
VI). Help, trap and stop add nothing that has no field here; an answer adds its addressee and a cell, a trap the trail
that it is caught in. The paper names no destination field, "as all messages are broadcast": an answer's addressee is
part of the message's content, and the master, which reads it, forwards the answer to that robot alone.

The "accept" of Fig. 10 is sent as an answer (to all, ``Reply.ACCEPT``): it answers the states of the exchange before.

A *synchronisation* packet carries the team (a bit for each member, the number of bits set being the team size) and the
hop information, and serves as the poll.

Three things are added to the paper's. A *roll* message is the state with which a robot answers the roll call of a new
team: it ends with a digest of what the robot knows to be covered. Where digests differ, *map* messages follow, which
carry that knowledge piece by piece. A *negative acknowledgement* of a slave names the robots whose messages it has
missed, as broadcasts are not acknowledged.

These are the bytes of teams of up to eight robots. A larger team that is one piconet all the same, as a radio with more
links lets it be, has packets of the *broad* form: three bits set stand before a source of 5 bits, and a bit for each of
32 robots where there were eight. One of several piconets takes the wide form (module ``wide``), in which no packet
begins with three bits set.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache, lru_cache
from typing import Any, Final, NamedTuple

from cosim.errors import WireError
from protocols import wire


class PacketType(IntEnum):
    """The 2-bit type field."""

    INFORMATION = 0
    SYNCHRONISATION = 1
    ACKNOWLEDGEMENT = 2
    NEGATIVE_ACKNOWLEDGEMENT = 3


class Kind(IntEnum):
    """The message types of section III.A, and two for new teams; NONE in packets that carry no message."""

    STATE = 0
    HELP = 1
    ANSWER = 2
    TRAP = 3
    STOP = 4
    ROLL = 5
    MAP = 6
    NONE = 7


class Action(IntEnum):
    """A robot's next action; the first four are the directions of a step."""

    NORTH = 0
    EAST = 1
    SOUTH = 2
    WEST = 3
    STAY = 4


class Verdict(IntEnum):
    """Why an action cannot, or should not, be taken."""

    POSSIBLE = 0
    WALL = 1
    COVERED = 2
    ROBOT = 3
    """Another robot stands there."""
    NEARER = 4
    """The step would reduce the distance to another robot."""
    LOST = 5
    """Another robot has the better claim to that cell."""


class Reply(IntEnum):
    """The content of an answer."""

    NONE = 0
    ACCEPT = 1
    """No robot is in the way of another: the next action is carried out."""
    YIELD = 2
    """The sender has changed its action, as the other robot has the better claim."""
    DIRECT = 3
    """The target is the nearest uncovered cell that the sender knows."""


TRAIL_LIMIT: Final = 12
"""Length of the longest trail that a trap message carries, in steps."""

BODY: Final[wire.Layout] = (
    ("x", 12),
    ("y", 12),
    ("action", 3),
    ("north", 3),
    ("east", 3),
    ("south", 3),
    ("west", 3),
    ("busy", 1),
)
"""Fields of every message behind its head."""


def message_layout(head: wire.Layout, kind: Kind, name_bits: int, marks: int = 0) -> wire.Layout:
    """Return the layout of a message of *kind* behind *head*: addressees of *name_bits*, *marks* bytes of map."""
    more: dict[Kind, wire.Layout] = {
        Kind.ANSWER: (
            ("to_all", 1),
            ("addressee", name_bits),
            ("reply", 2),
            ("target_x", 12),
            ("target_y", 12),
        ),
        Kind.TRAP: (("length", 4), ("trail", 2 * TRAIL_LIMIT)),
        Kind.ROLL: (("digest", 32),),
        Kind.MAP: (("chunk", 12), ("marks", 8 * marks)),
    }
    return (*head, *BODY, *more.get(kind, ()))


MESSAGE_KINDS: Final = tuple(kind for kind in Kind if kind != Kind.NONE)


class Form(NamedTuple):
    """The form of packets, which depends on how many robots a team may have."""

    robots: int
    """That number: 2 to the power of the bits of a robot's number."""
    mark: int = 0
    """Number of bits, all set, before everything else."""

    @property
    def name_bits(self) -> int:
        """The bits of a robot's number."""
        return (self.robots - 1).bit_length()


NARROW: Final = Form(8)
"""The paper's."""
BROAD: Final = Form(32, 3)
"""That of larger teams that are one piconet."""


class _Layouts:
    """The layouts of all packets of a form."""

    def __init__(self, form: Form) -> None:
        marked: wire.Layout = (("mark", form.mark),) if form.mark else ()
        self.form = form
        self.head: wire.Layout = (*marked, ("source", form.name_bits), ("type", 2), ("kind", 3), ("exchange", 8))
        self.messages: dict[Kind, wire.Layout] = {
            kind: message_layout(self.head, kind, form.name_bits) for kind in MESSAGE_KINDS
        }
        hop: wire.Layout = ("hop_address", 32), ("hop_clock", 28)
        self.sync: wire.Layout = (*self.head, ("members", form.robots), ("roll_call", 1), *hop)
        self.missing: wire.Layout = (*self.head, ("robots", form.robots))

    def message(self, kind: Kind, marks: int) -> wire.Layout:
        """Return the layout of a message of *kind* with *marks* bytes of map."""
        return message_layout(self.head, kind, self.form.name_bits, marks) if kind == Kind.MAP else self.messages[kind]


_LAYOUTS: Final = {form: _Layouts(form) for form in (NARROW, BROAD)}


def form_of(size: int) -> Form:
    """Return the form of the packets of a team of *size* that is one piconet."""
    return NARROW if size <= NARROW.robots else BROAD


def is_broad(data: bytes) -> bool:
    """Return whether *data* begins as the broad form does, and a packet of the wide form does not."""
    return bool(data) and data[0] >> (8 - BROAD.mark) == (1 << BROAD.mark) - 1


@dataclass(frozen=True, slots=True)
class Message:
    """The content of an information packet."""

    source: int
    kind: Kind
    exchange: int
    x: int
    y: int
    action: Action
    verdicts: tuple[Verdict, Verdict, Verdict, Verdict]
    busy: bool = False
    """True if the robot is not ready to decide: still driving, or out of step with the team."""
    addressee: int | None = None
    """Receiver of an answer; None for all."""
    reply: Reply = Reply.NONE
    target: tuple[int, int] = (0, 0)
    """Column and row of the cell to which an answer directs."""
    trail: tuple[Action, ...] = ()
    """Last steps of a robot that is trapped, oldest first."""
    digest: int = 0
    """Digest of all that the robot knows, in a roll message: 32 bits."""
    chunk: int = 0
    """Number of the piece of the map that a map message carries."""
    marks: bytes = b""
    """That piece: a bit for each covered cell."""

    def __str__(self) -> str:
        """Return what the trace of calls shows of a message."""
        words = [f"exchange {self.exchange}", f"at ({self.x}, {self.y})", self.action.name.lower()]
        words += [f"{a.name.lower()}: {v.name.lower()}" for a, v in zip(Action, self.verdicts, strict=False) if v]
        words += [self.reply.name.lower()] if self.reply else []
        words += ["busy"] if self.busy else []
        return ", ".join(words)

    def constricted(self) -> int:
        """Return the number of actions that remain possible: the fewer, the better the claim to a cell."""
        return sum(verdict == Verdict.POSSIBLE for verdict in self.verdicts)


@dataclass(frozen=True, slots=True)
class Sync:
    """The content of a synchronisation packet."""

    source: int
    exchange: int
    members: tuple[int, ...]
    """Members of the team, in increasing order."""
    roll_call: bool
    """True if the team has changed: the exchange begins again, and plans are made again after it."""
    hop_address: int = 0
    """Address word from which the piconet's hopping sequence is drawn, 32 bits."""
    hop_clock: int = 0
    """Clock of the piconet at the time when the link came up, 28 bits."""


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """The content of an acknowledgement, or (``negative``) of a negative one."""

    source: int
    exchange: int
    negative: bool = False


@dataclass(frozen=True, slots=True)
class Missing:
    """The content of a negative acknowledgement that asks for messages again."""

    source: int
    exchange: int
    robots: tuple[int, ...]
    """Robots whose messages of that exchange were not received, in increasing order."""


Packet = Message | Sync | Acknowledgement | Missing


@lru_cache(maxsize=256)  # a master sends on what it has decoded, and one poll to slave after slave
def encode(packet: Packet, form: Form = NARROW) -> bytes:
    """Return the bytes of *packet* in *form*; raise :exc:`WireError` for a value that its field cannot hold."""
    layouts, mark = _LAYOUTS[form], (1 << form.mark) - 1
    head = {"mark": mark, "source": packet.source, "exchange": packet.exchange, "kind": Kind.NONE}
    match packet:
        case Message():
            of_form = {"mark": mark, "source": packet.source, "addressee": packet.addressee or 0}
            return wire.pack(layouts.message(packet.kind, len(packet.marks)), message_values(packet) | of_form)
        case Sync():
            head |= {
                "type": PacketType.SYNCHRONISATION,
                "members": mask(packet.members),
                "roll_call": packet.roll_call,
                "hop_address": packet.hop_address,
                "hop_clock": packet.hop_clock,
            }
            return wire.pack(layouts.sync, head)
        case Missing():
            head |= {"type": PacketType.NEGATIVE_ACKNOWLEDGEMENT, "kind": Kind.STATE, "robots": mask(packet.robots)}
            return wire.pack(layouts.missing, head)
        case Acknowledgement():
            negative = packet.negative
            head["type"] = PacketType.NEGATIVE_ACKNOWLEDGEMENT if negative else PacketType.ACKNOWLEDGEMENT
            return wire.pack(layouts.head, head)


@lru_cache(maxsize=256)  # a broadcast reaches all robots with the same bytes
def decode(data: bytes, form: Form = NARROW) -> Packet:
    """Return the packet that *data* encodes in *form*.

    Raise :exc:`WireError` for anything that :func:`encode` does not make.
    """
    wire.check(data)
    try:
        packet = _decode(data, _LAYOUTS[form])
    except ValueError as error:  # a number that names no type, kind, action, verdict or reply
        raise WireError(str(error)) from None
    if encode(packet, form) != data:
        raise WireError("a packet that nobody encodes so")
    return packet


def mask(robots: tuple[int, ...]) -> int:
    """Return a word with the bits of *robots* set."""
    return sum(1 << robot for robot in robots)


def robots_of(word: int) -> tuple[int, ...]:
    """Return the robots whose bits are set in *word*, in increasing order."""
    return tuple(robot for robot in range(word.bit_length()) if word >> robot & 1)


def message_values(message: Message) -> dict[str, int]:
    """Return the fields of *message* but its source and addressee, which depend on the form."""
    north, east, south, west = message.verdicts
    values: dict[str, int] = {
        "type": PacketType.INFORMATION,
        "kind": message.kind,
        "exchange": message.exchange,
        "x": message.x,
        "y": message.y,
        "action": message.action,
        "north": north,
        "east": east,
        "south": south,
        "west": west,
        "busy": message.busy,
    }
    match message.kind:
        case Kind.ANSWER:
            values |= {
                "to_all": message.addressee is None,
                "reply": message.reply,
                "target_x": message.target[0],
                "target_y": message.target[1],
            }
        case Kind.TRAP:
            values |= {"length": len(message.trail), "trail": _trail_word(message.trail)}
        case Kind.ROLL:
            values["digest"] = message.digest
        case Kind.MAP:
            values |= {"chunk": message.chunk, "marks": int.from_bytes(message.marks, "big")}
    return values


def _trail_word(trail: tuple[Action, ...]) -> int:
    if len(trail) > TRAIL_LIMIT or Action.STAY in trail:
        raise WireError(f"a trail of {len(trail)} steps, where at most {TRAIL_LIMIT} steps that move are carried")
    return sum(action << 2 * index for index, action in enumerate(trail))


def marks_in(data: bytes, layout: wire.Layout) -> int:
    """Return the number of map bytes after *layout*, which has none; raise WireError if it is cut short."""
    if len(data) < wire.size(layout):
        raise WireError(f"{len(data)} bytes where at least {wire.size(layout)} were expected")
    return len(data) - wire.size(layout)


def _decode(data: bytes, layouts: _Layouts) -> Packet:
    bits = sum(bits for name, bits in layouts.head if name != "exchange")
    begin = int.from_bytes(data[:2], "big") >> (16 - bits)
    kind, number = Kind(begin & 7), begin >> 3 & 3
    match PacketType(number):
        case PacketType.INFORMATION if kind in layouts.messages:
            marks = marks_in(data, layouts.messages[kind]) if kind == Kind.MAP else 0
            values = wire.unpack(layouts.message(kind, marks), data)
            return message_of(values, values["source"], values.get("addressee"), marks)
        case PacketType.SYNCHRONISATION:
            values = wire.unpack(layouts.sync, data)
            return Sync(
                values["source"],
                values["exchange"],
                robots_of(values["members"]),
                bool(values["roll_call"]),
                values["hop_address"],
                values["hop_clock"],
            )
        case PacketType.NEGATIVE_ACKNOWLEDGEMENT if kind == Kind.STATE:
            values = wire.unpack(layouts.missing, data)
            return Missing(values["source"], values["exchange"], robots_of(values["robots"]))
        case PacketType.ACKNOWLEDGEMENT | PacketType.NEGATIVE_ACKNOWLEDGEMENT as packet_type:
            values = wire.unpack(layouts.head, data)
            return Acknowledgement(
                values["source"], values["exchange"], packet_type == PacketType.NEGATIVE_ACKNOWLEDGEMENT
            )
    raise WireError(f"no packet has type {number} with message kind {kind}")


def message_of(values: dict[str, int], source: int, addressee: int | None, marks: int) -> Message:
    """Return the message with these fields; raise ValueError for a number without a meaning."""
    verdicts = _verdicts(values["north"], values["east"], values["south"], values["west"])
    kind, action = Kind(values["kind"]), Action(values["action"])
    more: dict[str, Any] = {}
    match kind:
        case Kind.ANSWER:
            more["addressee"] = None if values["to_all"] else addressee
            more["reply"] = Reply(values["reply"])
            more["target"] = (values["target_x"], values["target_y"])
        case Kind.TRAP:
            length = min(values["length"], TRAIL_LIMIT)
            more["trail"] = tuple(Action(values["trail"] >> 2 * index & 3) for index in range(length))
        case Kind.ROLL:
            more["digest"] = values["digest"]
        case Kind.MAP:
            more |= {"chunk": values["chunk"], "marks": values["marks"].to_bytes(marks, "big")}
    busy = bool(values["busy"])
    return Message(source, kind, values["exchange"], values["x"], values["y"], action, verdicts, busy, **more)


@cache
def _verdicts(north: int, east: int, south: int, west: int) -> tuple[Verdict, Verdict, Verdict, Verdict]:
    return Verdict(north), Verdict(east), Verdict(south), Verdict(west)
