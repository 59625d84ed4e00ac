"""Parked slaves: members of a piconet without one of its seven addresses (Core v1.2, Vol 2 Part B, section 8.7).

A parked slave keeps its clock with the master's and listens in beacon windows only: a number of slots from every
multiple of the interval, counted on the master's clock. The master begins each window with a broadcast packet, the
first of its queue or an empty one (NULL, LT_ADDR 0), and sends broadcasts in windows only while anybody is parked, so
that all hear them. A slave comes back at the first beacon that it hears after it was asked to.

Neglected are the air time of link manager messages and that of the access window, in which parked slaves answer: a
beacon that a slave hears tells the master that it is still there, if the slave is in reach of the master.
"""

from dataclasses import dataclass

from cosim.channels.bluetooth.links import ALWAYS, Links, Presence
from cosim.channels.bluetooth.polling import (
    BEACON,
    EVERYONE,
    HELD,
    JOINED,
    MOST_SLAVES,
    NEVER,
    NEXT,
    SNIFF_COUNT,
    SNIFF_FIRST,
    SNIFF_PERIOD,
)
from cosim.machine import Address
from cosim.units import SLOT, Time


@dataclass(slots=True)
class Member:
    """A parked slave."""

    slave: Address
    heard_down: Time
    """When it last heard the master, and..."""
    heard_up: Time
    """...the master it."""
    presence: Presence = ALWAYS
    held: bool = True
    """Whether the master takes it for a member, and..."""
    joined: bool = True
    """...it takes itself for one."""
    waking: bool = False
    """Whether it is to come back."""


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
        """Tell the arithmetic of slots whether there are beacons, and that broadcasts have to wait for them."""
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

    def up(self, number: int, side: int) -> bool:
        """Return whether one side, HELD or JOINED, takes a parked slave for a member."""
        member = self.members[number]
        return member.held if side == HELD else member.joined

    def take_down(self, number: int, side: int) -> None:
        """Let one side take the membership of a parked slave for ended."""
        member = self.members[number]
        if side == HELD:
            member.held = False
        else:
            member.joined = False
        if not member.held and not member.joined:
            del self.members[number]
        self._note()

    def silent(self, limit: Time) -> list[tuple[int, int]]:
        """Return (number, side) of those who have heard nothing since *limit*."""
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
