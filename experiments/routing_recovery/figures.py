"""The claims on routes that are mended, and outages, losses and control traffic by router."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import NO_DATA, Answer, Arm, by_replicate, confidence_limits
from cosim.report.saving import save

SHAPES: Final = ("diamond", "ladder", "ring")
GOLDEN: Final = 0.618
INTERVAL_S: Final = 0.1
"""Interval from payload to payload."""
TC_S: Final = 5.5
"""A TC interval, and the jitter of the router that repeats the TC on its way to the source of the ring."""
ROWS: Final = {
    "outage_s": "outage, s",
    "steady_s": "steady after, s",
    "lost": "payloads lost",
    "control_octets_per_s": "control, octets/s",
}


def learnt(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether in every run the source of the ring learns within ``TC_S`` s of a death that OLSR has noticed."""
    arm: Arm = {"router": "olsr", "shape": "ring"}
    took = by_replicate(runs, arm, "recovery_s").sub(by_replicate(runs, arm, "noticed_s")).dropna()
    if took.empty:
        return NO_DATA
    return f"{took.mean():.3g}, at most {took.max():.3g}", bool(took.max() <= TC_S)


def _bounded(router: str, most_s: float, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether payloads came steadily after *most_s* s in every run."""
    if runs.empty or not {"router", "steady_s"} <= set(runs):
        return NO_DATA
    steady = runs.loc[runs["router"] == router, "steady_s"]
    if steady.empty:
        return NO_DATA
    if steady.isna().any():
        return f"never in {steady.isna().sum()} of {len(steady)} runs", False
    return f"{steady.mean():.3g}, at most {steady.max():.3g}", bool(steady.max() <= most_s)


def _shorter(one: str, other: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether outages are shorter with *one* than with *other* in every shape, by one-sided 95 % tests."""
    words, holds = [], True
    for shape in SHAPES:
        mine, others = (by_replicate(runs, {"router": name, "shape": shape}, "outage_s") for name in (one, other))
        found = confidence_limits((others - mine).dropna())
        if not found.size:
            return NO_DATA
        words.append(f"{shape} {mine.mean():.3g} against {others.mean():.3g} (shorter by {found.lower:.2g} at least)")
        if found.size < 2:
            return "; ".join(words), None
        holds = holds and found.lower > 0
    return "; ".join(words), holds


def milliseconds(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether AODV with the MAC's feedback adds less than 10 ms to the interval, by a one-sided 95 % test."""
    words, holds = [], True
    for shape in SHAPES:
        found = confidence_limits(by_replicate(runs, {"router": "aodv_mac", "shape": shape}, "outage_s") - INTERVAL_S)
        if not found.size:
            return NO_DATA
        words.append(f"{shape} {found.mean:.3g} (at most {found.upper:.3g})")
        if found.size < 2:
            return "; ".join(words), None
        holds = holds and found.upper < 0.01
    return "; ".join(words), holds


bounded_olsr = partial(_bounded, "olsr", 14.0)
bounded_olsr_fast_mac = partial(_bounded, "olsr_fast_mac", 4.25)
tuned_olsr = partial(_shorter, "olsr_fast", "olsr")
aodv_faster = partial(_shorter, "aodv", "olsr")


# ---------------------------------------------------------------- the figure


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw a column for each shape, a row for each of ``ROWS``; a dot is a run, a bar the mean of a router's."""
    if runs.empty or not {"router", "shape", *ROWS} <= set(runs):
        return []
    shapes = [shape for shape in SHAPES if (runs["shape"] == shape).any()]
    routers = list(dict.fromkeys(runs["router"]))
    size = 3.6 * len(shapes) + 1.0, 1.9 * len(ROWS) + 1.2
    figure = Figure(figsize=size, layout="constrained")
    plots = figure.subplots(len(ROWS), len(shapes), squeeze=False, sharex=True, sharey="row")
    for column, shape in zip(plots.T, shapes, strict=True):
        column[0].set_title(shape)
        for plot, metric in zip(column, ROWS, strict=True):
            _panel(plot, runs[runs["shape"] == shape], routers, metric)
        column[-1].set_xticks(range(len(routers)), routers, rotation=90)
    for plot, label in zip(plots[:, 0], ROWS.values(), strict=True):
        plot.set_ylabel(label)
    path = folder / "recovery.png"
    save(figure, path)
    return [path]


def _panel(plot: Any, runs: pd.DataFrame, routers: list[str], metric: str) -> None:
    for place, router in enumerate(routers):
        values = runs.loc[runs["router"] == router, metric].dropna()
        if values.empty:
            continue
        across = place + 0.3 * (np.arange(len(values)) * GOLDEN % 1.0 - 0.5)  # says nothing: dots lie apart
        plot.plot(across, values, ".", color="C0", markersize=3, alpha=0.6)
        plot.hlines(values.mean(), place - 0.35, place + 0.35, color="k", linewidth=1.2)
    if metric == "control_octets_per_s":
        plot.set_yscale("symlog", linthresh=10)
    elif metric == "outage_s":
        plot.set_yscale("log")
    plot.grid(alpha=0.3)
