"""How far a claim depends on what a paper leaves open: the verdicts on an experiment's claims, choice by choice.

    cosim sweep experiments/aggregation_search/alternatives.yaml
    python -P -m cosim.report.by_choice results/aggregation_alternatives

It reads the results of a sweep with an axis ``choice`` and judges each claim of the published.csv beside that sweep for
the runs of each choice alone. claims_by_choice.csv and its picture go into the folder of the results. Claims about arms
that the sweep does not have are left out. With ``--keep`` the verdicts of a whole sheet go into variations.csv beside
the published.csv, from where ``cosim.report.claims_page`` takes them.

Where the runs of a choice alone do not do, a function ``of_choice`` in figures.py says which runs a claim is judged by:
(runs, choice, the claim's id) -> runs. It may lend a choice runs of another; a verdict that these give alone is that of
the other, and is not kept for the choice, too.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.errors import UserError
from cosim.experiment import experiment_folders
from cosim.report.claims import Verdict, judge, published_claims
from cosim.report.figures_module import load_figures
from cosim.report.kept import KeptVariation, check_whole, keep_variations
from cosim.report.saving import save
from cosim.results import RunStore, SweepDescription

COLOURS: Final = {"holds": "C0", "fails": "C1", "open": "0.8"}
"""Colours of the verdicts that are drawn: those of claims that are judged."""


def judged(runs: pd.DataFrame, experiment: Path | None) -> dict[str, list[Verdict]]:
    """Return the verdicts on the claims of the folder *experiment*, in their order, by choice.

    Claims that have no data with any choice are left out.
    """
    figures, claims = load_figures(experiment), published_claims(experiment)
    chosen = getattr(figures, "of_choice", _alone)
    found = {
        choice: [judge(each, chosen(runs, choice, each.id), pd.DataFrame(), figures) for each in claims]
        for choice in runs["choice"].astype(str).unique()
    }
    answered = {each.id for row in found.values() for each in row if each.verdict != "no data"}
    return {choice: [each for each in row if each.id in answered] for choice, row in found.items()}


def own(found: dict[str, list[Verdict]], runs: pd.DataFrame, experiment: Path | None) -> dict[str, list[Verdict]]:
    """Return those of the verdicts *found* by :func:`judged` to which *runs* of their own choice have added."""
    figures, claims = load_figures(experiment), {each.id: each for each in published_claims(experiment)}
    chosen = getattr(figures, "of_choice", _alone)

    def lent(choice: str, verdict: Verdict) -> bool:
        given = chosen(runs, choice, verdict.id)
        others = given[given["choice"].astype(str) != choice]
        return not others.empty and judge(claims[verdict.id], others, pd.DataFrame(), figures) == verdict

    return {choice: [each for each in row if not lent(choice, each)] for choice, row in found.items()}


def _alone(runs: pd.DataFrame, choice: str, claim: str) -> pd.DataFrame:
    return runs[runs["choice"].astype(str) == choice]


def _words(found: dict[str, list[Verdict]]) -> pd.DataFrame:
    return pd.DataFrame({choice: {each.id: each.verdict for each in row} for choice, row in found.items()})


def verdicts(runs: pd.DataFrame, experiment: Path | None) -> pd.DataFrame:
    """Return the words of :func:`judged`, a row a claim, a column a choice."""
    return _words(judged(runs, experiment))


def draw_verdicts(found: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the verdicts, a row a claim that is judged, a column a choice, into *folder*; nothing if there is none."""
    found = found[found.isin(list(COLOURS)).any(axis="columns")]
    if found.empty:
        return []
    figure = Figure(figsize=(4.0 + 0.34 * found.shape[1], 2.4 + 0.24 * found.shape[0]), layout="constrained")
    plot = figure.subplots()
    for word, colour in COLOURS.items():
        rows, columns = np.nonzero(found.to_numpy() == word)
        plot.plot(columns, rows, "s", markersize=11, color=colour, label=word)
    plot.set_xticks(range(found.shape[1]), list(found.columns), rotation=60, ha="right", fontsize="small")
    plot.set_yticks(range(found.shape[0]), [name.replace("_", " ") for name in found.index], fontsize="small")
    plot.set_xlim(-0.6, found.shape[1] - 0.4)
    plot.set_ylim(found.shape[0] - 0.4, -0.6)
    figure.legend(*plot.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize="small")
    path = folder / "claims_by_choice.png"
    save(figure, path)
    return [path]


def main(words: Sequence[str] | None = None) -> None:
    """Print and write the verdicts on the results that the words of the command line name."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--keep", action="store_true", help="keep them beside the published.csv, in variations.csv")
    given = parser.parse_args(words)
    folder: Path = given.results
    try:
        sweep, runs, source = _read(folder)
        if given.keep:
            check_whole(folder, sweep, len(runs))
        done = runs[runs["status"] == "done"]
        found = judged(done, source)
        written = [_kept(sweep, own(found, done, source), source)] if given.keep and source else []
    except UserError as error:
        parser.exit(2, f"{error}\n")
    table = _words(found)
    table.to_csv(folder / "claims_by_choice.csv")
    print(f"claims by choice\n\n{table.to_string()}\n")
    print(folder / "claims_by_choice.csv", *draw_verdicts(table, folder), *written, sep="\n")


def _read(folder: Path) -> tuple[SweepDescription, pd.DataFrame, Path | None]:
    """Return the sweep in *folder*, its runs, and the experiment's folder; raise UserError for what is wrong."""
    store = RunStore(folder)
    sweep, runs = store.description(), store.present()
    if "choice" not in runs:
        raise UserError(f"{folder}: the sweep has no axis choice")
    source = Path(sweep.source).parent
    return sweep, runs, source if source.is_dir() else experiment_folders().get(source.name)


def _kept(sweep: SweepDescription, found: dict[str, list[Verdict]], experiment: Path) -> Path:
    """Write the verdicts *found* of *sweep* beside the published.csv in *experiment*; return the file."""
    sheet = Path(sweep.source).stem
    rows = [
        KeptVariation(sheet, choice, each.id, each.verdict, each.ours, str(sweep.replicates), sweep.code)
        for choice, row in found.items()
        for each in row
        if each.verdict != "no data"
    ]
    return keep_variations(experiment, sheet, rows)


if __name__ == "__main__":
    main()
