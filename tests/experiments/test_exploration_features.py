"""Speed set by SLAM with features and with grids: thresholds, errors told apart, and the rows that ask for them."""

import csv
import math
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from cosim.experiment import load_experiment
from cosim.units import S
from experiments.exploration_localization.features import figures
from experiments.exploration_localization.features.judging import (
    COLUMNS,
    errors_by_state,
    measure,
    spans,
    spread_m,
    thresholds,
)
from tests.checkout import EXPERIMENTS

SHEET = EXPERIMENTS / "exploration_localization" / "features" / "sweep.yaml"
NONE = pd.DataFrame()
with (SHEET.parent / "published.csv").open(newline="", encoding="utf-8") as file:
    TESTS = [row["test"] for row in csv.DictReader(file)]
ARMS = [arm.labels for arm in load_experiment(SHEET).arms]


def trace(*rows: tuple[str, float, float]) -> Any:
    """Return a trace of events, each with a time, s, and a spread, m."""
    columns = {
        "event": [row[0] for row in rows],
        "time_ns": [round(row[1] * S) for row in rows],
        "spread_m": [row[2] for row in rows],
    }
    return SimpleNamespace(columns=lambda name: columns)


def test_waits_that_are_over_have_a_begin_and_an_end() -> None:
    told = trace(
        ("Localised", 1.0, 0.1),
        ("Waiting", 2.5, 0.4),
        ("Resumed", 7.0, 0.3),
        ("Waiting", 9.0, 0.4),
        ("Resumed", 9.5, 0.2),
        ("Localised", 10.0, 0.2),
        ("Localised", 11.0, 0.6),
        ("Waiting", 12.0, 0.4),
    )
    assert spans(told) == [(2.5, 7.0), (9.0, 9.5)]
    assert spread_m(told) == 0.2


def test_errors_are_told_apart_by_what_the_robot_does() -> None:
    errors = [1.0, 2.0, 30.0, 31.0, 32.0, 3.0, 4.0]
    found = errors_by_state([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], errors, [(2.5, 5.0), (6.2, 6.8)])
    assert found == {"pose_error_driving_m": 2.5, "pose_error_before_m": 30.0, "pose_error_after_m": 32.0}
    assert math.isnan(errors_by_state([1.0], [1.0], [])["pose_error_after_m"])


def test_thresholds_are_to_each_other_as_those_in_metres() -> None:
    usual = load_experiment(SHEET.parents[1] / "sweep.yaml", ["map=office", "position='stop at 0.2 m'"]).arms[0]
    control = usual.parameters["scenario"]["protocol"]["parameters"]["positioning"]["control"]
    assert thresholds(0.2) == pytest.approx({name: control[name] for name in thresholds(0.2)})


def test_the_filter_by_features_assumes_the_true_errors_of_odometry_and_that_by_grids_their_variances() -> None:
    scenario = load_experiment(SHEET).base["scenario"]
    senses, positioning = scenario["team"]["senses"], scenario["protocol"]["parameters"]["positioning"]
    names = ("odometry_slip", "odometry_turn_rad", "odometry_way_m")
    assert {name: positioning["features"][name] for name in names} == {name: senses[name] for name in names}
    tick_m = scenario["protocol"]["parameters"]["steering"]["speed_mps"] * scenario["tick_s"]
    assert senses["odometry_way_m"] == pytest.approx(tick_m)
    grid, way_m = positioning["filter"], positioning["filter"]["update_way_m"]
    assert grid["alpha2"] * way_m**2 == pytest.approx(senses["odometry_turn_rad"] ** 2 / 3 * way_m)
    slips = way_m / tick_m  # ticks between updates
    assert grid["alpha3"] * way_m**2 == pytest.approx(slips * (senses["odometry_slip"] * tick_m) ** 2 / 3)
    assert (grid["alpha1"], grid["alpha4"]) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", figures.FILTERS)
def test_a_run_has_its_thresholds_from_a_pilot_and_tells_all_columns(kind: str) -> None:
    sets = ("map=corridor", f"filter={kind}", "range='2.5 m'", "scenario.duration_s=40", "pilot_s=20")
    steady, strict = (
        measure(load_experiment(SHEET, [*sets, f"position='{position}'"]).arms[0].parameters, 900001)
        for position in (figures.CONSTANT, figures.STOPS[1])
    )
    assert set(strict) == {column.name for column in COLUMNS}
    assert strict["median_m"] == steady["median_m"] > 0.0
    assert steady["waits"] == 0 < strict["waits"]
    assert 0.0 < steady["pose_error_driving_m"] == pytest.approx(steady["pose_error_m"])


# ---------------------------------------------------------------- the rows


def runs_of(sign: int, spoilt: Any = None) -> pd.DataFrame:
    """Return five runs an arm where the paper is right (sign 1) or wrong (-1), but for the arms of labels *spoilt*."""
    rows = []
    for labels in ARMS:
        here = -sign if spoilt is not None and spoilt.items() <= labels.items() else sign
        strict = {figures.CONSTANT: 0, figures.STOPS[4]: 1, figures.STOPS[2]: 2, figures.STOPS[1]: 3}[
            labels["position"]
        ]
        error = 0.1 * 0.7 ** (here * strict)
        metrics = {
            "until_95_s": 1000.0 * 1.3 ** (here * strict),
            "map_error": error,
            "pose_error_driving_m": error,
            "pose_error_before_m": 0.2 if strict else math.nan,
            "pose_error_after_m": 0.2 - 0.1 * here if strict else math.nan,
            "waits_localised": 0.5 + 0.3 * here if strict else math.nan,
        }
        scattered = [{k: v * (1 + 0.01 * math.sin(7 * at)) for k, v in metrics.items()} for at in range(5)]
        rows += [labels | {"replicate": at, "reached": 1.0} | own for at, own in enumerate(scattered)]
    return pd.DataFrame(rows)


def answers(runs: pd.DataFrame) -> dict[str, bool | None]:
    return {test: getattr(figures, test)(runs, NONE)[1] for test in TESTS}


def test_rows_hold_where_the_paper_is_right_and_fail_where_it_is_wrong() -> None:
    assert len(TESTS) == len(set(TESTS)) == 48
    assert set(answers(runs_of(1)).values()) == {True}
    assert set(answers(runs_of(-1)).values()) == {False}
    assert {getattr(figures, test)(NONE, NONE) for test in TESTS} == {("-", None)}


@pytest.mark.parametrize(
    ("position", "tests"),
    [
        (figures.CONSTANT, set()),
        (figures.STOPS[1], {"stricter", "localised", "waiting"}),
        (figures.STOPS[2], {"maps", "places", "costs", "localised", "waiting"}),
        (figures.STOPS[4], {"localised", "waiting"}),
    ],
)
def test_a_row_is_judged_by_its_floor_filter_scanner_and_thresholds_alone(position: str, tests: set[str]) -> None:
    spoilt = {"map": "office", "filter": "features", "range": "8 m", "position": position}
    failed = {test for test, holds in answers(runs_of(1, spoilt)).items() if holds is False}
    assert failed == {f"{test}_office_features_8" for test in tests}


def test_an_error_of_a_run_that_was_cut_is_a_lower_bound() -> None:
    runs = runs_of(1)
    cut = (runs["position"] == figures.STOPS[2]) & (runs["replicate"] == 0)
    found = answers(runs.assign(reached=(~cut).astype(float)))
    assert {test for test, holds in found.items() if holds is None} == {
        t for t in TESTS if t.startswith(("maps", "places"))
    }
