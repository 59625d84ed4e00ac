"""Paired comparison of a sweep's arms, replicate by replicate, with one-sided tests that answer a claim.

All arms of a replicate have the same seed and with it the same floors, targets and starts (common random numbers: Law,
Simulation Modeling and Analysis, 5th ed., 11.2). So two arms are compared within each replicate, and the replicates are
the sample. The tests:

- The mean over replicates of a difference, or of another number that compares arms, by Student's t: the paired t test.
  Each of its one-sided 95 % limits is exceeded with 5 %.
- Several pairs at once: the claim holds if every one does, each at 5 %, so that a wrong "holds" still has at most 5 %
  (intersection-union test: Berger, Technometrics 24, 1982).
- Equivalence: two one-sided tests (Schuirmann, J. Pharmacokinetics and Biopharmaceutics 15, 1987).
- A ratio of two means by the delta method for paired samples (Cochran, Sampling Techniques, 3rd ed., 6.4); a geometric
  mean of ratios by the t test of their logarithms.
- A share of runs by the limits of Clopper and Pearson (Biometrika 26, 1934).
- What is no mean over replicates (the spread of several means, a variance) by the 5 % points of bootstrap samples of
  the replicates (Efron and Tibshirani, An Introduction to the Bootstrap, chapter 13).

A single replicate has no limits, and its claims stay open. A claim's answer is (words, whether it holds, or None for
open); it is ``NO_DATA`` if there are no runs of one of its arms.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy import stats

from cosim.arrays import Floats
from cosim.randomness import Streams
from cosim.statistics.digits import digits
from cosim.statistics.intervals import CONFIDENCE

Answer: TypeAlias = tuple[str, bool | None]
Label: TypeAlias = str | int | float
Arm: TypeAlias = dict[str, Label]
"""An arm of a sweep: values of axes."""
Pair: TypeAlias = tuple[str, Arm, Arm]
"""Two arms that are compared, after a label: the one that should have less, and the one that should have more."""

NO_DATA: Final[Answer] = ("-", None)
SAMPLES: Final = 4000
"""Number of bootstrap samples."""


class Limits(NamedTuple):
    """A mean with its one-sided 95 % confidence limits, NaN for a single value, and the number of values."""

    mean: float
    lower: float
    upper: float
    size: int

    def exceeds(self, least: float) -> bool | None:
        """Return whether the mean is above *least* by its one-sided limit; None for a single replicate."""
        return None if self.size < 2 else self.lower > least

    def text(self, unit: str = "") -> str:
        """Return the mean with its limits."""
        text = f"{digits(self.mean, 3)} {unit}".strip()
        return text if math.isnan(self.lower) else f"{text} ({digits(self.lower, 3)} to {digits(self.upper, 3)})"


# ---------------------------------------------------------------- samples: a value a replicate


def by_replicate(runs: pd.DataFrame, arm: Arm, metric: str) -> "pd.Series[float]":
    """Return *metric* of the runs of *arm* by replicate; empty if there are none."""
    if runs.empty or metric not in runs or not {*arm, "replicate"} <= set(runs):
        return pd.Series(dtype=float)
    chosen = runs
    for axis, label in arm.items():
        chosen = chosen[chosen[axis] == label]
    found: pd.Series[float] = chosen.groupby("replicate")[metric].mean()
    return found


def paired(runs: pd.DataFrame, arms: Sequence[Arm], metric: str) -> pd.DataFrame:
    """Return *metric*, a column an arm and a row a replicate, of those replicates that all arms have."""
    parts = [by_replicate(runs, arm, metric) for arm in arms]
    return pd.concat(parts, axis=1, join="inner", keys=range(len(parts))).dropna()


def saving(runs: pd.DataFrame, arm: Arm, than: Arm, metric: str) -> "pd.Series[float]":
    """Return the share of the *metric* of the arm *than* that *arm* saves, by replicate."""
    both = paired(runs, [arm, than], metric)
    shares: pd.Series[float] = 1.0 - both[0] / both[1]
    return shares.dropna()


def per_minute(runs: pd.DataFrame, metrics: Sequence[str]) -> pd.DataFrame:
    """Return *runs* with a column ``METRIC_per_min`` for each of *metrics* that they have: over the time of the run."""
    if "simulated_s" not in runs:
        return runs
    minutes = runs["simulated_s"] / 60.0
    return runs.assign(**{f"{metric}_per_min": runs[metric] / minutes for metric in metrics if metric in runs})


def log_spread(runs: pd.DataFrame, arms: Sequence[Arm], metric: str) -> "pd.Series[float]":
    """Return the logarithm of the largest over the smallest *metric* among *arms*, by replicate."""
    table = paired(runs, arms, metric)
    return pd.Series(np.log(table.max(axis=1) / table.min(axis=1)), index=table.index)


def slopes(table: pd.DataFrame, at: Sequence[float]) -> "pd.Series[float]":
    """Return the slope of the least-squares line through the columns of *table*, placed *at*, by replicate."""
    places = np.asarray(at, float) - np.mean(at)
    return pd.Series(table.to_numpy(dtype=float) @ places / float(places @ places), index=table.index)


def levels(runs: pd.DataFrame, axis: str) -> list[Any]:
    """Return the values of *axis* in *runs*, ascending."""
    return sorted(runs[axis].unique().tolist()) if axis in runs else []


# ---------------------------------------------------------------- limits of a sample


def confidence_limits(values: "pd.Series[float]") -> Limits:
    """Return the mean of *values*, one a replicate, with its limits by Student's t; missing values are left out."""
    known = values.dropna().to_numpy(dtype=float)
    count = len(known)
    mean = float(np.mean(known)) if count else math.nan
    if count < 2:
        return Limits(mean, math.nan, math.nan, count)
    half = float(stats.t.ppf(CONFIDENCE, count - 1)) * float(np.std(known, ddof=1)) / math.sqrt(count)
    return Limits(mean, mean - half, mean + half, count)


def ratio_of_means(both: pd.DataFrame) -> Limits:
    """Return the mean of column 0 over that of column 1, with its limits by the delta method."""
    means = both.mean()
    ratio = float(means[0] / means[1])
    residual = confidence_limits((both[0] - ratio * both[1]) / means[1])
    return Limits(ratio, ratio + residual.lower, ratio + residual.upper, residual.size)


def mean_ratio(runs: pd.DataFrame, arm: Arm, other: Arm, metric: str) -> Limits:
    """Return the geometric mean, over replicates, of *metric* of *arm* over that of *other*, with its limits."""
    both = paired(runs, [arm, other], metric)
    found = confidence_limits(pd.Series(np.log(both[0] / both[1]), index=both.index))
    return Limits(math.exp(found.mean), math.exp(found.lower), math.exp(found.upper), found.size)


def share_limits(values: "pd.Series[float]") -> Limits:
    """Return the share of *values*, ones and zeros, with the one-sided limits of Clopper and Pearson."""
    known = values.dropna()
    count, ones = len(known), round(float(known.sum()))
    if not count:
        return Limits(math.nan, math.nan, math.nan, 0)
    lower = float(stats.beta.ppf(1 - CONFIDENCE, ones, count - ones + 1)) if ones else 0.0
    upper = float(stats.beta.ppf(CONFIDENCE, ones + 1, count - ones)) if ones < count else 1.0
    return Limits(ones / count, lower, upper, count)


def bootstrap_limits(table: pd.DataFrame, statistic: Callable[[Floats], Floats]) -> Limits:
    """Return *statistic* of *table*, a row a replicate, with its limits from resampled replicates.

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


# ---------------------------------------------------------------- answers


def all_hold(answers: Iterable[bool | None]) -> bool | None:
    """Return whether all *answers* are true; None if one of them is open."""
    known = list(answers)
    return None if None in known else all(known)


def none_fails(answers: Iterable[bool | None]) -> bool | None:
    """Return whether all *answers* are true; false if one of them is, even if others are open, which give None."""
    known = list(answers)
    return False if False in known else None if None in known else True


def less(runs: pd.DataFrame, pairs: Sequence[Pair], metric: str, factor: float = 1.0, unit: str = "") -> Answer:
    """Answer whether in every one of *pairs* the mean of the first arm is below *factor* times that of the second."""
    words, holds = [], []
    for label, arm, than in pairs:
        both = paired(runs, [arm, than], metric)
        if both.empty:
            return NO_DATA
        found = confidence_limits(factor * both[1] - both[0])
        words.append(f"{label} {against(both, unit)}".strip())
        holds.append(found.exceeds(0))
    return "; ".join(words), all_hold(holds) if holds else None


def less_censored(
    runs: pd.DataFrame, pairs: Sequence[Pair], metric: str, factor: float = 1.0, ended: str = "reached"
) -> Answer:
    """Answer as :func:`less`, of a *metric* that counts with a lower bound in runs that were cut: *ended* is 0 there.

    No pair holds whose first arm has such runs, and none fails whose second has. These stay open.
    """
    words, holds = [], []
    for label, arm, than in pairs:
        found, answer = less(runs, [(label, arm, than)], metric, factor)
        if found == NO_DATA[0]:
            return NO_DATA
        cut = [int((by_replicate(runs, each, ended) < 1).sum()) for each in (arm, than)]
        words.append(found + (f", {cut[0]} and {cut[1]} runs cut" if any(cut) else ""))
        holds.append(None if (answer is True and cut[0]) or (answer is False and cut[1]) else answer)
    return ("; ".join(words), none_fails(holds)) if holds else NO_DATA


def equivalent(runs: pd.DataFrame, arm: Arm, than: Arm, share: float, metric: str, unit: str = "") -> Answer:
    """Answer whether the means of two arms differ by less than *share* of the second (two one-sided tests)."""
    both = paired(runs, [arm, than], metric)
    if both.empty:
        return NO_DATA
    above, below = (
        confidence_limits(both[0] - (1 - share) * both[1]),
        confidence_limits((1 + share) * both[1] - both[0]),
    )
    holds = None if len(both) < 2 else above.lower > 0 and below.lower > 0
    return against(both, unit), holds


def saves(runs: pd.DataFrame, pairs: Sequence[Pair], metric: str, least: float = 0.0) -> Answer:
    """Answer whether in every one of *pairs* the first arm saves more than the share *least* of the second's *metric*.

    The share is taken in each replicate; :func:`less` compares the means.
    """
    found = [(label, confidence_limits(saving(runs, arm, than, metric))) for label, arm, than in pairs]
    if not found or not all(each.size for _, each in found):
        return NO_DATA
    words = "; ".join(f"{label} {saving_text(each)}".strip() for label, each in found)
    return words, all_hold(each.exceeds(least) for _, each in found)


def above(runs: pd.DataFrame, arms: Sequence[tuple[str, Arm]], metric: str, least: float = 0.0) -> Answer:
    """Answer whether the mean of *metric* is above *least* in every one of *arms*."""
    found = [(label, confidence_limits(by_replicate(runs, arm, metric))) for label, arm in arms]
    if not found or not all(each.size for _, each in found):
        return NO_DATA
    words = "; ".join(f"{label} {each.text()}".strip() for label, each in found)
    return words, all_hold(each.exceeds(least) for _, each in found)


def more(runs: pd.DataFrame, pairs: Sequence[tuple[str, Arm, str, Arm, str]]) -> Answer:
    """Answer whether in every pair, (label, arm, metric, other arm, its metric), the first has more than the second."""
    words, holds = [], []
    for label, arm, metric, other, its_metric in pairs:
        both = pd.concat([by_replicate(runs, arm, metric), by_replicate(runs, other, its_metric)], axis=1, join="inner")
        difference = confidence_limits(both.iloc[:, 0] - both.iloc[:, 1])
        if not difference.size:
            return NO_DATA
        one, two = both.mean()
        words.append(f"{label} {digits(one, 3)} against {digits(two, 3)}, difference {difference.text()}".strip())
        holds.append(difference.exceeds(0))
    return ("; ".join(words), all_hold(holds)) if holds else NO_DATA


def mostly(runs: pd.DataFrame, arms: Sequence[tuple[str, Arm]], least: float, metric: str = "completed") -> Answer:
    """Answer whether *metric*, 1 or 0, is 1 in more than the share *least* of the runs of every one of *arms*.

    It stays open if there are so few runs that not even all of them could show it, and these do not refute it.
    """
    found = [(label, share_limits(by_replicate(runs, arm, metric))) for label, arm in arms]
    if not found or not all(share.size for _, share in found):
        return NO_DATA
    words = "; ".join(f"{label} {share_text(share)}".strip() for label, share in found)
    return words, none_fails(_exceeds(share, least) for _, share in found)


def _exceeds(share: Limits, least: float) -> bool | None:
    enough = share_limits(pd.Series([1.0] * share.size)).lower > least
    return share.lower > least if enough or share.upper < least else None


def never(runs: pd.DataFrame, arms: Sequence[Arm], metric: str, label: str = "", unit: str = "") -> Answer:
    """Answer whether *metric*, a count, is 0 in every run of all *arms*: a single run refutes it."""
    found = [by_replicate(runs, arm, metric) for arm in arms]
    if not found or any(part.empty for part in found):
        return NO_DATA
    every = pd.concat(found)
    words = f"{label} {digits(every.mean(), 3)} {unit}".strip()
    return f"{words} a run, in {int((every > 0).sum())} of {len(every)}", not every.any()


# ---------------------------------------------------------------- words of an answer


def against(both: pd.DataFrame, unit: str = "") -> str:
    """Return the means of the columns 0 and 1, and the ratio of the means with its one-sided 95 % limits."""
    one, other = (digits(mean, 4) for mean in both.mean().iloc[:2])
    text = f"{one} against {other} {unit}".rstrip()
    if not (both[1] > 0).any():
        return text
    ratio = ratio_of_means(both)
    text += f" (x {digits(ratio.mean, 3)}"
    return text + (")" if math.isnan(ratio.lower) else f", {digits(ratio.lower, 3)} to {digits(ratio.upper, 3)})")


def saving_text(share: Limits) -> str:
    """Return a share that was saved, in words, with the limit that a claim of saving anything is judged by."""
    word = "saves" if share.mean >= 0 else "costs"
    text = f"{word} {_percent(abs(share.mean))}"
    if math.isnan(share.lower):
        return text
    bound = "at least" if share.lower >= 0 else "at most" if share.mean < 0 else "costs at most"
    return f"{text} ({bound} {_percent(abs(share.lower))})"


def _percent(share: float) -> str:
    return f"{digits(100 * share, 3)} %"


def share_text(share: Limits) -> str:
    """Return a share of runs with its limits."""
    return f"{100 * share.mean:.3g} % of {share.size} ({100 * share.lower:.3g} to {100 * share.upper:.3g} %)"
