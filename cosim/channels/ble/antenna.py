"""A device's one antenna: when it is taken, by what has begun and by what is planned.

It does one thing at a time. Events of links are known in advance and go before advertising, and that before scanning,
which has what is left.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple, Protocol

from cosim.channels.air.arbitration import Rank, Seat
from cosim.channels.ble.packets import LOOKBACK, Sent
from cosim.channels.ble.phy import Phy
from cosim.channels.energy import RECEIVE, TRANSMIT, Use
from cosim.machine import Address
from cosim.units import Time

_EVER: Final[Time] = 1 << 62


class Doing(NamedTuple):
    """What a radio does in [start, end)."""

    start: Time
    end: Time
    use: Use


class Claim(Protocol):
    """Something that takes the antenna at times that follow from arithmetic: a link."""

    def taken_until(self, start: Time, end: Time) -> Time | None:
        """Return the end of what it does in [start, end), of the last such if there are several; None for nothing."""

    def claimed_until(self, address: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of what is planned in [start, end), and is more to *address* than *rank*; None for nothing."""

    def doing(self, address: Address, since: Time, until: Time) -> Iterable[Doing]:
        """Return what the device *address* does for it from a time in [since, until) on, if that is not noted."""


class Noting(Protocol):
    """Something that keeps count of what the radio does."""

    def note(self, doing: Doing) -> None:
        """Note what the radio will do, from now on or later."""

    def settle(self, now: Time) -> None:
        """Account for all times before *now*."""


class _Claimed(NamedTuple):
    """A claim, and since when, and up to when, it was one."""

    claim: Claim
    since: Time
    until: Time = _EVER


class Antenna:
    """The antenna of one device."""

    def __init__(self) -> None:
        self._claims: list[_Claimed] = []
        self._booked: deque[tuple[Time, Time, object, Time]] = deque()  # start, end, owner, when it was booked
        self.meter: Noting | None = None
        """What keeps count of its radio, if anything does."""
        self.seat: Seat | None = None
        """Where it asks before it sends, if another radio of the robot may have the air."""
        self.advertises: tuple[Time, Time] = (0, 0)
        """From when to when the last event of advertising lasts that it has asked for and was granted."""

    @property
    def claims(self) -> list[Claim]:
        """What takes it by arithmetic: its links."""
        return [claimed.claim for claimed in self._claims if claimed.until == _EVER]

    def claim(self, claim: Claim, now: Time) -> None:
        """Have *claim* take it from *now* on."""
        self.settle(now)
        self._claims.append(_Claimed(claim, now))

    def release(self, claim: Claim, now: Time) -> None:
        """Have *claim* take it no more."""
        self.settle(now)
        kept = [each for each in self._claims if each.until > now - 2 * LOOKBACK]
        self._claims = [
            each._replace(until=now) if each.claim is claim and each.until == _EVER else each for each in kept
        ]

    def book(self, start: Time, end: Time, owner: object, now: Time) -> None:
        """Take it for [start, end), as is decided *now*."""
        if self.meter is not None:
            self.meter.settle(now)
        while self._booked and self._booked[0][1] < now - 2 * LOOKBACK:  # events that are looked at last 3 ms
            self._booked.popleft()
        self._booked.append((start, end, owner, now))

    def settle(self, now: Time) -> None:
        """Have its radio accounted for up to *now*: what it does may be something else from then on."""
        if self.meter is not None:
            self.meter.settle(now)

    def sends(self, packet: Sent) -> None:
        """Note that its radio sends *packet*."""
        if self.meter is not None:
            self.meter.note(Doing(packet.start, packet.end, Use(TRANSMIT, packet.phy.name)))

    def listens(self, start: Time, end: Time, phy: Phy) -> None:
        """Note that its radio listens for a packet in [start, end)."""
        if self.meter is not None:
            self.meter.note(Doing(start, end, Use(RECEIVE, phy.name)))

    def booked_until(self, start: Time, end: Time, owner: object = None, known: Time = _EVER) -> Time | None:
        """Return the end of what others than *owner* have taken it for in [start, end); None if that is nothing.

        What was decided later than the instant *known* does not count.
        """
        ends = [
            until
            for since, until, of, made in self._booked
            if since < end and until > start and of is not owner and made <= known
        ]
        return max(ends, default=None)

    def refused_until(self, now: Time, start: Time, end: Time, rank: Rank) -> Time | None:
        """Ask *now* for the air in [start, end); return when what another radio of the robot uses it for is over.

        None if nothing is in the way.
        """
        return None if self.seat is None else self.seat.ask(now, start, end, rank)

    def used_until(self, address: Address, start: Time, end: Time, rank: Rank) -> Time | None:
        """Return the end of what has begun, or is more to the device *address* than *rank*, in [start, end)."""
        ends = [self.booked_until(start, end)]
        ends += [claim.claimed_until(address, start, end, rank) for claim in self.claims]
        if self.advertises[0] < end and self.advertises[1] > start:
            ends.append(self.advertises[1])
        return max((each for each in ends if each is not None), default=None)

    def taken_until(self, start: Time, end: Time, known: Time | None = None) -> Time | None:
        """Return the end of what is done, or will be done, in [start, end); None if it is free.

        That is what is known now, or was at the instant *known*.
        """
        at = _EVER - 1 if known is None else known
        ends = [self.booked_until(start, end, None, at)]
        ends += [each.claim.taken_until(start, end) for each in self._claims if each.since <= at < each.until]
        return max((each for each in ends if each is not None), default=None)
