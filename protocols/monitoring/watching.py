"""One robot's watch over one life of another: a detector, what it has said, and since when it is asked."""

from cosim.units import Time
from protocols.detection.detectors import Detector
from protocols.detection.quality import History, Quality, quality


class Watch:
    """A detector that is told of heartbeats as they come, and asked when it is about to suspect."""

    def __init__(self, detector: Detector, since: Time, begun: Time | None) -> None:
        """*begun* names the life of the peer; None as long as it has not been heard of."""
        self.begun = begun
        self.history = History()
        self._detector = detector
        self._since = since
        self._until: Time | None = None

    @property
    def suspects(self) -> bool:
        """Whether the peer is suspected, as was last found."""
        return self.history.suspects

    def heartbeat(self, number: int, now: Time) -> None:
        """Take note that heartbeat *number* has arrived."""
        self._detector.heartbeat(number, now)
        self.look(now)

    def look(self, now: Time) -> None:
        """Find out whether the peer is suspected now."""
        found = self.history.transitions
        time = max(now, found[-1].time) if found else now  # the clock may have been set back
        self.history.note(time, self._detector.suspects(now))

    def due(self) -> Time | None:
        """Return when the peer will be suspected if nothing comes; None if it is, or never will be."""
        return None if self.suspects else self._detector.suspects_at()

    def close(self, now: Time) -> None:
        """End the watch: that life of the peer is over."""
        self._until = now

    def settled(self, now: Time) -> Quality:
        """Return the quality until *now* or the end of the watch; a suspicion that stands is right, and ends it."""
        found = self.history.transitions
        end = found[-1].time if self.suspects else now if self._until is None else self._until
        return quality(found, self._since, max(end, self._since))
