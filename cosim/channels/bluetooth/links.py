"""The links of one piconet, each with two sides that may be up or not, and the idle slots that keep them alive."""

import numpy as np

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.polling import DOWN, DUE, HEARD_DOWN, HEARD_UP, HELD, JOINED, MOST_SLAVES, NEXT, UP
from cosim.channels.bluetooth.radio import Heard, Reach
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.errors import LocalProtocolError
from cosim.machine import Address
from cosim.units import Time


class Links:
    """Who belongs to the piconet of *master*, who hears whom there, and what its idle slots have done so far.

    Reach is asked for when it is needed first after a change, and holds until the next one.
    """

    def __init__(self, master: Address, clock: NativeClock, t_poll_slots: int, reach: Reach, frames: FrameLog) -> None:
        self.piconet, self.table = polling.new_state(t_poll_slots, clock.phase, clock.ppm)
        self.slaves: dict[int, Address] = {}
        """Address by LT_ADDR of every link that one side, at least, takes to be up."""
        self.lt_addr: dict[Address, int] = {}
        self._master = master
        self._clock = clock
        self._reach = reach
        self._frames = frames
        self._stale = True
        self._stale_since: Time = 0

    def held(self) -> list[int]:
        """Return the LT_ADDR of all links that the master takes to be up."""
        return [k for k in sorted(self.slaves) if self.table[HELD, k]]

    def up(self, k: int, side: int) -> bool:
        """Return whether one side, HELD or JOINED, of link *k* is up."""
        return k in self.slaves and bool(self.table[side, k])

    def join(self, slave: Address, k: int, now: Time) -> None:
        """Bring the slave's side of a new link up; the master's follows by :meth:`admit`."""
        if not 1 <= k <= MOST_SLAVES or k in self.slaves or slave in self.lt_addr:
            raise LocalProtocolError(f"LT_ADDR {k} or slave {slave} is not free in the piconet of {self._master}")
        self.slaves[k] = slave
        self.lt_addr[slave] = k
        self.table[:, k] = 0
        self.table[JOINED, k] = 1
        self.table[HEARD_DOWN, k] = now
        self.reach_changed(now)

    def admit(self, k: int, due: int, now: Time) -> None:
        """Bring the master's side of link *k* up; its next packet is due at the tick *due*."""
        self.table[HELD, k] = 1
        self.table[DUE, k] = due
        self.table[HEARD_UP, k] = now

    def take_down(self, k: int, side: int) -> None:
        """Take one side down; a link without sides is gone."""
        self.table[side, k] = 0
        if not self.table[HELD, k] and not self.table[JOINED, k]:
            del self.lt_addr[self.slaves.pop(k)]

    def advance(self, now: Time) -> None:
        """Decide all TX slots before *now*, which must be idle ones."""
        self.refresh()
        end = first_transmission(self._clock, now)
        if not self._frames.idle_wanted:
            polling.advance(self.piconet, self.table, end, polling.NO_LOG)
            return
        most = max(0, end - int(self.piconet[NEXT])) // 4 + 1
        log = np.empty((most, 2), dtype=np.int64)
        count = polling.advance(self.piconet, self.table, end, log)
        if count:
            down = {k: self.heard_down(k) for k in self.slaves}
            up = {k: self.heard_up(k) for k in self.slaves}
            self._frames.record_idle(log[:count], self._master, self.slaves, down, up)

    def reach_changed(self, now: Time) -> None:
        """Forget who hears whom: from *now* on it may be otherwise. All slots before must have been decided."""
        self._stale, self._stale_since = True, now

    def refresh(self) -> None:
        """Ask who hears whom if that may have changed."""
        if not self._stale:
            return
        for k, slave in self.slaves.items():
            self.table[DOWN, k] = self._reach(self._master, slave, self._stale_since)
            self.table[UP, k] = self._reach(slave, self._master, self._stale_since)
        self._stale = False

    def heard_down(self, k: int) -> Heard:
        """Return what becomes of a frame of the master at the slave of link *k*."""
        if not self.table[DOWN, k]:
            return Heard.OUT_OF_RANGE
        return Heard.RECEIVED if self.table[JOINED, k] else Heard.NOT_TUNED

    def heard_up(self, k: int) -> Heard:
        """Return what becomes of a frame of the slave of link *k* at the master."""
        return Heard.RECEIVED if self.table[UP, k] else Heard.OUT_OF_RANGE
