"""Runs of cells: golden words, there and back, and what does not lie on a map."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.mapping.runs import LONGEST, MOST_CELLS, fits, from_runs, to_runs

maps = st.dictionaries(st.integers(0, 40) | st.integers(MOST_CELLS - 3, MOST_CELLS - 1), st.booleans(), max_size=30)
EMPTY, OCCUPIED = 0, 1 << 9


def there_and_back(cells: dict[int, bool]) -> dict[int, bool]:
    found, occupied = from_runs(to_runs(np.array(list(cells), np.int32), list(cells.values())))
    assert len(found) == len(cells)
    return dict(zip(found.tolist(), occupied.tolist(), strict=True))


@given(maps)
def test_cells_in_any_order_come_back(cells: dict[int, bool]) -> None:
    assert there_and_back(cells) == cells


@given(maps)
def test_there_are_no_more_runs_than_changes(cells: dict[int, bool]) -> None:
    """Counted one by one: a run begins where the cell before it is not told, or in the other state."""
    words = to_runs(np.array(list(cells), np.int32), list(cells.values()))
    assert len(words) == sum(cells.get(cell - 1) is not state for cell, state in cells.items())


def test_runs_are_words_of_first_cell_state_and_length() -> None:
    words = to_runs([7, 5, 6, 8, 100, MOST_CELLS - 1], [False, False, False, True, True, False])
    assert words.dtype == np.uint32
    assert words.tolist() == [5 << 10 | 2, 8 << 10 | OCCUPIED, 100 << 10 | OCCUPIED, (MOST_CELLS - 1) << 10]


@pytest.mark.parametrize(
    ("length", "lengths"), [(LONGEST, [512]), (LONGEST + 1, [512, 1]), (3 * LONGEST - 1, [512, 512, 511])]
)
def test_long_runs_are_cut(length: int, lengths: list[int]) -> None:
    cells = {9 + k: True for k in range(length)}
    words = to_runs(np.array(list(cells), np.int32), list(cells.values()))
    firsts = [9 + 512 * k for k in range(len(lengths))]
    assert words.tolist() == [first << 10 | OCCUPIED | size - 1 for first, size in zip(firsts, lengths, strict=True)]
    assert there_and_back(cells) == cells


def test_runs_fit_if_their_last_cell_does() -> None:
    words = to_runs([3, 4, 5, 9], [True] * 4)
    assert fits(words, 10)
    assert not fits(words, 9)
    assert not fits(np.array([9 << 10 | EMPTY | 1], np.uint32), 10)
    assert fits(np.empty(0, np.uint32), 0)


@given(st.lists(st.integers(0, 2**32 - 1), max_size=8), st.integers(1, MOST_CELLS))
def test_any_words_are_runs_and_those_that_fit_name_cells_of_the_map(words: list[int], cells: int) -> None:
    runs = np.array(words, np.uint32)
    found, occupied = from_runs(runs)
    assert len(found) == len(occupied) == sum(word % 512 + 1 for word in words)
    assert fits(runs, cells) == bool(np.all(found < cells))
