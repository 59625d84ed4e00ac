"""Parameters of a connection, their bounds, and the instants at which they change (Core v5.0, Vol 6 Part B, 4.5, 5.1).

An instant is an event counter of 16 bits. Events are numbered without wrapping here; the counter of an event is its
number modulo 65536.
"""

from dataclasses import dataclass
from typing import Final

from cosim.channels.ble.pdu import INTERVAL_UNIT, TIMEOUT_UNIT
from cosim.channels.bluetooth.clock import NativeClock
from cosim.errors import UserError
from cosim.units import MS, Time

MOST_LATENCY: Final = 499
"""Largest number of events in a row that a peripheral may sleep through."""
LONGEST_WINDOW: Final[Time] = 10 * MS
ESTABLISHMENT_INTERVALS: Final = 6
"""Connection intervals without a packet after which a connection that never had one is given up (4.5.2)."""
COUNTERS: Final = 1 << 16
"""Number of values of an event counter."""
INSTANT_MARGIN: Final = 7
"""Events from one in which a change is announced to its instant, beside the latency; at least 6 (as NimBLE has it)."""
PAST_INSTANTS: Final = 32_767
"""Least distance, modulo 65536, from a counter to an instant that has passed (5.1.1)."""


def _check(what: str, time: Time, unit: Time, low: Time, high: Time) -> None:
    if time % unit or not low <= time <= high:
        bounds = f"from {low / MS:g} to {high / MS:g} ms"
        raise UserError(f"{what}: {time / MS:g} ms is not a multiple of {unit / MS:g} ms {bounds}")


@dataclass(frozen=True, slots=True)
class ConnectionParameters:
    """What both ends of a connection know of its rhythm; UserError for what the specification does not allow."""

    interval: Time
    """connInterval: 7.5 ms to 4 s, in steps of 1.25 ms."""
    latency: int
    """connPeripheralLatency: events in a row that a peripheral with nothing to send may sleep through, 0 to 499."""
    timeout: Time
    """connSupervisionTimeout: 100 ms to 32 s, in steps of 10 ms, more than 2 (1 + latency) intervals."""

    def __post_init__(self) -> None:
        _check("connection interval", self.interval, INTERVAL_UNIT, 6 * INTERVAL_UNIT, 3200 * INTERVAL_UNIT)
        if not 0 <= self.latency <= MOST_LATENCY:
            raise UserError(f"latency: {self.latency} events is not from 0 to {MOST_LATENCY}")
        _check("supervision timeout", self.timeout, TIMEOUT_UNIT, 10 * TIMEOUT_UNIT, 3200 * TIMEOUT_UNIT)
        least = 2 * (1 + self.latency) * self.interval
        if self.timeout <= least:
            raise UserError(
                f"supervision timeout: {self.timeout / MS:g} ms is not > {least / MS:g} ms, 2 (1 + latency) intervals"
            )


@dataclass(frozen=True, slots=True)
class TransmitWindow:
    """Where the first packet of a connection, or the first one with new parameters, may begin."""

    size: Time
    """1.25 ms to 10 ms and to 1.25 ms less than an interval, in steps of 1.25 ms."""
    offset: Time
    """0 to an interval, in steps of 1.25 ms."""

    def check(self, interval: Time) -> None:
        """Raise UserError unless connections of *interval* may have this window."""
        longest = min(LONGEST_WINDOW, interval - INTERVAL_UNIT)
        _check("transmit window", self.size, INTERVAL_UNIT, INTERVAL_UNIT, longest)
        _check("transmit window offset", self.offset, INTERVAL_UNIT, 0, interval)


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
