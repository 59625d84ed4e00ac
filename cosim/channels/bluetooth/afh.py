"""Adaptive frequency hopping (Core v1.2, Vol 2 Part B, section 2.3 and Part C, section 4.1.4): which channels are used.

The master counts for each channel how many slot pairs on it succeeded and failed. A channel on which most failed is
left out of the hop set. At least 20 channels stay, the best of the bad ones if need be. After a while a channel that
was left out is tried again. The specification leaves the classification to the implementer.

A new hop set is used by the master and all its slaves from the next TX slot on. Neglected are the air time of the link
manager's messages which announce it, and that a slave may miss them.
"""

from collections.abc import Sequence
from typing import Final

from cosim.channels.bluetooth.hopping import CHANNELS
from cosim.channels.bluetooth.polling import NEXT, RUNNING, USED
from cosim.channels.bluetooth.state import PiconetState
from cosim.kernel import Handle
from cosim.units import Time

LEAST_CHANNELS: Final = 20
"""Size below which the hop set never falls (N_min of the specification)."""
SAMPLES: Final = 4
"""Slot pairs on a channel before it is judged."""
WORST_RATE: Final = 0.5
"""Share of slot pairs that may fail on a channel that is used."""


def in_order(channels: Sequence[int]) -> list[int]:
    """Return *channels* in the order in which the hop kernel counts them: even ones first, ascending."""
    return sorted(channels, key=lambda channel: (channel % 2, channel))


class ChannelMap:
    """Quality of the 79 channels of one piconet; *retry* is the time in ns for which a bad one is left out."""

    def __init__(self, retry: Time) -> None:
        self._retry = retry
        self._heard = [0] * CHANNELS
        self._failed = [0] * CHANNELS
        self._left_out: dict[int, Time] = {}  # since when

    @property
    def left_out(self) -> list[int]:
        """The channels that are not in the hop set, ascending."""
        return sorted(self._left_out)

    @property
    def used(self) -> list[int]:
        """The hop set, in the order of the hop kernel."""
        return in_order([channel for channel in range(CHANNELS) if channel not in self._left_out])

    def update(self, heard: Sequence[int], failed: Sequence[int], now: Time) -> bool:
        """Take the numbers of pairs that went well and badly since the last time, by channel, and choose again.

        Return whether the hop set has changed.
        """
        before = set(self._left_out)
        for channel in range(CHANNELS):
            self._count(channel, heard[channel], failed[channel])
        for channel in [old for old, since in self._left_out.items() if now - since >= self._retry]:
            del self._left_out[channel]
            self._heard[channel] = self._failed[channel] = 0
        for channel in range(CHANNELS):
            if channel not in self._left_out and self._bad(channel):
                self._left_out[channel] = now
        self._keep_enough()
        return set(self._left_out) != before

    def _count(self, channel: int, heard: int, failed: int) -> None:
        self._heard[channel] += heard
        self._failed[channel] += failed
        while self._heard[channel] + self._failed[channel] >= 4 * SAMPLES:  # old slot pairs count less
            self._heard[channel] //= 2
            self._failed[channel] //= 2

    def _bad(self, channel: int) -> bool:
        total = self._heard[channel] + self._failed[channel]
        return total >= SAMPLES and self._failed[channel] > WORST_RATE * total

    def _keep_enough(self) -> None:
        """Take back the channels that failed least, of equals the first, until there are enough."""
        short = LEAST_CHANNELS - (CHANNELS - len(self._left_out))
        if short > 0:
            for channel in sorted(self._left_out, key=lambda channel: (self._rate(channel), channel))[:short]:
                del self._left_out[channel]

    def _rate(self, channel: int) -> float:
        return self._failed[channel] / max(1, self._heard[channel] + self._failed[channel])


class Adaptation:
    """The hop set of one piconet: all channels at first, assessed every *interval* while there are links."""

    def __init__(self, state: PiconetState, interval: Time, retry: Time) -> None:
        """Assess every *interval*, and try a bad channel again after *retry*."""
        self._kernel = state.kernel
        self._air = state.air
        self._clock = state.clock
        self._links = state.links
        self._interval = interval
        self._map = ChannelMap(retry)
        self._sets = self._air.adapt()
        self._pending: Handle | None = None
        self._use()

    def wake(self) -> None:
        """Note that there may be links now."""
        if self._pending is None and self._links.held():
            self._pending = self._kernel.after(self._interval, self._assess)

    def _assess(self) -> None:
        """Choose a hop set at the beginning of a slot pair, when nothing of this piconet is on the air."""
        now, piconet = self._kernel.now, self._links.piconet
        self._air.advance(now)
        boundary = self._clock.time_of(int(piconet[NEXT]))
        if piconet[RUNNING] and boundary > now:
            self._pending = self._kernel.at(boundary, self._assess)
            return
        self._pending = None
        if piconet[RUNNING]:
            tallies = self._sets.tallies[self._links.master]
            heard, failed = tallies.tolist()
            tallies[:] = 0
            if self._map.update(heard, failed, now):
                self._use()
                self._links.memberships.leave_out(self._map.left_out, now)
        self.wake()

    def _use(self) -> None:
        used = self._map.used
        self._sets.used[self._links.master, : len(used)] = used
        self._links.piconet[USED] = len(used)
