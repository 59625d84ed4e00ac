"""How many payloads radios hold, and how long these have waited for their first frame, from the table ``payloads``."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.payloads import NEVER, HeldRow
from cosim.timeline.lanes import Array
from cosim.trace import PAYLOADS
from cosim.units import Time

COLUMNS: Final = ("source", "time_ns", "begun_ns", "end_ns")
"""Columns that are needed."""
_PLACES: Final = [[field.name for field in PAYLOADS.fields].index(name) for name in COLUMNS]


class Queue(NamedTuple):
    """The payloads of one robot's radios, or of all; int64, ns."""

    accepted: Array
    """Sorted: when radios have accepted them,"""
    ended: Array
    """and sorted for themselves: when these held them no more."""
    begun: Array
    """Sorted: when the first frame of each has begun, of those that were on the air,"""
    waited: Array
    """and how long that was after its acceptance."""

    def within(self, start: Time, end: Time) -> tuple[Array, Array]:
        """Return when the number that is held changes in [start, end), *start* before all, and what it is from then."""
        here = [times[slice(*np.searchsorted(times, (start, end)))] for times in (self.accepted, self.ended)]
        times = np.unique(np.concatenate(([start], *here)))
        accepted, ended = (np.searchsorted(of, times, side="right") for of in (self.accepted, self.ended))
        return times, (accepted - ended).astype(np.float64)


class Queues:
    """The queues of a run."""

    def __init__(self, columns: Mapping[str, Any], held: Sequence[HeldRow] = ()) -> None:
        """Take the *columns* of the table, and rows of payloads that are *held* yet; nothing is done before it is due.

        Who changes the columns makes others of these.
        """
        self._columns = columns
        self._held = held
        self.of = cache(self._of)

    def __bool__(self) -> bool:
        return len(self._held) > 0 or len(self._columns.get(COLUMNS[0], ())) > 0

    def _of(self, robot: int | None, robots: int) -> Queue:
        """Return the queue of *robot*; for None that of all *robots* together, whose addresses come first."""
        more = np.array([[row[at] for at in _PLACES] for row in self._held], dtype=np.int64).reshape(-1, len(_PLACES))
        told = (np.array(self._columns.get(name, ()), dtype=np.int64) for name in COLUMNS)
        rows = np.concatenate((np.stack(list(told), axis=1), more))
        _, accepted, begun, ended = rows[rows[:, 0] < robots if robot is None else rows[:, 0] == robot].T
        on_air = np.flatnonzero(begun != NEVER)
        on_air = on_air[np.argsort(begun[on_air], kind="stable")]
        return Queue(np.sort(accepted), np.sort(ended), begun[on_air], begun[on_air] - accepted[on_air])


NO_QUEUES: Final = Queues({})
"""Those of a run that does not tell of them."""
