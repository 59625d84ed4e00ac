"""Means with 95 % confidence intervals, of values that may come from the same runs."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

CONFIDENCE = 0.95


class Estimate(NamedTuple):
    """A mean, half the width of its confidence interval (NaN for a single run), and the number of values."""

    mean: float
    half: float
    size: int

    def __str__(self) -> str:
        if not self.size:
            return "-"
        spread = self.half > 1e-12 * abs(self.mean)  # NaN for a single run; less is the rounding of the sum
        return f"{self.mean:.4g} ± {self.half:.2g}" if spread else f"{self.mean:.4g}"


def estimate(values: "pd.Series[float]", seeds: "pd.Series[int] | None" = None) -> Estimate:
    """Return the mean of *values* with its 95 % confidence interval by Student's t; missing values are left out.

    *seeds*, as long as *values*, gives the seed of each. Values of one run need not be independent, nor those of
    several arms with the same random numbers, so the interval is that of a mean of clusters (Cochran, Sampling
    Techniques, 3rd ed., 9A.1), with one degree of freedom less than there are seeds. Without *seeds* all values count
    as independent.
    """
    there = values.notna().to_numpy()
    known = values.to_numpy(dtype=float)[there]
    if not len(known):
        return Estimate(math.nan, math.nan, 0)
    mean = float(np.mean(known))
    numbers = np.arange(len(known)) if seeds is None else np.unique(seeds.to_numpy()[there], return_inverse=True)[1]
    sums = np.bincount(numbers, weights=known - mean)
    count = len(sums)
    if count == 1:
        return Estimate(mean, math.nan, len(known))
    deviation = math.sqrt(float((sums**2).sum()) * count / (count - 1)) / len(known)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, count - 1))
    return Estimate(mean, quantile * deviation, len(known))


def estimates(frame: pd.DataFrame, by: Sequence[str], metrics: Sequence[str]) -> pd.DataFrame:
    """Return a row for each combination of the columns *by*, with an Estimate of each metric.

    Rows of one seed, where *frame* has that column, count as one for the interval: see :func:`estimate`.
    """
    groups = frame.groupby(list(by), sort=False, dropna=False) if by else [((), frame)]
    rows = []
    for key, group in groups:
        row: dict[str, Any] = dict(zip(by, key, strict=True))
        seeds = seeds_of(group)
        rows.append(row | {"n": len(group)} | {metric: estimate(group[metric], seeds) for metric in metrics})
    return pd.DataFrame(rows)


def seeds_of(frame: pd.DataFrame) -> "pd.Series[int] | None":
    """Return the seed of each row of *frame*, which all arms of a replicate share; None if it is not known."""
    return frame.get("seed")
