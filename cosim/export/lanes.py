"""Lanes of boxes, one box a row of a table: what a radio sends, what it hears, and what it and its robot are doing."""

from typing import Any, Final, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.export.recording import Recording

SENT: Final = "sent"
HEARD: Final = "received"
UNHEARD: Final = "broadcasts"
STATE: Final = "states"
ORDER: Final = (STATE, SENT, HEARD, UNHEARD)
WHOLE: Final = frozenset({"", "received"})
"""Outcomes of what was not lost."""


class Lane(NamedTuple):
    """Boxes of one robot's radio, in the order of their beginnings."""

    robot: int
    radio: int
    what: str
    """*states*, *sent*, *received* (frames meant for it) or *broadcasts* (its own that nobody was there for)."""
    table: str
    rows: Int64s
    """Numbers of the rows in the table."""
    starts: Int64s
    ends: Int64s
    kinds: list[str]
    """Packet types, or states."""
    outcomes: list[str]
    """What became of a frame; empty for states, and for what is sent, but *cut* if its sender fell silent."""

    @property
    def name(self) -> str:
        """What stands beside it."""
        return self.what if self.radio <= 0 else f"{self.what}, radio {self.radio}"


def lanes(recording: Recording) -> list[Lane]:
    """Return the lanes of *recording* that have boxes, robot by robot.

    Where a channel has written no transmissions, what was sent follows from the frames: their first row each.
    """
    found = [*_states(recording), *_sent(recording), *_heard(recording)]
    return sorted(found, key=lambda lane: (lane.robot % (1 << 62), lane.radio, ORDER.index(lane.what)))


def _states(recording: Recording) -> list[Lane]:
    table = "intervals"
    if not recording.count(table):
        return []
    starts, ends = recording.column(table, "start_ns"), recording.column(table, "end_ns")
    words = recording.column(table, "state"), np.full(len(starts), "", dtype=object)
    return _split(STATE, table, recording.column(table, "robot"), recording.radio(table), (starts, ends), words)


def _sent(recording: Recording) -> list[Lane]:
    table = "transmissions"
    found: list[Lane] = []
    told: set[int] = set()
    if recording.count(table):
        starts, radios = recording.column(table, "time_ns"), recording.radio(table)
        told = set(radios.tolist())
        outcomes = np.where(recording.column(table, "whole").astype(bool), "", "cut").astype(object)
        spans = starts, starts + recording.column(table, "duration_ns")
        words = recording.column(table, "kind"), outcomes
        found = _split(SENT, table, recording.column(table, "source"), radios, spans, words)
    return found + _sent_by_frames(recording, told)


def _sent_by_frames(recording: Recording, told: set[int]) -> list[Lane]:
    """Return what was sent by radios that are not among those *told* of."""
    table = "frames"
    if not recording.count(table):
        return []
    starts, robots, radios = (
        recording.column(table, "time_ns"),
        recording.column(table, "source"),
        recording.radio(table),
    )
    kinds = recording.column(table, "kind")
    keys = zip(starts.tolist(), robots.tolist(), radios.tolist(), kinds, strict=True)
    first: dict[tuple[int, int, int, str], int] = {}
    for row, key in enumerate(keys):
        if key[2] not in told:
            first.setdefault(key, row)
    if not first:
        return []
    rows = np.fromiter(first.values(), dtype=np.int64)
    ends = starts + recording.column(table, "duration_ns")
    words = kinds[rows], np.full(len(rows), "", dtype=object)
    return _split(SENT, table, robots[rows], radios[rows], (starts[rows], ends[rows]), words, rows)


def _heard(recording: Recording) -> list[Lane]:
    table = "frames"
    if not recording.count(table):
        return []
    starts, receivers = recording.column(table, "time_ns"), recording.column(table, "destination")
    sources, radios = recording.column(table, "source"), recording.radio(table)
    spans = starts, starts + recording.column(table, "duration_ns")
    kinds, outcomes = recording.column(table, "kind"), recording.column(table, "outcome")
    found = []
    for what, robots, rows in (
        (HEARD, receivers, np.flatnonzero(receivers >= 0)),
        (UNHEARD, sources, np.flatnonzero(receivers < 0)),
    ):
        words = kinds[rows], outcomes[rows]
        found += _split(what, table, robots[rows], radios[rows], (spans[0][rows], spans[1][rows]), words, rows)
    return found


def _split(
    what: str,
    table: str,
    robots: Int64s,
    radios: Int64s,
    spans: tuple[Int64s, Int64s],
    words: tuple[Any, Any],
    rows: Int64s | None = None,
) -> list[Lane]:
    """Return a lane for each robot and radio that has boxes."""
    rows = np.arange(len(robots), dtype=np.int64) if rows is None else rows
    found = []
    for robot, radio in sorted(set(zip(robots.tolist(), radios.tolist(), strict=True))):
        mine = np.flatnonzero((robots == robot) & (radios == radio))
        mine = mine[np.argsort(spans[0][mine], kind="stable")]
        kinds, outcomes = (list(each[mine]) for each in words)
        found.append(Lane(robot, radio, what, table, rows[mine], spans[0][mine], spans[1][mine], kinds, outcomes))
    return found
