"""Which channels of a hop set are left out: those on which most went wrong, as whoever hops learns from errors.

Specifications leave the classification of channels to the implementer (Core v1.2, Vol 2 Part C, section 4.1.4; Core
v5.0, Vol 6 Part B, section 4.5.8.1). Here what succeeded and failed is counted for each channel. One on which most
failed is left out, and tried again after a while. A least number of channels stays, the best of the bad ones if need
be.
"""

from collections.abc import Sequence
from typing import Final

from cosim.units import Time

SAMPLES: Final = 4
"""Number of times that a channel has been used before it is judged."""
WORST_RATE: Final = 0.5
"""Share of them that may fail on a channel that is used."""


class ChannelQuality:
    """Quality of so many channels, of which *least* stay; *retry* is the time in ns for which a bad one is left out."""

    def __init__(self, channels: int, least: int, retry: Time) -> None:
        self._channels, self._least = channels, least
        self._retry = retry
        self._heard = [0] * channels
        self._failed = [0] * channels
        self._left_out: dict[int, Time] = {}  # since when

    @property
    def left_out(self) -> list[int]:
        """The channels that are not used, ascending."""
        return sorted(self._left_out)

    @property
    def used(self) -> list[int]:
        """The channels that are, ascending."""
        return [channel for channel in range(self._channels) if channel not in self._left_out]

    def update(self, heard: Sequence[int], failed: Sequence[int], now: Time) -> bool:
        """Take how often each channel went well and badly since the last time, and choose again.

        Return whether other channels are used than before.
        """
        before = set(self._left_out)
        for channel in range(self._channels):
            self._count(channel, heard[channel], failed[channel])
        for channel in [old for old, since in self._left_out.items() if now - since >= self._retry]:
            del self._left_out[channel]
            self._heard[channel] = self._failed[channel] = 0
        for channel in range(self._channels):
            if channel not in self._left_out and self._bad(channel):
                self._left_out[channel] = now
        self._keep_enough()
        return set(self._left_out) != before

    def _count(self, channel: int, heard: int, failed: int) -> None:
        self._heard[channel] += heard
        self._failed[channel] += failed
        while self._heard[channel] + self._failed[channel] >= 4 * SAMPLES:  # what is old counts less
            self._heard[channel] //= 2
            self._failed[channel] //= 2

    def _bad(self, channel: int) -> bool:
        total = self._heard[channel] + self._failed[channel]
        return total >= SAMPLES and self._failed[channel] > WORST_RATE * total

    def _keep_enough(self) -> None:
        """Take back the channels that failed least, of equals the first, until there are enough."""
        short = self._least - (self._channels - len(self._left_out))
        if short > 0:
            for channel in sorted(self._left_out, key=lambda channel: (self._rate(channel), channel))[:short]:
                del self._left_out[channel]

    def _rate(self, channel: int) -> float:
        return self._failed[channel] / max(1, self._heard[channel] + self._failed[channel])
