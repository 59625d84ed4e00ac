"""How far a claim depends on what a paper leaves open: the verdicts on an experiment's claims, choice by choice.

    cosim sweep experiments/aggregation_search/alternatives.yaml
    python -P -m cosim.report.by_choice results/aggregation_alternatives

It reads the results of a sweep with an axis ``choice`` and judges each claim of the published.csv beside that sweep for
the runs of each choice alone. claims_by_choice.csv and its picture go into the folder of the results. Claims about arms
that the sweep does not have are left out.
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
from cosim.report.claims import judge, published_claims
from cosim.report.figures_module import load_figures
from cosim.report.saving import save
from cosim.results import RunStore

COLOURS: Final = {"holds": "C0", "fails": "C1", "open": "0.8", "not comparable": "0.9"}
"""Colours of the verdicts that are drawn."""


def verdicts(runs: pd.DataFrame, experiment: Path | None) -> pd.DataFrame:
    """Return the verdict on each claim of the folder *experiment*, a row each, by choice, a column each.

    Claims that have no data with any choice are left out.
    """
    figures = load_figures(experiment)
    rows = {}
    for claim in published_claims(experiment):
        row = {
            str(choice): judge(claim, part, pd.DataFrame(), figures).verdict
            for choice, part in runs.groupby("choice", sort=False)
        }
        if set(row.values()) - {"no data"}:
            rows[claim.id] = row
    return pd.DataFrame.from_dict(rows, orient="index")


def draw_verdicts(found: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the verdicts, a row a claim, a column a choice, into *folder*."""
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
    folder: Path = parser.parse_args(words).results
    try:
        found = _judged(folder)
    except UserError as error:
        parser.exit(2, f"{error}\n")
    table = folder / "claims_by_choice.csv"
    found.to_csv(table)
    print(f"claims by choice\n\n{found.to_string()}\n")
    print(table, *draw_verdicts(found, folder), sep="\n")


def _judged(folder: Path) -> pd.DataFrame:
    """Return the verdicts on the results in *folder*; raise UserError for what is wrong with them."""
    store = RunStore(folder)
    runs = store.present()
    source = Path(store.description().source).parent
    if "choice" not in runs:
        raise UserError(f"{folder}: the sweep has no axis choice")
    return verdicts(
        runs[runs["status"] == "done"], source if source.is_dir() else experiment_folders().get(source.name)
    )


if __name__ == "__main__":
    main()
