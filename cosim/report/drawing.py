"""Figures of a sweep's metrics, and parts of figures that several experiments share."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.arrays import Floats
from cosim.report.comparison import Label
from cosim.report.estimates import estimates
from cosim.report.saving import save
from cosim.statistics.intervals import Estimate
from cosim.trace import POSES, Trace

Named: TypeAlias = tuple[str, Mapping[Any, str]]
"""An axis of a sweep, and what a figure calls its values, in their order."""

OFFSET = 0.06
"""Distance between the points of neighbouring lines, in steps of the axis."""
MOST_LABELS = 4
"""Largest number of names that stand side by side below a figure; more are turned upright."""
MOST_TICKS = 20
"""Largest number of values of an axis that have ticks and are joined by a line; more are those of a design."""
BAND = (25, 75)
"""Percentiles of the band about a median over time."""
INSTANTS = 200
"""Number of times at which it is drawn."""


def draw(
    frame: pd.DataFrame, axes: Sequence[str], metric: str, x: str | None, folder: Path, panel: str | None = None
) -> Path:
    """Draw *metric* over the axis *x*, a line for each remaining arm, and return the path of the picture.

    Without *x* the first axis with numbers is taken. The axis *panel* gives the panels; if it is none of those that
    remain, the last of several does. Arms without any value of *metric* are left out.
    """
    frame = frame[frame[metric].notna()]
    numeric = [axis for axis in axes if pd.api.types.is_numeric_dtype(frame[axis])]
    along = x if x in axes else next(iter([*numeric, *axes]), None)
    others = [axis for axis in axes if axis != along and frame[axis].nunique() > 1]
    panel = panel if panel in others else others[-1] if len(others) > 1 else None
    others = [axis for axis in others if axis != panel]
    parts = list(frame.groupby(panel, sort=False)) if panel else [("", frame)]
    figure = Figure(figsize=(5.0 * len(parts) + 1.5, 4.0), layout="constrained")
    plots = figure.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    colours = {label: f"C{rank}" for rank, label in enumerate(_arms(frame, others))}  # the same in every panel
    lines: dict[str, Any] = {}
    for plot, (value, part) in zip(plots, parts, strict=True):
        for label, arm in _arms(part, others).items():
            lines[label] = _line(plot, arm, along, metric, colours[label])
        plot.set(title=f"{panel} {value!s}" if panel else "", xlabel=along or "")
        plot.grid(alpha=0.3)
        if along in numeric and frame[along].nunique() <= MOST_TICKS:
            plot.set_xticks(sorted(frame[along].unique()))
        elif along and frame[along].nunique() > MOST_LABELS:
            plot.tick_params(axis="x", labelrotation=90)
    plots[0].set_ylabel(metric)
    if (frame[metric] >= 0).all():
        plots[0].set_ylim(bottom=0)
    if others:
        handles = [lines[label] for label in colours]
        plots[-1].legend(handles, list(colours), fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    path = folder / f"{metric}.png"
    return save(figure, path)


def _arms(frame: pd.DataFrame, others: Sequence[str]) -> dict[str, pd.DataFrame]:
    """Return the rows of *frame* by the label of their arm."""
    groups = frame.groupby(list(others), sort=False) if others else [(("all",), frame)]
    return {", ".join(map(str, key)): group for key, group in groups}


def _line(plot: Any, frame: pd.DataFrame, along: str | None, metric: str, colour: str) -> Any:
    points = estimates(frame, [along] if along else [], [metric])
    places = points[along].tolist() if along else [0.0]
    means = [value.mean for value in points[metric]]
    style = {"linestyle": "none"} if len(places) > MOST_TICKS else {}
    return plot.errorbar(places, means, yerr=_bars(points[metric]), marker="o", capsize=3, color=colour, **style)


def _bars(found: Iterable[Estimate]) -> Floats:
    """Return how far the intervals of *found* reach below and above the means (2, n), 0 where there is none."""
    ends = [(max(each.mean - each.low, 0.0), max(each.high - each.mean, 0.0)) for each in found]
    bars: Floats = np.nan_to_num(np.array(ends).reshape(-1, 2).T)
    return bars


def draw_panels(
    runs: pd.DataFrame, path: Path, metric: tuple[str, str], x: tuple[str, Sequence[Label]], lines: Named, panels: Named
) -> list[Path]:
    """Draw *metric*, (column, label), over the axis *x*, (column, values), into the file *path*; return its path.

    There is a panel for each value of *panels* that *runs* have, and a line for each value of *lines*. Values of *x*
    that are text have no order and are not joined by lines. Return nothing if there is nothing to draw.
    """
    (column, label), (axis, at), (line_axis, names), (panel_axis, titles) = metric, x, lines, panels
    known = [each for each in titles if each in set(runs.get(panel_axis, ()))]
    if not known or not {axis, line_axis, column} <= set(runs):
        return []
    figure = Figure(figsize=(4.0 * len(known) + 1.8, 4.0), layout="constrained")
    plots = figure.subplots(1, len(known), squeeze=False, sharey=True)[0]
    text = any(isinstance(value, str) for value in at)
    for plot, panel in zip(plots, known, strict=True):
        for rank, (value, title) in enumerate(names.items()):
            part = runs[(runs[panel_axis] == panel) & (runs[line_axis] == value)]
            if part.empty:
                continue
            points = estimates(part, [axis], [column]).set_index(axis).reindex([v for v in at if v in set(part[axis])])
            offset = OFFSET * (rank - (len(names) - 1) / 2)
            plot.errorbar(
                [list(at).index(each) + offset for each in points.index],
                [each.mean for each in points[column]],
                yerr=_bars(points[column]),
                marker="o",
                linestyle="none" if text else "-",
                capsize=3,
                color=f"C{rank}",
                label=title,
            )
        plot.set_xticks(range(len(at)), [str(each) for each in at], rotation=90 if text else 0)
        plot.set(title=titles[panel], xlabel=axis)
        plot.grid(alpha=0.3)
    plots[0].set_ylim(bottom=0)  # of all panels, once all is drawn: it fixes the upper end as well
    plots[0].set_ylabel(label)
    legend_outside(figure, plots)
    save(figure, path)
    return [path]


def share_over_time(run: "pd.Series[Any]", known: Mapping[str, float], end: tuple[str, str], at_s: Floats) -> Floats:
    """Return the share of something that was done at the times *at_s* (n,) of one *run*, a row of the results.

    *known* are the shares by the columns that hold when they were done, ascending; *end* the columns of when the run
    ended and of the share that was done then. In between it grows evenly; from the run's end on it stays as it was.
    """
    points = [(float(run[name]), share) for name, share in known.items() if not np.isnan(run[name])]
    last = float(run[end[0]]), float(run[end[1]])
    times, shares = zip((0.0, 0.0), *points, last, strict=True)
    found: Floats = np.interp(at_s, times, shares)
    return found


def draw_shares(
    runs: pd.DataFrame,
    path: Path,
    shares: tuple[str, Mapping[str, float], tuple[str, str]],
    lines: Named,
    panels: Named,
    rows: Named,
) -> list[Path]:
    """Draw a share over time into the file *path*: the median of the runs, and the band of their middle half.

    *shares* is (label, known, end), as :func:`share_over_time` has them. There is a panel for each value of *panels*, a
    row of them for each value of *rows*, and a line for each value of *lines*; values that *runs* do not have are left
    out. Return the path, or nothing if there is nothing to draw.
    """
    (label, known, end), (axis, titles), (row_axis, row_titles) = shares, panels, rows
    if runs.empty or not {*known, *end, axis, row_axis, lines[0]} <= set(runs):
        return []
    across = [each for each in titles if each in set(runs[axis])]
    down = [each for each in row_titles if each in set(runs[row_axis])]
    if not across or not down:
        return []
    figure = Figure(figsize=(4.0 * len(across) + 2.0, 3.0 * len(down) + 0.6), layout="constrained")
    plots = figure.subplots(len(down), len(across), squeeze=False, sharey=True)
    for row, below in zip(plots, down, strict=True):
        for plot, beside in zip(row, across, strict=True):
            _curves(plot, runs[(runs[axis] == beside) & (runs[row_axis] == below)], known, end, lines)
            plot.set_title(f"{titles[beside]}, {row_titles[below]}", fontsize="medium")
        row[0].set_ylabel(label)
    for plot in plots[-1]:
        plot.set_xlabel("time, s")
    legend_outside(figure, plots.flat)
    save(figure, path)
    return [path]


def _curves(plot: Any, runs: pd.DataFrame, known: Mapping[str, float], end: tuple[str, str], lines: Named) -> None:
    """Draw the lines of one panel, until all runs in it have come to the last of the *known* shares or have ended."""
    if runs.empty:
        return
    (axis, names), last = lines, list(known)[-1]
    at_s = np.linspace(0.0, float(runs[last].fillna(runs[end[0]]).max()), INSTANTS)
    for rank, (value, title) in enumerate(names.items()):
        part = runs[runs[axis] == value]
        if part.empty:
            continue
        curves = np.array([share_over_time(run, known, end, at_s) for _, run in part.iterrows()])
        low, high = np.percentile(curves, BAND, axis=0)
        plot.plot(at_s, np.median(curves, axis=0), color=f"C{rank}", label=title)
        plot.fill_between(at_s, low, high, color=f"C{rank}", alpha=0.2, linewidth=0)
    plot.set(xlim=(0, at_s[-1]), ylim=(0, 1.02))
    plot.grid(alpha=0.3)


def legend_outside(figure: Any, plots: Iterable[Any]) -> None:
    """Put a legend to the right of *figure*, with every label that its *plots* have once."""
    handles = {text: handle for plot in plots for handle, text in zip(*plot.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), fontsize="small", loc="outside right center")


def limit_ordinate(plot: Any, means: Sequence[float]) -> None:
    """Let the ordinate of *plot* begin at 0 and end above all *means*: a wide interval of a quick sweep is cut."""
    known = [mean for mean in means if not math.isnan(mean)]
    plot.set_ylim(0, 1.7 * max(known, default=1.0) or 1.0)


def tracks(trace: Trace) -> dict[int, Floats]:
    """Return for each robot a table (ticks, 3) of time in ns, x and y in m, from the poses in *trace*."""
    poses = trace.columns(POSES.name)
    table = np.column_stack([poses["time_ns"], poses["x_m"], poses["y_m"]])
    sources = np.array(poses["source"])
    return {int(robot): table[sources == robot] for robot in np.unique(sources)}
