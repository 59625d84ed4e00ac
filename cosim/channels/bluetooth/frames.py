"""The frames of one connected piconet, counted by type and, if anybody asks, recorded with channel and outcome."""

from collections import Counter

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.channels.bluetooth.polling import SLAVE
from cosim.channels.bluetooth.radio import Air, Fate, Frame
from cosim.machine import Address


class FrameLog:
    """What is on the air of the piconet of *master*.

    *wanted*: record the frames of transactions that a payload takes part in; *idle_wanted*: idle POLL and NULL as well.
    """

    def __init__(
        self, air: Air, master: Address, clock: NativeClock, wanted: bool = False, idle_wanted: bool = False
    ) -> None:
        self.wanted = wanted or idle_wanted
        self.idle_wanted = idle_wanted
        self.payloads: Counter[str] = Counter()
        """Frames with user data by packet type, retransmissions and repetitions included."""
        self._air = air
        self._master = master
        self._clock = clock

    def attach(self, links: Links) -> None:
        """Record the idle frames of *links*, if they are wanted."""
        self._links = links
        if self.idle_wanted:
            self._air.tell_idle(self._master, self._record_idle)

    def record(self, frame: Frame, fate: Fate) -> None:
        """Record a frame of a transaction."""
        self._air.record(frame, fate)

    def _record_idle(self, tick: int, k: int, up: bool, fate: Fate) -> None:
        slave = int(self._links.table[SLAVE, k])  # the link itself may be gone by the end of the frame
        source, destination = (slave, self._master) if up else (self._master, slave)
        channel = self._air.channel(self._master, tick)
        start, kind = self._clock.time_of(tick), "NULL" if up else "POLL"
        self._air.record(Frame(start, HEADER_AIR, kind, source, destination, channel, k), fate)
