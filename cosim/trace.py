"""Records of a run: typed columns in memory, one schema for each table, Parquet on disk, and a digest of the content.

Here stand cosim's own tables; a protocol's event types are dataclasses beside its code and share the table ``events``.
A row costs one append per column; of what is written of every frame (``put``), one append in all. The digest sorts by
(time, table, source, sequence), where the sequence numbers the rows of one source in one table: the order in which
different sources were written has no meaning.

pyarrow is imported by who reads or writes a file: a run that keeps no tables does without.
"""

import dataclasses
import hashlib
import os
import sys
from array import array
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate, repeat
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias, get_type_hints

from cosim.errors import LocalProtocolError, UserError
from cosim.units import to_seconds

Kind: TypeAlias = Literal["int", "float", "str", "bool"]

ARROW: Final[dict[str, str]] = {"int": "int64", "float": "float64", "str": "string", "bool": "bool"}
_ARRAY_CODES: Final[dict[Kind, str]] = {"int": "q", "float": "d"}
_KIND_OF_TYPE: Final[dict[Any, Kind]] = {int: "int", float: "float", str: "str", bool: "bool"}


class Field(NamedTuple):
    """One column: its name, type, unit (empty where there is none) and meaning."""

    name: str
    kind: Kind
    unit: str
    meaning: str
    optional: bool = False


class Table(NamedTuple):
    """A table's name, meaning and columns; the first two are the time of a row and the robot that it is about."""

    name: str
    meaning: str
    fields: tuple[Field, ...]
    types: tuple[type, ...] = ()
    """The types of the events whose rows it takes."""


_TIME = Field("time_ns", "int", "ns", "simulated time")
_SOURCE = Field("source", "int", "", "address of the robot that the row is about")
_AIR_TIME = Field("duration_ns", "int", "ns", "air time")
_CHANNEL = Field("channel", "int", "", "RF channel k, 2402 + k MHz; -1 where a channel has none")
_LT_ADDR = Field("lt_addr", "int", "", "logical transport address; 0 for broadcasts and outside of a piconet")
_LENGTH = Field("length", "int", "B", "user payload")

POSES: Final = Table(
    "poses",
    "where the robots are, a row a robot and world tick",
    (
        _TIME,
        _SOURCE,
        Field("x_m", "float", "m", "position, world frame"),
        Field("y_m", "float", "m", "position, world frame"),
        Field("heading_rad", "float", "rad", "heading, counter-clockwise from the x axis"),
    ),
)
FRAMES: Final = Table(
    "frames",
    "frames on the air, a row a frame and receiver that it was meant for",
    (
        Field("time_ns", "int", "ns", "start of the frame"),
        Field("source", "int", "", "transmitter"),
        Field("destination", "int", "", "receiver; -1 for all"),
        _AIR_TIME,
        Field("kind", "str", "", "packet type"),
        _CHANNEL,
        _LT_ADDR,
        _LENGTH,
        Field("outcome", "str", "", "what became of it at the receiver"),
        Field("part", "str", "", "the part that failed first: access_code, header or payload; empty if none did"),
    ),
)
TRANSMISSIONS: Final = Table(
    "transmissions",
    "frames on the air, a row a frame, whoever hears it",
    (
        Field("time_ns", "int", "ns", "start of the frame"),
        Field("source", "int", "", "transmitter"),
        Field("kind", "str", "", "packet type"),
        Field("destination", "int", "", "receiver; -1 for all"),
        Field("reserves_ns", "int", "ns", "802.11: from its end on, for so long the others are to be silent"),
        Field("number", "int", "", "802.11: sequence number of the DATA that it is about"),
        Field("retry", "bool", "", "whether its payload has been on the air before"),
        Field("routed", "bool", "", "802.11: whether its body is a router's IPv4 packet, not a payload as it is"),
        Field("whole", "bool", "", "whether its sender was on to its end"),
        Field("body", "str", "", "what it carries, hexadecimal"),
        _AIR_TIME,
        _CHANNEL,
        _LT_ADDR,
        _LENGTH,
    ),
)
RECEPTIONS: Final = Table(
    "receptions",
    "what became of a transmission at a robot, a row for each that it was meant for, and each other that it disturbed "
    "or informed; of what a robot sends at one instant over an ideal or optical channel in the order of transmissions, "
    "if there is no jitter",
    (
        Field("time_ns", "int", "ns", "start of the frame"),
        Field("source", "int", "", "transmitter"),
        Field("receiver", "int", "", "the robot that may have heard it"),
        Field("power_dbm", "float", "dBm", "power that arrived; empty where a channel knows none", optional=True),
        Field("sinr_db", "float", "dB", "least ratio to noise and interference; empty where none", optional=True),
        Field("outcome", "str", "", "what became of it there, as in frames"),
        Field("part", "str", "", "the part that failed first: access_code, header or payload; empty if none did"),
    ),
)
INTERVALS: Final = Table(
    "intervals",
    "what robots and their radios were doing, a row an interval; a robot may be in several at a time",
    (
        Field("start_ns", "int", "ns", "simulated time at which it began"),
        Field("robot", "int", "", "address of the robot; -1 for a jammer or a wall of loss"),
        Field("end_ns", "int", "ns", "simulated time at which it was over, or the run"),
        Field("radio", "int", "", "which of its radios; -1 for the robot itself, and where the robot is -1"),
        Field("state", "str", "", "what it was doing, as listed below"),
        Field("detail", "str", "", "more about it, as words name=value"),
    ),
)
UNSENT: Final = Table(
    "unsent",
    "payloads that were never on the air, for the sender's device has not taken them",
    (
        Field("time_ns", "int", "ns", "when that was clear"),
        Field("source", "int", "", "sender"),
        Field("destination", "int", "", "receiver; -1 for all"),
        Field("length", "int", "B", "payload"),
        Field("outcome", "str", "", "why: no_link, no_route, too_long or queue_full"),
    ),
)
PAYLOADS: Final = Table(
    "payloads",
    "payloads that radios have accepted and not refused at once, a row for each when it is over; where there are "
    "routers, the packets that they hand to their radios",
    (
        Field("time_ns", "int", "ns", "when the channel accepted it"),
        Field("source", "int", "", "whose radio holds it"),
        Field("destination", "int", "", "receiver, or next hop; -1 for all"),
        _LENGTH,
        Field("begun_ns", "int", "ns", "start of the first frame that carries it; -1 if it was never on the air"),
        Field("end_ns", "int", "ns", "when the radio held it no more, or the end of the run"),
        Field("outcome", "str", "", "as of Fate in cosim.machine; off: switched off; held: the run was over before"),
    ),
)
MESSAGES: Final = Table(
    "messages",
    "payloads that arrived at a machine",
    (
        Field("time_ns", "int", "ns", "arrival"),
        Field("source", "int", "", "receiver"),
        Field("sender", "int", "", "who has sent it, however many hops of a router away; -2: the operator"),
        Field("broadcast", "bool", "", "sent to everyone"),
        Field("payload", "str", "", "the bytes, hexadecimal"),
    ),
)
WAKES: Final = Table(
    "wakes",
    "wakes of machines, a row for each deadline that a machine had set itself and that has come",
    (_TIME, _SOURCE),
)
LINKS: Final = Table(
    "links",
    "news of links and of payloads that reached machines, a row for each",
    (
        _TIME,
        _SOURCE,
        Field("event", "str", "", "Discovered, InquiryComplete, Connected, PageFailed, Lost, ... as in cosim.machine"),
        Field("peer", "int", "", "the robot at the other end; -1 where it is about none"),
        Field("detail", "str", "", "the role, the mode, or what became of the payload; then radio= of any radio but 0"),
    ),
)
_OF_RADIO: Final = "radio="


def link_detail(said: str, radio: int) -> str:
    """Return the detail of a row of ``links`` that says *said* about a link of *radio*.

    The first radio is not named: so the table is the same for any number of radios, and for runs of before there were
    links by others.
    """
    return f"{said} {_OF_RADIO}{radio}".lstrip() if radio else said


def link_told(detail: str) -> tuple[str, int]:
    """Return what a row of ``links`` with this *detail* says, and of which radio: what ``link_detail`` was given."""
    said, named, radio = detail.rpartition(_OF_RADIO)
    return (said.rstrip(), int(radio)) if named else (detail, 0)


METRICS: Final = Table(
    "metrics",
    "what metrics of the run would be if it ended then, a row for each that has changed, at most once a second",
    (
        _TIME,
        Field("source", "int", "", "the robot that it is about; -1 for the team"),
        Field("metric", "str", "", "its name: one that the protocol's referee counts over time, or battery_j"),
        Field("value", "float", "", "its value from then on, in its unit; NaN where it is not defined"),
        Field("unit", "str", "", "the unit; 1 is a plain number"),
    ),
)
ENERGY: Final = Table(
    "energy",
    "what robots have used in the run, a row for each thing that a radio has done, if channel.energy asks for it, and "
    "two rows for the battery of a robot that has one",
    (
        Field("time_ns", "int", "ns", "end of the run"),
        _SOURCE,
        Field("radio", "int", "", "which of its radios; -1 for the robot itself"),
        Field("state", "str", "", "off, sleep, idle, receive or transmit; of the robot host or drive"),
        Field("phy", "str", "", "the PHY that it has done that on, where there are several"),
        Field("time_s", "float", "s", "how long, to the nanosecond; empty for host and drive", optional=True),
        Field("energy_j", "float", "J", "what that has used; empty if no part is named", optional=True),
    ),
)
CALLS: Final = Table(
    "calls",
    "calls from room to room, as a robot's layers made them",
    (
        _TIME,
        _SOURCE,
        Field("depth", "int", "", "nesting depth, 0 at the top"),
        Field("room", "str", "", "the layer that is called"),
        Field("call", "str", "", "the service that is called"),
        Field("detail", "str", "", "arguments and result, for people"),
    ),
)
MAPS: Final = Table(
    "maps",
    "maps that machines have made, a row for each tick at which one has changed: the cells that have; a cell is the "
    "number row * columns + column, and those that follow each other are ranges: 3-7,9",
    (
        _TIME,
        Field("source", "int", "", "whose map it is; -1 for the one that all robots have in common"),
        Field("corner_x_m", "float", "m", "lower left corner of cell 0, world frame"),
        Field("corner_y_m", "float", "m", "lower left corner of cell 0, world frame"),
        Field("turn_rad", "float", "rad", "angle by which its rows are turned against the x axis, counter-clockwise"),
        Field("cell_m", "float", "m", "side of a cell"),
        Field("columns", "int", "", "number of columns"),
        Field("rows", "int", "", "number of rows, the first is the lowest"),
        Field("unknown", "str", "", "cells of which nothing is known any more"),
        Field("empty", "str", "", "cells that are taken for empty from now on"),
        Field("occupied", "str", "", "cells that are taken for occupied from now on"),
    ),
)
WAYS: Final = Table(
    "ways",
    "where robots mean to go, a row for each tick at which that has changed",
    (
        _TIME,
        _SOURCE,
        Field("points", "str", "m", "x y, x y, ... of the path that it follows from there on, world frame; or nothing"),
        Field("goal_x_m", "float", "m", "where it wants to get to, world frame; empty if nowhere known", optional=True),
        Field("goal_y_m", "float", "m", "where it wants to get to, world frame; empty if nowhere known", optional=True),
    ),
)
_COVARIANCE = "covariance of the place, world frame; empty if none is known"
ESTIMATES: Final = Table(
    "estimates",
    "where robots take themselves to be, a row a robot and tick, if they are not told where they are",
    (
        _TIME,
        _SOURCE,
        Field("origin", "str", "", "odometry, what the body senses; or machine, what a filter makes of that and scans"),
        Field("x_m", "float", "m", "position, world frame"),
        Field("y_m", "float", "m", "position, world frame"),
        Field("heading_rad", "float", "rad", "heading, counter-clockwise from the x axis"),
        Field("xx_m2", "float", "m^2", _COVARIANCE, optional=True),
        Field("xy_m2", "float", "m^2", _COVARIANCE, optional=True),
        Field("yy_m2", "float", "m^2", _COVARIANCE, optional=True),
    ),
)
BELIEFS: Final = (MAPS, WAYS, ESTIMATES)
"""Tables of what robots believe."""
TABLES: Final = {
    table.name: table
    for table in (
        *(POSES, FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS, MESSAGES, WAKES, LINKS, UNSENT, PAYLOADS),
        *(METRICS, ENERGY, CALLS, *BELIEFS),
    )
}


def events_table(types: Iterable[type]) -> Table:
    """Return the table of the event *types*: the union of their fields, empty where an event has no such field.

    Raise TypeError if two types disagree about a field, one has a field that is not int, float, str or bool, or one
    has a field of the name of a column that every event has.
    """
    fixed = (_TIME, _SOURCE, Field("event", "str", "", "the event's type"))
    fields: dict[str, Field] = {field.name: field for field in fixed}
    types = tuple(types)
    for kind in types:
        for field in event_fields(kind):
            known = fields.setdefault(field.name, field)
            if known in fixed:
                raise TypeError(f"{kind.__name__}.{field.name}: every event has a column of this name")
            if known.kind != field.kind:
                raise TypeError(f"{kind.__name__}.{field.name}: {field.kind}, elsewhere {known.kind}")
    return Table("events", "what the protocol's machines report", tuple(fields.values()), types)


def event_fields(kind: type) -> list[Field]:
    """Return the columns of the event type *kind*, a dataclass, with unit and meaning from its fields' metadata.

    Raise TypeError for a field that is not int, float, str or bool.
    """
    types = get_type_hints(kind)
    fields = []
    for item in dataclasses.fields(kind):
        if types[item.name] not in _KIND_OF_TYPE:
            raise TypeError(f"{kind.__name__}.{item.name}: {item.type} cannot be a column")
        unit, meaning = item.metadata.get("unit", ""), item.metadata.get("meaning", "")
        fields.append(Field(item.name, _KIND_OF_TYPE[types[item.name]], unit, meaning, optional=True))
    return fields


def _column(field: Field) -> Any:
    """Return an empty column; None in an optional one stands for a field that a row does not have."""
    code = None if field.optional else _ARRAY_CODES.get(field.kind)
    return [] if code is None else array(code)


PUT_ROWS: Final = 4096
"""Number of rows of a table that are put into its columns at once."""


class Trace:
    """The tables of one run. Only tables that were asked for keep rows; a row for another one is dropped at once."""

    def __init__(self, wanted: Iterable[Table] = ()) -> None:
        self.tables: dict[str, Table] = {table.name: table for table in wanted}
        self._columns = {name: tuple(map(_column, table.fields)) for name, table in self.tables.items()}
        self._appends = {name: tuple(column.append for column in columns) for name, columns in self._columns.items()}
        self._put: dict[str, list[tuple[Any, ...]]] = {name: [] for name in self.tables}
        """Rows that are not in the columns yet."""
        self._attributes: dict[type, tuple[str | None, ...]] = {}

    def wants(self, table: Table) -> bool:
        """Return whether rows of *table* are kept."""
        return table.name in self.tables

    def row(self, table: Table, *values: Any) -> None:
        """Append a row; *values* in the order of the table's fields, the first two being time and source."""
        appends = self._appends.get(table.name)
        if appends is not None:
            if self._put[table.name]:
                self._stored(table.name)
            for append, value in zip(appends, values, strict=True):
                append(value)

    def rows(self, table: Table, *columns: Any) -> None:
        """Append rows by column, all equally long, in the order of the table's fields.

        A column of numbers that every row has is an array of int64 or float64, any other one a list.
        """
        if not self.wants(table):
            return
        for column, values in zip(self._stored(table.name), columns, strict=True):
            if isinstance(column, array):
                column.frombytes(values.tobytes())
            else:
                column.extend(values)

    def put(self, table: Table, *values: Any) -> None:
        """Append a row as ``row`` does, in a third of the time: for what a model writes of every frame.

        Values of a wrong type are noticed only when somebody asks for the table, or thousands of rows have come.
        """
        rows = self._put.get(table.name)
        if rows is None:
            return
        width = len(self._columns[table.name])
        if len(values) != width:
            raise ValueError(f"a row of {table.name} has {len(values)} values, expected {width}")
        rows.append(values)
        if len(rows) == PUT_ROWS:
            self._stored(table.name)

    def _stored(self, name: str) -> tuple[Any, ...]:
        """Return the columns of the table *name* with all its rows in them."""
        columns, rows = self._columns[name], self._put[name]
        if rows:
            for column, values in zip(columns, zip(*rows, strict=True), strict=True):
                column.extend(values)
            rows.clear()
        return columns

    def event(self, time: int, source: int, event: Any) -> None:
        """Append a protocol's *event*, a dataclass, to the table ``events``.

        Raise LocalProtocolError for one whose type is not among those of the table.
        """
        table = self.tables.get("events")
        if table is None:
            return
        kind = type(event)
        names = self._attributes.get(kind)
        if names is None:
            if kind not in table.types:
                raise LocalProtocolError(
                    f"robot {source} at {to_seconds(time):.6f} s: {kind.__name__} is not among the event types that "
                    "the protocol's spec names"
                )
            names = self._attributes[kind] = _attributes(kind, table)
        values = [None if name is None else getattr(event, name) for name in names]
        self.row(table, time, source, kind.__name__, *values)

    def count(self, name: str) -> int:
        """Return the number of rows of the table *name*."""
        return len(self._columns[name][0]) + len(self._put[name])

    def columns(self, name: str) -> dict[str, list[Any]]:
        """Return the table *name* as lists by column."""
        fields = self.tables[name].fields
        return {field.name: list(column) for field, column in zip(fields, self._stored(name), strict=True)}

    def arrow(self, name: str, metadata: Mapping[str, str] | None = None) -> Any:
        """Return the table *name* as a pyarrow table, with units and meanings as metadata of its fields.

        Its rows are in the order of time; those of one instant keep the order in which they were appended.
        """
        import pyarrow as pa

        fields = self.tables[name].fields
        arrays = [pa.array(c, type=ARROW[f.kind]) for f, c in zip(fields, self._stored(name), strict=True)]
        table = pa.table(arrays, schema=pa.schema([arrow_field(field) for field in fields], dict(metadata or {})))
        return table.sort_by(fields[0].name)  # a stable sort; a frame is appended when it ends and tells when it began

    def digest(self, names: Iterable[str] | None = None) -> str:
        """Return a SHA-256 of the rows of the tables *names* (default: all), by (time, table, source, sequence)."""
        keyed: list[tuple[Any, ...]] = []
        for name in self.tables if names is None else names:
            columns = self._stored(name)
            times, sources = columns[:2]
            keyed += zip(times, repeat(name), sources, zip(*columns, strict=True), strict=False)
        keyed.sort(key=itemgetter(0, 1, 2))  # stable: rows of one source in one table keep their sequence
        digest = hashlib.sha256()
        for _, name, _, row in keyed:
            digest.update(repr((name, row)).encode())
        return digest.hexdigest()

    def write(self, folder: Path, metadata: Mapping[str, str] | None = None) -> list[Path]:
        """Write every table as ``folder/NAME.parquet`` and return the paths."""
        folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for name in self.tables:
            path = folder / f"{name}.parquet"
            write_parquet(self.arrow(name, metadata), path, GROUP_ROWS)
            paths.append(path)
        return paths


GROUP_ROWS: Final = 1 << 16
"""Rows that are read together from a file of a trace: one of them is not to cost much."""
_GROUPS_KEPT: Final = 2
_REPEATED: Final = ["kind", "outcome", "part", "state", "event"]
"""Columns of words, of which there are few different ones."""
_FIRST_COLUMNS: Final = [[_TIME.name, _SOURCE.name], [field.name for field in INTERVALS.fields[:2]]]


class StoredTable:
    """A table of an earlier run as :meth:`Trace.write` has written it, its rows in the order of time."""

    def __init__(self, path: Path) -> None:
        """Read *path*; raise UserError for a file that is no such table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
        except (pa.ArrowException, OSError) as error:
            raise UserError(f"{path}: cannot be read as Parquet: {error}") from None
        if table.column_names[:2] not in _FIRST_COLUMNS:
            raise UserError(f"{path}: is no table of a trace")
        self._table = table.sort_by(table.column_names[0])  # a stable sort: rows of one instant keep their order
        self.names: list[str] = table.column_names
        self.metadata = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def column(self, name: str) -> Any:
        """Return the column *name*, of numbers, as an array; NaN stands for what a row does not have."""
        return self._table.column(name).to_numpy()

    def rows(self, first: int, end: int) -> list[dict[str, Any]]:
        """Return the rows from number *first* to before *end*, by column; None for what a row does not have."""
        rows: list[dict[str, Any]] = self._table.slice(first, max(0, end - first)).to_pylist()
        return rows

    def rows_at(self, numbers: Any) -> list[dict[str, Any]]:
        """Return the rows with these *numbers*, an array, as ``rows`` does."""
        rows: list[dict[str, Any]] = self._table.take(numbers).to_pylist()
        return rows


class TableFile:
    """A table of an earlier run that is too large to be read whole: by columns and groups of rows, in their order."""

    def __init__(self, path: Path) -> None:
        """Look at *path*; raise UserError for a file that is no such table."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            about = pq.read_metadata(path)
            self.names: list[str] = about.schema.names
            repeated = [name for name in self.names if name in _REPEATED]
            self._file = pq.ParquetFile(path, metadata=about, read_dictionary=repeated)
        except (pa.ArrowException, OSError) as error:
            raise UserError(f"{path}: cannot be read as Parquet: {error}") from None
        self._path = path
        if self.names[:2] not in _FIRST_COLUMNS:
            raise UserError(f"{path}: is no table of a trace")
        self._groups = [at for at in range(about.num_row_groups) if about.row_group(at).num_rows]
        self._ends = list(accumulate(about.row_group(at).num_rows for at in self._groups))
        self._read: OrderedDict[int, Any] = OrderedDict()
        self._spans = [self._span(at) for at in range(len(self._groups))]

    def __len__(self) -> int:
        return int(self._file.metadata.num_rows)

    @property
    def metadata(self) -> dict[str, str]:
        """What was kept with the table."""
        return {key.decode(): value.decode() for key, value in (self._file.schema_arrow.metadata or {}).items()}

    @property
    def last(self) -> int:
        """The time of the last row; 0 if there is none."""
        return int(self._group(len(self._ends) - 1).column(0)[-1].as_py()) if len(self) else 0

    def until(self, time: int) -> int:
        """Return the number of rows up to *time*."""
        at = sum(greatest <= time for _, greatest in self._spans)
        begin = self._ends[at - 1] if at else 0
        if at == len(self._ends) or self._spans[at][0] > time:
            return begin
        return begin + int(self._group(at).column(0).to_numpy().searchsorted(time, side="right"))

    @property
    def ends(self) -> Sequence[int]:
        """Numbers of rows up to the end of each group."""
        return self._ends

    def group(self, at: int, names: Sequence[str]) -> dict[str, Any]:
        """Return the columns *names* of the group of that number, as ``groups`` does."""
        return {name: _plain(column) for name, column in self._columns(at, list(names)).items()}

    def groups(self, names: Sequence[str]) -> Iterator[dict[str, Any]]:
        """Yield for each group of rows the columns *names*: numbers as arrays, text as (codes, words by code)."""
        for at in range(len(self._ends)):
            yield self.group(at, names)

    def row(self, number: int) -> dict[str, Any]:
        """Return the row of that *number*, by column; None for what it does not have."""
        at = bisect_right(self._ends, number)
        if number < 0 or at == len(self._ends):
            raise UserError(f"{self._path.name}: there is no row {number}")
        return self._rows(at, number - (self._ends[at - 1] if at else 0), 1)[0]

    def rows(self, first: int, end: int) -> list[dict[str, Any]]:
        """Return the rows from number *first* to before *end*, by column; None for what a row does not have."""
        rows: list[dict[str, Any]] = []
        first, end = max(0, first), min(end, len(self))
        while first < end:
            at = bisect_right(self._ends, first)
            begin = self._ends[at - 1] if at else 0
            count = min(end, self._ends[at]) - first
            rows += self._rows(at, first - begin, count)
            first += count
        return rows

    def at(self, time: int) -> list[tuple[int, dict[str, Any]]]:
        """Return the numbers and rows of that *time*."""
        import pyarrow.compute as pc

        found = []
        for at, (least, greatest) in enumerate(self._spans):
            if least <= time <= greatest:
                times = self._group(at).column(0)
                begin = self._ends[at - 1] if at else 0
                for place in pc.indices_nonzero(pc.equal(times, time)).to_pylist():
                    found.append((begin + place, self._rows(at, place, 1)[0]))
        return found

    def _rows(self, at: int, first: int, count: int) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = self._group(at).slice(first, count).to_pylist()
        return rows

    def _group(self, at: int) -> Any:
        """Return all columns of the group number *at*; the last few are kept."""
        if at not in self._read:
            self._read[at] = self._columns(at, None)
            while len(self._read) > _GROUPS_KEPT:
                self._read.popitem(last=False)
        self._read.move_to_end(at)
        return self._read[at]

    def _columns(self, at: int, names: list[str] | None) -> Any:
        import pyarrow as pa

        try:
            table = self._file.read_row_group(self._groups[at], names, use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise UserError(f"{self._path}: cannot be read as Parquet: {error}") from None
        return table if names is None else dict(zip(names, table.select(names).columns, strict=True))

    def _span(self, at: int) -> tuple[int, int]:
        """Return the first and the last time in the group number *at*."""
        known = self._file.metadata.row_group(self._groups[at]).column(0).statistics
        if known is not None and known.has_min_max:
            return known.min, known.max
        times = self._group(at).column(0).to_numpy()
        return int(times.min()), int(times.max())


def _plain(column: Any) -> Any:
    """Return a *column* of numbers as an array, one of text as codes and the words that these stand for."""
    import pyarrow as pa

    if pa.types.is_string(column.type):
        column = column.dictionary_encode()
    if not pa.types.is_dictionary(column.type):
        return column.to_numpy()
    whole = column.unify_dictionaries().combine_chunks()
    if isinstance(whole, pa.ChunkedArray):  # as long as it is none
        whole = whole.chunk(0) if whole.num_chunks else pa.array([], type=column.type)
    return whole.indices.to_numpy(zero_copy_only=False), whole.dictionary.to_pylist()


def write_parquet(table: Any, path: Path, group_rows: int | None = None) -> None:
    """Write *table* to *path* whole: nobody ever reads half a file. Its rows are stored in groups of *group_rows*."""
    import pyarrow.parquet as pq

    with drafted(path) as draft:
        pq.write_table(table, draft, row_group_size=group_rows)


@contextmanager
def drafted(path: Path, folder: Path | None = None) -> Iterator[Path]:
    """Give the path of a draft, which takes the place of *path* when it is written, and is on the disk then.

    The draft is made in *folder*, on the same file system; beside *path*, if that is not given.
    """
    draft = (folder or path.parent) / f".{path.name}.{os.getpid()}.part"
    try:
        yield draft
        with draft.open("rb+") as file:
            os.fsync(file.fileno())  # a rename may reach the disk before what was written: 5 ms
        draft.replace(path)
        sync_folder(path.parent)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def sync_folder(folder: Path) -> None:
    """Have the names of the files in *folder* on the disk: without that a power cut may undo a rename."""
    if sys.platform == "win32":  # which opens no folders
        return
    file = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _attributes(kind: type, table: Table) -> tuple[str | None, ...]:
    """Return for each column of the table of events beyond the fixed three what it is in *kind*; None if nothing."""
    own = {field.name for field in dataclasses.fields(kind)}
    return tuple(field.name if field.name in own else None for field in table.fields[3:])


def arrow_field(field: Field) -> Any:
    """Return *field* as Arrow's, with unit and meaning as its metadata."""
    import pyarrow as pa

    metadata = {"unit": field.unit, "meaning": field.meaning}
    return pa.field(field.name, ARROW[field.kind], field.optional, metadata)
