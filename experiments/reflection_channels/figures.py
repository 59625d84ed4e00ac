"""What the time that messages take costs: steps, delay of the first useful reflection, and advice that comes too late.

``minimal_first_visbug_2_kbit`` in published.csv is ``minimal`` for the floor ``first``, the algorithm ``visbug`` and
the link ``2 kbit/s, 1 s``; the tests by such names are made at the end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import NO_DATA, Answer, Arm, confidence_limits, saves, saving, saving_text
from cosim.report.drawing import limit_ordinate
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.reflection.tables import ALGORITHMS, FLOORS, NAMES, SIZES, STEPS, cells

AT_ONCE: Final = "at once, 0.1 s"
NONE: Final = "no messages"
LINKS: Final = {
    "2_kbit": "2 kbit/s, 1 s",
    "450_bit": "450 bit/s, 1 s",
    "bluetooth": "Bluetooth, 1 s",
    "bluetooth_walls": "Bluetooth, walls, 1 s",
    "adhoc": "802.11, 1 s",
    "adhoc_each_tick": "802.11, 0.1 s",
}
"""Links, by the ends of the tests' names."""
SLIGHT: Final = 0.1
"""Share of the steps below which a link costs next to nothing."""
AXES: Final = ("floor", "algorithm", "link")
METRICS: Final = {
    "steps": "motion steps a target",
    "first_useful_reflection_s": "first useful reflection after, s",
    "stale_percent": "advice that is stale on arrival, %",
}


def _arm(floor: str, algorithm: str, link: str) -> Arm:
    return dict(zip(AXES, (floor, algorithm, link), strict=True))


def minimal(floor: str, algorithm: str, link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a link, at a frame a second, costs next to nothing against messages at once at every tick."""
    found = confidence_limits(saving(runs, _arm(floor, algorithm, link), _arm(floor, algorithm, AT_ONCE), STEPS))
    if not found.size:
        return NO_DATA
    return saving_text(found), None if found.size < 2 else found.lower > -SLIGHT


def helps(floor: str, algorithm: str, link: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether what comes over a link saves steps against the same robots without messages."""
    return saves(runs, [("", _arm(floor, algorithm, link), _arm(floor, algorithm, NONE))], STEPS)


def delay(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the delay of the first useful reflection by link."""
    return _by_link(runs, "first_useful_reflection_s")


def stale(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return the share of advice that was stale on arrival by link."""
    return _by_link(runs, "stale_advice")


def unseen(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return by link the share of all promises that came from robots out of sight, which are of no use."""
    return _by_link(_with_unseen(runs), "unseen")


def _with_unseen(runs: pd.DataFrame) -> pd.DataFrame:
    if not {"advice", "advice_unseen"} <= set(runs):
        return runs
    promises = runs["advice"] + runs["advice_unseen"]
    return runs.assign(unseen=runs["advice_unseen"] / promises.where(promises > 0))


def _by_link(runs: pd.DataFrame, metric: str) -> Answer:
    if not {metric, *AXES} <= set(runs):
        return NO_DATA
    means = runs.groupby("link", sort=False)[metric].mean().dropna()
    return "; ".join(f"{link}: {value:.3g}" for link, value in means.items()) or "-", None


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return what each link costs against messages that arrive at once, at every tick, and what it saves at all."""
    frame = _with_unseen(runs)
    if not {*AXES, "steps", "given_up", "unseen"} <= set(frame):
        return {}
    rows = []
    for key, part in frame.groupby(list(AXES), sort=False):
        floor, algorithm, link = map(str, key)
        row: dict[str, Any] = dict(zip(AXES, (floor, algorithm, link), strict=True))
        row["steps a target"] = str(estimate(part["steps"]))
        for name, other in (("against at once", AT_ONCE), ("against no messages", NONE)):
            against = confidence_limits(
                saving(frame, _arm(floor, algorithm, link), _arm(floor, algorithm, other), STEPS)
            )
            row[name] = saving_text(against) if against.size and link != other else "-"
        row["first useful, s"] = str(estimate(part["first_useful_reflection_s"]))
        row["stale, %"] = str(estimate(100 * part["stale_advice"]))
        row["of robots out of sight, %"] = str(estimate(100 * part["unseen"]))
        rows.append(row)
    return {"by link: mean ± half of the 95 % confidence interval": pd.DataFrame(rows)}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw steps, delay of the first useful reflection and stale advice by link, a row of panels a floor."""
    if not {*AXES, "steps", "first_useful_reflection_s", "stale_advice"} <= set(runs):
        return []
    frame = runs.assign(stale_percent=100 * runs["stale_advice"])
    floors = [floor for floor in FLOORS if floor in set(frame["floor"])]
    places = {str(link): rank for rank, link in enumerate(frame["link"].unique())}
    figure = Figure(figsize=(13.5, 1.0 + 3.6 * len(floors)), layout="constrained")
    plots = figure.subplots(len(floors), len(METRICS), squeeze=False, sharex=True)
    for line, floor in zip(plots, floors, strict=True):
        for plot, (metric, label) in zip(line, METRICS.items(), strict=True):
            _panel(plot, frame[frame["floor"] == floor], metric, places)
            plot.set(title=f"{floor} floor", ylabel=label)
        _printed(line[0], floor, places)
    for plot in plots[-1]:
        plot.set_xticks(list(places.values()), list(places), rotation=40, ha="right")
    handles, labels = plots[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize="small", loc="outside lower center", ncols=4)
    path = folder / "cost_by_link.png"
    save(figure, path)
    return [path]


def _panel(plot: Any, rows: pd.DataFrame, metric: str, places: dict[str, int]) -> None:
    for rank, algorithm in enumerate(ALGORITHMS):
        part = rows[(rows["algorithm"] == algorithm) & rows[metric].notna()]
        if not part.empty:
            points = estimates(part, ["link"], [metric])
            at = [places[link] + 0.15 * (rank - 1) for link in points["link"]]
            means = [value.mean for value in points[metric]]
            halves = np.nan_to_num([value.half for value in points[metric]])
            plot.errorbar(at, means, yerr=halves, fmt="o", capsize=3, color=f"C{rank}", label=NAMES[algorithm])
    if metric == "steps":
        plot.set_yscale("log")  # the potential field, where it is stuck, takes a hundred times as long as the others
    elif metric == "stale_percent":
        plot.set_ylim(0, 105)  # a share of 100 % is no edge
    else:
        limit_ordinate(plot, list(rows.groupby(["algorithm", "link"])[metric].mean()))
    plot.grid(alpha=0.3)


def _printed(plot: Any, floor: str, places: dict[str, int]) -> None:
    """Mark what Tables 1 and 2 print for four robots, whose messages arrive at once."""
    for each in cells():
        if each.floor == floor and each.robots == SIZES[-1] and AT_ONCE in places:
            rank = ALGORITHMS.index(each.algorithm)
            label = "paper, in the colours of the algorithms" if rank == 0 else None
            at = places[AT_ONCE] + 0.15 * (rank - 1)
            plot.plot(at, each.steps, "s", markerfacecolor="none", color=f"C{rank}", label=label)


# ---------------------------------------------------------------- the tests that published.csv names

globals().update(
    {
        f"{test.__name__}_{floor}_{algorithm}_{key}": partial(test, floor, algorithm, link)
        for test in (minimal, helps)
        for floor in FLOORS
        for algorithm in ALGORITHMS
        for key, link in LINKS.items()
    }
)
