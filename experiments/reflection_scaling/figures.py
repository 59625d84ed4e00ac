"""The claims of paper 000, section 4.4, on bandwidth, as one-sided tests of exponents."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report import estimates
from experiments.reflection_tables.comparison import NO_DATA, Answer, Limits, limits


def exponent(runs: pd.DataFrame, metric: str) -> Limits:
    """Return by which power of the team's size *metric* grows if everybody has targets: a line a replicate, log-log."""
    if runs.empty or not {"everybody", "robots", "replicate", metric} <= set(runs):
        return limits(pd.Series(dtype=float))
    rows = runs[runs["everybody"] & (runs[metric] > 0)]
    slopes = {
        replicate: float(np.polyfit(np.log(part["robots"]), np.log(part[metric]), 1)[0])
        for replicate, part in rows.groupby("replicate")
        if part["robots"].nunique() > 2
    }
    return limits(pd.Series(slopes, dtype=float))


def _at_most(found: Limits, most: float) -> Answer:
    if not found.size:
        return NO_DATA
    words = f"M to the power of {found.mean:.3g}"
    if found.size < 2:
        return words, None
    return f"{words} (at most {found.upper:.3g})", found.upper <= most


def meeting(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether what a robot tells at a meeting grows no faster than the team."""
    return _at_most(exponent(runs, "bytes_a_frame"), 1.0)


def together(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether what all robots tell in a period grows no faster than the square of the team."""
    return _at_most(exponent(runs, "bytes_a_period"), 2.0)


def beyond(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what one explorer comes to in an hour, by the size of its team."""
    if not {"everybody", "robots", "targets_an_hour"} <= set(runs):
        return NO_DATA
    means = runs[~runs["everybody"]].groupby("robots")["targets_an_hour"].mean()
    return ", ".join(f"{size} robots {value:.3g}" for size, value in means.items()) or "-", None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw bytes of a frame and of the team against the team's size, with the orders that the paper gives."""
    if runs.empty or not {"everybody", "robots", "bytes_a_frame", "bytes_a_period"} <= set(runs):
        return []
    rows = runs[runs["everybody"]]
    if rows.empty:
        return []
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    plots = figure.subplots(1, 2)
    for plot, metric, order in zip(plots, ("bytes_a_frame", "bytes_a_period"), (1, 2), strict=True):
        points = estimates(rows, ["robots"], [metric])
        sizes = points["robots"].to_numpy(dtype=float)
        means = np.array([value.mean for value in points[metric]])
        halves = np.nan_to_num([value.half for value in points[metric]])
        plot.errorbar(sizes, means, yerr=halves, marker="o", capsize=3, label="ours")
        plot.plot(sizes, means[0] * (sizes / sizes[0]) ** order, "k--", label=f"order M^{order}")
        plot.set(xlabel="robots, all with targets", ylabel=f"{metric.replace('_', ' ')}, B", xscale="log", yscale="log")
        plot.set_xticks(sizes, [f"{size:g}" for size in sizes])
        plot.minorticks_off()
        plot.grid(alpha=0.3)
        plot.legend(fontsize="small")
    path = folder / "bytes_by_team.png"
    figure.savefig(path, dpi=120)
    return [path]
