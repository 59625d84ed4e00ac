"""The tests that the published.csv of paper 001's explorations name hold, fail and stay open; and their floors."""

import csv
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.exploration_behaviour import figures as behaviour
from experiments.exploration_channels import figures as channels
from experiments.exploration_speed import figures as speed
from experiments.exploration_teams import figures as teams
from experiments.exploration_teams import floors
from experiments.exploration_teams.comparison import MAPS

EXPERIMENTS = Path(__file__).parent.parent / "experiments"
MODULES = {
    "exploration_teams": teams,
    "exploration_behaviour": behaviour,
    "exploration_speed": speed,
    "exploration_channels": channels,
}
NONE = pd.DataFrame()
REPLICATES = 12
Row = dict[str, Any]


def claims(name: str) -> list[dict[str, str]]:
    with (EXPERIMENTS / name / "published.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


ROWS = [(name, row["test"]) for name in MODULES for row in claims(name)]


def answer(name: str, test: str, runs: pd.DataFrame) -> tuple[str, bool | None]:
    found: tuple[str, bool | None] = getattr(MODULES[name], test)(runs, NONE)
    return found


def sweep(axes: dict[str, tuple[Any, ...]], row: Callable[[Row], Row], replicates: int) -> pd.DataFrame:
    rows = []
    for replicate in range(replicates):
        for values in product(*axes.values()):
            arm = dict(zip(axes, values, strict=True))
            noise = 1.0 + 0.01 * np.sin(7 * replicate + 3 * len(rows))
            scattered = {key: value * noise for key, value in row(arm).items() if key not in ("completed",)}
            rows.append(arm | {"replicate": replicate, "completed": row(arm)["completed"]} | scattered)
    return pd.DataFrame(rows)


# Metrics of an arm where the paper is right (sign 1), and where it is wrong (sign -1).


def in_teams(sign: int, arm: Row) -> Row:
    algorithm = {"schemas": 1.0, "nearest": 0.8, "utility": 0.7, "assignment": 0.6}[arm["algorithm"]] ** sign
    return {
        "until_95_s": 3000.0 * algorithm * arm["robots"] ** (-0.7 * sign),
        "completed": float(sign == 1),
        "blocked_ticks": 0.0 if sign == 1 else 3.0,
        "parted_by_escape_m": 2.0 * sign,
        "parted_else_m": 1.0 * sign if sign == 1 else -1.0,
        "stalls": 9.0 if sign == 1 else 0.0,
        "stalls_no_force": 4.0 if sign == 1 else 0.0,
        "covered_twice": 0.1 * arm["robots"] ** (0.5 * sign),
    }


def by_behaviour(sign: int, arm: Row) -> Row:
    kind = arm["behaviour"]
    worse = {"no escape": 0.4, "wide obstacles": 0.8}.get(kind, 0.97) if sign == 1 else 0.97 + (kind != "usual") * 0.02
    blocked = {"usual": 0.0, "no subsumption": 0.0, "no clearance": 8.0}.get(kind, 5.0)
    if kind == "no subsumption" and arm["robots"] == 4:
        blocked = 2.0
    wrong = {"usual": 9.0, "no subsumption": 8.0, "no clearance": 1.0}.get(kind, 5.0)
    return {
        "until_95_s": 1000.0 * (1.05 if sign == 1 else 1.3) ** (kind == "printed A*"),
        "completed": 1.0,
        "coverage": worse,
        "paths_led_on": 0.9 if sign == 1 else 0.6,
        "covered_twice": 0.5 + 0.1 * sign * (kind == "no avoid-robot"),
        "blocked_ticks": blocked if sign == 1 else wrong,
    }


def by_speed(sign: int, arm: Row) -> Row:
    faster = arm["speed"] == "by obstacles"
    share = {"empty": 0.5, "corridor": 0.3, "office": 0.1}[arm["map"]] * faster
    return {
        "until_95_s": 2000.0 / arm["robots"] * (1.0 - sign * share),
        "completed": float(sign == 1),
        "blocked_ticks": 0.0 if sign == 1 else 1.0,
    }


def by_network(sign: int, arm: Row) -> Row:
    slower = {"shared": 1.0, "ideal": 1.01, "near": 1.03, "adhoc": 1.05}[arm["network"]]
    return {
        "until_95_s": 3000.0 * (slower if sign == 1 else slower**12) * arm["robots"] ** (-0.7 * sign),
        "completed": float(sign == 1),
    }


AXES: dict[str, tuple[dict[str, tuple[Any, ...]], Callable[[int, Row], Row]]] = {
    "exploration_teams": ({"algorithm": tuple(teams.NAMES), "robots": (1, 2, 4, 8)}, in_teams),
    "exploration_behaviour": (
        {
            "behaviour": (
                "usual",
                "no escape",
                "no avoid-robot",
                "printed A*",
                "wide obstacles",
                "no subsumption",
                "no clearance",
            ),
            "robots": (1, 4),
        },
        by_behaviour,
    ),
    "exploration_speed": ({"speed": ("constant", "by obstacles"), "robots": (1, 4)}, by_speed),
    "exploration_channels": ({"network": channels.NETWORKS, "robots": (1, 4)}, by_network),
}


def runs_of(name: str, sign: int, replicates: int = REPLICATES) -> pd.DataFrame:
    axes, metrics = AXES[name]
    return sweep({"map": tuple(MAPS)} | axes, lambda arm: metrics(sign, arm), replicates)


@pytest.fixture(scope="module")
def right() -> dict[str, pd.DataFrame]:
    return {name: runs_of(name, 1) for name in MODULES}


@pytest.fixture(scope="module")
def wrong() -> dict[str, pd.DataFrame]:
    return {name: runs_of(name, -1) for name in MODULES}


@pytest.fixture(scope="module")
def single() -> dict[str, pd.DataFrame]:
    return {name: runs_of(name, 1, replicates=1) for name in MODULES}


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_holds_where_the_paper_is_right(name: str, test: str, right: dict[str, pd.DataFrame]) -> None:
    runs = right[name]
    if name == "exploration_behaviour" and test.startswith("untouched_"):
        runs = runs.assign(blocked_ticks=0.0)
    words, holds = answer(name, test, runs)
    assert holds is True, words


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_fails_where_the_paper_is_wrong(name: str, test: str, wrong: dict[str, pd.DataFrame]) -> None:
    words, holds = answer(name, test, wrong[name])
    assert holds is False, words


@pytest.mark.parametrize(("name", "test"), ROWS)
def test_a_claim_has_no_data_without_runs(name: str, test: str) -> None:
    assert answer(name, test, NONE) == ("-", None)


@pytest.mark.parametrize(("name", "test"), [row for row in ROWS if "untouched" not in row[1]])
def test_a_claim_stays_open_with_a_single_replicate(name: str, test: str, single: dict[str, pd.DataFrame]) -> None:
    words, holds = answer(name, test, single[name])
    assert words != "-"
    assert holds is None


@pytest.mark.parametrize(("sign", "cut"), [(1, "adhoc"), (-1, "shared")])
def test_a_claim_stays_open_where_a_lower_bound_could_decide_it(sign: int, cut: str) -> None:
    runs = runs_of("exploration_channels", sign)
    whole = runs.assign(reached=1.0)
    short = runs.assign(reached=np.where((runs["network"] == cut) & (runs["replicate"] == 0), 0.0, 1.0))
    assert answer("exploration_channels", "costs_little_office_adhoc", whole)[1] is (sign == 1)
    assert answer("exploration_channels", "costs_little_office_adhoc", short)[1] is None


@pytest.mark.parametrize("name", MODULES)
def test_figures_are_drawn(name: str, tmp_path: Path, right: dict[str, pd.DataFrame]) -> None:
    runs = right[name].assign(payload_bytes=100.0, covered_twice=0.5)
    paths = MODULES[name].draw(runs, NONE, tmp_path)
    assert paths
    assert all(path.stat().st_size > 0 for path in paths)
    assert MODULES[name].draw(NONE, NONE, tmp_path) == []


@pytest.mark.parametrize("name", floors.ABOUT)
def test_the_floors_are_what_writes_them(name: str) -> None:
    assert (EXPERIMENTS / "floors" / f"explore_{name}.yaml").read_text(encoding="utf-8") == floors.text(name)
