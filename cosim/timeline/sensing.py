"""Lanes of 802.11 stations that no table has: when the medium was busy for them, and when their NAV reserved it.

Both follow from transmissions and receptions (``cosim.channels.adhoc.carrier``), of a whole run or of one that is under
way. A box belongs to the row of the transmission that it begins with, and its peer is who sent that.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.arrays import Bools, Int64s
from cosim.channels.adhoc.carrier import carrier, places
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.machine import BROADCAST, Address
from cosim.timeline.assembly import lane_of
from cosim.timeline.codes import BUSY, NAV, STATE, Codes, Named
from cosim.timeline.lanes import DTYPES, Array, Boxes, Lane
from cosim.timeline.radios import ADHOC, channel_of, parts_of
from cosim.timeline.rows import RADIO, peers_of
from cosim.trace import RECEPTIONS, TRANSMISSIONS, TableFile
from cosim.units import S, Time

SENSED: Final = (BUSY, NAV)
"""What these lanes hold."""
SENSED_FROM: Final = {
    TRANSMISSIONS.name: ("time_ns", "source", "destination", "duration_ns", "reserves_ns"),
    RECEPTIONS.name: ("time_ns", "source", "receiver", "power_dbm", "sinr_db", "outcome"),
}
"""The tables that they follow from, with the columns that matter, besides that of radios."""
_FAR: Final = "out_of_range"
_LATE: Final[Time] = 1 * S
"""How much later than rows of later frames a row may come, in a run under way: those beyond are left out."""

Columns = dict[str, Array]


def sensed(
    tables: Mapping[str, Columns], radios: Mapping[int, AdhocSettings], codes: Codes, several: bool
) -> list[Lane]:
    """Return the lanes of the 802.11 *radios* of a run, by number, without levels, from the columns of its tables.

    There are none if one of the tables is missing.
    """
    if not SENSED_FROM.keys() <= tables.keys():
        return []
    sent, heard = (
        tables[name] | {"row": np.arange(len(tables[name]["time_ns"]))}
        for name in (TRANSMISSIONS.name, RECEPTIONS.name)
    )
    found = []
    for radio, settings in radios.items():
        network = _Network(_of(sent, radio), _of(heard, radio), settings)
        kinds = _kinds(codes) if len(network.sent["row"]) else {}
        for robot in network.robots:
            for what, silences in zip(SENSED, network.silences(robot), strict=True):
                if len(silences.spans):
                    boxes = network.boxes(silences, kinds[what])
                    found.append(lane_of(Lane(Named(robot, radio, what, 0, several), TRANSMISSIONS.name, boxes)))
    return found


def adhoc_radios(channel: Any) -> dict[int, AdhocSettings]:
    """Return the settings of the 802.11 radios of a scenario's *channel*, by number; none if it is unknown."""
    try:
        return {radio: AdhocSettings.model_validate(part) for radio, part in parts_of(channel, ADHOC).items()}
    except ValueError:
        return {}


def radios_of(metadata: Mapping[str, str]) -> dict[int, AdhocSettings]:
    """Return the settings of the 802.11 radios of a run, by number, as the *metadata* of its tables tells them."""
    return adhoc_radios(channel_of(metadata))


def columns_of(file: TableFile, name: str) -> Columns:
    """Return what matters of the table *name*, which is that *file*."""
    wanted = [*SENSED_FROM[name], *((RADIO,) if RADIO in file.names else ())]
    groups = [
        {name: np.array(each[1])[each[0]] if isinstance(each, tuple) else each for name, each in group.items()}
        for group in file.groups(wanted)
    ]
    return {name: np.concatenate([group[name] for group in groups]) if groups else _NOTHING for name in wanted}


_NOTHING: Final = np.zeros(0, np.int64)


def _kinds(codes: Codes) -> dict[str, int]:
    return {what: codes.kind(STATE, what) for what in SENSED}


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


class _Network:
    """The transmissions and receptions of one network."""

    def __init__(self, sent: Columns, heard: Columns, settings: AdhocSettings) -> None:
        self.sent = sent
        self._delay: Time = settings.timing().delay
        self._energy_dbm = settings.energy_dbm
        frames, found = places(sent, heard)
        self._heard = _taken(heard, found) | {"frame": frames[found]}

    @property
    def robots(self) -> list[Address]:
        """Those that have sent or heard anything, in order."""
        found: list[Address] = np.union1d(self.sent["source"], self._heard["receiver"]).tolist()
        return found

    def silences(self, robot: Address) -> tuple[_Silences, _Silences]:
        """Return when the medium was busy for *robot*, and when it was reserved."""
        heard = _taken(self._heard, self._heard["receiver"] == robot)
        own = np.flatnonzero(self.sent["source"] == robot)
        sent = _taken(self.sent, np.union1d(own, heard["frame"]))
        found = carrier(sent, heard, robot, self._delay, self._energy_dbm)
        time, duration = self.sent["time_ns"], self.sent["duration_ns"]
        frames = heard["frame"][heard["outcome"] != _FAR]
        begins = np.concatenate((time[own], time[frames] + self._delay))
        busy = _latest(begins, found.busy[:, 0], np.concatenate((own, frames)))
        to = self.sent["destination"][heard["frame"]]
        informs: Bools = (heard["outcome"] == "received") & (to != robot) & (to != BROADCAST)
        informing = heard["frame"][informs]
        informing = informing[self.sent["reserves_ns"][informing] > 0]
        ends = time[informing] + duration[informing] + self._delay
        return _Silences(found.busy, busy), _Silences(found.reserved, _latest(ends, found.reserved[:, 0], informing))

    def boxes(self, silences: _Silences, kind: int) -> Boxes:
        """Return *silences* as boxes of that *kind*."""
        count, frames = len(silences.spans), silences.frames
        columns = (
            *silences.spans.T,
            np.full(count, kind),
            np.zeros(count),
            self.sent["row"][frames],
            peers_of(self.sent["source"][frames]),
        )
        return Boxes(*(np.ascontiguousarray(column, dtype) for column, dtype in zip(columns, DTYPES, strict=True)))


def _latest(times: Int64s, until: Int64s, frames: Int64s) -> Int64s:
    """Return of those *frames* that have the *times* the latest one up to each instant of *until*."""
    order = np.argsort(times, kind="stable")
    found: Int64s = frames[order][np.searchsorted(times[order], until, side="right") - 1]
    return found


# ---------------------------------------------------------------- a run that is under way


class News(NamedTuple):
    """What a lane holds from an instant on, in the place of what it has held."""

    named: Named
    since: Time
    boxes: Boxes


@dataclass
class _Recent:
    """The latest rows of one network."""

    settings: AdhocSettings
    sent: Columns = field(default_factory=dict)
    heard: Columns = field(default_factory=dict)
    reach: Time = 0
    """The longest time after its beginning for which a frame has kept anybody silent, ns."""
    whole_from: Time = 0
    """Instant from which on no frame that matters has been forgotten."""
    since: Time | None = None
    """Beginning of the oldest frame of which there is a new row."""

    def take(self, table: str, new: Columns) -> None:
        if table == TRANSMISSIONS.name:
            lasting = new["duration_ns"] + new["reserves_ns"] + self.settings.timing().delay
            self.reach = max(self.reach, int(lasting.max(initial=0)))
        name = "sent" if table == TRANSMISSIONS.name else "heard"
        setattr(self, name, _joined(getattr(self, name), new))
        oldest = int(new["time_ns"].min())
        self.since = oldest if self.since is None else min(self.since, oldest)

    def network(self, since: Time) -> _Network:
        """Return the frames that anybody may be silent for at *since* or later, and forget those of long ago."""
        self.whole_from = max(self.whole_from, since - _LATE)
        kept = [_taken(rows, rows["time_ns"] >= self.whole_from - self.reach) for rows in (self.sent, self.heard)]
        self.sent, self.heard = kept
        sent, heard = (_taken(rows, rows["time_ns"] >= since - self.reach) for rows in kept)
        return _Network(sent, heard, self.settings)


class Sensing:
    """What the 802.11 radios of a run under way sense, from the rows of two tables as they come."""

    def __init__(self, radios: Mapping[int, AdhocSettings], codes: Codes, several: bool) -> None:
        """Take the settings of the *radios*, by number; *several*: whether robots have several of any kind."""
        self._codes = codes
        self._several = several
        self._recent = {radio: _Recent(settings) for radio, settings in radios.items()}

    def take(self, table: str, rows: Mapping[str, Sequence[Any]], first: int) -> None:
        """Take *rows* of one of the tables that it follows from, by column, from number *first* on."""
        columns = {name: _array(name, rows[name]) for name in (*SENSED_FROM[table], RADIO) if name in rows}
        columns["row"] = np.arange(first, first + len(columns["time_ns"]))
        for radio, recent in self._recent.items():
            new = _of(columns, radio)
            if len(new["row"]):
                recent.take(table, new)

    def news(self) -> Iterator[News]:
        """Yield how lanes have changed by what was taken."""
        for radio, recent in self._recent.items():
            if recent.since is None or not recent.sent or not recent.heard:
                continue
            since, recent.since = max(recent.since, recent.whole_from), None
            network, kinds = recent.network(since), _kinds(self._codes)
            for robot in network.robots:
                for what, silences in zip(SENSED, network.silences(robot), strict=True):
                    late = silences.spans[:, 1] > since
                    if late.any():
                        spans = np.maximum(silences.spans[late], since)
                        boxes = network.boxes(_Silences(spans, silences.frames[late]), kinds[what])
                        yield News(Named(robot, radio, what, 0, self._several), since, boxes)


def _array(name: str, values: Sequence[Any]) -> Array:
    if name == "outcome":
        return np.array(values, np.str_)
    return np.array(values, np.float64 if name in ("power_dbm", "sinr_db") else np.int64)  # None: not a number


def _joined(rows: Columns, new: Columns) -> Columns:
    return {name: np.concatenate((rows[name], new[name])) for name in new} if rows else new
