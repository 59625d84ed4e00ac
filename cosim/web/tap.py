"""The trace of a run that is looked at while it is under way: what a page shows is passed on, little is kept."""

from collections import deque
from collections.abc import Iterable
from typing import Any, Final

from cosim.trace import FRAMES, POSES, Table, Trace
from cosim.units import to_seconds
from cosim.web.history import DOWN, MOST_FRAMES, UP, places
from cosim.web.rows import Row

WATCHED: Final = (POSES, FRAMES)
"""The tables that a page shows besides the events."""


class Tap(Trace):
    """A trace that keeps the events, which decide the run's digest, and of all else only what is not fetched yet."""

    def __init__(self, wanted: Iterable[Table] = ()) -> None:
        super().__init__(wanted)
        self.down: set[int] = set()
        """The robots that do nothing any more."""
        self._ticks: list[tuple[int, list[float]]] = []
        self._frames: deque[Row] = deque(maxlen=MOST_FRAMES)
        self._events: list[Row] = []
        self._number = 0
        self._fields = tuple(field.name for field in self.tables["events"].fields[3:])

    def row(self, table: Table, *values: Any) -> None:
        """Take a row; *values* in the order of the table's fields."""
        if table.name == "events":
            super().row(table, *values)
            self._events.append(self._event(values))
        elif table.name == "frames":
            time, source, destination, _, kind, _, _, length, outcome, *_ = values
            self._frames.append([to_seconds(time), source, destination, kind, outcome, length])
        elif table.name == "poses":
            time, _, *pose = values
            if not self._ticks or self._ticks[-1][0] != time:
                self._ticks.append((time, []))
            self._ticks[-1][1].extend(pose)
        else:
            super().row(table, *values)

    def fetched(self) -> tuple[list[Row], list[Row], list[Row]]:
        """Drain the rows since the last call: of the ticks, of frames (the latest), of events."""
        ticks = [pose for _, pose in self._ticks]
        frames, events = list(self._frames), self._events
        self._ticks, self._events = [], []
        self._frames.clear()
        return ticks, frames, events

    def _event(self, values: tuple[Any, ...]) -> Row:
        time, source, name, *rest = values
        if name in DOWN:
            self.down.add(source)
        elif name in UP:
            self.down.discard(source)
        fields = {name: value for name, value in zip(self._fields, rest, strict=True) if value is not None}
        self._number += 1
        return [self._number - 1, to_seconds(time), source, name, fields]


def is_mark(row: Row) -> bool:
    """Return whether the event *row* tells of a place on the floor."""
    return bool(places(row[4]))
