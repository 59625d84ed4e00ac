"""Jammers at the stations of one 802.11 channel: how much of their power falls into its band, and when.

The band is as wide as the physical layer says, about 2412 + 5 (n - 1) MHz for channel n; its receivers are taken to
pass all of it evenly, and nothing else. A jammer's power on channel k is spread evenly over the 1 MHz about 2402 + k
MHz. It arrives at once, and is noise: it makes the medium busy if it is energy enough, and disturbs what is received.

Only the instants at which that power changes are scheduled, and none of them while no station has anything to send and
no frame is on the air. Changes during that time are made up for when a station begins to send.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol, TypeAlias

from cosim.channels.jamming import CONSTANT, PULSED, Jammer
from cosim.kernel import WORLD, Handle, Kernel
from cosim.units import MS, Time

FIRST_MHZ: Final = 2412.0
SPACING_MHZ: Final = 5.0
"""Spacing of the centres of neighbouring 802.11 channels in the band of 2.4 GHz."""
LOWEST_JAMMED_MHZ: Final = 2402.0
MEMORY: Final = 10 * MS
"""Time after which a change no longer matters to a station at rest: longer than any interframe space."""

Gains: TypeAlias = Callable[[Sequence[Jammer]], Sequence[Sequence[float]]]
"""Function from jammers to the power in mW of each (row) at each station, on one channel of 1 MHz."""


class JammedStations(Protocol):
    """What jammers need of the stations of a network."""

    @property
    def matter(self) -> bool:
        """True if changes matter to any of them now."""

    def jammed(self, powers_mw: Sequence[float], at: Time) -> None:
        """Have each receive its power of jammers from *at* on."""


class Source(NamedTuple):
    """A jammer, and the share of each of its channels that falls into the band."""

    jammer: Jammer
    shares: tuple[float, ...]
    """Shares of its channels, in their order: 0 to 1."""

    def weight(self, at: Time) -> float:
        """Return how many of its channels, in all, are on in the band at *at*."""
        jammer = self.jammer
        since = at - jammer.start
        if not 0 <= since < jammer.end - jammer.start:
            return 0.0
        if jammer.mode == CONSTANT:
            return math.fsum(self.shares)
        if jammer.mode == PULSED:
            return math.fsum(self.shares) if since % jammer.period < jammer.on else 0.0
        return self.shares[since // jammer.dwell % len(self.shares)]

    def next_change(self, after: Time) -> Time | None:
        """Return the first instant after *after* at which its weight may change; None if it never changes again."""
        jammer = self.jammer
        if after < jammer.start:
            return jammer.start
        if after >= jammer.end:
            return None
        return min(self._next_within(after), jammer.end)

    def _next_within(self, after: Time) -> Time:
        jammer = self.jammer
        since = after - jammer.start
        if jammer.mode == CONSTANT:
            return jammer.end
        if jammer.mode == PULSED:
            begin = since - since % jammer.period
            return jammer.start + begin + (jammer.on if since - begin < jammer.on else jammer.period)
        step, count = since // jammer.dwell, len(self.shares)
        here = self.shares[step % count]
        ahead = next((n for n in range(1, count) if self.shares[(step + n) % count] != here), None)
        return jammer.end if ahead is None else jammer.start + (step + ahead) * jammer.dwell


def source(jammer: Jammer, channel: int, bandwidth_hz: float) -> Source | None:
    """Return *jammer* as 802.11 *channel*, 1 to 13, receives it; None if nothing of it falls into the band."""
    middle_mhz = FIRST_MHZ + SPACING_MHZ * (channel - 1)
    low_mhz, high_mhz = middle_mhz - bandwidth_hz / 2e6, middle_mhz + bandwidth_hz / 2e6
    shares = []
    for number in jammer.channels:
        jammed_mhz = LOWEST_JAMMED_MHZ + number
        shares.append(max(0.0, min(high_mhz, jammed_mhz + 0.5) - max(low_mhz, jammed_mhz - 0.5)))
    return Source(jammer, tuple(shares)) if any(shares) else None


class Jamming:
    """All jammers of a channel."""

    def __init__(self, kernel: Kernel, gains: Gains, stations: JammedStations, size: int) -> None:
        """Take the power of jammers at each of *size* stations from *gains*."""
        self._kernel = kernel
        self._gains = gains
        self._stations = stations
        self._size = size
        self._sources: list[Source] = []
        self._received_mw: Sequence[Sequence[float]] | None = None
        """Power of each jammer (row) at each station, on one channel of 1 MHz; None until needed after a move."""
        self._known_to: Time = 0
        """Instant up to which the stations are up to date."""
        self._next: Handle | None = None

    def add(self, source: Source) -> None:
        """Add another jammer, which is on at its times."""
        self.advance()
        self._sources.append(source)
        self.moved()
        if self._next is not None:
            self._next.cancel()
            self._next = None
        if self._stations.matter:
            self._go_on()

    def moved(self) -> None:
        """Note that stations or barriers have moved; the stations have been brought up to now before."""
        if self._sources:
            now = self._kernel.now
            self._sources = [each for each in self._sources if each.jammer.end > now]
            self._received_mw = None
            self._apply(now)

    def follow(self) -> None:
        """Bring stations up to now and follow every change from now on: one of them is about to send."""
        if self._sources and self._next is None:
            self.advance()
            self._go_on()

    def _change(self) -> None:
        self._next = None
        self.advance()
        if self._stations.matter:
            self._go_on()

    def _go_on(self) -> None:
        following = self._change_after(self._kernel.now)
        if following is not None:
            self._next = self._kernel.at(following, self._change, WORLD)

    def advance(self) -> None:
        """Bring stations up to now: of changes too long ago to matter, only the result is applied."""
        if not self._sources:
            return
        now = self._kernel.now
        begin = max(self._known_to, now - MEMORY)
        self._apply(begin)
        for change in self._changes(begin, now):
            self._apply(change)
        self._known_to = now

    def _changes(self, begin: Time, end: Time) -> Iterator[Time]:
        """Yield the instants of changes in (begin, end]."""
        change = self._change_after(begin)
        while change is not None and change <= end:
            yield change
            change = self._change_after(change)

    def _change_after(self, time: Time) -> Time | None:
        changes = [change for each in self._sources if (change := each.next_change(time)) is not None]
        return min(changes, default=None)

    def _apply(self, at: Time) -> None:
        """Apply to all stations the power that they receive from *at* on."""
        weights = [each.weight(at) for each in self._sources]
        if not any(weights):
            powers_mw = [0.0] * self._size
        else:
            if self._received_mw is None:
                self._received_mw = self._gains([each.jammer for each in self._sources])
            columns = zip(*self._received_mw, strict=True)
            powers_mw = [math.fsum(w * mw for w, mw in zip(weights, column, strict=True)) for column in columns]
        self._stations.jammed(powers_mw, at)
