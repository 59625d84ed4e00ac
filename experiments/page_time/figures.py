"""Distribution functions of page times, and the claims that no single number decides."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save

Answer = tuple[str, bool | None]

NEEDED = {"mode", "estimate", "page_time_s", "page_time_from_command_s"}
PUBLISHED_S = {
    ("R0", "exact"): 0.0052,
    ("R0", "random"): 0.0102,
    ("R1", "exact"): 0.641,
    ("R1", "random"): 1.280,
    ("R2", "exact"): 1.277,
    ("R2", "random"): 2.560,
}


def unanswered(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share of pages without an answer, by mode and estimate."""
    if observations.empty or not set(observations) >= NEEDED:
        return "-", None
    rows = observations.assign(unanswered=observations["page_time_s"].isna().astype(float))
    found = estimates(rows, ["mode", "estimate"], ["unanswered"])
    shares = zip(found["mode"], found["estimate"], found["unanswered"], strict=True)
    return ", ".join(f"{mode} {estimate} {share}" for mode, estimate, share in shares if share.mean) or "none", None


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the distribution functions, a panel a mode, with the published means."""
    if observations.empty or not set(observations) >= NEEDED:
        return []
    parts = list(observations.groupby("mode", sort=False))
    figure = Figure(figsize=(4.6 * len(parts), 4.0), layout="constrained")
    for plot, (mode, rows) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
        _distributions(plot, rows, str(mode))
    path = folder / "page_time_distribution.png"
    save(figure, path)
    return [path]


def _distributions(plot: Any, rows: pd.DataFrame, mode: str) -> None:
    scale, unit = (1000, "ms") if rows["page_time_s"].median() < 0.1 else (1, "s")
    for rank, (estimate, part) in enumerate(rows.groupby("estimate")):
        found = np.sort(part["page_time_s"].dropna().to_numpy()) * scale
        plot.step(
            found,
            np.arange(1, len(found) + 1) / len(part),
            where="post",
            color=f"C{rank}",
            label=f"{estimate} estimate",
        )
        plot.axvline(found.mean(), color=f"C{rank}", linewidth=1)
        if (mode, str(estimate)) in PUBLISHED_S:
            plot.axvline(PUBLISHED_S[mode, str(estimate)] * scale, color="k", linestyle=":")
    plot.plot([], [], "k-", linewidth=1, label="our means")
    plot.plot([], [], "k:", label="published means")
    plot.set(title=mode, xlabel=f"page time, {unit}", ylim=(0, 1.02))
    plot.set_ylabel("share of pages answered")
    plot.grid(alpha=0.3)
    plot.legend(fontsize="small", loc="lower right")
