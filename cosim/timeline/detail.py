"""All about one box: the fields of its row, what became of the frame at everyone, and the bytes that it carries."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, Protocol, TypeAlias

from cosim.machine import BROADCAST
from cosim.timeline.lanes import Array, Lane
from cosim.trace import FRAMES, MESSAGES, RECEPTIONS, TRANSMISSIONS
from cosim.units import Time

Row: TypeAlias = dict[str, Any]
Nearby: TypeAlias = Callable[[Collection[str]], tuple[Iterator[Row], Iterator[Row]]]
"""(types of packets) -> the transmissions of these types before one, and after it, of the same sender."""
Decode: TypeAlias = Callable[[bytes, Row | None, Nearby], Any]
"""(body, the row of the transmission that carries it, what is beside it) -> what it says, as plain data.

Without a transmission it is a payload.
"""
MOST_RECEPTIONS: Final = 200
"""Maximum number of receptions that are told of."""
BYTES_IN: Final = {TRANSMISSIONS.name: "body", MESSAGES.name: "payload"}
"""The columns that hold bytes, by table."""


class Tables(Protocol):
    """Rows of a run by table; those of a table that there is not are none."""

    def row(self, table: str, number: int) -> Row:
        """Return the row of *table* with that *number*; raise UserError if there is none."""

    def at(self, table: str, time: Time) -> Sequence[Row]:
        """Return the rows of *table* of that *time*."""

    def total(self, table: str, name: str, rows: Array) -> int:
        """Return the sum of the column *name* of *table*, of whole numbers, over the *rows* of these numbers."""


def alone(sent: Row, kinds: Collection[str]) -> tuple[Iterator[Row], Iterator[Row]]:
    """Return that there is nothing beside a transmission."""
    return iter(()), iter(())


def detail(
    tables: Tables,
    lane: Lane,
    number: int,
    decode: Decode | None = None,
    beside: Callable[[Row, Collection[str]], tuple[Iterator[Row], Iterator[Row]]] = alone,
) -> Row:
    """Return all about the box of *lane* that the row *number* makes, as plain data.

    *beside* finds what is near a transmission, for *decode*. Raise UserError if there is no such row.
    """
    table, row = lane.table, tables.row(lane.table, number)
    about: Row = {"table": table, "fields": row, "transmission": None, "receptions": [], "bytes": "", "decoded": None}
    sent: Row | None = None
    if table in (TRANSMISSIONS.name, FRAMES.name):
        rows = [each for each in tables.at(TRANSMISSIONS.name, row["time_ns"]) if _same(each, row)]
        meant = [each for each in rows if each["destination"] in (row["destination"], BROADCAST)]
        sent = row if table == TRANSMISSIONS.name else next(iter(meant), None)
        about["transmission"] = sent
        about["receptions"] = _receptions(tables, row, rows)[:MOST_RECEPTIONS]
    carried = row.get(BYTES_IN.get(table, ""), "") if sent is None else sent[BYTES_IN[TRANSMISSIONS.name]]
    about["bytes"] = carried or ""
    about["decoded"] = _decoded(decode, about["bytes"], sent, partial(beside, sent or {}))
    return about


def _same(one: Row, other: Row) -> bool:
    """Return whether two rows are about one transmission."""
    names = ("time_ns", "source", "kind", "radio")
    return all(one[name] == other[name] for name in names if name in one and name in other)


def _receptions(tables: Tables, row: Row, sent: Sequence[Row]) -> list[Row]:
    """Return what became of the transmission of *row* at whom; by its frames, if there are no rows of receptions.

    *sent*: all transmissions of that robot and kind at that instant.
    """
    heard = [each for each in tables.at(RECEPTIONS.name, row["time_ns"]) if _same(each, row)]
    if heard:
        to = row["destination"]
        alike = [each for each in sent if each["destination"] == to]
        if len(alike) == len(sent) or to == BROADCAST:
            return heard
        return [each for each in heard if each["receiver"] == to]
    frames = [each for each in tables.at(FRAMES.name, row["time_ns"]) if _same(each, row)]
    none = {"power_dbm": None, "sinr_db": None}
    return [
        {"receiver": each["destination"]} | none | {"outcome": each["outcome"], "part": each["part"]}
        for each in frames
    ]  # fmt: skip


def _decoded(decode: Decode | None, carried: str, sent: Row | None, nearby: Nearby) -> Any:
    """Return what the bytes say, or why nobody can tell; None if the protocol does not say how to decode them."""
    if decode is None or not carried:
        return None
    try:
        said = decode(bytes.fromhex(carried), sent, nearby)
        json.dumps(said)
    except Exception as error:  # noqa: BLE001  # a protocol's decoder may raise anything; its field of the page says what
        return f"cannot be decoded: {type(error).__name__}: {error}"
    return said


def plain(row: Mapping[str, Any]) -> Row:
    """Return *row* with times as text of decimal digits: JSON's numbers lose the last ones in many readers."""
    return {name: str(value) if name.endswith("_ns") and value is not None else value for name, value in row.items()}
