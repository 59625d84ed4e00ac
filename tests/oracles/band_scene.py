"""What the oracle of the whole band is given and what it tells: inputs of hosts, devices, frames, news."""

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

from tests.oracles.band_air import Radio

ALL = -1


class Kind(NamedTuple):
    """A packet type: slots, capacity in bytes, bytes of payload header, and whether every 10 bits are sent as 15."""

    slots: int
    capacity: int
    header: int
    coded: bool


KINDS = {
    "DM1": Kind(1, 17, 1, True),
    "DH1": Kind(1, 27, 1, False),
    "DM3": Kind(3, 121, 2, True),
    "DH3": Kind(3, 183, 2, False),
    "DM5": Kind(5, 224, 2, True),
    "DH5": Kind(5, 339, 2, False),
}


# ---------------------------------------------------------------- what hosts do


class Send(NamedTuple):
    """A host's payload of *length* bytes; *token* also names it."""

    time: int
    source: int
    destination: int
    length: int
    token: int


class Flush(NamedTuple):
    """A host's wish to forget what it has queued for *destination*."""

    time: int
    source: int
    destination: int


class Join(NamedTuple):
    """A link comes up, ready-made; its first poll is due at the master's tick *due*."""

    time: int
    master: int
    slave: int
    lt_addr: int
    due: int


class Suspend(NamedTuple):
    """The master leaves its piconet alone in [time, until)."""

    time: int
    master: int
    until: int


class Share(NamedTuple):
    """The device divides its time: parts (master, first slot, slots) of a period counted on *reference*'s clock."""

    time: int
    device: int
    period: int
    parts: tuple[tuple[int, int, int], ...]
    reference: int


class Inquire(NamedTuple):
    """The device inquires for *duration* ticks or until *enough* are found."""

    time: int
    device: int
    duration: int
    enough: int


class PageFor(NamedTuple):
    """The device pages *peer*, whose clock it takes to be *offset* ticks ahead of its own."""

    time: int
    device: int
    peer: int
    offset: int


class Scan(NamedTuple):
    """The device can be found and paged, links or not; or not at all."""

    time: int
    device: int
    enabled: bool


Input = Join | Send | Flush | Suspend | Share | Inquire | PageFor | Scan


# ---------------------------------------------------------------- what is to be seen


class Seen(NamedTuple):
    """A frame meant for *destination*, and what became of it."""

    start: int
    duration: int
    kind: str
    source: int
    destination: int
    channel: int
    lt_addr: int
    outcome: str
    part: str | None
    """The section that failed."""


class Delivery(NamedTuple):
    """A payload, named by its token, reaches a host."""

    time: int
    source: int
    receiver: int
    token: int
    broadcast: bool


class Verdict(NamedTuple):
    """The fate of a payload."""

    time: int
    owner: int
    token: int
    outcome: str


class Loss(NamedTuple):
    """*owner* gives up *peer*."""

    time: int
    owner: int
    peer: int


class News(NamedTuple):
    """What a host learns of links: connected as master or slave, page failed, discovered, inquiry complete."""

    time: int
    host: int
    what: str
    peer: int = -1
    offset: int = 0


class FlowNote(NamedTuple):
    """Something about FLOW in the slot pair that begins at *start*, of no consequence by itself.

    "master stops": a packet says so, or "slave's payload waits" for that; "slave stops": an answer says so, or "stop
    unheard", if that is lost; "polled though stopped"; "go by lost answer" and "go without answer": the link is not
    stopped any more, for no good reason; "refused": a payload has found no place, at a slave or "refused by master".
    """

    start: int
    what: str
    master: int
    slave: int


@dataclass
class Book:
    """All that happened."""

    seen: list[Seen] = field(default_factory=list)
    idle: list[Seen] = field(default_factory=list)
    """Frames of transactions in which neither side has a payload."""
    deliveries: list[Delivery] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)
    news: list[News] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    """Packets of connected devices by type, and idle polls; an answer counts once it is known that it comes."""
    flow: list[FlowNote] = field(default_factory=list)
    intervals: list[tuple[int, int, int, str, str]] = field(default_factory=list)
    """(start, device, end, state, detail) of all that devices did, if they were watched."""
    doubts: list[tuple[int, str]] = field(default_factory=list)
    """What the readings do not settle; a case in which it happens proves nothing."""

    def sort(self) -> None:
        for rows in (self.deliveries, self.verdicts, self.losses, self.news):
            rows.sort()
        for frames in (self.seen, self.idle):
            frames.sort(key=lambda row: row[:6])


# ---------------------------------------------------------------- the scene


class ScanWindows(NamedTuple):
    """How a device scans: ticks of its own clock; *version* and *n*, replies sent before, count for inquiries."""

    offset: int = 0
    interval: int = 4096
    interlaced: bool = False
    version: str = "1.2"
    n: int = 0


class Body(NamedTuple):
    """A device: its clock, hop address, how it scans; None: never."""

    phase: int
    ppm: int
    word: int
    inquiry_scan: ScanWindows | None = None
    page_scan: ScanWindows | None = None


@dataclass(frozen=True)
class Scene:
    """Everything that is given, from time 0 to *end*."""

    bodies: tuple[Body, ...]
    radio: Radio
    inputs: tuple[Input, ...]
    end: int
    t_poll: int = 40
    n_bc: int = 1
    kinds: tuple[str, ...] = tuple(KINDS)
    supervision: int = 20_000_000_000
    n_inquiry: int = 256
    first_train: str = "A"
    repetitions: int = 1
    page_timeout: int = 16384
    host_bps: int | None = None
    """Bit/s from a device to its host; None: at once."""
    room: int = 8
    """Payloads of each peer that a device holds until its host has them."""
