"""The rows of an 802.11 channel's tables, by column, from what its stations keep for them (``log``)."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.adhoc.log import OUTCOMES, STATES, unpacked_slots
from cosim.channels.adhoc.mac import KINDS
from cosim.channels.adhoc.state import Records

MOST_WORDS: Final = 1 << 16
_STATES: Final = np.array(STATES, np.object_)
_KINDS: Final = np.array(KINDS, np.object_)
_OUTCOMES: Final = np.array(OUTCOMES, np.object_)


class Doings(NamedTuple):
    """What stations were doing."""

    starts: Int64s
    stations: Int64s
    ends: Int64s
    states: list[str]
    details: list[str]


class Transmissions(NamedTuple):
    """What was on the air, in the order of the table's columns."""

    times: Int64s
    sources: Int64s
    kinds: list[str]
    destinations: Int64s
    reserves: Int64s
    numbers: Int64s
    retries: list[bool]
    routed: list[bool]
    whole: list[bool]
    bodies: list[str]
    durations: Int64s
    channels: Int64s
    lt_addrs: Int64s
    lengths: Int64s


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
    starts, stations, ends = (np.ascontiguousarray(intervals[name]) for name in ("begin", "station", "end"))
    return Doings(starts, stations, ends, _STATES[intervals["state"]].tolist(), _SLOTS.of(intervals["slots"]))


class _Slots(dict[int, str]):
    """Words about back-offs that have been needed, by their slots, packed; none about 0, which is no back-off."""

    def of(self, packed: Int64s) -> list[str]:
        """Return the words about each of *packed*."""
        if len(self) > MOST_WORDS:
            self.clear()
        return list(map(self.__getitem__, packed.tolist()))

    def __missing__(self, packed: int) -> str:
        left, drawn, window = unpacked_slots(packed)
        words = self[packed] = f"slots={left} of={drawn} cw={window}" if packed else ""
        return words


_SLOTS: Final = _Slots()


def transmissions(rows: Records, carried: Sequence[bytes], routed: bool) -> Transmissions:
    """Return the columns of *rows*, which have *carried* that: payloads, or packets that a router has *routed*."""
    count = len(rows)
    times, sources, destinations, reserves, numbers, durations = (
        np.ascontiguousarray(rows[name])
        for name in ("begin", "source", "destination", "reserves", "number", "duration")
    )
    kinds, retries, whole = _KINDS[rows["kind"]].tolist(), rows["again"].tolist(), rows["whole"].tolist()
    bodies, lengths = list(map(_hexadecimal, carried)), np.array(list(map(len, carried)), np.int64)
    named = times, sources, kinds, destinations, reserves, numbers, retries, [routed] * count, whole, bodies
    return Transmissions(*named, durations, np.full(count, -1), np.zeros(count, np.int64), lengths)


@lru_cache(maxsize=256)
def _hexadecimal(body: bytes) -> str:
    """Return the digits of *body*; the same string for all frames that carry it."""
    return body.hex()


def receptions(rows: Records) -> Receptions:
    """Return the columns of *rows*."""
    begins, sources, receivers = (np.ascontiguousarray(rows[name]) for name in ("begin", "source", "receiver"))
    outcomes = _OUTCOMES[rows["outcome"]].tolist()
    powers_dbm, ratios_db = _known(rows["power_dbm"]), _known(rows["sinr_db"])
    return Receptions(begins, sources, receivers, powers_dbm, ratios_db, outcomes, [""] * len(rows))


def _known(values: Any) -> list[float | None]:
    """Return *values*, None in the place of NaN."""
    unknown = np.flatnonzero(np.isnan(values))
    if len(unknown) == len(values):
        return [None] * len(values)
    known: list[float | None] = values.tolist()
    for at in unknown.tolist():
        known[at] = None
    return known
