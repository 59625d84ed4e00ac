"""How far the answers depend on what the paper leaves open: claims, and what helpers save, choice by choice.

    cosim sweep experiments/reflection_tables/alternatives.yaml
    python -P -m experiments.reflection_tables.alternatives results/reflection_alternatives

It reads the results of a sweep with an axis ``choice``, of this experiment or of a sister that has one, and judges the
claims of that experiment's published.csv for each choice alone. Into the folder of the results go claims_by_choice.csv
and its picture, and for this experiment savings_by_choice.csv, beside what the paper's robots save, and its picture.
"""

import argparse
import math
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cosim.report import by_choice
from cosim.report.comparison import Arm, by_replicate, confidence_limits, saving
from cosim.report.saving import save
from cosim.results import RunStore
from experiments.reflection.choices import AXES, MANY
from experiments.reflection.tables import ALGORITHMS, FLOORS, LEAST, NAMES, SIZES, STEPS, cells

FEW: Final = "smallest"


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables of the results that the words of the command line name, and write them and their pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path)
    folder: Path = parser.parse_args(words).results
    store = RunStore(folder)
    runs = store.present()
    done = runs[runs["status"] == "done"]
    found = verdicts(done, Path(store.description().source).parent.name)
    written = [folder / "claims_by_choice.csv", *by_choice.draw_verdicts(found, folder)]
    found.to_csv(written[0])
    print(f"claims by choice\n\n{found.to_string()}\n")
    if "team" in done:
        written += [folder / "savings_by_choice.csv", *draw(done, pd.DataFrame(), folder)]
        savings(done).to_csv(folder / "savings_by_choice.csv", index=False)
        for title, table in tables(done, pd.DataFrame()).items():
            print(f"{title}\n\n{table.to_string(index=False)}\n")
    print(*written, sep="\n")


# ---------------------------------------------------------------- claims


def verdicts(runs: pd.DataFrame, experiment: str) -> pd.DataFrame:
    """Return the verdict on each claim of *experiment*, a row each, by choice, a column each; those that are judged."""
    found = by_choice.verdicts(runs, Path(__file__).parent.parent / experiment)
    return found[found.isin(["holds", "fails"]).any(axis=1)]


# ---------------------------------------------------------------- what helpers save


def savings(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each choice, floor and algorithm that it concerns; shares in per cent, NaN where not known.

    ``saved`` is the mean of what four robots save against the smallest team that the paper has a number for, target
    set by target set; ``at_least`` and ``at_most`` are its one-sided 95 % limits; ``published`` is what the paper's
    save.
    """
    if runs.empty or not {*AXES, "replicate", "steps", "given_up"} <= set(runs):
        return pd.DataFrame()
    rows = [
        row
        for choice in runs["choice"].unique()
        for floor in FLOORS
        for algorithm in ALGORITHMS
        if (row := _row(runs, str(choice), floor, algorithm))
    ]
    return pd.DataFrame(rows)


def _row(runs: pd.DataFrame, choice: str, floor: str, algorithm: str) -> dict[str, Any]:
    few, many = (_arm(choice, floor, algorithm, team) for team in (FEW, MANY))
    found = confidence_limits(saving(runs, many, few, STEPS))
    if not found.size:
        return {}
    row: dict[str, Any] = {"choice": choice, "floor": floor, "algorithm": algorithm, "robots": LEAST[algorithm]}
    row |= {"published": 100 * published(floor, algorithm), "sets": found.size}
    row |= {"saved": 100 * found.mean, "at_least": 100 * found.lower, "at_most": 100 * found.upper}
    for name, arm in ((FEW, few), (MANY, many)):
        row[f"steps_{name}"] = float(by_replicate(runs, arm, STEPS).mean())
        row[f"given_up_{name}"] = 100 * float(by_replicate(runs, arm, "given_up").mean())
    return row


def _arm(choice: str, floor: str, algorithm: str, team: str) -> Arm:
    return dict(zip(AXES, (choice, floor, algorithm, team), strict=True))


def published(floor: str, algorithm: str) -> float:
    """Return which share of the steps four robots save in the paper, against the smallest team with a number."""
    printed = {each.robots: each.steps for each in cells() if (each.floor, each.algorithm) == (floor, algorithm)}
    return 1 - printed[SIZES[-1]] / printed[LEAST[algorithm]]


def tables(runs: pd.DataFrame, observations: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return what four robots save, a row a choice and floor, a column an algorithm, for people to read."""
    found = savings(runs)
    if found.empty:
        return {}
    rows = []
    for (choice, floor), part in found.groupby(["choice", "floor"], sort=False):
        by_name = {each["algorithm"]: each for each in part.to_dict("records")}
        row: dict[str, Any] = {"choice": choice, "floor": floor}
        for name in ALGORITHMS:
            row[name] = _told(by_name[name]) if name in by_name else "-"
        rows.append(row)
    theirs = [
        {"choice": "paper", "floor": floor} | {name: f"{100 * published(floor, name):.0f} %" for name in ALGORITHMS}
        for floor in FLOORS
    ]
    title = (
        "saved by four robots against R1 (potential field: R1,2), at least (one-sided 95 %); given up before > after"
    )
    return {title: pd.DataFrame([*theirs, *rows])}


def _told(row: dict[Hashable, Any]) -> str:
    least = "" if math.isnan(row["at_least"]) else f" (>= {row['at_least']:.0f})"
    return f"{row['saved']:.0f} %{least}; {row[f'given_up_{FEW}']:.0f} > {row[f'given_up_{MANY}']:.0f} %"


def draw(runs: pd.DataFrame, observations: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what is saved by choice, a panel a floor and algorithm, with what the paper's robots save as a line."""
    found = savings(runs)
    if found.empty:
        return []
    choices = list(found["choice"].unique())
    places = {choice: -rank for rank, choice in enumerate(choices)}
    figure = Figure(figsize=(13.0, 2.4 + 0.5 * len(choices)), layout="constrained")
    plots = figure.subplots(len(FLOORS), len(ALGORITHMS), sharex=True, sharey=True, squeeze=False)
    for line, floor in zip(plots, FLOORS, strict=True):
        for plot, name in zip(line, ALGORITHMS, strict=True):
            _panel(plot, found[(found["floor"] == floor) & (found["algorithm"] == name)], places)
            theirs = 100 * published(floor, name)
            plot.axvline(theirs, linestyle="--", color="C3", linewidth=1.2, label=f"paper: {theirs:.0f} %")
            plot.set_title(f"{floor} floor, {NAMES[name]}", fontsize="medium")
            plot.legend(fontsize="x-small", loc="upper left")
            plot.grid(alpha=0.3)
        line[0].set_yticks(list(places.values()), choices, fontsize="small")
    for plot in plots[-1]:
        plot.set_xlabel("% of the steps saved by four robots")
    plots[0][0].set_xlim(-105, 105)  # the limits of few sets may lie far outside
    path = folder / "savings_by_choice.png"
    save(figure, path)
    return [path]


def _panel(plot: Any, rows: pd.DataFrame, places: dict[str, int]) -> None:
    plot.axvline(0, color="0.4", linewidth=0.8)
    heights = [places[choice] for choice in rows["choice"]]
    spread = np.nan_to_num([rows["saved"] - rows["at_least"], rows["at_most"] - rows["saved"]])
    plot.errorbar(rows["saved"], heights, xerr=spread, fmt="o", markersize=4, capsize=2, color="C0")


if __name__ == "__main__":
    main()
