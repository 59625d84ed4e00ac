"""A lane: boxes of one robot and radio, sorted by their starts."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from cosim.timeline.codes import Named
from cosim.units import Time

Array: TypeAlias = np.ndarray[Any, np.dtype[Any]]


class Boxes(NamedTuple):
    """Boxes in columns of equal length, sorted by (start, row)."""

    starts: Array
    """int64, ns"""
    ends: Array
    """int64, ns; equal to its start for an instant"""
    kinds: Array
    """uint16"""
    outcomes: Array
    """uint8"""
    rows: Array
    """uint32, number of the row in the table that the lane is made from"""
    peers: Array
    """int16, the robot at the other end of a frame, message or link; -1 for all or none"""

    def taken(self, which: Any) -> "Boxes":
        """Return those that *which* selects: a slice, numbers, or a mask."""
        return Boxes(*(column[which] for column in self))


DTYPES = Boxes(np.int64, np.int64, np.uint16, np.uint8, np.uint32, np.int16)  # type: ignore[arg-type]
"""Types of the columns."""


def no_boxes() -> Boxes:
    """Return none."""
    return Boxes(*(np.zeros(0, dtype=dtype) for dtype in DTYPES))


@dataclass
class Lane:
    """The boxes of one lane, and what makes it quick to find some of them."""

    named: Named
    table: str
    """Name of the table that the rows belong to."""
    boxes: Boxes
    longest: Time = 0
    """The longest duration among those of boxes that may overlap."""
    disjoint: bool = False
    """Whether no two boxes overlap, so that ends are sorted too."""
    levels: Any = None
    """Its :class:`cosim.timeline.levels.Levels`, of its first boxes."""
    under_way: Boxes = field(default_factory=no_boxes)
    """Boxes that have not ended yet; their rows are no rows of the table."""

    def span(self, start: Time, end: Time) -> slice:
        """Return a slice with all boxes that overlap [start, end), or are instants in it; it may have others."""
        starts, ends = self.boxes.starts, self.boxes.ends
        if self.disjoint:
            first = int(np.searchsorted(starts, start, side="left"))
            first -= first > 0 and int(ends[first - 1]) > start
        else:
            first = int(np.searchsorted(starts, start - self.longest, side="left"))
        return slice(first, max(first, int(np.searchsorted(starts, end, side="left"))))

    def start_of(self, row: int) -> Time | None:
        """Return when the box of *row* begins; None if there is none."""
        found = np.flatnonzero(self.boxes.rows == row)
        return int(self.boxes.starts[found[0]]) if len(found) else None

    def within(self, start: Time, end: Time) -> Boxes:
        """Return the boxes that overlap [start, end), or are instants in it, oldest first."""
        found = self.boxes.taken(self.span(start, end))
        if not self.disjoint:
            found = found.taken(overlapping(found, start, end))
        if not len(self.under_way.starts):
            return found
        more = self.under_way.taken(overlapping(self.under_way, start, end))
        both = Boxes(*(np.concatenate(pair) for pair in zip(found, more, strict=True)))
        return both.taken(np.argsort(both.starts, kind="stable"))


def overlapping(boxes: Boxes, start: Time, end: Time) -> Array:
    """Return a mask of the *boxes* that overlap [start, end), or are instants in it."""
    mask: Array = (boxes.starts < end) & ((boxes.ends > start) | (boxes.starts >= start))
    return mask
