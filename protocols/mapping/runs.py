"""Map cells as runs: neighbours in a row that are in the same state, which is how maps travel.

A run is a word of 32 bits: the first cell (22 bits, so that a map has at most 4,194,304 cells), whether the cells are
occupied or empty (1 bit), and their number less one (9 bits). Unknown cells are not told.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.arrays import Bools, Int32s, Words
from cosim.geometry.grids import Cell

MOST_CELLS: Final = 1 << 22
LONGEST: Final = 1 << 9
_OCCUPIED: Final = 1 << 9


def to_runs(cells: Sequence[Cell] | Int32s, occupied: Sequence[bool] | Bools) -> Words:
    """Return the runs (n,) of *cells*, in any order and without doubles, of which some are *occupied*.

    A run may go on from the end of a row to the beginning of the next.
    """
    order = np.argsort(cells, kind="stable")
    sorted_cells = np.asarray(cells, np.int64)[order]
    states = np.asarray(occupied, np.bool_)[order]
    if not len(sorted_cells):
        return np.empty(0, np.uint32)
    broken = (np.diff(sorted_cells) != 1) | (np.diff(states.view(np.int8)) != 0)
    starts = np.concatenate(([0], np.flatnonzero(broken) + 1))
    lengths = np.diff(np.concatenate((starts, [len(sorted_cells)])))
    pieces = -(-lengths // LONGEST)
    nth = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    firsts = np.repeat(sorted_cells[starts], pieces) + nth * LONGEST
    sizes = np.minimum(np.repeat(lengths, pieces) - nth * LONGEST, LONGEST)
    occupancy = np.where(np.repeat(states[starts], pieces), _OCCUPIED, 0)
    words: Words = (firsts << 10 | occupancy | sizes - 1).astype(np.uint32)
    return words


def from_runs(words: Words) -> tuple[Int32s, Bools]:
    """Return the cells (n,) that the runs name, and which of them are occupied (n,)."""
    wide = words.astype(np.int64)
    sizes = (wide & LONGEST - 1) + 1
    firsts = np.repeat(wide >> 10, sizes)
    nth = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return (firsts + nth).astype(np.int32), np.repeat(wide & _OCCUPIED != 0, sizes)


def fits(words: Words, cells: int) -> bool:
    """Return whether all runs lie on a map of so many *cells*."""
    wide = words.astype(np.int64)
    return bool(np.all((wide >> 10) + (wide & LONGEST - 1) < cells))
