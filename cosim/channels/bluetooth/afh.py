"""Adaptive frequency hopping (Core v1.2, Vol 2 Part B, section 2.3 and Part C, section 4.1.4): which channels are used.

The master counts for each channel how many slot pairs on it succeeded and failed, and leaves out those on which most
did (:mod:`cosim.channels.air.quality`). At least 20 channels stay.

A new hop set is used by the master and all its slaves from the next TX slot on. Neglected are the air time of the link
manager's messages which announce it, and that a slave may miss them.
"""

from collections.abc import Sequence
from typing import Final

from cosim.channels.air.quality import ChannelQuality
from cosim.channels.bluetooth.hopping import CHANNELS
from cosim.channels.bluetooth.polling import NEXT, RUNNING, USED
from cosim.channels.bluetooth.state import PiconetState
from cosim.kernel import Handle
from cosim.units import Time

LEAST_CHANNELS: Final = 20
"""Size below which the hop set never falls (N_min of the specification)."""


def in_order(channels: Sequence[int]) -> list[int]:
    """Return *channels* in the order in which the hop kernel counts them: even ones first, ascending."""
    return sorted(channels, key=lambda channel: (channel % 2, channel))


class Adaptation:
    """The hop set of one piconet: all channels at first, assessed every *interval* while there are links."""

    def __init__(self, state: PiconetState, interval: Time, retry: Time) -> None:
        """Assess every *interval*, and try a bad channel again after *retry*."""
        self._kernel = state.kernel
        self._air = state.air
        self._clock = state.clock
        self._links = state.links
        self._interval = interval
        self._quality = ChannelQuality(CHANNELS, LEAST_CHANNELS, retry)
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
            if self._quality.update(heard, failed, now):
                self._use()
                self._links.memberships.leave_out(self._quality.left_out, now)
        self.wake()

    def _use(self) -> None:
        used = in_order(self._quality.used)
        self._sets.used[self._links.master, : len(used)] = used
        self._links.piconet[USED] = len(used)
