"""Empirical distributions of discovery times, and the claims that no single number decides."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate

Answer = tuple[str, bool | None]

NEEDED = {"procedure", "version", "interlaced", "scan_interval_s", "drift_ppm", "discovery_time_s"}
PUBLISHED = {"v1.1": 5.12, "v1.2": 3.84, "v1.2 interlaced": 1.28}
"""Peterson et al.: seconds until 99 % are found, with a scan every 1.28 s."""
LOCK_S = 50.0


def _missing(
    observations: pd.DataFrame, where: str, within_s: float, by: str | None = None
) -> list[tuple[Any, Estimate]]:
    """Return the share of devices not found *within_s*, of the rows *where*, by the column *by*; empty without rows."""
    if not set(observations) >= NEEDED:
        return []
    rows = observations.query(where)
    if rows.empty:
        return []
    found = estimates(
        rows.assign(late=(~(rows["discovery_time_s"] <= within_s)).astype(float)), [by] if by else [], ["late"]
    )
    return list(zip(found[by] if by else [""], found["late"], strict=True))


def _late(observations: pd.DataFrame, where: str, within_s: float, model: float) -> Answer:
    """Answer with our share of late devices beside that of a *model* that came without an interval."""
    found = _missing(observations, f"{where} and scan_interval_s == 1.28 and drift_ppm == 0", within_s)
    return (f"{found[0][1]} (ours / theirs {found[0][1].mean / model:.2f})", None) if found else ("-", None)


def late_v11(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share not found within 5.12 s by v1.1."""
    return _late(observations, "version == '1.1'", 5.12, 0.011)


def late_v12(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share not found within 3.84 s by v1.2."""
    return _late(observations, "version == '1.2' and not interlaced", 3.84, 0.0004)


def late_interlaced(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share not found within 1.28 s by v1.2 with interlaced scan."""
    return _late(observations, "interlaced", 1.28, 0.001)


def phase_locked(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share not found in 50 s without drift; it holds if that rounds to 1 %."""
    found = _missing(observations, "version == '1.1' and scan_interval_s == 2.56 and drift_ppm == 0", LOCK_S)
    return (str(found[0][1]), bool(0.005 <= found[0][1].mean < 0.015)) if found else ("-", None)


def not_found_by_drift(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share not found in 50 s by drift."""
    found = _missing(observations, "version == '1.1' and scan_interval_s == 2.56", LOCK_S, "drift_ppm")
    return ", ".join(f"{ppm} ppm {share}" for ppm, share in found) or "-", None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the distribution functions, a panel a scan interval, and how the locked pairs of v1.1 come free."""
    if observations.empty or not set(observations) >= NEEDED:
        return []
    intervals = sorted(observations["scan_interval_s"].unique())
    figure = Figure(figsize=(4.6 * (len(intervals) + 1), 4.0), layout="constrained")
    *plots, tail = figure.subplots(1, len(intervals) + 1)
    for plot, interval in zip(plots, intervals, strict=True):
        _distributions(plot, observations[observations["scan_interval_s"] == interval], interval)
    _tail(tail, observations)
    path = folder / "discovery_time_distribution.png"
    save(figure, path)
    return [path]


def _distributions(plot: Any, rows: pd.DataFrame, interval_s: float) -> None:
    drift = rows["drift_ppm"].min()
    for rank, (procedure, part) in enumerate(rows[rows["drift_ppm"] == drift].groupby("procedure", sort=False)):
        _step(plot, part["discovery_time_s"], color=f"C{rank}", label=str(procedure))
        if interval_s == 1.28 and procedure in PUBLISHED:
            plot.plot(PUBLISHED[procedure], 0.99, "v", color=f"C{rank}", markersize=8, markeredgecolor="k")
    if interval_s == 1.28:
        plot.plot([], [], "kv", label="99 %, Peterson et al.")
    plot.set(
        title=f"a scan every {interval_s:g} s, {_drift(drift)}",
        xlabel="discovery time, s",
        xlim=(0, 10),
        ylim=(0, 1.02),
    )
    plot.set_ylabel("share of devices found")
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small", loc="lower right")


def _drift(ppm: int) -> str:
    return f"clocks drift up to {ppm} ppm" if ppm else "no drift"


def _step(plot: Any, times_s: "pd.Series[float]", late: bool = False, **style: Any) -> None:
    """Draw the empirical distribution function of *times_s*, or one minus it; devices not found count as late."""
    found = np.sort(times_s.dropna().to_numpy())
    shares = np.arange(1, len(found) + 1) / len(times_s)
    plot.step(found, 1 - shares if late else shares, where="post", **style)


def _tail(plot: Any, observations: pd.DataFrame) -> None:
    longest = observations["scan_interval_s"].max()
    rows = observations[(observations["version"] == "1.1") & (observations["scan_interval_s"] == longest)]
    for rank, (drift, part) in enumerate(rows.groupby("drift_ppm")):
        _step(plot, part["discovery_time_s"], late=True, color=f"C{rank + 3}", label=_drift(drift))
    plot.set(title=f"v1.1, a scan every {longest:g} s: phase lock", xlabel="discovery time, s", yscale="log")
    plot.set_ylabel("share of devices not found yet")
    plot.grid(alpha=0.3)
    if len(rows):
        plot.legend(fontsize="small")
