"""When a scanner hears an advertiser: computed from event to event (Core v5.0, Vol 6 Part B, section 4.4.3).

A scanner listens on one channel for scanWindow at the beginning of every scanInterval, and in the next interval on the
next channel. A PDU is heard if all of it lies in one window of its channel: one that is on the air while a scan without
pauses changes channel is not. Which window that could be follows from the start of the PDU by one division, so that the
search steps over the advertiser's events, and over no windows.

A scanner that asks for more (active scanning) does not ask every time. It counts down backoffCount with each PDU that
it could answer, and asks at 0; two failures in a row double upperLimit, up to 256, two successes halve it, down to 1,
and a new count is drawn from 1 to upperLimit (4.4.3.2).
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, NamedTuple

from cosim.channels.ble.advertising import Advertiser, next_start
from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.clock import NativeClock, instant_of, local_at
from cosim.errors import LocalProtocolError
from cosim.jit import njit
from cosim.randomness import Draws
from cosim.units import Time

GREATEST_LIMIT: Final = 256
"""Largest upperLimit."""


@dataclass(frozen=True, slots=True)
class ScanWindows:
    """The windows of a scanner: local times [offset + k * interval, + window) of *clock*, for every integer k.

    Window k is on the channel ``channels[k % len(channels)]``. With *window* = *interval* the scan has no pauses.
    ValueError if a window is longer than an interval, or on no advertising channel.
    """

    clock: NativeClock
    offset: Time
    interval: Time
    """scanInterval."""
    window: Time
    """scanWindow."""
    channels: tuple[int, ...] = ADVERTISING
    """Indices of the channels in turn, each of them once: those of a usual scanner are all, with any of them first."""

    def __post_init__(self) -> None:
        if not 0 < self.window <= self.interval:
            raise ValueError(f"a window of {self.window} ns in an interval of {self.interval} ns")
        if not self.channels or len(set(self.channels) & set(ADVERTISING)) < len(self.channels):
            raise ValueError(f"{self.channels} are not some of {ADVERTISING}, each once")

    def channel(self, time: Time) -> int | None:
        """Return the channel on which the scanner listens at the simulated *time*; None if it does not."""
        number, since = divmod(self.clock.local(time) - self.offset, self.interval)
        return self.channels[number % len(self.channels)] if since < self.window else None

    def open_time(self, start: Time, end: Time) -> Time:
        """Return how much of the simulated time [start, end) lies in windows."""
        if self.window == self.interval:
            return end - start
        clock, total = self.clock, 0
        opens = self.offset + (clock.local(start) - self.offset) // self.interval * self.interval
        while (begin := clock.at_local(opens)) < end:
            total += max(0, min(clock.at_local(opens + self.window), end) - max(begin, start))
            opens += self.interval
        return total


class HeardPdu(NamedTuple):
    """A PDU that a scanner in reach would hear, were nothing else on the air; times in ns."""

    event: int
    """Number of the advertiser's event."""
    channel: int
    start: Time
    end: Time


def next_heard(advertiser: Advertiser, windows: ScanWindows, since: Time, until: Time) -> HeardPdu | None:
    """Return the first PDU of *advertiser* that lies in [*since*, *until*) and in a window; None if there is none."""
    event = advertiser.event_from(since)
    turns = [windows.channels.index(channel) if channel in windows.channels else -1 for channel in advertiser.channels]
    first, second, third = (*turns, -1, -1)[:3]
    sender, scanner = advertiser.clock, windows.clock
    number, pdu, start, end = _next_heard(
        *(sender.phase, sender.ppm, *advertiser.steps, *event),
        *(advertiser.spacing, advertiser.air_time, (first, second, third), len(turns)),
        *(scanner.phase, scanner.ppm, windows.offset, windows.interval, windows.window, len(windows.channels)),
        *(since, until),
    )
    return None if number < 0 else HeardPdu(number, advertiser.channels[pdu], start, end)


@njit(cache=True)
def _next_heard(
    ph: int,  # the advertiser's clock...
    pm: int,
    key_0: int,  # ...how it gets from event to event, and where it is...
    key_1: int,
    delayed: bool,
    interval: int,
    number: int,
    local: int,
    spacing: int,  # ...its PDUs, with the turn of each one's channel at the scanner, or -1...
    air: int,
    turns: tuple[int, int, int],
    pdus: int,
    sph: int,  # ...the scanner's clock, its windows, the number of its channels...
    spm: int,
    offset: int,
    period: int,
    window: int,
    channels: int,
    since: int,  # ...and the bounds of the search
    until: int,
) -> tuple[int, int, int, int]:
    """Return event, place in it, start and end of the next PDU that is heard; event -1 if there is none."""
    while True:
        for pdu in range(pdus):
            start = instant_of(ph, pm, local + pdu * spacing)
            end = start + air
            if end > until:
                return -1, 0, 0, 0
            turn = (local_at(sph, spm, start) - offset) // period
            closing = offset + turn * period + window
            # the last instant of the PDU is before its end: it may end when the window does
            inside = local_at(sph, spm, end - 1) < closing
            if inside and turn % channels == turns[pdu] and start >= since:
                return number, pdu, start, end
        local = next_start(key_0, key_1, delayed, interval, number, local)
        number += 1


# ---------------------------------------------------------------- back-off of an active scan


class Run(Enum):
    """What came last of an active scanner's requests, and does not count for upperLimit yet."""

    NONE = auto()
    SUCCESS = auto()
    FAILURE = auto()


class Change(Enum):
    """What becomes of upperLimit."""

    KEEP = auto()
    DOUBLE = auto()
    HALVE = auto()


BACKOFF: Final[dict[tuple[Run, bool], tuple[Change, Run]]] = {
    (Run.NONE, True): (Change.KEEP, Run.SUCCESS),
    (Run.NONE, False): (Change.KEEP, Run.FAILURE),
    (Run.SUCCESS, True): (Change.HALVE, Run.NONE),
    (Run.SUCCESS, False): (Change.KEEP, Run.FAILURE),
    (Run.FAILURE, True): (Change.KEEP, Run.SUCCESS),
    (Run.FAILURE, False): (Change.DOUBLE, Run.NONE),
}
"""(what came last, whether a request was answered) -> (what becomes of upperLimit, what came last then)."""


@dataclass(slots=True)
class Backoff:
    """Back-off of an active scanner; LocalProtocolError if it is told of a PDU or of an answer out of turn."""

    draws: Draws
    """The stream of new counts: number n is drawn when request n, from 0 on, was answered or not."""
    upper_limit: int = 1
    count: int = 1
    """backoffCount: 0 while an answer is awaited."""
    run: Run = Run.NONE
    requests: int = 0
    """Number of requests of which the outcome is known."""

    def asks(self) -> bool:
        """Count a PDU to which a request could be sent; return whether it is to be sent."""
        if self.count == 0:
            raise LocalProtocolError("an advertisement is counted while an answer is awaited")
        self.count -= 1
        return self.count == 0

    def asked(self, answered: bool) -> None:
        """Note whether a request was *answered*, and draw a new count."""
        if self.count:
            raise LocalProtocolError("a request has an outcome, but none was sent")
        change, self.run = BACKOFF[self.run, answered]
        if change is Change.DOUBLE:
            self.upper_limit = min(2 * self.upper_limit, GREATEST_LIMIT)
        elif change is Change.HALVE:
            self.upper_limit = max(self.upper_limit // 2, 1)
        self.count = 1 + self.draws.below(self.upper_limit, self.requests)
        self.requests += 1
