"""What the slot-by-slot oracles share: clocks, frames on the air and who destroys whom, scan windows.

The oracles are slow and meant to be obviously right. They import nothing of cosim but the hop functions (which have the
specification's sample data as their own oracle) and take draws and reach as callables. Times are integer nanoseconds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, takewhile
from typing import NamedTuple

US = 1_000
TICK = 312_500
SLOT = 625_000
ID_AIR = 68 * US
FHS_AIR = 366 * US
HEADER_AIR = 126 * US
WINDOW = 36

RECEIVED, OUT_OF_RANGE, COLLIDED, NOT_TUNED, BUSY = "received", "out_of_range", "collided", "not_tuned", "busy"

Reach = Callable[[int, int, int], bool]
"""(transmitter, receiver, instant) -> whether the one is heard by the other."""


class Sighting(NamedTuple):
    """One frame and what became of it."""

    start: int
    duration: int
    kind: str
    source: int
    destination: int
    channel: int
    outcome: str


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
        """Return the first instant whose local time is at least *local*: guess, then walk there."""
        time = (local - self.phase) * 1_000_000 // (1_000_000 + self.ppm)
        while self.local(time) >= local:
            time -= 1
        while self.local(time) < local:
            time += 1
        return time

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


class Medium:
    """All frames that were ever on the air, in the order of their starts, and *noise* of strangers."""

    def __init__(self, reach: Reach, noise: Sequence[OnAir] = ()) -> None:
        self.reach = reach
        self.noise = noise
        self.frames: list[OnAir] = []

    def put(self, start: int, duration: int, source: int, channel: int) -> OnAir:
        frame = OnAir(start, start + duration, source, channel)
        self.frames.append(frame)
        return frame

    def clear(self, frame: OnAir, receiver: int, until: int) -> bool:
        """Return whether *receiver* hears nothing else on the frame's channel from its start to *until*."""
        recent = takewhile(lambda other: other.start > frame.start - 5_000_000, reversed(self.frames))
        return not any(
            other is not frame
            and other.source != receiver
            and other.channel == frame.channel
            and other.start < until
            and other.end > frame.start
            and self.reach(other.source, receiver, other.start)
            for other in chain(recent, self.noise)
        )
