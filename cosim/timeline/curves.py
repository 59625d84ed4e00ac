"""Curves over time, in equal parts of a window: what falls into each part, what lasts in it, or how long things took.

A count is per second, and 0 where nothing was. A level is the mean over the part's time of how many boxes there were.
A duration is the mean of those that ended in the part, with the least and the greatest; without any there is none.
The one of a metric, or of a queue's length, is the mean over the part's time, with the least and the greatest.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from cosim.timeline.assembly import lost_codes
from cosim.timeline.codes import EVENT, STATE, Codes
from cosim.timeline.lanes import Array, Boxes, Lane
from cosim.timeline.queues import NO_QUEUES, Queue, Queues
from cosim.units import S, Time

ROBOTS_ONLY: Final = 1 << 31
"""A number of robots that no address reaches: where there are no stations."""
_BLOCK: Final = 4096
"""Boxes that are looked at together for the packet before the window."""


class Curve(NamedTuple):
    """What a curve is called, and what it shows."""

    name: str
    title: str
    unit: str
    meaning: str
    of_robots: bool = True
    """Whether each robot has one of its own."""


class Values(NamedTuple):
    """What a curve is in each part, oldest first; NaN where it is nothing."""

    mean: Array
    """float64"""
    least: Array | None = None
    most: Array | None = None


class Series(NamedTuple):
    """A metric over time, as a step function."""

    times: Array
    """int64, ns, sorted: when it has changed"""
    values: Array
    """float64: what it is from then on"""
    unit: str


SeriesOfRun: TypeAlias = Mapping[tuple[int, str], Series]
"""Metrics over time by robot, -1 for those of the team, and name."""
_TEAM: Final = -1


class Parts(NamedTuple):
    """Equal parts of a window, one after the other."""

    start: Time
    step: Time
    number: int

    @property
    def edges(self) -> Array:
        """Where they begin, and the end of the last, int64, ns."""
        return self.start + self.step * np.arange(self.number + 1, dtype=np.int64)

    @property
    def end(self) -> Time:
        """The end of the last."""
        return self.start + self.step * self.number


class Drawn(NamedTuple):
    """What curves are made from."""

    lanes: Sequence[Lane]
    codes: Codes
    series: SeriesOfRun = MappingProxyType({})
    queues: Queues = NO_QUEUES
    robots: int = ROBOTS_ONLY
    """Number of robots: addresses from there on are those of stations in the background."""

    def of(self, robot: int | None) -> list[Lane]:
        """Return the lanes of *robot*, or of a station; for None those of the team, and of nobody."""
        return [
            lane
            for lane in self.lanes
            if (lane.named.robot < self.robots if robot is None else lane.named.robot == robot)
        ]


def curves(drawn: Drawn) -> list[Curve]:
    """Return the curves that there are."""
    there = {lane.named.what for lane in drawn.lanes}
    found = [each for what, each in _OF_LANES if what in there]
    found += [_POLLS] if drawn.codes.slaves and "sent" in there else []
    found += [curve for curve, _ in _OF_QUEUES] if drawn.queues else []
    kinds = drawn.codes.kinds
    found += [_of_state(name) for group, name in kinds if group == STATE]
    found += [_of_event(name) for group, name in kinds if group == EVENT]
    metrics = {name: (series.unit, robot != _TEAM) for (robot, name), series in drawn.series.items()}
    return found + [_of_metric(name, *about) for name, about in metrics.items()]


_DELIVERED: Final = Curve("delivered", "delivered/s", "1/s", "payloads that have arrived at a host")
_LOST: Final = Curve("lost", "lost/s", "1/s", "frames to one robot that it has not received, by their beginning")
_SENT: Final = Curve("sent", "frames/s", "1/s", "frames sent")
_SENDING: Final = Curve("sending", "sending", "1", "how many were sending, over the time; of a robot, the share of it")
_OF_LANES: Final = (("messages", _DELIVERED), ("received", _LOST), ("sent", _SENT), ("sent", _SENDING))
_POLLS: Final = Curve(
    "poll_gap",
    "poll gap",
    "ms",
    "from one packet of a master (or central) to its slave (or peripheral) to the next; of a robot, where it is the "
    "slave. Polls of idle slaves are only known if the scenario has idle_frames",
)
_LENGTH: Final = Curve(
    "queue_length",
    "queue length",
    "payloads",
    "how many payloads radios had accepted that were not over: sent, delivered, lost or flushed. Where there are "
    "routers, packets that these had handed to their radios",
)
_WAIT: Final = Curve(
    "message_wait",
    "message wait",
    "ms",
    "from the acceptance of a payload by a radio to the start of the first frame that carries it, where that starts; "
    "RTS and CTS come before it",
)


def _of_state(name: str) -> Curve:
    meaning = f"how many intervals of the state {name} there were, over the time; of a robot, of its own"
    return Curve(f"{STATE}:{name}", name.replace("_", " "), "1", meaning)


def _of_event(name: str) -> Curve:
    return Curve(f"{EVENT}:{name}", f"{name}/s", "1/s", f"events {name}")


def _of_metric(name: str, unit: str, of_robots: bool) -> Curve:
    meaning = f"what {name} would be if the run ended then"
    return Curve(f"metric:{name}", name.replace("_", " "), unit, meaning, of_robots)


def values(name: str, drawn: Drawn, parts: Parts, robot: int | None) -> Values | None:
    """Return the curve *name* of the team, or of a *robot*; None if there is none of that name."""
    group, _, kind = name.partition(":")
    if group == "metric":
        series = _chosen(drawn.series, kind, robot)
        return None if series is None else _averaged(series, parts)
    for curve, of_queue in _OF_QUEUES:
        if name == curve.name:
            return of_queue(drawn.queues.of(robot, drawn.robots), parts) if drawn.queues else None
    lanes = drawn.of(robot)
    if name == _POLLS.name:
        return _gaps(drawn, lanes, parts)
    make = _MAKERS.get(name if not kind else group)
    code = drawn.codes.code_of(group, kind)
    if make is None or (kind and code is None):
        return None
    return make(lanes, parts, drawn.codes, code)


def _of(lanes: Iterable[Lane], what: str) -> list[Lane]:
    return [lane for lane in lanes if lane.named.what == what]


# ---------------------------------------------------------------- counts


def _counted(lanes: Iterable[Lane], parts: Parts, wanted: Callable[[Boxes], Array] | None = None) -> Values:
    edges = parts.edges
    count = np.zeros(parts.number, dtype=np.int64)
    for lane in lanes:
        first, end = np.searchsorted(lane.boxes.starts, edges[[0, -1]])
        boxes = lane.boxes.taken(slice(first, end))
        starts = boxes.starts if wanted is None else boxes.starts[wanted(boxes)]
        count += np.diff(np.searchsorted(starts, edges))
    return Values(count * (S / parts.step))


def _delivered(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    return _counted(_of(lanes, "messages"), parts)


def _lost(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    lost = lost_codes(codes)
    return _counted(_of(lanes, "received"), parts, lambda boxes: lost[boxes.outcomes])


def _sent(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    return _counted(_of(lanes, "sent"), parts)


def _events(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    return _counted(_of(lanes, "events"), parts, lambda boxes: boxes.kinds == code)


# ---------------------------------------------------------------- levels


def _level(lanes: Iterable[Lane], parts: Parts, code: int | None) -> Values:
    """Return how many boxes there are, those of one kind if *code* is one: exact sums of ns, divided at last."""
    edges = parts.edges - parts.start
    lasted = np.zeros(parts.number, dtype=np.int64)
    for lane in lanes:
        boxes = lane.within(parts.start, parts.end)
        if code is not None:
            boxes = boxes.taken(boxes.kinds == code)
        begins = np.maximum(boxes.starts - parts.start, 0)
        ends = np.sort(np.minimum(boxes.ends - parts.start, edges[-1]))
        lasted += np.diff(_passed(begins, edges) - _passed(ends, edges))
    return Values(lasted / parts.step)


def _passed(instants: Array, edges: Array) -> Array:
    """Return at each edge the time that has passed since the sorted *instants* before it, all together.

    Sums that do not fit 64 bits wrap, and so do their differences: back.
    """
    before = np.searchsorted(instants, edges)
    passed: Array = before * edges - np.concatenate(([0], np.cumsum(instants)))[before]
    return passed


def _sending(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    return _level(_of(lanes, "sent"), parts, None)


def _states(lanes: Sequence[Lane], parts: Parts, codes: Codes, code: int | None) -> Values:
    return _level((lane for lane in lanes if lane.named.what in ("states", "busy", "NAV")), parts, code)


_MAKERS: Final[dict[str, Callable[[Sequence[Lane], Parts, Codes, int | None], Values]]] = {
    _DELIVERED.name: _delivered,
    _LOST.name: _lost,
    _SENT.name: _sent,
    _SENDING.name: _sending,
    STATE: _states,
    EVENT: _events,
}


# ---------------------------------------------------------------- durations


def _gaps(drawn: Drawn, lanes: Sequence[Lane], parts: Parts) -> Values:
    """Return the gaps between packets from masters to the robots of *lanes*, their slaves, by where they end."""
    slaves = drawn.codes.slaves
    sent = {lane.named[:2]: lane for lane in _of(drawn.lanes, "sent")}
    ends, lengths = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for lane in _of(lanes, "states"):
        links = lane.within(parts.start, parts.end)
        links = links.taken(np.isin(links.kinds, slaves))
        for begin, end, master in zip(links.starts.tolist(), links.ends.tolist(), links.peers.tolist(), strict=True):
            of_master = sent.get((master, lane.named.radio))
            if of_master is not None:
                polls = _polls(of_master.boxes, lane.named.robot, begin, (parts.start, min(end, parts.end)))
                ends.append(polls[1:])
                lengths.append(np.diff(polls))
    return _mean(np.concatenate(ends), np.concatenate(lengths), parts)


def _polls(boxes: Boxes, slave: int, begin: Time, window: tuple[Time, Time]) -> Array:
    """Return when packets to *slave* begin in the *window*, and the last before it, if the link was up by then."""
    least, first, end = np.searchsorted(boxes.starts, (begin, max(begin, window[0]), max(begin, window[1]))).tolist()
    found: Array = boxes.starts[first:end][boxes.peers[first:end] == slave]
    while first > least:
        block = slice(max(least, first - _BLOCK), first)
        before = boxes.starts[block][boxes.peers[block] == slave]
        if len(before):
            return np.concatenate((before[-1:], found))
        first = block.start
    return found


def _mean(times: Array, lengths: Array, parts: Parts) -> Values:
    """Return the mean, least and greatest of *lengths*, ns, in ms, in the parts in which their *times* are."""
    least, most = np.full(parts.number, np.inf), np.full(parts.number, -np.inf)
    at = (times - parts.start) // parts.step
    count = np.bincount(at, minlength=parts.number)
    total = np.zeros(parts.number, dtype=np.int64)
    np.add.at(total, at, lengths)
    np.minimum.at(least, at, lengths / 1e6)
    np.maximum.at(most, at, lengths / 1e6)
    there = count > 0
    mean = np.where(there, total / np.maximum(count, 1) / 1e6, np.nan)
    return Values(mean, np.where(there, least, np.nan), np.where(there, most, np.nan))


# ---------------------------------------------------------------- queues


def _length(queue: Queue, parts: Parts) -> Values:
    return _averaged(Series(*queue.within(parts.start, parts.end), _LENGTH.unit), parts)


def _wait(queue: Queue, parts: Parts) -> Values:
    here = slice(*np.searchsorted(queue.begun, (parts.start, parts.end)))
    return _mean(queue.begun[here], queue.waited[here], parts)


_OF_QUEUES: Final = ((_LENGTH, _length), (_WAIT, _wait))


# ---------------------------------------------------------------- metrics


def series_of(columns: Mapping[str, Sequence[Any]]) -> SeriesOfRun:
    """Return the metrics over time that the rows of the table ``metrics`` are, sorted by time."""
    found: dict[tuple[int, str], tuple[list[int], list[float], str]] = {}
    names = ("time_ns", "source", "metric", "value", "unit")
    for time, robot, name, value, unit in zip(*(columns[column] for column in names), strict=True):
        times, values, _ = found.setdefault((robot, name), ([], [], unit))
        times.append(time)
        values.append(value)
    return {
        key: Series(np.array(times, dtype=np.int64), np.array(values, dtype=np.float64), unit)
        for key, (times, values, unit) in found.items()
    }


def _chosen(all_series: SeriesOfRun, name: str, robot: int | None) -> Series | None:
    """Return the metric *name* of a *robot* if each has its own, else of the team: its own, or that of all together."""
    found = all_series.get((_TEAM, name)) or (None if robot is None else all_series.get((robot, name)))
    parts = [series for (of, each), series in all_series.items() if each == name and of != _TEAM]
    if found is not None or robot is not None or not parts:
        return found
    times = np.unique(np.concatenate([part.times for part in parts]))
    total = np.sum([_held(part, times) for part in parts], axis=0)
    return Series(times, total, parts[0].unit)


def _held(series: Series, at: Array) -> Array:
    """Return what a metric is *at* instants; NaN before it is known."""
    which = np.searchsorted(series.times, at, side="right") - 1
    return np.where(which >= 0, series.values[which], np.nan)


def _averaged(series: Series, parts: Parts) -> Values:
    """Return the mean over the time of each part in which the metric is known, with the least and the greatest."""
    edges = parts.edges
    first, end = np.searchsorted(series.times, edges[0], side="right"), np.searchsorted(series.times, edges[-1])
    points = np.union1d(edges, series.times[first:end])
    held = _held(series, points[:-1])
    known = ~np.isnan(held)
    firsts = np.searchsorted(points[:-1], edges[:-1])
    lengths = np.where(known, np.diff(points), 0)
    total = np.add.reduceat(np.where(known, held, 0.0) * lengths, firsts)
    lasted = np.add.reduceat(lengths, firsts)
    mean = np.where(lasted > 0, total / np.maximum(lasted, 1), np.nan)
    return Values(mean, np.fmin.reduceat(held, firsts), np.fmax.reduceat(held, firsts))
