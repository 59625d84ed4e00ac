"""One-sided tests between the arms of goal reflection's sweeps, replicate by replicate.

All arms of a replicate have the same targets in the same order, so what is tested is the mean, over replicates, of a
number that compares two arms of one replicate; its one-sided 95 % limits are those of Student's t. A single replicate
has no limits, and its claims stay open.

The metric is *steps*: motion steps a target. A target that is given up counts with the steps until then, so steps are
the mean of min(steps to the target, give_up_s / tick_s): the same limit for all arms, and a lower bound of what the
paper counts where targets were given up.
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy import stats

Answer: TypeAlias = tuple[str, bool | None]
Label: TypeAlias = str | int | float
Arm: TypeAlias = dict[str, Label]
"""Values of axes."""

CONFIDENCE = 0.95
NAMES: Final = {"avoid_past": "Avoid Past", "visbug": "VisBug", "potential_field": "potential field"}
"""What the algorithms are called in figures."""
NO_DATA: Answer = ("-", None)


class Limits(NamedTuple):
    """A mean with its one-sided 95 % limits: each alone is exceeded with 5 %; NaN for a single value."""

    mean: float
    lower: float
    upper: float
    size: int


def limits(values: "pd.Series[float]") -> Limits:
    """Return the mean of *values*, one a replicate, with its one-sided limits; empty ones are left out."""
    known = values.dropna().to_numpy(dtype=float)
    count = len(known)
    mean = float(np.mean(known)) if count else math.nan
    if count < 2:
        return Limits(mean, math.nan, math.nan, count)
    half = float(stats.t.ppf(CONFIDENCE, count - 1)) * float(np.std(known, ddof=1)) / math.sqrt(count)
    return Limits(mean, mean - half, mean + half, count)


def with_steps(runs: pd.DataFrame) -> pd.DataFrame:
    """Return *runs* with the column ``steps``; without it if they do not have what it is made of."""
    if runs.empty or not {"motion_steps", "targets", "replicate"} <= set(runs):
        return runs
    return runs.assign(steps=runs["motion_steps"] / runs["targets"])


def values_of(runs: pd.DataFrame, arm: Arm, metric: str = "steps") -> "pd.Series[float]":
    """Return *metric* of the runs of *arm* by replicate; empty if there are none."""
    if runs.empty or metric not in runs or not {*arm, "replicate"} <= set(runs):
        return pd.Series(dtype=float)
    chosen = runs
    for axis, label in arm.items():
        chosen = chosen[chosen[axis] == label]
    found: pd.Series[float] = chosen.groupby("replicate")[metric].mean()
    return found


def saving(runs: pd.DataFrame, arm: Arm, than: Arm, metric: str = "steps") -> "pd.Series[float]":
    """Return which share of the *metric* of the arm *than* is saved in *arm*, by replicate; those in both."""
    both = pd.concat([values_of(runs, arm, metric), values_of(runs, than, metric)], axis=1, join="inner")
    shares: pd.Series[float] = 1.0 - both.iloc[:, 0] / both.iloc[:, 1]
    return shares.dropna()


def told(found: Limits) -> str:
    """Return a share that was saved, in words, with the limit that a claim of saving anything is judged by."""
    word = "saves" if found.mean >= 0 else "costs"
    limit = "" if math.isnan(found.lower) else f" (saves at least {_percent(found.lower)})"
    return f"{word} {_percent(abs(found.mean))}{limit}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def saves(runs: pd.DataFrame, pairs: Sequence[tuple[str, Arm, Arm]], least: float = 0.0) -> Answer:
    """Answer whether in every one of the *pairs*, (label, arm, than), more than the share *least* is saved.

    All have to hold, each at 5 %, so that a wrong "holds" has at most 5 %. It is open with a single replicate, and
    there is no data if any pair has none.
    """
    found = [(label, limits(saving(runs, arm, than))) for label, arm, than in pairs]
    if not found or not all(each.size for _, each in found):
        return NO_DATA
    words = "; ".join(f"{label} {told(each)}".strip() for label, each in found)
    if any(each.size < 2 for _, each in found):
        return words, None
    return words, all(each.lower > least for _, each in found)


def ratio_limits(runs: pd.DataFrame, one: Arm, other: Arm) -> Limits:
    """Return the geometric mean of steps of *one* over those of *other*, with its one-sided limits."""
    both = pd.concat([values_of(runs, one), values_of(runs, other)], axis=1, join="inner").dropna()
    found = limits(pd.Series(np.log(both.iloc[:, 0] / both.iloc[:, 1]), index=both.index))
    return Limits(math.exp(found.mean), math.exp(found.lower), math.exp(found.upper), found.size)


def spread(runs: pd.DataFrame, arms: Sequence[Arm]) -> "pd.Series[float]":
    """Return the logarithm of the most steps over the fewest among *arms*, by replicate; those that are in all."""
    columns = pd.concat([values_of(runs, arm) for arm in arms], axis=1, join="inner").dropna()
    return pd.Series(np.log(columns.max(axis=1) / columns.min(axis=1)), index=columns.index)


def cut_top(plot: Any, means: Sequence[float]) -> None:
    """Let the ordinate of *plot* begin at 0 and end above all *means*: a wide interval of a first look is cut."""
    known = [mean for mean in means if not math.isnan(mean)]
    plot.set_ylim(0, 1.7 * max(known, default=1.0) or 1.0)
