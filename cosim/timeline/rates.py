"""How many payloads were delivered, and how many frames lost, in equal parts of a window of time."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from cosim.timeline.lanes import Array, Lane
from cosim.units import Time


class Rates(NamedTuple):
    """Numbers in each part, oldest first."""

    delivered: Array
    """int64, messages that have arrived at a host"""
    lost: Array
    """int64, frames to a robot that it has not received, counted where they begin; without those to all robots"""


def rates(lanes: Iterable[Lane], start: Time, step: Time, parts: int, lost: Array) -> Rates:
    """Return what there is in *parts* of *step* ns from *start* on; *lost*: whether boxes are, by codes of outcomes."""
    edges = start + step * np.arange(parts + 1, dtype=np.int64)
    found = Rates(np.zeros(parts, dtype=np.int64), np.zeros(parts, dtype=np.int64))
    for lane in lanes:
        starts = lane.boxes.starts
        if lane.named.what == "messages":
            found.delivered[:] += np.diff(np.searchsorted(starts, edges))
        elif lane.named.what == "received":
            first, end = np.searchsorted(starts, edges[[0, -1]])
            bad = starts[first:end][lost[lane.boxes.outcomes[first:end]]]
            found.lost[:] += np.diff(np.searchsorted(bad, edges))
    return found
