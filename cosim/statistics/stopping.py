"""When a sweep has replicates enough: sequential stopping by the relative precision of means.

Replicates are made until the 95 % interval of the mean has half a width of at most g / (1 + g) of the mean, of every
arm and metric that was named beforehand: then the mean is off the true one by about the share g of that, or less (Law,
Simulation Modeling and Analysis, 5th ed., 9.4.1). Whoever looks too early stops where the deviation is small by chance,
so there are at least ``FIRST`` replicates before the first look, and the looks are rounds that grow with their number.

Where it stops is a function of the values in the order of replicates. So it is the same whatever the order in which
runs end, and after a resume.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple, TypeVar

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.statistics.intervals import interval

FIRST: Final = 10
"""Least number of replicates before the first look."""
GROWTH: Final = 5
"""A round is this part of the replicates that are there: a fifth."""

Key = TypeVar("Key", bound=Hashable)


class Decision(NamedTuple):
    """How many replicates each arm is to have, and whether the sweep ends with them."""

    replicates: int
    stop: bool
    lacking: int
    """How many of the means are not yet as precise as asked."""


def looks(first: int, most: int) -> Iterator[int]:
    """Yield the numbers of replicates at which to look, from *first* to *most*."""
    count = min(first, most)
    while count < most:
        yield count
        count = min(count + max(count // GROWTH, 1), most)
    yield most


def decide(
    samples: Mapping[Key, Mapping[int, float]], wanted: Mapping[Key, float], most: int, first: int = FIRST
) -> Decision:
    """Return how many replicates each arm is to have, by what is known of those that are there.

    *samples* holds by arm and metric the values by replicate, NaN where a run failed or has none; *wanted* the g of
    each. Values past the look that decides are not looked at. Raise ValueError if the first look is too early.
    """
    if first < FIRST:
        raise ValueError(f"{first} replicates before the first look, expected at least {FIRST}")
    for count in looks(first, most):
        if any(replicate not in samples.get(key, {}) for key in wanted for replicate in range(count)):
            return Decision(count, False, len(wanted))
        heads = {key: np.array([samples[key][replicate] for replicate in range(count)]) for key in wanted}
        lacking = sum(not precise(heads[key], share) for key, share in wanted.items())
        if not lacking:
            break
    return Decision(count, True, lacking)


def precise(values: Floats, share: float) -> bool:
    """Return whether the mean of *values*, one a replicate, is known to the relative error *share*.

    Fewer known values than ``FIRST`` are not trusted. A share has Wilson's interval, so that it may need
    many replicates; a mean of 0 is never precise.
    """
    found = interval(values)
    return found.size >= FIRST and found.known and found.half <= abs(found.mean) * share / (1 + share)


def parse_precisions(texts: Iterable[str]) -> dict[str, float]:
    """Return the relative errors that *texts* such as ``delay_s=0.02`` ask for, by metric; raise UserError if wrong."""
    wanted = {}
    for text in texts:
        metric, _, number = text.rpartition("=")
        try:
            share = float(number)
        except ValueError:
            share = 0.0
        if not metric or not 0 < share < 1:
            raise UserError(f"{text!r}: expected a metric and its relative error, such as delay_s=0.02")
        wanted[metric] = share
    return wanted
