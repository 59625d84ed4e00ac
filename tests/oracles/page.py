"""The slot-by-slot oracle of paging: the pager's half-slots are visited one by one, in page and in the exchange.

Readings: ID, 625 us later the response, FHS up to four times until the response's acknowledgement, POLL up to sixteen
times until a NULL; each side goes back on its own when the other stays silent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from cosim.channels.bluetooth.hopping import (
    basic_channel,
    master_response_channel,
    page_channel,
    page_scan_channel,
    slave_response_channel,
)
from tests.oracles.medium import (
    COLLIDED,
    FHS_AIR,
    HEADER_AIR,
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

KOFFSET = {"A": 24, "B": 8}
SCAN, RESPONSE, HOPPING, CONNECTED = "scan", "response", "hopping", "connected"


@dataclass
class PageScanner:
    """A device in page scan, enabled at *begin*; *word* is its hop address."""

    address: int
    word: int
    windows: Windows
    begin: int = 0
    state: str = SCAN
    limit: int = 0
    """When it goes back to page scan from the response (no FHS) or the hopping sequence (no POLL)."""
    frozen: int = 0
    """CLKN*."""
    connected: int | None = None

    def settle(self, now: int) -> None:
        """Go back to page scan if the other side has stayed silent for too long."""
        if self.state in (RESPONSE, HOPPING) and now >= self.limit:
            self.state, self.begin = SCAN, self.limit

    def part(self, start: int) -> int | None:
        """Return which scan window hears an ID at *start*, or None."""
        self.settle(start)
        if self.state != SCAN or start < self.begin:
            return None
        return self.windows.part(start)

    def clock_at(self, start: int, part: int) -> int:
        return self.windows.clock.tick(start) + (part * 16 << 12)

    def channel(self, ticks: int) -> int:
        """Return its channel in the response substate, *ticks* after the start of its frozen slot."""
        return slave_response_channel(self.word, self.frozen, (self.frozen & ~3) + ticks)


@dataclass
class Page:
    """One page from *start*: *offset* is the pager's estimate of the difference of the clocks, in ticks."""

    address: int
    word: int
    clock: Clock
    scanner: PageScanner
    offset: int
    repetitions: int
    reach: Reach
    start: int
    timeout: int = 16384
    noise: Sequence[OnAir] = ()
    sightings: list[Sighting] = field(default_factory=list)
    connected: int | None = None
    failed: int | None = None

    def run(self) -> None:
        self.medium = Medium(self.reach, self.noise)
        self.first = self.clock.first_transmit_tick(self.start)
        self.give_up = self.first + self.timeout
        tick = self.first
        while tick < self.give_up and self.connected is None:
            tick = self.page(tick)
        if self.connected is None:
            self.failed = self.clock.start(tick)
        self.sightings.sort()

    def train(self, tick: int) -> Literal["A", "B"]:
        return "A" if (tick - self.first) // (32 * self.repetitions) % 2 == 0 else "B"

    def page(self, tick: int) -> int:
        """Live through one half-slot of paging and whatever exchange it starts; return the next tick of paging."""
        if tick % 4 in (0, 1) and self.page_id(tick, self.clock.start(tick)):
            return self.exchange(tick)
        return tick + 1

    def page_id(self, tick: int, now: int) -> bool:
        """Send an ID; return whether an answer to it was received."""
        scanner = self.scanner
        channel = page_channel(scanner.word, tick + self.offset, self.train(tick))
        part = scanner.part(now)
        if part is None or page_scan_channel(scanner.word, scanner.clock_at(now, part)) != channel:
            return False
        if not self.reach(self.address, scanner.address, now):
            return False
        ident = OnAir(now, now + ID_AIR, self.address, channel)
        if not self.medium.clear(ident, scanner.address, ident.end):
            return False
        self.note(now, ID_AIR, "ID", True, channel, channel)
        scanner.frozen = scanner.clock_at(now, part)
        scanner.state, scanner.limit = RESPONSE, now + SLOT + 8 * SLOT
        mine = page_channel(scanner.word, tick + 2 + self.offset, self.train(tick + 2))
        return self.note(now + SLOT, ID_AIR, "ID", False, scanner.channel(2), mine)

    def exchange(self, tick: int) -> int:
        """Send up to four FHS, then POLLs; return the tick at which paging goes on, if there is no connection."""
        base = tick - tick % 4
        frozen, koffset = tick + 2 + self.offset, KOFFSET[self.train(tick)]
        for n in range(1, 5):
            if self.fhs(base, n, frozen, koffset):
                return self.polls(base + 4 * n + 4)
        return base + 20

    def fhs(self, base: int, n: int, frozen: int, koffset: int) -> bool:
        """Send the n-th FHS; return whether its acknowledgement was received."""
        scanner, tick = self.scanner, base + 4 * n
        now = self.clock.start(tick)

        def mine(ticks: int) -> int:
            return master_response_channel(scanner.word, frozen, tick + ticks + self.offset, koffset)

        scanner.settle(now)
        theirs = scanner.channel(4 * n) if scanner.state == RESPONSE else None
        if not self.note(now, FHS_AIR, "FHS", True, mine(0), theirs):
            return False
        scanner.state, scanner.limit = HOPPING, now + SLOT + 32 * SLOT
        return self.note(now + SLOT, ID_AIR, "ID", False, scanner.channel(4 * n + 2), mine(2))

    def polls(self, first: int) -> int:
        """Send up to sixteen POLLs; return the tick after the last one's slot pair."""
        scanner = self.scanner
        for tick in range(first, first + 64, 4):
            now = self.clock.start(tick)
            scanner.settle(now)
            channel = basic_channel(self.word, tick)
            theirs = channel if scanner.state in (HOPPING, CONNECTED) else None
            if not self.note(now, HEADER_AIR, "POLL", True, channel, theirs):
                continue
            if scanner.state == HOPPING:
                scanner.state, scanner.connected = CONNECTED, now + HEADER_AIR
            channel = basic_channel(self.word, tick + 2)
            if self.note(now + SLOT, HEADER_AIR, "NULL", False, channel, channel):
                self.connected = now + SLOT + HEADER_AIR
                break
        return first + 64

    def note(self, start: int, duration: int, kind: str, down: bool, channel: int, tuned: int | None) -> bool:
        """Put a frame of the pager (*down*) or the scanner on the air; return whether the other side receives it."""
        pair = (self.address, self.scanner.address)
        source, destination = pair if down else pair[::-1]
        frame = self.medium.put(start, duration, source, channel)
        if not self.reach(source, destination, start):
            outcome = OUT_OF_RANGE
        elif tuned != channel:
            outcome = NOT_TUNED
        else:
            outcome = RECEIVED if self.medium.clear(frame, destination, frame.end) else COLLIDED
        self.sightings.append(Sighting(start, duration, kind, source, destination, channel, outcome))
        return outcome == RECEIVED
