"""The claims of paper 000, section 4.4, on bandwidth: O(M) a robot, at most M terms and M pairs, and O(M^2) in all."""

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import NO_DATA, Answer
from cosim.report.estimates import estimates
from cosim.report.saving import save
from protocols.reflection.frames import Frame, encode

HALL: Final = "all explore a hall"
ROOMS: Final = "all explore rooms"
HELPED: Final = "one explores rooms"
ORDERS: Final = {"bytes_a_frame": 1, "bytes_a_period": 2}
"""Powers of the team's size that the paper gives, by metric."""


def most(robots: int) -> int:
    """Return the bytes of a frame with as much as the paper allows: M terms, M pairs, and a bearing of each other."""
    bearing, term, pledge = (0, 0.0), (0, 1, 0.0, 0.0), (0, 1, 0.0, 0)
    return len(encode(Frame(False, False, 0, [bearing] * (robots - 1), [term] * robots, [pledge] * robots)))


def _bounded(runs: pd.DataFrame, metric: str) -> Answer:
    """Answer whether *metric* is within its bound in every run in which all have targets, and how it grows."""
    if runs.empty or not {"task", "robots", metric} <= set(runs):
        return NO_DATA
    rows = runs[runs["task"].isin((HALL, ROOMS)) & (runs[metric] > 0)]
    if rows.empty:
        return NO_DATA
    bounds = rows["robots"].map(lambda size: most(size) * size ** (ORDERS[metric] - 1))
    words = f"at most {100 * float((rows[metric] / bounds).max()):.3g} % of M terms and M pairs"
    means = rows[rows["task"] == HALL].groupby("robots")[metric].mean()
    if len(means) > 1:
        (less, fewer), (more, many) = zip(means.iloc[-2:], means.index[-2:], strict=True)
        power = np.log(more / less) / np.log(many / fewer)
        words += f"; in the hall from {fewer} to {many} robots M to the power of {power:.3g}"
    return words, bool((rows[metric] <= bounds).all())


def meeting(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether what a robot sends at a meeting, in the mean of a run, is within M terms and M pairs."""
    return _bounded(runs, "bytes_a_frame")


def together(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether what all robots send in a period is within M times as much."""
    return _bounded(runs, "bytes_a_period")


def beyond(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what one explorer comes to in an hour, by the size of its team."""
    if not {"task", "robots", "targets_an_hour"} <= set(runs):
        return NO_DATA
    means = runs[runs["task"] == HELPED].groupby("robots")["targets_an_hour"].mean()
    return ", ".join(f"{size} robots {value:.3g}" for size, value in means.items()) or "-", None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw bytes of a frame and of the team against the team's size, with the most that the paper allows."""
    if runs.empty or not {"task", "robots", *ORDERS} <= set(runs):
        return []
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    for plot, (metric, order) in zip(figure.subplots(1, 2), ORDERS.items(), strict=True):
        for task in (HALL, ROOMS):
            rows = runs[(runs["task"] == task) & (runs[metric] > 0)]
            if rows.empty:
                continue
            points = estimates(rows, ["robots"], [metric])
            sizes = points["robots"].to_numpy(dtype=float)
            means = np.array([value.mean for value in points[metric]])
            halves = np.nan_to_num([value.half for value in points[metric]])
            plot.errorbar(sizes, means, yerr=np.minimum(halves, 0.9 * means), marker="o", capsize=3, label=task)
        sizes = np.sort(runs["robots"].unique())
        bounds = [most(int(size)) * size ** (order - 1) for size in sizes]
        plot.plot(sizes, bounds, "k--", label=f"paper: M terms and M pairs{' of M robots' if order > 1 else ''}")
        plot.set(xlabel="robots, all with targets", ylabel=f"{metric.replace('_', ' ')}, B", xscale="log", yscale="log")
        plot.set_xticks(sizes, [f"{size:g}" for size in sizes])
        plot.minorticks_off()
        plot.grid(alpha=0.3)
        plot.legend(fontsize="small")
    path = folder / "bytes_by_team.png"
    save(figure, path)
    return [path]
