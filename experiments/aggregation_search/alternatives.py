"""How far the answers depend on what paper 002 leaves open: the claims of a search's published.csv, choice by choice.

    cosim sweep experiments/aggregation_search/alternatives.yaml
    python -P -m experiments.aggregation_search.alternatives results/aggregation_alternatives

It reads the results of a sweep with an axis ``choice``, of this experiment or of a sister that has one, and judges each
claim for the runs of each choice alone. Into the folder of the results go claims_by_choice.csv and its picture. Claims
about arms that the sweep does not have are left out.
"""

import argparse
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import pandas as pd

from cosim.report import judge
from cosim.results import RunStore
from experiments.reflection_tables.alternatives import draw_verdicts
from experiments.reflection_tables.figures import claims


def verdicts(runs: pd.DataFrame, experiment: str) -> pd.DataFrame:
    """Return the verdict on each claim of *experiment*, a row each, by choice, a column each; those with data."""
    module = import_module(f"experiments.{experiment}.figures")
    rows = {}
    for claim in claims(experiment):
        row = {
            str(choice): judge(claim, part, pd.DataFrame(), module).verdict
            for choice, part in runs.groupby("choice", sort=False)
        }
        if set(row.values()) - {"no data"}:
            rows[claim.id] = row
    return pd.DataFrame.from_dict(rows, orient="index")


def main(words: Sequence[str] | None = None) -> None:
    """Print and write the verdicts on the results that the words of the command line name."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path)
    folder: Path = parser.parse_args(words).results
    store = RunStore(folder)
    runs = store.present()
    found = verdicts(runs[runs["status"] == "done"], Path(store.description().source).parent.name)
    table = folder / "claims_by_choice.csv"
    found.to_csv(table)
    print(f"claims by choice\n\n{found.to_string()}\n")
    print(table, *draw_verdicts(found, folder), sep="\n")


if __name__ == "__main__":
    main()
