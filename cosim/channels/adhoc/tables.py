"""The rows of an 802.11 channel's tables, by column, from what its stations keep for them (``log``)."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.adhoc.log import BACKING_OFF, OUTCOMES, STATES
from cosim.channels.adhoc.state import Records


class Doings(NamedTuple):
    """What stations were doing."""

    starts: Int64s
    stations: Int64s
    ends: Int64s
    states: list[str]
    details: list[str]


class Receptions(NamedTuple):
    """What became of frames, in the order of the table's columns."""

    times: Int64s
    sources: Int64s
    receivers: Int64s
    powers_dbm: Sequence[float | None]
    ratios_db: Sequence[float | None]
    outcomes: list[str]
    parts: list[str]


def doings(intervals: Records) -> Doings:
    """Return the columns of *intervals*."""
    states = intervals["state"]
    details = [""] * len(intervals)
    counts = np.flatnonzero(states == BACKING_OFF)
    told = (intervals[name][counts].tolist() for name in ("slots", "drawn_slots", "drawn_window"))
    for at, detail in zip(counts.tolist(), map(_backoff, *told), strict=True):
        details[at] = detail
    times = (np.ascontiguousarray(intervals[name]) for name in ("begin", "station", "end"))
    return Doings(*times, [STATES[state] for state in states.tolist()], details)


@lru_cache(maxsize=1 << 16)
def _backoff(left: int, drawn: int, window: int) -> str:
    return f"slots={left} of={drawn} cw={window}"


def receptions(rows: Records) -> Receptions:
    """Return the columns of *rows*."""
    names = (np.ascontiguousarray(rows[name]) for name in ("begin", "source", "receiver"))
    outcomes = [OUTCOMES[outcome] for outcome in rows["outcome"].tolist()]
    return Receptions(*names, _known(rows["power_dbm"]), _known(rows["sinr_db"]), outcomes, [""] * len(rows))


def _known(values: Any) -> list[float | None]:
    """Return *values*, None in the place of NaN."""
    unknown = np.isnan(values)
    if unknown.all():
        return [None] * len(values)
    known: list[float | None] = np.where(unknown, None, values).tolist()
    return known
