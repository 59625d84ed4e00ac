"""The claims of paper 000, section 7, on roles, as one-sided tests, and steps and time of the task by roles.

``dedicated_visbug_2`` in published.csv is ``dedicated`` for the algorithm ``visbug`` and two explorers; the tests by
such names are made at the end of this file.
"""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.experiment import axis_titles
from cosim.report.comparison import Answer, Arm, confidence_limits, saves, saving, saving_text
from cosim.report.drawing import legend_outside, limit_ordinate
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.reflection.choices import of_choice as of_choice  # by_choice asks for it

STEPS: Final = "steps"
ALGORITHMS: Final = axis_titles(Path(__file__).parent)["algorithm"]
TEAM: Final = 4
"""Size of the teams in which dedicated helpers are compared with explorers."""
AXES: Final = ("algorithm", "explorers", "helpers")


def _arm(algorithm: str, explorers: int, helpers: int) -> Arm:
    return dict(zip(AXES, (algorithm, explorers, helpers), strict=True))


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' if number != 1 else ''}"


def dedicated(algorithm: str, explorers: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether in a team of four, of whom some only help, a target takes fewer steps than if all explore."""
    return saves(runs, [("", _arm(algorithm, explorers, TEAM - explorers), _arm(algorithm, TEAM, 0))], STEPS)


def several(algorithm: str, explorers: int, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether one helper saves steps for several explorers together."""
    return saves(runs, [("", _arm(algorithm, explorers, 1), _arm(algorithm, explorers, 0))], STEPS)


def each_other(algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether four explorers without a helper need fewer steps a target than one that is alone."""
    return saves(runs, [("", _arm(algorithm, TEAM, 0), _arm(algorithm, 1, 0))], STEPS)


def sooner(algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Return when teams of four have done the same work, over the time of four explorers; no claim of the paper."""
    words = []
    for explorers in range(TEAM - 1, 0, -1):
        found = confidence_limits(
            saving(runs, _arm(algorithm, explorers, TEAM - explorers), _arm(algorithm, TEAM, 0), "done_s")
        )
        if found.size:
            team = f"{_counted(explorers, 'explorer')} and {_counted(TEAM - explorers, 'helper')}"
            words.append(f"{team}: {saving_text(found)}")
    return "; ".join(words) or "-", None


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return what teams of four need, by how many of them explore."""
    if runs.empty or not {*AXES, "steps", "given_up", "done_s"} <= set(runs):
        return {}
    teams = runs[runs["explorers"] + runs["helpers"] == TEAM]
    rows = []
    for key, part in teams.groupby(list(AXES), sort=False):
        row: dict[str, Any] = dict(zip(AXES, key, strict=True))
        row["steps a target"] = str(estimate(part["steps"]))
        row["given up, %"] = str(estimate(100 * part["given_up"]))
        row["task done after, s"] = str(estimate(part["done_s"]))
        rows.append(row)
    return {f"teams of {TEAM}, the same targets in all: mean ± half of the 95 %": pd.DataFrame(rows)} if rows else {}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw steps a target against the number of helpers, a panel an algorithm, a line a number of explorers."""
    if runs.empty or not {*AXES, "steps"} <= set(runs):
        return []
    names = [name for name in ALGORITHMS if name in set(runs["algorithm"])]
    figure = Figure(figsize=(4.4 * len(names) + 2.0, 4.4), layout="constrained")
    plots = figure.subplots(1, len(names), squeeze=False)[0]
    for plot, name in zip(plots, names, strict=True):
        for explorers, part in runs[runs["algorithm"] == name].groupby("explorers"):
            points = estimates(part, ["helpers"], ["steps"])
            means = [value.mean for value in points["steps"]]
            halves = np.nan_to_num([value.half for value in points["steps"]])
            label = _counted(int(str(explorers)), "explorer")
            plot.errorbar(points["helpers"], means, yerr=halves, marker="o", capsize=3, label=label)
        plot.set(title=ALGORITHMS[name], xlabel="helpers", ylabel="motion steps a target")
        plot.set_xticks(sorted(runs["helpers"].unique()))
        limit_ordinate(plot, list(runs[runs["algorithm"] == name].groupby(["explorers", "helpers"])["steps"].mean()))
        plot.grid(alpha=0.3)
    legend_outside(figure, plots)
    path = folder / "steps_by_roles.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update(
    {f"dedicated_{name}_{count}": partial(dedicated, name, count) for name in ALGORITHMS for count in range(1, TEAM)}
)
globals().update(
    {f"several_{name}_{count}": partial(several, name, count) for name in ALGORITHMS for count in range(2, TEAM + 1)}
)
globals().update({f"{t.__name__}_{name}": partial(t, name) for t in (each_other, sooner) for name in ALGORITHMS})
