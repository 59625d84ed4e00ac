"""Boxes summed up by cells of time, whose width is a power of two of nanoseconds: what windows of many boxes show.

An entry is about a cell and a kind: how long boxes of the kind cover the cell, how many of them begin in it, and
whether a lost one touches it. Entries of two cells add up to those of the cell of twice the width, so that each level
follows from the one below. Cells without boxes have no entries.
"""

from typing import Final, NamedTuple

import numpy as np

from cosim.timeline.codes import NO_KIND
from cosim.timeline.lanes import Array, Boxes
from cosim.units import Time

FEWEST: Final = 4096
"""Boxes that a lane must have for levels to be kept: fewer are summed up when they are asked for."""
SHARE: Final = 2
"""The lowest level has at most this part of the boxes' number in entries."""
FEWEST_ENTRIES: Final = 64
"""Entries of a level that needs no coarser one."""
MOST_SHIFT: Final = 61
_PART: Final = 1 << 18


class Entries(NamedTuple):
    """Entries in columns, sorted by (cell, kind)."""

    cells: Array
    """int64: the cell c of width 2^shift is [c 2^shift, (c + 1) 2^shift) ns"""
    kinds: Array
    """uint16"""
    times: Array
    """int64, ns"""
    counts: Array
    """uint32"""
    lost: Array
    """uint8, 0 or 1"""


ENTRY_DTYPES = Entries(np.int64, np.uint16, np.int64, np.uint32, np.uint8)  # type: ignore[arg-type]
"""Types of the columns."""


class Cells(NamedTuple):
    """Neighbouring cells, in columns."""

    codes: Array
    """uint16: the kind that covers most of it, or else of which most boxes begin there; kinds of lost boxes first"""
    shares: Array
    """uint8: what part of the cell all its boxes cover, 255 for all of it or more; at least 1 if any does"""
    lost: Array
    """uint8, 0 or 1"""
    counts: Array
    """uint32: how many boxes begin in it"""


class Levels(NamedTuple):
    """The levels of the first *summed* boxes of a lane."""

    lowest: int
    """The width of the cells of the lowest level is 2^lowest ns; that of each next one is twice as much."""
    levels: list[Entries]
    summed: int

    def entries(self, shift: int, first: int, end: int) -> Entries | None:
        """Return entries of the cells from *first* to before *end* of width 2^shift, not yet added up.

        None if the lowest level is too coarse.
        """
        if shift < self.lowest:
            return None
        at = min(shift - self.lowest, len(self.levels) - 1)
        level, more = self.levels[at], shift - self.lowest - at
        low, high = np.searchsorted(level.cells, (first << more, end << more)).tolist()
        cut = Entries(*(column[low:high] for column in level))
        return cut._replace(cells=cut.cells >> more)


def pieces(boxes: Boxes, lost: Array, shift: int, first: int = 0, end: int = 1 << 62) -> Entries:
    """Return an entry for each of *boxes* and cell from *first* to before *end* of width 2^shift that it touches.

    *lost*: whether boxes are, by their codes of outcomes. The entries are not added up.
    """
    starts, ends = np.asarray(boxes.starts), np.asarray(boxes.ends)
    begin, last = starts >> shift, np.maximum(ends - 1, starts) >> shift
    low, high = np.maximum(begin, first), np.minimum(last, end - 1)
    touched = np.maximum(high - low + 1, 0)
    if not len(starts) or (int(touched.min()) == 1 == int(touched.max()) and (begin == last).all()):
        which, cells, times, counts = slice(None), begin, ends - starts, np.ones(len(starts), dtype=np.uint32)
        return Entries(cells, boxes.kinds[which], times, counts, lost[boxes.outcomes[which]].astype(np.uint8))
    numbers = np.repeat(np.arange(len(starts)), touched)
    before = np.cumsum(touched) - touched
    cells = low[numbers] + (np.arange(len(numbers)) - before[numbers])
    edges = cells << shift
    times = np.minimum(ends[numbers], edges + (1 << shift)) - np.maximum(starts[numbers], edges)
    counts = (cells == begin[numbers]).astype(np.uint32)
    return Entries(cells, boxes.kinds[numbers], times, counts, lost[boxes.outcomes[numbers]].astype(np.uint8))


def added(entries: Entries) -> Entries:
    """Return *entries* with those of one cell and kind added up, sorted by (cell, kind)."""
    if not len(entries.cells):
        return Entries(*(np.zeros(0, dtype=dtype) for dtype in ENTRY_DTYPES))
    keys = (entries.cells << 16) | entries.kinds
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    firsts = np.flatnonzero(np.concatenate(([True], keys[1:] != keys[:-1])))
    return Entries(
        keys[firsts] >> 16,
        (keys[firsts] & 0xFFFF).astype(np.uint16),
        np.add.reduceat(entries.times[order], firsts),
        np.add.reduceat(entries.counts[order], firsts).astype(np.uint32),
        np.maximum.reduceat(entries.lost[order], firsts),
    )


def levels_of(boxes: Boxes, lost: Array) -> Levels | None:
    """Return the levels of *boxes*; None for too few, or if the lowest were no shorter than they are."""
    count = len(boxes.starts)
    if count < FEWEST:
        return None
    first, last = int(boxes.starts[0]), int(np.max(boxes.ends))
    shift = max(1, 2 * (last - first) // count).bit_length()
    while _more(boxes, shift) > count:
        shift += 1
    level = _lowest(boxes, lost, shift)
    while len(level.cells) <= count // (8 * SHARE) and shift > 2 and _more(boxes, shift - 2) <= count:  # bursts
        finer = _lowest(boxes, lost, shift - 2)
        if len(finer.cells) > count // SHARE:
            break
        shift, level = shift - 2, finer
    while len(level.cells) > count // SHARE and shift < MOST_SHIFT:
        shift, level = shift + 1, _coarser(level)
    lowest, levels = shift, [level]
    while len(level.cells) > FEWEST_ENTRIES and shift < MOST_SHIFT:
        shift, level = shift + 1, _coarser(level)
        levels.append(level)
    return Levels(lowest, levels, count)


def _more(boxes: Boxes, shift: int) -> int:
    """Return how many cells of width 2^shift *boxes* touch beyond one or two each."""
    return int(((boxes.ends - boxes.starts) >> shift).sum())


def _coarser(level: Entries) -> Entries:
    return added(level._replace(cells=level.cells >> 1))


def _lowest(boxes: Boxes, lost: Array, shift: int) -> Entries:
    """Return the added entries of *boxes*, of a part of them at a time."""
    parts = [
        added(pieces(boxes.taken(slice(at, at + _PART)), lost, shift)) for at in range(0, len(boxes.starts), _PART)
    ]
    return added(Entries(*(np.concatenate(columns) for columns in zip(*parts, strict=True))))


def cells_of(entries: Entries, shift: int, first: int, count: int) -> Cells:
    """Return the *count* cells from number *first* on, of width 2^shift, from *entries* that are about no others."""
    used = np.flatnonzero(np.bincount(entries.kinds)).tolist()
    row = np.zeros(max(used, default=0) + 1, dtype=np.int64)
    row[used] = np.arange(len(used)) * count
    keys = row[entries.kinds] + (entries.cells - first)
    shape = len(used), count  # a row a kind: what is done to all its cells at once is fast
    times = np.bincount(keys, entries.times, len(used) * count).reshape(shape)
    begun = np.bincount(keys, entries.counts, len(used) * count).reshape(shape)
    there: Array = (times > 0) | (begun > 0)
    lost = np.zeros(count, dtype=bool)
    if entries.lost.any():
        bad: Array = np.bincount(keys, entries.lost, len(used) * count).reshape(shape) > 0
        np.any(bad, axis=0, out=lost)
        there &= bad | ~lost
    codes = np.full(count, NO_KIND, dtype=np.uint16)
    longest, most = np.full(count, -1.0), np.full(count, -1.0)
    for kind, own, time, begins in zip(used, there, times, begun, strict=True):
        better = own & ((time > longest) | ((time == longest) & (begins > most)))
        codes[better], longest[better], most[better] = kind, time[better], begins[better]
    shares: Array = np.ceil(times.sum(axis=0) * (255 / (1 << shift))).clip(max=255).astype(np.uint8)
    return Cells(codes, shares, lost.astype(np.uint8), begun.sum(axis=0).astype(np.uint32))


def cell_range(start: Time, end: Time, shift: int) -> tuple[int, int]:
    """Return the numbers of the first cell of width 2^shift that [start, end) touches, and of that after its last."""
    return start >> shift, ((end - 1) >> shift) + 1
