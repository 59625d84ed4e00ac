"""Spans of time, of which it is asked which of them an instant is in."""

from typing import Any, Final

import numpy as np

from cosim.arrays import Int64s
from cosim.units import Time

_BLOCK: Final = 4096
"""Number of spans of which the last end is known."""


class Spans:
    """Spans [start, end) in the order of their starts; they may overlap, and be as long as they like.

    Those that an instant is in are found block by block: a block all of which is over is passed at a glance.
    """

    def __init__(self, starts: Int64s, ends: Int64s) -> None:
        """Take sorted *starts* and their *ends*, ns, shape (n,)."""
        self.starts = starts
        self.ends = ends
        blocks = np.arange(0, len(starts), _BLOCK)
        self._last: Any = np.maximum.reduceat(ends, blocks) if len(starts) else ends

    def __len__(self) -> int:
        return len(self.starts)

    def begun(self, time: Time) -> int:
        """Return how many begin up to *time*."""
        return int(np.searchsorted(self.starts, time, side="right"))

    def at(self, time: Time, longer: Time = 0) -> Int64s:
        """Return the numbers of those that *time* is in, in order, each taken to end *longer* ns later than it does."""
        end = self.begun(time)
        since = time - longer
        numbers = [
            first + np.flatnonzero(self.ends[first : min(first + _BLOCK, end)] > since)
            for first in (np.flatnonzero(self._last > since) * _BLOCK).tolist()
            if first < end
        ]
        return np.concatenate(numbers) if numbers else np.empty(0, dtype=np.int64)
