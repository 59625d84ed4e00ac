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
    """The bound that is nearest to the mean."""
    needed: int | None
    """About how many replicates would decide; None if no number would, or it is decided."""


def place(found: Estimate, low: float, high: float, replicates: int) -> Placed:
    """Return where the interval of *found*, of so many *replicates*, lies in the range from *low* to *high*.

    An interval shrinks with the root of their number, about a mean that is taken to stay where it is.
    """
    bound = min((low, high), key=lambda each: abs(found.mean - each))
    if not found.known:
        return Placed(None, bound, None)
    slack = 1e-12 * max(abs(each) for each in (low, high) if math.isfinite(each))  # the rounding of a sum
    if low - slack <= found.low and found.high <= high + slack:
        return Placed(True, bound, None)
    if found.high < low - slack or found.low > high + slack:
        return Placed(False, bound, None)
    return Placed(None, bound, _needed(found, bound, replicates))


def _needed(found: Estimate, bound: float, replicates: int) -> int | None:
    half = found.mean - found.low if bound < found.mean else found.high - found.mean
    distance = abs(found.mean - bound)
    if replicates * half**2 > MOST * distance**2:
        return None
    return max(math.ceil(replicates * (half / distance) ** 2), replicates + 1)
