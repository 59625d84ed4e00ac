"""Devices in inquiry scan and in page scan, as the oracle of the whole band has them.

An inquiry's ID is heard when it lies wholly in one scan window of a listening scanner that is tuned to its channel. A
v1.1 scanner then backs off, listens again, and answers the next ID; a v1.2 scanner answers first and backs off then. A
paged device goes from ID and response to FHS and POLL, and back to its scan when the other side stays silent.
"""

from collections.abc import Callable
from dataclasses import dataclass

from cosim.channels.bluetooth.hopping import slave_response_channel
from tests.oracles.medium import FHS_AIR, ID_AIR, SLOT, Clock, Windows

SCAN, RESPONSE, HOPPING, CONNECTED = "scan", "response", "hopping", "connected"
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
    heard: tuple[int, int] | None = None
    """Start and channel of the last ID heard."""

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
class Paged:
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
    off: int | None = None
    """It hears nothing that ends at or after this instant."""
    partner: int = -1
    """With whom it speaks, unless it scans."""
    heard: tuple[int, int] | None = None
    """Start and channel of the last ID heard."""

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

    def hears(self, start: int) -> int | None:
        """Return which scan window hears an ID at *start*, or None."""
        part = self.part(start)
        return None if self.off is not None and start + ID_AIR >= self.off else part

    def with_partner(self, partner: int, start: int, *states: str) -> bool:
        """Return whether it is in one of *states* with *partner* when a frame begins."""
        self.settle(start)
        return self.partner == partner and self.state in states
