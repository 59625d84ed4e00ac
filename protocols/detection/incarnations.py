"""Incarnations: what is watched is one incarnation of a peer, which begins when the peer is started or rebooted.

A peer that has been rebooted counts its heartbeats from 0 again and has forgotten everything. ``Incarnation`` finds
that out from the heartbeats; ``Watch`` is one robot's watch over one incarnation of another.
"""

from cosim.units import MS, Time
from protocols.detection.detectors import Detector
from protocols.detection.quality import History, Quality, quality


class Incarnation:
    """The incarnation of one peer, recognised by the instant at which its count of heartbeats must have begun."""

    def __init__(self, period: Time, clock_ms: int) -> None:
        """Take heartbeats to be *period* apart, from number 0 on; their stamps are whole ms, modulo *clock_ms*."""
        self._period = period
        self._clock_ms = clock_ms
        self._began_ms: int | None = None

    def is_new(self, number: int, stamp_ms: int) -> bool:
        """Return whether this heartbeat is of another incarnation than the one before.

        An incarnation whose clock was stepped looks like a new one, too.
        """
        began_ms = (stamp_ms - number * self._period // MS) % self._clock_ms
        before, self._began_ms = self._began_ms, began_ms
        if before is None or before == began_ms:
            return False
        later = (began_ms - before + self._clock_ms // 2) % self._clock_ms - self._clock_ms // 2
        return abs(later) > max(self._period // MS, 1)


class Watch:
    """One robot's watch over one incarnation of another: a detector and the history of its suspicions."""

    def __init__(self, detector: Detector, since: Time, begun: Time | None) -> None:
        """Watch from *since* on; *begun* names the incarnation of the peer, None before its first heartbeat."""
        self.begun = begun
        self.history = History()
        self._detector = detector
        self._since = since
        self._until: Time | None = None

    @property
    def suspects(self) -> bool:
        """True if the peer was suspected at the last look."""
        return self.history.suspects

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*, received at *now*."""
        self._detector.heartbeat(number, now)
        self.look(now)

    def look(self, now: Time) -> None:
        """Ask the detector, and note what it answers."""
        found = self.history.transitions
        time = max(now, found[-1].time) if found else now  # the clock may have been set back
        self.history.note(time, self._detector.suspects(now))

    def due(self) -> Time | None:
        """Return the instant at which the peer will be suspected if nothing comes; None if it is, or never will be."""
        return None if self.suspects else self._detector.suspects_at()

    def close(self, now: Time) -> None:
        """End the watch, as that incarnation of the peer is over."""
        self._until = now

    def settled(self, now: Time) -> Quality:
        """Return the quality until *now* or the end of the watch; a suspicion that stands is right, and ends it."""
        found = self.history.transitions
        end = found[-1].time if self.suspects else now if self._until is None else self._until
        return quality(found, self._since, max(end, self._since))
