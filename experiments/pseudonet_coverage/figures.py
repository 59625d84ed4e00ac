"""What Bluetooth costs against the ideal channel, and the answers to the paper's claims that no number decides."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from cosim.report.comparison import NO_DATA, Answer, by_replicate, confidence_limits, levels, none_fails
from cosim.report.saving import save
from cosim.statistics.digits import digits

SLOT_MS = 0.625
RADIOS: Final = {"bluetooth": "inquiry of v1.2", "bluetooth v1.1": "inquiry of v1.1, as in the paper"}
"""Labels of the Bluetooth channels, and what their set-up is called in the figure."""
PAIRED = ["algorithm", "team_size", "floor", "replicate"]
COSTS = ["time_to_cover_s", "coverage", "steps", "radio_wait_s", "setup_s"]
NEAR_ZERO: Final = 0.1
"""Overlap that counts as near zero: entries of covered cells, a tenth of the cells covered."""
OVERHEAD = ["messages_help", "messages_answer", "messages_trap", "messages_stop"]


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the paired differences to the ideal channel, a row a radio: all channels of a replicate see one world."""
    if not {"channel", *PAIRED} <= set(runs):
        return {}
    present = [column for column in COSTS if column in runs]
    sides = {name: part.set_index(PAIRED)[present] for name, part in runs.groupby("channel")}
    rows = []
    if "ideal" not in sides:
        return {}
    for radio in filter(sides.__contains__, RADIOS):
        differences = (sides[radio] - sides["ideal"]).dropna(how="all").reset_index()
        for key, part in differences.groupby(PAIRED[:-1], sort=False):
            labels = {"channel": radio} | dict(zip(PAIRED, key, strict=False))
            rows.append(labels | {column: _interval(part[column]) for column in present})
    if not rows:
        return {}
    return {
        "what Bluetooth costs: mean of the paired differences to the ideal channel ± half of the 95 %": pd.DataFrame(
            rows
        )
    }


def _interval(values: "pd.Series[float]") -> str:
    known = values.dropna()
    if len(known) < 2:
        return f"{known.mean():+.4g}" if len(known) else "-"
    half = stats.t.ppf(0.975, len(known) - 1) * known.std(ddof=1) / len(known) ** 0.5
    return f"{known.mean():+.4g} ± {digits(half, 2)}"


def overhead(runs: pd.DataFrame, observations: pd.DataFrame) -> tuple[str, bool | None]:
    """Return the mean number of messages other than state that each algorithm sends in a run."""
    if runs.empty or not {"algorithm", *OVERHEAD} <= set(runs):
        return "-", None
    sums = runs.assign(overhead=runs[OVERHEAD].sum(axis=1)).groupby("algorithm", sort=False)["overhead"].mean()
    return ", ".join(f"{algorithm} {digits(value, 4)}" for algorithm, value in sums.items()), None


def exchange_time(runs: pd.DataFrame, observations: pd.DataFrame) -> tuple[str, bool | None]:
    """Return the mean duration of an exchange over Bluetooth by team size, in ms, beside the paper's ideal one."""
    if not {"channel", "team_size", "exchange_s"} <= set(runs):
        return "-", None
    means = 1000 * runs[runs["channel"] == "bluetooth"].groupby("team_size")["exchange_s"].mean()
    ideal = (2 * (means.index.to_numpy() - 1) + 1) * SLOT_MS
    rows = zip(means.index, means, ideal, strict=True)
    told = [f"M={size} {mean:.4g} (ideal {least:g})" for size, mean, least in rows]
    return ", ".join(told) or "-", None


def near_zero(algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether overlap is below ``NEAR_ZERO`` with every team and on every floor, over Bluetooth.

    By one-sided 95 % limits of the mean; a single team and floor that is wholly above refutes it.
    """
    words, holds = [], []
    for floor in levels(runs, "floor"):
        for size in levels(runs, "team_size"):
            arm = {"algorithm": algorithm, "channel": "bluetooth", "floor": floor, "team_size": size}
            found = confidence_limits(by_replicate(runs, arm, "overlap_ratio"))
            if found.size:
                words.append(f"{floor} M={size} {found.text()}")
                known = found.size > 1 and not found.lower <= NEAR_ZERO <= found.upper
                holds.append(found.upper < NEAR_ZERO if known else None)
    return ("; ".join(words), none_fails(holds)) if words else NO_DATA


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what the radio costs: setting the piconet up, and standing still for messages in each step."""
    if runs.empty or not {"channel", "team_size", "algorithm", "setup_s", "radio_wait_s", "steps"} <= set(runs):
        return []
    rows = runs[runs["channel"] == "bluetooth"]
    if rows.empty:
        return []
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    setups = runs.drop_duplicates(["channel", "team_size", "replicate"])  # one piconet each, whatever runs on it
    for radio in filter(set(setups["channel"]).__contains__, RADIOS):
        _points(left, RADIOS[radio], setups[setups["channel"] == radio].groupby("team_size")["setup_s"])
    left.set(title="setting up: inquiry, then a page for each slave", xlabel="robots", ylabel="s")
    waits = rows.assign(wait_ms=1000 * rows["radio_wait_s"] / rows["steps"])
    for algorithm, part in waits.groupby("algorithm", sort=False):
        _points(right, str(algorithm), part.groupby("team_size")["wait_ms"])
    sizes = np.arange(rows["team_size"].min(), rows["team_size"].max() + 1)
    right.plot(sizes, 2 * (4 * sizes - 2) * SLOT_MS, "k--", label="two exchanges of 4M - 2 slots on the air")
    right.set(title="standing still for messages, each step", xlabel="robots", ylabel="ms")
    for plot in (left, right):
        plot.set_xticks(sorted(rows["team_size"].unique()))
        plot.set_ylim(bottom=0)
        plot.grid(alpha=0.3)
    left.legend(fontsize="small")
    right.legend(fontsize="small")
    path = folder / "what_bluetooth_costs.png"
    save(figure, path)
    return [path]


def _points(plot: Any, label: str, groups: Any) -> None:
    means, counts = groups.mean(), groups.count()
    halves = stats.t.ppf(0.975, counts.clip(lower=2) - 1) * groups.std(ddof=1).fillna(0) / counts**0.5
    plot.errorbar(means.index, means, yerr=halves, marker="o", capsize=3, label=label)


# ---------------------------------------------------------------- the tests that published.csv names

ALGORITHMS: Final = ("oscard", "boustrophedon", "spanning_tree", "random_walk")
globals().update({f"near_zero_{algorithm}": partial(near_zero, algorithm) for algorithm in ALGORITHMS})
