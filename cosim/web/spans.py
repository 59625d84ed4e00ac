"""Spans of time, of which it is asked which of them an instant is in."""

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np

from cosim.arrays import Int64s
from cosim.units import Time


class Spans:
    """Spans [start, end) in the order of their starts; they may overlap."""

    def __init__(self, starts: Int64s, ends: Int64s) -> None:
        """Take sorted *starts* and their *ends*, ns, shape (n,)."""
        self.starts = starts
        self.ends = ends

    def __len__(self) -> int:
        return len(self.starts)

    def begun(self, time: Time) -> int:
        """Return how many begin up to *time*."""
        return int(np.searchsorted(self.starts, time, side="right"))

    def at(self, time: Time, longer: Time = 0) -> Int64s:
        """Return the numbers of those that *time* is in, in order, each taken to end *longer* ns later than it does."""
        return np.flatnonzero(self.ends[: self.begun(time)] > time - longer)


class FiledSpans:
    """Spans that are too many for the memory: they are read in groups, one after the other by their starts.

    Those that outlast their group are known: so an instant needs the group that it is in, and, as long as spans are
    taken to end later, some before it.
    """

    def __init__(self, groups: Sequence[int], read: Callable[[int], Spans]) -> None:
        """Take the numbers of spans up to the end of each of the *groups*, none empty, and *read*, which reads one."""
        self._first = [0, *groups]
        self._read = read
        parts = [read(at) for at in range(len(groups))]
        self._begins = [int(spans.starts[0]) for spans in parts]
        self._last_begins = [int(spans.starts[-1]) for spans in parts]
        longs = [spans.ends > spans.starts[-1] for spans in parts]
        numbers = [self._first[at] + np.flatnonzero(long) for at, long in enumerate(longs)]
        none = np.empty(0, dtype=np.int64)
        self._long = np.concatenate([none, *numbers])
        self._long_ends = np.concatenate([none, *(spans.ends[long] for spans, long in zip(parts, longs, strict=True))])

    def __len__(self) -> int:
        return self._first[-1]

    @property
    def last(self) -> Time:
        """The end of that which ends last; 0 if there is none."""
        return int(self._long_ends.max(initial=0))

    def group(self, time: Time) -> int:
        """Return the number of the group that *time* is in; -1 before all."""
        return bisect_right(self._begins, time) - 1

    def begun(self, time: Time) -> int:
        """Return how many begin up to *time*."""
        at = self.group(time)
        return 0 if at < 0 else self._first[at] + self._read(at).begun(time)

    def at(self, time: Time, longer: Time = 0) -> Int64s:
        """Return the numbers of those that *time* is in, in order, each taken to end *longer* ns later than it does."""
        since = time - longer
        last = self.group(time)
        first = last
        while first > 0 and self._last_begins[first - 1] > since:
            first -= 1
        before = self._long[(self._long < self._first[max(0, first)]) & (self._long_ends > since)]
        own = [self._first[at] + self._read(at).at(time, longer) for at in range(max(0, first), last + 1)]
        return np.concatenate([before, *own])
