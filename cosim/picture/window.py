"""The boxes that are seen between two times, as a list: what a picture draws, and what stands beside it."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from cosim.export.lanes import HEARD, STATE, STATES, Lane, Sending, packet_names
from cosim.export.recording import Recording
from cosim.timeline.sensing import SENSED
from cosim.units import MS, Time


class Box(NamedTuple):
    """A box of a lane."""

    start: Time
    end: Time
    robot: int
    radio: int
    what: str
    kind: str
    channel: int
    """RF channel; -1 where there is none."""
    outcome: str
    peer: int
    """Of what was received, and of what is busy or reserved, the sender; of what was sent, the destination, -1 for
    all; of other states -1."""
    part: str
    """The part of a frame that failed first; empty if none did."""
    detail: str
    """More about a state, or which packet of a router a frame carries: RREQ, HELLO, ..."""

    @property
    def name(self) -> str:
        """What stands in it."""
        return self.detail if self.detail and self.what != STATE else self.kind


COLUMNS: Final = Box._fields
HALF: Final = 10 * MS
"""How far a picture reaches before and after its moment, if that is not said."""


def boxes(recording: Recording, found: Iterable[Lane], begin: Time, end: Time) -> list[Box]:
    """Return the boxes of the lanes *found* that are seen from *begin* to before *end*, by start, robot and lane."""
    seen = [box for lane in found for box in _of_lane(recording, lane, begin, end)]
    names = packet_names(recording, begin, end)
    if names:
        seen = [box if box.what in STATES else box._replace(detail=names.get(_sending(box), "")) for box in seen]
    return sorted(seen, key=lambda box: (box.start, box.robot, box.radio, box.what, box.peer))


def _of_lane(recording: Recording, lane: Lane, begin: Time, end: Time) -> Iterator[Box]:
    def column(name: str, other: int | str) -> Sequence[int | str]:
        if not recording.has(lane.table, name):
            return [other] * len(chosen)
        values: list[int | str] = recording.column(lane.table, name)[lane.rows[chosen]].tolist()
        return values

    chosen = np.flatnonzero((lane.starts < end) & (lane.ends > begin))
    peers = column("source" if lane.what in (HEARD, *SENSED) else "destination", -1)
    more = zip(column("channel", -1), peers, column("part", ""), column("detail", ""), strict=True)
    for at, (channel, peer, part, detail) in zip(chosen.tolist(), more, strict=True):
        words = int(channel), lane.outcomes[at], int(peer), str(part), str(detail)
        span = int(lane.starts[at]), int(lane.ends[at])
        yield Box(span[0], span[1], lane.robot, lane.radio, lane.what, lane.kinds[at], *words)


def _sending(box: Box) -> Sending:
    """Return what the transmission of the frame *box* is known by: time, sender, radio, kind."""
    return box.start, box.peer if box.what == HEARD else box.robot, box.radio, box.kind


def as_csv(seen: Iterable[Box]) -> str:
    """Return the boxes *seen* as CSV, a line each below their names."""
    file = io.StringIO()
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(COLUMNS)
    rows.writerows(seen)
    return file.getvalue()


def first_moment(recording: Recording, found: Iterable[Lane]) -> Time:
    """Return a moment worth a look if none is named: the beginning of the frame nearest to the middle of the run."""
    middle = recording.end // 2
    starts = [lane.starts[np.abs(lane.starts - middle).argmin()] for lane in found if lane.what == HEARD]
    return int(min(starts, key=lambda start: abs(start - middle), default=middle))
