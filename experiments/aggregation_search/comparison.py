"""One-sided tests between the arms of the searches of paper 002, replicate by replicate.

All arms of a replicate have the same floor, targets and seeds, so arms are compared replicate by replicate, and means
over replicates are judged by the one-sided 95 % limits of Student's t. What is no mean of replicates (a spread between
arms, a variance, the share of a straight line) is judged by the 5 % point of 4000 bootstrap samples of the replicates
(Efron and Tibshirani, An Introduction to the Bootstrap, chapter 13), shares of runs by Clopper and Pearson's limits.
A single replicate has no limits, and its claims stay open.

A search that finds no end counts with the cap, as in the paper: a lower bound of what it would have taken.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from cosim.arrays import Floats
from cosim.randomness import Streams
from experiments.reflection_tables.comparison import CONFIDENCE, NO_DATA, Answer, Arm, Limits, limits, values_of

TIME: Final = "search_time_min"
NAMES: Final = {"srp": "SRP", "mrp": "MRP", "mi": "MI", "mito": "MITO", "random": "random"}
"""The strategies, as figures and answers call them."""
OURS: Final = ("srp", "mrp", "mi")
"""The strategies that the paper compares with each other."""
UNITS: Final = {
    TIME: "min",
    "distance_m": "m",
    "distance_after_m": "m",
    "payload_bytes": "bytes",
    "frames": "frames",
    "energy_j": "J",
    "motion_j": "J",
    "rejoin_time_s": "s",
}
SAMPLES: Final = 4000
"""Of the bootstrap."""

Pair = tuple[str, Arm, Arm]
"""What to call it, the arm that should have less, and the one that should have more."""


def columns(runs: pd.DataFrame, arms: Sequence[Arm], metric: str = TIME) -> pd.DataFrame:
    """Return *metric*, a column an arm and a row a replicate; those replicates that all arms have."""
    parts = [values_of(runs, arm, metric) for arm in arms]
    return pd.concat(parts, axis=1, join="inner", keys=range(len(parts))).dropna()


def excess(runs: pd.DataFrame, arm: Arm, than: Arm, metric: str = TIME, factor: float = 1.0) -> "pd.Series[float]":
    """Return by how much *metric* of *than*, times *factor*, is above that of *arm*, by replicate."""
    both = columns(runs, [arm, than], metric)
    return factor * both[1] - both[0]


def less(runs: pd.DataFrame, pairs: Sequence[Pair], metric: str = TIME, factor: float = 1.0) -> Answer:
    """Answer whether in every one of *pairs* the mean of the first arm is below *factor* times that of the second.

    All have to hold, each at 5 %, so that a wrong "holds" has at most 5 %.
    """
    words, holds = [], []
    for label, arm, than in pairs:
        both = columns(runs, [arm, than], metric)
        if both.empty:
            return NO_DATA
        found = limits(factor * both[1] - both[0])
        words.append(f"{label} {against(both, metric)}".strip())
        holds.append(None if found.size < 2 else found.lower > 0)
    return "; ".join(words), None if None in holds or not holds else all(holds)


def against(both: pd.DataFrame, metric: str) -> str:
    """Return the means of the columns 0 and 1, and the quotient of the means with its one-sided 95 % limits."""
    one, other = (f"{mean:.4g}" for mean in both.mean().iloc[:2])
    unit = UNITS.get(metric, "")
    if not (both[1] > 0).any():
        return f"{one} against {other} {unit}".rstrip()
    ratio = quotient(both)
    told = f"{one} against {other} {unit}".rstrip() + f" (x {ratio.mean:.3g}"
    return told + (")" if math.isnan(ratio.lower) else f", {ratio.lower:.3g} to {ratio.upper:.3g})")


def quotient(both: pd.DataFrame) -> Limits:
    """Return the mean of column 0 over that of column 1, by the delta method for paired replicates."""
    means = both.mean()
    ratio = float(means[0] / means[1])
    residual = limits((both[0] - ratio * both[1]) / means[1])
    return Limits(ratio, ratio + residual.lower, ratio + residual.upper, residual.size)


def within(runs: pd.DataFrame, arm: Arm, than: Arm, share: float, metric: str = TIME) -> Answer:
    """Answer whether the means of two arms differ by less than *share* of the second (two one-sided tests)."""
    both = columns(runs, [arm, than], metric)
    if both.empty:
        return NO_DATA
    above, below = limits(both[0] - (1 - share) * both[1]), limits((1 + share) * both[1] - both[0])
    holds = None if len(both) < 2 else above.lower > 0 and below.lower > 0
    return against(both, metric), holds


def share_limits(values: "pd.Series[float]") -> Limits:
    """Return the share of *values*, ones and zeros, with the one-sided limits of Clopper and Pearson."""
    known = values.dropna()
    count, ones = len(known), round(float(known.sum()))
    if not count:
        return Limits(math.nan, math.nan, math.nan, 0)
    lower = float(stats.beta.ppf(1 - CONFIDENCE, ones, count - ones + 1)) if ones else 0.0
    upper = float(stats.beta.ppf(CONFIDENCE, ones + 1, count - ones)) if ones < count else 1.0
    return Limits(ones / count, lower, upper, count)


def completes(runs: pd.DataFrame, arms: Sequence[tuple[str, Arm]], least: float) -> Answer:
    """Answer whether in every one of *arms* more than the share *least* of the searches comes to an end in time.

    It stays open if there are so few that not even all of them could show it, and these do not refute it.
    """
    found = [(label, share_limits(values_of(runs, arm, "completed"))) for label, arm in arms]
    if not found or not all(share.size for _, share in found):
        return NO_DATA
    words = "; ".join(f"{label} {told_share(share)}".strip() for label, share in found)
    holds = [_exceeds(share, least) for _, share in found]
    return words, False if False in holds else None if None in holds else True


def _exceeds(share: Limits, least: float) -> bool | None:
    enough = share_limits(pd.Series([1.0] * share.size)).lower > least
    return share.lower > least if enough or share.upper < least else None


def told_share(share: Limits) -> str:
    """Return a share of runs with its limits."""
    return f"{100 * share.mean:.3g} % of {share.size} ({100 * share.lower:.3g} to {100 * share.upper:.3g} %)"


def bootstrapped(table: pd.DataFrame, statistic: Callable[[Floats], Floats]) -> Limits:
    """Return *statistic* of *table*, a row a replicate, with its one-sided 95 % limits from resampled replicates.

    *statistic* takes samples of the shape (samples, replicates, columns) and returns a value a sample.
    """
    values = table.to_numpy(dtype=float)
    count = len(values)
    if not count:
        return Limits(math.nan, math.nan, math.nan, 0)
    whole = float(statistic(values[None])[0])
    if count < 2:
        return Limits(whole, math.nan, math.nan, count)
    picks = Streams(0)("bootstrap", count).integers(count, size=(SAMPLES, count))
    lower, upper = np.quantile(statistic(values[picks]), [1 - CONFIDENCE, CONFIDENCE])
    return Limits(whole, float(lower), float(upper), count)


def spread_of_means(samples: Floats) -> Floats:
    """Return the largest mean of a column less the smallest, for samples (samples, replicates, columns)."""
    means = samples.mean(axis=1)
    found: Floats = means.max(axis=1) - means.min(axis=1)
    return found


def slope(table: pd.DataFrame, at: Sequence[float]) -> "pd.Series[float]":
    """Return the slope of the least-squares line through the columns of *table*, placed *at*, by replicate."""
    places = np.asarray(at, float) - np.mean(at)
    return pd.Series(table.to_numpy(dtype=float) @ places / float(places @ places), index=table.index)


def positive(found: Limits) -> bool | None:
    """Return whether *found* is above 0 by its one-sided limit; None for a single replicate."""
    return None if found.size < 2 else found.lower > 0


def told(found: Limits, unit: str = "") -> str:
    """Return a value with its one-sided limits."""
    text = f"{found.mean:.3g} {unit}".strip()
    return text if math.isnan(found.lower) else f"{text} ({found.lower:.3g} to {found.upper:.3g})"
