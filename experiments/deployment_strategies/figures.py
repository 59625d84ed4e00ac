"""Paper 004's claims on its three strategies, as tests: how many robots move, and what the augmentations are good for.

``lowers_group_4`` in published.csv is ``lowers`` for the strategy ``group`` and four robots; the tests by such names
are made at the end of this file. Interference is robot-seconds that robots lose to others: below their free speed
because of another robot (:mod:`protocols.deployment.interference`), as shares of it. Where it counts whole seconds the
names have ``hinders`` for ``lowers``; where the time that robots wait for their turn, as ordered, counts as lost too,
``saves``: a staggered start must not only move seconds from one column to the other.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from cosim.report.comparison import (
    NO_DATA,
    Answer,
    Arm,
    Label,
    by_replicate,
    confidence_limits,
    mostly,
    paired,
    ratio_of_means,
)
from cosim.statistics.digits import digits

IN_TIME: Final = 0.9
"""Share of the runs that must end deployed for a strategy to count as robust."""
STRATEGIES: Final = ("group", "wave", "leap_frog")
AUGMENTED: Final = ("group", "leap_frog")
"""Strategies that have anything to augment."""
SIZES: Final = (2, 4, 6, 8)
LOST: Final = "interference_s"
HINDERED: Final = "hindered_s"
WAITED: Final = "waited_s"
EITHER: Final = "lost_or_waited_s"
"""Column of both together."""
NOTHING: Final = 0.01
"""Share of the time under way below which there is no interference."""
UNIT: Final = "robot-s"


def _arm(strategy: str, robots: int, augmentation: str = "with") -> Arm:
    return {"strategy": strategy, "robots": robots, "augmentation": augmentation}


def _sizes(runs: pd.DataFrame) -> list[int]:
    return [size for size in SIZES if "robots" in runs and size in set(runs["robots"])]


# ---------------------------------------------------------------- how many robots move


def _expected(strategy: str, robots: int) -> list[float]:
    rising = [float(n) for n in range(1, robots + 1)]
    return {"group": rising[::-1], "wave": rising, "leap_frog": [1.0] * robots}[strategy]


def moving(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether in every deployment that came to its end so many robots moved per stage as the paper says."""
    sizes = _sizes(runs)
    if not sizes or not {"strategy", "moving_1", "deployed"} <= set(runs):
        return NO_DATA
    whole = runs[(runs["strategy"] == strategy) & (runs["deployed"] == 1)]
    if whole.empty:
        return NO_DATA
    words, holds = [], True
    for size, part in whole.groupby("robots"):
        wanted = _expected(strategy, int(str(size)))
        counted = part[[f"moving_{n}" for n in range(1, len(wanted) + 1)]].to_numpy(float)
        right = (counted == wanted).all(axis=1)
        holds &= bool(right.all()) and bool((part["stages"] == len(wanted)).all())
        usual = ", ".join(f"{value:g}" for value in np.nanmedian(counted, axis=0))
        words.append(f"{size} robots: {usual} in {int(right.sum())} of {len(part)}")
    return "; ".join(words), holds


# ---------------------------------------------------------------- what the augmentations are good for


def _means(runs: pd.DataFrame, strategy: str, sizes: Sequence[int], metric: str) -> pd.DataFrame:
    """Return the mean over team sizes, augmented (0) and not (1), a row a replicate; those that have all arms."""
    parts = [
        paired(runs, [_arm(strategy, size, augmentation) for size in sizes], metric).mean(axis=1)
        for augmentation in ("with", "without")
    ]
    return pd.concat(parts, axis=1, join="inner", keys=(0, 1)).dropna()


def lowers(strategy: str, size: int | None, metric: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether interference is lower with the augmentations, with 95 % confidence.

    Without a *size* it is that of all sizes in the mean.
    """
    sizes = _sizes(runs) if size is None else [size]
    both = _means(runs, strategy, sizes, metric) if sizes else pd.DataFrame()
    if both.empty:
        return NO_DATA
    found = confidence_limits(both[1] - both[0])
    one, other = (digits(mean, 4) for mean in both.mean())
    words = f"{one} with against {other} {UNIT} without; {found.text(UNIT)} less"
    if (both[1] > 0).any():
        words += f", x {ratio_of_means(both).mean:.3g}"
    return words, None if found.size < 2 else found.lower > 0


def _summed(runs: pd.DataFrame) -> pd.DataFrame:
    """Return *runs* with a column for what was lost or waited, if they have both."""
    return runs.assign(**{EITHER: runs[LOST] + runs[WAITED]}) if {LOST, WAITED} <= set(runs) else runs


def saves(strategy: str, size: int | None, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer as ``lowers``, with the time that robots wait for their turn, as ordered, for lost too."""
    return lowers(strategy, size, EITHER, _summed(runs), observations)


def none_wave(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether robots of a wave lose less than ``NOTHING`` of the time under way, with every size of team."""
    words, holds = [], []
    for size in _sizes(runs):
        lost, way = (by_replicate(runs, _arm("wave", size, "without"), metric) for metric in (LOST, "under_way_s"))
        shares = (lost / way).dropna()
        if shares.empty:
            return NO_DATA
        found = confidence_limits(shares)
        words.append(f"{size} robots: {100 * found.mean:.3g} % of the time under way")
        holds.append(None if math.isnan(found.upper) else found.upper < NOTHING)
    return ("; ".join(words), None if None in holds else all(holds)) if holds else NO_DATA


# ---------------------------------------------------------------- how robust they are


def deploys(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether with every size of team the augmented strategy ends deployed."""
    return mostly(runs, [(f"{size} robots:", _arm(strategy, size)) for size in _sizes(runs)], IN_TIME, "deployed")


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return time, way and interference with the augmentations over those without, by strategy and size."""
    rows: list[dict[str, Label]] = []
    runs = _summed(runs)
    for strategy in STRATEGIES:
        for size in _sizes(runs):
            row: dict[str, Label] = {"strategy": strategy, "robots": size}
            for metric in ("until_deployed_s", "way_m", LOST, EITHER):
                both = paired(runs, [_arm(strategy, size), _arm(strategy, size, "without")], metric)
                known = not both.empty and bool((both[1] > 0).any())
                row[metric] = f"x {ratio_of_means(both).mean:.3g}" if known else "-"
            rows.append(row)
    return {"with the augmentations over without": pd.DataFrame(rows)} if rows else {}


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"moving_{s}": partial(moving, s) for s in STRATEGIES})
globals().update({f"deploys_{s}": partial(deploys, s) for s in STRATEGIES})
globals().update({f"lowers_{s}": partial(lowers, s, None, LOST) for s in AUGMENTED})
globals().update({f"hinders_{s}": partial(lowers, s, None, HINDERED) for s in AUGMENTED})
globals().update({f"lowers_{s}_{n}": partial(lowers, s, n, LOST) for s in AUGMENTED for n in SIZES})
globals().update({f"saves_{s}": partial(saves, s, None) for s in AUGMENTED})
globals().update({f"saves_{s}_{n}": partial(saves, s, n) for s in AUGMENTED for n in SIZES})
