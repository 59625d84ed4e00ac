"""In which of its piconets a device is, and when: it can only be in one at a time."""

from collections.abc import Callable, Collection

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.links import ALWAYS, Presence
from cosim.errors import LocalProtocolError
from cosim.machine import Address, Share

AWAY = Presence(here=False)
ELSEWHERE = Presence(period=1, length=0)
"""It has divided its time, with no part for that piconet: its master knows that."""


class Attendance:
    """The presence of the device *address*: as its host has divided its time, else in the piconet of its latest link.

    *clock_of* returns the native clock of any device: parts are counted on the one that they refer to.
    """

    def __init__(self, address: Address, clock_of: Callable[[Address], NativeClock]) -> None:
        self._address = address
        self._clock_of = clock_of
        self._latest: list[Address] = []  # masters of its piconets, in the order in which links came up
        self._share: Share | None = None

    @property
    def linked(self) -> bool:
        """Whether the device has any link."""
        return bool(self._latest)

    def enter(self, master: Address) -> None:
        """Note that a link in the piconet of *master* has come up."""
        self._latest = [*(other for other in self._latest if other != master), master]

    def keep(self, masters: Collection[Address]) -> None:
        """Note that the device still has links in the piconets of *masters* only."""
        self._latest = [master for master in self._latest if master in masters]

    def share(self, share: Share | None) -> None:
        """Divide the time as the host has it; None, or no parts, for not at all.

        Raise LocalProtocolError for parts that overlap within the period, which may begin in the midst of one.
        """
        if share is not None:
            _check(share)
        self._share = share if share is not None and share.parts else None

    def presence(self, master: Address, busy: bool) -> Presence:
        """Return when the device is in the piconet of *master*; *busy* with a procedure it is in no other's.

        (The own piconet is suspended then, which need not be said twice.)
        """
        if busy and master != self._address:
            return self._planned(master)._replace(here=False)
        return self._planned(master)

    def _planned(self, master: Address) -> Presence:
        if self._share is None:
            return ALWAYS if not self._latest or self._latest[-1] == master else AWAY
        for part_of, first, count in self._share.parts:
            if part_of == master:
                clock = self._clock_of(self._share.reference)
                return Presence(True, 2 * self._share.period_slots, 2 * first, 2 * count, clock)
        return ELSEWHERE


def _check(share: Share) -> None:
    parts = sorted((first, count) for _, first, count in share.parts)
    later = [first for first, _ in parts[1:]] + [first + share.period_slots for first, _ in parts[:1]]
    for (first, count), following in zip(parts, later, strict=True):
        if not 0 <= first < share.period_slots or count < 1 or first + count > following:
            raise LocalProtocolError(f"parts {share.parts} overlap, or leave the period of {share.period_slots} slots")
