"""The boxes that rows of tables make, and the lanes that they belong to."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.intervals import HOST, INTERVALS
from cosim.timeline.codes import CUT, EVENT, FRAME, MESSAGE, STATE, Codes, Named
from cosim.timeline.lanes import Array, Boxes
from cosim.trace import FRAMES, MESSAGES, TRANSMISSIONS, Trace
from cosim.units import Time

EVENTS: Final = "events"
SOURCES: Final[dict[str, tuple[str, ...]]] = {
    TRANSMISSIONS.name: ("time_ns", "source", "duration_ns", "kind", "whole"),
    FRAMES.name: ("time_ns", "source", "destination", "duration_ns", "kind", "outcome"),
    INTERVALS.name: ("start_ns", "robot", "end_ns", "radio", "state"),
    MESSAGES.name: ("time_ns", "source"),
    EVENTS: ("time_ns", "source", "event"),
}
"""Tables whose rows are boxes, in the order in which they are to be read, with the columns that tell which."""
RADIO: Final = "radio"
MOST_STACKED: Final = 16
"""Lanes of overlapping boxes of one kind; the last one takes all that have no place in the others."""


class Made(NamedTuple):
    """Boxes of one kind of lanes, of several robots."""

    what: str
    robots: Array
    radios: Array
    stacked: Array
    """Which of the lanes of that kind."""
    boxes: Boxes

    def by_lane(self) -> Iterator[tuple[tuple[int, int, int], Boxes]]:
        """Yield (robot, radio, which) and the boxes of each lane, in their order."""
        if not len(self.robots):
            return
        keys = ((self.robots + 1) << 16) | ((self.radios + 1) << 8) | self.stacked
        lanes, numbers = np.unique(keys, return_inverse=True)
        if len(lanes) < 1 << 16:
            numbers = numbers.astype(np.uint16)  # which NumPy sorts by its bytes
        order = np.argsort(numbers, kind="stable")
        edges = np.concatenate(([0], np.cumsum(np.bincount(numbers, minlength=len(lanes)))))
        for at, lane in enumerate(lanes.tolist()):
            key = (lane >> 16) - 1, (lane >> 8 & 0xFF) - 1, lane & 0xFF
            yield key, self.boxes.taken(order[edges[at] : edges[at + 1]])


class Stacks:
    """Where intervals of one robot and radio that overlap are put: each into the first lane that is free."""

    def __init__(self) -> None:
        self._ends: defaultdict[tuple[int, int], list[Time]] = defaultdict(list)
        self._held: dict[tuple[Any, ...], int] = {}

    def place(self, key: tuple[int, int], start: Time, end: Time) -> int:
        """Return the number of the lane of the interval from *start* to *end*."""
        ends = self._ends[key]
        for at, before in enumerate(ends):
            if before <= start:
                ends[at] = end
                return at
        if len(ends) < MOST_STACKED:
            ends.append(end)
            return len(ends) - 1
        ends[-1] = max(ends[-1], end)
        return MOST_STACKED - 1

    def hold(self, interval: tuple[Any, ...], key: tuple[int, int], start: Time) -> int:
        """Return the number of the lane of an *interval* that has not ended: nothing else is put there until then."""
        if interval not in self._held:
            self._held[interval] = self.place(key, start, 1 << 62)
        return self._held[interval]

    def release(self, interval: tuple[Any, ...], key: tuple[int, int], end: Time) -> int | None:
        """Return the number of the lane where an *interval* was held that has ended now; None if it was not."""
        at = self._held.pop(interval, None)
        if at is not None:
            self._ends[key][at] = end
        return at


class Maker:
    """Makes boxes of rows: a table's columns are arrays of numbers, and (codes, words by code) for text."""

    def __init__(self, codes: Codes, stacks: Stacks | None = None) -> None:
        self.codes = codes
        self.stacks = stacks or Stacks()
        self.sending: set[int] = set()
        """Radios of whose transmissions there are rows."""

    def made(self, table: str, columns: Mapping[str, Any], first: int, details: Any = None) -> list[Made]:
        """Return the boxes of the rows of *table* from number *first* on."""
        make = getattr(self, f"_{table}")
        made: list[Made] = make(columns, first, details) if table == INTERVALS.name else make(columns, first)
        return made

    def _transmissions(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        outcomes = np.where(columns["whole"], 0, self.codes.outcome(CUT)).astype(np.uint8)
        radios = _radios(columns)
        self.sending.update(np.unique(radios).tolist())
        boxes = self._frame_boxes(columns, outcomes, first)
        return [_made("sent", columns["source"], radios, boxes)]

    def _frames(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        codes, words = columns["outcome"]
        outcomes = _lut([self.codes.outcome(word) for word in words], np.uint8)[codes]
        radios, robots = _radios(columns), columns["destination"]
        boxes = self._frame_boxes(columns, outcomes, first)
        to_one = robots >= 0
        made = [_made("received", robots, radios, boxes, to_one)]
        told = np.isin(radios, sorted(self.sending))
        made.append(_made("broadcasts", columns["source"], radios, boxes, told & ~to_one))
        sent = boxes._replace(outcomes=np.where(to_one, 0, outcomes).astype(np.uint8))
        made.append(_made("sent", columns["source"], radios, sent, ~told))
        return made

    def _frame_boxes(self, columns: Mapping[str, Any], outcomes: Array, first: int) -> Boxes:
        starts = columns["time_ns"]
        kinds = self._kinds(FRAME, columns["kind"])
        return Boxes(starts, starts + columns["duration_ns"], kinds, outcomes, _numbers(first, starts))

    def _intervals(self, columns: Mapping[str, Any], first: int, details: Any) -> list[Made]:
        starts, ends = columns["start_ns"], columns["end_ns"]
        robots, radios = columns["robot"], columns["radio"]
        rows = zip(starts.tolist(), ends.tolist(), robots.tolist(), radios.tolist(), strict=True)
        if details is None:
            stacked = [self.stacks.place((robot, radio), start, end) for start, end, robot, radio in rows]
        else:
            stacked = [
                at if (at := self.stacks.release(detail, detail[:2], row[1])) is not None
                else self.stacks.place(detail[:2], row[0], row[1])
                for row, detail in zip(rows, details, strict=True)
            ]  # fmt: skip
        boxes = Boxes(starts, ends, self._kinds(STATE, columns["state"]), _zeros(starts), _numbers(first, starts))
        return [Made("states", robots, radios, np.array(stacked, dtype=np.int64), boxes)]

    def _messages(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        times = columns["time_ns"]
        kinds = np.full(len(times), self.codes.kind(MESSAGE, MESSAGE), dtype=np.uint16)
        return [self._instants("messages", columns, kinds, first)]

    def _events(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        return [self._instants("events", columns, self._kinds(EVENT, columns["event"]), first)]

    def _instants(self, what: str, columns: Mapping[str, Any], kinds: Array, first: int) -> Made:
        times = columns["time_ns"]
        boxes = Boxes(times, times, kinds, _zeros(times), _numbers(first, times))
        return _made(what, columns["source"], np.full(len(times), HOST, dtype=np.int64), boxes)

    def _kinds(self, group: str, column: tuple[Array, Sequence[str]]) -> Array:
        codes, words = column
        return _lut([self.codes.kind(group, word) for word in words], np.uint16)[codes]


def _lut(codes: list[int], dtype: Any) -> Array:
    return np.array(codes or [0], dtype=dtype)


def _zeros(column: Array) -> Array:
    return np.zeros(len(column), dtype=np.uint8)


def _numbers(first: int, column: Array) -> Array:
    return np.arange(first, first + len(column), dtype=np.uint32)


def _radios(columns: Mapping[str, Any]) -> Array:
    radios: Array = columns[RADIO] if RADIO in columns else np.zeros(len(columns["time_ns"]), dtype=np.int64)
    return radios


def _made(what: str, robots: Array, radios: Array, boxes: Boxes, mask: Array | None = None) -> Made:
    if mask is not None:
        robots, radios, boxes = robots[mask], radios[mask], boxes.taken(mask)
    return Made(what, robots, radios, np.zeros(len(robots), dtype=np.int64), boxes)


def distinct(boxes: Boxes) -> Boxes:
    """Return *boxes* with one of those of equal start and kind: rows of the receivers of one frame."""
    same = np.zeros(len(boxes.starts), dtype=bool)
    same[1:] = (boxes.starts[1:] == boxes.starts[:-1]) & (boxes.kinds[1:] == boxes.kinds[:-1])
    return boxes.taken(~same) if same.any() else boxes


def in_order(boxes: Boxes) -> Boxes:
    """Return *boxes* by (start, row), given by row."""
    starts = boxes.starts
    return boxes if (starts[1:] >= starts[:-1]).all() else boxes.taken(np.argsort(starts, kind="stable"))


def names_of(table: str, there: Sequence[str]) -> list[str]:
    """Return the names of the columns of *table* that are needed, of those that are *there*."""
    return [*SOURCES[table], *((RADIO,) if RADIO in there and RADIO not in SOURCES[table] else ())]


def columns_of(table: str, columns: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """Return what a :class:`Maker` takes of *columns* that are lists."""
    found: dict[str, Any] = {}
    for name in names_of(table, list(columns)):
        column = columns[name]
        if name in ("kind", "outcome", "state", "event"):
            words = list(dict.fromkeys(column))
            codes = {word: code for code, word in enumerate(words)}
            found[name] = np.array([codes[word] for word in column], dtype=np.int64), words
        else:
            found[name] = np.array(column, dtype=bool if name == "whole" else np.int64)
    return found


def by_time(trace: Trace, table: str) -> dict[str, Any]:
    """Return what a :class:`Maker` takes of *table* of *trace*, its rows in the order in which they are stored."""
    columns = columns_of(table, trace.columns(table))
    order = np.argsort(columns[SOURCES[table][0]], kind="stable")
    return {
        name: (column[0][order], column[1]) if isinstance(column, tuple) else column[order]
        for name, column in columns.items()
    }


def lane_name(what: str, key: tuple[int, int, int], several: bool) -> Named:
    """Return what the lane *key*, (robot, radio, which), of the kind *what* is called."""
    return Named(key[0], key[1], what, key[2], several)
