"""When a scanner hears a train of IDs: computed, not searched slot by slot (Core v1.2, Vol 2 Part B, section 8).

An inquirer or pager sends IDs at the ticks c of its own clock with c mod 4 in {0, 1}, hopping through a train of 16
channels in 32 ticks; a scanner listens on one channel for a window of 36 ticks of its own clock, once an interval. An
ID is heard when it lies wholly inside a window and the X of both are equal.

X of the transmitter is a function of the tick's bits 4, 3, 2, 0 and of its block (bits 16-12) and train; X of the
scanner of its block alone. So between changes of a block or a train the equation X = X has at most one solution in
every 32 ticks, and it is written down: with b the block of the transmitter, k the train's offset and
d = (X - b - k) mod 32, there is none if d >= 16, and else bits 4, 3, 2, 0 of the tick are (b + d) mod 16 and bit 1
is 0. The search steps over windows and such segments only. In the 23-channel system X counts mod 16, and so does d:
both trains are the same, and there is always a solution.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, Self, cast

import numpy as np
from pydantic import Field, model_validator

from cosim.arrays import Int64s
from cosim.channels.bluetooth.hopping import KOFFSET, Train, page_channel, train_phase
from cosim.channels.bluetooth.medium import TRAIN, Records, records
from cosim.channels.bluetooth.packets import ID_AIR
from cosim.channels.clock import NativeClock, start_of, tick_at
from cosim.channels.courses import Stretch
from cosim.intervals import Interval
from cosim.jit import njit
from cosim.kernel import DELIVER, Callback, Handle, Kernel
from cosim.machine import Address
from cosim.settings import Settings, error_at
from cosim.units import SLOT, TICK, Time, from_seconds

WINDOW: Final = 36
"""Ticks of a scan window, 11.25 ms."""
RESPONSE_DELAY: Final[Time] = SLOT
"""Time from the start of a heard ID to the start of its answer."""

_NEVER = 1 << 62


class ScanSettings(Settings):
    """Parameters of a scan."""

    interval_s: float = Field(default=1.28, ge=0.01125, le=2.56)
    """Time from the start of a window to the next; the shortest, the length of a window, is a continuous scan."""
    interlaced: bool = False
    """Two windows back to back, the second half a hop cycle ahead (v1.2)."""

    @property
    def interval_ticks(self) -> int:
        """The interval in ticks."""
        return from_seconds(self.interval_s) // TICK

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if from_seconds(self.interval_s) % TICK:
            raise error_at(("interval_s",), self.interval_s, "is not a multiple of 0.0003125")
        if self.interlaced and self.interval_ticks < 2 * WINDOW:
            raise error_at(("interval_s",), self.interval_s, "does not hold the two windows of an interlaced scan")
        return self


@dataclass(frozen=True, slots=True)
class IdTrain:
    """The IDs of one inquiry or page: at ticks ``first <= c < end`` of *clock* with c mod 4 in {0, 1}.

    *first* and *end* are multiples of 4. The train changes after every *repetitions* * 32 ticks. The hop phase is read
    from c + *estimate*, a multiple of 4: 0 for an inquirer, the distance to the paged device's clock for a pager.
    *narrow* is the 23-channel system, in which there are 16 phases instead of 32.
    """

    clock: NativeClock
    first: int
    end: int
    repetitions: int
    first_train: Train = "A"
    estimate: int = 0
    narrow: bool = False

    def train(self, tick: int) -> Train:
        """Return the train in use at *tick*."""
        even = (tick - self.first) // (32 * self.repetitions) % 2 == 0
        return "A" if even == (self.first_train == "A") else "B"

    def phase(self, tick: int) -> int:
        """Return X at *tick*."""
        return train_phase(tick + self.estimate, self.train(tick))

    def stretches(self, start: Time, end: Time, before: str, after: str) -> Iterator[Stretch]:
        """Yield the stretches of one train each in [*start*, *end*) of its time; *before* and *after* are details."""
        switch = 32 * self.repetitions
        while start < end:
            tick = self.clock.tick(start)
            change = self.clock.time_of(tick - (tick - self.first) % switch + switch)
            yield start, min(change, end), f"{before}train={self.train(tick)}{after}"
            start = change

    def on_air(self, device: Address, since: Time) -> Records:
        """Return the record (1,) for ``Air.open_train``: *device* sends the train from *since* (ns) to its end."""
        clock, switch = self.clock, 32 * self.repetitions
        koffset, end = KOFFSET[self.first_train], self.clock.time_of(self.end)
        train = records(1, TRAIN)
        row = (device, clock.phase, clock.ppm, self.first, switch, koffset, self.estimate, since, max(since, end))
        train[0] = (*row, 0, 0, 0)
        return train


@dataclass(frozen=True, slots=True)
class ScanWindows:
    """The windows of a scanner: local ticks [offset + k * interval, + WINDOW) of *clock* for every integer k.

    An *interval* of one window is a continuous scan. *interlaced* (v1.2) puts a second window directly behind each, in
    which X is 16 further.
    """

    clock: NativeClock
    offset: int
    interval: int
    interlaced: bool = False

    @property
    def continuous(self) -> bool:
        """True if there is no time outside of the windows."""
        return self.interval == WINDOW

    def stretches(self, start: Time, end: Time) -> Iterator[Stretch]:
        """Yield the windows, or parts of windows, in [*start*, *end*); those of a continuous scan are one."""
        if self.continuous:
            yield start, end, ""
            return
        details = ("window=1", "window=2") if self.interlaced else ("",)
        edge = self.clock.tick(start)
        edge -= (edge - self.offset) % self.interval
        while (opening := self.clock.time_of(edge)) < end:
            for number, detail in enumerate(details, 1):
                closing = self.clock.time_of(edge + number * WINDOW)
                if max(opening, start) < min(closing, end):
                    yield max(opening, start), min(closing, end), detail
                opening = closing
            edge += self.interval


class Meeting(NamedTuple):
    """An ID that a scanner would hear."""

    tick: int
    """The transmitter's tick."""
    second: bool
    """True if it falls into the second of two interlaced windows."""


def first_transmission(clock: NativeClock, now: Time) -> int:
    """Return the first tick at or after *now* that begins a transmit slot: a multiple of 4."""
    return (clock.tick(now - 1) + 4) // 4 * 4


def at_meeting(kernel: Kernel, time: Time, callback: Callback) -> Handle:
    """Call *callback* at *time*, which may be now: then in the present phase, if DELIVER is over."""
    phase = kernel.phase
    return kernel.at(time, callback, max(DELIVER, phase[1]) if phase[0] == time == kernel.now else DELIVER)


def next_meeting(ids: IdTrain, windows: ScanWindows, tick: int, since: Time, n: int = 0) -> Meeting | None:
    """Return the first ID at or after *tick* that starts at or after *since* and falls into a window.

    *n* is added to the scanner's X. None if there is no such ID before the train ends.
    """
    second = -1 if windows.continuous else int(windows.interlaced)
    numbers = _numbers(ids, windows.clock)
    return _as_meeting(_next_meeting(*numbers, second, windows.interval, windows.offset, n, tick, since, _NEVER))


def next_meeting_between(
    ids: IdTrain, clock: NativeClock, tick: int, since: Time, until: Time, n: int = 0
) -> Meeting | None:
    """Return the first ID at or after *tick* that lies in [*since*, *until*], in all of which *clock*'s owner scans."""
    return _as_meeting(_next_meeting(*_numbers(ids, clock), -1, WINDOW, 0, n, tick, since, until))


def _numbers(ids: IdTrain, scanner: NativeClock) -> tuple[int, int, int, int, int, int, int, int, int, int]:
    clock, switch, koffset, mask = ids.clock, 32 * ids.repetitions, KOFFSET[ids.first_train], 15 if ids.narrow else 31
    return clock.phase, clock.ppm, ids.first, ids.end, switch, koffset, ids.estimate, mask, scanner.phase, scanner.ppm


def _as_meeting(found: int) -> Meeting | None:
    return None if found < 0 else Meeting(found >> 1, bool(found & 1))


@njit(cache=True, borrows=True)
def _solve(x: int, block: int, koffset: int, tick: int, estimate: int, mask: int) -> int:
    """Return the first c >= *tick* at which a train in *block* with *koffset* has the phase *x*, or -1.

    *mask* is the number of phases minus 1.
    """
    d = (x - block - koffset) & mask
    if d >= 16:
        return -1
    step = (block + d) & 15
    residue = ((step >> 1) << 2) | (step & 1)
    return tick + ((residue - tick - estimate) & 31)


@njit(cache=True, borrows=True)
def _in_window(
    ph: int, pm: int, first: int, switch: int, k: int, est: int, mask: int, sph: int, spm: int, x: int, lo: int, hi: int
) -> int:
    """Return the first c in [lo, hi] that meets a scanner of phase CLKN16-12 + x, all of these ticks heard; else -1."""
    while lo <= hi:
        block = tick_at(sph, spm, start_of(ph, pm, lo)) >> 12
        change = tick_at(ph, pm, start_of(sph, spm, (block + 1) << 12) - 1)
        mine = (lo + est) >> 12
        turn = (lo - first) // switch
        last = min(hi, change, ((mine + 1) << 12) - est - 1, first + (turn + 1) * switch - 1)
        koffset = k if turn % 2 == 0 else 32 - k  # the offsets of the trains are 24 and 8
        tick = _solve((block + x) & 31, mine & 31, koffset, lo, est, mask)
        if 0 <= tick <= last:
            return tick
        lo = last + 1
    return -1


@njit(cache=True, borrows=True)
def _next_meeting(
    ph: int,  # the transmitter's clock, its train...
    pm: int,
    first: int,
    end: int,
    switch: int,
    k: int,
    est: int,
    mask: int,
    sph: int,  # ...the scanner's clock, its windows...
    spm: int,
    second: int,  # -1 continuous, 0 single windows, 1 interlaced
    interval: int,
    offset: int,
    n: int,
    tick: int,  # ...and the bounds of the search
    since: int,
    until: int,
) -> int:
    """Return 2 * tick + (1 in a second window) of the next meeting, or -1."""
    lo = max(tick, first, tick_at(ph, pm, since - 1) + 1)
    hi = end - 1
    if until != _NEVER:
        hi = min(hi, tick_at(ph, pm, until - ID_AIR))
    if second < 0:
        found = _in_window(ph, pm, first, switch, k, est, mask, sph, spm, n, lo, hi)
        return 2 * found if found >= 0 else -1
    window = (tick_at(sph, spm, start_of(ph, pm, lo)) - offset) // interval
    while lo <= hi:
        edge = offset + window * interval
        for part in range(second + 1):
            opening = start_of(sph, spm, edge + part * WINDOW)
            closing = start_of(sph, spm, edge + (part + 1) * WINDOW)
            start = max(lo, tick_at(ph, pm, opening - 1) + 1)
            stop = min(hi, tick_at(ph, pm, closing - ID_AIR))
            found = _in_window(ph, pm, first, switch, k, est, mask, sph, spm, n + 16 * part, start, stop)
            if found >= 0:
                return 2 * found + part
            lo = max(lo, stop + 1)
        window += 1
        lo = max(lo, tick_at(ph, pm, start_of(sph, spm, offset + window * interval) - 1) + 1)
    return -1


# ---------------------------------------------------------------- trains as rows of the table ``intervals``


def train_words(ids: IdTrain, word: int) -> str:
    """Return what the detail of a row of *ids* tells beside the train; *word* is the one whose code they carry."""
    clock = ids.clock
    return f" word={word:#x} phase_ns={clock.phase} ppm={clock.ppm} estimate={ids.estimate}"


def sent_ids(
    row: Interval, start: Time, end: Time, silences: Iterable[tuple[Time, Time]] = ()
) -> tuple[Int64s, Int64s]:
    """Return (starts in ns, RF channels) of the IDs of the train *row* that start in [*start*, *end*), in order.

    A row of the states ``inquiry`` and ``page`` stands for up to thousands of IDs, and tells all that they follow from:
    the train (A or B), the word of which they carry the access code, the sender's clock (``phase_ns``, ``ppm``) and by
    how many ticks the sender of a page takes the other's clock to be ahead (``estimate``).

    An inquirer sends none while it receives an answer: at no instant after the start of such an FHS and before its end,
    which are the *silences*. Nor does a device that was refused the air (``air.arbitration``): a row ``deferred`` is a
    silence from 1 ns before its start on. Raise ValueError for a row that is not of a train.
    """
    words = dict(word.split("=", 1) for word in row.detail.split())
    if row.state not in ("inquiry", "page"):
        raise ValueError(f"a row of {row.state!r} is no train of IDs, expected one of 'inquiry' or 'page'")
    train = cast(Train, words["train"])
    clock = NativeClock(int(words["phase_ns"]), int(words["ppm"]))
    start, end = max(start, row.start), min(end, row.end)
    ticks = np.arange(clock.tick(start - 1) + 1, clock.tick(end - 1) + 1, dtype=np.int64)
    ticks = ticks[ticks & 2 == 0]
    starts = clock.times_of(ticks)
    for silent, again in silences:
        heard = (starts <= silent) | (starts >= again)
        ticks, starts = ticks[heard], starts[heard]
    return starts, page_channel(int(words["word"], 0), ticks + int(words["estimate"]), train)
