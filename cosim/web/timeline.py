"""The timeline of a session as pages ask for it: lanes, windows of time, single boxes, what comes next.

A page asks in JSON, times being text of decimal digits, as many readers of JSON have 53 bits only:

    {"say": "window", "number": 7, "lanes": [0, 3], "from_ns": "0", "to_ns": "1000000", "step_ns": "1024"}
    {"say": "box", "lane": 3, "row": 17}
    {"say": "find", "kind": 4, "robot": null, "lost": true, "from_ns": "0", "back": false}
    {"say": "channels", "number": 9, "robot": null, "from_ns": "0", "to_ns": "1000000"}
    {"say": "curves", "number": 8, "names": ["lost"], "robot": null, "from_ns": "0", "to_ns": "1000", "step_ns": "10"}
    {"say": "region", "number": 9, "robot": 2, "from_ns": "0", "to_ns": "1000000"}

What comes next begins at ``from_ns`` or later, or before it if it is to be looked for backwards; with the lane and row
of a present box that begins there, it comes after that, or before, by (start, lane, row). A ``number`` is given back.

A window is answered by one binary message, little-endian: a header u32 1, u32 number, u32 lanes, u32 0, i64 from_ns,
i64 step_ns (of the cells: both rounded down to a power of two and a multiple of it), and for each lane, in the order of
the request, u32 lane, u32 form, u32 n, u32 0 and columns of n values, each padded to a multiple of 8 B. Form 0, boxes:
starts f64 (ns after from_ns), durations f64 (ns), rows u32, kinds u16, outcomes u8, peers i16 (-1: all, or nobody).
Form 1, cells: kinds u16 (65535: nothing there), shares u8, lost u8, counts u32. All else is answered in JSON.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Lock
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Protocol, TypeAlias

import numpy as np
from pydantic import Field

from cosim.errors import UserError
from cosim.present import Present
from cosim.settings import Settings
from cosim.timeline.assembly import lost_codes, span_of
from cosim.timeline.beside import beside
from cosim.timeline.codes import CARRIER_SENSE, CHANNEL, ORDER, PICONET, Codes
from cosim.timeline.curves import ROBOTS_ONLY, Drawn, Parts, SeriesOfRun, curves, values
from cosim.timeline.detail import Decode, Row, Tables, detail, plain
from cosim.timeline.growing import Growing, Rows
from cosim.timeline.index import Files, Index
from cosim.timeline.lanes import Array, Boxes, Lane
from cosim.timeline.levels import Cells
from cosim.timeline.queues import NO_QUEUES, Queues
from cosim.timeline.radios import LOW_ENERGY, parts_of
from cosim.timeline.region import region
from cosim.timeline.search import Place, Wanted, find
from cosim.timeline.sensing import adhoc_radios
from cosim.timeline.spectrum import areas, tallies
from cosim.timeline.window import Window, window
from cosim.trace import FRAMES, Table
from cosim.units import Time

MOST_LANES: Final = 200
"""Maximum number of lanes that a page may ask for at once."""
MOST_CELLS: Final = 8192
"""Maximum number of cells in a lane that a page may ask for."""
MOST_PARTS: Final = 2048
"""Maximum number of parts of a window for which a page may ask for curves."""
MOST_CURVES: Final = 12
"""Maximum number of curves that a page may ask for at once."""
_LATEST: Final = 1 << 62
_WINDOW: Final = 1
_HEADER: Final = struct.Struct("<IIIIqq")
_BLOCK: Final = struct.Struct("<IIII")
_BOXES, _CELLS = 0, 1
_TWICE: Final = (PICONET, CHANNEL)
"""Lanes of what other lanes have as well."""

Nanoseconds: TypeAlias = Annotated[str, Field(pattern=r"^-?[0-9]{1,18}$")]
Number: TypeAlias = Annotated[int, Field(ge=0, lt=1 << 32)]
Code: TypeAlias = Annotated[int, Field(ge=0, lt=1 << 16)]
LaneNumber: TypeAlias = Annotated[int, Field(ge=0, lt=1 << 16)]
RowNumber: TypeAlias = Annotated[int, Field(ge=0, lt=1 << 32)]


class AskWindow(Settings):
    """Ask what is in a window of time."""

    say: Literal["window"]
    number: Number
    lanes: Annotated[list[LaneNumber], Field(max_length=MOST_LANES)]
    from_ns: Nanoseconds
    to_ns: Nanoseconds
    step_ns: Nanoseconds


class AskBox(Settings):
    """Ask for all about a box."""

    say: Literal["box"]
    number: Number | None = None
    lane: LaneNumber
    row: RowNumber


class AskNext(Settings):
    """Ask for the next box of a kind, of a robot, or that is lost; ``lane`` and ``row``: the present one, if any."""

    say: Literal["find"]
    number: Number | None = None
    kind: Code | None = None
    robot: Annotated[int, Field(ge=-1, lt=1 << 31)] | None = None
    lost: bool = False
    from_ns: Nanoseconds
    back: bool = False
    lane: LaneNumber | None = None
    row: RowNumber | None = None
    lanes: Annotated[list[LaneNumber], Field(max_length=MOST_LANES)] | None = None


class AskCurves(Settings):
    """Ask for curves in parts of a window of time: those of the team, or of a robot."""

    say: Literal["curves"]
    number: Number
    names: Annotated[list[Annotated[str, Field(max_length=100)]], Field(max_length=MOST_CURVES)]
    robot: Annotated[int, Field(ge=0, lt=1 << 31)] | None = None
    from_ns: Nanoseconds
    to_ns: Nanoseconds
    step_ns: Nanoseconds


class AskRegion(Settings):
    """Ask for sums of what lies in a part of time, of one robot or of all."""

    say: Literal["region"]
    number: Number
    robot: Annotated[int, Field(ge=-1, lt=1 << 31)] | None = None
    from_ns: Nanoseconds
    to_ns: Nanoseconds


class AskChannels(Settings):
    """Ask what is left out, jammed and lost in a window of time; of hop sets, those of a robot's piconets."""

    say: Literal["channels"]
    number: Number
    robot: Annotated[int, Field(ge=0, lt=1 << 31)] | None = None
    from_ns: Nanoseconds
    to_ns: Nanoseconds


Question: TypeAlias = AskWindow | AskBox | AskNext | AskCurves | AskChannels | AskRegion
"""What a page may ask a timeline."""
Known: TypeAlias = tuple[int, ...]
"""What a page knows: the numbers of lanes, kinds, outcomes, forgotten rows and metrics, and if there are queues."""


class Timeline(Protocol):
    """What pages ask for the boxes of a session, from any thread."""

    def told(self, known: Known | None) -> tuple[Row | None, Known]:
        """Return the message ``lanes`` for a page that knows *known*, if anything is new, and what it knows then."""

    def answer(self, question: Question) -> bytes | Row:
        """Answer a page; raise UserError, one line, for what cannot be asked."""


class Answers:
    """Answers about lanes that do not change meanwhile."""

    def __init__(self, drawn: Drawn, tables: Tables, decode: Decode | None = None) -> None:
        self._lanes, codes = drawn.lanes, drawn.codes
        self._drawn = drawn
        self._lost = lost_codes(codes)
        self._tables = tables
        self._decode = decode

    def answer(self, question: Question) -> bytes | Row:
        """Answer a page; raise UserError, one line, for what cannot be asked."""
        match question:
            case AskWindow():
                return self._window(question)
            case AskBox():
                return self._box(question)
            case AskCurves():
                return self._curves(question)
            case AskRegion():
                return self._region(question)
            case AskChannels():
                return self._channels(question)
            case _:
                return self._next(question)

    def _window(self, asked: AskWindow) -> bytes:
        start, end, step = int(asked.from_ns), int(asked.to_ns), int(asked.step_ns)
        if step < 1 or end < start:
            raise UserError("window: expected from_ns <= to_ns and a step_ns of at least 1")
        if (end - start) // (1 << (step.bit_length() - 1)) > MOST_CELLS:
            raise UserError(f"window: step_ns makes more than {MOST_CELLS} cells")
        lanes = [self._lane(number) for number in asked.lanes]
        return packed(asked.number, asked.lanes, window(lanes, start, end, step, self._lost))

    def _box(self, asked: AskBox) -> Row:
        lane = self._lane(asked.lane)
        nearby = partial(beside, self._lanes, self._drawn.codes, self._tables)
        about = detail(self._tables, lane, asked.row, self._decode, nearby)
        start = next(iter(about["fields"].values()))  # the first column is a row's time
        if lane.named.what in CARRIER_SENSE:  # whose boxes begin when a frame has come, or has ended
            start = lane.start_of(asked.row) or start
        for name in ("fields", "transmission"):
            about[name] = about[name] and plain(about[name])
        about["receptions"] = [plain(each) for each in about["receptions"]]
        return {"say": "box"} | self._shown(Place(start, asked.lane, asked.row)) | about | _numbered(asked)

    def _curves(self, asked: AskCurves) -> Row:
        start, end, step = int(asked.from_ns), int(asked.to_ns), int(asked.step_ns)
        if step < 1 or not start < end <= start + MOST_PARTS * step:
            raise UserError(f"curves: expected from_ns < to_ns, and a step_ns that makes at most {MOST_PARTS} parts")
        parts = Parts(start, step, -(-(end - start) // step))
        told = []
        for name in asked.names:
            found = values(name, self._drawn, parts, asked.robot)
            if found is not None:
                told.append({"name": name} | {key: _numbers(column) for key, column in found._asdict().items()})
        words = {"from_ns": str(start), "step_ns": str(step), "robot": asked.robot}
        return {"say": "curves", "number": asked.number} | words | {"curves": told}

    def _region(self, asked: AskRegion) -> Row:
        start, end = int(asked.from_ns), int(asked.to_ns)
        if end <= start:
            raise UserError("region: expected from_ns < to_ns")
        found = region(self._drawn.of(asked.robot), start, end, self._lost)
        in_order = sorted(found.sums.items(), key=lambda item: (ORDER.index(item[0][0]), item[0][1]))
        sums = [
            {"what": what, "kind": kind, "count": each.number, "lost": each.lost, "time_ns": str(each.time)}
            for (what, kind), each in in_order
        ]
        asked_for = {"number": asked.number, "robot": asked.robot, "from_ns": str(start), "to_ns": str(end)}
        spans = {"first": found.first, "last": found.last}
        ends = {name: span and [str(time) for time in span] for name, span in spans.items()}
        received_bytes = self._tables.total(FRAMES.name, "length", found.received)
        return {"say": "region", **asked_for, "sums": sums, **ends, "received_bytes": received_bytes}

    def _channels(self, asked: AskChannels) -> Row:
        window = int(asked.from_ns), int(asked.to_ns)
        if window[1] < window[0]:
            raise UserError("channels: expected from_ns <= to_ns")
        found, more = areas(self._lanes, self._drawn.codes, self._tables, window, asked.robot)
        told = [
            {"what": each.what, "robot": each.robot, "start_ns": str(each.start), "end_ns": str(each.end)}
            | {"channels": each.channels}
            for each in found
        ]
        counted = [list(each) for each in tallies(self._lanes, self._lost, window)]
        about: Row = {"number": asked.number, "robot": asked.robot, "areas": told, "more": more, "channels": counted}
        return {"say": "channels"} | about

    def _next(self, asked: AskNext) -> Row:
        wanted = Wanted(asked.kind, asked.robot, asked.lost)
        present = None if asked.lane is None or asked.row is None else (asked.lane, asked.row)
        if asked.lanes is None:
            lanes = [(number, lane) for number, lane in enumerate(self._lanes) if lane.named.what not in _TWICE]
        else:
            lanes = [(number, self._lane(number)) for number in sorted(set(asked.lanes))]
        found = find(lanes, wanted, int(asked.from_ns), asked.back, self._lost, present)
        place: Row = {"lane": None, "row": None} if found is None else self._shown(found)
        return {"say": "found"} | place | _numbered(asked)

    def _shown(self, place: Place) -> Row:
        """Return what a lane shows of the box at *place*."""
        lane = self._lane(place.lane)
        boxes = lane.within(place.start, place.start + 1)
        at = np.flatnonzero((boxes.starts == place.start) & (boxes.rows == place.row)).tolist()
        if not at:
            raise UserError(f"lane {place.lane}: there is no box of row {place.row}")
        box = boxes.taken(at[0])
        named = lane.named
        return {
            "lane": place.lane,
            "row": place.row,
            "robot": named.robot,
            "radio": named.radio,
            "what": named.what,
            "start_ns": str(box.starts),
            "end_ns": str(box.ends),
            "kind": int(box.kinds),
            "outcome": int(box.outcomes),
            "peer": int(box.peers),
        }

    def _lane(self, number: int) -> Lane:
        if number >= len(self._lanes):
            raise UserError(f"there is no lane {number}: expected 0 to {len(self._lanes) - 1}")
        return self._lanes[number]


class Kept:
    """The timeline of a recorded run."""

    def __init__(
        self,
        index: Index,
        folder: Path,
        decode: Decode | None = None,
        series: SeriesOfRun = MappingProxyType({}),
        queues: Queues = NO_QUEUES,
        robots: int = ROBOTS_ONLY,
    ) -> None:
        """*robots*: how many there are, stations in the background not counted."""
        self.index = index
        drawn = Drawn(index.lanes, index.codes, series, queues, robots)
        self._answers = Answers(drawn, Files(folder), decode)
        self._message = lanes_message(drawn, *span_of(index.lanes))
        self._lock = Lock()

    def told(self, known: Known | None) -> tuple[Row | None, Known]:
        """Return the message ``lanes`` for a page that has not been sent it."""
        return (self._message, ()) if known is None else (None, known)

    def answer(self, question: Question) -> bytes | Row:
        """Answer a page; raise UserError, one line, for what cannot be asked."""
        with self._lock:  # files of tables are no thing for two threads
            return self._answers.answer(question)


class Grown:
    """The timeline of a run that is under way: one thread adds to it, others ask."""

    def __init__(
        self,
        tables: Iterable[Table],
        decode: Decode | None = None,
        channel: Any = None,
        robots: int = ROBOTS_ONLY,
    ) -> None:
        """*channel*: that of the scenario, as plain data; *robots*: how many there are, stations not counted."""
        self._growing = Growing(tables, radios=adhoc_radios(channel), low_energy=parts_of(channel, LOW_ENERGY))
        self._decode = decode
        self._robots = robots
        self._lock = Lock()

    def take(self, new: Mapping[str, Rows], present: Present) -> None:
        """Add the *new* rows of tables, by name, and show what has begun and is not over at *present*."""
        with self._lock:
            self._growing.take(new, present)

    def told(self, known: Known | None) -> tuple[Row | None, Known]:
        """Return the message ``lanes`` if there are others than a page knows."""
        with self._lock:
            growing, drawn = self._growing, self._drawn
            lanes, codes = drawn.lanes, drawn.codes
            counts = len(lanes), len(codes.kinds), len(codes.outcomes)
            news = *counts, growing.forgotten, len(drawn.series), int(bool(drawn.queues))
            if news == known:
                return None, known
            first = span_of(lanes)[0] if growing.forgotten else 0
            return lanes_message(drawn, first, growing.now, growing.forgotten), news

    def answer(self, question: Question) -> bytes | Row:
        """Answer a page; raise UserError, one line, for what cannot be asked."""
        with self._lock:
            return Answers(self._drawn, self._growing, self._decode).answer(question)

    @property
    def _drawn(self) -> Drawn:
        growing = self._growing
        return Drawn(growing.lanes, growing.codes, growing.series, growing.queues, self._robots)


def _numbered(asked: AskBox | AskNext) -> Row:
    return {} if asked.number is None else {"number": asked.number}


def _numbers(column: Array | None) -> list[float | None] | None:
    """Return a column of a curve as plain data, None for what it has not."""
    return None if column is None else [None if value != value else value for value in column.tolist()]


def lanes_message(drawn: Drawn, first: Time, last: Time, forgotten: int = 0) -> Row:
    """Return the message ``lanes``: what lanes, kinds, outcomes and curves there are, lanes from top to bottom."""
    lanes = drawn.lanes
    numbers = sorted(range(len(lanes)), key=lambda number: lanes[number].named.place)
    told = [
        {
            "lane": number,
            "robot": named.robot,
            "radio": named.radio,
            "what": named.what,
            "stacked": named.row,
            "name": named.called(drawn.robots),
            "channel": named.channel,
        }
        for number in numbers
        for named in (lanes[number].named,)
    ]
    there = [each._asdict() for each in curves(drawn)]
    span: Row = {"curves": there, "peers": True, "first_ns": str(first), "last_ns": str(last), "forgotten": forgotten}
    return {"say": "lanes", "lanes": told} | drawn.codes.plain | span


def packed(number: int, lanes: Sequence[int], answer: Window) -> bytes:
    """Return the binary message of *answer* to the request *number* about *lanes*."""
    parts = [_HEADER.pack(_WINDOW, number, len(lanes), 0, answer.start, answer.step)]
    for lane, part in zip(lanes, answer.parts, strict=True):
        if isinstance(part, Boxes):
            columns = [
                (part.starts - answer.start).astype("<f8"),
                (part.ends - part.starts).astype("<f8"),
                part.rows.astype("<u4"),
                part.kinds.astype("<u2"),
                part.outcomes.astype("u1"),
                part.peers.astype("<i2"),
            ]
        else:
            columns = [part.codes.astype("<u2"), part.shares, part.lost, part.counts.astype("<u4")]
        parts.append(_BLOCK.pack(lane, _CELLS if isinstance(part, Cells) else _BOXES, len(columns[0]), 0))
        for column in columns:
            data = column.tobytes()
            parts += (data, bytes(-len(data) % 8))
    return b"".join(parts)


NO_TIMELINE: Final = Kept(Index([], Codes()), Path())
"""The timeline of a session that has none."""
