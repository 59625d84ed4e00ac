"""What a run counts more than once: intervals between runs, claims about shares, axes that write into each other."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml

from cosim.errors import UserError
from cosim.experiment import load_experiment
from cosim.report.claims import Claim, judge
from cosim.report.estimates import estimates
from cosim.results import RunStore
from cosim.statistics.intervals import estimate
from cosim.sweep import run_sweep
from experiments.inquiry_time import discovery

NOTHING = pd.DataFrame()


def claim(**fields: str) -> Claim:
    base = {"id": "a", "paper": "P", "section": "", "claim": "it is so", "quantity": "delay_s", "where": ""}
    return Claim.model_validate(base | {"unit": "s", "published": "2", "test": "within 1 %"} | fields)


def observations(values: list[list[float]]) -> pd.DataFrame:
    """A row for each value; every inner list is a run."""
    return pd.DataFrame(
        {"configuration": "c", "seed": seed, "code": "k", "delay_s": value}
        for seed, run in enumerate(values)
        for value in run
    )


def test_values_of_one_run_count_as_one_value_for_the_interval():
    alone = estimate(pd.Series([1.0, 2.0, 4.0]))
    repeated = estimate(pd.Series([1.0, 1.0, 2.0, 2.0, 4.0, 4.0]), pd.Series([7, 7, 8, 8, 9, 9]))
    assert repeated.half == pytest.approx(alone.half, rel=1e-12)
    assert (repeated.mean, repeated.size) == (alone.mean, 6)
    assert estimate(pd.Series([1.0, 1.0, 2.0, 2.0, 4.0, 4.0])).half < 0.7 * alone.half


def test_arms_with_the_same_random_numbers_count_as_one_run_for_the_interval():
    """All arms of a replicate share its seed: what chance does to one it does to all, and more arms know no more."""
    one = pd.concat([observations([[1.0], [2.0], [4.0]])] * 3)
    arms = one.assign(configuration=np.repeat(["a", "b", "c"], 3))
    for found in (estimates(arms, [], ["delay_s"])["delay_s"][0], estimates(one, [], ["delay_s"])["delay_s"][0]):
        assert found.half == pytest.approx(estimate(pd.Series([1.0, 2.0, 4.0])).half, rel=1e-12)
    apart = claim(published="0.5", test="in the interval")  # 2.33 ± 3.8, but ± 1.0 if these were nine runs
    assert judge(apart, arms, NOTHING, None).verdict == "holds"


def test_values_that_are_independent_within_runs_have_the_interval_of_single_values():
    rng = np.random.default_rng(5)
    values, runs = pd.Series(rng.normal(size=4000)), pd.Series(np.arange(4000) // 20)
    # 200 runs: the standard error of a standard deviation is 5 %
    assert estimate(values, runs).half == pytest.approx(estimate(values).half, rel=0.15)


def test_a_mean_over_runs_of_different_length_is_that_of_all_values():
    values, runs = pd.Series([1.0, 1.0, 1.0, 4.0]), pd.Series([1, 1, 1, 2])
    found = estimate(values, runs)
    assert found.mean == 1.75
    # sums of deviations -2.25 and 2.25: sqrt(2 (2.25^2 + 2.25^2)) / 4 = 1.125; t(0.975, 1) = 12.706
    assert found.half == pytest.approx(12.706 * 1.125, rel=1e-4)


def test_values_that_are_missing_take_their_runs_with_them():
    values, runs = pd.Series([1.0, 2.0, math.nan, math.nan]), pd.Series([1, 2, 3, 3])
    assert estimate(values, runs) == estimate(pd.Series([1.0, 2.0]))
    assert math.isnan(estimate(pd.Series([1.0, 2.0]), pd.Series([1, 1])).half)  # one run has no interval


def test_the_table_of_observations_takes_runs_for_what_is_independent():
    rows = observations([[1.0, 1.0], [2.0, 2.0], [4.0, 4.0]])
    (found,) = estimates(rows, ["configuration"], ["delay_s"])["delay_s"]
    assert found.half == pytest.approx(estimate(pd.Series([1.0, 2.0, 4.0])).half, rel=1e-12)
    assert judge(claim(), NOTHING.assign(seed=[1]), rows, None).ours == str(found)


@pytest.mark.parametrize(
    ("fields", "verdict", "ours"),
    [
        ({"quantity": "delay_s <= 2", "published": "0.75", "test": "equal"}, "fails", "0.75"),
        ({"quantity": "delay_s <= 2", "published": "0.75"}, "open", "0.75"),
        # what was not found is late, however late is
        ({"quantity": "not (delay_s <= 9)", "published": "0.25"}, "open", "0.25"),
        ({"quantity": "delay_s > 9", "where": "delay_s > 9"}, "no data", "-"),
        ({"quantity": "delay_s + speed"}, "no data", "-"),
    ],
)
def test_a_quantity_may_be_an_expression_of_columns(fields: dict[str, str], verdict: str, ours: str):
    rows = observations([[1.0, 2.0], [2.0], [math.nan]])
    made = judge(claim(**fields), NOTHING.assign(seed=[1]), rows, None)
    assert (made.verdict, made.ours.split()[0]) == (verdict, ours)


def test_a_quantity_that_cannot_be_read_is_told_in_one_line():
    with pytest.raises(UserError, match=r"published\.csv: a: quantity: 'delay_s <= '"):
        judge(claim(quantity="delay_s <= "), NOTHING.assign(seed=[1]), observations([[1.0]]), None)


@pytest.mark.parametrize(
    ("published", "verdict"), [("3.8", "holds"), ("1.0", "holds"), ("3.9", "fails"), ("0.9", "fails")]
)
def test_a_value_lies_in_the_interval_or_not(published: str, verdict: str):
    rows = observations([[1.0], [2.0], [4.0], [2.0], [3.0]])  # s^2 = 1.3, t(0.975, 4) = 2.776: 2.4 ± 1.42
    assert (
        judge(claim(published=published, test="in the interval"), NOTHING.assign(seed=[1]), rows, None).verdict
        == verdict
    )


def test_a_single_run_has_no_interval_to_lie_in():
    rows = observations([[1.0, 2.0, 4.0]])
    assert judge(claim(test="in the interval"), NOTHING.assign(seed=[1]), rows, None).verdict == "open"


def test_a_function_of_figures_still_answers_before_the_quantity():
    figures: Any = SimpleNamespace(decide=lambda runs, seen: ("ours", True))
    made = judge(
        claim(test="decide", quantity="no such thing"), NOTHING.assign(seed=[1]), observations([[1.0]]), figures
    )
    assert (made.ours, made.verdict) == ("ours", "holds")


@pytest.mark.slow
def test_an_axis_may_write_into_the_values_of_another(tmp_path: Path):
    """Arms that share a value must not see what another axis writes into it."""
    plain = {
        "name": "nested",
        "run": "experiments.inquiry_time.discovery:observe",
        "parameters": {
            "scan": {"version": "1.2", "interval_s": 1.28, "interlaced": False},
            "inquiries": 2,
            "duration_s": 1.0,
        },
        "sweep": {
            "procedure": {
                "path": "scan",
                "values": {"new": {"version": "1.2", "interval_s": 1.28, "interlaced": False}},
            },
            "scan_interval_s": {"path": "scan.interval_s", "values": [0.64, 1.28, 2.56]},
        },
        "replicates": 1,
    }
    path = tmp_path / "sweep.yaml"
    path.write_text(yaml.safe_dump(plain, sort_keys=False))
    experiment = load_experiment(path)
    assert [arm.parameters["scan"]["interval_s"] for arm in experiment.arms] == [0.64, 1.28, 2.56]
    assert len({arm.configuration for arm in experiment.arms}) == 3
    assert run_sweep(experiment, tmp_path / "r", jobs=1).failures == ()
    rows = RunStore(tmp_path / "r").present("observations")
    assert rows.groupby("scan_interval_s").size().to_dict() == {0.64: 2, 1.28: 2, 2.56: 2}


@pytest.mark.slow
def test_columns_that_an_experiment_declares_carry_their_units(tmp_path: Path):
    path = tmp_path / "sweep.yaml"
    run = "experiments.inquiry_time.discovery:observe"
    parameters = {"scan": {"version": "1.2"}, "drift_ppm": 0, "inquiries": 1, "duration_s": 0.01}
    path.write_text(
        yaml.safe_dump({"name": "n", "run": run, "parameters": parameters, "sweep": {"drift_ppm": [0, 20]}})
    )
    run_sweep(load_experiment(path, replicates=1), tmp_path / "r", jobs=1)
    schema = pq.read_schema(next((tmp_path / "r" / "observations").glob("*.parquet")))
    kinds = {field.name: (str(field.type), field.metadata[b"unit"].decode()) for field in schema}
    assert kinds["discovery_time_s"] == ("double", "s")
    assert kinds["drift_ppm"] == ("int64", "ppm")
    assert kinds["interlaced"] == ("bool", "")
    assert b"FHS" in schema.field("discovery_time_s").metadata[b"meaning"]
    names = {column.name for column in discovery.COLUMNS}
    assert names == set(discovery.observe(parameters, 1)[0])
