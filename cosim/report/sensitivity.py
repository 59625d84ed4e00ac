"""Which axis moves which metric: Sobol's indices or Morris's effects of a sweep whose design was drawn for them.

The design is known by its shape, so that a folder of results is all that is needed: of the points that sweep.json
holds, groups of d + 2 are Saltelli's, and groups of d + 1 Morris's (``cosim.statistics.designs``). A metric counts with
its mean over replicates. SALib computes:

- Sobol's indices (saltelli): the share of a metric's variance that an axis explains alone (first_order), and with all
  others (total), with halves of their 95 % intervals by bootstrap.
- Morris's effects (morris): what a metric changes if an axis goes from one end to the other, extrapolated from steps of
  two thirds: the mean mu; the mean of the amounts mu_star, with half of its interval; the standard deviation sigma,
  which is large where the effect depends on the other axes, or on its own place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.installed import check_libraries
from cosim.results import FIXED, OBSERVATION_FIXED, RunStore, SweepDescription
from cosim.statistics.designs import LEVELS

NEEDS: Final = ("SALib>=1.5",)
"""The libraries of the extra ``sensitivity``."""
RESAMPLES: Final = 400
"""Number of bootstrap samples."""
SEED: Final = 1
"""Of the bootstrap: the same folder has the same intervals each time."""
_LEAST_AXES: Final = 2


@dataclass
class Sensitivity:
    """A row for each metric and axis, and what was left out."""

    experiment: str
    design: str
    points: int
    table: pd.DataFrame
    notes: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Return the table for a terminal."""
        title = f"{self.experiment}, {self.design}, {self.points} points"
        shown = self.table.to_string(index=False, float_format=lambda number: f"{number:.3g}")
        return "\n\n".join([f"{title}\n{shown if len(self.table) else 'no metric varies'}", *self.notes])

    def plain(self) -> dict[str, Any]:
        """Return the table as plain data."""
        rows = self.table.to_dict("records")
        return {"experiment": self.experiment, "design": self.design, "points": self.points} | {
            "indices": rows,
            "notes": self.notes,
        }


def sensitivity(folder: Path) -> Sensitivity:
    """Return the indices of the last sweep into *folder*; raise UserError if its design was not drawn for them."""
    check_libraries("sensitivities", NEEDS)
    store = RunStore(folder)
    told = store.description()
    rows = design_rows(told)
    axes = list(told.axes)
    design = design_of(rows)
    if design is None:
        raise UserError(f"{folder}: expected a sweep of two axes or more with the design saltelli or morris")
    runs = store.present()
    done = runs[runs["status"] == "done"]
    tables = [_means(done, axes), _means(store.present("observations"), axes)]
    found = Sensitivity(told.experiment, design, len(rows), pd.DataFrame())
    table = []
    for metric, by_configuration in (item for each in tables for item in each.items()):
        values = _in_turn(by_configuration, rows, told.configurations)
        missing = int(np.isnan(values).sum())
        if missing:
            found.notes.append(f"{metric}: {missing} of {len(rows)} points have no value, and the design needs all")
        elif np.ptp(values) > 1e-12 * np.abs(values).max():
            table += [{"metric": metric} | each for each in indices(design, axes, rows, values)]
    found.table = pd.DataFrame(table)
    return found


def design_rows(told: SweepDescription) -> list[tuple[Any, ...]]:
    """Return the points of the design of a sweep, in their order; none if it was not drawn."""
    columns = [axis.values for axis in told.axes.values()]
    if len({len(column) for column in columns}) != 1:
        return []
    rows = list(zip(*columns, strict=True))
    return rows if len({*rows}) == len(told.configurations) else []


def design_of(rows: Sequence[tuple[Any, ...]]) -> str | None:
    """Return whether *rows*, points in their order, are those of saltelli or of morris; None if of neither."""
    axes = len(rows[0]) if rows else 0
    if axes < _LEAST_AXES:
        return None
    for name, size, fits in (("saltelli", axes + 2, _is_crossed), ("morris", axes + 1, _is_trajectory)):
        groups = [rows[at : at + size] for at in range(0, len(rows), size)]
        if len(rows) % size == 0 and all(fits(group) for group in groups):
            return name
    return None


def _is_crossed(group: Sequence[tuple[Any, ...]]) -> bool:
    first, *crossed, last = group
    return all(row == (*first[:at], last[at], *first[at + 1 :]) for at, row in enumerate(crossed))


def _is_trajectory(group: Sequence[tuple[Any, ...]]) -> bool:
    moved = [[at for at, (a, b) in enumerate(zip(row, after, strict=True)) if a != b] for row, after in pairwise(group)]
    steps = [at for each in moved for at in each]
    return all(len(each) <= 1 for each in moved) and len(steps) == len({*steps})


def indices(design: str, axes: Sequence[str], rows: Sequence[tuple[Any, ...]], values: Floats) -> list[dict[str, Any]]:
    """Return a row of indices for each of *axes*, from *values* at the points *rows* of *design*."""
    from SALib.analyze import morris, sobol

    problem = {"num_vars": len(axes), "names": list(axes), "bounds": [[0.0, 1.0]] * len(axes)}
    settings = {"num_resamples": RESAMPLES, "seed": SEED}
    if design == "saltelli":
        made = sobol.analyze(problem, values, calc_second_order=False, **settings)
        columns = {"first_order": "S1", "first_half": "S1_conf", "total": "ST", "total_half": "ST_conf"}
    else:
        made = morris.analyze(problem, _ranks(rows), values, num_levels=LEVELS, **settings)
        columns = {"mu": "mu", "mu_star": "mu_star", "mu_star_half": "mu_star_conf", "sigma": "sigma"}
    return [
        {"axis": axis} | {column: float(made[key][at]) for column, key in columns.items()}
        for at, axis in enumerate(axes)
    ]


def _ranks(rows: Sequence[tuple[Any, ...]]) -> Floats:
    """Return *rows* with numbers for names: only whether an axis went up or down is looked at."""
    columns = [pd.Series(column) for column in zip(*rows, strict=True)]
    ranks = [
        column if pd.api.types.is_numeric_dtype(column) else column.astype(str).rank(method="dense")
        for column in columns
    ]
    table: Floats = np.column_stack([rank.to_numpy(dtype=float) for rank in ranks])
    return table


def _means(frame: pd.DataFrame, axes: Sequence[str]) -> dict[str, "pd.Series[float]"]:
    """Return the means of all metrics in *frame* by the digest of the configuration."""
    without = {*axes, *(each.name for each in (*FIXED, *OBSERVATION_FIXED))}
    metrics = [str(name) for name in frame.select_dtypes(["number", "bool"]).columns if name not in without]
    means = frame.groupby("configuration")[metrics].mean() if metrics else pd.DataFrame()
    return {metric: means[metric] for metric in metrics}


def _in_turn(means: "pd.Series[float]", rows: Sequence[tuple[Any, ...]], configurations: Sequence[str]) -> Floats:
    """Return the value of each of *rows*; arms are in the order in which their points were drawn first."""
    arms = dict(zip(dict.fromkeys(rows), configurations, strict=True))
    return np.asarray(means.reindex([arms[row] for row in rows]), dtype=np.float64)
