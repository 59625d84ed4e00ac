"""When the events of a connection are: on the central's clock, and as the peripheral expects them on its own.

The central begins event n at its anchor, n intervals after anchor 0. The peripheral counts from the last anchor that it
has heard, and listens for w longer on each side: w = (SCA of both, ppm) x time since that anchor + jitter (Core v5.0,
Vol 6 Part B, 4.2.2, 4.5.7). All of these times are local, in ns.
"""

from dataclasses import dataclass, replace
from typing import Final

from cosim.channels.ble.phy import T_IFS
from cosim.channels.clock import MILLION, NativeClock
from cosim.units import US, Time

JITTER: Final[Time] = 16 * US
"""Largest deviation of an active or sleeping clock beside its drift (4.2.2; v5.1 has 32 us for both ends together)."""
WINDOW_DELAYS: Final[dict[str, Time]] = {"legacy": 1_250 * US, "uncoded": 2_500 * US, "coded": 3_750 * US}
"""transmitWindowDelay after a CONNECT_IND, and after an AUX_CONNECT_REQ by its PHY (4.5.3)."""


@dataclass(frozen=True, slots=True)
class Anchors:
    """The anchors of a central: *event* begins at *local*, every other one by *interval* from there."""

    event: int
    local: Time
    interval: Time
    before: "Anchors | None" = None
    """Those of earlier events, where these are another interval's."""

    def at(self, event: int) -> Time:
        """Return the local time of the anchor of *event*."""
        if self.before is not None and event < self.event:
            return self.before.at(event)
        return self.local + (event - self.event) * self.interval

    def first_from(self, clock: NativeClock, time: Time) -> int:
        """Return the first event whose anchor, counted on *clock*, is not before the simulated *time*."""
        event = self.event + (clock.local(time - 1) - self.local) // self.interval + 1
        if self.before is not None and event <= self.event:
            return min(self.before.first_from(clock, time), self.event)
        return event

    def updated(self, instant: int, offset: Time, interval: Time) -> "Anchors":
        """Return the anchors from event *instant* on, which begins *offset* late and brings a new *interval*."""
        earlier = replace(self, before=None)  # changes are far apart: nobody asks for what was before that
        return Anchors(instant, self.at(instant) + offset, interval, earlier)


@dataclass(frozen=True, slots=True)
class Expectation:
    """When a peripheral expects the first packets of events, from *event* on."""

    event: int
    local: Time
    """Local time at which *event* is expected, or its transmit window begins."""
    interval: Time
    heard: Time
    """Local time of the last anchor that was heard; before the first one, of the end of the CONNECT_IND."""
    ppm: int
    """Accuracies of both ends' sleep clocks together."""
    window: Time = 0
    """Size of the transmit window, 0 once an anchor has been heard."""

    def at(self, event: int) -> Time:
        """Return the local time at which *event*, or its transmit window, is expected to begin."""
        return self.local + (event - self.event) * self.interval

    def widening(self, event: int) -> Time:
        """Return w of *event*, rounded up."""
        return -(-self.ppm * (self.at(event) + self.window - self.heard) // MILLION) + JITTER

    def opens(self, event: int) -> Time:
        """Return the first local time at which the peripheral listens for *event*."""
        return self.at(event) - self.widening(event)

    def closes(self, event: int) -> Time:
        """Return the last local time at which the first packet of *event* may begin and be heard."""
        return self.at(event) + self.window + self.widening(event)

    def lost_from(self) -> int:
        """Return the first event for which the peripheral does not listen, as w has reached interval / 2 - T_IFS."""
        room = (self.interval // 2 - T_IFS - JITTER) * MILLION
        elapsed = (room - MILLION) // self.ppm + 1  # the shortest time whose w, rounded up, is too wide
        return max(self.event, self.event - (self.local + self.window - self.heard - elapsed) // self.interval)

    def event_at(self, local: Time) -> int | None:
        """Return the event, from the next one on, whose first packet it would take one that begins at *local* for."""
        near = self.event + (local - self.local - self.window) // self.interval
        candidates = range(max(self.event, near - 1), min(near + 3, self.lost_from()))
        return next((event for event in candidates if self.opens(event) <= local <= self.closes(event)), None)

    def anchored(self, event: int, local: Time) -> "Expectation":
        """Return what is expected after *event* once its first packet has been heard to begin at *local*."""
        return replace(self, event=event + 1, local=local + self.interval, heard=local, window=0)

    def updated(self, instant: int, offset: Time, size: Time, interval: Time) -> "Expectation":
        """Return what is expected from event *instant* on, which begins within *size* after *offset*."""
        start = self.at(instant) + offset
        # The window that is pending may not have been met: then it still counts.
        return replace(self, event=instant, local=start, interval=interval, window=self.window + size)
