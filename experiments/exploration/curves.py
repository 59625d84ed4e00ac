"""Coverage over time: what had been seen when, the median of the replicates and the band of their middle half."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.arrays import Floats
from cosim.report.comparison import levels
from cosim.report.drawing import legend_outside
from experiments.exploration.claims import MAPS
from experiments.exploration.exploring import TENTHS

POINTS: Final = {f"seen_{round(100 * share)}_s": share for share in TENTHS} | {"time_95_s": 0.95, "time_99_s": 0.99}
"""Shares of what can be seen, by the columns that hold when they had been."""
BAND: Final = (25, 75)
"""Percentiles of the band."""
INSTANTS: Final = 200


def curve(run: "pd.Series[Any]", at_s: Floats) -> Floats:
    """Return the share of what can be seen that had been at the times *at_s* (n,) of one *run*, a row of the results.

    Between the times that the row holds it is taken to grow evenly; from the run's end on it stays as it was.
    """
    known = [(float(run[name]), share) for name, share in POINTS.items() if not np.isnan(run[name])]
    last = float(run["simulated_s"]), float(run["coverage"])
    times, shares = zip((0.0, 0.0), *known, last, strict=True)
    found: Floats = np.interp(at_s, times, shares)
    return found


def coverage_over_time(
    runs: pd.DataFrame, folder: Path, name: str, robots: Sequence[int], lines: tuple[str, Mapping[Any, str]]
) -> list[Path]:
    """Draw coverage over time, a panel a map and a row of them a team size, a line each of *lines* (axis, names).

    Team sizes that *runs* do not have are left out. Return the path of the picture, if there is anything to draw.
    """
    axis, names = lines
    if runs.empty or not {*POINTS, "coverage", "simulated_s", "map", "robots", axis} <= set(runs):
        return []
    floors, sizes = [each for each in MAPS if each in set(runs["map"])], set(levels(runs, "robots"))
    rows = [size for size in robots if size in sizes]
    if not floors or not rows:
        return []
    figure = Figure(figsize=(4.0 * len(floors) + 2.0, 3.0 * len(rows) + 0.6), layout="constrained")
    plots = figure.subplots(len(rows), len(floors), squeeze=False, sharey=True)
    for row, size in zip(plots, rows, strict=True):
        for plot, floor in zip(row, floors, strict=True):
            part = runs[(runs["map"] == floor) & (runs["robots"] == size)]
            _panel(plot, part, axis, names)
            plot.set_title(f"{MAPS[floor]}, {size} robot{'s' if size > 1 else ''}", fontsize="medium")
        row[0].set_ylabel("share of what can be seen")
    for plot in plots[-1]:
        plot.set_xlabel("time, s")
    legend_outside(figure, plots.flat)
    path = folder / name
    figure.savefig(path, dpi=120)
    return [path]


def _panel(plot: Any, runs: pd.DataFrame, axis: str, names: Mapping[Any, str]) -> None:
    """Draw the lines of one panel, until all runs in it have come to 99 % or have ended."""
    if runs.empty:
        return
    at_s = np.linspace(0.0, float(runs["time_99_s"].fillna(runs["simulated_s"]).max()), INSTANTS)
    for rank, (value, title) in enumerate(names.items()):
        part = runs[runs[axis] == value]
        if part.empty:
            continue
        curves = np.array([curve(run, at_s) for _, run in part.iterrows()])
        low, high = np.percentile(curves, BAND, axis=0)
        plot.plot(at_s, np.median(curves, axis=0), color=f"C{rank}", label=title)
        plot.fill_between(at_s, low, high, color=f"C{rank}", alpha=0.2, linewidth=0)
    plot.set(xlim=(0, at_s[-1]), ylim=(0, 1.02))
    plot.grid(alpha=0.3)
