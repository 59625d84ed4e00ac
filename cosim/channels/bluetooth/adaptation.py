"""Adapted hop sets at work: a master assesses its channels from time to time, and all its slaves hop with it.

A new hop set is used by all from the next TX slot on; that the link manager's messages which tell it take air time, and
that a slave may miss them, is neglected.
"""

from cosim.channels.bluetooth.afh import ChannelMap
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.polling import NEXT, RUNNING, USED, time_of
from cosim.channels.bluetooth.radio import Air
from cosim.kernel import Handle, Kernel
from cosim.units import Time


class Adaptation:
    """The hop set of one piconet: all channels at first, assessed every *interval* while there are links."""

    def __init__(self, kernel: Kernel, air: Air, links: Links, interval: Time, retry: Time) -> None:
        self._kernel = kernel
        self._air = air
        self._links = links
        self._interval = interval
        self._map = ChannelMap(retry)
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
        boundary = int(time_of(piconet, piconet[NEXT]))
        if piconet[RUNNING] and boundary > now:
            self._pending = self._kernel.at(boundary, self._assess)
            return
        self._pending = None
        if piconet[RUNNING]:
            tallies = self._air.band.tallies[self._links.master]
            heard, failed = tallies.tolist()
            tallies[:] = 0
            if self._map.update(heard, failed, now):
                self._use()
        self.wake()

    def _use(self) -> None:
        used = self._map.used
        self._air.band.used[self._links.master, : len(used)] = used
        self._links.piconet[USED] = len(used)
