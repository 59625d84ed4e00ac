"""Which life of a host a heartbeat is of: one that has been rebooted counts anew, and has forgotten all."""

from cosim.units import MS, Time
from protocols.aggregation.frames import CLOCK_MS
from protocols.aggregation.messages import Heartbeat


class Life:
    """The life of one host, as its heartbeats tell: when its count must have begun."""

    def __init__(self, period: Time) -> None:
        """Take heartbeats to be *period* apart, from number 0 on."""
        self._period = period
        self._began_ms: int | None = None

    def anew(self, beat: Heartbeat) -> bool:
        """Return whether *beat* is of another life than the one before: a stepped clock looks like that, too."""
        began_ms = (beat.stamp_ms - beat.number * self._period // MS) % CLOCK_MS
        before, self._began_ms = self._began_ms, began_ms
        if before is None:
            return False
        later = (began_ms - before + CLOCK_MS // 2) % CLOCK_MS - CLOCK_MS // 2
        return abs(later) > max(self._period // MS, 1)
