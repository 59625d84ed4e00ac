"""The report of a sweep: a table of estimates by arm, the verdicts on the paper's claims, and figures.

Functions ``tables(runs, observations)`` and ``draw(runs, observations, folder)`` in the experiment's ``figures.py`` may
add tables by their titles, and figures.
"""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.report.claims import (
    LIMITS,
    WIDTH,
    Claim,
    Verdict,
    chance,
    judge,
    limits_told,
    published_claims,
    source_folder,
)
from cosim.report.drawing import draw
from cosim.report.estimates import estimates
from cosim.report.figures_module import call, load_figures
from cosim.report.sensitivity import design_rows
from cosim.results import FIXED, OBSERVATION_FIXED, RunStore, SweepDescription
from cosim.statistics.intervals import Estimate


@dataclass
class Report:
    """The tables by their titles, the claims, and the figures that were written."""

    name: str
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)
    claims: list[Claim] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    """Of the claims, in their order."""
    figures: list[Path] = field(default_factory=list)
    runs: int = 0
    """How many rows there are."""
    failures: int = 0
    sweep: SweepDescription | None = None

    @property
    def missing(self) -> int:
        """How many runs of the sweep are not there yet."""
        return 0 if self.sweep is None else max(0, self.sweep.runs - self.runs)

    def text(self) -> str:
        """Return the report for a terminal."""
        parts = [f"{title}\n{table.to_string(index=False)}" for title, table in self.tables.items()]
        if self.verdicts:
            parts.append(
                "\n".join([f"{self.name}, ours beside the published", *(verdict.text() for verdict in self.verdicts)])
            )
            expected = chance(self.verdicts)
            parts += [expected.text()] if expected else []
            parts += [textwrap.fill(LIMITS, WIDTH)] if limits_told(self.verdicts) else []
        if self.missing:
            there = f"{self.runs} of {self.runs + self.missing} runs are there"
            parts.append(f"{there}: all this is of those alone; cosim status says how long the rest takes")
        if self.failures:
            parts.append(f"{self.failures} runs failed; the column error of the table runs says why")
        parts += ["\n".join(f"figure: {path}" for path in self.figures)] if self.figures else []
        return "\n\n".join(parts) or f"{self.name}: no runs"

    def plain(self) -> dict[str, Any]:
        """Return the report as plain data."""
        expected = chance(self.verdicts)
        return {
            "experiment": self.name,
            "tables": {title: table.astype(str).to_dict("records") for title, table in self.tables.items()},
            "published": [verdict._asdict() for verdict in self.verdicts],
            "chance": expected._asdict() if expected else None,
            "figures": [str(path) for path in self.figures],
            "failures": self.failures,
            "missing": self.missing,
        }


def report(folder: Path) -> Report:
    """Compute the report of the last sweep into *folder*, and write its figures there.

    Raise UserError if *folder* holds no results, or a claim asks for what is not there.
    """
    store = RunStore(folder)
    sweep = store.description()
    runs, seen = store.present(), store.present("observations")
    good = runs[runs["status"] == "done"]
    axes = [axis for axis in sweep.axes if axis in runs or axis in seen]
    name = sweep.experiment
    source = source_folder(sweep)
    figures = load_figures(source)
    claims = published_claims(source)
    verdicts = [judge(claim, good, seen, figures) for claim in claims]
    made = Report(name, {}, claims, verdicts, runs=len(runs), failures=len(runs) - len(good), sweep=sweep)
    for title, frame, fixed in ((f"{name}, runs", good, FIXED), (f"{name}, observations", seen, OBSERVATION_FIXED)):
        metrics = _metrics(frame, axes, [each.name for each in fixed], sweep.report.metrics)
        if metrics:
            kinds = [column for column in frame if not pd.api.types.is_numeric_dtype(frame[column])]
            by = [*axes, *(str(column) for column in kinds if column not in {*axes, *_fixed()})]
            made.tables[f"{title}: mean ± half of the 95 % confidence interval"] = _shown(estimates(frame, by, metrics))
            drawn = [metric for metric in sweep.report.figures if metric in metrics] or metrics
            x, panel = sweep.report.x, sweep.report.panel
            known = [metric for metric in drawn if frame[metric].notna().any()]
            shown = [x if x in axes else axes[0]] if design_rows(sweep) else axes  # a line for each arm shows nothing
            made.figures += [draw(frame, shown, metric, x, folder, panel) for metric in known]
    if hasattr(figures, "tables"):
        made.tables |= call(figures, "tables", good, seen)
    if hasattr(figures, "draw"):
        made.figures += call(figures, "draw", good, seen, folder)
    return made


def _fixed() -> set[str]:
    return {each.name for each in (*FIXED, *OBSERVATION_FIXED)}


def _metrics(frame: pd.DataFrame, axes: Sequence[str], fixed: Iterable[str], named: Sequence[str]) -> list[str]:
    """Return the columns that are worth a column in the table: those that are named, or else all that vary."""
    numbers = [str(column) for column in frame.select_dtypes("number").columns] if len(frame) else []
    free = [column for column in numbers if column not in {*axes, *fixed}]
    chosen = [column for column in named if column in free]
    return chosen or [column for column in free if frame[column].nunique() > 1]


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    return table.map(lambda value: str(value) if isinstance(value, Estimate) else value)
