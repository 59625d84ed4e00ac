"""The contract between a protocol and everything around it: bytes and time in, bytes and commands out.

A :class:`Machine` is a protocol endpoint without input or output of its own. It reads no clock (time is an argument),
draws only from the stream it was given, and is driven by four kinds of calls: bytes that arrived, news about links,
an observation of the robot's own body, a deadline of its own. What it wants done it leaves in three queues that the
driver drains after every call: ``outbox`` (payloads and link commands, in one order), ``commands`` (motion) and
``events`` (rows for the trace).

Addresses are small integers, the robots' numbers in the team; channels map them to whatever their radios use.
"""

from collections.abc import Mapping
from dataclasses import Field, dataclass
from enum import StrEnum
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeAlias, TypeVar

from cosim.errors import LocalProtocolError
from cosim.observation import Observation
from cosim.units import Time

Address: TypeAlias = int
"""A robot's number in its team, from 0."""

BROADCAST: Final[Address] = -1
"""The destination of a payload that is meant for all who hear the sender: everyone in reach of a radio that needs no
links, over Bluetooth a master's slaves. A slave has a link to its master only, and reaches nobody by a broadcast."""

OPERATOR: Final[Address] = -2
"""The person at the robot's console: what is sent there and comes from there goes by cable, past every channel."""


# ---------------------------------------------------------------- what comes in


class Reception(NamedTuple):
    """How a payload arrived."""

    source: Address
    """Who has sent it: where a router brings payloads, the robot that it comes from, however many hops away."""
    broadcast: bool
    """Whether it was sent to everyone."""
    rssi_dbm: float | None = None
    """Received power; None where signals do not fade, so that all in range are heard alike, and where a router is."""
    radio: int = 0
    """Which of the receiver's radios it came by."""


class Outcome(StrEnum):
    """What became of a payload, as its sender learns it."""

    DELIVERED = "delivered"
    """Acknowledged by the destination's radio."""
    SENT = "sent"
    """On the air as often as it was to be (a broadcast: nobody acknowledges it)."""
    NO_LINK = "no_link"
    """There is no link to the destination."""
    NO_ROUTE = "no_route"
    """No way to the destination has been found over other robots."""
    TOO_LONG = "too_long"
    """No packet type in use can carry it."""
    FLUSHED = "flushed"
    """Taken out of the queue by a ``Flush``, for having waited too long, or as its link ended or was parked."""
    UNACKNOWLEDGED = "unacknowledged"
    """Sent as often as allowed, and never acknowledged by the destination's radio."""
    QUEUE_FULL = "queue_full"
    """The device holds as many payloads as it can."""


class Role(StrEnum):
    """Which end of a link one is."""

    MASTER = "master"
    SLAVE = "slave"
    PEER = "peer"
    """A channel without roles."""


class Mode(StrEnum):
    """How much of the time the two ends of a link are there for each other."""

    ACTIVE = "active"
    HOLD = "hold"
    SNIFF = "sniff"
    PARKED = "parked"
    NONE = "none"
    """There is no such link."""


@dataclass(frozen=True, slots=True)
class Discovered:
    """An inquiry has found *peer*."""

    peer: Address
    clock_offset: int = 0
    """Ticks of 312.5 us from the own clock to the peer's, mod 2**28, as far as its answer told; 0 without clocks."""
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class InquiryComplete:
    """The inquiry is over; *found* are all peers that it has found, in the order of their replies."""

    found: tuple[Address, ...]
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class Connected:
    """A link to *peer* is up, in which this side is *role*.

    ``hop_address`` and ``hop_clock`` are what determines the link's hopping sequence (Bluetooth: the master's 32-bit
    UAP/LAP word and its 28-bit clock now); 0 where a channel does not hop.
    """

    peer: Address
    role: Role
    hop_address: int = 0
    hop_clock: int = 0
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class PageFailed:
    """Paging *peer* ended without a link."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class Lost:
    """The link to *peer* is gone: nothing was heard of it for the supervision time-out, or the other side closed it."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """The link to *peer* is in *mode* now; as an answer to a command that was refused, it still is."""

    peer: Address
    mode: Mode
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class RoleChanged:
    """This side's role on the link to *peer* is *role* now; as an answer to a switch that was refused, it still is."""

    peer: Address
    role: Role
    radio: int = 0
    """Which of the robot's radios it comes from."""


@dataclass(frozen=True, slots=True)
class Fate:
    """What became of the payload that was sent with *token*."""

    token: int
    outcome: Outcome
    radio: int = 0
    """Which of the robot's radios it comes from."""


LinkEvent: TypeAlias = Discovered | InquiryComplete | Connected | PageFailed | Lost | ModeChanged | RoleChanged | Fate


# ---------------------------------------------------------------- what goes out


class Outgoing(NamedTuple):
    """A payload for *destination* (or ``BROADCAST``). With a *token* its fate is reported by a ``Fate`` event."""

    destination: Address
    payload: bytes
    token: int | None = None
    radio: int = 0
    """By which of the sender's radios."""


@dataclass(frozen=True, slots=True)
class Inquire:
    """Look for devices for *duration* ns, or until *enough* have been found."""

    duration: Time
    enough: int
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Page:
    """Ask *peer* for a link, of which the caller becomes the master."""

    peer: Address
    clock_offset: int | None = None
    """Where the peer's clock is taken to be, as in :class:`Discovered`; None: as the last inquiry told, if any did."""
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Be discoverable and connectable (both), or not."""

    enabled: bool
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Close the link to *peer*; what is still queued for it is flushed."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Flush:
    """Take out of the queue what is meant for *destination* and has not been on the air yet."""

    destination: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Share:
    """Divide the own time among several piconets: be in that of each master only during its part of every period.

    A period begins wherever the number of slots that the clock of *reference* has counted is a multiple of
    *period_slots*; that clock is taken to be known to all who follow it. A master that is away silences its piconet.
    Without parts (as in the beginning) the device is in the piconet of its latest link only.
    """

    period_slots: int
    parts: tuple[tuple[Address, int, int], ...]
    """(master of the piconet, possibly oneself; first slot of the part; its number of slots)."""
    reference: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Leave the link to *peer* alone for *slots* of 625 us; both sides learn when that begins and ends."""

    peer: Address
    slots: int
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Sniff:
    """Use the link to *peer* only in a part of every interval of the master's clock; an interval of 0 ends that.

    A packet to the slave begins in the first *attempt_slots* from *offset_slots* after each multiple of
    *interval_slots* on; all three are even. Low Energy makes the link's events as rare as that interval, and knows
    neither of the others.
    """

    peer: Address
    interval_slots: int
    offset_slots: int
    attempt_slots: int
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Park:
    """Make the link to the slave *peer* a mere membership, which costs none of the master's places."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class Unpark:
    """Give the parked slave *peer* a place again, at its next beacon."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


@dataclass(frozen=True, slots=True)
class SwitchRole:
    """Exchange the roles of the two ends of the link to *peer*, which must be the only link of both."""

    peer: Address
    radio: int = 0
    """Which of the robot's radios it is for."""


ModeCommand: TypeAlias = Hold | Sniff | Park | Unpark
LinkCommand: TypeAlias = Inquire | Page | Scan | Disconnect | Flush | Share | ModeCommand | SwitchRole


class GoTo(NamedTuple):
    """Drive straight to a point in the world frame and stop there."""

    x_m: float
    y_m: float


class Drive(NamedTuple):
    """Drive with a linear and an angular velocity until told otherwise."""

    speed_mps: float
    turn_radps: float


Command: TypeAlias = GoTo | Drive


class Event(Protocol):
    """A typed row for the trace: a frozen dataclass whose fields are int, float, str or bool."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


@dataclass(frozen=True, slots=True)
class Call:
    """A call from one room of a layered protocol to the next, for the trace; emitted among the events."""

    depth: int
    room: str
    call: str
    detail: str = ""


class Unrecorded:
    """The base of events that only the referee hears: they leave no row in the trace."""

    __slots__ = ()


class Machine(Protocol):
    """A protocol endpoint. It does no I/O, reads no clock and draws only from the stream it was given."""

    @property
    def finished(self) -> bool:
        """Nothing more will come from this machine unless it is addressed again."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool | None:
        """Take a payload; never raise for bad bytes, they become an event.

        A machine may return False if nothing has come of it, neither output nor an earlier deadline: then it is not
        asked for any. One that does not know returns nothing, and is asked.
        """

    def link(self, event: LinkEvent, now: Time) -> bool | None:
        """Take news about links and about the fate of payloads; return False as :meth:`receive` may."""

    def observe(self, observation: Observation, now: Time) -> bool | None:
        """Take what the robot senses at a world tick; return False as :meth:`receive` may."""

    def wake(self, now: Time) -> None:
        """Act on all deadlines up to *now* (``now >= wake_at()``); idempotent."""

    def wake_at(self) -> Time | None:
        """Return the absolute time of the earliest deadline; pure and O(1)."""

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain payloads and link commands; they are acted on at once and in this order."""

    def commands(self) -> list[Command]:
        """Drain motion commands; they are acted on at the next world tick."""

    def events(self) -> list[Event]:
        """Drain rows for the trace."""


T = TypeVar("T")


class Drains:
    """The three queues of a machine, to derive from: lists that are filled in any way and drained as the node asks.

    A list stays the same object, so that a machine's parts may hold it and append to it. Mostly there is nothing in it:
    then a drain is over at once.
    """

    def __init__(self) -> None:
        self._outbox: list[Outgoing | LinkCommand] = []
        self._commands: list[Command] = []
        self._events: list[Event] = []

    def left(self) -> bool:
        """Return whether there is anything to drain: what a machine without deadlines may return of an input."""
        return bool(self._outbox or self._commands or self._events)

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain payloads and link commands."""
        return drained(self._outbox) if self._outbox else []

    def commands(self) -> list[Command]:
        """Drain motion commands."""
        return drained(self._commands) if self._commands else []

    def events(self) -> list[Event]:
        """Drain rows for the trace, and what only the referee hears."""
        return drained(self._events) if self._events else []


def drained(queue: list[T]) -> list[T]:
    """Return what is in *queue* and empty it."""
    if not queue:
        return []
    items = queue[:]
    queue.clear()
    return items


def next_state(table: Mapping[tuple[Any, Any], tuple[Any, Any]], state: Any, event: Any) -> tuple[Any, Any]:
    """Look up (state, input) in a state table and return (action, next state).

    Raise :exc:`LocalProtocolError` for a pair that the table does not hold: the caller drove the machine wrongly.
    """
    try:
        return table[state, event]
    except KeyError:
        raise LocalProtocolError(f"input {event} is not legal in state {state}") from None
