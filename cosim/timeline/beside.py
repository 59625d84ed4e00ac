"""What a sender has sent to the same receiver just before a transmission, and just after it."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from cosim.timeline.codes import FRAME, Codes
from cosim.timeline.detail import Row, Tables
from cosim.timeline.lanes import Lane
from cosim.trace import TRANSMISSIONS

MOST_BESIDE: Final = 4096
"""Boxes of the sender's lane that are looked at, before and after."""


def beside(
    lanes: Sequence[Lane], codes: Codes, tables: Tables, sent: Row, kinds: Collection[str]
) -> tuple[Iterator[Row], Iterator[Row]]:
    """Return the transmissions of these *kinds* before that of the row *sent*, the last one first, and those after it.

    They are of the same sender and radio, to the same receiver; none if there are no lanes of transmissions.
    """
    place = sent["source"], sent.get("radio", 0), "sent"
    lane = next((each for each in lanes if each.named[:3] == place and each.table == TRANSMISSIONS.name), None)
    if lane is None:
        return iter(()), iter(())
    wanted = {code for code, (group, name) in enumerate(codes.kinds) if group == FRAME and name in kinds}
    first = int(np.searchsorted(lane.boxes.starts, sent["time_ns"], side="left"))
    end = int(np.searchsorted(lane.boxes.starts, sent["time_ns"], side="right"))
    before, after = range(first - 1, -1, -1)[:MOST_BESIDE], range(end, len(lane.boxes.starts))[:MOST_BESIDE]
    about: Any = lane, wanted, tables, sent["destination"]
    return _rows(before, *about), _rows(after, *about)


def _rows(numbers: Iterable[int], lane: Lane, kinds: set[int], tables: Tables, receiver: int) -> Iterator[Row]:
    boxes = lane.boxes
    for at in numbers:
        if int(boxes.kinds[at]) in kinds and boxes.peers[at] == receiver:
            yield tables.row(TRANSMISSIONS.name, int(boxes.rows[at]))
