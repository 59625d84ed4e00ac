"""The timeline's lanes as exports and pictures read them: boxes with words instead of codes."""

from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.export.recording import Recording
from cosim.timeline.assembly import Assembly
from cosim.timeline.codes import CUT, Codes
from cosim.timeline.lanes import Boxes
from cosim.timeline.rows import SOURCES, columns_of, names_of
from cosim.trace import TRANSMISSIONS

STATE: Final = "states"
SENT: Final = "sent"
HEARD: Final = "received"
ORDER: Final = (STATE, SENT, HEARD, "broadcasts")
"""What lanes are read; messages and events are instants, not boxes."""
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
    """Return the lanes of *recording* that have boxes, robot by robot; states that overlap stand in one lane."""
    assembly = Assembly()
    for table in SOURCES:
        if recording.count(table):
            lists = {name: recording.column(table, name).tolist() for name in names_of(table, recording.names(table))}
            assembly.add(table, columns_of(table, lists), 0)
    made = [lane for lane in assembly.lanes() if lane.named.what in ORDER and len(lane.boxes.starts)]
    found = []
    for (robot, radio, what, table), parts in groupby(made, key=lambda lane: (*lane.named[:3], lane.table)):
        columns = [np.concatenate(column) for column in zip(*(part.boxes for part in parts), strict=True)]
        boxes = Boxes(*columns)
        boxes = boxes.taken(np.lexsort((boxes.rows, boxes.starts)))
        found.append(_worded((robot, radio, what, table), boxes, assembly.codes, recording))
    return sorted(found, key=lambda lane: (lane.robot % (1 << 62), lane.radio, ORDER.index(lane.what)))


def _worded(place: tuple[int, int, str, str], boxes: Boxes, codes: Codes, recording: Recording) -> Lane:
    kinds, outcomes = [name for _, name in codes.kinds], [name for name, _ in codes.outcomes]
    starts, ends, rows = (column.astype(np.int64) for column in (boxes.starts, boxes.ends, boxes.rows))
    found = [outcomes[code] for code in boxes.outcomes.tolist()]
    if place[2] == SENT:  # whether anybody has lost it is told where it was to be received
        told = place[3] == TRANSMISSIONS.name
        whole = recording.column(place[3], "whole")[rows].tolist() if told else [True] * len(rows)
        found = ["" if each else CUT for each in whole]
    return Lane(*place, rows, starts, ends, [kinds[code] for code in boxes.kinds.tolist()], found)
