"""Packet traffic arbitration (PTA): a robot's own radios in one air ask before they send, and one of them has the air.

Antennas of one robot are 10 to 30 dB apart, so a radio that sends leaves nothing of what another one would receive, on
any channel. What has to be sent is divided by time: a radio asks its robot's arbiter with the time that it needs and
the rank of what it is for. It is refused if another radio's use of more right overlaps that time: one that has begun,
or one that is planned, as an event of a link is. Who is refused waits, or leaves out what it was to send.

Nobody keeps a record of uses here: each radio answers for its own, out of what it knows of itself at that instant.
"""

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Final, NamedTuple, TypeAlias

from cosim.intervals import Intervals
from cosim.machine import Address
from cosim.units import Time

DEFERRED: Final = "deferred"
"""The state, in the table of intervals, of a radio that has been refused."""


class Rank(IntEnum):
    """What a use of the air is for: the greater one goes first."""

    EMPTY = 0
    FRAME = 1
    DATA = 2
    RECEPTION = 3
    SUPERVISION = 4
    BEGUN = 5


PRIORITIES: Final[dict[Rank, str]] = {
    Rank.BEGUN: "what has begun: a frame of 802.11 with the time that it reserves for answers, an event of Low Energy, "
    "a pair of slots of Bluetooth",
    Rank.SUPERVISION: "an event, or a pair, of a link that is lost soon if nothing is heard",
    Rank.RECEPTION: "a frame of 802.11 that is being received, and is for this robot or for all, and its answer",
    Rank.DATA: "an event, or a pair, of a link with something of this robot to send, a payload for everyone, "
    "a request for a link",
    Rank.FRAME: "a frame of 802.11 that has not begun",
    Rank.EMPTY: "an event, or a pair, with nothing of this robot to send, advertising, a request for a name, an ID",
}
"""What goes first, in that order; what is not here, such as scanning, asks for nothing.

That acknowledgements go before data is said of the packet traffic arbitration of IEEE 802.15.2-2003, whose text is not
at hand. Of vendors' coexistence modes one has all of Bluetooth but scanning go first (Microchip's BLE stack, PTA), one
has 802.11 go first and a colliding advertisement left out (Silicon Labs, SiWx91x): here that depends on whether there
is anything to say. That a link must not be lost by it, and what is received go on, are readings of our own.
"""

Uses: TypeAlias = Callable[[Time, Time, Rank], Time | None]
"""(start, end, rank) -> the end of what a radio uses the air for in [start, end), of what has begun or goes before
*rank*; None for nothing."""


class Refusal(NamedTuple):
    """A radio has been refused."""

    asked: Time
    until: Time
    """When the use of the radio that has the air is over."""
    by: int
    """The number of that radio."""


class Seat:
    """A radio at its robot's arbiter."""

    def __init__(self, arbiter: "Arbiter", radio: int, uses: Uses, intervals: Intervals) -> None:
        self.radio, self.uses = radio, uses
        self.refused = 0
        """How often it has been refused."""
        self._arbiter = arbiter
        self._intervals = intervals
        self._refusals: list[Refusal] = []
        """Those that are no rows yet, as they may last for longer than the run."""

    def ask(self, now: Time, start: Time, end: Time, rank: Rank) -> Time | None:
        """Ask *now* for the air in [start, end); return None if it is granted, else when the other use is over."""
        refusal = self._arbiter.refusal(self, now, start, end, rank)
        if refusal is None:
            return None
        self.refused += 1
        if self._intervals.wanted:
            self._write(now)
            self._refusals.append(refusal)
        return refusal.until

    def close(self, now: Time) -> None:
        """Write what is not written: the run is over."""
        self._refusals = [each._replace(until=min(each.until, now)) for each in self._refusals]
        self._write(now)

    def _write(self, now: Time) -> None:
        over = [each for each in self._refusals if each.until <= now]
        self._refusals = [each for each in self._refusals if each.until > now]
        for asked, until, by in over:
            self._intervals.add(self._arbiter.robot, asked, until, DEFERRED, f"radio={by}")


class Arbiter:
    """The arbiter of one *robot*."""

    def __init__(self, robot: Address) -> None:
        self.robot = robot
        self.seats: list[Seat] = []

    def refusal(self, seat: Seat, now: Time, start: Time, end: Time, rank: Rank) -> Refusal | None:
        """Return why *seat* must not use the air in [start, end), as is known *now*; None if it may."""
        found = None
        for other in self.seats:
            until = None if other is seat else other.uses(start, end, rank)
            if until is not None and (found is None or until > found.until):
                found = Refusal(now, until, other.radio)
        return found


class Arbitration:
    """The arbiters of those robots that have several radios; *carried* are the numbers of each one's radios."""

    def __init__(self, carried: Sequence[Sequence[int]]) -> None:
        self._carried = carried
        self._arbiters = {robot: Arbiter(robot) for robot, radios in enumerate(carried) if len(radios) > 1}

    def seat(self, robot: Address, radio: int, uses: Uses, intervals: Intervals) -> Seat | None:
        """Take in a *radio* of *robot*, which writes to *intervals*; None if it is the only one, or is not there."""
        if robot not in self._arbiters or radio not in self._carried[robot]:
            return None
        arbiter = self._arbiters[robot]
        arbiter.seats.append(Seat(arbiter, radio, uses, intervals))
        return arbiter.seats[-1]

    def refused(self, radio: int) -> int:
        """Return how often robots' radios of that number have been refused."""
        return sum(seat.refused for seat in self._seats if seat.radio == radio)

    def close(self, now: Time) -> None:
        """Write what is not written: the run is over."""
        for seat in self._seats:
            seat.close(now)

    @property
    def _seats(self) -> list[Seat]:
        return [seat for arbiter in self._arbiters.values() for seat in arbiter.seats]
