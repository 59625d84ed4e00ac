"""The claims of paper 002 on large areas (sections VII.B and VIII) as one-sided tests, and search time over the side.

``gains_mi`` in published.csv is ``gains`` for the strategy ``mi``; the tests by such names are made at the end of this
file.
"""

import math
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.experiment import axis_titles
from cosim.report.comparison import NO_DATA, Answer, Arm, Limits, confidence_limits, less, mostly, paired, slopes
from cosim.report.estimates import estimates
from cosim.report.saving import save
from experiments.aggregation.strategies import OURS, TIME

NAMES: Final = axis_titles(Path(__file__).parent)["strategy"]
"""Names of the strategies in figures and answers."""
AXES: Final = ("strategy", "side_m", "sub_teams")
MOBILE: Final = ("mrp", "mi")
IN_TIME: Final = 0.75
"""Share of the searches that a strategy must bring to an end to extend to an area."""


def _arm(strategy: str, side_m: float, sub_teams: int) -> Arm:
    return dict(zip(AXES, (strategy, side_m, sub_teams), strict=True))


def _levels(runs: pd.DataFrame) -> tuple[list[float], list[int]]:
    """Return the sides and the numbers of sub-teams of the sweep, ascending."""
    if runs.empty or not {*AXES, TIME} <= set(runs):
        return [], []
    return sorted(runs["side_m"].unique().tolist()), sorted(runs["sub_teams"].unique().tolist())


def gains(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether SRP's search time over a strategy's grows with the side, for every number of sub-teams."""
    sides, teams = _levels(runs)
    if len(sides) < 2:
        return NO_DATA
    words, holds = [], []
    for count in teams:
        advantage = _advantage(runs, strategy, sides, count)
        found = confidence_limits(slopes(advantage, np.log(sides).tolist()))
        if not found.size:
            return NO_DATA
        ratios = ", ".join(
            f"{side:g} m x {np.exp(mean):.3g}" for side, mean in zip(sides, advantage.mean(), strict=True)
        )
        words.append(f"sub-teams {count}: {ratios}, power of the side {found.text()}")
        holds.append(found.exceeds(0))
    return "; ".join(words), None if None in holds else all(holds)


def _advantage(runs: pd.DataFrame, strategy: str, sides: list[float], sub_teams: int) -> pd.DataFrame:
    """Return the logarithm of SRP's search time over that of *strategy*, a column a side, a row a replicate."""
    arms = [_arm(name, side, sub_teams) for name in ("srp", strategy) for side in sides]
    logs = paired(runs, arms, TIME).map(math.log)
    return logs.iloc[:, : len(sides)] - logs.iloc[:, len(sides) :].to_numpy()


def leads(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy has a lower mean search time than SRP on the largest area, whatever the sub-teams."""
    sides, teams = _levels(runs)
    if not sides:
        return NO_DATA
    side = sides[-1]
    return less(
        runs,
        [(f"sub-teams {n}, {side:g} m:", _arm(strategy, side, n), _arm("srp", side, n)) for n in teams],
        TIME,
        unit="min",
    )


def extends(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether a strategy, with as many sub-teams as there are, brings searches of the largest area to an end."""
    sides, teams = _levels(runs)
    if not sides:
        return NO_DATA
    return mostly(runs, [(f"sub-teams {teams[-1]}, {sides[-1]:g} m:", _arm(strategy, sides[-1], teams[-1]))], IN_TIME)


def parallel(strategy: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on every area more sub-teams find the targets sooner: the slope of the logarithms is below 0."""
    sides, teams = _levels(runs)
    if len(teams) < 2:
        return NO_DATA
    found: dict[float, Limits] = {}
    for side in sides:
        table = paired(runs, [_arm(strategy, side, count) for count in teams], TIME).map(math.log)
        found[side] = confidence_limits(-slopes(table, np.log(teams).tolist()))
    if not all(each.size for each in found.values()):
        return NO_DATA
    words = "; ".join(
        f"{side:g} m: shorter by their number to the power of {each.text()}" for side, each in found.items()
    )
    holds = [each.exceeds(0) for each in found.values()]
    return words, None if None in holds else all(holds)


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw mean search time over the side, a line a strategy, a panel a number of sub-teams."""
    sides, teams = _levels(runs)
    if not sides:
        return []
    figure = Figure(figsize=(4.2 * len(teams) + 1.5, 4.2), layout="constrained")
    plots = figure.subplots(1, len(teams), squeeze=False, sharey=True)[0]
    for plot, count in zip(plots, teams, strict=True):
        rows = runs[runs["sub_teams"] == count].sort_values("side_m")
        for name in (name for name in NAMES if name in set(rows["strategy"])):
            points = estimates(rows[rows["strategy"] == name], ["side_m"], [TIME])
            halves = np.nan_to_num([value.half for value in points[TIME]])
            means = [value.mean for value in points[TIME]]
            plot.errorbar(points["side_m"], means, yerr=halves, marker="o", capsize=3, label=NAMES[name])
        plot.set(title=f"{count} sub-team{'s' if count != 1 else ''}", xlabel="side of the area, m")
        plot.set_xticks(sides)
        plot.grid(alpha=0.3)
    plots[0].set_ylim(bottom=0)  # of all panels, once all is drawn: it fixes the upper end as well
    plots[0].set_ylabel("search time, min")
    plots[-1].legend(fontsize="small")
    path = folder / "search_time_by_side.png"
    save(figure, path)
    return [path]


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"{t.__name__}_{strategy}": partial(t, strategy) for t in (gains, leads) for strategy in MOBILE})
globals().update({f"{t.__name__}_{strategy}": partial(t, strategy) for t in (extends, parallel) for strategy in OURS})
