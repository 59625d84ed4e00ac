"""Where devices of Bluetooth ask before they send, if other radios of their robots are in the same air."""

from collections.abc import Callable
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.air.arbitration import Arbitration, Rank
from cosim.channels.bluetooth.packets import ID_AIR
from cosim.channels.bluetooth.polling import SNIFF_PERIOD, T_POLL, State
from cosim.intervals import Intervals
from cosim.kernel import Kernel
from cosim.machine import Address
from cosim.units import TICK, Time

LAST_POLLS: Final = 6
"""Number of polls left until its supervision time-out with which a link is lost soon."""
Planned: TypeAlias = Callable[[Address, Time, Time, Rank], Time | None]
"""(device, start, end, rank) -> the end of what it plans to send in [start, end) and is more than *rank*, or None."""


class Seats:
    """The seats of devices at their robots' arbiters: what they ask there, and answer to the robots' other radios."""

    def __init__(
        self, arbitration: Arbitration, radio: int, kernel: Kernel, size: int, supervision: Time, intervals: Intervals
    ) -> None:
        """*supervision* is the time-out of all links; *intervals* take the times for which a device is refused."""
        seats = [arbitration.seat(each, radio, partial(self._used_until, each), intervals) for each in range(size)]
        self.planned: Planned = lambda device, start, end, rank: None
        self._seats = {device: seat for device, seat in enumerate(seats) if seat is not None}
        self._kernel, self._supervision = kernel, supervision
        self._begun: Int64s = np.zeros(size, np.int64)
        """When the last of what each has begun is over, with the answers to it."""
        self._silences: dict[Address, tuple[Time, Time]] = {}
        """From when to when the last IDs are left out that each was refused."""

    @property
    def taken(self) -> bool:
        """True if any device has a seat: its robot has other radios in the air."""
        return bool(self._seats)

    def refused_until(self, device: Address, end: Time, rank: Rank) -> Time | None:
        """Ask for the air from now to *end*, in which *device* begins something at once unless it is refused.

        Return when the other radio's use is over in that case, else None.
        """
        seat = self._seats.get(device)
        if seat is None:
            return None
        now = self._kernel.now
        until = seat.ask(now, now, end, rank)
        if until is None:
            self.begin(device, end)
        return until

    def begin(self, device: Address, end: Time) -> None:
        """Note that *device* does something until *end* that it has begun."""
        self._begun[device] = max(int(self._begun[device]), end)

    def ask_for_id(self, device: Address) -> Time | None:
        """Ask for an ID that is to begin now, as :meth:`refused_until` does."""
        now = self._kernel.now
        until = self.refused_until(device, now + ID_AIR, Rank.EMPTY)
        if until is not None:
            self._silences[device] = now, until
        return until

    def has_sent_id(self, device: Address, start: Time) -> bool:
        """Return whether *device* has sent the ID of *start*, of late, for all that its robot's other radios do."""
        since, until = self._silences.get(device, (0, 0))
        return not since <= start < until

    def rank(self, piconet: State, links: State, k: int, heard: int, data: bool, at: Time) -> Rank:
        """Return what a pair of link *k* at an instant is to the side that *heard*, a row of *links*, belongs to.

        *data* is True if that has something to say.
        """
        interval = TICK * max(int(piconet[T_POLL]), int(links[SNIFF_PERIOD, k]))
        left = int(links[heard, k]) + self._supervision - at
        if left <= min(LAST_POLLS * interval, self._supervision // 2):
            return Rank.SUPERVISION
        return Rank.DATA if data else Rank.EMPTY

    def _used_until(self, device: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        begun = int(self._begun[device])
        ends = [begun] if begun > start else []
        if rank < Rank.SUPERVISION and (planned := self.planned(device, start, end, rank)) is not None:
            ends.append(planned)
        return max(ends, default=None)
