"""Survival beside the closed forms, and the claims that need all numbers of piconets at once."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate

Answer = tuple[str, bool | None]

NEEDED = {"traffic", "interference", "piconets", "survival", "closed_form", "without_repeats", "load"}
TOGETHER = 0.95
"""Confidence that all intervals of one claim hold at once."""
PAIR = "traffic == 'one_slot' and interference == 'co_channel' and piconets == 2"


def _rows(runs: pd.DataFrame, traffic: str, interference: str = "co_channel") -> pd.DataFrame:
    """Return the rows of one traffic and interference; empty if there are none or columns are missing."""
    if not set(runs) >= NEEDED:
        return pd.DataFrame()
    return runs[(runs["traffic"] == traffic) & (runs["interference"] == interference)]


def _listed(rows: pd.DataFrame, column: str = "survival") -> list[tuple[int, Estimate]]:
    found = estimates(rows, ["piconets"], [column])
    return list(zip(found["piconets"], found[column], strict=True))


def _against(traffic: str, column: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return our survival by N beside a closed form; it holds if that lies in all intervals, widened to hold together.

    Of k intervals of 95 % one in twenty misses the truth, so each is taken at 1 - 0.05 / k (Bonferroni). Open without
    intervals.
    """
    rows = _rows(runs, traffic)
    if rows.empty:
        return "-", None
    expected = rows.groupby("piconets")[column].first()
    found = _listed(rows)
    told = ", ".join(f"N={n} {ours} ({expected[n]:.4g})" for n, ours in found)
    misses = [n for n, ours in found if not abs(ours.mean - expected[n]) <= max(ours.half, 1e-12)]
    told += f"; outside of single 95 % intervals: {', '.join(f'N={n}' for n in misses) or 'none'}"
    if any(ours.size < 2 for _, ours in found):
        return told, None
    return told, all(
        abs(ours.mean - expected[n]) <= max(ours.half * _widening(ours.size, len(found)), 1e-12) for n, ours in found
    )


def _widening(size: int, claims: int) -> float:
    """Return how much wider an interval of *size* values is if *claims* of them shall hold at once."""
    wide, single = (stats.t.ppf(1 - (1 - TOGETHER) / 2 / count, size - 1) for count in (claims, 1))
    return float(wide / single)


one_slot, full_slot, synchronised = (
    partial(_against, traffic, "closed_form") for traffic in ("one_slot", "full_slot", "synchronised")
)
"""Hold frames of 366 us, of 625 us, and of 366 us in aligned slots against the published form."""
one_slot_exact, full_slot_exact = (
    partial(_against, traffic, "without_repeats") for traffic in ("one_slot", "full_slot")
)
"""Hold frames of 366 us and of 625 us against the form for hops that do not repeat."""


def spread_of_pairs(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how far single pairs of piconets lie apart."""
    rows = runs.query(PAIR) if set(runs) >= NEEDED else pd.DataFrame()
    if len(rows) < 2:
        return "-", None
    low, middle, high = np.quantile(rows["survival"], [0.05, 0.5, 0.95])
    return f"of {len(rows)} pairs the 5 %, 50 % and 95 % quantiles are {low:.4f}, {middle:.4f}, {high:.4f}", None


def neighbouring(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return survival when neighbouring channels count."""
    rows = _rows(runs, "one_slot", "neighbouring")
    return ", ".join(f"N={n} {ours}" for n, ours in _listed(rows)) if len(rows) else "-", None


def real_links(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return survival and load of real links."""
    rows = _rows(runs, "links")
    if rows.empty:
        return "-", None
    loads = dict(_listed(rows, "load"))
    return ", ".join(f"N={n} {ours} at load {loads[n].mean:.3f}" for n, ours in _listed(rows)), None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw survival over N beside the closed forms, with neighbours and with real links; and the spread of pairs."""
    if runs.empty or not set(runs) >= NEEDED:
        return []
    figure = Figure(figsize=(14.0, 4.2), layout="constrained")
    forms, others, pairs = figure.subplots(1, 3)
    for rank, traffic in enumerate(("one_slot", "full_slot", "synchronised")):
        _points(forms, _rows(runs, traffic), traffic, f"C{rank}")
        _form(forms, _rows(runs, traffic), f"C{rank}")
    forms.set(title="co-channel; lines: closed forms", xlabel="piconets", ylabel="share of frames that survive")
    _points(others, _rows(runs, "one_slot"), "one_slot, co-channel", "C0")
    _points(others, _rows(runs, "one_slot", "neighbouring"), "one_slot, with neighbours", "C3")
    _points(others, _rows(runs, "links"), "real links, co-channel", "C4")
    _points(others, _rows(runs, "links", "neighbouring"), "real links, with neighbours", "C5")
    others.set(title="neighbouring channels, real links", xlabel="piconets")
    for plot in (forms, others):
        plot.set_ylim(0, 1.02)
        plot.grid(alpha=0.3)
        plot.legend(fontsize="small")
    rows = runs.query(PAIR)
    if len(rows):
        pairs.hist(rows["survival"], bins=30, color="C0")
        pairs.axvline(rows["closed_form"].iloc[0], color="k", linestyle="--", label="closed form")
        pairs.legend(fontsize="small")
    pairs.set(
        title="N = 2: each run is another pair of addresses", xlabel="share of frames that survive", ylabel="runs"
    )
    path = folder / "survival_of_frames.png"
    save(figure, path)
    return [path]


def _points(plot: Any, rows: pd.DataFrame, label: str, colour: str) -> None:
    if len(rows):
        found = _listed(rows)
        halves = [0.0 if np.isnan(ours.half) else ours.half for _, ours in found]
        means = [ours.mean for _, ours in found]
        plot.errorbar([n for n, _ in found], means, yerr=halves, fmt="o", color=colour, capsize=3, label=label)


def _form(plot: Any, rows: pd.DataFrame, colour: str) -> None:
    if len(rows):
        form = rows.groupby("piconets")["closed_form"].first()
        plot.plot(form.index, form, color=colour, linewidth=1)
