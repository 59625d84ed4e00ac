"""Rates beside the closed form, and the claims that no single number decides."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate
from experiments.ble_throughput.throughput import OVERHEAD_OCTETS, Parameters, expected_kbps

Answer = tuple[str, bool | None]

AXES: Final = ["phy", "octets", "interval_s", "margin_db"]
VALUES: Final = ["throughput_kbps", "closed_form_kbps", "difference_kbps"]
CLEAR_DB: Final = 50
"""Margin at which nothing is lost."""


def _points(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each arm with Estimates; empty if columns are missing."""
    if runs.empty or not set(runs) >= {*AXES, *VALUES}:
        return pd.DataFrame()
    return estimates(runs, AXES, VALUES)


def whole_exchanges(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return how many runs without losses, of those in which an exchange fits, carry exactly whole exchanges."""
    if not set(runs) >= {*AXES, *VALUES}:
        return "-", None
    rows = runs[(runs["margin_db"] == CLEAR_DB) & (runs["closed_form_kbps"] > 0)]
    equal = int((rows["difference_kbps"].abs() < 1e-9 * rows["closed_form_kbps"].clip(lower=1.0)).sum())
    return f"{equal} of {len(rows)} runs equal", bool(equal == len(rows)) if len(rows) else None


def with_losses(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return in how many points with losses the closed form lies in the interval of the mean, or a packet from it."""
    points = _points(runs)
    if points.empty:
        return "-", None
    carries = np.array([value.mean > 0 for value in points["closed_form_kbps"]])
    lossy = points[carries & (points["margin_db"] < CLEAR_DB).to_numpy()]
    if lossy.empty or any(np.isnan(value.half) for value in lossy["difference_kbps"]):
        return "-", None
    packets = [
        _packet_kbps(octets, interval) for octets, interval in zip(lossy["octets"], lossy["interval_s"], strict=True)
    ]
    differences = zip(lossy["difference_kbps"], packets, strict=True)
    inside = [abs(value.mean) <= value.half + packet for value, packet in differences]
    return f"{sum(inside)} of {len(inside)} points", bool(sum(inside) >= 0.9 * len(inside))


def _packet_kbps(octets: int, interval_s: float) -> float:
    """Return the rate in kb/s that one packet more is in the time that is counted: less cannot be seen."""
    duration_s = max(Parameters().duration_s, interval_s)
    return 8 * (octets - OVERHEAD_OCTETS) / duration_s / 1000


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the rates over the margin, a panel an interval, with the closed form as lines."""
    points = _points(runs)
    if points.empty:
        return []
    intervals = sorted(points["interval_s"].unique())
    figure = Figure(figsize=(4.6 * len(intervals), 4.2), layout="constrained")
    for plot, interval in zip(np.atleast_1d(figure.subplots(1, len(intervals))), intervals, strict=True):
        _panel(plot, points[points["interval_s"] == interval], float(interval))
    path = folder / "throughput.png"
    save(figure, path)
    return [path]


def _panel(plot: Any, points: pd.DataFrame, interval_s: float) -> None:
    grid = np.linspace(0.0, 10.0, 101)
    for rank, ((phy, octets), part) in enumerate(points.groupby(["phy", "octets"], sort=True)):
        arm = Parameters.model_validate({"phy": phy, "octets": octets, "interval_s": interval_s})
        line = [expected_kbps(arm.model_copy(update={"margin_db": margin})) for margin in grid]
        if max(line) > 0:  # else packets are cut shorter than these
            plot.plot(grid, line, color=f"C{rank}", linewidth=1)
        near = part[part["margin_db"] <= grid[-1]]
        values: list[Estimate] = list(near["throughput_kbps"])
        halves = [0.0 if np.isnan(value.half) else value.half for value in values]
        means = [value.mean for value in values]
        label = f"{phy}, {octets} octets"
        plot.errorbar(near["margin_db"], means, yerr=halves, fmt="o", color=f"C{rank}", capsize=3, label=label)
    plot.set(title=f"an event every {1000 * interval_s:g} ms", xlabel="dB above the sensitivity of the PHY")
    plot.set_ylabel("acknowledged user data, kb/s")
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small", loc="center right")
