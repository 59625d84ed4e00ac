import math

import numpy as np
import pytest
from scipy import stats

from cosim.randomness import Streams
from cosim.statistics.equivalence import place
from cosim.statistics.intervals import Estimate, bootstrapped, cautious, estimate, interval, paired, share, unpaired


@pytest.mark.parametrize(("ones", "count"), [(50, 50), (0, 20), (19, 20), (1, 3), (7, 12)])
def test_a_share_of_one_value_a_seed_has_the_interval_of_wilson(ones: int, count: int):
    theirs = stats.binomtest(ones, count).proportion_ci(method="wilson")
    ours = share([1.0] * ones + [0.0] * (count - ones), range(count))
    assert (ours.mean, ours.size) == (ones / count, count)
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_fifty_of_fifty_is_not_certain():
    assert str(share([1.0] * 50)) == "1 (0.929 to 1)"  # as sweeps of 50 that print it by scipy do


def test_a_share_that_all_values_agree_on_counts_a_seed_as_a_trial():
    theirs = stats.binomtest(8, 8).proportion_ci(method="wilson")
    found = share(np.ones(800), np.arange(800) // 100)
    assert (found.low, found.high, found.size) == (pytest.approx(theirs.low, abs=1e-12), 1.0, 800)


def test_runs_of_which_each_agrees_with_itself_count_as_one_value_each():
    alone = share([1.0, 0, 0, 1, 1, 0], range(6))
    repeated = share(np.repeat([1.0, 0, 0, 1, 1, 0], 10), np.arange(60) // 10)
    # the two quantiles of t are those of 5 and of 59 degrees: 2.571 and 2.001
    wider = stats.t.ppf(0.975, 5) / stats.t.ppf(0.975, 59)
    trials = 60 / (59 / 5 * wider**2)  # a design effect of 10, but for degrees of freedom, and the quantiles
    assert repeated.half > alone.half
    assert 3.0 < trials < 6.0
    z = stats.norm.ppf(0.975)
    assert repeated.half == pytest.approx(z / math.sqrt(trials + z * z) / 2, rel=0.02)


def test_values_that_differ_within_runs_as_much_as_between_them_count_nearly_all():
    values = Streams(3)("values").random(4000) < 0.3
    found = share(values, np.arange(4000) // 20)
    alone = stats.binomtest(int(values.sum()), 4000).proportion_ci(method="wilson")
    assert found.half == pytest.approx((alone.high - alone.low) / 2, rel=0.15)
    assert found.half >= (alone.high - alone.low) / 2 - 1e-12  # never more trials than values


def test_runs_that_make_up_for_each_other_count_no_more_than_their_values():
    found = share([1.0, 0.0] * 10, np.arange(20) // 2)  # every seed has a half: their mean does not vary at all
    theirs = stats.binomtest(10, 20).proportion_ci(method="wilson")
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_a_cautious_interval_reaches_farther_to_the_side_of_the_skew():
    values = np.array([1.0, 1.1, 1.2, 1.3, 1.5, 1.9, 2.8, 5.0])
    found, usual, mirrored = cautious(values), estimate(values), cautious(-values)
    assert (found.low, found.mean) == (usual.low, usual.mean)
    assert usual.high + 0.2 * usual.half < found.high <= usual.mean + 1.5 * usual.half * (1 + 1e-12)
    few = cautious([1.0, 1.01, 1.02, 9.0])  # the skewness of four says little
    assert few.high == pytest.approx(few.mean + 1.5 * estimate([1.0, 1.01, 1.02, 9.0]).half)
    assert (-mirrored.high, -mirrored.low) == pytest.approx((found.low, found.high), rel=1e-12)
    assert cautious(np.repeat(values, 3), np.arange(24) // 3)[:3] == pytest.approx(found[:3], rel=1e-12)
    assert cautious([1.0, 2.0, 3.0]) == pytest.approx(estimate([1.0, 2.0, 3.0]))  # not skewed
    assert cautious([2.0, 2.0]) == estimate([2.0, 2.0])
    assert cautious([1.0, 1.0, 0.0]) == share([1.0, 1.0, 0.0])


def test_one_seed_has_no_interval():
    for found in (share([1.0, 0.0, 1.0], [4, 4, 4]), estimate([2.0, 3.0], [4, 4]), interval([1.0])):
        assert not found.known
        assert math.isnan(found.high)


def test_values_are_taken_for_a_share_only_if_all_are_zero_or_one():
    assert interval([0.0, 1, 1, math.nan]) == share([0.0, 1, 1])
    assert interval([0.0, 1, 2]) == estimate([0.0, 1, 2])
    assert str(interval([math.nan])) == "-"


def test_a_paired_difference_has_the_interval_of_the_differences():
    one, other = np.array([1.0, 2, 4, 8, math.nan]), np.array([2.0, 3, 6, 9, 1])
    found = paired(one, other)
    theirs = stats.ttest_rel(other[:4], one[:4]).confidence_interval()
    assert (found.mean.low, found.mean.high) == pytest.approx((theirs.low, theirs.high), rel=1e-12)
    assert found.mean.size == 4
    assert found.correlation == pytest.approx(stats.pearsonr(one[:4], other[:4]).statistic, rel=1e-12)
    assert paired([1.0, 2, 3], [3.0, 2, 1]).correlation == pytest.approx(-1.0)
    assert math.isnan(paired([1.0, 1, 1], [3.0, 2, 1]).correlation)


def test_a_difference_of_other_seeds_has_the_interval_of_welch():
    one, other = [1.0, 2, 4, 8], [2.0, 3, 9]
    theirs = stats.ttest_ind(other, one, equal_var=False).confidence_interval()
    found = unpaired(one, other)
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), rel=1e-9)
    assert not unpaired([1.0], other).known
    assert unpaired([1.0, 1], [3.0, 3]) == Estimate(2.0, 2.0, 2.0, 4)


def test_the_bootstrap_is_that_of_scipy_and_the_same_each_time():
    values = Streams(1)("values").exponential(size=20)
    found = bootstrapped(values)
    theirs = stats.bootstrap((values,), np.mean, method="BCa", rng=np.random.Generator(np.random.PCG64(9)))
    assert (found.low, found.high) == pytest.approx(tuple(theirs.confidence_interval), rel=0.02)
    assert found == bootstrapped(values)
    assert found.high - found.mean > found.mean - found.low  # as the data are skewed
    assert bootstrapped(values, np.median).mean == np.median(values)


def test_a_bootstrap_of_nothing_that_varies_has_no_interval():
    assert not bootstrapped([2.0, 2.0, 2.0]).known
    assert not bootstrapped([2.0]).known
    assert bootstrapped([]).size == 0


@pytest.mark.parametrize(
    ("found", "within", "bound", "needed"),
    [
        (Estimate(2.4, 2.31, 2.49, 10), True, 2.16, None),
        (Estimate(2.4, 2.16, 2.64, 10), True, 2.16, None),
        (Estimate(2.8, 2.7, 2.9, 10), False, 2.64, None),
        (Estimate(2.0, 1.9, 2.1, 10), False, 2.16, None),
        (Estimate(2.54, 2.34, 2.74, 10), None, 2.64, 40),  # twice as far as it is to the bound: four times as many
        (Estimate(2.74, 2.54, 2.94, 10), None, 2.64, 40),
        (Estimate(2.54, 2.52, 2.74, 10), None, 2.64, 40),  # the end towards the bound counts
        (Estimate(2.74, 2.54, 2.76, 10), None, 2.64, 40),
        (Estimate(2.64, 2.54, 2.74, 10), None, 2.64, None),
        (Estimate(2.64 + 1e-6, 2.54, 2.74, 10), None, 2.64, None),
        (Estimate(2.5, math.nan, math.nan, 1), None, 2.64, None),
    ],
)
def test_an_interval_lies_inside_outside_or_across(
    found: Estimate, within: bool | None, bound: float, needed: int | None
):
    placed = place(found, 2.16, 2.64, 10)
    assert (placed.within, placed.bound) == (within, pytest.approx(bound))
    assert placed.needed == (needed and pytest.approx(needed, abs=1))


def test_a_share_that_is_all_ones_needs_as_many_replicates_as_wilson_says():
    found = share(np.ones(400), np.arange(400) // 100)  # 4 seeds of which each always agrees: 0.51 to 1
    placed = place(found, 0.96, 1.02, 4)
    assert (placed.within, placed.bound) == (None, 0.96)  # no share lies above the other one
    assert placed.needed == 93  # n / (n + 1.96^2) >= 0.96 from n = 92.2 on
    assert place(share(np.ones(93)), 0.96, 1.02, 93).within is True
    assert place(share(np.ones(92)), 0.96, 1.02, 92).within is None


def test_a_range_may_be_open_at_one_end():
    assert place(Estimate(5.0, 4.0, 6.0, 9), 3.0, math.inf, 9).within is True
    assert place(Estimate(5.0, 4.0, 6.0, 9), -math.inf, 3.0, 9).within is False
    assert place(Estimate(5.0, 4.0, 6.0, 9), -math.inf, 5.5, 9).needed == 36
