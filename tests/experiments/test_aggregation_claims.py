"""The tests that the published.csv of paper 002's searches name: each holds, fails and stays open when it should."""

import csv
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from experiments.aggregation_channels import figures as channels
from experiments.aggregation_laboratory import figures as laboratory
from experiments.aggregation_scaling import figures as scaling
from experiments.aggregation_search import figures as search
from tests.checkout import EXPERIMENTS

MODULES = {
    "aggregation_search": search,
    "aggregation_laboratory": laboratory,
    "aggregation_scaling": scaling,
    "aggregation_channels": channels,
}
NONE = pd.DataFrame()
REPLICATES = 30
Row = dict[str, Any]
STRATEGIES = ("srp", "mrp", "mi", "mito", "random")


def claims(name: str) -> list[dict[str, str]]:
    with (EXPERIMENTS / name / "published.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


ROWS = [(name, row["test"]) for name in MODULES for row in claims(name)]
BY_SCATTER = "varies_least"
"""Has a test of its own: in the runs below the scatter goes with the mean."""


def answer(name: str, test: str, runs: pd.DataFrame) -> tuple[str, bool | None]:
    found: tuple[str, bool | None] = getattr(MODULES[name], test)(runs, NONE)
    return found


def sweep(axes: dict[str, tuple[Any, ...]], row: Callable[[Row], Row], replicates: int = REPLICATES) -> pd.DataFrame:
    """Return the runs of a sweep: *row* says what an arm's metrics are; times and costs scatter alike in all arms."""
    rows = []
    for replicate in range(replicates):
        luck = 1.0 + 0.2 * np.sin(replicate)
        for values in product(*axes.values()):
            arm = dict(zip(axes, values, strict=True))
            noise = 1.0 + 0.01 * np.sin(7 * replicate + 3 * len(rows))
            metrics = {key: value * luck * noise for key, value in row(arm).items()}
            rows.append(arm | {"replicate": replicate, "completed": 1.0} | metrics)
    return pd.DataFrame(rows)


# What the paper claims, and the contrary of it, as metrics of an arm.

COSTS = {"srp": 5.0, "mrp": 4.0, "mi": 2.0, "mito": 1.5, "random": 6.0}


def costs(strategy: str, sign: int = 1) -> Row:
    driven = 1000.0 * COSTS[strategy] ** sign
    said = 1e5 / driven
    joules = {"motion_j": 100 * driven, "radio_j": 3 * driven if sign == 1 else 30 * driven, "energy_j": 103 * driven}
    sent = {"payload_bytes": 1e6 * said, "frames": 1e4 * said}
    return {"distance_m": driven, "distance_after_m": driven / 10} | joules | sent


def lasted(minutes: float) -> Row:
    return {"search_time_min": minutes, "simulated_s": 60.0 * minutes}


def searched(arm: Row) -> Row:
    fault = {"normal": 0.0, "out_of_range": 1.0, "failed": 4.0}[arm["case"]]
    weight = {"srp": 0.1, "mrp": 1.0, "mi": 0.6, "mito": 0.6, "random": 1.0}[arm["strategy"]]
    base = {"srp": 12.0, "mrp": 10.0, "mi": 8.0, "mito": 8.5, "random": 25.0}[arm["strategy"]]
    later = {"srp": 30.0, "mrp": 90.0}.get(arm["strategy"], 60.0)
    return lasted(base + weight * fault) | {"rejoin_time_s": later} | costs(arm["strategy"])


def searched_otherwise(arm: Row) -> Row:
    fault = {"normal": 0.0, "out_of_range": 15.0, "failed": 20.0}[arm["case"]]
    base = {"srp": 12.0, "mrp": 14.0, "mi": 25.0, "mito": 25.0, "random": 8.0}[arm["strategy"]]
    weight = {"srp": 1.2, "mrp": 0.8, "mi": 1.0, "mito": 1.0, "random": 0.0}[arm["strategy"]]
    later = {"srp": 90.0, "mrp": 30.0}.get(arm["strategy"], 60.0)
    return lasted(base + weight * fault) | {"rejoin_time_s": later} | costs(arm["strategy"], -1)


LAB = {"srp": (10, 10.3, 10.6, 11), "mrp": (7, 9, 10.5, 14), "mi": (3, 5, 7, 9), "random": (19, 19, 20, 20)}
LAB_OTHERWISE = {"srp": (6, 10, 14, 3), "mrp": (8, 9, 20, 2.5), "mi": (26, 24, 22, 20), "random": (3, 3, 3, 2)}


def sweeps(otherwise: bool, replicates: int = REPLICATES) -> dict[str, pd.DataFrame]:
    """Return runs of all four experiments in which the paper is right, or wrong throughout."""
    table = LAB_OTHERWISE if otherwise else LAB
    cases = {"strategy": STRATEGIES, "case": search.CASES}
    tried = sweep(cases, searched_otherwise if otherwise else searched, replicates)
    lab = {"strategy": tuple(table), "distribution": (1, 2, 3, 4)}
    drawn = sweep(lab, lambda arm: {"search_time_min": table[arm["strategy"]][arm["distribution"] - 1]}, replicates)
    areas = {"strategy": ("srp", "mrp", "mi"), "side_m": (75.0, 150.0, 300.0), "sub_teams": (1, 3)}
    power = {"srp": 1.5, "mrp": 1.0, "mi": 0.9} if not otherwise else {"srp": 1.0, "mrp": 1.2, "mi": 1.3}
    crowd = 1.0 if not otherwise else -0.5
    grown = sweep(
        areas,
        lambda arm: {"search_time_min": arm["side_m"] ** power[arm["strategy"]] / arm["sub_teams"] ** crowd},
        replicates,
    )
    nets = {"strategy": STRATEGIES, "network": channels.NETWORKS}
    slower = {"ideal": 1.0, "adhoc": 1.05 if not otherwise else 1.2, "jammed": 1.3}
    sent = sweep(
        nets,
        lambda arm: {
            key: value * (slower[arm["network"]] if key == "search_time_min" else 1.0)
            for key, value in (searched_otherwise if otherwise else searched)(arm | {"case": "normal"}).items()
        },
        replicates,
    )
    made = dict(zip(MODULES, (tried, drawn, grown, sent), strict=True))
    ended = {True: lambda strategy: float(strategy == "random"), False: lambda strategy: float(strategy != "random")}
    return {name: runs.assign(completed=runs["strategy"].map(ended[otherwise])) for name, runs in made.items()}


RIGHT, WRONG, ONE = sweeps(False), sweeps(True), sweeps(False, replicates=1)


def test_the_rows_have_an_id_each() -> None:
    for name in MODULES:
        assert len({row["id"] for row in claims(name)}) == len(claims(name))


@pytest.mark.parametrize(("name", "test"), [row for row in ROWS if not row[1].startswith(BY_SCATTER)])
def test_a_claim_holds_where_it_is_true_fails_where_it_is_false_and_needs_data(name: str, test: str) -> None:
    words, holds = answer(name, test, RIGHT[name])
    assert holds, words
    words, holds = answer(name, test, WRONG[name])
    assert holds is False, words
    assert answer(name, test, NONE) == ("-", None)
    words, holds = answer(name, test, ONE[name])
    assert holds is None
    assert words != "-"


@pytest.mark.parametrize("case", search.CASES)
def test_what_varies_least_is_judged_by_the_scatter_and_not_by_the_mean(case: str) -> None:
    test = f"{BY_SCATTER}_{case}"
    assert ("aggregation_search", test) in ROWS
    runs = RIGHT["aggregation_search"].copy()
    srp = runs["strategy"] == "srp"
    runs.loc[srp, "search_time_min"] = 30.0 + 0.01 * runs.loc[srp, "replicate"]
    assert answer("aggregation_search", test, runs)[1]
    runs.loc[srp, "search_time_min"] = 1.0 + 1.0 * runs.loc[srp, "replicate"]
    assert answer("aggregation_search", test, runs)[1] is False
    assert answer("aggregation_search", test, NONE) == ("-", None)
    assert answer("aggregation_search", test, ONE["aggregation_search"])[1] is None


@pytest.mark.parametrize(("name", "arm"), [("aggregation_search", "normal"), ("aggregation_channels", "adhoc")])
def test_who_takes_twice_as_long_may_say_more_by_the_task_and_less_by_the_minute(name: str, arm: str) -> None:
    runs = RIGHT[name].copy()
    slow = runs["strategy"] == "mrp"
    runs["simulated_s"] = np.where(slow, 1200.0, 600.0)
    runs["frames"] = runs["energy_j"] = np.where(slow, 15.0, 10.0) + 0.1 * np.sin(runs["replicate"])
    assert answer(name, f"says_more_frames_{arm}", runs)[1] is False
    assert answer(name, f"needs_less_energy_j_{arm}", runs)[1]
    words, holds = answer(name, f"says_more_frames_per_min_{arm}", runs)
    assert holds, words
    assert "frames/min" in words
    assert answer(name, f"needs_less_energy_j_per_min_{arm}", runs)[1] is False


@pytest.mark.parametrize(
    ("means", "share"),
    [((1, 2, 3, 4), 1.0), ((4, 3, 2, 1), 0.0), ((2, 2, 2, 2), 0.0), ((0, 0, 0, 1), 0.6), ((1, 1, 2, 2), 0.8)],
)
def test_how_straight_means_lie_is_the_square_of_their_correlation(means: tuple[float, ...], share: float) -> None:
    samples = np.array([[means, means]], dtype=float)
    assert laboratory.straight(samples)[0] == pytest.approx(share)
    if len(set(means)) > 1 and share:
        assert stats.pearsonr(range(4), means).statistic ** 2 == pytest.approx(share)


@pytest.mark.slow
def test_tables_and_figures_show_all_arms(tmp_path: Path) -> None:
    for name, module in MODULES.items():
        assert all(path.stat().st_size > 5000 for path in module.draw(RIGHT[name], NONE, tmp_path))
        assert module.draw(NONE, NONE, tmp_path) == []
    times, spent = search.tables(RIGHT["aggregation_search"], NONE).values()
    assert len(times) == len(spent) == 15
    (table,) = laboratory.tables(RIGHT["aggregation_laboratory"], NONE).values()
    assert list(table.columns) == ["strategy", "1", "2", "3", "4"]
