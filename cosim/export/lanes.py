"""The timeline's lanes as exports and pictures read them: boxes with words instead of codes."""

from collections.abc import Iterator
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.decoding import packet_name
from cosim.export.recording import Recording
from cosim.timeline import lanes as timeline
from cosim.timeline.assembly import Assembly
from cosim.timeline.codes import CUT, Codes
from cosim.timeline.lanes import Boxes
from cosim.timeline.rows import RADIO, SOURCES, columns_of, names_of
from cosim.timeline.sensing import SENSED, SENSED_FROM, radios_of, sensed
from cosim.trace import TRANSMISSIONS
from cosim.units import Time

STATE: Final = "states"
SENT: Final = "sent"
HEARD: Final = "received"
STATES: Final = (STATE, *SENSED)
"""Lanes of states, which are no frames: as the tables tell, and of 802.11 what follows from the frames."""
ORDER: Final = (*STATES, SENT, HEARD, "broadcasts")
"""What lanes are read; messages, wakes and events are instants, not boxes."""
WHOLE: Final = frozenset({"", "received"})
"""Outcomes of what was not lost."""


Sending = tuple[Time, int, int, str]
"""What a transmission is known by: its time, sender, radio and kind."""


class Lane(NamedTuple):
    """Boxes of one robot's radio, in the order of their beginnings."""

    robot: int
    radio: int
    what: str
    """*states*, *busy*, *NAV*, *sent*, *received* (frames meant for it) or *broadcasts* (its own that nobody was there
    for)"""
    table: str
    rows: Int64s
    """Numbers of the rows in the table; of what is busy or reserved (NAV), those of the frames that it begins with."""
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
    """Return the lanes of *recording* that have boxes, robot by robot; states that overlap stand in one lane.

    An 802.11 radio has lanes of what it senses if the tables of transmissions and of receptions were kept.
    """
    assembly = Assembly()
    for table in SOURCES:
        if recording.count(table):
            lists = {name: recording.column(table, name).tolist() for name in names_of(table, recording.names(table))}
            assembly.add(table, columns_of(table, lists), 0)
    made = [lane for lane in assembly.lanes() if lane.named.what in ORDER and len(lane.boxes.starts)]
    return _ordered(recording, [*made, *_sensed(recording, assembly.codes)], assembly.codes)


def sensed_lanes(recording: Recording) -> list[Lane]:
    """Return those lanes of *recording* that tell when the medium was busy or reserved for its 802.11 radios."""
    codes = Codes()
    return _ordered(recording, _sensed(recording, codes), codes)


def packet_names(recording: Recording, begin: Time, end: Time) -> dict[Sending, str]:
    """Return what routers' packets are called that were on the air from *begin* to *end*: RREQ, HELLO, ...

    Those that carry a host's payload are left out.
    """
    table = TRANSMISSIONS.name
    if not recording.count(table):
        return {}
    starts = recording.column(table, "time_ns")
    there = (starts < end) & (starts + recording.column(table, "duration_ns") > begin)
    rows = np.flatnonzero(there & recording.column(table, "routed").astype(bool))
    names = [packet_name(bytes.fromhex(body)) for body in recording.column(table, "body")[rows]]
    return {key: name for key, name in zip(sendings(recording, table, rows), names, strict=True) if name}


def with_names(recording: Recording, lane: Lane, names: dict[Sending, str]) -> Lane:
    """Return *lane* with the *names* of routers' packets in the place of what the frames are to a radio: DATA."""
    if not names or lane.what in STATES:
        return lane
    keys = sendings(recording, lane.table, lane.rows)
    return lane._replace(kinds=[names.get(key, key[-1]) for key in keys])


def sendings(recording: Recording, table: str, rows: Int64s | slice = slice(None)) -> Iterator[Sending]:
    """Yield what the transmission of each row of *table*, that of frames or of transmissions, is known by."""
    if recording.count(table):
        columns = [recording.column(table, name)[rows].tolist() for name in ("time_ns", "source")]
        radios, kinds = recording.radio(table)[rows].tolist(), recording.column(table, "kind")[rows].tolist()
        yield from zip(*columns, radios, kinds, strict=True)


def _sensed(recording: Recording, codes: Codes) -> list[timeline.Lane]:
    tables = {
        table: {name: recording.column(table, name) for name in (*names, RADIO) if recording.has(table, name)}
        for table, names in SENSED_FROM.items()
        if recording.count(table)
    }
    return sensed(tables, radios_of(recording.metadata), codes, several=False)  # which is in their names only


def _ordered(recording: Recording, made: list[timeline.Lane], codes: Codes) -> list[Lane]:
    found = []
    for (robot, radio, what, table), parts in groupby(made, key=lambda lane: (*lane.named[:3], lane.table)):
        columns = [np.concatenate(column) for column in zip(*(part.boxes for part in parts), strict=True)]
        boxes = Boxes(*columns)
        boxes = boxes.taken(np.lexsort((boxes.rows, boxes.starts)))
        found.append(_worded((robot, radio, what, table), boxes, codes, recording))
    return sorted(found, key=lambda lane: (lane.robot % (1 << 62), lane.radio, ORDER.index(lane.what)))


def _worded(place: tuple[int, int, str, str], boxes: Boxes, codes: Codes, recording: Recording) -> Lane:
    kinds, outcomes = [name for _, name in codes.kinds], [outcome.name for outcome in codes.outcomes]
    starts, ends, rows = (column.astype(np.int64) for column in (boxes.starts, boxes.ends, boxes.rows))
    found = [outcomes[code] for code in boxes.outcomes.tolist()]
    if place[2] == SENT:  # whether anybody has lost it is told where it was to be received
        told = place[3] == TRANSMISSIONS.name
        whole = recording.column(place[3], "whole")[rows].tolist() if told else [True] * len(rows)
        found = ["" if each else CUT for each in whole]
    return Lane(*place, rows, starts, ends, [kinds[code] for code in boxes.kinds.tolist()], found)
