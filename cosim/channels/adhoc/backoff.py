"""The back-off of one station: a number of slots that have to be idle, drawn from a window that failures double."""

from typing import Final

from cosim.channels.adhoc.mac import Access
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time

BACKOFF: Final = 1
"""The purpose of the draws."""


class Backoff:
    """What one station has to wait besides the interframe space (IEEE 802.11-1999, 9.2.4 and 9.2.5.2)."""

    def __init__(self, address: Address, access: Access, slot: Time, draws: Draws) -> None:
        self.pending = False
        """There is one to be done."""
        self._address = address
        self._access = access
        self._slot = slot
        self._draws = draws
        self._drawn = 0
        self._window = access.cw_min
        self._slots = 0
        self._not_before: Time = 0
        self._counted_from: Time = 0

    def draw(self, not_before: Time) -> None:
        """Draw a new one, whose slots count from *not_before* on at the earliest."""
        self._slots = self._draws.below(self._window + 1, self._drawn, self._address, BACKOFF)
        self._drawn += 1
        self._not_before = not_before
        self.pending = True

    def ends_at(self, idle: Time) -> Time:
        """Count on from *idle*, the end of the interframe space; return when it is done if the medium stays idle."""
        self._counted_from = max(idle, self._not_before)
        return self._counted_from + self._slots * self._slot

    def interrupt(self, sensed_at: Time) -> None:
        """Take off the slots that have ended before *sensed_at*, at which the medium is known to be busy."""
        over = sensed_at - self._counted_from
        if over > 0:
            self._slots -= -(-over // self._slot) - 1
            if self._access.bianchi_counting:
                self._slots = max(self._slots - 1, 0)

    def widen(self) -> None:
        """Double the window, up to its greatest."""
        self._window = min(2 * self._window + 1, self._access.cw_max)

    def narrow(self) -> None:
        """Put the window back to its smallest."""
        self._window = self._access.cw_min
