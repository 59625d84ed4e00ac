"""When a connection is given up, and the instants at which it changes (Core v5.0, Vol 6 Part B, sections 4.5.2, 5.1).

An instant is an event counter of 16 bits. Events are numbered without wrapping here; the counter of an event is its
number modulo 65536.
"""

from dataclasses import dataclass
from typing import Final

from cosim.channels.ble.connections.parameters import ConnectionParameters
from cosim.channels.clock import NativeClock
from cosim.units import Time

ESTABLISHMENT_INTERVALS: Final = 6
"""Connection intervals without a packet after which a connection that never had one is given up (4.5.2)."""
COUNTERS: Final = 1 << 16
"""Number of values of an event counter."""
INSTANT_MARGIN: Final = 7
"""Events from one in which a change is announced to its instant, beside the latency; at least 6 (as NimBLE has it)."""
PAST_INSTANTS: Final = 32_767
"""Least distance, modulo 65536, from a counter to an instant that has passed (5.1.1)."""


@dataclass(slots=True)
class Supervision:
    """The supervision timer of one end, counted on its own *clock* (4.5.2).

    It runs from the end of the last packet with a right CRC; before the first one, from the end of the CONNECT_IND,
    and for six intervals only.
    """

    clock: NativeClock
    since: Time
    """Local time from which it runs."""
    parameters: ConnectionParameters
    established: bool = False
    """True once a packet has been heard."""

    def heard(self, end: Time) -> None:
        """Note that a packet with a right CRC has ended at *end*."""
        self.since, self.established = self.clock.local(end), True

    def renew(self, local: Time, parameters: ConnectionParameters) -> None:
        """Take new *parameters* at the *local* time of their instant, from which the timer begins anew (5.1.1)."""
        self.since, self.parameters = local, parameters

    def deadline(self) -> Time:
        """Return the instant at which the connection is lost unless a packet ends before."""
        interval, timeout = self.parameters.interval, self.parameters.timeout
        return self.clock.at_local(self.since + (timeout if self.established else ESTABLISHMENT_INTERVALS * interval))


def instant_for(event: int, latency: int) -> int:
    """Return the instant, 16 bits, of a change that is announced from *event* on."""
    return (event + latency + INSTANT_MARGIN) % COUNTERS


def event_at(instant: int, event: int) -> int | None:
    """Return the number of the event that an *instant* heard in *event* means, or None if it has passed.

    An *instant* that is this very event counts as passed, as nothing could change for it any more.
    """
    ahead = (instant - event) % COUNTERS
    return event + ahead if 0 < ahead < PAST_INSTANTS else None
