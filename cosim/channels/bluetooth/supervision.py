"""Link supervision (Core v1.2, Vol 2 Part B, section 3.1): a side that has heard nothing for too long lets go."""

from collections.abc import Callable

from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.parking import Parking
from cosim.channels.bluetooth.polling import HEARD_DOWN, HEARD_UP, HELD, JOINED
from cosim.kernel import WAKE, Handle, Kernel
from cosim.units import Time


class Supervision:
    """One kernel event for the earliest time-out of all sides of all links of a piconet, parked slaves included.

    *expire* is called at a time-out with (LT_ADDR or number, HELD or JOINED) of each side that has heard nothing for so
    long, perhaps none: that a deadline has moved later is found when its event fires.
    """

    def __init__(
        self,
        kernel: Kernel,
        timeout: Time,
        links: Links,
        parking: Parking,
        advance: Callable[[Time], None],
        expire: Callable[[list[tuple[int, int]]], None],
    ) -> None:
        self._kernel = kernel
        self._timeout = timeout
        self._links = links
        self._parking = parking
        self._advance = advance
        self._expire = expire
        self._pending: Handle | None = None

    def watch(self) -> None:
        """Wait for the earliest time-out."""
        sides = [heard for heard in (self._links.last_heard(), self._parking.last_heard()) if heard is not None]
        if not sides:
            return
        deadline = min(sides) + self._timeout
        if self._pending is not None:
            if self._pending.time <= deadline:
                return
            self._pending.cancel()
        self._pending = self._kernel.at(deadline, self._look, WAKE)

    def _look(self) -> None:
        self._pending = None
        now, table = self._kernel.now, self._links.table
        self._advance(now)
        limit = now - self._timeout
        silent = [
            (k, side)
            for k in sorted(self._links.slaves)
            for side, heard in ((HELD, HEARD_UP), (JOINED, HEARD_DOWN))
            if table[side, k] and table[heard, k] <= limit
        ]
        self._expire(silent + self._parking.silent(limit))
        self.watch()
