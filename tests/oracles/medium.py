"""Clocks, scan windows and frames on the air of the slot-by-slot oracle. Times are integer nanoseconds."""

from dataclasses import dataclass
from typing import NamedTuple

US = 1_000
TICK = 312_500
SLOT = 625_000
ID_AIR = 68 * US
FHS_AIR = 366 * US
HEADER_AIR = 126 * US
WINDOW = 36

RECEIVED, OUT_OF_RANGE, COLLIDED, NOT_TUNED, BUSY = "received", "out_of_range", "collided", "not_tuned", "busy"


@dataclass(frozen=True)
class Clock:
    """A native clock: local time *phase* at time 0, drifting by *ppm*; one tick every 312.5 us of local time."""

    phase: int
    ppm: int = 0

    def local(self, time: int) -> int:
        return self.phase + time + time * self.ppm // 1_000_000

    def tick(self, time: int) -> int:
        return self.local(time) // TICK

    def at_local(self, local: int) -> int:
        """Return the first instant whose local time is at least *local*: guess, then walk there.

        The guess is rounded down, so that it is this instant, or the one before it.
        """
        guess = (local - self.phase) * 1_000_000 // (1_000_000 + self.ppm)
        return guess if self.local(guess) >= local else guess + 1

    def start(self, tick: int) -> int:
        """Return the instant at which *tick* begins."""
        return self.at_local(tick * TICK)

    def first_transmit_tick(self, time: int) -> int:
        """Return the first tick with CLK1-0 = 00 that begins at or after *time*."""
        tick = self.tick(time)
        while tick % 4 != 0 or self.start(tick) < time:
            tick += 1
        return tick


@dataclass(frozen=True)
class Windows:
    """When a scanner listens; *interval* and *offset* in its own ticks, interval 36 being a scan without pauses."""

    clock: Clock
    offset: int
    interval: int
    interlaced: bool = False

    def part(self, start: int) -> int | None:
        """Return which of the (at most two) windows an ID at *start* lies in wholly, or None."""
        if self.interval == WINDOW:
            return 0
        tick = self.clock.tick(start)
        into = (tick - self.offset) % self.interval
        part = into // WINDOW
        if part > (1 if self.interlaced else 0):
            return None
        close = self.clock.start(tick - into + (part + 1) * WINDOW)
        return part if start + ID_AIR <= close else None


class OnAir(NamedTuple):
    """A frame on the air."""

    start: int
    end: int
    source: int
    channel: int
