"""Saturation throughput over the number of stations, beside Bianchi's model and the values of ns-3."""

import csv
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save

NEEDED: Final = {"network", "access", "stations", "throughput_mbps", "bianchi_mbps"}
COLUMNS: Final = 4


def published(network: str, access: str) -> list[tuple[int, float]]:
    """Return the printed values of a network as (stations, Mb/s)."""
    with (Path(__file__).parent / "published.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if f"'{network}' and access == '{access}'" in row["where"]]
    return [(int(row["where"].rpartition(" ")[2]), float(row["published"])) for row in rows]


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw a panel for each network: ours with intervals, basic and RTS/CTS, and the printed values as crosses."""
    if runs.empty or not set(runs) >= NEEDED:
        return []
    networks = list(runs["network"].unique())
    rows = -(-len(networks) // COLUMNS)
    figure = Figure(figsize=(3.6 * COLUMNS, 3.1 * rows), layout="constrained")
    plots = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for plot, network in zip(plots, networks, strict=False):
        for colour, access in (("C0", "basic"), ("C1", "rts")):
            _panel(plot, runs[(runs["network"] == network) & (runs["access"] == access)], access, colour)
            printed = published(network, access)
            if printed:
                plot.plot(*zip(*printed, strict=True), "x", color="k", markersize=5, label="printed")
        plot.set(title=network, xlabel="stations", ylabel="Mb/s")
        plot.set_ylim(bottom=0)
        plot.grid(alpha=0.3)
        names = dict(zip(*reversed(plot.get_legend_handles_labels()), strict=True))
        plot.legend(names.values(), names.keys(), fontsize="x-small", loc="lower left")
    for plot in plots[len(networks) :]:
        plot.remove()
    path = folder / "throughput_by_stations.png"
    save(figure, path)
    return [path]


def _panel(plot: Any, runs: pd.DataFrame, access: str, colour: str) -> None:
    if runs.empty:
        return
    found = estimates(runs, ["stations"], ["throughput_mbps"])
    means = [each.mean for each in found["throughput_mbps"]]
    halves = np.nan_to_num([each.half for each in found["throughput_mbps"]])
    plot.errorbar(found["stations"], means, yerr=halves, fmt="o", markersize=3, capsize=2, color=colour, label=access)
    model = runs.groupby("stations")["bianchi_mbps"].first().dropna()
    plot.plot(model.index, model, color=colour, linewidth=1, label=f"{access}, Bianchi")
