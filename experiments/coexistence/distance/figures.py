"""What links lose over the distance of the station beside what is expected there, and the claims."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from experiments.coexistence.figures import CLASSIC, LE, NEAR, UNKNOWN, Answer, as_expected

VALUES: Final = ["narrow_loss", "expected_narrow_loss"]
HARMLESS_M: Final = 63.0
"""Distance from which on the station ruins no channel of Bluetooth."""


def _points(runs: pd.DataFrame, links: Sequence[str] = (*CLASSIC, *LE)) -> pd.DataFrame:
    """Return a row of Estimates for each of *links* and each distance, by both; empty if there are none."""
    if runs.empty or not set(runs) >= {"link", "station_m", *VALUES}:
        return pd.DataFrame()
    rows = estimates(runs[runs["link"].isin(links)], ["link", "station_m"], VALUES)
    return rows.set_index(["link", "station_m"]).sort_index() if len(rows) else rows


def over_distance_classic(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points Bluetooth loses what the station's frames let expect."""
    return as_expected(_points(runs, CLASSIC))


def over_distance_le(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return at how many points Low Energy does."""
    return as_expected(_points(runs, LE))


def farther_less(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return by how much more is lost at a greater distance than at a smaller one, at most."""
    points = _points(runs)
    if points.empty:
        return UNKNOWN
    rises = []
    for link in sorted(set(points.index.get_level_values("link"))):
        lost = pd.Series([each.mean for each in points.loc[link]["narrow_loss"]])
        rises.append(float((lost - lost.cummin()).max()))
    return f"{max(rises):.4f} at most", bool(max(rises) <= NEAR)


def safe(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return what Bluetooth loses where the rule says that it loses nothing, at most, and nearer by, at least."""
    points = _points(runs, CLASSIC)
    if points.empty:
        return UNKNOWN
    lost = [(metres, each.mean) for (_, metres), each in zip(points.index, points["narrow_loss"], strict=True)]
    far = [loss for metres, loss in lost if metres > HARMLESS_M]
    near = [loss for metres, loss in lost if metres <= HARMLESS_M]
    if not far or not near:
        return UNKNOWN
    return f"{max(far):.4f} at most, {min(near):.4f} at least", bool(max(far) == 0.0 and min(near) > 0.0)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what links lose over the distance of the station, with what its frames let expect as lines."""
    points = _points(runs)
    if points.empty:
        return []
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    plot: Any = figure.subplots()
    for rank, link in enumerate((*CLASSIC, *LE)):
        if link not in points.index.get_level_values("link"):
            continue
        part = points.loc[link]
        means, halves = zip(*((each.mean, each.half) for each in part["narrow_loss"]), strict=True)
        plot.errorbar(part.index, means, yerr=halves, fmt="o", color=f"C{rank}", capsize=3, label=link)
        expected = [each.mean for each in part["expected_narrow_loss"]]
        plot.plot(part.index, expected, color=f"C{rank}", linewidth=1)
    plot.set(xlabel="m from the slave of a link of 10 m to a station of 802.11", ylabel="share of packets lost")
    plot.set(xscale="log", ylim=(0.0, None))
    ticks = sorted(runs["station_m"].unique())
    plot.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    plot.minorticks_off()
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small")
    path = folder / "coexistence_distance.png"
    save(figure, path)
    return [path]
