"""What a sweep found: means with confidence intervals, figures, and our numbers beside those that a paper printed.

``published.csv``, beside an experiment's sweep.yaml, holds a claim a row:

    id, paper, section, claim     what the paper says, and where
    quantity, where               what answers it, a column or an expression of columns such as ``delay_s <= 2.5`` (its
                                  mean is a share), and which rows (a pandas query; all, if empty)
    unit, published, test         the printed value, and how ours is held against it

``test`` is ``equal`` (every single row), ``within N %``, ``at least`` or ``at most`` (the mean), ``in the interval``
(the printed value lies in the confidence interval of ours), or the name of a function in the experiment's
``figures.py``: (runs, observations) -> (ours, whether the claim holds, or None for open).
Such a function answers ("-", None) where it finds no data.
Functions ``tables(runs, observations)`` and ``draw(runs, observations, folder)`` there may add tables by their titles,
and figures.
"""

import csv
import importlib.util
import io
import math
import os
import re
import textwrap
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field, ValidationInfo, field_validator
from scipy import stats

from cosim.documents import read_text, validated
from cosim.errors import UserError
from cosim.experiment import experiment_folders
from cosim.results import FIXED, OBSERVATION_FIXED, RunStore, SweepDescription
from cosim.settings import Settings

CONFIDENCE = 0.95
WIDTH = 110
"""Columns of a terminal that claims are wrapped to."""
MOST_LABELS = 4
"""With more names than this below a figure they stand upright."""
_COLUMNS = ("id", "paper", "section", "claim", "quantity", "where", "unit", "published", "test")
ANSWER = "answer"
"""The column of a claim's rows that holds the value of its quantity."""
_WITHIN = re.compile(r"within ([0-9]+(?:\.[0-9]+)?) ?%")
_MOST_LETTERS = 80
"""Of what somebody wrote, in an error."""
_NO_TEST = "is neither equal, within N %, at least, at most, in the interval, nor a function in figures.py"


class Estimate(NamedTuple):
    """A mean, half the width of its confidence interval (NaN for a single run), and the number of values."""

    mean: float
    half: float
    size: int

    def __str__(self) -> str:
        if not self.size:
            return "-"
        spread = self.half > 1e-12 * abs(self.mean)  # NaN for a single run; less is the rounding of the sum
        return f"{self.mean:.4g} ± {self.half:.2g}" if spread else f"{self.mean:.4g}"


class Claim(Settings):
    """A row of published.csv."""

    id: str = Field(min_length=1, max_length=_MOST_LETTERS)
    paper: str
    section: str
    claim: str
    quantity: str
    where: str
    unit: str
    test: str
    published: str
    place: str = "published.csv"
    """Where it stands, for errors."""

    @field_validator("test")
    @classmethod
    def _known(cls, test: str) -> str:
        if not (_compares(test) or test.isidentifier()):
            raise ValueError(_NO_TEST)
        return test

    @field_validator("published")
    @classmethod
    def _finite(cls, published: str, info: ValidationInfo) -> str:
        test = info.data.get("test", "")
        if _compares(test):
            try:
                finite = math.isfinite(float(published))
            except ValueError:
                finite = False
            if not finite:
                raise ValueError(f"is not a finite number, which the test {test!r} compares ours with")
        return published


def _compares(test: str) -> bool:
    """Return whether *test* holds ours against a printed number; if not, a function in figures.py decides."""
    return test in ("equal", "at least", "at most", "in the interval") or _WITHIN.fullmatch(test) is not None


class Verdict(NamedTuple):
    """A published claim with our answer."""

    id: str
    claim: str
    published: str
    ours: str
    verdict: str
    """holds, fails, open (the claim has no test that decides, or a single run no interval), or no data"""


def _lines_of(verdict: Verdict) -> str:
    """Return *verdict* for a terminal: the word first, then what was claimed, what was printed and what we have."""
    indent = " " * 7
    lines = textwrap.wrap(f"{verdict.id}: {verdict.claim}", WIDTH - 7, subsequent_indent=indent)
    lines[0] = f"{verdict.verdict:6s} {lines[0]}"
    answer = f"{indent}published {verdict.published}; ours {verdict.ours}"
    return "\n".join([*lines, *textwrap.wrap(answer, WIDTH, subsequent_indent=indent)])


@dataclass
class Report:
    """The tables by their titles, the claims, and the figures that were written."""

    name: str
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)
    figures: list[Path] = field(default_factory=list)
    failures: int = 0

    def text(self) -> str:
        """Return the report for a terminal."""
        parts = [f"{title}\n{table.to_string(index=False)}" for title, table in self.tables.items()]
        if self.verdicts:
            parts.append("\n".join([f"{self.name}, ours beside the published", *map(_lines_of, self.verdicts)]))
        if self.failures:
            parts.append(f"{self.failures} runs failed; the column error of the table runs says why")
        parts += ["\n".join(f"figure: {path}" for path in self.figures)] if self.figures else []
        return "\n\n".join(parts) or f"{self.name}: no runs"

    def plain(self) -> dict[str, Any]:
        """Return the report as plain data."""
        return {
            "experiment": self.name,
            "tables": {title: table.astype(str).to_dict("records") for title, table in self.tables.items()},
            "published": [verdict._asdict() for verdict in self.verdicts],
            "figures": [str(path) for path in self.figures],
            "failures": self.failures,
        }


def report(folder: Path) -> Report:
    """Compute the report of the last sweep into *folder*, and write its figures there.

    Raise UserError if *folder* holds no results, or a claim asks for what is not there.
    """
    store = RunStore(folder)
    told = store.description()
    runs, seen = store.present(), store.present("observations")
    good = runs[runs["status"] == "done"]
    axes = [axis for axis in told.axes if axis in runs or axis in seen]
    name = told.experiment
    source = _source_folder(told)
    figures = _figures_module(source)
    verdicts = [judge(claim, good, seen, figures) for claim in published_claims(source)]
    made = Report(name, {}, verdicts, failures=len(runs) - len(good))
    for title, frame, fixed in ((f"{name}, runs", good, FIXED), (f"{name}, observations", seen, OBSERVATION_FIXED)):
        metrics = _metrics(frame, axes, [each.name for each in fixed], told.report.metrics)
        if metrics:
            kinds = [column for column in frame if not pd.api.types.is_numeric_dtype(frame[column])]
            by = [*axes, *(str(column) for column in kinds if column not in {*axes, *_fixed()})]
            made.tables[f"{title}: mean ± half of the 95 % confidence interval"] = _shown(estimates(frame, by, metrics))
            drawn = [metric for metric in told.report.figures if metric in metrics] or metrics
            x, panel = told.report.x, told.report.panel
            known = [metric for metric in drawn if frame[metric].notna().any()]
            made.figures += [draw(frame, axes, metric, x, folder, panel) for metric in known]
    if hasattr(figures, "tables"):
        made.tables |= _asked(figures, "tables", good, seen)
    if hasattr(figures, "draw"):
        made.figures += _asked(figures, "draw", good, seen, folder)
    return made


def _fixed() -> set[str]:
    return {each.name for each in (*FIXED, *OBSERVATION_FIXED)}


def _metrics(frame: pd.DataFrame, axes: Sequence[str], fixed: Iterable[str], named: Sequence[str]) -> list[str]:
    """Return the columns that are worth a column in the table: those that are named, or else all that vary."""
    numbers = [str(column) for column in frame.select_dtypes("number").columns] if len(frame) else []
    free = [column for column in numbers if column not in {*axes, *fixed}]
    chosen = [column for column in named if column in free]
    return chosen or [column for column in free if frame[column].nunique() > 1]


# ---------------------------------------------------------------- estimates


def estimate(values: "pd.Series[float]", seeds: "pd.Series[int] | None" = None) -> Estimate:
    """Return the mean of *values* (empty ones left out) with its 95 % interval by Student's t.

    *seeds*, as long as *values*, says of which seed each is: values of one run need not be independent, nor those of
    several arms with the same random numbers, so the interval is that of a mean of clusters (Cochran, Sampling
    Techniques, 3rd ed., 9A.1), with a degree of freedom less than there are seeds. Without it every value is by itself.
    """
    there = values.notna().to_numpy()
    known = values.to_numpy(dtype=float)[there]
    if not len(known):
        return Estimate(math.nan, math.nan, 0)
    mean = float(np.mean(known))
    numbers = np.arange(len(known)) if seeds is None else np.unique(seeds.to_numpy()[there], return_inverse=True)[1]
    sums = np.bincount(numbers, weights=known - mean)
    count = len(sums)
    if count == 1:
        return Estimate(mean, math.nan, len(known))
    deviation = math.sqrt(float((sums**2).sum()) * count / (count - 1)) / len(known)
    quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, count - 1))
    return Estimate(mean, quantile * deviation, len(known))


def estimates(frame: pd.DataFrame, by: Sequence[str], metrics: Sequence[str]) -> pd.DataFrame:
    """Return a row for each combination of the columns *by*, with an Estimate of each metric.

    Rows of one seed, where *frame* has that column, count as one for the interval: see :func:`estimate`.
    """
    groups = frame.groupby(list(by), sort=False, dropna=False) if by else [((), frame)]
    rows = []
    for key, group in groups:
        row: dict[str, Any] = dict(zip(by, key, strict=True))
        seeds = _seeds_of(group)
        rows.append(row | {"n": len(group)} | {metric: estimate(group[metric], seeds) for metric in metrics})
    return pd.DataFrame(rows)


def _seeds_of(frame: pd.DataFrame) -> "pd.Series[int] | None":
    """Return the seed of each row of *frame*, which all arms of a replicate share; None if that is not known."""
    return frame.get("seed")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    return table.map(lambda value: str(value) if isinstance(value, Estimate) else value)


# ---------------------------------------------------------------- claims


def _source_folder(told: SweepDescription) -> Path | None:
    """Return the experiment's folder: where it was when it was run, or where the installed one of its name is.

    A sweep of another name in the folder answers other questions: the claims there are not about it.
    """
    source = Path(told.source)
    if source.name != "sweep.yaml":
        return None
    return source.parent if os.path.isdir(source.parent) else experiment_folders().get(told.experiment)


def published_claims(folder: Path | None) -> list[Claim]:
    """Return the rows of the published.csv in *folder*, if there is one; raise UserError for one that is wrong."""
    path = folder / "published.csv" if folder else None
    if path is None or not path.is_file():
        return []
    rows = csv.DictReader(io.StringIO(read_text(path), newline=""))
    claims = []
    try:
        for row in rows:
            place = f"{path}: line {rows.line_num}"
            if set(row) != set(_COLUMNS) or None in row.values():
                raise UserError(f"{place}: expected the columns {', '.join(_COLUMNS)}")
            claims.append(validated(Claim, row | {"place": place}, place))
    except csv.Error as error:
        raise UserError(f"{path}: line {rows.line_num}: is not CSV: {error}") from None
    return claims


def judge(claim: Claim, runs: pd.DataFrame, seen: pd.DataFrame, figures: ModuleType | None) -> Verdict:
    """Return our answer to *claim*; raise UserError if it cannot be held against anything."""
    published = f"{claim.published} {claim.unit.removeprefix('1')}".strip()
    function = None if _compares(claim.test) else claim.test
    if function is not None and not callable(getattr(figures, function, None)):
        raise UserError(f"{claim.place}: {_short(claim.id)}: test: {_short(repr(function))} {_NO_TEST}")
    if runs.empty:
        return Verdict(claim.id, claim.claim, published, "-", "no data")
    if function is not None:
        ours, holds = _asked(figures, function, runs, seen)
        undecided = "no data" if ours == "-" else "open"
        word = undecided if holds is None else "holds" if holds else "fails"
        return Verdict(claim.id, claim.claim, published, str(ours), word)
    rows = next((rows for rows in (_rows(each, claim) for each in (runs, seen)) if rows is not None), None)
    if rows is None or rows.empty or rows[ANSWER].isna().all():
        return Verdict(claim.id, claim.claim, published, "-", "no data")
    found = estimate(rows[ANSWER], _seeds_of(rows))
    holds = _passes(claim, rows[ANSWER], found)
    word = "open" if holds is None else "holds" if holds else "fails"
    return Verdict(claim.id, claim.claim, published, str(found), word)


def _rows(frame: pd.DataFrame, claim: Claim) -> pd.DataFrame | None:
    """Return the rows that *claim* is about, its quantity in the column ANSWER; None if *frame* does not hold that."""
    if not claim.quantity or frame.empty:
        return None
    try:
        answer = _evaluated(frame, claim, "quantity").astype(float)
    except pd.errors.UndefinedVariableError:
        return None
    return frame.assign(**{ANSWER: answer})[_evaluated(frame, claim, "where") if claim.where else slice(None)]


def _evaluated(frame: pd.DataFrame, claim: Claim, column: str) -> "pd.Series[Any]":
    """Return what the expression in *column* of *claim* gives for each row: numbers, or for ``where`` truth values.

    Raise UndefinedVariableError for a quantity that names no column, UserError for all else that is wrong with it.
    """
    expression = getattr(claim, column)
    try:  # nothing of this program is to be seen from the expression
        found: Any = frame[expression] if expression in frame else frame.eval(expression, local_dict={}, global_dict={})
        if not isinstance(found, pd.Series) or not found.index.equals(frame.index):
            raise TypeError("gives no value for each row")
        if column == "where" and not pd.api.types.is_bool_dtype(found):
            raise TypeError("is neither true nor false of each row")
        return found if column == "where" else found.astype(float)
    except Exception as error:  # what is wrong with an expression pandas tells by exceptions of a dozen classes
        if column == "quantity" and isinstance(error, pd.errors.UndefinedVariableError):
            raise
        place, told = f"{claim.place}: {_short(claim.id)}: {column}", _short(error) or type(error).__name__
        raise UserError(f"{place}: {_short(repr(expression))}: {told}") from None


def _passes(claim: Claim, values: "pd.Series[float]", found: Estimate) -> bool | None:
    published, mean, test = float(claim.published), found.mean, claim.test
    within = _WITHIN.fullmatch(test)
    if within:
        return abs(mean - published) <= abs(published) * float(within[1]) / 100
    if test == "in the interval":
        return None if math.isnan(found.half) else abs(mean - published) <= found.half
    if test == "equal":
        return bool(np.isclose(values.to_numpy(dtype=float), published, rtol=1e-12, atol=0).all())
    return mean >= published if test == "at least" else mean <= published


def _short(text: object) -> str:
    """Return *text* in one line of not too many letters."""
    line = " ".join(str(text).split())
    return line if len(line) <= _MOST_LETTERS else f"{line[: _MOST_LETTERS - 3]}..."


# ---------------------------------------------------------------- an experiment's figures.py


def _figures_module(folder: Path | None) -> ModuleType | None:
    path = folder / "figures.py" if folder else None
    if path is None or not path.is_file():
        return None
    spec = importlib.util.spec_from_file_location("figures", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with _blamed(str(path)):
        spec.loader.exec_module(module)
    return module


def _asked(figures: ModuleType | None, name: str, *arguments: Any) -> Any:
    """Return what the function *name* in *figures* answers; raise UserError if it fails, or answers something else."""
    path = getattr(figures, "__file__", None) or "figures.py"
    with _blamed(path, f"{name}: "):
        answer = getattr(figures, name)(*arguments)
    if name == "tables":
        expected = "a dict of titles and tables"
        right = isinstance(answer, dict) and all(isinstance(table, pd.DataFrame) for table in answer.values())
    elif name == "draw":
        expected = "a list of paths"
        right = isinstance(answer, list) and all(isinstance(path, Path) for path in answer)
    else:
        expected = "(ours, whether the claim holds or None)"
        right = isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], bool | np.bool_ | None)
    if not right:
        raise UserError(f"{path}: {name}: answers {_short(repr(answer))}, expected {expected}")
    return answer


@contextmanager
def _blamed(path: str, name: str = "") -> Iterator[None]:
    """Tell in one line with the place in the file *path* what goes wrong in it; the cause has the whole traceback."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # a figures.py is anybody's code and may fail in any way; raised on, with its place
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == path else (lines or [None])[-1]
        where = f"{path}: line {line}" if line else path
        raise UserError(f"{where}: {name}{type(error).__name__}: {_short(error)}") from error


# ---------------------------------------------------------------- figures


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
        if along in numeric:
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
    with mpl.rc_context({"savefig.dpi": 120}):
        figure.savefig(path)
    return path


def _arms(frame: pd.DataFrame, others: Sequence[str]) -> dict[str, pd.DataFrame]:
    """Return the rows of *frame* by the label of their arm."""
    groups = frame.groupby(list(others), sort=False) if others else [(("all",), frame)]
    return {", ".join(map(str, key)): group for key, group in groups}


def _line(plot: Any, frame: pd.DataFrame, along: str | None, metric: str, colour: str) -> Any:
    points = estimates(frame, [along] if along else [], [metric])
    places = points[along].tolist() if along else [0.0]
    means = [value.mean for value in points[metric]]
    halves = [0.0 if math.isnan(value.half) else value.half for value in points[metric]]
    return plot.errorbar(places, means, yerr=halves, marker="o", capsize=3, color=colour)
