"""When a fault begins and ends, as often as it does in a run, and the agenda by which all faults happen.

Instants are drawn as the run comes to them: a run that will end early may be given a thousand years.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

import numpy as np

from cosim.faults.settings import LastingSettings, TimedSettings
from cosim.kernel import FAULT, Kernel
from cosim.units import Time, from_seconds, to_seconds

Span: TypeAlias = tuple[Time, Time | None]
"""When it begins, and when it ends if that is before the end of the run (and it has an end at all)."""
Happening: TypeAlias = tuple[tuple[Time, Callable[[], None]], ...]
"""What a fault does each time that it happens, and when; what begins it comes first."""


def spans(fault: TimedSettings, stream: np.random.Generator, run_end: Time) -> Iterator[Span]:
    """Yield when *fault* happens before *run_end*: once, or with its rate, by exponential gaps from *stream*."""
    for start in _starts(fault, stream, run_end):
        yield start, _end(fault, start, run_end)


def _starts(fault: TimedSettings, stream: np.random.Generator, run_end: Time) -> Iterator[Time]:
    if fault.rate_per_s is None:
        yield from_seconds(fault.at_s)
        return
    at_s = fault.at_s + stream.exponential(1.0 / fault.rate_per_s)
    end_s = to_seconds(run_end)
    while at_s <= end_s and from_seconds(at_s) < run_end:  # an infinite gap has no nanoseconds
        yield from_seconds(at_s)
        at_s += stream.exponential(1.0 / fault.rate_per_s)


def _end(fault: TimedSettings, start: Time, run_end: Time) -> Time | None:
    if not isinstance(fault, LastingSettings):
        return None
    end = None
    if fault.until_s is not None:
        end = from_seconds(fault.until_s)
    elif fault.for_s is not None:
        end = start + max(1, from_seconds(fault.for_s))
    return end if end is not None and end < run_end else None


def lasting(span: Span, begin: Callable[[], None], end: Callable[[], None]) -> Happening:
    """Return what begins and ends with *span*."""
    return ((span[0], begin),) if span[1] is None else ((span[0], begin), (span[1], end))


class Agenda:
    """What faults will do, in the order (time, number of the fault, as it was drawn). The kernel has the next of it."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._queue: list[tuple[Time, int, int, int, Callable[[], None], Iterator[Happening]]] = []
        """Time, fault, which of its happenings, which part of that, and what happens to it after this one."""

    def enter(self, number: int, happenings: Iterable[Happening]) -> None:
        """Have *happenings* of the fault *number* take place, of which none begins before the one before it."""
        self._draw(number, 0, iter(happenings))

    def begin(self) -> None:
        """Enter the first of all into the kernel."""
        if self._queue:
            self._kernel.at(self._queue[0][0], self._act, FAULT)

    def _draw(self, number: int, nth: int, happenings: Iterator[Happening]) -> None:
        for part, (time, act) in enumerate(next(happenings, ())):
            heapq.heappush(self._queue, (time, number, nth, part, act, happenings))

    def _act(self) -> None:
        _, number, nth, part, act, happenings = heapq.heappop(self._queue)
        if part == 0:
            self._draw(number, nth + 1, happenings)
        act()
        self.begin()
