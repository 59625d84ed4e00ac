"""The claims of paper 000, section 6.1, as one-sided tests, and Figs 16 and 17.

``grows_first_visbug`` in published.csv is ``grows`` for the floor ``first`` and the algorithm ``visbug``; the tests by
such names are made at the end of this file. The paper prints Figs 16 and 17 without numbers.
"""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report.comparison import NO_DATA, Answer, Arm, by_replicate, confidence_limits, saves, saving, saving_text
from cosim.report.drawing import legend_outside
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import estimate
from experiments.reflection.choices import of_choice as of_choice  # by_choice asks for it
from experiments.reflection.tables import ALGORITHMS, FLOORS, NAMES, SIZES, STEPS, cells, with_steps

ERRORS: Final = ("0", "0.1", "0.2", "0.3", "0.4")
ALONE: Final = "alone"
SOON: Final = "0.2"
"""Error at which helpers are to have become almost useless: half of the largest."""
ALMOST_USELESS: Final = 0.1
"""Share of the steps of the robot alone below which the saving by helpers is almost useless."""


def _arm(floor: str, algorithm: str, error: str) -> Arm:
    return {"floor": floor, "algorithm": algorithm, "err_max": error}


def grows(floor: str, algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether steps grow with the error: the slope of the straight line through each replicate's is positive."""
    frame = with_steps(runs)
    found = {float(error): by_replicate(frame, _arm(floor, algorithm, error), STEPS) for error in ERRORS}
    table = pd.DataFrame({error: values for error, values in found.items() if not values.empty}).dropna()
    if table.empty or table.shape[1] < 2:
        return NO_DATA
    errors = np.array(table.columns, dtype=float)
    slopes = pd.Series({row: float(np.polyfit(errors, values, 1)[0]) for row, values in table.iterrows()})
    slope = confidence_limits(slopes)
    words = f"{slope.mean / 10:+.3g} steps a target for each 0.1"
    if slope.size < 2:
        return words, None
    return f"{words} (at least {slope.lower / 10:+.3g})", slope.lower > 0


def better_than_alone(algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the first floor helpers save steps even with the largest error."""
    return saves(with_steps(runs), [("", _arm("first", algorithm, ERRORS[-1]), _arm("first", algorithm, ALONE))], STEPS)


def useless(algorithm: str, runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the second floor, with an error of ``SOON``, helpers save a share below ``ALMOST_USELESS``."""
    found = confidence_limits(
        saving(with_steps(runs), _arm("second", algorithm, SOON), _arm("second", algorithm, ALONE), STEPS)
    )
    if not found.size:
        return NO_DATA
    words = saving_text(found)
    if found.size < 2:
        return words, None
    return f"{words}, at most {100 * found.upper:.3g} %", found.upper < ALMOST_USELESS


def worse_than_alone(runs: pd.DataFrame, observations: pd.DataFrame) -> Answer:
    """Answer whether on the second floor VisBug needs more steps with helpers and the largest error than alone."""
    pair = ("alone, against helpers:", _arm("second", "visbug", ALONE), _arm("second", "visbug", ERRORS[-1]))
    return saves(with_steps(runs), [pair], STEPS)


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return steps a target, and what helpers save against the robot alone."""
    frame = with_steps(runs)
    if "steps" not in frame or not {"floor", "algorithm", "err_max"} <= set(frame):
        return {}
    rows = []
    for key, part in frame.groupby(["floor", "algorithm", "err_max"], sort=False):
        floor, algorithm, error = map(str, key)
        against = confidence_limits(saving(frame, _arm(floor, algorithm, error), _arm(floor, algorithm, ALONE), STEPS))
        row: dict[str, Any] = {"floor": floor, "algorithm": algorithm, "err_max": error}
        row["steps a target"] = str(estimate(part["steps"]))
        row["against alone"] = saving_text(against) if against.size and error != ALONE else "-"
        rows.append(row)
    return {"steps a target: mean ± half of the 95 % confidence interval": pd.DataFrame(rows)}


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw Figs 16 and 17: steps against the error, with the robot alone at the right.

    The paper prints their ends only, in Tables 1 and 2: no error, and the robot alone.
    """
    frame = with_steps(runs)
    if "steps" not in frame or not {"floor", "algorithm", "err_max"} <= set(frame):
        return []
    places = {error: 0.1 * rank for rank, error in enumerate((*ERRORS, ALONE))}
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    plots = figure.subplots(1, len(FLOORS), squeeze=False)[0]
    for plot, floor in zip(plots, FLOORS, strict=True):
        for rank, algorithm in enumerate(ALGORITHMS):
            part = frame[(frame["floor"] == floor) & (frame["algorithm"] == algorithm)]
            if not part.empty:
                points = estimates(part, ["err_max"], ["steps"])
                _line(plot, points, places, f"C{rank}", NAMES[algorithm])
            _printed(plot, floor, algorithm, places, f"C{rank}")
        plot.set(title=f"{floor} floor", xlabel="largest relative error of a distance", ylabel="motion steps a target")
        plot.set_xticks(list(places.values()), list(places))
        plot.set_yscale("log")  # the potential field, where it is stuck, takes a hundred times as long as the others
        plot.grid(alpha=0.3)
    legend_outside(figure, plots)
    path = folder / "steps_by_error.png"
    save(figure, path)
    return [path]


def _line(plot: Any, points: pd.DataFrame, places: dict[str, float], colour: str, label: str) -> None:
    """Draw the arms with helpers as a line, and the robot alone as a point with a level."""
    means = {str(error): value.mean for error, value in zip(points["err_max"], points["steps"], strict=True)}
    halves = {str(error): value.half for error, value in zip(points["err_max"], points["steps"], strict=True)}
    helped = [error for error in ERRORS if error in means]
    spread = np.nan_to_num([halves[error] for error in helped])
    at = [places[error] for error in helped]
    plot.errorbar(at, [means[e] for e in helped], yerr=spread, marker="o", capsize=3, color=colour, label=label)
    if ALONE in means:
        half = np.nan_to_num(halves[ALONE])
        plot.errorbar(places[ALONE], means[ALONE], yerr=half, marker="D", capsize=3, color=colour)
        plot.axhline(means[ALONE], linestyle=":", linewidth=1.0, color=colour)


def _printed(plot: Any, floor: str, algorithm: str, places: dict[str, float], colour: str) -> None:
    """Mark what Tables 1 and 2 print: four robots without an error, and R1 alone."""
    ends = {max(SIZES): places[ERRORS[0]], min(SIZES): places[ALONE]}
    known = [each for each in cells() if (each.floor, each.algorithm) == (floor, algorithm)]
    marks = [(ends[each.robots], each.steps) for each in known if each.robots in ends]
    label = f"{NAMES[algorithm]}, paper (Tables 1 and 2)"
    plot.plot(*zip(*marks, strict=True), "s", markersize=8, markerfacecolor="none", color=colour, label=label)


# ---------------------------------------------------------------- the tests that published.csv names

globals().update({f"grows_{floor}_{name}": partial(grows, floor, name) for floor in FLOORS for name in ALGORITHMS})
globals().update(
    {f"{t.__name__}_{name}": partial(t, name) for t in (better_than_alone, useless) for name in ALGORITHMS}
)
