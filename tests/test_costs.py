"""Frames, robot-ticks and inquiries take no more kernel events and Python calls than before: counts, and no clock."""

import sys

import pytest

from benchmarks.costs import KEPT, MEASURES, PYTHON, RENEW, Cost, changes, cost, counted, kept
from cosim.kernel import Kernel
from cosim.units import S, to_seconds

here = pytest.mark.skipif(
    sys.version_info[:2] != PYTHON, reason=f"counts are kept of Python {'.'.join(map(str, PYTHON))}"
)


@here
@pytest.mark.slow
@pytest.mark.parametrize("name", MEASURES)
def test_no_count_has_moved_by_a_tenth(name: str):
    lines = changes(name, cost(MEASURES[name]), kept().get(name))
    if lines:
        pytest.fail("\n".join(lines), pytrace=False)


def test_nothing_is_kept_that_is_not_measured():
    assert set(kept()) <= set(MEASURES), f"{KEPT.name}: {RENEW}"


def test_growth_and_savings_beyond_a_tenth_are_told_with_how_to_keep_them():
    before = Cost(10.0, 100.0)
    assert changes("a frame", Cost(11.0, 91.0), before) == []
    assert changes("a frame", Cost(11.1, 100.0), before) == [
        "a frame: kernel events were 10, now 11.1: too many; if that is meant: python -m benchmarks.costs --write"
    ]
    assert changes("a frame", Cost(10.0, 90.0), before) == [
        "a frame: Python calls were 100, now 90: fewer; keep that: python -m benchmarks.costs --write"
    ]
    assert len(changes("a frame", Cost(1.0, 200.0), before)) == 2
    assert "nothing was kept" in changes("a frame", before, None)[0]


def test_events_are_those_that_kernels_execute_in_the_work():
    def prepare(seed):
        kernel = Kernel()
        kernel.every(10, lambda: None)
        kernel.run(101)

        def work():
            kernel.run(kernel.now + 500)
            return 25

        return work

    assert cost(prepare).events == 2.0


def test_calls_are_those_of_our_functions():
    def work():
        return float(sum(len(str(to_seconds(S))) for _ in range(7)))

    assert counted(work) == (7 * len("1.0"), 7)


def test_counting_leaves_the_profiler_as_it_was():
    def profiler(frame, event, argument):
        pass

    sys.setprofile(profiler)
    try:
        counted(lambda: 1.0)
        assert sys.getprofile() is profiler
    finally:
        sys.setprofile(None)
