"""What the oracle of the whole band is given and what it tells: inputs of hosts, devices, frames, news."""

from dataclasses import dataclass, field
from typing import NamedTuple

from tests.oracles.band_air import Radio
from tests.oracles.polling import KINDS, Delivery, Flush, Loss, Send, Verdict

# ---------------------------------------------------------------- what hosts do


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
    lt_addr: int = 1


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


class News(NamedTuple):
    """What a host learns of links: connected as master or slave, page failed, discovered, inquiry complete."""

    time: int
    host: int
    what: str
    peer: int = -1
    offset: int = 0


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
