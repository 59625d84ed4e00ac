"""One page about all claims of all papers: the verdict on each, by other choices too, and what decides it.

The page is ``docs/claims.md``. After a change of a published.csv, or of what is kept beside one
(``cosim.report.kept``), it is made anew:

    python -P -m cosim.report.claims_page > docs/claims.md
"""

import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from cosim.experiment import experiment_folders
from cosim.report.claims import LIMITS, Claim, published_claims
from cosim.report.kept import (
    KINDS,
    Decides,
    KeptChance,
    KeptVariation,
    KeptVerdict,
    kept_chance,
    kept_variations,
    kept_verdicts,
    known_causes,
)
from cosim.report.page import VERDICTS

NOT_RUN: Final = "not run whole"
"""The word of a claim of which no verdict is kept."""
WORDS: Final = (*VERDICTS, NOT_RUN)
TO_EXPLAIN: Final = ("fails", "open")
"""Verdicts of which a reader asks why."""
NOT_KNOWN: Final = "not known"
PAPERS: Final = {
    "000": "Sgorbissa and Arkin, *Local navigation strategies for a team of robots*",
    "001": "Lau, *Behavioural approach for multi-robot exploration*",
    "002": "Meng, Nickerson and Gan, *Multi-robot aggregation strategies with limited communication*",
    "003": "Raghavan and Ravindran, *Profiling Pseudonet architecture for coordinating mobile robots*",
    "004": "Simmons et al., *Coordinated deployment of multiple, heterogeneous robots*",
}
"""What the papers that this program implements are called."""
MOST_OF_A_CLAIM: Final = 160
"""Letters of a claim that the page shows: its beginning, which is the paper's, and its end, which is the case."""
MOST_OF_A_VALUE: Final = 56
"""Letters of a value, printed or ours, that the page shows."""
MOST_NAMED: Final = 4
"""Choices with one verdict that are named one by one."""
INTRODUCTION: Final = f"""\
# All claims

Made from the experiments by `python -P -m cosim.report.claims_page > docs/claims.md`; do not edit.

A claim is a sentence or a number of a paper that a run can answer: a row of the `published.csv` of an experiment, with
a test that was written down before the first whole sweep. The verdict is that of the whole sweep, under the paper's
words as the experiment reads them:

- *holds*, *fails*: shown, or refuted, by the test; *fails* may also mean that a proof was asked for and did not come;
- *open*: the runs do not decide, or the row is a question to which there is no printed answer;
- *not comparable*: ours is another thing than theirs, and both are shown;
- *no data*: no run is about it; *not run whole*: no verdict of a whole sweep is kept yet.

{LIMITS}

Claims and values are shortened here; `published.csv` and `verdicts.csv` of the experiment have all of them. *Other
choices* are verdicts on the same claim where something that the paper leaves open is chosen otherwise; where a choice
of this project has been changed, the old one is among them. *Decided by* is told only where the experiment's README,
or a review of it with runs of its own, says so. It is one of these, or *not known*:

"""
CHANCE: Final = """\
## How many verdicts chance would turn

Replicates of each sweep are drawn again with replacement, and its claims judged anew (`cosim.report.by_chance`; the
verdicts *not comparable* and *no data* are left out). Expected is how many verdicts a draw turns on average. A fresh
sweep would turn somewhat more: drawn means of n replicates vary by (n - 1) / n of the variance of fresh ones.
"""
"""The beginning of the section about draws."""


class Row(NamedTuple):
    """A claim with all that is known of it."""

    experiment: str
    claim: Claim
    kept: KeptVerdict | None
    variations: list[KeptVariation]
    cause: Decides | None

    @property
    def word(self) -> str:
        """The verdict of the whole sheet."""
        return self.kept.verdict if self.kept else NOT_RUN

    @property
    def decided_by(self) -> str:
        """The kind of what decides it, or that this is not known; nothing where nobody asks."""
        if self.cause and self.cause.decides:
            return self.cause.decides
        return NOT_KNOWN if self.word in TO_EXPLAIN else ""


def rows_of(folders: Mapping[str, Path]) -> list[Row]:
    """Return a row for each claim of the experiments in *folders*, by their names: paper by paper."""
    found = []
    for name, folder in sorted(folders.items()):
        kept, causes, variations = kept_verdicts(folder), known_causes(folder), kept_variations(folder)
        for claim in published_claims(folder):
            ours = [row for row in variations if row.id == claim.id]
            found.append(Row(name, claim, kept.get(claim.id), ours, causes.get(claim.id)))
    return sorted(found, key=lambda row: (row.claim.paper not in PAPERS, row.claim.paper))  # stable


def page(folders: Mapping[str, Path]) -> str:
    """Return the page, in Markdown, about the claims of the experiments in *folders*, by their names."""
    rows = rows_of(folders)
    papers = list(dict.fromkeys(row.claim.paper for row in rows))
    asked = [row for row in rows if row.word in TO_EXPLAIN]
    sections = [
        INTRODUCTION + "".join(f"- *{kind}*: {meaning}.\n" for kind, meaning in KINDS.items()),
        "## Counts\n",
        _counts(rows, papers, WORDS, lambda row: row.word),
        "What decides those that fail or are open:\n",
        _counts(asked, papers, (*KINDS, NOT_KNOWN), lambda row: row.decided_by),
        *_turned_by_chance({name: kept_chance(folder) for name, folder in sorted(folders.items())}),
        *(_paper(paper, [row for row in rows if row.claim.paper == paper], folders) for paper in papers),
    ]
    return "\n".join(sections)


def _counts(rows: Sequence[Row], papers: Sequence[str], words: Sequence[str], word: Callable[[Row], str]) -> str:
    """Return how many of *rows* have which of *words*, paper by paper and in all."""
    lines = []
    for name, ours in [*((each, [row for row in rows if row.claim.paper == each]) for each in papers), ("all", rows)]:
        found = Counter(map(word, ours))
        if ours:
            lines.append([_called(name), *(str(found[each] or "") for each in words), str(len(ours))])
    return _grid(["source", *words, "claims"], lines)


def _turned_by_chance(kept: Mapping[str, Sequence[KeptChance]]) -> list[str]:
    """Return the section on verdicts that chance would turn, by what is *kept* of each experiment, if anything is."""
    told = {name: [float(row.turned) for row in rows] for name, rows in kept.items()}
    told["all"] = [share for shares in told.values() for share in shares]
    lines = [
        [name, str(len(shares)), f"{sum(shares):.1f}", f"{100 * sum(shares) / len(shares):.1f} %"]
        for name, shares in told.items()
        if shares
    ]
    head = ["experiment", "rows judged", "expected to turn", "share"]
    return [CHANCE, _grid(head, lines)] if lines else []


def _called(paper: str) -> str:
    return f"paper {paper}" if paper in PAPERS else paper


def _paper(paper: str, rows: Sequence[Row], folders: Mapping[str, Path]) -> str:
    head = f"## Paper {paper}\n\n{PAPERS[paper]}.\n" if paper in PAPERS else f"## {_called(paper)}\n"
    names = dict.fromkeys(row.experiment for row in rows)
    return "\n".join([head, *(_experiment([r for r in rows if r.experiment == name], folders[name]) for name in names)])


def _experiment(rows: Sequence[Row], folder: Path) -> str:
    """Return the section of an experiment with its *rows*, all of one paper."""
    varied = any(row.variations for row in rows)
    columns = ["claim", "published", "ours", "verdict", *(["other choices"] if varied else []), "decided by"]
    lines = [
        [
            f"{_brief(row.claim.claim)}{_place(row.claim)}",
            _value(row.claim.printed),
            _value(row.kept.ours) if row.kept else "",
            row.word,
            *([_by_choice(row.variations)] if varied else []),
            f"*{row.decided_by}*: {row.cause.left}" if row.cause and row.cause.left else row.decided_by,
        ]
        for row in rows
    ]
    return f"### {rows[0].experiment}\n\n{_runs(rows, folder, varied)}\n\n{_grid(columns, lines)}"


def _runs(rows: Sequence[Row], folder: Path, varied: bool) -> str:
    """Return which runs the verdicts on *rows* are of, and what is not there."""
    words = Counter(row.word for row in rows)
    told = ", ".join(f"{words[word]} {word}" for word in WORDS if words[word])
    sizes = sorted({int(row.kept.replicates) for row in rows if row.kept})
    of = f", of {' or '.join(map(str, sizes))} replicates" if sizes else ""
    missing = not varied and (folder / "alternatives.yaml").is_file()
    other = " Verdicts by other choices (`alternatives.yaml`) are not kept yet." if missing else ""
    return f"{told}{of}; choices and reasons are in `{_place_of(folder)}/README.md`.{other}"


def _place_of(folder: Path) -> str:
    """Return the path of the *folder* of an experiment within the project."""
    since = max((number for number, part in enumerate(folder.parts) if part == "experiments"), default=-1)
    return "/".join(folder.parts[since:])


def _place(claim: Claim) -> str:
    return f" ({claim.section}; `{claim.id}`)" if claim.section else f" (`{claim.id}`)"


def _brief(text: str) -> str:
    """Return *text* without its middle, if it is long."""
    if len(text) <= MOST_OF_A_CLAIM:
        return text
    half = MOST_OF_A_CLAIM // 2
    first, last = text[:half].rsplit(" ", 1)[0], text[-half:].split(" ", 1)[-1]
    return f"{first} … {last}"


def _value(text: str) -> str:
    return textwrap.shorten(text, MOST_OF_A_VALUE, placeholder=" …")


def _by_choice(variations: Iterable[KeptVariation]) -> str:
    """Return the verdicts by other choices, those with one verdict together; ours, where nothing is judged."""
    names: dict[str, list[str]] = {}
    for row in variations:
        name = f'"{row.variation}"' if ", " in row.variation else row.variation  # it stands in a list
        if row.verdict == "not comparable":  # the word says nothing without ours
            name += f" ({_value(row.ours)})"
        names.setdefault(row.verdict, []).append(name)
    total = sum(map(len, names.values()))
    return "; ".join(
        f"{word} with {len(found)} of {total}" if len(found) > MOST_NAMED else f"{word}: {', '.join(found)}"
        for word, found in sorted(names.items(), key=lambda item: VERDICTS.index(item[0]))
    )


def _grid(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    shown = [head, ["---"] * len(head), *([_escaped(cell) for cell in line] for line in lines)]
    return "".join(f"| {' | '.join(line)} |\n" for line in shown)


def _escaped(cell: str) -> str:
    return " ".join(cell.replace("|", "/").replace("<", "&lt;").split())


if __name__ == "__main__":
    print(page(experiment_folders()), end="")
