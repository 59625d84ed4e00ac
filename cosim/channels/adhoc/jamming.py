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

from cosim.arrays import Floats
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


class Others(Protocol):
    """Other radios that stations hear: their power changes at instants that are known only when they begin to send."""

    attentive: bool
    """True while the stations are told of that."""

    def listen(self) -> None:
        """Have them told from now on."""

    def ignore(self) -> None:
        """Have them told no more."""

    def settle(self) -> None:
        """Make known all that has begun before now."""

    def powers_mw(self, at: Time) -> Floats:
        """Return the power that comes to each station at the instant *at*, (n,)."""

    def change_after(self, time: Time) -> Time | None:
        """Return the first instant after *time* at which these change, for all that is known."""


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

    def __init__(
        self, kernel: Kernel, gains: Gains, stations: JammedStations, size: int, others: Others | None = None
    ) -> None:
        """Take the power of jammers at each of *size* stations from *gains*; *others* are radios that are noise too."""
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
        self._others = others

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
        if self._others is not None:
            if not self._others.attentive:
                self._others.listen()
                self._catch_up()
                self._go_on()
        elif self._sources and self._next is None:
            self._catch_up()
            self._go_on()

    def noticed(self, start: Time) -> None:
        """Note that another radio sends from *start* on, which is now or soon."""
        if self._next is not None:
            if self._next.time <= start:
                return
            self._next.cancel()
        now = self._kernel.now
        priority = WORLD if start > now else max(WORLD, self._kernel.phase[1])
        self._next = self._kernel.at(max(start, now), self._change, priority)

    def _change(self) -> None:
        self._next = None
        self._catch_up()
        if self._stations.matter:
            self._go_on()
        elif self._others is not None:
            self._others.ignore()

    def _go_on(self) -> None:
        following = self._change_after(self._kernel.now)
        if following is not None:
            self._next = self._kernel.at(following, self._change, WORLD)

    def advance(self) -> None:
        """Bring stations up to now, before jammers are received with other powers."""
        if self._sources:
            self._catch_up()

    def _catch_up(self) -> None:
        """Bring stations up to now: of changes too long ago to matter, only the result is applied."""
        if self._others is not None:
            self._others.settle()
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
        if self._others is not None and (change := self._others.change_after(time)) is not None:
            changes.append(change)
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
        if self._others is not None:
            powers_mw = [mw + other for mw, other in zip(powers_mw, self._others.powers_mw(at).tolist(), strict=True)]
        self._stations.jammed(powers_mw, at)
