"""The parameters of a connection, and their bounds (Core v5.0, Vol 6 Part B, sections 2.3.3.1 and 4.5)."""

from dataclasses import dataclass, replace
from typing import Final

from cosim.errors import UserError
from cosim.units import MS, US, Time

INTERVAL_UNIT: Final[Time] = 1_250 * US
"""Unit of intervals, transmit windows and their offsets."""
TIMEOUT_UNIT: Final[Time] = 10 * MS
"""Unit of supervision timeouts."""
MOST_LATENCY: Final = 499
"""Largest number of events in a row that a peripheral may sleep through."""
LONGEST_WINDOW: Final[Time] = 10 * MS
"""Largest size of a transmit window."""


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

    def of_interval(self, interval: Time) -> "ConnectionParameters":
        """Return these with another *interval*, and a timeout that is as long, or as short as that allows."""
        least = 2 * (1 + self.latency) * interval // TIMEOUT_UNIT * TIMEOUT_UNIT + TIMEOUT_UNIT
        return replace(self, interval=interval, timeout=max(self.timeout, least))


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
