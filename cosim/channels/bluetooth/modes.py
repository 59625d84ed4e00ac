"""Hold, sniff and park: links that are not active all the time (Core v1.2, Vol 2 Part B, sections 8.5 to 8.7).

Either side may ask for a mode. If each is in reach of the other and the request is valid, the link changes its mode at
once on both sides, and both hosts get an event with the new mode. Otherwise the host that asked gets the mode that the
link is still in. The air time of the link manager's messages is neglected, as it is for a disconnection; a slot pair
under way is finished.

A link may not be silent for so long that it is lost: at most for the supervision time-out less twice T_poll, for the
waits before and after.
"""

from collections.abc import Callable
from functools import partial

from cosim.channels.bluetooth.links import Member
from cosim.channels.bluetooth.polling import (
    HELD,
    HELD_UNTIL,
    JOINED,
    MOST_SLAVES,
    NEXT,
    SNIFF_COUNT,
    SNIFF_FIRST,
    SNIFF_PERIOD,
)
from cosim.channels.bluetooth.state import PiconetState
from cosim.machine import Address, Hold, Mode, ModeChanged, ModeCommand, Park, Sniff, Unpark
from cosim.units import SLOT


class Modes:
    """The modes of the links of one piconet; *changed* is called after a change."""

    def __init__(self, state: PiconetState, changed: Callable[[], None]) -> None:
        self._kernel = state.kernel
        self._air = state.air
        self._clock = state.clock
        self._links = state.links
        self._queues = state.queues
        self._parking = state.parking
        self._longest = state.settings.supervision - 2 * state.settings.t_poll_slots * SLOT
        """Longest silence that a link survives."""
        self._report = state.report
        self._changed = changed

    def command(self, side: Address, command: ModeCommand) -> None:
        """Carry out a command of the host of *side*, the master or a slave."""
        self._air.advance(self._kernel.now)
        slave = command.peer if side == self._links.master else side
        known = self._links.master in (side, command.peer)
        if known and self._obey(slave, command):
            self._changed()
        else:
            self._report([(side, ModeChanged(command.peer, self.mode(slave) if known else Mode.NONE))])

    def members(self) -> list[Address]:
        """Return all devices that either side takes for members, parked or not."""
        return [*self._links.lt_addr, *(member.slave for member in self._parking.members.values())]

    def mode(self, slave: Address) -> Mode:
        """Return the mode of the link to *slave*."""
        if self._parking.number(slave) is not None:
            return Mode.PARKED
        k = self._links.lt_addr.get(slave)
        if k is None:
            return Mode.NONE
        table = self._links.table
        if table[HELD_UNTIL, k]:
            return Mode.HOLD
        return Mode.SNIFF if table[SNIFF_PERIOD, k] else Mode.ACTIVE

    def both_hear(self, slave: Address) -> bool:
        """Return whether the link to *slave* is up on both sides, each in reach of the other."""
        air, links = self._air, self._links
        k = links.lt_addr.get(slave, 0)
        ways = ((links.master, slave), (slave, links.master))
        return links.up(k, HELD) and links.up(k, JOINED) and all(air.reaches(air.carrier(*way)) for way in ways)

    def _obey(self, slave: Address, command: ModeCommand) -> bool:
        """Carry out the command if it is possible, and return whether it is."""
        if isinstance(command, Unpark):
            return self._wake(slave)
        if not self.both_hear(slave):
            return False
        k = self._links.lt_addr[slave]
        match command:
            case Hold():
                return self._hold(k, command.slots)
            case Sniff():
                return self._sniff(k, command)
            case Park():
                return self._park(k)

    # ------------------------------------------------------------ hold and sniff

    def _hold(self, k: int, slots: int) -> bool:
        if slots < 1 or slots * SLOT > self._longest:
            return False
        until = -(-(self._clock.tick(self._kernel.now) + 2 * slots) // 4) * 4
        self._links.table[HELD_UNTIL, k] = until
        self._kernel.at(self._clock.time_of(until), partial(self._hold_ends, k, self._links.slaves[k], until))
        self._note(k)
        return True

    def _hold_ends(self, k: int, slave: Address, until: int) -> None:
        table = self._links.table
        if self._links.slaves.get(k) == slave and table[HELD_UNTIL, k] == until:
            self._air.advance(self._kernel.now)
            table[HELD_UNTIL, k] = 0
            self._note(k)
            self._changed()

    def _sniff(self, k: int, wish: Sniff) -> bool:
        interval, offset, attempt = wish.interval_slots, wish.offset_slots, wish.attempt_slots
        if interval:
            even = interval % 2 == offset % 2 == attempt % 2 == 0
            fits = 0 <= offset < interval and 0 < attempt <= interval and interval * SLOT <= self._longest
            if not (even and fits):
                return False
        table = self._links.table
        table[SNIFF_PERIOD, k], table[SNIFF_FIRST, k], table[SNIFF_COUNT, k] = 2 * interval, 2 * offset, 2 * attempt
        self._note(k)
        return True

    def _note(self, k: int) -> None:
        """Note a change of mode in the arrays, and report it to both hosts."""
        self._links.note_shares()
        slave = self._links.slaves[k]
        mode = self.mode(slave)
        self._links.memberships.change_mode(slave, mode, self._kernel.now, self._parts(k) if mode is Mode.SNIFF else "")
        self._report_mode(slave)

    def _parts(self, k: int) -> str:
        """Return when a link in sniff mode is active, as the table of intervals has it."""
        interval, offset, attempt = (self._links.table[[SNIFF_PERIOD, SNIFF_FIRST, SNIFF_COUNT], k] // 2).tolist()
        return f"interval_slots={interval} offset_slots={offset} attempt_slots={attempt}"

    def _report_mode(self, slave: Address) -> None:
        master, mode = self._links.master, self.mode(slave)
        self._report([(master, ModeChanged(slave, mode)), (slave, ModeChanged(master, mode))])

    # ------------------------------------------------------------ park

    def _park(self, k: int) -> bool:
        if self._parking.interval > self._longest:
            return False
        links, now = self._links, self._kernel.now
        slave = links.slaves[k]
        events = self._queues.flush(k, slave) + self._queues.flush_link(k, links.master, master_alone=False)
        member = Member(slave, now, now, links.presence(k))
        links.take_down(k, HELD, now)
        links.take_down(k, JOINED, now)
        self._parking.add(member)
        links.memberships.change_mode(slave, Mode.PARKED, now)
        self._report(events)
        self._report_mode(slave)
        return True

    def _wake(self, slave: Address) -> bool:
        number = self._parking.number(slave)
        if number is None:
            return False
        waking = sum(member.waking for member in self._parking.members.values())
        member = self._parking.members[number]
        if not member.waking and len(self._links.slaves) + waking >= MOST_SLAVES:
            return False
        member.waking = True
        return True

    def beacon_heard(self, number: int) -> None:
        """Note that a parked slave has heard a broadcast packet that ends now; it may come back then."""
        member, links, now = self._parking.members[number], self._links, self._kernel.now
        member.heard_down = now
        if not member.held or not self._air.reaches(self._air.carrier(member.slave, links.master)):
            return
        member.heard_up = now
        k = links.free_lt_addr()
        if not member.waking:
            return
        member.waking = False
        if k is not None:
            self._parking.remove(number)
            links.memberships.change_mode(member.slave, Mode.ACTIVE, now)
            links.join(member.slave, k, now)
            links.set_presence(member.slave, member.presence)
            links.admit(k, int(links.piconet[NEXT]), now)
            self._changed()
        self._report_mode(member.slave)
