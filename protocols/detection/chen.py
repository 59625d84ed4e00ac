"""Failure detectors with freshness points: NFD-S and NFD-E of Chen, Toueg and Aguilera.

"On the quality of service of failure detectors", IEEE Transactions on Computers 51(5), 2002. The watched process sends
heartbeat m_i at i eta. From the freshness point tau_i on, and until tau_{i+1}, it is trusted if and only if some m_j
with j >= i has arrived. So, once m_l is the newest that has arrived, suspicion begins at tau_{l+1}.

- NFD-S: the clocks are synchronised, and tau_i = i eta + delta;
- NFD-E: they need not be, and tau_i = EA_i + alpha, with EA_i the expected arrival of m_i, from the last n arrivals.

The paper's detectors begin with suspicion. Ours begin with trust, until the first heartbeat that can come is overdue.
"""

from collections import deque
from typing import Literal

from pydantic import Field

from cosim.settings import Count, Seconds, Settings
from cosim.units import Time, from_seconds


class NfdSSettings(Settings):
    """NFD-S: freshness points at the times of sending, shifted; for synchronised clocks."""

    kind: Literal["nfd_s"] = "nfd_s"
    shift_s: Seconds = Field(
        default=2.0, gt=0, description="s, delta, from when a heartbeat is sent until it is overdue; two may be lost"
    )


class NfdESettings(Settings):
    """NFD-E: freshness points at the expected arrivals, and a margin; for clocks that differ but do not drift."""

    kind: Literal["nfd_e"] = "nfd_e"
    margin_s: Seconds = Field(
        default=2.0, gt=0, description="s, alpha, from a heartbeat's expected arrival until it is overdue"
    )
    window: Count = Field(default=32, gt=0, description="n, arrivals from which the next one is estimated")


class NfdS:
    """Chen's detector for synchronised clocks; suspects at most eta + delta after the crash."""

    def __init__(self, settings: NfdSSettings, period: Time, start: Time, epoch: Time = 0) -> None:
        """Watch from *start* on a process that sends heartbeat i at *epoch* + i *period*."""
        self._period = period
        self._first_freshness_point = epoch + from_seconds(settings.shift_s)
        # the first heartbeat whose absence proves anything is the first that is sent from the start on
        self._newest = max(-((epoch - start) // period), 0) - 1

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*; the instant of its arrival does not matter."""
        self._newest = max(self._newest, number)

    def suspects(self, now: Time) -> bool:
        """Return whether the process is suspected at *now*."""
        return now >= self.suspects_at()

    def suspects_at(self) -> Time:
        """Return the freshness point after that of the newest heartbeat."""
        return self._first_freshness_point + (self._newest + 1) * self._period


class NfdE:
    """Chen's detector for clocks that are not synchronised; suspects about eta + alpha after the last arrival."""

    def __init__(self, settings: NfdESettings, period: Time, start: Time) -> None:
        """Watch from *start* on a process that sends a heartbeat each *period*."""
        self._period = period
        self._margin = from_seconds(settings.margin_s)
        self._offsets: deque[Time] = deque(maxlen=settings.window)
        self._offset_sum = 0
        self._newest: int | None = None
        self._suspects_at = start + period + self._margin

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*, received at *now*; one that newer ones have overtaken is ignored."""
        if self._newest is not None and number <= self._newest:
            return
        self._newest = number
        if len(self._offsets) == self._offsets.maxlen:
            self._offset_sum -= self._offsets[0]
        self._offsets.append(now - number * self._period)
        self._offset_sum += self._offsets[-1]
        mean_offset = -(-self._offset_sum // len(self._offsets))  # rounded up to the first instant that is overdue
        self._suspects_at = mean_offset + (number + 1) * self._period + self._margin

    def suspects(self, now: Time) -> bool:
        """Return whether the process is suspected at *now*."""
        return now >= self._suspects_at

    def suspects_at(self) -> Time:
        """Return the freshness point after the newest heartbeat: EA + alpha."""
        return self._suspects_at
