"""What a confidence interval decides about a range: all of it inside, all of it outside, or neither yet.

A mean that lies in the range proves nothing if its interval leaves it: that is the difference between "not shown to be
different" and "shown to be alike" (Schuirmann, J. Pharmacokinetics and Biopharmaceutics 15, 1987). A 95 % interval
within the range has it at a level of 2.5 %, as each of its ends is exceeded with that.
"""

import math
from typing import NamedTuple

from cosim.statistics.intervals import Estimate

MOST = 1_000_000
"""Most replicates that are worth telling: if more would be needed, the mean lies practically on the bound."""


class Placed(NamedTuple):
    """Where an interval lies: within a range (True), wholly outside (False), or across a bound (None)."""

    within: bool | None
    bound: float
    """The bound that it crosses, the one that is nearer to the mean; else the nearest."""
    needed: int | None
    """About how many replicates would decide; None if no number would, or it is decided."""


def place(found: Estimate, low: float, high: float, replicates: int) -> Placed:
    """Return where the interval of *found*, of so many *replicates*, lies in the range from *low* to *high*."""
    within = _within(found, low, high)
    crossed = [bound for bound in (low, high) if found.low < bound < found.high] if within is None else []
    bound = min(crossed or (low, high), key=lambda each: abs(found.mean - each))
    needed = _needed(found, low, high, replicates) if within is None and found.known else None
    return Placed(within, bound, needed)


def _within(found: Estimate, low: float, high: float) -> bool | None:
    slack = 1e-12 * max(abs(each) for each in (low, high) if math.isfinite(each))  # the rounding of a sum
    if low - slack <= found.low and found.high <= high + slack:
        return True
    return False if found.high < low - slack or found.low > high + slack else None


def _needed(found: Estimate, low: float, high: float, replicates: int) -> int | None:
    """Return the least number of replicates that would decide, if the mean stays where it is."""
    few, many = replicates, MOST
    if _within(found.grown(many / replicates), low, high) is None:
        return None
    while many - few > 1:
        middle = (few + many) // 2
        if _within(found.grown(middle / replicates), low, high) is None:
            few = middle
        else:
            many = middle
    return many
