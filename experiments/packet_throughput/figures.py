"""Rates beside the closed form and beside the reference's table."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.channels.bluetooth.bits.errors import throughput_kbps
from cosim.channels.bluetooth.packets import ACL
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate

Answer = tuple[str, bool | None]

NEEDED: Final = {"packet", "es_n0_db", "throughput_kbps", "closed_form_kbps", "difference_kbps"}
ES_N0_DB: Final = (8, 10, 11, 12, 13, 14, 15, 16, 18)
TABLE_KBPS: Final = {
    "DM1": (8.3, 83.4, 103.0, 108.0, 108.7, 108.8, 108.8, 108.8, 108.8),
    "DH1": (0.0, 7.7, 44.2, 105.0, 149.5, 167.5, 172.0, 172.7, 172.8),
    "DM3": (0.0, 80.8, 280.4, 370.2, 385.7, 387.1, 387.2, 387.2, 387.2),
    "DH3": (0.0, 0.0, 0.1, 26.3, 237.6, 481.5, 568.6, 584.0, 585.6),
    "DM5": (0.0, 27.5, 265.5, 440.4, 474.5, 477.7, 477.9, 477.9, 477.9),
    "DH5": (0.0, 0.0, 0.0, 2.4, 138.2, 505.0, 685.3, 719.5, 723.2),
}
"""The reference's table, to 0.1 kb/s, at ``ES_N0_DB``."""
BEST: Final[dict[float, str]] = {
    es_n0_db: max(TABLE_KBPS, key=lambda packet: TABLE_KBPS[packet][column]) for column, es_n0_db in enumerate(ES_N0_DB)
}
"""The type with the highest rate of the table at each Es/N0."""


def tolerance_kbps(expected_kbps: float) -> float:
    """Return how far a rate may be from the expected one: 1 % of it or 0.1 kb/s."""
    return max(0.01 * expected_kbps, 0.1)


def _means(runs: pd.DataFrame, packet: str | None = None) -> pd.DataFrame:
    """Return a row for each packet type (or one) and Es/N0, with Estimates; empty if columns or rows are missing."""
    if runs.empty or not set(runs) >= NEEDED:
        return pd.DataFrame()
    rows = runs if packet is None else runs[runs["packet"] == packet]
    found = estimates(rows, ["packet", "es_n0_db"], ["throughput_kbps", "closed_form_kbps", "difference_kbps"])
    return found if len(rows) else pd.DataFrame()


def within_closed_form(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the point that is farthest from the closed form, in parts of what is allowed."""
    found = _means(runs)
    if found.empty:
        return "-", None
    shares = [
        abs(difference.mean) / tolerance_kbps(expected.mean)
        for difference, expected in zip(found["difference_kbps"], found["closed_form_kbps"], strict=True)
    ]
    worst = int(np.argmax(shares))
    row = found.iloc[worst]
    told = (
        f"the worst of {len(found)} points, {row['packet']} at {row['es_n0_db']:g} dB, is {row['throughput_kbps']} "
        f"({row['closed_form_kbps'].mean:.4g}), {shares[worst]:.2f} of what is allowed"
    )
    return told, bool(max(shares) <= 1)


def _table(packet: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return our rates of one type, beside the table's; it holds if all are within 1 % or 0.1 kb/s."""
    known = dict(zip(ES_N0_DB, TABLE_KBPS[packet], strict=True))
    found = [(row["es_n0_db"], row["throughput_kbps"]) for _, row in _means(runs, packet).iterrows()]
    found = [(es_n0_db, ours) for es_n0_db, ours in found if es_n0_db in known]
    told = ", ".join(f"{es_n0_db:g} dB {ours} ({known[es_n0_db]})" for es_n0_db, ours in found)
    if not found:
        return "-", None
    return told, all(abs(ours.mean - known[es_n0_db]) <= tolerance_kbps(known[es_n0_db]) for es_n0_db, ours in found)


dm1, dh1, dm3, dh3, dm5, dh5 = (partial(_table, packet) for packet in TABLE_KBPS)
"""Hold a type against the table."""


def best_types(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the type with the highest rate at each Es/N0 at which all types were run."""
    found = _means(runs)
    if found.empty:
        return "-", None
    rates = found.assign(rate=[ours.mean for ours in found["throughput_kbps"]])
    best = {
        float(part["es_n0_db"].iloc[0]): str(part["packet"].iloc[int(np.argmax(part["rate"]))])
        for _, part in rates.groupby("es_n0_db")
        if len(part) == len(ACL)
    }
    told = ", ".join(f"{es_n0_db:g} dB {packet}" for es_n0_db, packet in best.items())
    known = [es_n0_db for es_n0_db in best if es_n0_db in BEST]
    return told or "-", all(best[es_n0_db] == BEST[es_n0_db] for es_n0_db in known) if known else None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the rates beside the closed form, and how far they are from it."""
    found = _means(runs)
    if found.empty:
        return []
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    rates, differences = figure.subplots(1, 2)
    grid = np.linspace(found["es_n0_db"].min(), found["es_n0_db"].max(), 300)
    for rank, (packet, part) in enumerate(found.groupby("packet", sort=False)):
        style = {"fmt": "o", "color": f"C{rank}", "capsize": 3, "label": str(packet)}
        rates.plot(grid, throughput_kbps(ACL[str(packet)], grid), color=f"C{rank}", linewidth=1)
        _points(rates, part["es_n0_db"], part["throughput_kbps"], [1.0] * len(part), style)
        allowed = [tolerance_kbps(expected.mean) for expected in part["closed_form_kbps"]]
        _points(differences, part["es_n0_db"] + 0.08 * (rank - 2.5), part["difference_kbps"], allowed, style)
    rates.set(title="one way, beside the closed form", xlabel="Es/N0, dB", ylabel="kb/s")
    differences.set(title="distance from the closed form", xlabel="Es/N0, dB", ylabel="parts of 1 % or 0.1 kb/s")
    differences.axhspan(-1, 1, color="k", alpha=0.07)
    for plot in (rates, differences):
        plot.grid(alpha=0.3)
    rates.legend(fontsize="small")
    path = folder / "throughput.png"
    save(figure, path)
    return [path]


def _points(plot: Any, x: Any, found: "pd.Series[Any]", scales: list[float], style: dict[str, Any]) -> None:
    values: list[Estimate] = list(found)
    means = [value.mean / scale for value, scale in zip(values, scales, strict=True)]
    halves = [0.0 if np.isnan(v.half) else v.half / scale for v, scale in zip(values, scales, strict=True)]
    plot.errorbar(x, means, yerr=halves, **style)
