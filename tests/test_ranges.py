"""Numbers as text in tables: ranges of those that follow each other."""

import numpy as np
import pytest

from cosim.ranges import numbers_of, pairs_of, ranges_of


@pytest.mark.parametrize(
    ("numbers", "ranges"),
    [([], ""), ([4], "4"), ([1, 2, 3], "1-3"), ([0, 2, 3, 7, 8, 9, 11], "0,2-3,7-9,11"), ([0, 1, 7, 5], "0-1,7,5")],
)
def test_numbers_are_written_as_ranges_in_their_order(numbers: list[int], ranges: str):
    assert ranges_of(numbers) == ranges_of(np.array(numbers, dtype=np.int64)) == ranges
    assert numbers_of(ranges).tolist() == numbers
    assert [number for first, last in pairs_of(ranges) for number in range(first, last + 1)] == numbers
