"""Marks on the slider of time: when events of which kinds happen in a recorded run, few enough for a page to draw."""

from typing import Final

import numpy as np

from cosim.arrays import Int64s
from cosim.timeline.lanes import Array
from cosim.units import S
from cosim.web.messages import Plain

MOST_MARKS: Final = 2000
"""Maximum number of marks: of more events, the first of each kind and robot in each of equal parts of the run."""


def marks_of(times: Int64s, robots: Array, names: Array) -> Plain:
    """Return the marks of events, whose columns are given in the order of their *times*.

    ``kinds`` are the names, sorted, and ``rows`` have a time (s), the robot and the number of the kind, by time. The
    robot is null if kinds and robots are too many for a mark of each: then a mark stands for events of any robot.
    """
    kinds, codes = np.unique(names.astype(str), return_inverse=True)
    groups, group = np.unique(np.stack([codes, robots.astype(np.int64)]), axis=1, return_inverse=True)
    of_each = groups.shape[1] <= MOST_MARKS
    chosen = _chosen(times, group.ravel() if of_each else codes)
    seconds = (times[chosen] / S).tolist()
    shown = robots[chosen].tolist() if of_each else [None] * len(chosen)
    rows = [list(row) for row in zip(seconds, shown, codes[chosen].tolist(), strict=True)]
    return {"kinds": kinds.tolist(), "rows": rows}


def _chosen(times: Int64s, group: Array) -> Array:
    """Return the numbers of the events that have marks."""
    if len(times) <= MOST_MARKS:
        return np.arange(len(times))
    parts = max(1, MOST_MARKS // (int(group.max()) + 1))
    part = (times - times[0]) * parts // (int(times[-1] - times[0]) + 1)
    return np.sort(np.unique(group.astype(np.int64) * parts + part, return_index=True)[1])
