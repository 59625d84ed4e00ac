"""The next box of a kind, of a robot, or that is lost, forwards and backwards in time."""

from collections.abc import Iterable
from typing import Final, Literal, NamedTuple

import numpy as np

from cosim.timeline.lanes import Array, Lane
from cosim.units import Time

_FEWEST: Final = 1 << 12
_MOST: Final = 1 << 18
"""Boxes that are looked at together, in the first step and at most."""


class Wanted(NamedTuple):
    """What is looked for; None for what does not matter."""

    kind: int | None = None
    robot: int | None = None
    lost: bool = False


class Place(NamedTuple):
    """Where a box is, in the order in which boxes are found."""

    start: Time
    lane: int
    row: int


def find(
    lanes: Iterable[tuple[int, Lane]],
    wanted: Wanted,
    begin: Time,
    back: bool,
    lost: Array,
    present: tuple[int, int] | None = None,
) -> Place | None:
    """Return the first box of *lanes*, numbered ones, from *begin* on, or if *back* the last one before; None if none.

    With *present*, the (lane, row) of a box that begins at *begin*, it is the next one after that, or before, in the
    order of starts, lanes and rows. *lost*: whether boxes are, by their codes of outcomes.
    """
    best: Place | None = None
    here = None if present is None else Place(begin, *present)
    for at, lane in lanes:
        if wanted.robot is None or lane.named.robot == wanted.robot:
            found = _in_lane(at, lane, wanted, begin, back, lost, here, best)
            if found is not None and (best is None or (found > best if back else found < best)):
                best = found
    return best


def _in_lane(
    number: int,
    lane: Lane,
    wanted: Wanted,
    begin: Time,
    back: bool,
    lost: Array,
    here: Place | None,
    best: Place | None,
) -> Place | None:
    starts = lane.boxes.starts
    side: Literal["left", "right"] = "right" if back and here is not None else "left"
    at = int(np.searchsorted(starts, begin, side=side))
    size = _FEWEST
    while (at > 0) if back else (at < len(starts)):
        low, high = (max(0, at - size), at) if back else (at, min(len(starts), at + size))
        if best is not None and (int(starts[high - 1]) < best.start if back else int(starts[low]) > best.start):
            return None
        hits = np.flatnonzero(_fits(lane, slice(low, high), wanted, lost))
        for hit in hits[::-1] if back else hits:
            box = low + int(hit)
            place = Place(int(starts[box]), number, int(lane.boxes.rows[box]))
            if here is None or (place < here if back else place > here):
                return place
        at, size = (low if back else high), min(2 * size, _MOST)
    return None


def _fits(lane: Lane, part: slice, wanted: Wanted, lost: Array) -> Array:
    kinds, outcomes = lane.boxes.kinds[part], lane.boxes.outcomes[part]
    mask = np.ones(len(kinds), dtype=bool) if wanted.kind is None else kinds == wanted.kind
    return mask & lost[outcomes] if wanted.lost else mask
