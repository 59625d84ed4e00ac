"""Numbered rows of a run, oldest first: all of a recorded one, or the latest of one that is under way."""

from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Any, Protocol, TypeAlias

import numpy as np

from cosim.trace import TableFile
from cosim.units import Time

Row: TypeAlias = list[Any]
"""Plain data, as a page gets it."""


class Rows(Protocol):
    """Rows that are numbered from 0, of which the oldest may be gone."""

    @property
    def first(self) -> int:
        """Number of the oldest row that is kept."""

    def until(self, time: Time) -> int:
        """Return the number of rows up to *time*, those that are gone included."""

    def between(self, first: int, end: int, step: int = 1) -> list[Row]:
        """Return the rows from number *first* to before *end*, each *step*-th of them."""


class Stored:
    """Rows of a recorded run, which are read when they are asked for."""

    def __init__(self, times: np.ndarray[Any, np.dtype[np.int64]], read: Callable[[int, int, int], list[Row]]) -> None:
        """Take the sorted *times* of the rows, and *read*, (first, end, step) -> the rows with these numbers."""
        self._times = times
        self._read = read

    @property
    def first(self) -> int:
        """Number of the oldest row that is kept."""
        return 0

    def until(self, time: Time) -> int:
        """Return the number of rows up to *time*."""
        return int(np.searchsorted(self._times, time, side="right"))

    def between(self, first: int, end: int, step: int = 1) -> list[Row]:
        """Return the rows from number *first* to before *end*, each *step*-th of them."""
        return self._read(max(0, first), min(end, len(self._times)), step)


class Filed:
    """Rows of a recorded run that are too many for the memory."""

    def __init__(self, table: TableFile, read: Callable[[int, int, int], list[Row]]) -> None:
        """Take the *table*, and *read*, (first, end, step) -> the rows with these numbers."""
        self._table = table
        self._read = read

    @property
    def first(self) -> int:
        """Number of the oldest row that is kept."""
        return 0

    def until(self, time: Time) -> int:
        """Return the number of rows up to *time*."""
        return self._table.until(time)

    def between(self, first: int, end: int, step: int = 1) -> list[Row]:
        """Return the rows from number *first* to before *end*, each *step*-th of them."""
        return self._read(max(0, first), min(end, len(self._table)), step)


class Rolling:
    """The latest rows of a run that is under way, where every time that is asked for is that of the latest row."""

    def __init__(self, most: int) -> None:
        self._rows: deque[Row] = deque(maxlen=most)
        self._count = 0

    @property
    def first(self) -> int:
        """Number of the oldest row that is kept."""
        return self._count - len(self._rows)

    def append(self, row: Row) -> None:
        """Add *row*; drop the oldest one if there are too many."""
        self._rows.append(row)
        self._count += 1

    def until(self, time: Time) -> int:
        """Return the number of rows so far, those that are gone included."""
        return self._count

    def between(self, first: int, end: int, step: int = 1) -> list[Row]:
        """Return the rows from number *first* to before *end* that are kept, each *step*-th of them."""
        gone = self.first
        return list(islice(self._rows, max(0, first - gone), max(0, end - gone), step))
