"""All lanes of a run, from all its tables at once."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Any, Final

import numpy as np

from cosim.timeline.codes import BUSY, CHANNEL, NAV, PICONET, Codes
from cosim.timeline.lanes import Array, Boxes, Lane
from cosim.timeline.levels import levels_of
from cosim.timeline.rows import SOURCES, Maker, all_of, by_time, distinct, in_order, lane_name
from cosim.trace import FRAMES, Trace
from cosim.units import Time

TABLE_OF: Final = {
    "states": "intervals",
    BUSY: "transmissions",
    NAV: "transmissions",
    "sent": "transmissions",
    "received": "frames",
    "broadcasts": "frames",
    "messages": "messages",
    "wakes": "wakes",
    "events": "events",
    PICONET: "intervals",
    CHANNEL: "transmissions",
}
"""The table that the rows of a lane's boxes belong to."""


OF_SENDERS: Final = ("sent", CHANNEL)
"""Lanes of transmissions, or of frames where there are no rows of these."""


class Assembly:
    """Takes the tables of a run, a group of rows at a time, and makes lanes of them."""

    def __init__(self, low_energy: Collection[int] = ()) -> None:
        """*low_energy*: the numbers of the radios of Low Energy."""
        self.codes = Codes()
        self.several = False
        """Whether robots have several radios."""
        self._maker = Maker(self.codes, low_energy=low_energy)
        self._parts: defaultdict[tuple[str, tuple[int, int, int]], list[Boxes]] = defaultdict(list)

    def add(self, table: str, columns: dict[str, Any], first: int) -> None:
        """Take the rows of *table* from number *first* on; tables in the order of ``SOURCES``."""
        self.several |= "radio" in columns and table != "intervals"
        for made in self._maker.made(table, columns, first):
            for key, boxes in made.by_lane():
                self._parts[made.what, key].append(boxes)

    def lanes(self) -> list[Lane]:
        """Return the lanes from top to bottom, without levels; what was taken is forgotten."""
        found, lost = [], all_of(self._maker.losses)
        for what, key in list(self._parts):
            parts = self._parts.pop((what, key))
            boxes = in_order(Boxes(*(np.concatenate(columns) for columns in zip(*parts, strict=True))))
            table = TABLE_OF[what]
            if what in OF_SENDERS:
                if key[1] in self._maker.sending:
                    lost.taken(lost.shown(what, key)).mark(boxes, what)
                else:
                    table, boxes = FRAMES.name, distinct(boxes, what)
            found.append(lane_of(Lane(lane_name(what, key, self.several), table, boxes)))
        return sorted(found, key=lambda lane: lane.named.place)


def lane_of(lane: Lane) -> Lane:
    """Return *lane* with what follows from its boxes."""
    starts, ends = lane.boxes.starts, lane.boxes.ends
    lane.longest = int((ends - starts).max()) if len(starts) else 0
    lane.disjoint = bool((starts[1:] >= ends[:-1]).all())
    return lane


def lost_codes(codes: Codes) -> Array:
    """Return whether boxes are lost, by their codes of outcomes; all that fit a byte, whatever a damaged index has."""
    lost = np.zeros(1 << 8, dtype=bool)
    lost[: len(codes.lost)] = codes.lost
    return lost


def lanes_of(trace: Trace) -> tuple[list[Lane], Codes]:
    """Return the lanes of a run whose *trace* is in memory, and the codes of their boxes.

    Rows are numbered as in the files that the trace writes.
    """
    assembly = Assembly()
    for table in SOURCES:
        if table in trace.tables:
            assembly.add(table, by_time(trace, table), 0)
    lanes = assembly.lanes()
    for lane in lanes:
        lane.levels = levels_of(lane.boxes, lost_codes(assembly.codes))
    return lanes, assembly.codes


def span_of(lanes: Sequence[Lane]) -> tuple[Time, Time]:
    """Return when the first box of *lanes* begins and the last ends."""
    firsts = [int(lane.boxes.starts[0]) for lane in lanes if len(lane.boxes.starts)]
    return min(firsts, default=0), max(
        (int(lane.boxes.ends.max()) for lane in lanes if len(lane.boxes.ends)), default=0
    )
