"""Adaptive frequency hopping (Core v1.2, Vol 2 Part B, section 2.3 and Part C, section 4.1.4): which channels are used.

The master counts on which channels of its slot pairs it got what it asked for. A channel on which it failed more often
than not is left out of the hop set; at least 20 channels stay, the best of the bad ones if need be; after a while a
channel that was left out is tried again. The specification leaves the classification to the implementer.
"""

from collections.abc import Sequence
from typing import Final

from cosim.channels.bluetooth.hopping import CHANNELS
from cosim.units import Time

LEAST_CHANNELS: Final = 20
"""The hop set is never smaller (N_min of the specification)."""
SAMPLES: Final = 4
"""Slot pairs on a channel before it is judged."""
WORST_RATE: Final = 0.5
"""Part of slot pairs that may fail on a channel that is used."""


def in_order(channels: Sequence[int]) -> list[int]:
    """Return *channels* in the order in which the hop kernel counts them: even ones first, ascending."""
    return sorted(channels, key=lambda channel: (channel % 2, channel))


class ChannelMap:
    """What is known of the 79 channels of one piconet; *retry* is how long (ns) a bad one is left out."""

    def __init__(self, retry: Time) -> None:
        self._retry = retry
        self._heard = [0] * CHANNELS
        self._failed = [0] * CHANNELS
        self._left_out: dict[int, Time] = {}  # since when

    @property
    def used(self) -> list[int]:
        """The hop set, in the order of the hop kernel."""
        return in_order([channel for channel in range(CHANNELS) if channel not in self._left_out])

    def update(self, heard: Sequence[int], failed: Sequence[int], now: Time) -> bool:
        """Take the numbers of pairs that went well and badly since the last time, by channel, and choose anew.

        Return whether the hop set is another one.
        """
        before = set(self._left_out)
        for channel in range(CHANNELS):
            self._count(channel, heard[channel], failed[channel])
        for channel in [old for old, since in self._left_out.items() if now - since >= self._retry]:
            del self._left_out[channel]
            self._heard[channel] = self._failed[channel] = 0
        for channel in range(CHANNELS):
            if channel not in self._left_out and self._bad(channel):
                self._left_out[channel] = now
        self._keep_enough()
        return set(self._left_out) != before

    def _count(self, channel: int, heard: int, failed: int) -> None:
        self._heard[channel] += heard
        self._failed[channel] += failed
        while self._heard[channel] + self._failed[channel] >= 4 * SAMPLES:  # what was long ago counts less
            self._heard[channel] //= 2
            self._failed[channel] //= 2

    def _bad(self, channel: int) -> bool:
        total = self._heard[channel] + self._failed[channel]
        return total >= SAMPLES and self._failed[channel] > WORST_RATE * total

    def _keep_enough(self) -> None:
        """Take back the channels that failed least, of equals the first, until there are enough."""
        short = LEAST_CHANNELS - (CHANNELS - len(self._left_out))
        if short > 0:
            for channel in sorted(self._left_out, key=lambda channel: (self._rate(channel), channel))[:short]:
                del self._left_out[channel]

    def _rate(self, channel: int) -> float:
        return self._failed[channel] / max(1, self._heard[channel] + self._failed[channel])
