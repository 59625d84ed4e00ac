"""Progress: a distance that falls by enough counts, whatever it does in between."""

import math

from hypothesis import given
from hypothesis import strategies as st

from protocols.motion.progress import Progress

WAYS = st.lists(st.floats(0.0, 100.0), max_size=30)


def test_a_way_that_falls_by_less_than_counts_is_no_progress_until_it_has_fallen_by_more() -> None:
    progress = Progress(0.5, 3)
    assert progress.look(10.0, 4)
    assert [
        progress.look(left_m, now) for now, left_m in enumerate((9.8, 9.6, 9.5, 9.49, 12.0, 9.3, 8.9), start=5)
    ] == [*(False, False, False, True, False, False, True)]
    assert progress.held(20) == 20 - 11


def test_it_begins_again_with_another_way() -> None:
    progress = Progress(0.5)
    progress.look(1.0, 5)
    progress.begin(7)
    assert (progress.least_m, progress.held(9)) == (math.inf, 2)
    progress.begin(10, 4.0)
    assert not progress.look(3.6, 11)
    assert progress.look(3.4, 12)


@given(WAYS, st.floats(0.0, 5.0))
def test_the_least_way_that_counted_is_never_undercut_by_more(ways_m: list[float], nearer_m: float) -> None:
    progress, last = Progress(nearer_m), 0
    for now, left_m in enumerate(ways_m):
        if progress.look(left_m, now):
            last = now
    if ways_m:
        assert progress.since == last
        assert progress.least_m - nearer_m <= min(ways_m) + 1e-9
