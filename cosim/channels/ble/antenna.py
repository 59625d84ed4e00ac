"""A device's one antenna: when it is taken, by what has begun and by what is planned.

It does one thing at a time. Events of links are known in advance and go before advertising, and that before scanning,
which has what is left.
"""

from collections import deque
from typing import Protocol

from cosim.channels.ble.ether import LOOKBACK
from cosim.units import Time


class Claim(Protocol):
    """Something that takes the antenna at times that follow from arithmetic: a link."""

    def taken_until(self, start: Time, end: Time) -> Time | None:
        """Return the end of what it does in [start, end), of the last such if there are several; None for nothing."""


class Antenna:
    """The antenna of one device; *claims* are its links."""

    def __init__(self) -> None:
        self.claims: list[Claim] = []
        self._booked: deque[tuple[Time, Time, object]] = deque()

    def book(self, start: Time, end: Time, owner: object = None) -> None:
        """Take it for [start, end)."""
        while self._booked and self._booked[0][1] < start - 2 * LOOKBACK:  # events that are looked at last 3 ms
            self._booked.popleft()
        self._booked.append((start, end, owner))

    def booked_until(self, start: Time, end: Time, owner: object = None) -> Time | None:
        """Return the end of what others than *owner* have taken it for in [start, end); None if that is nothing."""
        ends = [until for since, until, of in self._booked if since < end and until > start and of is not owner]
        return max(ends, default=None)

    def taken_until(self, start: Time, end: Time, owner: object = None) -> Time | None:
        """Return the end of what others than *owner* do, or will do, in [start, end); None if it is free."""
        ends = [self.booked_until(start, end, owner)]
        ends += [claim.taken_until(start, end) for claim in self.claims if claim is not owner]
        return max((each for each in ends if each is not None), default=None)
