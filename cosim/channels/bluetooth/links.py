"""The members of one piconet: its links, each with two sides that may be up or not, and its parked slaves.

A parked slave is a member without one of the seven addresses (Core v1.2, Vol 2 Part B, section 8.7). It keeps its clock
with the master's and listens in beacon windows only: a number of slots from every multiple of the interval, counted on
the master's clock. The master begins each window with a broadcast packet, the first of its queue or an empty one (NULL,
LT_ADDR 0), and sends broadcasts in windows only while a slave is parked, so that all slaves hear them. A slave comes
back at the first beacon that it hears after it was asked to.

Neglected are the air time of link manager messages and that of the access window, in which parked slaves answer: a
beacon that a slave hears also shows the master that the slave is still there, if it is in reach of the master.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.polling import (
    BEACON,
    CLOCK_PHASE,
    CLOCK_PPM,
    COUNT,
    DUE,
    EVERYONE,
    FIRST,
    FULL_UNTIL,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    HELD_UNTIL,
    HERE,
    JOINED,
    MOST_SLAVES,
    NEVER,
    NEXT,
    PERIOD,
    SHARED,
    SLAVE,
    SNIFF_COUNT,
    SNIFF_FIRST,
    SNIFF_PERIOD,
    State,
)
from cosim.channels.bluetooth.transport import Transport
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError
from cosim.intervals import Intervals
from cosim.machine import Address, Mode
from cosim.ranges import ranges_of
from cosim.trace import Trace
from cosim.units import SLOT, Time


class Presence(NamedTuple):
    """The presence of a device in a piconet: never unless *here*; for *length* from *first* in every *period*, if set.

    Ticks, counted on *clock*.
    """

    here: bool = True
    period: int = 0
    first: int = 0
    length: int = 0
    clock: NativeClock = NativeClock(0)


ALWAYS = Presence()
MODES: Final = {Mode.HOLD: "hold", Mode.SNIFF: "sniff", Mode.PARKED: "park"}
"""The states in which links are that are not active all the time."""


class Memberships:
    """The intervals of the piconet of *master*: members, their absence, and the channels that are left out."""

    def __init__(self, master: Address, intervals: Intervals | None = None) -> None:
        self._master = master
        self._intervals = Intervals(Trace()) if intervals is None else intervals
        self._open: dict[tuple[Address, Address], dict[str, str]] = {}
        """Details by state of what each side of a link is in; a side is (device, slave)."""
        self._presence: dict[Address, Presence] = {}
        self._suspended = False
        self._meanwhile: dict[tuple[Address, str], tuple[str, str]] = {}
        """State and detail of what lasts while a device is a member, by the device and what it is about."""

    def begin(self, device: Address, slave: Address, lt_addr: int, now: Time) -> None:
        """Note that *device*, the master or the *slave*, takes the link between them to be up."""
        if self._intervals.wanted:
            state = "master" if device == self._master else "slave"
            self._enter(device, slave, state, f"lt_addr={lt_addr}", now)
            for (of, _), (other, detail) in self._meanwhile.items():
                if of == device:
                    self._intervals.begin(device, other, now, detail)

    def change_presence(self, device: Address, presence: Presence, now: Time) -> None:
        """Note when *device*, the master or a slave, is there."""
        if self._intervals.wanted:
            self._presence[device] = presence
            self._change(device, "presence", self._absence(device), now)

    def suspend(self, suspended: bool, now: Time) -> None:
        """Note whether the master leaves its piconet alone from *now* on, for an inquiry or a page."""
        if self._intervals.wanted:
            self._suspended = suspended
            self._change(self._master, "presence", self._absence(self._master), now)

    def leave_out(self, channels: Sequence[int], now: Time) -> None:
        """Note that the hop set leaves out *channels*, ascending, from *now* on."""
        if self._intervals.wanted:
            told = ("afh", f"channels={ranges_of(channels)}") if channels else None
            self._change(self._master, "hop set", told, now)

    def _absence(self, device: Address) -> tuple[str, str] | None:
        """Return the state of a device that is not there all the time, and its detail; None for one that is."""
        presence = self._presence.get(device, ALWAYS)
        suspended = self._suspended and device == self._master
        if not presence.here or suspended or (presence.period and not presence.length):
            return "away", f"master={self._master}"
        if not presence.period:
            return None
        period, first, length = (ticks // 2 for ticks in (presence.period, presence.first, presence.length))
        parts = f"interval_slots={period} offset_slots={first} attempt_slots={length}"
        return "part_time", f"master={self._master} {parts} phase_ns={presence.clock.phase} ppm={presence.clock.ppm}"

    def _change(self, device: Address, what: str, doing: tuple[str, str] | None, now: Time) -> None:
        """Note what *device* does from *now* on, or None, for as long as it is a member."""
        before = self._meanwhile.pop((device, what), None)
        if doing is not None:
            self._meanwhile[device, what] = doing
        if before is not None and before != doing:
            self._intervals.end(device, before[0], now, before[1])
        if doing is not None and self._is_member(device):
            self._intervals.begin(device, doing[0], now, doing[1])

    def _is_member(self, device: Address) -> bool:
        return any(of == device and states for (of, _), states in self._open.items())

    def change_mode(self, slave: Address, mode: Mode, now: Time, more: str = "") -> None:
        """Note that the link to *slave* is in *mode* on both sides; *more* tells about the mode."""
        if not self._intervals.wanted:
            return
        wanted = MODES.get(mode)
        for device in (self._master, slave):
            states = self._open.get((device, slave), {})
            member = bool(states) or mode is Mode.PARKED
            for state in [state for state in states if state in MODES.values()]:
                if state != wanted or states[state] != self._detail(device, slave, more):
                    self._leave(device, slave, state, now)
            if wanted is not None and member:
                self._enter(device, slave, wanted, more, now)

    def end(self, device: Address, slave: Address, now: Time) -> None:
        """Note that *device* does not take *slave*, or itself, for a member any more."""
        for state in list(self._open.get((device, slave), ())):
            self._leave(device, slave, state, now)
        if not self._is_member(device):
            for (of, _), (state, detail) in self._meanwhile.items():
                if of == device:
                    self._intervals.end(device, state, now, detail)

    def _enter(self, device: Address, slave: Address, state: str, more: str, now: Time) -> None:
        detail = self._detail(device, slave, more)
        self._open.setdefault((device, slave), {})[state] = detail
        self._intervals.begin(device, state, now, detail)

    def _detail(self, device: Address, slave: Address, more: str) -> str:
        peer = f"slave={slave}" if device == self._master else f"master={self._master}"
        return f"{peer} {more}" if more else peer

    def _leave(self, device: Address, slave: Address, state: str, now: Time) -> None:
        self._intervals.end(device, state, now, self._open[device, slave].pop(state))


class Links:
    """The links of the piconet of *master*; *piconet* and *table* are its arrays (see ``polling``).

    *transport* brings payloads to hosts, and may have no room for more; without it they take everything at once.
    """

    def __init__(
        self,
        master: Address,
        piconet: State,
        table: State,
        transport: Transport | None = None,
        memberships: Memberships | None = None,
    ) -> None:
        self.piconet = piconet
        self.table = table
        self.slaves: dict[int, Address] = {}
        """Address by LT_ADDR of every link that one side, at least, takes to be up."""
        self.lt_addr: dict[Address, int] = {}
        self.master = master
        self.transport = transport
        self.memberships = memberships or Memberships(master)
        """Who is a member, and in which mode, for who wants to see it."""
        self.note_shares()

    def held(self) -> list[int]:
        """Return the LT_ADDR of all links that the master takes to be up."""
        return [k for k in sorted(self.slaves) if self.table[HELD, k]]

    def audience(self) -> bool:
        """Return whether the master takes any device to hear its broadcasts."""
        return any(self.table[HELD].tolist())

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
        self.memberships.begin(slave, slave, k, now)
        if self.transport is not None:  # it may still hold what came over an earlier link
            self.table[FULL_UNTIL, k] = self.transport.full_until(slave, self.master)

    def admit(self, k: int, due: int, now: Time) -> None:
        """Bring the master's side of link *k* up; its next packet is due at the tick *due*."""
        self.table[HELD, k] = 1
        self.table[DUE, k] = due
        self.table[HEARD_UP, k] = now
        self.memberships.begin(self.master, self.slaves[k], k, now)

    def take_down(self, k: int, side: int, now: Time) -> None:
        """Take one side down; a link without sides is gone."""
        self.memberships.end(self.master if side == HELD else self.slaves[k], self.slaves[k], now)
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
        """Note in the arrays whether any device is absent at times, or may be stopped."""
        columns, table = [0, *self.slaves], self.table
        absences = [table[field].tolist() for field in (PERIOD, SNIFF_PERIOD, HELD_UNTIL)]
        here = table[HERE].tolist()
        absent = any(not here[k] or any(absence[k] for absence in absences) for k in columns)
        self.piconet[SHARED] = absent or self.transport is not None

    def last_heard(self) -> Time | None:
        """Return the earliest of all "last heard" instants of sides that are up, or None without any."""
        heard = polling.last_heard(self.table)
        return None if heard == polling.NOTHING else heard


@dataclass(slots=True)
class Member:
    """A parked slave."""

    slave: Address
    heard_down: Time
    """Instant at which it last heard the master."""
    heard_up: Time
    """Instant at which the master last heard it."""
    presence: Presence = ALWAYS
    held: bool = True
    """True if the master takes it for a member."""
    joined: bool = True
    """True if it takes itself for a member."""
    waking: bool = False
    """True if it has been asked to come back."""


class Parking:
    """The parked slaves of a piconet, by numbers above those of its links."""

    def __init__(self, links: Links, interval_slots: int, window_slots: int) -> None:
        self.members: dict[int, Member] = {}
        self.interval: Time = interval_slots * SLOT
        self._links = links
        self._period = 2 * interval_slots
        self._window = 2 * window_slots

    def number(self, slave: Address) -> int | None:
        """Return the number of the parked *slave*, or None."""
        return next((number for number, member in self.members.items() if member.slave == slave), None)

    def add(self, member: Member) -> None:
        """Park a slave whose link is down by now."""
        number = MOST_SLAVES + 1
        while number in self.members:
            number += 1
        self.members[number] = member
        self._note()

    def remove(self, number: int) -> Member:
        """Forget a parked slave, or take it back."""
        member = self.members.pop(number)
        self._note()
        return member

    def _note(self) -> None:
        """Note in the arrays whether there are beacons, for which broadcasts have to wait."""
        piconet, table = self._links.piconet, self._links.table
        held = any(member.held for member in self.members.values())
        table[HELD, EVERYONE] = held
        table[SNIFF_PERIOD, EVERYONE] = self._period if held else 0
        table[SNIFF_FIRST, EVERYONE], table[SNIFF_COUNT, EVERYONE] = 0, self._window
        if not held:
            piconet[BEACON] = NEVER
        elif piconet[BEACON] == NEVER:
            piconet[BEACON] = self._after(int(piconet[NEXT]) - 1)
        self._links.note_shares()

    def listeners(self) -> list[tuple[Address, Address, int, int]]:
        """Return (master, slave, ticks from a beacon window to the next, ticks of a window) of slaves that listen."""
        members = (member for member in self.members.values() if member.joined and member.presence.here)
        return [(self._links.master, member.slave, self._period, self._window) for member in members]

    def up(self, number: int, side: int) -> bool:
        """Return whether one side, HELD or JOINED, takes a parked slave for a member."""
        member = self.members[number]
        return member.held if side == HELD else member.joined

    def take_down(self, number: int, side: int, now: Time) -> None:
        """End the membership of a parked slave on one side."""
        member = self.members[number]
        self._links.memberships.end(self._links.master if side == HELD else member.slave, member.slave, now)
        if side == HELD:
            member.held = False
        else:
            member.joined = False
        if not member.held and not member.joined:
            del self.members[number]
        self._note()

    def silent(self, limit: Time) -> list[tuple[int, int]]:
        """Return (number, side) of the sides that have heard nothing since *limit*."""
        master = [(number, HELD) for number, member in self.members.items() if member.held and member.heard_up <= limit]
        slaves = [(number, JOINED) for number, m in self.members.items() if m.joined and m.heard_down <= limit]
        return sorted(master + slaves)

    def sent(self, tick: int) -> None:
        """Note that a broadcast, or an empty beacon, has been sent at *tick*."""
        if self._links.piconet[BEACON] <= tick:
            self._links.piconet[BEACON] = self._after(tick)

    def _after(self, tick: int) -> int:
        """Return the first tick of the first window that begins after *tick*."""
        return (tick // self._period + 1) * self._period

    def last_heard(self) -> Time | None:
        """Return the earliest of all "last heard" instants of sides that are up, or None without any."""
        heard = [member.heard_up for member in self.members.values() if member.held]
        heard += [member.heard_down for member in self.members.values() if member.joined]
        return min(heard, default=None)
