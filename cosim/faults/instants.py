"""When a fault begins and ends, as often as it does in a run."""

from typing import TypeAlias

import numpy as np

from cosim.faults.settings import LastingSettings, TimedSettings
from cosim.units import Time, from_seconds

Span: TypeAlias = tuple[Time, Time | None]
"""When it begins, and when it ends if that is before the end of the run (and it has an end at all)."""


def spans(fault: TimedSettings, stream: np.random.Generator, run_end: Time) -> list[Span]:
    """Return when *fault* happens before *run_end*: once, or with its rate, by exponential gaps from *stream*."""
    return [(start, _end(fault, start, run_end)) for start in _starts(fault, stream, run_end)]


def _starts(fault: TimedSettings, stream: np.random.Generator, run_end: Time) -> list[Time]:
    if fault.rate_per_s is None:
        return [from_seconds(fault.at_s)]
    starts: list[Time] = []
    at_s = fault.at_s + stream.exponential(1.0 / fault.rate_per_s)
    while from_seconds(at_s) < run_end:
        starts.append(from_seconds(at_s))
        at_s += stream.exponential(1.0 / fault.rate_per_s)
    return starts


def _end(fault: TimedSettings, start: Time, run_end: Time) -> Time | None:
    if not isinstance(fault, LastingSettings):
        return None
    end = None
    if fault.until_s is not None:
        end = from_seconds(fault.until_s)
    elif fault.for_s is not None:
        end = start + max(1, from_seconds(fault.for_s))
    return end if end is not None and end < run_end else None
