"""What is in a window of time: boxes where there are few, cells where there are more than a screen can show."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cosim.timeline.lanes import Array, Boxes, Lane
from cosim.timeline.levels import Cells, Entries, cell_range, cells_of, pieces
from cosim.units import Time

MOST_BOXES: Final = 5000
"""Maximum number of boxes in an answer, over all lanes; those of the lanes with the fewest come first."""


class Window(NamedTuple):
    """An answer: what is in each lane that was asked for."""

    start: Time
    """Where the first cell begins, at or before the start that was asked for."""
    step: Time
    """Width of the cells: the greatest power of two up to the step that was asked for."""
    parts: list[Boxes | Cells]


def window(lanes: Sequence[Lane], start: Time, end: Time, step: Time, lost: Array) -> Window:
    """Return what overlaps [start, end) in *lanes*; an empty one is the instant *start*.

    *lost*: whether boxes are, by their codes of outcomes.
    """
    end = max(end, start + 1)
    shift = max(1, step).bit_length() - 1
    counts = [_count(lane, start, end) for lane in lanes]
    as_boxes, room = set(), MOST_BOXES
    for at in sorted(range(len(lanes)), key=counts.__getitem__):
        room -= counts[at]
        if room < 0:
            break
        as_boxes.add(at)
    first, after = cell_range(start, end, shift)
    parts: list[Boxes | Cells] = [
        lane.within(start, end) if at in as_boxes else cells(lane, shift, first, after, lost)
        for at, lane in enumerate(lanes)
    ]
    return Window(first << shift, 1 << shift, parts)


def _count(lane: Lane, start: Time, end: Time) -> int:
    span = lane.span(start, end)
    return int(span.stop) - int(span.start) + len(lane.under_way.starts)


def cells(lane: Lane, shift: int, first: int, end: int, lost: Array) -> Cells:
    """Return the cells of width 2^shift ns of *lane* from number *first* to before *end*."""
    start, stop = first << shift, end << shift
    found = None if lane.levels is None else lane.levels.entries(shift, first, end)
    if found is None:
        parts = [pieces(lane.within(start, stop), lost, shift, first, end)]
    else:
        span = lane.span(start, stop)
        rest = lane.boxes.taken(slice(max(span.start, lane.levels.summed), span.stop))
        more = (boxes for boxes in (rest, lane.under_way) if len(boxes.starts))
        parts = [found, *(pieces(boxes, lost, shift, first, end) for boxes in more)]
    entries = parts[0] if len(parts) == 1 else Entries(*map(np.concatenate, zip(*parts, strict=True)))
    return cells_of(entries, shift, first, end - first)
