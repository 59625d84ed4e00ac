"""What is kept beside an experiment's published.csv: verdicts of whole sheets, and what decides them.

verdicts.csv      the verdict on each claim by the runs of sweep.yaml; ``cosim reproduce --keep`` writes it
variations.csv    the verdict on each claim by each choice of another sheet, such as alternatives.yaml;
                  ``python -P -m cosim.report.by_choice RESULTS --keep`` writes it
chance.csv        how often the verdict on each claim turns if the replicates of sweep.yaml are drawn again;
                  ``python -P -m cosim.report.by_chance RESULTS --keep`` writes it
decides.csv       what decides a claim, as far as it is known, and what is left to find out; people write it
"""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from cosim.documents import read_text
from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.results import SweepDescription
from cosim.trace import drafted

VERDICTS_FILE: Final = "verdicts.csv"
VARIATIONS_FILE: Final = "variations.csv"
CHANCE_FILE: Final = "chance.csv"
DECIDES_FILE: Final = "decides.csv"


class KeptVerdict(NamedTuple):
    """A row of verdicts.csv."""

    id: str
    """of the claim"""
    verdict: str
    ours: str
    replicates: str
    code: str
    """the digests of the code that made the runs"""


class KeptVariation(NamedTuple):
    """A row of variations.csv."""

    sheet: str
    """the sweep's file, without its ending"""
    variation: str
    """a value of its axis ``choice``"""
    id: str
    verdict: str
    ours: str
    replicates: str
    code: str


class KeptChance(NamedTuple):
    """A row of chance.csv."""

    id: str
    """of the claim"""
    verdict: str
    """of the runs as they are"""
    turned: str
    """the share of the draws that have another one"""
    other: str
    """the one that most of those have; empty if there are none"""
    draws: str


class Decides(NamedTuple):
    """A row of decides.csv."""

    id: str
    decides: str
    """one of KINDS; empty if it is not known"""
    left: str
    """one sentence on what decides it, and what is left to find out"""


KINDS: Final = {
    "input": "something that the paper does not print and that was chosen here: a floor, a speed, a range, a limit",
    "reading": "how the paper's words are turned into a rule or into a test",
    "statistics": "the number of runs: what is there is too little to show it",
    "paper": "the paper itself: it prints no answer, or states what a closed form or a specification contradicts",
}
"""What may decide a verdict, and what that means."""


def kept_verdicts(folder: Path) -> dict[str, KeptVerdict]:
    """Return the verdicts that are kept in *folder* of the whole sheet, if they are, by the ids of claims."""
    return {row[0]: KeptVerdict(*row) for row in _read(folder / VERDICTS_FILE, KeptVerdict._fields)}


def kept_variations(folder: Path) -> list[KeptVariation]:
    """Return the verdicts that are kept in *folder* of its other sheets, choice by choice."""
    return [KeptVariation(*row) for row in _read(folder / VARIATIONS_FILE, KeptVariation._fields)]


def kept_chance(folder: Path) -> list[KeptChance]:
    """Return how often the verdicts of the whole sheet turn, as it is kept in *folder*."""
    return [KeptChance(*row) for row in _read(folder / CHANCE_FILE, KeptChance._fields)]


def known_causes(folder: Path) -> dict[str, Decides]:
    """Return what decides the claims in *folder*, by their ids; raise UserError for a word that is not in KINDS."""
    path = folder / DECIDES_FILE
    rows = [Decides(*row) for row in _read(path, Decides._fields)]
    for row in rows:
        if row.decides and row.decides not in KINDS:
            raise UserError(f"{path}: {row.id}: decides: {row.decides!r} is none of {', '.join(KINDS)}")
    return {row.id: row for row in rows}


def keep_verdicts(folder: Path, rows: Iterable[KeptVerdict]) -> Path:
    """Write verdicts.csv into *folder*; return its path."""
    return _write(folder / VERDICTS_FILE, KeptVerdict._fields, rows)


def keep_variations(folder: Path, sheet: str, rows: Iterable[KeptVariation]) -> Path:
    """Write variations.csv into *folder*, *rows* in place of those that were kept of that *sheet*; return its path."""
    others = [row for row in kept_variations(folder) if row.sheet != sheet]
    written = sorted([*others, *rows], key=lambda row: row.sheet)  # stable: within a sheet as they were made
    return _write(folder / VARIATIONS_FILE, KeptVariation._fields, written)


def keep_chance(folder: Path, rows: Iterable[KeptChance]) -> Path:
    """Write chance.csv into *folder*; return its path."""
    return _write(folder / CHANCE_FILE, KeptChance._fields, rows)


def check_whole(folder: Path, sweep: SweepDescription, runs: int) -> None:
    """Raise UserError unless the *runs* in *folder*, so many, are all that the sheet of *sweep* asks for now."""
    sheet = load_experiment(Path(sweep.source))
    arms = tuple(arm.configuration for arm in sheet.arms)
    if arms != sweep.configurations or sweep.replicates < sheet.replicates or runs < sweep.runs:
        raise UserError(f"{folder}: --keep: keeps the verdicts of whole sheets, this is not all of {sweep.source}")


def csv_text(names: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV."""
    file = io.StringIO(newline="")
    csv.writer(file, lineterminator="\n").writerows([names, *rows])
    return file.getvalue()


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    with drafted(path) as draft:
        draft.write_text(csv_text(names, rows), encoding="utf-8")
    return path


def _read(path: Path, names: Sequence[str]) -> list[list[str]]:
    """Return the rows of the table in *path*, none if there is no such file; raise UserError if it is another one."""
    if not path.is_file():
        return []
    rows = csv.DictReader(io.StringIO(read_text(path), newline=""))
    if tuple(rows.fieldnames or ()) != tuple(names):
        raise UserError(f"{path}: expected the columns {', '.join(names)}")
    table = []
    for row in rows:
        if None in row or None in row.values():
            raise UserError(f"{path}: line {rows.line_num}: expected {len(names)} cells")
        table.append([row[name] for name in names])
    return table
