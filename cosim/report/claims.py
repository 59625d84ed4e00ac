"""What a paper claims, row by row in ``published.csv``, and whether our runs agree.

``published.csv``, beside an experiment's sweep.yaml, holds one claim a row::

    id, paper, section, claim     what the paper says, and where
    quantity, where               what answers it, a column or an expression of columns such as ``delay_s <= 2.5`` (its
                                  mean is a share), and which rows (a pandas query; all, if empty)
    unit, published, test         the printed value, and how ours is compared with it

``test`` is one of these::

    equal                     every single row is what is printed
    within N %, at least,     the whole 95 % interval of our mean lies in that range: holds; wholly outside: fails;
    at most                   across its bound: open, and the reason tells about how many replicates would decide
    in the interval           the printed value lies in the interval of ours, which is the easier the wider that is
    not comparable: WHY       ours is another thing than theirs; both are shown
    the name of a function    in the experiment's ``figures.py``: (runs, observations) -> (ours, whether the claim
                              holds, or None for open); ("-", None) where it finds no data

A quantity that is 0 or 1 in every row is a share, with Wilson's interval: 50 of 50 is not certain. What is to lie in a
range has the wider one of Student's interval and of that for skewed values, so that a mean outside of it is seldom
taken for one inside. A single replicate has no interval, and what needs one stays open.
"""

import csv
import io
import math
import os
import re
import textwrap
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field, ValidationInfo, field_validator

from cosim.arrays import Floats
from cosim.documents import read_text, validated
from cosim.errors import UserError
from cosim.experiment import experiment_folders
from cosim.report.estimates import seeds_of
from cosim.report.figures_module import MOST_LETTERS, call, question, shortened
from cosim.results import SweepDescription
from cosim.settings import Settings
from cosim.statistics.digits import digits
from cosim.statistics.equivalence import place
from cosim.statistics.intervals import CONFIDENCE, Estimate, cautious, estimate, interval

WIDTH = 110
"""Columns of a terminal that claims are wrapped to."""
ANSWER = "answer"
"""The column of a claim's rows that holds the value of its quantity."""
_COLUMNS = ("id", "paper", "section", "claim", "quantity", "where", "unit", "published", "test")
INTERVAL: Final = "in the interval"
"""The test that a true claim fails by chance once in twenty."""
LIMITS: Final = (
    "Limits of a comparison, such as 1.4 (1.3 to 1.6) or 12 % (at least 9 %), are one-sided at 95 %, as its test uses "
    "them: a lower and an upper one hold together in nine sweeps of ten. Those of a share beside a printed number, and "
    "what follows ±, are a 95 % interval."
)
"""What the numbers beside a mean are, for whoever reads a claim's answer."""
_IN_BRACKETS = re.compile(r"[0-9] to [-+.0-9e]+( %)?\)|\([^()]*\bat (least|most)\b")
_WITHIN = re.compile(r"within ([0-9]+(?:\.[0-9]+)?) ?%")
_OTHER = re.compile(r"not comparable: *(\S.*)")
_NO_TEST = (
    "is neither equal, within N %, at least, at most, in the interval, not comparable: WHY, "
    "nor a function in figures.py"
)


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

    @property
    def printed(self) -> str:
        """The printed value, with its unit."""
        return f"{self.published} {self.unit.removeprefix('1')}".strip()

    @field_validator("test")
    @classmethod
    def _known(cls, test: str) -> str:
        if not (_compares(test) or _OTHER.fullmatch(test) or test.isidentifier()):
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
    return test in ("equal", "at least", "at most", INTERVAL) or _WITHIN.fullmatch(test) is not None


class Verdict(NamedTuple):
    """A published claim with our answer."""

    id: str
    claim: str
    published: str
    ours: str
    verdict: str
    """holds, fails, open (neither is shown), not comparable, or no data"""
    reason: str
    """why, in one sentence"""
    test: str = ""
    """the test in published.csv"""

    def text(self) -> str:
        """Return the verdict for a terminal: the word, what was claimed, what was printed, our number, and why."""
        indent = " " * 7
        claim = f"{self.verdict:6s} {self.id}: {self.claim}"
        answer = f"published {self.published}; ours {self.ours}"
        lines = textwrap.wrap(claim, WIDTH, subsequent_indent=indent)
        for told in (answer, self.reason):
            lines += textwrap.wrap(told, WIDTH, initial_indent=indent, subsequent_indent=indent)
        return "\n".join(lines)


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
    other = _OTHER.fullmatch(claim.test)
    function = None if _compares(claim.test) or other else claim.test
    if function is not None and not callable(getattr(figures, function, None)):
        raise UserError(f"{claim.place}: {shortened(claim.id)}: test: {shortened(repr(function))} {_NO_TEST}")
    if runs.empty:
        return _verdict(claim, "-", "no data", "there are no runs")
    if function is not None:
        ours, holds = call(figures, function, runs, seen)
        return _answered(claim, ours, holds, question(figures, function))
    rows = next((rows for rows in (_rows(each, claim) for each in (runs, seen)) if rows is not None), None)
    missing = rows is None or rows.empty or rows[ANSWER].isna().all()
    if other and not claim.quantity:
        return _verdict(claim, "-", "not comparable", other[1])
    if rows is None or missing:
        asked = f" where {claim.where}" if claim.where else ""
        return _verdict(claim, "-", "no data", f"no run has a value of {claim.quantity or 'any quantity'}{asked}")
    if other:
        return _verdict(claim, str(interval(rows[ANSWER], seeds_of(rows))), "not comparable", other[1])
    single = claim.test == "equal"  # of every row: no share of them
    found = (estimate if single else interval)(rows[ANSWER], seeds_of(rows))
    holds, reason = _held(claim, rows, found)
    return _verdict(claim, str(found), _word(holds), reason)


def _verdict(claim: Claim, ours: str, word: str, reason: str) -> Verdict:
    return Verdict(claim.id, claim.claim, claim.printed, ours, word, reason, claim.test)


def _word(holds: bool | None) -> str:
    return "open" if holds is None else "holds" if holds else "fails"


def _answered(claim: Claim, ours: object, holds: bool | None, about: str) -> Verdict:
    """Return the verdict by what the function of *claim* answers; *about* is what that says of itself."""
    function = claim.test
    if ours == "-" and holds is None:
        return _verdict(claim, "-", "no data", f"{function} in figures.py finds no runs that it is about")
    said = "leaves it open" if holds is None else "finds that it holds" if holds else "finds that it does not hold"
    return _verdict(claim, str(ours), _word(holds), f"{function} in figures.py {said}{about and f': {about}'}")


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
    except Exception as error:  # pandas has no common type for what it raises about expressions; raised again below
        if column == "quantity" and isinstance(error, pd.errors.UndefinedVariableError):
            raise
        place, told = f"{claim.place}: {shortened(claim.id)}: {column}", shortened(error) or type(error).__name__
        raise UserError(f"{place}: {shortened(repr(expression))}: {told}") from None


def _held(claim: Claim, rows: pd.DataFrame, found: Estimate) -> tuple[bool | None, str]:
    """Return whether *claim* holds of its *rows*, whose mean is *found*, and why; None if they do not decide."""
    published, test = float(claim.published), claim.test
    if test == "equal":
        return _all_equal(rows[ANSWER].to_numpy(dtype=float), published)
    if not found.known:
        return None, "a single replicate has no interval"
    if test == INTERVAL:
        ends = f"the interval {digits(found.low, 4)} to {digits(found.high, 4)}"
        inside = found.low <= published <= found.high
        return inside, f"{published:g} lies {'in' if inside else 'outside'} {ends}, which says little if that is wide"
    within = _WITHIN.fullmatch(test)
    slack = abs(published) * float(within[1]) / 100 if within else 0.0
    low = -math.inf if test == "at most" else published - slack
    high = math.inf if test == "at least" else published + slack
    seeds = seeds_of(rows)
    found = cautious(rows[ANSWER], seeds)
    ends = f"the interval {digits(found.low, 4)} to {digits(found.high, 4)}"
    replicates = len(rows) if seeds is None else seeds[rows[ANSWER].notna()].nunique()
    placed = place(found, low, high, replicates)
    asked = f"{test} of {published:g}" if within else f"{test} {published:g}"
    if placed.within is not None:
        return placed.within, f"{'all' if placed.within else 'no part'} of {ends} is {asked}"
    return None, f"{ends} crosses the bound {digits(placed.bound, 4)} ({asked}); {_needs(placed.needed)}"


def _all_equal(values: Floats, published: float) -> tuple[bool, str]:
    same = np.isclose(values, published, rtol=1e-12, atol=0)
    if same.all():
        return True, f"each of the {len(values)} values is {published:g}"
    return False, f"{int((~same).sum())} of the {len(values)} values are not {published:g}"


def limits_told(verdicts: Iterable[Verdict]) -> bool:
    """Return whether an answer among *verdicts* has limits in brackets."""
    return any(_IN_BRACKETS.search(each.ours) for each in verdicts)


def _needs(replicates: int | None) -> str:
    if replicates is None:
        return "no number of replicates would decide, as the mean lies practically on it"
    return f"about {replicates} replicates would decide"


class Chance(NamedTuple):
    """How many claims fail, of those that were held against an interval, and what chance alone explains of it."""

    held: int
    failed: int
    expected: float
    """Failures of so many claims if all are true."""
    probability: float
    """Of so many failures or more, if all are true and independent."""

    def text(self) -> str:
        """Return it as a sentence."""
        count = f"{self.failed} of {self.held} claims {INTERVAL} fail"
        explained = f"chance alone fails {self.expected:.2g} of them if all are true"
        return f"{count}; {explained}, and {self.failed} or more with a probability of {self.probability:.2g}"


def chance(verdicts: Iterable[Verdict]) -> Chance | None:
    """Return what chance explains of the failures among *verdicts*; None if none was held against an interval."""
    words = [each.verdict for each in verdicts if each.test == INTERVAL and each.verdict in ("holds", "fails")]
    if not words:
        return None
    held, failed, rate = len(words), words.count("fails"), 1 - CONFIDENCE
    fewer = math.fsum(math.comb(held, k) * rate**k * (1 - rate) ** (held - k) for k in range(failed))
    return Chance(held, failed, held * rate, 1 - fewer)
