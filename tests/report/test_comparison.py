"""Paired comparisons of arms: against scipy, printed tables, and what happens by chance."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from cosim.report.comparison import (
    Limits,
    bootstrap_limits,
    confidence_limits,
    equivalent,
    less,
    mean_ratio,
    mostly,
    never,
    ratio_of_means,
    saves,
    saving,
    saving_text,
    share_limits,
)

TIME = "search_time_min"


def sweep(times: dict[str, float]) -> pd.DataFrame:
    """Return 30 replicates of an arm for each strategy in *times*, which scatter alike in all arms."""
    rows = []
    for replicate in range(30):
        luck = 1.0 + 0.2 * np.sin(replicate)
        for strategy, time in times.items():
            noise = 1.0 + 0.01 * np.sin(7 * replicate + 3 * len(rows))
            rows.append({"strategy": strategy, "replicate": replicate, TIME: time * luck * noise})
    return pd.DataFrame(rows)


def test_limits_are_those_of_students_t() -> None:
    found = confidence_limits(pd.Series([1.0, 2.0, 3.0, 4.0, 5.0]))
    half = 2.131847 * math.sqrt(2.5) / math.sqrt(5)  # t of 0.95 and 4 degrees of freedom, from a printed table
    assert found.mean == 3.0
    assert found.lower == pytest.approx(3.0 - half, abs=1e-5)
    assert found.upper == pytest.approx(3.0 + half, abs=1e-5)
    assert math.isnan(confidence_limits(pd.Series([1.0])).lower)


def test_savings_are_taken_within_a_replicate() -> None:
    runs = pd.DataFrame({"team": ["a", "a", "b", "b", "b"], "replicate": [0, 1, 1, 0, 2], "steps": [1, 30, 40, 2, 9]})
    found = saving(runs, {"team": "a"}, {"team": "b"}, "steps")
    assert dict(found) == {0: 0.5, 1: 0.25}  # the third replicate is in one arm only


@pytest.mark.parametrize(
    ("mean", "lower", "words"),
    [
        (0.651, 0.6, "saves 65.1 % (at least 60 %)"),
        (0.0, 0.0, "saves 0 % (at least 0 %)"),
        (0.025, -0.175, "saves 2.5 % (costs at most 17.5 %)"),
        (-0.318, -0.462, "costs 31.8 % (at most 46.2 %)"),
        (-0.318, math.nan, "costs 31.8 %"),  # of a single run
    ],
)
def test_a_saving_is_told_without_a_sign(mean: float, lower: float, words: str) -> None:
    assert saving_text(Limits(mean, lower, math.nan, 5)) == words


def test_a_claim_of_several_pairs_holds_if_each_of_them_does() -> None:
    runs = pd.DataFrame({"team": list("aabbcc"), "replicate": [0, 1] * 3, "steps": [10.0, 10.1, 20, 20, 10, 10.2]})
    better, equal = ("", {"team": "a"}, {"team": "b"}), ("", {"team": "a"}, {"team": "c"})
    assert saves(runs, [better], "steps")[1] is True
    assert saves(runs, [better, equal], "steps")[1] is False
    assert saves(runs, [better], "steps", least=0.6)[1] is False
    assert saves(runs[runs["replicate"] == 0], [better], "steps")[1] is None  # a single run has no limits
    assert saves(runs, [better, ("", {"team": "a"}, {"team": "d"})], "steps") == ("-", None)


def test_ratios_are_geometric() -> None:
    runs = pd.DataFrame({"team": list("aabb"), "replicate": [0, 1] * 2, "steps": [1.0, 4.0, 1.0, 1.0]})
    assert mean_ratio(runs, {"team": "a"}, {"team": "b"}, "steps").mean == pytest.approx(2.0)


def test_less_needs_every_pair_and_the_factor() -> None:
    runs = sweep({"a": 1.0, "b": 1.2, "c": 0.9})
    a, b, c = ({"strategy": name} for name in "abc")
    assert less(runs, [("", a, b)], TIME)[1]
    assert not less(runs, [("", a, b), ("", a, c)], TIME)[1]
    assert less(runs, [("", b, a)], TIME, factor=1.25)[1]
    assert not less(runs, [("", b, a)], TIME, factor=1.15)[1]


def test_equivalence_is_refused_on_either_side() -> None:
    times = {"srp": 10.0, "above": 11.5, "below": 8.5, "like": 10.5}
    runs = sweep(times)
    found = {name: equivalent(runs, {"strategy": name}, {"strategy": "srp"}, 0.1, TIME)[1] for name in times}
    assert found == {"srp": True, "above": False, "below": False, "like": True}


@pytest.mark.slow
def test_a_difference_by_chance_holds_in_one_of_twenty() -> None:
    stream = np.random.default_rng(5)
    runs = []
    for trial in range(600):
        for strategy in ("mi", "mrp"):
            times = stream.normal(10, 1, 15)
            runs.append(
                pd.DataFrame({"strategy": strategy, "trial": trial, "replicate": range(15), "search_time_min": times})
            )
    parts = pd.concat(runs).groupby("trial")
    held = [less(part, [("", {"strategy": "mi"}, {"strategy": "mrp"})], TIME)[1] for _, part in parts]
    low, high = stats.binom.ppf([0.001, 0.999], 600, 0.05)
    assert low <= sum(map(bool, held)) <= high


def test_the_limits_of_a_share_are_those_of_clopper_and_pearson() -> None:
    found = share_limits(pd.Series([1.0] * 27 + [0.0] * 3))
    interval = stats.binomtest(27, 30).proportion_ci(0.9, "exact")
    assert (found.lower, found.upper) == pytest.approx(tuple(interval))
    assert share_limits(pd.Series([1.0] * 15)).lower == pytest.approx(0.05 ** (1 / 15))


@pytest.mark.parametrize(
    ("ended", "of", "answer"),
    [(11, 11, True), (10, 11, False), (10, 10, None), (9, 10, None), (4, 10, False), (1, 1, None)],
)
def test_a_share_that_so_few_runs_cannot_show_stays_open(ended: int, of: int, answer: bool | None) -> None:
    """More than 75 %: 0.05 to the power of 1/11 is 0.762, of 1/10 0.741; 4 of 10 have 0.697 as their upper limit."""
    runs = pd.DataFrame({"strategy": "mi", "replicate": range(of), "completed": [1.0] * ended + [0.0] * (of - ended)})
    assert mostly(runs, [("", {"strategy": "mi"})], 0.75)[1] is answer


def test_the_bootstrap_of_a_mean_has_the_limits_of_student() -> None:
    values = pd.DataFrame({0: np.random.default_rng(3).normal(5, 2, 200)})
    found = bootstrap_limits(values, lambda samples: samples.mean(axis=1)[:, 0])
    half = stats.t.ppf(0.95, 199) * values[0].std() / np.sqrt(200)
    assert found.mean == pytest.approx(values[0].mean())
    assert found.lower == pytest.approx(found.mean - half, abs=0.1 * half)
    assert found.upper == pytest.approx(found.mean + half, abs=0.1 * half)


def test_the_quotient_of_means_has_the_limits_of_the_delta_method() -> None:
    stream = np.random.default_rng(4)
    other = stream.normal(10, 1, 400)
    both = pd.DataFrame({0: 2 * other + stream.normal(0, 0.5, 400), 1: other})
    found = ratio_of_means(both)
    error = 0.5 / 10 / np.sqrt(400)
    assert found.mean == pytest.approx(2.0, abs=4 * error)
    assert found.upper - found.mean == pytest.approx(stats.t.ppf(0.95, 399) * error, rel=0.15)


def test_a_count_that_is_ever_above_0_was_not_never() -> None:
    arms = [{"strategy": "srp"}, {"strategy": "mi"}]
    runs = sweep({"srp": 1.0, "mi": 1.0, "mrp": 1.0}).assign(contacts=0.0)
    assert never(runs, arms, "contacts", "held up in", "ticks") == ("held up in 0 ticks a run, in 0 of 60", True)
    runs.loc[runs.index[-1], "contacts"] = 3.0  # of MRP, which is not asked of
    assert never(runs, arms, "contacts")[1] is True
    runs.loc[runs.index[:2], "contacts"] = [6.0, 0.0]
    assert never(runs, arms, "contacts", unit="ticks") == ("0.1 ticks a run, in 1 of 60", False)
    assert never(runs, [*arms, {"strategy": "mito"}], "contacts") == never(runs, [], "contacts") == ("-", None)
