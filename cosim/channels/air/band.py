"""The band that channels share: they tell it what they send, and ask it what disturbs what they receive.

Channels may run ahead lazily: an idle piconet decides its slots when somebody asks for what it has sent. So before the
band answers for a time, all its tenants catch up to it, and may ask themselves what has disturbed them so far. That
ends, and comes to the same in any order, since what is sent at a time depends on receptions that have ended by then
only: who catches up to a time asks for earlier times.
"""

from typing import Final, NamedTuple, Protocol

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats, Int64s
from cosim.channels.air.emissions import (
    COLUMNS,
    GENERATION,
    Listening,
    Table,
    Tuning,
    Wanted,
    forget,
    insert,
    insert_all,
    overlapping,
    sections,
)
from cosim.channels.air.spectra import SENDERS, shares
from cosim.errors import LocalProtocolError
from cosim.units import Time

_ROOM: Final = 256
"""Number of emissions that a new band has room for."""
_NEVER: Final[Time] = -(1 << 62)
_EVER: Final[Time] = 1 << 62


class Emission(NamedTuple):
    """Something sent on one channel without a pause; all of it arrives at once."""

    start: Time
    end: Time
    """The first instant at which it is over."""
    kind: int
    """One of the senders of ``spectra``."""
    centre: int
    """In steps of 0.5 MHz: 4804 is 2402 MHz."""
    sender: int
    """The number of the radio."""
    tenant: int
    """The number of the channel that it belongs to."""
    sent_mw: float


class Section(NamedTuple):
    """A time [start, end) during which the same interference is received."""

    start: Time
    end: Time
    mw: float


class Tenant(Protocol):
    """A channel that shares a band."""

    @property
    def asks_from(self) -> Time:
        """Instant from which it may still ask for interference.

        It is the start of the oldest reception under way, or of what is not decided yet by who has not caught up.
        """

    def catch_up(self, until: Time) -> None:
        """Tell the band all emissions that start before *until*, in their order of time.

        It may ask the band for times before *until* only, and tells nothing later that starts before *until*.
        """


class Band:
    """A band of radio frequencies, and what *size* radios send in it and receive of it.

    Several channels may each have a radio of the same number, on one robot. What one of them sends comes to the others
    weakened by *isolation_db*, and not at all to itself: it is half duplex.
    """

    def __init__(self, size: int, isolation_db: float) -> None:
        self._isolation = float(elementary.exp10(-isolation_db / 10.0))
        self._tenants: list[Tenant] = []
        self._told: list[Time] = []
        """Instants before which each tenant has told all that it sends."""
        self._catching: Time = _EVER
        """Instant to which a tenant is catching up."""
        rows, sent_mw = np.zeros((_ROOM, COLUMNS), np.int64), np.zeros(_ROOM)
        self.table = Table(rows, sent_mw, np.zeros(2, np.int64), np.zeros((1, size, size)), shares())
        """What is on the air, for kernels; another one whenever there is more room, or radios move."""

    def join(self, tenant: Tenant) -> int:
        """Take *tenant* in; return its number."""
        self._tenants.append(tenant)
        self._told.append(_NEVER)
        return len(self._tenants) - 1

    def grow(self, count: int) -> None:
        """Make room for *count* more senders, which are received by nobody before the next :meth:`moved`."""
        table = self.table
        self.table = table._replace(gains=np.pad(table.gains, ((0, 0), (0, count), (0, count))))

    def moved(self, gains_db: Floats, now: Time) -> None:
        """Take the gains in dB between all radios, (size, size), for what is sent from *now* on.

        What is on the air keeps the gains of its start: who sends for longer ends, and begins anew. Gains are those of
        ``propagation``, with walls, barriers and shadowing; the diagonal does not matter.
        """
        self.settle(now)
        self._forget()
        gains = np.asarray(elementary.exp10s(np.asarray(gains_db, np.float64) / 10.0))
        np.fill_diagonal(gains, self._isolation)
        table = self.table
        used = set(table.rows[: table.state[0], GENERATION].tolist())
        free = next(number for number in range(len(used) + 1) if number not in used)
        if free == len(table.gains):
            self.table = table = table._replace(gains=np.concatenate((table.gains, gains[None])))
        table.gains[free] = gains
        table.state[1] = free

    def tell(self, emission: Emission) -> None:
        """Put *emission* on the air.

        Raise LocalProtocolError if it is empty, of no kind or sent by nobody, or starts when its tenant has told all.
        """
        if not (emission.start < emission.end and 0 <= emission.kind < SENDERS):
            raise LocalProtocolError(f"{emission} is empty, or of no kind")
        if not (0 <= emission.sender < self.table.gains.shape[1] and 0 <= emission.tenant < len(self._tenants)):
            raise LocalProtocolError(f"{emission} is sent by nobody in this band")
        if emission.start < self._told[emission.tenant]:
            raise LocalProtocolError(f"{emission} starts before {self._told[emission.tenant]}, up to which all is told")
        self.reveal(emission)

    def reveal(self, emission: Emission) -> None:
        """Put *emission* on the air, at whatever time: nobody has asked for that time yet."""
        self.reserve(1)
        insert(self.table, *emission)

    def tell_all(self, tuned: Listening, starts: Int64s, ends: Int64s, senders: Int64s, powers_mw: Floats) -> None:
        """Put what *tuned* says on the air, at all of *starts* up to *ends*, (m,); *powers_mw* are by sender.

        Raise LocalProtocolError if one of them starts when its tenant has told all.
        """
        if len(starts) == 0:
            return
        if starts.min() < self._told[tuned.tenant]:
            raise LocalProtocolError(f"a start at {starts.min()} is before {self._told[tuned.tenant]}: all is told")
        self.reserve(len(starts))
        insert_all(self.table, starts, ends, tuned.kind, tuned.centre, senders, tuned.tenant, powers_mw)

    def reserve(self, count: int) -> None:
        """Make room for *count* more emissions in the table: a kernel that tells them itself cannot."""
        table = self.table
        if table.state[0] + count <= len(table.rows):
            return
        self._forget()
        if 2 * (table.state[0] + count) > len(table.rows):
            more = len(table.rows) + count
            rows, sent_mw = np.zeros((more, COLUMNS), np.int64), np.zeros(more)
            self.table = table._replace(
                rows=np.concatenate((table.rows, rows)), sent_mw=np.concatenate((table.sent_mw, sent_mw))
            )

    def _forget(self) -> None:
        forget(self.table, min((tenant.asks_from for tenant in self._tenants), default=_NEVER))

    def settle(self, until: Time, asker: int | None = None) -> None:
        """Have all tenants but *asker*, which has told all that it sends before, catch up to *until*.

        Raise LocalProtocolError if a tenant asks for that while it, or another, catches up to *until* or earlier.
        """
        if asker is not None and until < self._catching:
            self._told[asker] = max(self._told[asker], until)
        self.gather(until, asker)

    def gather(self, until: Time, asker: int | None = None) -> None:
        """Have all tenants but *asker* catch up to *until*: it needs that to find out what it has sent itself.

        Raise LocalProtocolError as :meth:`settle` does.
        """
        before = self._catching
        if until >= before:
            raise LocalProtocolError(f"a tenant that catches up to {before} asks for {until}")
        self._catching = until
        try:
            for number, tenant in enumerate(self._tenants):
                if number != asker and self._told[number] < until:
                    tenant.catch_up(until)
                    self._told[number] = max(self._told[number], until)
        finally:
            self._catching = before

    def interference(self, tuning: Tuning, start: Time, end: Time, wanted: Wanted) -> list[Section]:
        """Return what disturbs a receiver of tenant ``wanted.tenant`` during [start, end), section by section.

        The sections follow each other from *start* to *end*. *end* is not later than now.
        """
        self.settle(end, wanted.tenant)
        bounds, levels = sections(self.table, tuning, start, end, wanted)
        at = bounds.tolist()
        return [Section(*section) for section in zip(at[:-1], at[1:], levels.tolist(), strict=True)]

    def overlapped(self, tuning: Tuning, start: Time, end: Time, wanted: Wanted, least_share: float) -> list[Emission]:
        """Return what overlaps [start, end) in time, and with *least_share* of its power, or more, in frequency.

        It is for receivers that any overlap destroys: how strong an emission is does not matter unless it is neglected.
        """
        self.settle(end, wanted.tenant)
        table = self.table
        found = overlapping(table, tuning, start, end, wanted, least_share)
        rows, powers = table.rows[found, :GENERATION].tolist(), table.sent_mw[found].tolist()
        return [Emission._make((*row, mw)) for row, mw in zip(rows, powers, strict=True)]
