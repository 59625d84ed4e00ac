"""What became of each experiment of a reproduction, and of each claim."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from cosim.report.claims import Claim, Verdict
from cosim.report.kept import KeptVerdict
from cosim.report.page import UNDECIDED
from cosim.report.sweep_report import Report


class Judged(NamedTuple):
    """A row of the index: a claim of a published.csv and what became of it."""

    paper: str
    section: str
    experiment: str
    id: str
    claim: str
    published: str
    ours: str
    verdict: str
    reason: str
    whole: str
    """The verdict that is kept of a whole sheet; empty if none is."""

    @property
    def disagrees(self) -> bool:
        """Whether the verdict is another than that of the whole sheet, and not for want of runs."""
        return bool(self.whole) and self.verdict not in UNDECIDED and self.verdict != self.whole


@dataclass
class Tried:
    """What became of one experiment."""

    name: str
    source: Path
    """Its sweep.yaml."""
    claims: list[Claim] = field(default_factory=list)
    whole: dict[str, KeptVerdict] = field(default_factory=dict)
    """The verdicts that are kept of a whole sheet, by the ids of claims."""
    made: Report | None = None
    runs: int = 0
    failed: int = 0
    error: str = "was not run"
    """Why there is no report; empty if there is one."""

    def rows(self) -> list[Judged]:
        """Return a row for each claim, with or without a report."""
        return [
            Judged(
                *(claim.paper, claim.section, self.name, claim.id, claim.claim, found.published, found.ours),
                *(found.verdict, found.reason, self.whole[claim.id].verdict if claim.id in self.whole else ""),
            )
            for claim, found in zip(self.claims, self.verdicts(), strict=True)
        ]

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts on the claims; without a report there are no data, for the reason that there is none."""
        if self.made:
            return self.made.verdicts
        return [Verdict(each.id, each.claim, each.published, "-", "no data", self.error) for each in self.claims]

    def line(self) -> str:
        """Return what became of it in a line."""
        if self.error:
            return f"{self.name}: {self.error}"
        words = [each.verdict for each in self.rows()]
        counted = ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words)) or "no claims"
        return f"{self.name}: {self.runs} runs, {self.failed} of them failed; {counted}"


def index_rows(tried: Iterable[Tried]) -> list[Judged]:
    """Return the index: all claims, paper by paper."""
    rows = [row for each in tried for row in each.rows()]
    return sorted(rows, key=lambda row: (not row.paper[:1].isdigit(), row.paper))  # stable: as they stand in a file
