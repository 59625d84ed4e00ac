"""When a device advertises: legacy advertising, event by event (Core v5.0, Vol 6 Part B, section 4.4.2).

In an event the advertiser sends its PDU on each of its channels, one after the other. From the start of an event to
that of the next it is T_advEvent = advInterval + advDelay by its own clock. advDelay is pseudo-random, 0 to 10 ms, and
another one for every event; high duty cycle directed advertising has none. Event n + 1 so follows from event n and a
counter-based draw for n, and whoever asks for the events from some time on has to draw what is between.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from cosim.channels.ble.channels import ADVERTISING
from cosim.channels.ble.phy import LE_1M, T_IFS
from cosim.channels.clock import NativeClock
from cosim.jit import njit
from cosim.randomness import Draws, philox_words
from cosim.units import MS, Time

LONGEST_DELAY: Final[Time] = 10 * MS
"""Largest advDelay (4.4.2.2.1)."""
LONGEST_SPACING: Final[Time] = 10 * MS
"""Largest time from the start of a PDU to that of the next one of the same event."""
STEP_BACK: Final[Time] = 100 * MS
"""Time by which whoever asks for events may go back at little cost."""
REQUEST_ROOM: Final[Time] = T_IFS + LE_1M.air_time(34)
"""Time from the end of a PDU in which the longest request, a CONNECT_IND, may begin and end."""

SCAN_REQUEST: Final[Time] = LE_1M.air_time(12)
"""Duration of a SCAN_REQ."""


class Event(NamedTuple):
    """An advertising event."""

    number: int
    local: Time
    """Time of the advertiser's clock at which its first PDU begins."""


@dataclass(slots=True)
class Advertiser:
    """An advertiser and its events, of which number 0 begins at *first*; ValueError for events that do not fit.

    It keeps the place of the last event that was asked for, and of one some time before: to ask for an earlier one yet
    begins anew with event 0.
    """

    clock: NativeClock
    first: Time
    """Local time of the start of event 0."""
    interval: Time
    """advInterval, on the same clock."""
    air_time: Time
    """Duration of each PDU, in simulated time."""
    delays: Draws | None
    """The stream of advDelay, in ns and uniform: number n is that between the events n and n + 1. None: no delay."""
    gap: Time = REQUEST_ROOM
    """Time from the end of a PDU to the start of the next one, on the advertiser's clock."""
    channels: tuple[int, ...] = ADVERTISING
    """Indices of the channels that are used, ascending."""
    steps: tuple[int, int, bool, Time] = field(init=False, repr=False, compare=False)
    """What leads from an event to the next one, for ``next_start``."""
    _cursor: Event = field(init=False, repr=False, compare=False)
    _following: Event = field(init=False, repr=False, compare=False)
    """The event that follows on that of ``_cursor``, once it has been asked for; else that one itself."""
    _earlier: Event = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.channels or list(self.channels) != sorted(set(self.channels) & set(ADVERTISING)):
            raise ValueError(f"{self.channels} are not some of {ADVERTISING}, ascending")
        if self.air_time < 1 or self.gap < 0 or self.spacing > LONGEST_SPACING:
            raise ValueError(f"PDUs of {self.air_time} ns with gaps of {self.gap} ns")
        if self.offset(len(self.channels) - 1) + self.air_time > self.interval:
            raise ValueError(f"an interval of {self.interval} ns, which does not hold an event")
        key_0, key_1 = (0, 0) if self.delays is None else self.delays.key
        self.steps = key_0, key_1, self.delays is not None, self.interval
        self._cursor = self._following = self._earlier = Event(0, self.first)

    @property
    def spacing(self) -> Time:
        """The local time from the start of a PDU to that of the next one."""
        return self.air_time + self.gap

    def offset(self, pdu: int) -> Time:
        """Return the local time from the start of an event to that of its *pdu*, from 0 on."""
        return pdu * self.spacing

    def start(self, event: Event, pdu: int) -> Time:
        """Return the simulated time at which a *pdu* of *event*, from 0 on, begins."""
        return self.clock.at_local(event.local + pdu * (self.air_time + self.gap))

    def after(self, event: Event) -> Event:
        """Return the event that follows on *event*."""
        return Event(event.number + 1, next_start(*self.steps, *event))

    def event_from(self, time: Time) -> Event:
        """Return the first event of which a PDU begins at or after the simulated *time*."""
        least = self.clock.local(time - 1) + 1 - self.offset(len(self.channels) - 1)
        if self._cursor.local < least <= self._following.local:
            return self._following
        first = Event(0, self.first)
        if first.local >= least:
            return first
        if self._cursor.local >= least:
            self._cursor = self._earlier if self._earlier.local < least else first
        if least - self._cursor.local > STEP_BACK:
            self._earlier = self._cursor = Event(*_last_before(*self.steps, *self._cursor, least - STEP_BACK))
        self._cursor = Event(*_last_before(*self.steps, *self._cursor, least))
        self._following = self.after(self._cursor)
        return self._following

    def events_from(self, time: Time) -> Iterator[Event]:
        """Yield the events from ``event_from(time)`` on, without end."""
        event = self.event_from(time)
        while True:
            yield event
            event = self.after(event)


@njit(cache=True)
def next_start(key_0: int, key_1: int, delayed: bool, interval: Time, number: int, local: Time) -> Time:
    """Return when, in local time, the event after *number*, which begins at *local*, does."""
    if not delayed:
        return local + interval
    words = philox_words(number, number >> 32, 0, 0, key_0, key_1)
    bound = LONGEST_DELAY + 1  # the product of it and 64 bits, of which the upper 64 count
    return local + interval + ((words[0] * bound + (words[1] * bound >> 32)) >> 32)


@njit(cache=True)
def _last_before(
    key_0: int, key_1: int, delayed: bool, interval: Time, number: int, local: Time, least: Time
) -> tuple[int, Time]:
    """Return the last event, from *number* at *local* on, that begins before the local time *least*."""
    if not delayed:
        steps = (least - 1 - local) // interval
        return number + steps, local + steps * interval
    while True:
        following = next_start(key_0, key_1, delayed, interval, number, local)
        if following >= least:
            return number, local
        number, local = number + 1, following
