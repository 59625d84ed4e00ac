"""The boxes that rows of tables make, and the lanes that they belong to."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.intervals import HOST, LINKED, MEMBER, master_of, partner
from cosim.timeline.codes import CHANNEL, CUT, EVENT, FRAME, MESSAGE, PICONET, STATE, WAKE, Codes, Named
from cosim.timeline.lanes import Array, Boxes
from cosim.timeline.sections import of_bluetooth, of_low_energy
from cosim.trace import FRAMES, INTERVALS, MESSAGES, TRANSMISSIONS, WAKES, Trace
from cosim.units import Time

EVENTS: Final = "events"
SOURCES: Final[dict[str, tuple[str, ...]]] = {
    TRANSMISSIONS.name: ("time_ns", "source", "destination", "duration_ns", "kind", "channel", "whole"),
    FRAMES.name: ("time_ns", "source", "destination", "duration_ns", "kind", "channel", "length", "outcome", "part"),
    INTERVALS.name: ("start_ns", "robot", "end_ns", "radio", "state", "detail"),
    MESSAGES.name: ("time_ns", "source", "sender"),
    WAKES.name: ("time_ns", "source"),
    EVENTS: ("time_ns", "source", "event"),
}
"""Tables whose rows are boxes, in the order in which they are to be read, with the columns that tell which."""
RADIO: Final = "radio"
MOST_STACKED: Final = 16
"""Lanes of overlapping boxes of one kind; the last one takes all that have no place in the others."""


_WORDED: Final = ("outcome", "part", "kind")
"""Columns of frames that are words."""
_TOGETHER: Final = 8
"""Frames of one lane that begin at one instant, at most: those beyond show no loss."""


class Made(NamedTuple):
    """Boxes of one kind of lanes, of several robots."""

    what: str
    robots: Array
    radios: Array
    which: Array
    """Which of the lanes of that kind: of those in which others would overlap, or of those of channels."""
    boxes: Boxes

    def by_lane(self) -> Iterator[tuple[tuple[int, int, int], Boxes]]:
        """Yield (robot, radio, which) and the boxes of each lane, in their order."""
        if not len(self.robots):
            return
        keys = ((self.robots + 1) << 24) | ((self.radios + 1) << 16) | self.which
        lanes, numbers = np.unique(keys, return_inverse=True)
        if len(lanes) < 1 << 16:
            numbers = numbers.astype(np.uint16)  # which NumPy sorts by its bytes
        order = np.argsort(numbers, kind="stable")
        edges = np.concatenate(([0], np.cumsum(np.bincount(numbers, minlength=len(lanes)))))
        for at, lane in enumerate(lanes.tolist()):
            key = (lane >> 24) - 1, (lane >> 16 & 0xFF) - 1, lane & 0xFFFF
            yield key, self.boxes.taken(order[edges[at] : edges[at + 1]])


class Stacks:
    """Where intervals of one robot and radio that overlap are put: each into the first lane that is free."""

    def __init__(self) -> None:
        self._ends: defaultdict[tuple[int, int], list[Time]] = defaultdict(list)
        self._held: dict[tuple[Any, ...], int] = {}

    def place(self, key: tuple[int, int], start: Time, end: Time) -> int:
        """Return the number of the lane of the interval from *start* to *end*."""
        ends = self._ends[key]
        for at, before in enumerate(ends):
            if before <= start:
                ends[at] = end
                return at
        if len(ends) < MOST_STACKED:
            ends.append(end)
            return len(ends) - 1
        ends[-1] = max(ends[-1], end)
        return MOST_STACKED - 1

    def hold(self, interval: tuple[Any, ...], key: tuple[int, int], start: Time) -> int:
        """Return the number of the lane of an *interval* that has not ended: nothing else is put there until then."""
        if interval not in self._held:
            self._held[interval] = self.place(key, start, 1 << 62)
        return self._held[interval]

    def release(self, interval: tuple[Any, ...], key: tuple[int, int], end: Time) -> int | None:
        """Return the number of the lane where an *interval* was held that has ended now; None if it was not."""
        at = self._held.pop(interval, None)
        if at is not None:
            self._ends[key][at] = end
        return at


class Losses(NamedTuple):
    """Frames that a receiver has lost: what is to be shown at those who have sent them."""

    times: Array
    sources: Array
    radios: Array
    channels: Array
    kinds: Array
    outcomes: Array

    def shown(self, what: str, key: tuple[int, int, int]) -> Array:
        """Return a mask of those that the lane *key* of the kind *what* shows."""
        robot, radio, which = key
        mask: Array = (self.radios == radio) & (self.channels == which if what == CHANNEL else self.sources == robot)
        return mask

    def taken(self, which: Array) -> "Losses":
        """Return those that *which* selects."""
        return Losses(*(column[which] for column in self))

    def mark(self, boxes: Boxes, what: str) -> Array:
        """Give the *boxes* of these frames, sorted by their starts, the outcome; return which frames have one."""
        there = np.zeros(len(self.times), dtype=bool)
        if not len(boxes.starts):
            return there
        at = np.searchsorted(boxes.starts, self.times, side="left")
        for ahead in range(_TOGETHER):
            here = np.minimum(at + ahead, len(boxes.starts) - 1)
            same = (boxes.starts[here] == self.times) & (boxes.kinds[here] == self.kinds)
            if what == CHANNEL:
                same &= boxes.peers[here] == self.sources
            boxes.outcomes[here[same]] = self.outcomes[same]
            there |= same
        return there


def all_of(parts: Sequence[Losses]) -> Losses:
    """Return the frames of all *parts*."""
    none = Losses(*(np.zeros(0, dtype=dtype) for dtype in _LOSSES))
    return Losses(*(np.concatenate(columns) for columns in zip(none, *parts, strict=True)))


_LOSSES: Final = (np.int64, np.int64, np.int64, np.int64, np.uint16, np.uint8)
"""Types of the columns of losses."""


class Maker:
    """Makes boxes of rows: a table's columns are arrays of numbers, and (codes, words by code) for text."""

    def __init__(self, codes: Codes, late: bool = False, low_energy: Collection[int] = ()) -> None:
        """*late*: rows of a radio's transmissions may come after those of its frames; *low_energy*: radios of it."""
        self.codes = codes
        self.stacks = Stacks()
        self._late = late
        self._low_energy = sorted(low_energy)
        self.sending: set[int] = set()
        """Radios of whose transmissions there are rows."""
        self.losses: list[Losses] = []
        """Frames of these radios that a receiver has lost."""

    def made(self, table: str, columns: Mapping[str, Any], first: int, details: Any = None) -> list[Made]:
        """Return the boxes of the rows of *table* from number *first* on."""
        make = getattr(self, f"_{table}")
        made: list[Made] = make(columns, first, details) if table == INTERVALS.name else make(columns, first)
        return made

    def _transmissions(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        cut = ~columns["whole"]
        outcomes = np.where(cut, self.codes.outcome(CUT) if cut.any() else 0, 0).astype(np.uint8)
        radios, sources = _radios(columns), columns["source"]
        self.sending.update(np.unique(radios).tolist())
        boxes = self._frame_boxes(columns, outcomes, first)
        sent = _made("sent", sources, radios, boxes._replace(peers=peers_of(columns["destination"])))
        return [sent, _on_channels(columns, radios, boxes._replace(peers=peers_of(sources)))]

    def _frames(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        radios, robots, sources = _radios(columns), columns["destination"], columns["source"]
        boxes = self._frame_boxes(columns, self._outcomes(columns), first)._replace(peers=peers_of(sources))
        to_one = robots >= 0
        told = np.isin(radios, sorted(self.sending))
        lost = _lut(self.codes.lost, bool)[boxes.outcomes]
        missed = lost if self._late else told & lost
        if missed.any():
            shown = boxes.starts, sources, radios, columns["channel"], boxes.kinds, boxes.outcomes
            self.losses.append(Losses(*(column[missed] for column in shown)))
        made = [_made("received", robots, radios, boxes, to_one)]
        made.append(_made("broadcasts", sources, radios, boxes, told & ~to_one))
        if not told.all():
            sent = boxes._replace(outcomes=np.where(lost, boxes.outcomes, 0).astype(np.uint8))
            made.append(_made("sent", sources, radios, sent._replace(peers=peers_of(robots)), ~told))
            made.append(_on_channels(columns, radios, sent, ~told))
        return made

    def _outcomes(self, columns: Mapping[str, Any]) -> Array:
        """Return the codes of the outcomes of rows of frames, and of the parts that failed."""
        (outcomes, words), (parts, part_words) = columns["outcome"], columns["part"]
        own = np.isin(_radios(columns), self._low_energy) & _lut([part != "" for part in part_words], bool)[parts]
        table = np.zeros(max(1, len(words) * max(1, len(part_words))), dtype=np.uint8)
        pairs = outcomes.astype(np.int64) * max(1, len(part_words)) + parts
        for pair in np.unique(pairs[~own]).tolist():
            word, part = divmod(pair, len(part_words))
            table[pair] = self.codes.outcome(words[word], part_words[part], of_bluetooth(part_words[part]))
        codes: Array = table[pairs]
        for row in np.flatnonzero(own).tolist():
            codes[row] = self._lost_of_low_energy(columns, row)
        return codes

    def _lost_of_low_energy(self, columns: Mapping[str, Any], row: int) -> int:
        """Return the code of the outcome of a *row* of a frame of Low Energy of which a part was lost."""
        outcome, part, kind = (words[codes[row]] for codes, words in (columns[name] for name in _WORDED))
        section = of_low_energy(part, kind, int(columns["duration_ns"][row]), int(columns["length"][row]))
        return self.codes.outcome(outcome, part, section)

    def _frame_boxes(self, columns: Mapping[str, Any], outcomes: Array, first: int) -> Boxes:
        starts = columns["time_ns"]
        kinds = self._kinds(FRAME, columns["kind"])
        ends, rows = starts + columns["duration_ns"], _numbers(first, starts)
        return Boxes(starts, ends, kinds, outcomes, rows, _nobody(starts))

    def _intervals(self, columns: Mapping[str, Any], first: int, details: Any) -> list[Made]:
        starts, ends = columns["start_ns"], columns["end_ns"]
        robots, radios = columns["robot"], columns["radio"]
        spans = zip(starts.tolist(), ends.tolist(), robots.tolist(), radios.tolist(), strict=True)
        if details is None:
            stacked = [self.stacks.place((robot, radio), start, end) for start, end, robot, radio in spans]
        else:
            stacked = [
                at if (at := self.stacks.release(detail, detail[:2], row[1])) is not None
                else self.stacks.place(detail[:2], row[0], row[1])
                for row, detail in zip(spans, details, strict=True)
            ]  # fmt: skip
        kinds, rows = self._kinds(STATE, columns["state"]), _numbers(first, starts)
        boxes = Boxes(
            starts,
            ends,
            kinds,
            _zeros(starts),
            rows,
            peers_of(_robots_in(columns["state"], columns["detail"], LINKED, partner)),
        )
        made = Made("states", robots, radios, np.array(stacked, dtype=np.int64), boxes)
        return [made, _in_piconets(columns, boxes)]

    def _messages(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        return [self._instants("messages", columns, self._all_of(MESSAGE, columns), first)]

    def _wakes(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        return [self._instants("wakes", columns, self._all_of(WAKE, columns), first)]

    def _events(self, columns: Mapping[str, Any], first: int) -> list[Made]:
        return [self._instants("events", columns, self._kinds(EVENT, columns["event"]), first)]

    def _instants(self, what: str, columns: Mapping[str, Any], kinds: Array, first: int) -> Made:
        times = columns["time_ns"]
        peers = peers_of(columns["sender"]) if "sender" in columns else _nobody(times)
        boxes = Boxes(times, times, kinds, _zeros(times), _numbers(first, times), peers)
        return _made(what, columns["source"], np.full(len(times), HOST, dtype=np.int64), boxes)

    def _all_of(self, group: str, columns: Mapping[str, Any]) -> Array:
        """Return the kinds of rows of a table that has one kind only, of the name of its *group*."""
        return np.full(len(columns["time_ns"]), self.codes.kind(group, group), dtype=np.uint16)

    def _kinds(self, group: str, column: tuple[Array, Sequence[str]]) -> Array:
        codes, words = column
        return _lut([self.codes.kind(group, word) for word in words], np.uint16)[codes]


def _on_channels(columns: Mapping[str, Any], radios: Array, boxes: Boxes, mask: Array | None = None) -> Made:
    """Return the boxes of RF channels, whose robot is nobody."""
    channels = columns["channel"]
    there = channels >= 0 if mask is None else mask & (channels >= 0)
    nobody = np.full(len(channels), -1, dtype=np.int64)
    return Made(CHANNEL, nobody[there], radios[there], channels[there], boxes.taken(there))


def _in_piconets(columns: Mapping[str, Any], boxes: Boxes) -> Made:
    """Return the boxes of members of piconets, by master and member."""
    masters = _robots_in(columns["state"], columns["detail"], MEMBER, master_of)
    there = np.flatnonzero(masters >= 0)
    members = columns["robot"][there]
    found = boxes.taken(there)._replace(peers=peers_of(members))
    return Made(PICONET, masters[there], columns["radio"][there], members, found)


def _lut(codes: Sequence[int], dtype: Any) -> Array:
    return np.array(codes or [0], dtype=dtype)


def peers_of(robots: Array) -> Array:
    """Return *robots* as a column of peers."""
    return np.clip(robots, -2, np.iinfo(np.int16).max).astype(np.int16)


def _robots_in(
    states: tuple[Array, Sequence[str]],
    details: tuple[Array, Sequence[str]],
    wanted: Mapping[str, Any],
    named: Callable[[str, str], int],
) -> Array:
    """Return the robot that is *named* by state and detail of each interval in one of the *wanted* states; -1 else."""
    (state_codes, state_words), (codes, words) = states, details
    robots = np.full(len(codes), -1)
    for state, word in enumerate(state_words):
        if word not in wanted:
            continue
        there = np.flatnonzero(state_codes == state)
        texts, which = np.unique(codes[there], return_inverse=True)  # each text once, of many rows
        robots[there] = np.array([named(word, words[text]) for text in texts.tolist()], dtype=np.int64)[which]
    return robots


def _nobody(column: Array) -> Array:
    return np.full(len(column), -1, dtype=np.int16)


def _zeros(column: Array) -> Array:
    return np.zeros(len(column), dtype=np.uint8)


def _numbers(first: int, column: Array) -> Array:
    return np.arange(first, first + len(column), dtype=np.uint32)


def _radios(columns: Mapping[str, Any]) -> Array:
    radios: Array = columns[RADIO] if RADIO in columns else np.zeros(len(columns["time_ns"]), dtype=np.int64)
    return radios


def _made(what: str, robots: Array, radios: Array, boxes: Boxes, mask: Array | None = None) -> Made:
    if mask is not None:
        robots, radios, boxes = robots[mask], radios[mask], boxes.taken(mask)
    return Made(what, robots, radios, np.zeros(len(robots), dtype=np.int64), boxes)


def distinct(boxes: Boxes, what: str) -> Boxes:
    """Return *boxes* of a lane of the kind *what* with one of those that are rows of one frame.

    It is lost if any of them is, and meant for all if they have several peers.
    """
    same = np.zeros(len(boxes.starts), dtype=bool)
    same[1:] = (boxes.starts[1:] == boxes.starts[:-1]) & (boxes.kinds[1:] == boxes.kinds[:-1])
    if what == CHANNEL:  # the peer is the sender
        same[1:] &= boxes.peers[1:] == boxes.peers[:-1]
    if not same.any():
        return boxes
    firsts = np.flatnonzero(~same)
    outcomes = np.maximum.reduceat(boxes.outcomes, firsts)
    several = np.minimum.reduceat(boxes.peers, firsts) != np.maximum.reduceat(boxes.peers, firsts)
    peers = np.where(several, -1, boxes.peers[firsts]).astype(np.int16)
    return boxes.taken(firsts)._replace(outcomes=outcomes, peers=peers)


def in_order(boxes: Boxes) -> Boxes:
    """Return *boxes* by (start, row), given by row."""
    starts = boxes.starts
    return boxes if (starts[1:] >= starts[:-1]).all() else boxes.taken(np.argsort(starts, kind="stable"))


def names_of(table: str, there: Sequence[str]) -> list[str]:
    """Return the names of the columns of *table* that are needed, of those that are *there*."""
    return [*SOURCES[table], *((RADIO,) if RADIO in there and RADIO not in SOURCES[table] else ())]


def columns_of(table: str, columns: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """Return what a :class:`Maker` takes of *columns* that are lists."""
    found: dict[str, Any] = {}
    for name in names_of(table, list(columns)):
        column = columns[name]
        if name in ("kind", "outcome", "part", "state", "detail", "event"):
            words = list(dict.fromkeys(column))
            codes = {word: code for code, word in enumerate(words)}
            found[name] = np.array([codes[word] for word in column], dtype=np.int64), words
        else:
            found[name] = np.array(column, dtype=bool if name == "whole" else np.int64)
    return found


def by_time(trace: Trace, table: str) -> dict[str, Any]:
    """Return what a :class:`Maker` takes of *table* of *trace*, its rows in the order in which they are stored."""
    columns = trace.columns(table)
    order = np.argsort(np.array(columns[SOURCES[table][0]], dtype=np.int64), kind="stable").tolist()
    return columns_of(table, {name: [column[at] for at in order] for name, column in columns.items()})


def lane_name(what: str, key: tuple[int, int, int], several: bool) -> Named:
    """Return what the lane *key*, (robot, radio, which), of the kind *what* is called."""
    robot, radio, which = key
    if what == CHANNEL:
        return Named(robot, radio, what, 0, several, which)
    return Named(robot, radio, what, which, several)
