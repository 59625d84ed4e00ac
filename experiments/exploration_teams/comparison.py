"""What the tests and figures of the exploration experiments have in common.

Arms are compared replicate by replicate, as in :mod:`experiments.aggregation_search.comparison`; the metric is the time
until 95 % of what can be seen has been.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report import estimates
from experiments.aggregation_search.comparison import Pair, columns, less, told
from experiments.reflection_tables.comparison import NO_DATA, Answer, Arm, Label, limits, values_of

TIME: Final = "until_95_s"
MAPS: Final = {"empty": "empty map", "corridor": "corridor with rooms", "office": "office"}
"""The floors, as figures call them."""
MUCH: Final = 0.75
"""A team is much quicker than one robot if it needs less than this share of the time."""
SLIGHT: Final = 1.1
"""What makes an exploration less than this factor longer costs little."""
BESIDE: Final = 0.06
"""Points of several lines stand so far beside each other, in steps of the axis."""
IN_TIME: Final = 0.7
"""A floor is explored if more than this share of the runs come to 99 %; 9 of 9 show it."""


def levels(runs: pd.DataFrame, axis: str) -> list[Any]:
    """Return the values of *axis* in *runs*, ascending."""
    return sorted(runs[axis].unique().tolist()) if axis in runs else []


def sooner_than(runs: pd.DataFrame, pairs: Sequence[Pair], factor: float = 1.0) -> Answer:
    """Answer whether in every one of *pairs* the first arm takes less than *factor* times as long as the second.

    A run that was cut counts with a lower bound of its time: no pair holds whose first arm has such runs, and none
    fails whose second has. These stay open.
    """
    words, holds = [], []
    for label, arm, than in pairs:
        found, answer = less(runs, [(label, arm, than)], TIME, factor)
        if found == NO_DATA[0]:
            return NO_DATA
        cut = [_cut(runs, each) for each in (arm, than)]
        words.append(found + (f", {cut[0]} and {cut[1]} runs cut" if any(cut) else ""))
        holds.append(None if (answer is True and cut[0]) or (answer is False and cut[1]) else answer)
    if not holds:
        return NO_DATA
    return "; ".join(words), False if False in holds else None if None in holds else True


def _cut(runs: pd.DataFrame, arm: Arm) -> int:
    """Return how many runs of *arm* ended before 95 % had been seen."""
    return int((values_of(runs, arm, "reached") < 1).sum())


def untouched(runs: pd.DataFrame, arms: Sequence[Arm]) -> Answer:
    """Answer whether no robot of *arms* was held up in any run: one refutes it."""
    found = [values_of(runs, arm, "blocked_ticks") for arm in arms]
    if not found or any(part.empty for part in found):
        return NO_DATA
    every = pd.concat(found)
    return f"held up in {every.mean():.3g} ticks a run, in {int((every > 0).sum())} of {len(every)}", not every.any()


def above(runs: pd.DataFrame, arms: Sequence[tuple[str, Arm]], metric: str, least: float = 0.0) -> Answer:
    """Answer whether the mean of *metric* is above *least* in every one of *arms*."""
    found = [(label, limits(values_of(runs, arm, metric))) for label, arm in arms]
    if not found or not all(each.size for _, each in found):
        return NO_DATA
    words = "; ".join(f"{label} {told(each)}".strip() for label, each in found)
    return words, None if any(each.size < 2 for _, each in found) else all(each.lower > least for _, each in found)


def more(runs: pd.DataFrame, pairs: Sequence[tuple[str, Arm, str, Arm, str]]) -> Answer:
    """Answer whether in every pair, (label, arm, metric, other arm, its metric), the first has more than the second."""
    words, holds = [], []
    for label, arm, metric, other, its_metric in pairs:
        both = pd.concat([values_of(runs, arm, metric), values_of(runs, other, its_metric)], axis=1, join="inner")
        difference = limits(both.iloc[:, 0] - both.iloc[:, 1])
        if not difference.size:
            return NO_DATA
        one, two = both.mean()
        words.append(f"{label} {one:.3g} against {two:.3g}, difference {told(difference)}".strip())
        holds.append(None if difference.size < 2 else difference.lower > 0)
    return ("; ".join(words), None if None in holds else all(holds)) if holds else NO_DATA


def shares_saved(runs: pd.DataFrame, arm: Arm, than: Arm) -> "pd.Series[float]":
    """Return which share of the time of *than* is saved in *arm*, by replicate."""
    both = columns(runs, [arm, than], TIME)
    return 1.0 - both[0] / both[1]


def panels(
    runs: pd.DataFrame,
    folder: Path,
    name: str,
    metric: str,
    label: str,
    x: tuple[str, Sequence[Label]],
    lines: tuple[str, Mapping[Any, str]],
) -> list[Path]:
    """Draw *metric* over the axis *x*, a panel a map, a line each of *lines*, into the file *name*; return its path."""
    (axis, at), (line_axis, names) = x, lines
    floors = [each for each in MAPS if each in set(runs.get("map", ()))]
    if not floors or not {axis, line_axis, metric} <= set(runs):
        return []
    figure = Figure(figsize=(4.0 * len(floors) + 1.8, 4.0), layout="constrained")
    plots = figure.subplots(1, len(floors), squeeze=False, sharey=True)[0]
    named = any(isinstance(value, str) for value in at)  # what has no order is not joined by lines
    for plot, floor in zip(plots, floors, strict=True):
        for rank, (value, title) in enumerate(names.items()):
            part = runs[(runs["map"] == floor) & (runs[line_axis] == value)]
            if part.empty:
                continue
            points = estimates(part, [axis], [metric]).set_index(axis).reindex([v for v in at if v in set(part[axis])])
            halves = np.nan_to_num([each.half for each in points[metric]])
            beside = BESIDE * (rank - (len(names) - 1) / 2)
            places = [list(at).index(each) + beside for each in points.index]
            plot.errorbar(
                places,
                [each.mean for each in points[metric]],
                yerr=halves,
                marker="o",
                linestyle="none" if named else "-",
                capsize=3,
                color=f"C{rank}",
                label=title,
            )
        plot.set_xticks(range(len(at)), [str(each) for each in at], rotation=90 if named else 0)
        plot.set(title=MAPS[floor], xlabel=axis)
        plot.grid(alpha=0.3)
    plots[0].set_ylim(bottom=0)  # of all panels, once all is drawn: it fixes the upper end as well
    plots[0].set_ylabel(label)
    handles = {text: handle for plot in plots for handle, text in zip(*plot.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), fontsize="small", loc="outside right center")
    path = folder / name
    figure.savefig(path, dpi=120)
    return [path]
