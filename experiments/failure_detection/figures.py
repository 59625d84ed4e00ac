"""The claims that no single number decides, the table of the reference beside ours, and mistakes over detection time.

Tests compare detectors on the same heartbeats, so differences are paired by run; all are for heartbeats each second.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.digits import digits
from cosim.statistics.intervals import CONFIDENCE
from experiments.failure_detection.theory import nfd_s

Answer = tuple[str, bool | None]

NO_DATA: Final[Answer] = ("-", None)
NEEDED: Final = {"network", "period_s", "detector", "bound_s", "threshold", "mistakes", "watched_s", "accuracy"}
PERIOD_S: Final = 1.0
LOSS: Final = {"lossless": 0.0, "loss_1": 0.01, "loss_10": 0.1}
"""Networks whose delays and losses the theory knows."""
MEAN_DELAY_S: Final = 0.02
HOUR_S: Final = 3600.0
DETECTORS: Final = ("nfd_s", "nfd_e", "nfd_e_32", "fixed", "fixed_cut_4", "fixed_cut_8", "phi_akka", "phi_normal")
BOUNDED: Final = DETECTORS[:6]
"""Detectors that are set by the time within which a crash is to be noticed."""


def _rows(observations: pd.DataFrame, network: str, detector: str) -> pd.DataFrame:
    """Return the rows of a detector on a network, with heartbeats each second; none if there are not the columns."""
    if not set(observations) >= NEEDED:
        return pd.DataFrame()
    each = observations["network"] == network
    return observations[each & (observations["detector"] == detector) & (observations["period_s"] == PERIOD_S)]


def few_mistakes(bound_s: float, published_s: float, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether E(T_MR) of NFD-S as published lies in the 95 % interval of ours, from the count of all runs.

    For mistakes so rare that runs have none or one: the count is Poisson's, and the interval is the exact one.
    """
    rows = _rows(observations, "loss_1", "nfd_s")
    rows = rows[rows["bound_s"] == bound_s] if len(rows) else rows
    if rows.empty:
        return NO_DATA
    count, watched_s, tail = int(rows["mistakes"].sum()), float(rows["watched_s"].sum()), (1.0 - CONFIDENCE) / 2.0
    most = stats.chi2.ppf(1.0 - tail, 2 * count + 2) / 2.0
    least = stats.chi2.ppf(tail, 2 * count) / 2.0 if count else 0.0
    longest_s = watched_s / least if count else math.inf
    text = f"{count} mistakes in {watched_s:.0f} s: {digits(watched_s / most, 4)} to {digits(longest_s, 4)}"
    return text, bool(watched_s / most <= published_s <= longest_s)


few_mistakes_2_50 = partial(few_mistakes, 2.5, 10101.0)
few_mistakes_3_05 = partial(few_mistakes, 3.05, 110680.0)


def _differences(observations: pd.DataFrame, column: str, one: str, other: str) -> pd.DataFrame:
    """Return *column* of *one* detector less that of the *other*, a row a run and a column a bound; 1 % are lost."""
    tables = [_rows(observations, "loss_1", detector) for detector in (one, other)]
    if any(table.empty for table in tables):
        return pd.DataFrame()
    first, second = (table.pivot_table(index="seed", columns="bound_s", values=column) for table in tables)
    return first - second


def _limits(differences: pd.DataFrame) -> list[tuple[float, float, float]]:
    """Return the bound, and the one-sided 95 % limits of the mean difference, below and above, for each column."""
    size = len(differences)
    half = stats.t.ppf(CONFIDENCE, size - 1) * differences.std(ddof=1) / math.sqrt(size)
    mean = differences.mean()
    bounds = [float(column) for column in differences.columns]
    return list(zip(bounds, (mean - half).tolist(), (mean + half).tolist(), strict=True))


def more_accurate(other: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether P_A of NFD-S is above that of the *other* detector at every bound of the detection time."""
    found = _differences(observations, "accuracy", "nfd_s", other)
    if len(found) < 2:
        return NO_DATA
    limits = _limits(found)
    text = ", ".join(f"{bound:g} s: {low:.2g}" for bound, low, _ in limits)
    return f"P_A gains at least {text}", all(low > 0.0 for _, low, _ in limits)


def less_often_wrong(other: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether NFD-S makes fewer mistakes than the *other* at some bounds, and at none more."""
    found = _differences(observations, "mistake_rate_per_s", "nfd_s", other)
    if len(found) < 2:
        return NO_DATA
    limits = _limits(found)
    fewer = [f"{bound:g}" for bound, _, high in limits if high < 0.0]
    more = [f"{bound:g}" for bound, low, _ in limits if low > 0.0]
    text = f"fewer at {', '.join(fewer) or 'none'} s, more at {', '.join(more) or 'none'}, of {len(limits)} bounds"
    return text, bool(fewer) and not more


more_accurate_cut_4, more_accurate_cut_8 = (partial(more_accurate, f"fixed_cut_{c}") for c in (4, 8))
less_often_wrong_cut_4, less_often_wrong_cut_8 = (partial(less_often_wrong, f"fixed_cut_{c}") for c in (4, 8))


def two_falls(kind: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether phi accrual errs less often at threshold 2 than at 0.5, and at 32 less often than at 4."""
    rows = _rows(observations, "loss_1", kind)
    if rows.empty or rows["seed"].nunique() < 2:
        return NO_DATA
    rates = rows.pivot_table(index="seed", columns="threshold", values="mistake_rate_per_s")
    falls = pd.DataFrame({2.0: rates[0.5] - rates[2.0], 32.0: rates[4.0] - rates[32.0]})
    text = ", ".join(f"{threshold:g}: {HOUR_S * mean:.3g}/h" for threshold, mean in rates.mean().items())
    return text, all(low > 0.0 for _, low, _ in _limits(falls))


two_falls_akka, two_falls_normal = (partial(two_falls, kind) for kind in ("phi_akka", "phi_normal"))


# ---------------------------------------------------------------- tables and figures


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return mistakes an hour of all detectors by bound or threshold, each second a heartbeat, a table a network."""
    made: dict[str, pd.DataFrame] = {}
    if not set(observations) >= NEEDED:
        return made
    rows = observations[observations["period_s"] == PERIOD_S]
    for network, part in rows.groupby("network", sort=False):
        part = part.assign(per_hour=HOUR_S * part["mistake_rate_per_s"])
        for title, chosen, by in (
            ("bound of the detection time, s", part[part["bound_s"].notna()], "bound_s"),
            ("threshold", part[part["threshold"].notna()], "threshold"),
        ):
            table = chosen.pivot_table(index=by, columns="detector", values=["detection_s", "per_hour"], sort=False)
            if len(table):
                named = {"detection_s": "T_D", "per_hour": "/h"}
                table.columns = pd.Index([f"{pair[1]} {named[pair[0]]}" for pair in table.columns])
                table = table.map(lambda value: f"{value:.4g}").rename_axis(index=title).reset_index()
                made[f"{network}: mean detection time (s) and mistakes an hour, by {title}"] = table
    return made


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw mistakes over detection time by detector, and mistakes of NFD-S over the bound by period, with theory."""
    if not set(observations) >= NEEDED:
        return []
    networks = list(observations["network"].unique())
    made = []
    for name, panel in (("mistakes_by_detection_time", _by_detector), ("mistakes_by_period", _by_period)):
        figure = Figure(figsize=(4.3 * len(networks), 4.4), layout="constrained")
        plots = figure.subplots(1, len(networks), sharey=True, squeeze=False)[0]
        for plot, network in zip(plots, networks, strict=True):
            panel(plot, observations[observations["network"] == network], network)
            plot.set(title=network, yscale="log")
            plot.grid(alpha=0.3)
        plots[0].set_ylabel("mistakes an hour")
        plots[-1].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
        made.append(folder / f"{name}.png")
        save(figure, made[-1])
    return made


def _by_detector(plot: Any, rows: pd.DataFrame, network: str) -> None:
    """Draw a line a detector, from its most impatient setting to its most patient; settings without mistakes end it."""
    rows = rows[rows["period_s"] == PERIOD_S]
    for rank, detector in enumerate(DETECTORS):
        part = rows[rows["detector"] == detector]
        by = "bound_s" if detector in BOUNDED else "threshold"
        found = part.groupby(by)[["detection_s", "mistake_rate_per_s"]].mean()
        found = found[found["mistake_rate_per_s"] > 0.0]
        style = {"linestyle": "-" if detector in BOUNDED else "--", "color": f"C{rank}", "label": detector}
        size = 1.0 + 0.4 * (len(DETECTORS) - rank)  # those that come to the same are seen behind each other
        rates = HOUR_S * found["mistake_rate_per_s"]
        plot.plot(found["detection_s"], rates, marker="o", markersize=2.0 + size, linewidth=size, **style)
    plot.set_xlabel("mean detection time, s")


def _by_period(plot: Any, rows: pd.DataFrame, network: str) -> None:
    rows = rows[rows["detector"] == "nfd_s"]
    for rank, period_s in enumerate(sorted(rows["period_s"].unique().tolist())):
        found = estimates(rows[rows["period_s"] == period_s], ["bound_s"], ["mistake_rate_per_s"])
        means = HOUR_S * np.array([each.mean for each in found["mistake_rate_per_s"]])
        halves = HOUR_S * np.nan_to_num([each.half for each in found["mistake_rate_per_s"]])
        seen, colour, label = means > 0.0, f"C{rank}", f"a heartbeat each {period_s:g} s"
        points = found["bound_s"][seen], means[seen], halves[seen]
        plot.errorbar(*points, fmt="o", capsize=3, color=colour, label=label)
        if network in LOSS:
            bounds_s = np.linspace(period_s + MEAN_DELAY_S, 3.2, 400).tolist()
            theory = [nfd_s(bound_s - period_s, period_s, LOSS[network], MEAN_DELAY_S) for bound_s in bounds_s]
            rates = [HOUR_S / each.recurrence_s for each in theory]
            plot.plot(bounds_s, rates, color=colour, linewidth=1, label=f"theory, {period_s:g} s")
    plot.set_xlabel("bound of the detection time, s")
    plot.set_ylim(1e-2, 1e4)
