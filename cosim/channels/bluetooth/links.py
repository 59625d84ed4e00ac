"""The links of one piconet, each with two sides that may be up or not, and who is present in it when."""

from typing import NamedTuple

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.polling import (
    CLOCK_PHASE,
    CLOCK_PPM,
    COUNT,
    DUE,
    FIRST,
    FULL_UNTIL,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    HELD_UNTIL,
    HERE,
    JOINED,
    MOST_SLAVES,
    PERIOD,
    SHARED,
    SLAVE,
    SNIFF_PERIOD,
    State,
)
from cosim.channels.bluetooth.transport import Transport
from cosim.errors import LocalProtocolError
from cosim.machine import Address
from cosim.units import Time


class Presence(NamedTuple):
    """When a device is in a piconet: never unless *here*; for *length* from *first* in every *period*, if set.

    Ticks, counted on *clock*.
    """

    here: bool = True
    period: int = 0
    first: int = 0
    length: int = 0
    clock: NativeClock = NativeClock(0)


ALWAYS = Presence()


class Links:
    """Who belongs to the piconet of *master*; *piconet* and *table* are its arrays (see ``polling``).

    *transport* brings payloads to hosts, and may have no room for more; without it they take everything at once.
    """

    def __init__(self, master: Address, piconet: State, table: State, transport: Transport | None = None) -> None:
        self.piconet = piconet
        self.table = table
        self.slaves: dict[int, Address] = {}
        """Address by LT_ADDR of every link that one side, at least, takes to be up."""
        self.lt_addr: dict[Address, int] = {}
        self.master = master
        self.transport = transport
        self.note_shares()

    def held(self) -> list[int]:
        """Return the LT_ADDR of all links that the master takes to be up."""
        return [k for k in sorted(self.slaves) if self.table[HELD, k]]

    def audience(self) -> bool:
        """Return whether the master takes anybody to hear what it broadcasts."""
        return bool(self.table[HELD].any())

    def up(self, k: int, side: int) -> bool:
        """Return whether one side, HELD or JOINED, of link *k* is up."""
        return k in self.slaves and bool(self.table[side, k])

    def join(self, slave: Address, k: int, now: Time) -> None:
        """Bring the slave's side of a new link up; the master's follows by :meth:`admit`."""
        if not 1 <= k <= MOST_SLAVES or k in self.slaves or slave in self.lt_addr:
            raise LocalProtocolError(f"LT_ADDR {k} or slave {slave} is not free in the piconet of {self.master}")
        self.slaves[k] = slave
        self.lt_addr[slave] = k
        self.table[:, k] = 0
        self.table[JOINED, k] = 1
        self.table[SLAVE, k] = slave
        self.table[HERE, k] = 1
        self.table[HEARD_DOWN, k] = now
        if self.transport is not None:  # it may still hold what came over an earlier link
            self.table[FULL_UNTIL, k] = self.transport.full_until(slave, self.master)

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
            self.note_shares()

    def set_presence(self, device: Address, presence: Presence) -> None:
        """Note when *device*, the master or a slave, is there."""
        k = 0 if device == self.master else self.lt_addr[device]
        table, clock = self.table, presence.clock
        table[HERE, k] = presence.here
        table[PERIOD, k], table[FIRST, k], table[COUNT, k] = presence.period, presence.first, presence.length
        table[CLOCK_PHASE, k], table[CLOCK_PPM, k] = clock.phase, clock.ppm
        self.note_shares()

    def presence(self, k: int) -> Presence:
        """Return when the device of column *k*, the master (0) or a slave, is there."""
        here, period, first, length, phase, ppm = self.table[[HERE, PERIOD, FIRST, COUNT, CLOCK_PHASE, CLOCK_PPM], k]
        return Presence(bool(here), int(period), int(first), int(length), NativeClock(int(phase), int(ppm)))

    def free_lt_addr(self) -> int | None:
        """Return the smallest LT_ADDR that no side of a link uses, or None."""
        return next((k for k in range(1, MOST_SLAVES + 1) if k not in self.slaves), None)

    def note_shares(self) -> None:
        """Tell the arithmetic of slots whether anybody is absent at times, or may be stopped."""
        columns = [0, *self.slaves]
        absences = self.table[[PERIOD, SNIFF_PERIOD, HELD_UNTIL]][:, columns]
        absent = bool(absences.any() or not self.table[HERE, columns].all())
        self.piconet[SHARED] = absent or self.transport is not None

    def last_heard(self) -> Time | None:
        """Return the earliest of all "last heard" instants of sides that are up, or None without any."""
        heard = polling.last_heard(self.table)
        return None if heard == polling.NOTHING else heard
