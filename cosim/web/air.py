"""The frames that a floor shows at an instant: those in the air, and for a while those that were.

How long a frame is shown after its end follows from the run's clock and its speed alone, so that a pause shows it, and
so does a return to that time. At the speed 1 that is ``GLOW_S``, at a tenth of it a tenth: on the screen it is equal.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Bools, Int64s
from cosim.channels.base import Flying
from cosim.trace import TableFile
from cosim.units import S, Time, to_seconds
from cosim.web.messages import Plain
from cosim.web.rows import Row
from cosim.web.spans import FiledSpans, Spans

GLOW_S: Final = 0.45
"""Time for which a frame is shown after its end at the speed 1, s."""
TALK_S: Final = 2.5
"""Time for which two robots are shown to talk after a frame from one to the other at the speed 1, s."""
MOST_FRAMES: Final = 300
"""Maximum number of frames that are shown after their end: the latest ones."""
_RECEIVED: Final = "received"
"""Outcome of a frame that was received."""
_KEPT: Final = 20_000
"""Number of frames of a run under way that are shown at most."""
_LATE: Final[Time] = S
"""No frame of a run under way is told later than this after another one that ended later, ns."""
_GROUPS: Final = 8
"""Number of groups of rows of a recorded run that are kept in memory."""
_TALK_ROWS: Final = 100_000
"""Number of frames that are searched for who talks."""


class Frame(NamedTuple):
    """A frame, for one receiver."""

    start: Time
    end: Time
    source: int
    destination: int
    kind: str
    outcome: str
    length: int
    channel: int
    lt_addr: int
    part: str
    radio: int

    @property
    def row(self) -> Row:
        """It as a page gets it: start and end in s, all else as it is."""
        return [to_seconds(self.start), to_seconds(self.end), *self[2:]]


class Air(Protocol):
    """The frames of a run."""

    def until(self, time: Time) -> int:
        """Return the number of frames that have begun up to *time*."""

    def at(self, time: Time, speed: float) -> Plain:
        """Return what a message tells of the frames at *time*, if it passes with *speed*.

        ``frames``: those that are shown, as rows of :class:`Frame`; ``frames_left_out``: how many more there are;
        ``frames_seen`` and ``frames_lost``: how many have begun up to then, and were not received; ``talks``: rows of
        two robots and the start of the last frame that one has received of the other, s.
        """


class _Group(NamedTuple):
    """A group of rows of the table ``frames``, as arrays."""

    spans: Spans
    whole: Bools
    """Which were received."""
    lost_before: Int64s
    """(n + 1,): how many of those before were not."""
    pairs: Int64s
    """(n, 2): sources and destinations."""


class StoredAir:
    """The frames of a recorded run."""

    def __init__(self, table: TableFile | None) -> None:
        """Take the table ``frames``; None, if the run has kept none."""
        self._table = table
        groups = () if table is None else table.ends
        self._first = [0, *groups]
        self._group = lru_cache(_GROUPS)(self._read)
        self._lost = [0]
        self._spans = FiledSpans(groups, self._spans_of)

    def until(self, time: Time) -> int:
        """Return the number of frames that have begun up to *time*."""
        return self._spans.begun(time)

    def time(self, number: int) -> Time:
        """Return when the frame of that *number* has begun."""
        at = bisect_right(self._first, number) - 1
        return int(self._group(at).spans.starts[number - self._first[at]])

    def at(self, time: Time, speed: float) -> Plain:
        """Return what a message tells of the frames at *time*, if it passes with *speed*."""
        seen = self.until(time)
        shown = self._spans.at(time, glow(speed))
        flying = np.isin(shown, self._spans.at(time))
        over = shown[~flying]
        numbers = np.sort(np.concatenate([shown[flying], over[-MOST_FRAMES:]]))
        return {
            "frames": self._rows(numbers.tolist()),
            "frames_left_out": max(0, len(over) - MOST_FRAMES),
            "frames_seen": seen,
            "frames_lost": self._lost_until(time, seen),
            "talks": self._talks(time, speed, seen),
        }

    def _spans_of(self, at: int) -> Spans:
        group = self._group(at)
        if at + 1 == len(self._lost):  # it is read for the first time
            self._lost.append(self._lost[at] + int(group.lost_before[-1]))
        return group.spans

    def _read(self, at: int) -> _Group:
        assert self._table is not None
        columns = self._table.group(at, ("time_ns", "duration_ns", "source", "destination", "outcome"))
        starts, (codes, words) = columns["time_ns"], columns["outcome"]
        whole = codes == words.index(_RECEIVED) if _RECEIVED in words else np.zeros(len(starts), dtype=np.bool_)
        pairs = np.stack([columns["source"], columns["destination"]], axis=1)
        spans = Spans(starts, starts + columns["duration_ns"])
        return _Group(spans, whole, np.concatenate([[0], np.cumsum(~whole)]), pairs)

    def _lost_until(self, time: Time, seen: int) -> int:
        at = self._spans.group(time)
        return 0 if at < 0 else self._lost[at] + int(self._group(at).lost_before[seen - self._first[at]])

    def _rows(self, numbers: list[int]) -> list[Row]:
        if self._table is None or not numbers:
            return []
        first, end = numbers[0], numbers[-1] + 1
        if end - first > 2 * len(numbers) + MOST_FRAMES:  # one of them is long, and many others were in between
            return [_frame(self._table.row(number)).row for number in numbers]
        rows = self._table.rows(first, end)
        return [_frame(rows[number - first]).row for number in numbers]

    def _talks(self, time: Time, speed: float, seen: int) -> list[Row]:
        first = max(self.until(time - _talk(speed)), seen - _TALK_ROWS)
        latest: dict[tuple[int, int], Time] = {}
        for at in range(bisect_right(self._first, first) - 1, self._spans.group(time) + 1):
            group, begin = self._group(at), self._first[at]
            since, end = max(0, first - begin), min(len(group.whole), seen - begin)
            told = since + np.flatnonzero(group.whole[since:end] & (group.pairs[since:end, 1] >= 0))
            pairs, last = np.unique(np.sort(group.pairs[told], axis=1)[::-1], axis=0, return_index=True)
            starts = group.spans.starts[told[::-1][last]]
            latest |= {(one, two): start for (one, two), start in zip(pairs.tolist(), starts.tolist(), strict=True)}
        return [[*pair, to_seconds(start)] for pair, start in sorted(latest.items())]


class RecentAir:
    """The latest frames of a run under way, which tells of a frame when it is over, and those on the air at present."""

    def __init__(self) -> None:
        self._frames: deque[Frame] = deque(maxlen=_KEPT)
        self._seen = 0
        self._lost = 0
        self._talked: dict[tuple[int, int], Time] = {}
        self._flying: list[Frame] = []

    def put(self, flying: Iterable[Flying]) -> None:
        """Say which frames are on the air; their outcome is not known."""
        self._flying = [
            Frame(start, end, source, destination, kind, "", length, channel, lt_addr, "", radio)
            for start, source, end, kind, destination, length, channel, lt_addr, radio, _ in flying
        ]

    def append(self, frame: Frame) -> None:
        """Add a frame."""
        whole = frame.outcome == _RECEIVED
        self._frames.append(frame)
        self._seen += 1
        self._lost += not whole
        if whole and frame.destination >= 0:
            pair = min(frame.source, frame.destination), max(frame.source, frame.destination)
            self._talked[pair] = max(frame.start, self._talked.get(pair, 0))

    def until(self, time: Time) -> int:
        """Return the number of frames so far."""
        return self._seen

    def at(self, time: Time, speed: float) -> Plain:
        """Return what a message tells of the frames now, at *time*, if it passes with *speed*."""
        since = time - glow(speed)
        shown: list[Frame] = []
        for frame in reversed(self._frames):
            if frame.end > since:
                shown.append(frame)
            elif frame.end < since - _LATE:
                break
        talks = [(*pair, to_seconds(at)) for pair, at in self._talked.items() if at > time - _talk(speed)]
        return {
            "frames": [frame.row for frame in (*reversed(shown[:MOST_FRAMES]), *self._flying)],
            "frames_left_out": max(0, len(shown) - MOST_FRAMES),
            "frames_seen": self._seen,
            "frames_lost": self._lost,
            "talks": [list(talk) for talk in sorted(talks)],
        }


def _frame(row: dict[str, Any]) -> Frame:
    """Return a row of the table ``frames``."""
    start = row["time_ns"]
    named = {name: row[name] for name in Frame._fields[2:-1]}
    return Frame(start, start + row["duration_ns"], **named, radio=row.get("radio", 0))


def glow(speed: float) -> Time:
    """Return for how long a frame is shown after its end if time passes with *speed*, ns."""
    return round(GLOW_S * speed * S)


def _talk(speed: float) -> Time:
    return round(TALK_S * speed * S)
