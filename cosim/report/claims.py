"""What a paper claims, row by row in ``published.csv``, and whether our runs agree.

``published.csv``, beside an experiment's sweep.yaml, holds one claim a row::

    id, paper, section, claim     what the paper says, and where
    quantity, where               what answers it, a column or an expression of columns such as ``delay_s <= 2.5`` (its
                                  mean is a share), and which rows (a pandas query; all, if empty)
    unit, published, test         the printed value, and how ours is compared with it

``test`` is ``equal`` (every single row), ``within N %``, ``at least`` or ``at most`` (the mean), ``in the interval``
(the printed value lies in the confidence interval of ours), or the name of a function in the experiment's
``figures.py``: (runs, observations) -> (ours, whether the claim holds, or None for open).
Such a function answers ("-", None) where it finds no data.
"""

import csv
import io
import math
import os
import re
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field, ValidationInfo, field_validator

from cosim.documents import read_text, validated
from cosim.errors import UserError
from cosim.experiment import experiment_folders
from cosim.report.estimates import Estimate, estimate, seeds_of
from cosim.report.figures_module import MOST_LETTERS, call, shortened
from cosim.results import SweepDescription
from cosim.settings import Settings

WIDTH = 110
"""Columns of a terminal that claims are wrapped to."""
ANSWER = "answer"
"""The column of a claim's rows that holds the value of its quantity."""
_COLUMNS = ("id", "paper", "section", "claim", "quantity", "where", "unit", "published", "test")
_WITHIN = re.compile(r"within ([0-9]+(?:\.[0-9]+)?) ?%")
_NO_TEST = "is neither equal, within N %, at least, at most, in the interval, nor a function in figures.py"


class Claim(Settings):
    """A row of published.csv."""

    id: str = Field(min_length=1, max_length=MOST_LETTERS)
    paper: str
    section: str
    claim: str
    quantity: str
    where: str
    unit: str
    test: str
    published: str
    place: str = "published.csv"
    """Place of the row, for errors."""

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

    def text(self) -> str:
        """Return the verdict for a terminal: the word, what was claimed, what was printed, and our number."""
        indent = " " * 7
        lines = textwrap.wrap(f"{self.id}: {self.claim}", WIDTH - 7, subsequent_indent=indent)
        lines[0] = f"{self.verdict:6s} {lines[0]}"
        answer = f"{indent}published {self.published}; ours {self.ours}"
        return "\n".join([*lines, *textwrap.wrap(answer, WIDTH, subsequent_indent=indent)])


def source_folder(sweep: SweepDescription) -> Path | None:
    """Return the experiment's folder: where it was when it was run, or where the installed one of its name is.

    A sweep of another name in the folder answers other questions: the claims there are not about it.
    """
    source = Path(sweep.source)
    if source.name != "sweep.yaml":
        return None
    return source.parent if os.path.isdir(source.parent) else experiment_folders().get(sweep.experiment)


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
        raise UserError(f"{claim.place}: {shortened(claim.id)}: test: {shortened(repr(function))} {_NO_TEST}")
    if runs.empty:
        return Verdict(claim.id, claim.claim, published, "-", "no data")
    if function is not None:
        ours, holds = call(figures, function, runs, seen)
        undecided = "no data" if ours == "-" else "open"
        word = undecided if holds is None else "holds" if holds else "fails"
        return Verdict(claim.id, claim.claim, published, str(ours), word)
    rows = next((rows for rows in (_rows(each, claim) for each in (runs, seen)) if rows is not None), None)
    if rows is None or rows.empty or rows[ANSWER].isna().all():
        return Verdict(claim.id, claim.claim, published, "-", "no data")
    found = estimate(rows[ANSWER], seeds_of(rows))
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
    except Exception as error:  # a user's expression can fail in any way in pandas; always re-raised
        if column == "quantity" and isinstance(error, pd.errors.UndefinedVariableError):
            raise
        place, told = f"{claim.place}: {shortened(claim.id)}: {column}", shortened(error) or type(error).__name__
        raise UserError(f"{place}: {shortened(repr(expression))}: {told}") from None


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
