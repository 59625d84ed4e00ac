"""What lies in a part of time, counted and added up: boxes by kind, and the first and the last frame."""

from collections import defaultdict
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from cosim.timeline.codes import CHANNEL, PICONET
from cosim.timeline.lanes import Array, Boxes, Lane, overlapping
from cosim.trace import FRAMES
from cosim.units import Time

_CELLS: Final = 64
"""Cells of the levels that a region has about: the boxes of those that it cuts are looked at one by one."""


class Sum(NamedTuple):
    """Boxes of one kind."""

    number: int
    """How many of them begin in the region."""
    lost: int
    """How many of these are lost."""
    time: Time
    """How long they last together, only as far as they lie in the region, ns."""


class Span(NamedTuple):
    """When a frame begins and ends, ns."""

    start: Time
    end: Time


class Region(NamedTuple):
    """What lies in [start, end)."""

    sums: dict[tuple[str, int], Sum]
    """By what a lane is of, and the code of a kind."""
    first: Span | None
    """The frame that begins first; of several the one that ends first. None if no frame begins in the region."""
    last: Span | None
    """The frame that begins last; of several the one that ends last."""
    received: Array
    """Numbers of rows of the table ``frames``: those that begin in the region, are to one robot, and were received."""


def region(lanes: Iterable[Lane], start: Time, end: Time, lost: Array) -> Region:
    """Return what lies in [start, end) of *lanes*, exactly; those of channels and piconets show the same: left out.

    *lost*: whether boxes are, by their codes of outcomes.
    """
    sums: defaultdict[tuple[str, int], list[int]] = defaultdict(lambda: [0, 0, 0])
    firsts, lasts, received = [], [], [np.zeros(0, dtype=np.uint32)]
    for lane in lanes:
        what = lane.named.what
        if what in (PICONET, CHANNEL):
            continue
        for kind, count, time in _sums(lane, start, end):
            sums[what, kind][0] += count
            sums[what, kind][2] += time
        begun = _begun(lane.boxes, start, end)
        bad = lost[begun.outcomes]
        for kind, count in enumerate(np.bincount(begun.kinds[bad]).tolist()):
            if count:
                sums[what, kind][1] += count
        if what == "received" and lane.table == FRAMES.name:
            received.append(begun.rows[~bad])
        if what == "sent" and len(begun.starts):
            first, last = begun.starts == begun.starts[0], begun.starts == begun.starts[-1]
            firsts.append(Span(int(begun.starts[0]), int(begun.ends[first].min())))
            lasts.append(Span(int(begun.starts[-1]), int(begun.ends[last].max())))
    found = {key: Sum(*numbers) for key, numbers in sums.items()}
    return Region(found, min(firsts, default=None), max(lasts, default=None), np.concatenate(received))


def _begun(boxes: Boxes, start: Time, end: Time) -> Boxes:
    """Return those that begin in [start, end)."""
    return boxes.taken(slice(*np.searchsorted(boxes.starts, (start, end)).tolist()))


def _sums(lane: Lane, start: Time, end: Time) -> list[tuple[int, int, Time]]:
    """Return kind, count and time of the boxes of *lane* in [start, end); whole cells of its levels count as such."""
    levels = lane.levels
    shift = 0 if levels is None else max(levels.lowest, ((end - start) // _CELLS).bit_length() - 1)
    first, after = -(-start >> shift), end >> shift
    if levels is None or first >= after:
        parts = [_looked_at(lane.within(start, end), start, end)]
    else:
        low, high = first << shift, after << shift
        entries = levels.entries(shift, first, after)
        summed = lane.boxes.taken(slice(0, levels.summed)), lane.boxes.taken(slice(levels.summed, None))
        known = Lane(lane.named, lane.table, summed[0], lane.longest, lane.disjoint)
        rest = Lane(lane.named, lane.table, summed[1], lane.longest, lane.disjoint, under_way=lane.under_way)
        parts = [(entries.kinds, entries.counts, entries.times)]
        parts += [_looked_at(known.within(*edge), *edge) for edge in ((start, low), (high, end)) if edge[0] < edge[1]]
        parts.append(_looked_at(rest.within(start, end), start, end))
    kinds, counts, times = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return [
        (kind, int(counts[which].sum(dtype=np.int64)), int(times[which].sum(dtype=np.int64)))
        for kind in np.unique(kinds).tolist()
        for which in (kinds == kind,)
    ]


def _looked_at(boxes: Boxes, start: Time, end: Time) -> tuple[Array, Array, Array]:
    """Return for each of *boxes* its kind, whether it begins in [start, end), and how long it lies in there, ns."""
    inside = boxes.taken(overlapping(boxes, start, end))
    times = np.minimum(inside.ends, end) - np.maximum(inside.starts, start)
    return inside.kinds, inside.starts >= start, times
