"""The frames that a floor shows at an instant: those in the air, and for a while those that were.

How long a frame is shown after its end follows from the run's clock and its speed alone, so that a pause shows it, and
so does a return to that time. At the speed 1 that is ``GLOW_S``, at a tenth of it a tenth: on the screen it is equal.
"""

from collections import deque
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Int64s
from cosim.trace import StoredTable
from cosim.units import S, Time, to_seconds
from cosim.web.messages import Plain
from cosim.web.rows import Row
from cosim.web.spans import Spans

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

    def count(self, time: Time) -> int:
        """Return the number of frames that have begun up to *time*."""

    def at(self, time: Time, speed: float) -> Plain:
        """Return what a message tells of the frames at *time*, if it passes with *speed*.

        ``frames``: those that are shown, as rows of :class:`Frame`; ``frames_left_out``: how many more there are;
        ``frames_seen`` and ``frames_lost``: how many have begun up to then, and were not received; ``talks``: rows of
        two robots and the start of the last frame that one has received of the other, s.
        """


class StoredAir:
    """The frames of a recorded run."""

    def __init__(self, table: StoredTable | None) -> None:
        """Take the table ``frames``; None, if the run has kept none."""
        self._table = table
        starts = np.empty(0, dtype=np.int64) if table is None else table.column("time_ns")
        lengths = starts if table is None else table.column("duration_ns")
        self._spans = Spans(starts, starts + lengths)
        outcomes = np.empty(0, dtype=object) if table is None else table.column("outcome")
        self._whole = outcomes == _RECEIVED
        self._lost_before = np.concatenate([[0], np.cumsum(~self._whole)])
        ends = [starts if table is None else table.column(name) for name in ("source", "destination")]
        self._pairs = np.stack(ends, axis=1)

    def count(self, time: Time) -> int:
        """Return the number of frames that have begun up to *time*."""
        return self._spans.begun(time)

    def at(self, time: Time, speed: float) -> Plain:
        """Return what a message tells of the frames at *time*, if it passes with *speed*."""
        seen = self.count(time)
        shown = self._spans.at(time, glow(speed))
        flying = self._spans.ends[shown] > time
        over = shown[~flying]
        numbers = np.sort(np.concatenate([shown[flying], over[-MOST_FRAMES:]]))
        return {
            "frames": self._rows(numbers),
            "frames_left_out": max(0, len(over) - MOST_FRAMES),
            "frames_seen": seen,
            "frames_lost": int(self._lost_before[seen]),
            "talks": self._talks(time, speed, seen),
        }

    def _rows(self, numbers: Int64s) -> list[Row]:
        if self._table is None or not len(numbers):
            return []
        return [_frame(row).row for row in self._table.rows_at(numbers)]

    def _talks(self, time: Time, speed: float, seen: int) -> list[Row]:
        first = max(self.count(time - _talk(speed)), seen - _TALK_ROWS)
        told = first + np.flatnonzero(self._whole[first:seen] & (self._pairs[first:seen, 1] >= 0))
        pairs = np.sort(self._pairs[told], axis=1)[::-1]
        found, latest = np.unique(pairs, axis=0, return_index=True)
        at: Int64s = self._spans.starts[told[::-1][latest]]
        return [[*pair, to_seconds(start)] for pair, start in zip(found.tolist(), at.tolist(), strict=True)]


class RecentAir:
    """The latest frames of a run under way, which tells of a frame when it is over; asked for at its present."""

    def __init__(self) -> None:
        self._frames: deque[Frame] = deque(maxlen=_KEPT)
        self._seen = 0
        self._lost = 0
        self._talked: dict[tuple[int, int], Time] = {}

    def append(self, frame: Frame) -> None:
        """Add a frame."""
        whole = frame.outcome == _RECEIVED
        self._frames.append(frame)
        self._seen += 1
        self._lost += not whole
        if whole and frame.destination >= 0:
            pair = min(frame.source, frame.destination), max(frame.source, frame.destination)
            self._talked[pair] = max(frame.start, self._talked.get(pair, 0))

    def count(self, time: Time) -> int:
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
            "frames": [frame.row for frame in reversed(shown[:MOST_FRAMES])],
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
