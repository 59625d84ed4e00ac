"""The lanes of a run that is under way: rows are added as they come, and the oldest are forgotten if there are many.

Rows come late: a frame's when it ends, an interval's when it is over, or when a model that has run ahead tells of it.
Each is put where it belongs by its start. What is under way has boxes too, which end at the present. What 802.11
stations sense follows from frames that are over.
"""

from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.base import Flying
from cosim.errors import UserError
from cosim.intervals import Interval, master_of, partner
from cosim.present import Present
from cosim.timeline.assembly import OF_SENDERS, TABLE_OF, lost_codes
from cosim.timeline.codes import CHANNEL, FRAME, PICONET, STATE, Codes
from cosim.timeline.curves import SeriesOfRun, series_of
from cosim.timeline.detail import Row
from cosim.timeline.lanes import DTYPES, Array, Boxes, Lane, no_boxes
from cosim.timeline.levels import levels_of
from cosim.timeline.queues import Queues
from cosim.timeline.rows import RADIO, SOURCES, Maker, all_of, columns_of, distinct, lane_name
from cosim.timeline.sensing import SENSED_FROM, Sensing
from cosim.trace import FRAMES, INTERVALS, METRICS, PAYLOADS, TRANSMISSIONS, Field, Table
from cosim.units import S, Time

MOST_ROWS: Final = 2_000_000
"""Rows of all tables that are kept: beyond, a quarter of them is forgotten, the oldest ones."""
_UNSUMMED: Final = 1 << 14
"""Boxes of a lane, and beyond them an eighth of all, that may be in no level."""
_OPEN: Final = (1 << 32) - (1 << 16)
"""The numbers of rows of intervals that are under way begin here,"""
_FLYING: Final = (1 << 32) - (1 << 15)
"""and those of frames on the air here."""

_WAITED: Final[Time] = 10 * S
"""Time after which the transmission of a lost frame is not waited for any more, ns."""

Rows = Sequence[tuple[Any, ...]]
_NO_RADIOS: Final[Mapping[int, AdhocSettings]] = {}


class Columns:
    """The latest rows of a table, numbered from the first one that ever was."""

    def __init__(self, table: Table) -> None:
        self.names = tuple(each.name for each in table.fields)
        self.first = 0
        """Number of the oldest row that is kept."""
        self._columns = [_column(each) for each in table.fields]

    def __len__(self) -> int:
        return len(self._columns[0])

    def extend(self, rows: Rows) -> None:
        """Add *rows*."""
        for column, values in zip(self._columns, zip(*rows, strict=True), strict=True):
            column.extend(values)

    def total(self, name: str, rows: Array) -> int:
        """Return the sum of the column *name*, of whole numbers, over the *rows* of these numbers that are kept."""
        there = rows[rows >= self.first].astype(np.int64) - self.first
        column = np.array(self._columns[self.names.index(name)], dtype=np.int64)
        return int(column[there].sum())

    def forget(self, count: int) -> None:
        """Forget the oldest *count* rows."""
        for column in self._columns:
            del column[:count]
        self.first += count

    def row(self, number: int) -> Row | None:
        """Return the row of that *number*; None if there is none, or not any more."""
        at = number - self.first
        if not 0 <= at < len(self):
            return None
        return dict(zip(self.names, (column[at] for column in self._columns), strict=True))

    @property
    def columns(self) -> dict[str, Any]:
        """The rows that are kept, by column."""
        return dict(zip(self.names, self._columns, strict=True))

    def at(self, time: Time) -> list[Row]:
        """Return the rows of that *time*."""
        found = np.flatnonzero(np.frombuffer(self._columns[0], dtype=np.int64) == time).tolist() if len(self) else []
        return [row for number in found if (row := self.row(self.first + number)) is not None]


def _column(about: Field) -> Any:
    codes = {"int": "q", "float": "d"}
    return array(codes[about.kind]) if about.kind in codes and not about.optional else []


@dataclass
class GrowingLane(Lane):
    """A lane to which boxes are added."""

    disjoint: bool = True
    _room: Boxes = field(default_factory=no_boxes)

    def add(self, new: Boxes) -> None:
        """Put boxes where they belong; they are given by row, and have greater numbers than those that are there."""
        count = len(self.boxes.starts)
        least = int(new.starts.min())
        cut = count
        if count and least <= int(self.boxes.starts[-1]):
            cut = int(np.searchsorted(self.boxes.starts, least, side="left"))
        late = Boxes(*(np.concatenate(pair) for pair in zip(self.boxes.taken(slice(cut, count)), new, strict=True)))
        late = late.taken(np.argsort(late.starts, kind="stable"))
        if self.named.what in OF_SENDERS and self.table == FRAMES.name:
            late = distinct(late, self.named.what)
        self._replace_from(cut, late)
        self.longest = max(self.longest, int((new.ends - new.starts).max()))
        before = max(0, cut - 1)
        self.disjoint &= bool((self.boxes.starts[before + 1 :] >= self.boxes.ends[before:-1]).all())

    def renew(self, since: Time, new: Boxes) -> None:
        """Hold *new* boxes from *since* on; the first goes on with that which is held until then, if one is.

        Of this lane no two boxes overlap or touch, and none of the new ones begins before *since*.
        """
        cut = int(np.searchsorted(self.boxes.starts, since, side="left"))
        if cut and int(self.boxes.ends[cut - 1]) >= since and int(new.starts[0]) == since:
            cut -= 1
            for column, held in zip(new, self.boxes.taken(cut), strict=True):
                if column is not new.ends:
                    column[0] = held
        self._replace_from(cut, new)
        self.longest = max(self.longest, int((new.ends - new.starts).max()))

    def _replace_from(self, cut: int, late: Boxes) -> None:
        if self.levels is not None and cut < self.levels.summed:
            self.levels = None
        count = cut + len(late.starts)
        if count > len(self._room.starts):
            size = max(64, 2 * count)
            room = Boxes(*(np.zeros(size, dtype=dtype) for dtype in DTYPES))
            for column, old in zip(room, self.boxes, strict=True):
                column[:cut] = old[:cut]
            self._room = room
        for column, values in zip(self._room, late, strict=True):
            column[cut:count] = values
        self.boxes = self._room.taken(slice(0, count))

    def forget(self, first: int) -> None:
        """Forget the boxes of rows before number *first*."""
        kept = self.boxes.taken(self.boxes.rows >= first)
        self._room, self.boxes, self.levels = no_boxes(), no_boxes(), None
        self._replace_from(0, kept)

    def unsum(self, time: Time) -> None:
        """Forget the levels if they are about a box that begins at *time* or later."""
        if self.levels is not None and int(self.boxes.starts[self.levels.summed - 1]) >= time:
            self.levels = None

    def show(self, box: tuple[int, ...]) -> None:
        """Have a box that has not ended, too."""
        more = Boxes(*(np.array([value], dtype=dtype) for value, dtype in zip(box, DTYPES, strict=True)))
        self.under_way = Boxes(*(np.concatenate(pair) for pair in zip(self.under_way, more, strict=True)))

    def sum_up(self, codes: Codes) -> None:
        """Make levels anew if there are many boxes that are in none."""
        count = len(self.boxes.starts)
        summed = 0 if self.levels is None else self.levels.summed
        if count - summed > _UNSUMMED + count // 8:
            self.levels = levels_of(self.boxes.taken(slice(0, count - count // 32)), lost_codes(codes))


class Growing:
    """The lanes of a run that is under way, and the latest rows of its tables."""

    def __init__(
        self,
        tables: Iterable[Table],
        most: int = MOST_ROWS,
        radios: Mapping[int, AdhocSettings] = _NO_RADIOS,
        low_energy: Collection[int] = (),
    ) -> None:
        """Keep at most so many rows.

        *radios*: the settings of the 802.11 radios, by number; *low_energy*: the numbers of those of Low Energy.
        """
        self.lanes: list[GrowingLane] = []
        self.codes = Codes()
        self.now: Time = 0
        self.forgotten = 0
        """Number of rows that are not kept any more."""
        self._tables = {table.name: Columns(table) for table in tables}
        self._several = any(RADIO in table.names for name, table in self._tables.items() if name != INTERVALS.name)
        self._most = most
        self._maker = Maker(self.codes, late=True, low_energy=low_energy)
        self._numbers: dict[tuple[str, tuple[int, int, int]], int] = {}
        self._open: list[Interval] = []
        self._flying: list[Flying] = []
        self._held: Rows = ()
        self._sensing = Sensing(radios, self.codes, self._several)
        self._series: SeriesOfRun = {}
        self._series_of = 0, 0
        """First row and number of the rows that the series are of."""

    def take(self, new: Mapping[str, Rows], present: Present) -> None:
        """Add the *new* rows of tables, by name, and show what has begun and is not over at *present*."""
        self.now = present.now
        self._held = present.held
        for name in (*SOURCES, *(name for name in new if name not in SOURCES)):
            if new.get(name) and name in self._tables:
                self._add(name, new[name])
        self._mark_losses()
        for named, since, boxes in self._sensing.news():
            lane = self._lane(named.what, (named.robot, named.radio, 0))
            lane.renew(since, boxes)
            lane.sum_up(self.codes)
        self._show(present.under_way)
        self._show_flying(present.flying)
        if sum(map(len, self._tables.values())) > self._most:
            self._forget()

    def row(self, table: str, number: int) -> Row:
        """Return the row of *table* with that *number*; raise UserError if it is not kept."""
        if table == INTERVALS.name and 0 <= number - _OPEN < len(self._open):
            return dict(zip((each.name for each in INTERVALS.fields), self._open[number - _OPEN], strict=True))
        if table != INTERVALS.name and 0 <= number - _FLYING < len(self._flying):
            return _row_of(self._flying[number - _FLYING])
        row = self._tables[table].row(number) if table in self._tables else None
        if row is None:
            raise UserError(f"{table}: there is no row {number}, or not any more")
        return row

    @property
    def series(self) -> SeriesOfRun:
        """Metrics over time."""
        table = self._tables.get(METRICS.name)
        if table is not None and self._series_of != (table.first, len(table)):
            self._series_of = table.first, len(table)
            self._series = series_of(table.columns)
        return self._series

    @property
    def queues(self) -> Queues:
        """What radios hold."""
        table = self._tables.get(PAYLOADS.name)
        return Queues({} if table is None else table.columns, self._held)

    def at(self, table: str, time: Time) -> list[Row]:
        """Return the rows of *table* of that *time*."""
        return self._tables[table].at(time) if table in self._tables else []

    def total(self, table: str, name: str, rows: Array) -> int:
        """Return the sum of the column *name* of *table*, of whole numbers, over the *rows* of these numbers."""
        return self._tables[table].total(name, rows) if table in self._tables else 0

    def _add(self, name: str, rows: Rows) -> None:
        table = self._tables[name]
        first = table.first + len(table)
        table.extend(rows)
        columns = dict(zip(table.names, zip(*rows, strict=True), strict=True))
        if name in SENSED_FROM:
            self._sensing.take(name, columns, first)
        if name not in SOURCES:
            return
        details = None
        if name == INTERVALS.name:
            details = [_identity(Interval(*row)) for row in rows]
        for made in self._maker.made(name, columns_of(name, columns), first, details):
            for key, boxes in made.by_lane():
                lane = self._lane(made.what, key)
                if made.what in OF_SENDERS and name != lane.table:  # its transmissions are told after all
                    lane.table = name
                    lane.forget(1 << 32)
                lane.add(boxes)
                lane.sum_up(self.codes)

    def _mark_losses(self) -> None:
        """Have the lanes of senders show what receivers have lost; keep for later what they do not show yet."""
        lost = all_of(self._maker.losses)
        self._maker.losses.clear()
        waits = np.ones(len(lost.times), dtype=bool)
        if not len(lost.times):
            return
        for (what, key), number in self._numbers.items():
            lane = self.lanes[number]
            if what in OF_SENDERS and lane.table != FRAMES.name:
                here = lost.shown(what, key)
                there = lost.taken(here).mark(lane.boxes, what)
                if what == "sent":
                    waits[here] = ~there
                if lane.levels is not None and there.any():
                    lane.unsum(int(lost.times[here].min()))
        waits &= lost.times > self.now - _WAITED
        if waits.any():
            self._maker.losses.append(lost.taken(waits))

    def _lane(self, what: str, key: tuple[int, int, int]) -> GrowingLane:
        if (what, key) not in self._numbers:
            self._numbers[what, key] = len(self.lanes)
            of_frames = what in OF_SENDERS and key[1] not in self._maker.sending
            table = FRAMES.name if of_frames else TABLE_OF[what]
            self.lanes.append(GrowingLane(lane_name(what, key, self._several), table, no_boxes()))
        return self.lanes[self._numbers[what, key]]

    def _show(self, under_way: Sequence[Interval]) -> None:
        """Have the lanes show the intervals *under_way*."""
        for lane in self.lanes:
            if len(lane.under_way.starts):
                lane.under_way = no_boxes()
        self._open = sorted(under_way)
        for at, each in enumerate(self._open):
            key = each.robot, each.radio
            which = self._maker.stacks.hold(_identity(each), key, each.start)
            kind = self.codes.kind(STATE, each.state)
            box = each.start, max(self.now, each.start), kind, 0, _OPEN + at
            self._lane("states", (*key, which)).show((*box, partner(each.state, each.detail)))
            master = master_of(each.state, each.detail)
            if master >= 0:
                self._lane(PICONET, (master, each.radio, each.robot)).show((*box, each.robot))

    def _show_flying(self, flying: Sequence[Flying]) -> None:
        """Have the lanes of senders and channels show the frames that are *flying*, if no rows have told of them."""
        self._flying = [each for each in flying if not each.told]
        for at, each in enumerate(self._flying):
            kind = self.codes.kind(FRAME, each.kind)
            box = each.start, max(self.now, each.start), kind, 0, _FLYING + at
            self._lane("sent", (each.source, each.radio, 0)).show((*box, each.destination))
            if each.channel >= 0:
                self._lane(CHANNEL, (-1, each.radio, each.channel)).show((*box, each.source))

    def _forget(self) -> None:
        """Forget a quarter of the rows of each table, and their boxes."""
        for table in self._tables.values():
            count = len(table) // 4
            table.forget(count)
            self.forgotten += count
        for lane in self.lanes:
            lane.forget(self._tables[lane.table].first)
            lane.sum_up(self.codes)


def _row_of(flying: Flying) -> Row:
    """Return what is known of a frame's row of the table ``transmissions``."""
    row: Row = {each.name: None for each in TRANSMISSIONS.fields} | {"body": "", "routed": False}
    row |= {name: getattr(flying, name) for name in ("source", "kind", "destination", "channel", "lt_addr", "length")}
    return row | {"time_ns": flying.start, "duration_ns": flying.end - flying.start, "radio": flying.radio}


def _identity(interval: Interval) -> tuple[Any, ...]:
    """Return what an interval is known by before and after its end; first its robot and radio."""
    return interval.robot, interval.radio, interval.start, interval.state, interval.detail
