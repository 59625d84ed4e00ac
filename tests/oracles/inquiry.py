"""The slot-by-slot oracle of inquiry: every half-slot of the inquirer is visited, every scanner asked at each.

Readings: an ID is heard when it lies wholly in one scan window of a listening scanner that is tuned to its channel. A
v1.1 scanner then backs off, listens again, and answers the next ID; a v1.2 scanner answers first and backs off then. An
answer is an FHS 625 us after the ID's start, looked for two ticks after it. Only one FHS can be received at a time, and
no ID is sent while one is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from cosim.channels.bluetooth.hopping import inquiry_channel, inquiry_response_channel, inquiry_scan_channel
from tests.oracles.medium import (
    BUSY,
    COLLIDED,
    FHS_AIR,
    ID_AIR,
    NOT_TUNED,
    OUT_OF_RANGE,
    RECEIVED,
    SLOT,
    Clock,
    Medium,
    OnAir,
    Reach,
    Sighting,
    Windows,
)

Train = Literal["A", "B"]
Draw = Callable[[int, int], int]
"""(bound, the scanner's clock value) -> an integer in [0, bound)"""


@dataclass
class Scanner:
    """A device in inquiry scan, enabled at *begin*."""

    address: int
    windows: Windows
    version: str
    draw: Draw
    begin: int = 0
    """It is deaf before this instant."""
    n: int = 0
    off: int | None = None
    """It stops scanning at this instant, and sends nothing from then on."""
    limit: int | None = None
    """End of the response substate of v1.1; None in any other state."""
    reply: int | None = None
    """Start of an FHS that is still to come or on the air: it does not listen meanwhile."""

    @property
    def clock(self) -> Clock:
        return self.windows.clock

    def listens(self, start: int) -> int | None:
        """Return the offset of X with which it listens to an ID at *start* (n, or n + 16), or None."""
        if self.limit is not None and start >= self.limit:
            self.begin, self.limit = self.limit, None  # inquiry response time-out
        if self.reply is not None or start < self.begin or self.is_off(start + ID_AIR):
            return None
        if self.limit is not None:
            return self.n if start + ID_AIR <= self.limit else None
        part = self.windows.part(start)
        return None if part is None else self.n + 16 * part

    def is_off(self, time: int) -> bool:
        return self.off is not None and time >= self.off

    def hear(self, start: int) -> bool:
        """Take in an ID that began at *start*; return whether an FHS follows."""
        if self.version == "1.2" or self.limit is not None:
            self.reply = start + SLOT
            return True
        resume = self.clock.local(start) + self.draw(1024, self.clock.tick(start)) * SLOT
        self.begin = max(self.clock.at_local(resume), start + ID_AIR)
        self.limit = self.clock.at_local(resume + 128 * SLOT)
        return False

    def replied(self, heard: int) -> None:
        """Go on after the FHS that answered the ID of *heard*."""
        end = heard + SLOT + FHS_AIR
        self.n, self.reply, self.limit, self.begin = self.n + 1, None, None, end
        if self.version == "1.2":
            bound = 128 if self.windows.interval < 4096 else 1024
            slots = self.draw(bound, self.clock.tick(heard))
            self.begin = self.clock.at_local(self.clock.local(end) + slots * SLOT)


@dataclass
class Reply:
    """An FHS: to which ID, with which offset of X, by whom; then, on the air, how the inquirer takes it."""

    scanner: Scanner
    heard: int
    tick: int
    """The inquirer's tick in which it is looked for."""
    offset: int
    frame: OnAir | None = None
    outcome: str | None = None
    """None while it is being received."""


@dataclass
class Inquiry:
    """One inquiry, from *start* for *duration* ticks (a multiple of 4) or until *enough* devices were found."""

    address: int
    clock: Clock
    scanners: list[Scanner]
    reach: Reach
    start: int
    duration: int
    enough: int
    n_inquiry: int = 256
    first_train: Train = "A"
    noise: Sequence[OnAir] = ()
    sightings: list[Sighting] = field(default_factory=list)
    found: list[tuple[int, int, int]] = field(default_factory=list)
    """(instant, address, its clock less the inquirer's as the FHS tells it, mod 2**28), the first time only."""
    end: int = 0

    def run(self) -> None:
        self.medium = Medium(self.reach, self.noise)
        self.first = self.clock.first_transmit_tick(self.start)
        self.last = self.first + self.duration
        self.end = self.clock.start(self.last + 1)
        self.due: dict[int, list[Reply]] = {}
        self.on_air: list[Reply] = []
        self.lock: OnAir | None = None
        for tick in range(self.first, self.last + 8):
            now = self.clock.start(tick)
            if now > self.end + 8 * SLOT:
                break  # enough were found, and every answer has ended
            self.finish_replies(now)
            self.start_replies(tick)
            if tick % 4 in (0, 1) and tick < self.last and now < self.end and not self.receiving(now):
                self.send(tick, now)
        self.sightings.sort()

    def train(self, tick: int) -> Train:
        other: Train = "B" if self.first_train == "A" else "A"
        return self.first_train if (tick - self.first) // (32 * self.n_inquiry) % 2 == 0 else other

    def channel(self, tick: int) -> int:
        return inquiry_channel(tick, self.train(tick))

    def receiving(self, now: int) -> bool:
        return self.lock is not None and self.lock.start < now < self.lock.end

    def send(self, tick: int, now: int) -> None:
        channel = self.channel(tick)
        ident = self.medium.put(now, ID_AIR, self.address, channel)
        for scanner in self.scanners:
            offset = scanner.listens(now)
            if offset is None or inquiry_scan_channel(scanner.clock.tick(now), offset) != channel:
                continue
            if not self.reach(self.address, scanner.address, now):
                continue
            if not self.medium.clear(ident, scanner.address, ident.end):
                continue
            self.sightings.append(Sighting(now, ID_AIR, "ID", self.address, scanner.address, channel, RECEIVED))
            if scanner.hear(now):
                self.due.setdefault(tick + 2, []).append(Reply(scanner, now, tick + 2, offset))

    def start_replies(self, tick: int) -> None:
        """Put the answers to the ID of two ticks ago on the air; only then see which of them is locked on."""
        replies = [reply for reply in self.due.pop(tick, []) if not reply.scanner.is_off(reply.heard + SLOT)]
        for reply in replies:
            start = reply.heard + SLOT
            channel = inquiry_response_channel(reply.scanner.clock.tick(start), reply.offset)
            reply.frame = self.medium.put(start, FHS_AIR, reply.scanner.address, channel)
        tuned = self.channel(tick)
        for reply in replies:
            reply.outcome = self.at_start(reply, tuned)
        self.on_air += replies

    def at_start(self, reply: Reply, tuned: int) -> str | None:
        frame = reply.frame
        assert frame is not None
        if not self.reach(frame.source, self.address, frame.start):
            return OUT_OF_RANGE
        if frame.channel != tuned or frame.start >= self.end:
            return NOT_TUNED
        if self.lock is not None and frame.start < self.lock.end:
            return BUSY
        if not self.medium.clear(frame, self.address, frame.start + ID_AIR):
            return COLLIDED
        self.lock = frame
        return None

    def finish_replies(self, now: int) -> None:
        """Judge the answers that have ended, in the order of their ends."""
        ended = [reply for reply in self.on_air if reply.frame is not None and reply.frame.end <= now]
        self.on_air = [reply for reply in self.on_air if reply not in ended]
        for reply in sorted(ended, key=lambda reply: (reply.heard, reply.scanner.address)):
            frame = reply.frame
            assert frame is not None
            outcome = reply.outcome
            if frame.end > self.end and outcome != OUT_OF_RANGE:
                outcome = NOT_TUNED
            if outcome is None:
                outcome = RECEIVED if self.medium.clear(frame, self.address, frame.end) else COLLIDED
            self.sightings.append(
                Sighting(frame.start, FHS_AIR, "FHS", frame.source, self.address, frame.channel, outcome)
            )
            reply.scanner.replied(reply.heard)
            if outcome == RECEIVED:
                self.note(frame, reply)

    def note(self, frame: OnAir, reply: Reply) -> None:
        if frame.source not in [address for _, address, _ in self.found]:
            told = reply.scanner.clock.tick(frame.start) & ~3  # an FHS carries bits 27-2
            self.found.append((frame.end, frame.source, (told - (reply.tick & ~3)) % (1 << 28)))
            if len(self.found) == self.enough:
                self.end = frame.end
