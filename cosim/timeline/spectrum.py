"""What RF channels are left out or jammed, from when to when, and how many frames on each are lost."""

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cosim.ranges import pairs_of
from cosim.timeline.codes import CHANNEL, STATE, Codes
from cosim.timeline.detail import Tables
from cosim.timeline.lanes import Array, Lane
from cosim.units import Time

MOST_AREAS: Final = 500
"""Maximum number of areas that are told of: the first ones."""
_JAMMED: Final = "jammer"
_AREAS: Final = ("afh", _JAMMED)
_CHANNELS: Final = re.compile(r"\bchannels=([0-9,-]+)")


class Area(NamedTuple):
    """Channels that something is about for some time."""

    what: str
    """afh: the hop set leaves them out; jammer"""
    robot: int
    """The master whose hop set it is; -1 for a jammer."""
    start: Time
    end: Time
    channels: list[list[int]]
    """First and last of each range."""


class Tally(NamedTuple):
    """The frames on one channel."""

    channel: int
    frames: int
    lost: int


def areas(
    lanes: Sequence[Lane], codes: Codes, tables: Tables, window: tuple[Time, Time], robot: int | None = None
) -> tuple[list[Area], int]:
    """Return what there is in the *window*, oldest first, and how many are not told of.

    Of hop sets those of the piconets to which the *robot* belongs then, if there is one.
    """
    wanted = {code: name for code, (group, name) in enumerate(codes.kinds) if group == STATE and name in _AREAS}
    masters = None if robot is None else _masters(lanes, codes, window, robot)
    places = []
    for lane in lanes:
        if lane.named.what != "states" or not wanted:
            continue
        found = lane.within(*window)
        found = found.taken(np.isin(found.kinds, list(wanted)))
        for start, end, kind, row in zip(*(column.tolist() for column in found[:3]), found.rows.tolist(), strict=True):
            if wanted[kind] == _JAMMED or masters is None or lane.named.robot in masters:
                places.append((start, end, wanted[kind], lane, row))
    places.sort(key=lambda place: place[:2])
    told = [
        Area(what, lane.named.robot, start, end, ranges)
        for start, end, what, lane, row in places[:MOST_AREAS]
        if (ranges := ranges_in(tables.row(lane.table, row)["detail"]))
    ]
    return told, max(0, len(places) - MOST_AREAS)


def _masters(lanes: Sequence[Lane], codes: Codes, window: tuple[Time, Time], robot: int) -> set[int]:
    """Return the masters of the piconets to which *robot* belongs in the *window*, itself included."""
    slaves = codes.slaves
    found = {robot}
    for lane in lanes:
        if lane.named.what == "states" and lane.named.robot == robot:
            boxes = lane.within(*window)
            found.update(boxes.peers[np.isin(boxes.kinds, slaves)].tolist())
    return found


def ranges_in(detail: str) -> list[list[int]]:
    """Return first and last channel of each range that the *detail* of an interval names."""
    found = _CHANNELS.search(detail)
    return [] if found is None else pairs_of(found[1])


def tallies(lanes: Sequence[Lane], lost: Array, window: tuple[Time, Time]) -> list[Tally]:
    """Return how many frames begin in the *window* on each channel, and how many of them are *lost*, by outcome."""
    found: dict[int, Tally] = {}
    for lane in lanes:
        if lane.named.what != CHANNEL:
            continue
        first, end = np.searchsorted(lane.boxes.starts, window).tolist()
        bad = int(np.count_nonzero(lost[lane.boxes.outcomes[first:end]]))
        channel = lane.named.channel
        before = found.get(channel, Tally(channel, 0, 0))
        found[channel] = Tally(channel, before.frames + end - first, before.lost + bad)
    return [found[channel] for channel in sorted(found)]
