"""The claims of paper 002, section VII.B, as one-sided tests, and Figure 4: search time by target distribution.

``fastest_3`` in published.csv is ``fastest`` for the distribution 3; the tests by such names are made at the end of
this file.
"""

from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.arrays import Floats
from cosim.report.comparison import (
    NO_DATA,
    Answer,
    bootstrap_limits,
    by_replicate,
    confidence_limits,
    equivalent,
    less,
    paired,
    share_limits,
    share_text,
    slopes,
)
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.aggregation.strategies import OURS, TIME, Strategies

SHEET: Final = Strategies(Path(__file__).parent, "distribution")
"""The strategies by target distribution."""
DISTRIBUTIONS: Final = (1, 2, 3, 4)
"""Target distributions, from easy to hard."""
CONSTANT: Final = 0.25
"""Share by which a distribution may take longer, or less long, than the first for SRP to be nearly constant."""
STRAIGHT: Final = 0.9
"""Least share of the sum of squares between the distributions that a straight line has to account for."""
SIMILAR: Final = 0.1
"""Share by which MRP may take more or less time to be like SRP."""
MOST: Final = 0.5
"""Share of the runs below which random search mostly fails."""


def faster_than_random(strategy: str, distribution: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a lower mean search time than random search on one distribution."""
    return less(runs, [("", SHEET.arm(strategy, distribution), SHEET.arm("random", distribution))], TIME, unit="min")


def random_mostly_fails(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether less than half of the random searches come to an end, taking all distributions together."""
    parts = [by_replicate(runs, SHEET.arm("random", distribution), "completed") for distribution in DISTRIBUTIONS]
    found = share_limits(pd.concat(parts))
    if not found.size:
        return NO_DATA
    return share_text(found), None if any(len(part) < 2 for part in parts) else found.upper < MOST


def fastest(distribution: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI has a lower mean search time than SRP and than MRP."""
    return SHEET.fastest(distribution, runs)


def early(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a lower mean search time than SRP where targets are found early."""
    return less(runs, [("", SHEET.arm(strategy, 1), SHEET.arm("srp", 1))], TIME, unit="min")


def srp_constant(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether each of SRP's means differs by a share below ``CONSTANT`` from that for the first distribution."""
    first, *others = (SHEET.arm("srp", each) for each in DISTRIBUTIONS)
    found = [equivalent(runs, each, first, CONSTANT, TIME, "min") for each in others]
    if NO_DATA in found:
        return NO_DATA
    words = "; ".join(f"{each}: {text}" for each, (text, _) in zip(DISTRIBUTIONS[1:], found, strict=True))
    holds = [answer for _, answer in found]
    return words, None if None in holds else all(holds)


def _slopes(runs: pd.DataFrame, strategy: str) -> "pd.Series[float]":
    """Return the increase of the search time from one distribution to the next, min, by replicate."""
    return slopes(paired(runs, [SHEET.arm(strategy, each) for each in DISTRIBUTIONS], TIME), DISTRIBUTIONS)


def srp_increases(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether SRP's search time increases with difficulty at all: the slope is above 0."""
    found = confidence_limits(_slopes(runs, "srp"))
    return (found.text("min from one to the next"), found.exceeds(0)) if found.size else NO_DATA


def srp_flatter(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether SRP's search time increases less with difficulty than MI's."""
    parts = {strategy: _slopes(runs, strategy) for strategy in ("srp", "mi")}
    if any(part.empty for part in parts.values()):
        return NO_DATA
    limits = {SHEET.names[each]: confidence_limits(part) for each, part in parts.items()}
    words = "; ".join(f"{name} {found.text('min from one to the next')}" for name, found in limits.items())
    return words, confidence_limits((parts["mi"] - parts["srp"]).dropna()).exceeds(0)


def mi_increases(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MI's search time increases from each distribution to the next: increments of the same sign."""
    arms = ((each, SHEET.arm("mi", each)) for each in DISTRIBUTIONS)
    steps = [(f"{low} to {high}:", easier, harder) for (low, easier), (high, harder) in pairwise(arms)]
    return less(runs, steps, TIME, unit="min")


def mi_linear(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a rising line accounts for at least ``STRAIGHT`` of what MI's means differ by."""
    table = paired(runs, [SHEET.arm("mi", each) for each in DISTRIBUTIONS], TIME)
    if table.empty:
        return NO_DATA
    found = bootstrap_limits(table, straight)
    words = f"{found.text()} of the sum of squares between the distributions"
    return words, None if found.size < 2 else found.lower >= STRAIGHT


def straight(samples: Floats) -> Floats:
    """Return which share of the variance of the means of the columns their rising least-squares line accounts for.

    Of samples (samples, replicates, columns); 0 where the line falls, or no mean differs.
    """
    means = samples.mean(axis=1)
    means = means - means.mean(axis=1, keepdims=True)
    places = np.arange(means.shape[1]) - (means.shape[1] - 1) / 2
    slopes = means @ places / float(places @ places)
    total = (means**2).sum(axis=1)
    found: Floats = np.where(slopes > 0, slopes**2 * float(places @ places) / np.where(total > 0, total, np.inf), 0.0)
    return found


def mrp_like_srp(distribution: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether the mean search times of MRP and SRP differ by a share of less than ``SIMILAR``."""
    return equivalent(runs, SHEET.arm("mrp", distribution), SHEET.arm("srp", distribution), SIMILAR, TIME, "min")


def mrp_worse(distribution: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether MRP has a higher mean search time than SRP."""
    return less(runs, [SHEET.pair("srp", "mrp", distribution)], TIME, unit="min")


# ---------------------------------------------------------------- tables and figures


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return Figure 4 as a table: a row a strategy, a column a distribution, and the share that came to an end."""
    if runs.empty or not {"strategy", "distribution", "completed", TIME} <= set(runs):
        return {}
    rows = []
    for strategy, part in runs.groupby("strategy", sort=False):
        row: dict[str, str] = {"strategy": SHEET.names.get(str(strategy), str(strategy))}
        for distribution, cell in part.groupby("distribution"):
            row[f"{distribution}"] = f"{estimate(cell[TIME])}, {100 * cell['completed'].mean():.3g} %"
        rows.append(row)
    title = "Figure 4: search time, min, mean ± half of the 95 % confidence interval, and the share that came to an end"
    return {title: pd.DataFrame(rows)}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw Figure 4: mean search time over the distribution, a line a strategy."""
    if runs.empty or not {"strategy", "distribution", TIME} <= set(runs):
        return []
    figure = Figure(figsize=(6.5, 4.4), layout="constrained")
    plot = figure.subplots()
    for name in (name for name in SHEET.names if name in set(runs["strategy"])):
        points = estimates(runs[runs["strategy"] == name].sort_values("distribution"), ["distribution"], [TIME])
        halves = np.nan_to_num([value.half for value in points[TIME]])
        means = [value.mean for value in points[TIME]]
        plot.errorbar(points["distribution"], means, yerr=halves, marker="o", capsize=3, label=SHEET.names[name])
    plot.set(xlabel="target distribution, from easy to hard", ylabel="search time, min")
    plot.set_xticks(sorted(runs["distribution"].unique()))
    plot.set_ylim(bottom=0)
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small")
    path = folder / "search_time_by_distribution.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update(
    {f"faster_than_random_{s}_{d}": partial(faster_than_random, s, d) for s in OURS for d in DISTRIBUTIONS}
)
globals().update(
    {f"{t.__name__}_{d}": partial(t, d) for t in (fastest, mrp_like_srp, mrp_worse) for d in DISTRIBUTIONS}
)
globals().update({f"early_{strategy}": partial(early, strategy) for strategy in OURS[1:]})
