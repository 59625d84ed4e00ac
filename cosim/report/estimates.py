"""Tables of means with 95 % confidence intervals, a row an arm."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from cosim.statistics.intervals import estimate, is_share, share


def estimates(frame: pd.DataFrame, by: Sequence[str], metrics: Sequence[str]) -> pd.DataFrame:
    """Return a row for each combination of the columns *by*, with an Estimate of each metric.

    Rows of one seed, where *frame* has that column, count as one for the interval: see :func:`estimate`. A metric that
    is 0 or 1 in every row of *frame*, and not always the same, is a share in each of them.
    """
    groups = frame.groupby(list(by), sort=False, dropna=False) if by else [((), frame)]
    kinds = {
        metric: share if is_share(frame[metric]) and frame[metric].nunique() > 1 else estimate for metric in metrics
    }
    rows = []
    for key, group in groups:
        row: dict[str, Any] = dict(zip(by, key, strict=True))
        seeds = seeds_of(group)
        rows.append(row | {"n": len(group)} | {metric: kinds[metric](group[metric], seeds) for metric in metrics})
    return pd.DataFrame(rows)


def seeds_of(frame: pd.DataFrame) -> "pd.Series[int] | None":
    """Return the seed of each row of *frame*, which all arms of a replicate share; None if it is not known."""
    return frame.get("seed")
