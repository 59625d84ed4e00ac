"""Records of a run: typed columns in memory, one schema for each table, Parquet on disk, and a digest of the content.

Here stand cosim's own tables; a protocol's event types are dataclasses beside its code and share the table ``events``.
A row costs one append per column. The digest sorts by (time, table, source, sequence), where the sequence numbers the
rows of one source in one table: the order in which different sources were written has no meaning.
"""

import dataclasses
import hashlib
import os
import tempfile
from array import array
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import pyarrow as pa
import pyarrow.parquet as pq

Kind: TypeAlias = Literal["int", "float", "str", "bool"]

_ARROW: Final[dict[str, Any]] = {"int": pa.int64(), "float": pa.float64(), "str": pa.string(), "bool": pa.bool_()}
_KIND_OF_TYPE: Final[dict[Any, Kind]] = {int: "int", float: "float", str: "str", bool: "bool"}


class Field(NamedTuple):
    """One column: its name, type, unit (empty where there is none) and meaning."""

    name: str
    kind: Kind
    unit: str
    meaning: str
    optional: bool = False


class Table(NamedTuple):
    """A table's name, meaning and columns; the first two columns are always ``time_ns`` and ``source``."""

    name: str
    meaning: str
    fields: tuple[Field, ...]


_TIME = Field("time_ns", "int", "ns", "simulated time")
_SOURCE = Field("source", "int", "", "address of the robot that the row is about")

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
        Field("duration_ns", "int", "ns", "air time"),
        Field("kind", "str", "", "packet type"),
        Field("channel", "int", "", "RF channel k, 2402 + k MHz; -1 where a channel has none"),
        Field("lt_addr", "int", "", "logical transport address; 0 for broadcasts and outside of a piconet"),
        Field("length", "int", "B", "user payload"),
        Field("outcome", "str", "", "what became of it at the receiver"),
    ),
)
MESSAGES: Final = Table(
    "messages",
    "payloads that arrived at a machine",
    (
        Field("time_ns", "int", "ns", "arrival"),
        Field("source", "int", "", "receiver"),
        Field("sender", "int", "", "last hop"),
        Field("broadcast", "bool", "", "sent to everyone"),
        Field("payload", "str", "", "the bytes, hexadecimal"),
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
TABLES: Final = {table.name: table for table in (POSES, FRAMES, MESSAGES, CALLS)}


def events_table(types: Iterable[type]) -> Table:
    """Return the table of the protocol's event *types*: the union of their fields, empty where an event has no such field.

    Raise TypeError if two types disagree about a field or one has a field that is not int, float, str or bool.
    """
    fields: dict[str, Field] = {}
    for kind in types:
        for item in dataclasses.fields(kind):
            if item.type not in _KIND_OF_TYPE:
                raise TypeError(f"{kind.__name__}.{item.name}: {item.type} cannot be a column")
            field = Field(
                item.name,
                _KIND_OF_TYPE[item.type],
                item.metadata.get("unit", ""),
                item.metadata.get("meaning", ""),
                optional=True,
            )
            known = fields.setdefault(item.name, field)
            if known.kind != field.kind:
                raise TypeError(f"{kind.__name__}.{item.name}: {field.kind}, elsewhere {known.kind}")
    name = Field("event", "str", "", "the event's type")
    return Table("events", "what the protocol's machines report", (_TIME, _SOURCE, name, *fields.values()))


class _Column:
    """The values of one column; None stands for a field that a row does not have."""

    def __init__(self, field: Field) -> None:
        self.field = field
        self.values: Any = array("q") if field.kind == "int" and not field.optional else []
        self.append = self.values.append

    def arrow(self) -> Any:
        return pa.array(self.values, type=_ARROW[self.field.kind])


class Trace:
    """The tables of one run. Only tables that were asked for keep rows; a row for another one is dropped at once."""

    def __init__(self, wanted: Iterable[Table] = ()) -> None:
        self.tables: dict[str, Table] = {table.name: table for table in wanted}
        self._columns = {name: tuple(_Column(field) for field in table.fields) for name, table in self.tables.items()}

    def wants(self, table: Table) -> bool:
        """Return whether rows of *table* are kept."""
        return table.name in self.tables

    def row(self, table: Table, *values: Any) -> None:
        """Append a row; *values* in the order of the table's fields, the first two being time and source."""
        columns = self._columns.get(table.name)
        if columns is not None:
            for column, value in zip(columns, values, strict=True):
                column.append(value)

    def event(self, time: int, source: int, event: Any) -> None:
        """Append a protocol's *event*, a dataclass, to the table ``events``."""
        table = self.tables.get("events")
        if table is None:
            return
        given = {"time_ns": time, "source": source, "event": type(event).__name__} | {
            field.name: getattr(event, field.name) for field in dataclasses.fields(event)
        }
        self.row(table, *(given.get(field.name) for field in table.fields))

    def count(self, name: str) -> int:
        """Return the number of rows of the table *name*."""
        return len(self._columns[name][0].values)

    def columns(self, name: str) -> dict[str, list[Any]]:
        """Return the table *name* as lists by column."""
        return {column.field.name: list(column.values) for column in self._columns[name]}

    def arrow(self, name: str, metadata: Mapping[str, str] | None = None) -> Any:
        """Return the table *name* as a pyarrow table, with units and meanings as metadata of its fields."""
        columns = self._columns[name]
        fields = [pa.field(c.field.name, _ARROW[c.field.kind], c.field.optional, _metadata(c.field)) for c in columns]
        return pa.table([c.arrow() for c in columns], schema=pa.schema(fields, dict(metadata or {})))

    def digest(self, names: Iterable[str] | None = None) -> str:
        """Return a SHA-256 of the rows of the tables *names* (all, by default), sorted by (time, table, source, sequence)."""
        rows = [
            (row[0], name, row[1], row)
            for name in (self.tables if names is None else names)
            for row in zip(*(column.values for column in self._columns[name]), strict=True)
        ]
        rows.sort(key=lambda row: row[:3])  # stable: rows of one source in one table keep their sequence
        digest = hashlib.sha256()
        for _, name, _, row in rows:
            digest.update(repr((name, row)).encode())
        return digest.hexdigest()

    def write(self, folder: Path, metadata: Mapping[str, str] | None = None) -> list[Path]:
        """Write every table as ``folder/NAME.parquet`` and return the paths."""
        folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for name in self.tables:
            path = folder / f"{name}.parquet"
            write_parquet(self.arrow(name, metadata), path)
            paths.append(path)
        return paths


def write_parquet(table: Any, path: Path) -> None:
    """Write *table* to *path* whole: to a temporary file beside it, then renamed; nobody ever reads half a file."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    try:
        pq.write_table(table, name)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _metadata(field: Field) -> dict[str, str]:
    return {"unit": field.unit, "meaning": field.meaning}

