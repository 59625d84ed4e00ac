"""What a mixed team costs: the time to do the task beside that of a team of equals in the same worlds."""

import math
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate, estimate

TIMES = {"coverage": "time_to_cover_s", "gathering": "time_to_gather_s"}
EQUALS = "alike"
ARM = ["task", "team", "air"]


def _timed(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs with ``done_s``, the time to do the task, whichever it was; none if a column is missing."""
    if runs.empty or not {*ARM, "replicate", "teams_lost"} <= set(runs):
        return pd.DataFrame()
    parts = [
        part.assign(done_s=part[TIMES[str(task)]])
        for task, part in runs.groupby("task", sort=False)
        if TIMES.get(str(task)) in part
    ]
    return pd.concat(parts) if parts else pd.DataFrame()


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the ratio of each team's time to that of the team of equals, replicate by replicate."""
    timed = _timed(runs)
    if timed.empty or EQUALS not in set(timed["team"]):
        return {}
    keys = ["task", "air", "replicate"]
    equals = timed[timed["team"] == EQUALS].set_index(keys)["done_s"].rename("equals_s")
    both = timed[timed["team"] != EQUALS].join(equals, on=keys)
    rows = [
        dict(zip(ARM, key, strict=True)) | {"ratio": str(_ratio(part))} for key, part in both.groupby(ARM, sort=False)
    ]
    return {
        "time to do the task, over that of a team of equals in the same world: mean ± half of the 95 %": pd.DataFrame(
            rows
        )
    }


def _ratio(rows: pd.DataFrame) -> Estimate:
    return estimate(rows["done_s"] / rows["equals_s"])


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the time to do the task by team, a panel a task, and how often robots lost their team."""
    timed = _timed(runs)
    if timed.empty:
        return []
    panels = [(task, part, "done_s", "s until the task is done") for task, part in timed.groupby("task", sort=False)]
    panels += [(f"{task}: teams lost", part, "teams_lost", "losses of a team, all robots") for task, part, *_ in panels]
    teams = {str(team): rank for rank, team in enumerate(timed["team"].unique())}
    figure = Figure(figsize=(4.8 * len(panels), 4.2), layout="constrained")
    plots = figure.subplots(1, len(panels), squeeze=False)[0]
    for plot, (title, part, metric, label) in zip(plots, panels, strict=True):
        for shift, (air, arm) in enumerate(part.groupby("air", sort=False)):
            _points(plot, arm, metric, teams, 0.12 * shift, str(air))
        plot.set(title=str(title), ylabel=label)
        plot.set_xticks(list(teams.values()), list(teams), rotation=30, ha="right")
        plot.set_ylim(bottom=0)
        plot.grid(alpha=0.3)
        plot.legend(fontsize="small")
    path = folder / "time_of_mixed_teams.png"
    save(figure, path)
    return [path]


def _points(plot: Any, rows: pd.DataFrame, metric: str, teams: dict[str, int], shift: float, label: str) -> None:
    points = estimates(rows, ["team"], [metric])
    places = [teams[team] + shift for team in points["team"]]
    means = [value.mean for value in points[metric]]
    halves = [0.0 if math.isnan(value.half) else value.half for value in points[metric]]
    plot.errorbar(places, means, yerr=halves, fmt="o", capsize=3, label=label)
