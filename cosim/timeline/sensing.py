"""Lanes of 802.11 stations that no table has: when the medium was busy for them, and when their NAV reserved it.

Both follow from transmissions and receptions (``cosim.channels.adhoc.carrier``) once a run is over. A box belongs to
the row of the transmission that it begins with, and its peer is who sent that.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Bools, Int64s
from cosim.channels.adhoc.carrier import carrier, places
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.machine import BROADCAST
from cosim.timeline.codes import BUSY, NAV, STATE, Codes, Named
from cosim.timeline.gathering import lane_of
from cosim.timeline.lanes import DTYPES, Array, Boxes, Lane
from cosim.timeline.rows import RADIO, peers_of
from cosim.trace import RECEPTIONS, TRANSMISSIONS, TableFile
from cosim.units import Time

SENSED: Final = (BUSY, NAV)
"""What these lanes hold."""
_SENT: Final = ("time_ns", "source", "destination", "duration_ns", "reserves_ns")
_HEARD: Final = ("time_ns", "source", "receiver", "power_dbm", "sinr_db", "outcome")
_FAR: Final = "out_of_range"

Columns = dict[str, Array]


def sensed(files: Mapping[str, TableFile], codes: Codes, several: bool) -> list[Lane]:
    """Return the lanes of all 802.11 radios of a run, without levels, from its tables by name.

    There are none if one of the tables is missing, or if it does not tell the settings of the radios.
    """
    if not {TRANSMISSIONS.name, RECEPTIONS.name} <= files.keys():
        return []
    radios = _radios(files[TRANSMISSIONS.name].metadata)
    if not radios:
        return []
    sent, heard = _columns(files[TRANSMISSIONS.name], _SENT), _columns(files[RECEPTIONS.name], _HEARD)
    return [
        lane
        for radio, settings in radios.items()
        for lane in _Radio(_of(sent, radio), _of(heard, radio), settings).lanes(radio, codes, several)
    ]


def _radios(metadata: Mapping[str, str]) -> dict[int, AdhocSettings]:
    """Return the settings of the 802.11 radios, by number; none for a trace that does not tell them as we know them."""
    try:
        channel = json.loads(metadata["scenario"])["channel"]
        parts = channel["radios"] if channel["kind"] == "radios" else [channel]
        adhoc = {radio: part for radio, part in enumerate(parts) if part["kind"] == "adhoc"}
        return {radio: AdhocSettings.model_validate(part) for radio, part in adhoc.items()}
    except (KeyError, TypeError, ValueError):
        return {}


def _columns(file: TableFile, names: tuple[str, ...]) -> Columns:
    wanted = [*names, *((RADIO,) if RADIO in file.names else ())]
    groups = [
        {name: np.array(each[1])[each[0]] if isinstance(each, tuple) else each for name, each in group.items()}
        for group in file.groups(wanted)
    ]
    found = {name: np.concatenate([group[name] for group in groups]) if groups else _NOTHING for name in wanted}
    return found | {"row": np.arange(len(found["time_ns"]))}


_NOTHING: Final = np.zeros(0, np.int64)


def _of(columns: Columns, radio: int) -> Columns:
    """Return the rows of one radio."""
    return _taken(columns, columns[RADIO] == radio) if RADIO in columns else columns


def _taken(columns: Columns, which: Array) -> Columns:
    return {name: column[which] for name, column in columns.items()}


class _Silences(NamedTuple):
    """When a station must not begin to send, and which frames that begins with, by their numbers in a table."""

    spans: Int64s
    """(n, 2)"""
    frames: Int64s


class _Radio:
    """The transmissions and receptions of one network."""

    def __init__(self, sent: Columns, heard: Columns, settings: AdhocSettings) -> None:
        self._sent = sent
        self._delay: Time = settings.timing().delay
        self._energy_dbm = settings.energy_dbm
        frames, found = places(sent, heard)
        self._heard = _taken(heard, found) | {"frame": frames[found]}

    def lanes(self, radio: int, codes: Codes, several: bool) -> Iterator[Lane]:
        kinds = {what: codes.kind(STATE, what) for what in SENSED} if len(self._sent["row"]) else {}
        for robot in np.union1d(self._sent["source"], self._heard["receiver"]).tolist():
            for what, silences in zip(SENSED, self._of(robot), strict=True):
                if len(silences.spans):
                    boxes = self._boxes(silences, kinds[what])
                    yield lane_of(Lane(Named(robot, radio, what, 0, several), TRANSMISSIONS.name, boxes))

    def _of(self, robot: int) -> tuple[_Silences, _Silences]:
        """Return when the medium was busy for *robot*, and when it was reserved."""
        heard = _taken(self._heard, self._heard["receiver"] == robot)
        own = np.flatnonzero(self._sent["source"] == robot)
        sent = _taken(self._sent, np.union1d(own, heard["frame"]))
        found = carrier(sent, heard, robot, self._delay, self._energy_dbm)
        time, duration = self._sent["time_ns"], self._sent["duration_ns"]
        frames = heard["frame"][heard["outcome"] != _FAR]
        begins = np.concatenate((time[own], time[frames] + self._delay))
        busy = _latest(begins, found.busy[:, 0], np.concatenate((own, frames)))
        to = self._sent["destination"][heard["frame"]]
        informs: Bools = (heard["outcome"] == "received") & (to != robot) & (to != BROADCAST)
        informing = heard["frame"][informs]
        informing = informing[self._sent["reserves_ns"][informing] > 0]
        ends = time[informing] + duration[informing] + self._delay
        return _Silences(found.busy, busy), _Silences(found.reserved, _latest(ends, found.reserved[:, 0], informing))

    def _boxes(self, silences: _Silences, kind: int) -> Boxes:
        count, frames = len(silences.spans), silences.frames
        columns = (
            *silences.spans.T,
            np.full(count, kind),
            np.zeros(count),
            self._sent["row"][frames],
            peers_of(self._sent["source"][frames]),
        )
        return Boxes(*(np.ascontiguousarray(column, dtype) for column, dtype in zip(columns, DTYPES, strict=True)))


def _latest(times: Int64s, until: Int64s, frames: Int64s) -> Int64s:
    """Return of those *frames* that have the *times* the latest one up to each instant of *until*."""
    order = np.argsort(times, kind="stable")
    found: Int64s = frames[order][np.searchsorted(times[order], until, side="right") - 1]
    return found
