import itertools
import math

import numpy as np
import pytest
from scipy import stats

from cosim.errors import UserError
from cosim.randomness import Streams
from cosim.statistics.stopping import FIRST, Decision, decide, looks, parse_precisions, precise

ARMS = ("near", "far")
NAMES = [(arm, "delay_s") for arm in ARMS]
DRAWN = {key: Streams(1)("values", key[0]).normal(1.0, 0.3, size=400) for key in NAMES}


def rows(count: int, keys: list[tuple[str, str]] = NAMES) -> dict[tuple[str, str], dict[int, float]]:
    return {key: dict(enumerate(DRAWN[key][:count])) for key in keys}


def swept(wanted: dict[tuple[str, str], float], most: int, there: int = 0) -> int:
    """Return where a sweep that has *there* replicates stops."""
    while True:
        decision = decide(rows(there), wanted, most)
        if decision.stop:
            return decision.replicates
        assert decision.replicates > there
        there = decision.replicates


def test_looks_come_in_rounds_that_grow_up_to_the_most():
    assert list(looks(10, 22)) == [10, 12, 14, 16, 19, 22]
    assert list(looks(10, 10)) == [10]
    assert list(looks(10, 4)) == [4]


def test_a_sweep_stops_at_the_first_look_at_which_all_means_are_precise():
    wanted = dict.fromkeys(NAMES, 0.1)
    stop = swept(wanted, 400)
    assert stop in looks(FIRST, 400)
    for count in itertools.takewhile(lambda count: count <= stop, looks(FIRST, 400)):
        halves = [  # Student's t by the table of scipy, as the rule is written
            stats.t.ppf(0.975, count - 1)
            * np.std(DRAWN[key][:count], ddof=1)
            / math.sqrt(count)
            / abs(np.mean(DRAWN[key][:count]))
            for key in NAMES
        ]
        assert (max(halves) <= 0.1 / 1.1) == (count == stop)


@pytest.mark.parametrize("there", [0, 3, 10, 11, 37, 399, 400])
def test_it_stops_at_the_same_number_after_a_resume_and_with_more_than_it_needs(there: int):
    wanted = dict.fromkeys(NAMES, 0.06)
    assert swept(wanted, 400, there) == swept(wanted, 400)
    assert 10 < swept(wanted, 400) < 400


def test_the_order_of_arrival_does_not_matter():
    wanted = dict.fromkeys(NAMES, 0.06)
    order = Streams(2)("order").permutation(400)
    shuffled = {key: {int(each): values[int(each)] for each in order} for key, values in rows(400).items()}
    assert decide(shuffled, wanted, 400) == decide(rows(400), wanted, 400)
    gap = rows(400)
    del gap[NAMES[0]][4]
    assert decide(gap, wanted, 400) == Decision(10, False, 2)  # what is not there yet is waited for


def test_all_arms_and_metrics_decide():
    stops = [swept({key: 0.06}, 400) for key in NAMES]
    assert swept(dict.fromkeys(NAMES, 0.06), 400) >= max(stops)
    assert min(stops) < max(stops)


def test_there_is_a_hard_maximum_that_tells_what_is_lacking():
    assert decide(rows(30), dict.fromkeys(NAMES, 0.0001), 30) == Decision(30, True, 2)
    assert decide({}, dict.fromkeys(NAMES, 0.5), 30) == Decision(10, False, 2)
    with pytest.raises(ValueError, match="5 replicates before the first look, expected at least 10"):
        decide({}, {}, 30, first=5)


def test_runs_without_a_value_count_as_replicates_and_not_as_values():
    values = rows(12)
    values[NAMES[0]] |= dict.fromkeys(range(3), math.nan)
    assert decide(values, {NAMES[0]: 0.9}, 12) == Decision(12, True, 1)  # nine values
    assert decide(rows(12), {NAMES[0]: 0.9}, 12) == Decision(10, True, 0)


def test_what_always_happened_is_not_precise_at_once():
    assert not precise(np.ones(10), 0.05)
    assert precise(np.ones(80), 0.05)
    assert precise(np.full(10, 3.0), 0.05)
    assert not precise(np.zeros(1000), 0.5)


def test_precisions_are_read_from_the_command_line():
    assert parse_precisions(["delay_s=0.02", "a=b=0.5"]) == {"delay_s": 0.02, "a=b": 0.5}
    for text in ("delay_s", "=0.1", "delay_s=", "delay_s=0", "delay_s=1", "delay_s=nan", "delay_s=2 %"):
        with pytest.raises(UserError, match=r"expected a metric and its relative error, such as delay_s=0.02"):
            parse_precisions([text])
