"""All experiments, one after the other, and one index over all claims of all papers.

    FOLDER/index.html   a row a claim: paper, section, experiment, published, ours, verdict, reason
    FOLDER/index.csv    the same
    FOLDER/NAME.html    the page of an experiment
    FOLDER/NAME/        its results, into which the next reproduction goes on

The verdicts of a whole sheet may be kept beside its published.csv, in ``verdicts.csv``: then the index of a quick one
lists where it says something else.
"""

import logging
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from cosim.errors import UserError
from cosim.experiment import experiment_folders, find_experiment, load_experiment
from cosim.report.claims import published_claims
from cosim.report.experiment_page import write_page
from cosim.report.index_page import index_page
from cosim.report.kept import KeptVerdict, csv_text, keep_verdicts, kept_verdicts
from cosim.report.page import VERDICTS
from cosim.report.sweep_report import report
from cosim.report.tried import Judged, Tried, index_rows
from cosim.sweep import Progress, run_sweep
from cosim.trace import drafted

_LOG: Final = logging.getLogger(__name__)


class Reproduction:
    """Experiments, run into one folder, and the index over their claims."""

    def __init__(self, names: Sequence[str], folder: Path, quick: bool, jobs: int | None) -> None:
        """Choose the experiments *names*, or all that are installed; raise UserError for one that is none."""
        paths = [find_experiment(name) for name in names]
        installed = {folder.resolve(): name for name, folder in experiment_folders().items()}
        chosen = {installed.get(at := path.resolve().parent, at.name): path for path in paths}
        if len(chosen) < len(set(paths)):
            raise UserError(f"{', '.join(map(str, paths))}: expected experiments in folders of different names")
        if not names:
            chosen = {name: at / "sweep.yaml" for name, at in experiment_folders().items()}
        self.folder = folder
        self.quick = quick
        self._jobs = jobs
        self.tried = {name: Tried(name, path) for name, path in chosen.items()}
        for each in self.tried.values():
            try:
                each.claims = published_claims(each.source.parent)
                each.whole = kept_verdicts(each.source.parent)
            except UserError as error:
                each.error = str(error)

    def make(self, name: str, progress: Progress) -> Tried:
        """Make the runs of the experiment *name* that are not there yet, its page, and the index so far.

        Whatever goes wrong in it becomes its error, and the others go on.
        """
        tried, folder = self.tried[name], self.folder / name
        try:
            tried.whole = kept_verdicts(tried.source.parent)
            experiment = load_experiment(tried.source, (), self.quick)
            summary = run_sweep(experiment, folder, self._jobs, progress=progress)
            tried.runs, tried.failed = summary.runs, len(summary.failures)
            made = report(folder)
            write_page(self.folder / f"{name}.html", folder, made)
            tried.claims, tried.made, tried.error = made.claims, made, ""
        except Exception as error:  # noqa: BLE001  # the others go on; it stands in the index, and the command fails
            kind = "" if isinstance(error, UserError) else f"{type(error).__name__}: "
            tried.error = " ".join(f"{kind}{error}".split())
            if not isinstance(error, UserError | OSError):  # a fault of this program: its place is not in the sentence
                _LOG.error("%s has failed\n\n%s", name, traceback.format_exc().rstrip())
        self.write_index()
        return tried

    def rows(self) -> list[Judged]:
        """Return the index: all claims, paper by paper."""
        return index_rows(self.tried.values())

    def write_index(self) -> None:
        """Write index.html and index.csv."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with drafted(self.folder / "index.html") as draft:
            draft.write_text(index_page(self.tried, self.quick), encoding="utf-8")
        with drafted(self.folder / "index.csv") as draft:
            draft.write_text(csv_text(Judged._fields, self.rows()), encoding="utf-8")

    def keep_verdicts(self) -> list[Path]:
        """Write the verdicts beside each published.csv, as those of its whole sheet; return the files."""
        files = []
        for each in self.tried.values():
            if each.made is None or each.made.sweep is None or not each.claims:
                continue
            sweep = each.made.sweep
            rows = [
                KeptVerdict(found.id, found.verdict, found.ours, str(sweep.replicates), sweep.code)
                for found in each.made.verdicts
            ]
            files.append(keep_verdicts(each.source.parent, rows))
        return files

    @property
    def failed(self) -> bool:
        """Whether an experiment has no report, or one of its runs failed."""
        return any(each.error or each.failed for each in self.tried.values())

    def text(self) -> str:
        """Return the totals for a terminal."""
        words = Counter(row.verdict for row in self.rows())
        lines = [f"{words[word]:5d} {word}" for word in VERDICTS if words[word]]
        other = sum(row.disagrees for row in self.rows())
        lines += [f"{other:5d} otherwise than the whole sheet"] if other else []
        return "\n".join([*lines, f"index: {self.folder / 'index.html'}"])

    def plain(self) -> dict[str, Any]:
        """Return all as plain data."""
        return {
            "experiments": [
                {"name": each.name, "runs": each.runs, "failed": each.failed, "error": each.error}
                for each in self.tried.values()
            ],
            "claims": [row._asdict() for row in self.rows()],
            "disagreeing": [f"{row.experiment}: {row.id}" for row in self.rows() if row.disagrees],
        }
