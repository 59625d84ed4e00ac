"""The columns of the tables that sweeps write: one schema for all parts of a table, whatever runs a part holds.

Readers such as pandas, polars and DuckDB take the schema of one part, or refuse parts that differ. So the kind of a
column comes from what is declared and from all values that are known, and what a row does not have is null.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np

from cosim.trace import ARROW, Field, Kind, arrow_field


def kind_of(values: Iterable[Any]) -> Any:
    """Return the kind of column that holds all *values*: bool, int, float, or else str; null if there are none."""
    return _common({_kind(each) for each in set(map(type, values)) if each is not type(None)})


def _kind(kind: type) -> str:
    if issubclass(kind, bool | np.bool_):
        return "bool"
    if issubclass(kind, Integral):
        return "int"
    return "float" if issubclass(kind, Real) else "str"


def _common(kinds: Collection[str]) -> str:
    """Return the kind of column that holds values of all *kinds*."""
    if len(kinds) < 2:
        return next(iter(kinds), "null")
    return "float" if set(kinds) == {"int", "float"} else "str"


def union(fixed: Sequence[Field], *more: Iterable[Field]) -> list[Field]:
    """Return *fixed* as they are, then the columns of all *more* in the order in which they come.

    A column that comes several times is of the kind that holds the values of all, and is described as the first
    that has a unit, or a meaning. All but the fixed may be null.
    """
    found: dict[str, list[Field]] = {}
    for fields in more:
        for field in fields:
            found.setdefault(field.name, []).append(field)
    for field in fixed:
        found.pop(field.name, None)
    return [*fixed, *map(_joined, found.values())]


def _joined(fields: Sequence[Field]) -> Field:
    described = max(fields, key=lambda field: 2 * bool(field.unit) + bool(field.meaning))  # the first of the best
    kind: Any = _common({field.kind for field in fields})
    return described._replace(kind=kind, optional=True)


def columns_of_rows(rows: Sequence[Mapping[str, Any]], described: Iterable[Field]) -> list[Field]:
    """Return the columns that *rows* have, those of them that are *described* first.

    What is neither described nor has a value in any row is left out: nobody knows its kind.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    told = [field for field in described if field.name in names]
    kinds = {name: kind_of(row.get(name) for row in rows) for name in names}
    return union((), told, (Field(name, kind, "", "") for name, kind in kinds.items() if kind != "null"))


def columns_of_schema(schema: Any) -> list[Field]:
    """Return the columns of the Arrow *schema*, but for those that can only hold nulls."""
    import pyarrow as pa

    fields = []
    for each in schema:
        notes = {key.decode(): text.decode() for key, text in (each.metadata or {}).items()}
        kind: Kind = "str"
        if pa.types.is_boolean(each.type):
            kind = "bool"
        elif pa.types.is_integer(each.type):
            kind = "int"
        elif pa.types.is_floating(each.type):
            kind = "float"
        if not pa.types.is_null(each.type):
            fields.append(Field(each.name, kind, notes.get("unit", ""), notes.get("meaning", ""), each.nullable))
    return fields


def schema_of(fields: Iterable[Field], metadata: Mapping[Any, Any] | None = None) -> Any:
    """Return the Arrow schema of the columns *fields*, with their units and meanings, and *metadata* of the file."""
    import pyarrow as pa

    return pa.schema([arrow_field(field) for field in fields], dict(metadata or {}))


def array_of(values: Sequence[Any], kind: str) -> Any:
    """Return *values*, of which any may be None, as an Arrow array of a column of *kind*."""
    import pyarrow as pa

    convert = {"float": float, "str": str}.get(kind)
    if convert is not None:
        values = [None if value is None else convert(value) for value in values]
    return pa.array(values, ARROW[kind])


def table_of(rows: Sequence[Mapping[str, Any]], fields: Sequence[Field], metadata: Mapping[str, str]) -> Any:
    """Return *rows* as an Arrow table with the columns *fields*."""
    import pyarrow as pa

    arrays = [array_of([row.get(field.name) for row in rows], field.kind) for field in fields]
    return pa.table(arrays, schema=schema_of(fields, metadata))


def conformed(table: Any, fields: Sequence[Field]) -> Any:
    """Return the Arrow *table* with the columns *fields*: null where it has none, others converted."""
    import pyarrow as pa

    schema = schema_of(fields, table.schema.metadata)
    arrays = []
    for field in fields:
        if field.name not in table.column_names:
            arrays.append(pa.nulls(len(table), ARROW[field.kind]))
        elif table[field.name].type == schema.field(field.name).type:
            arrays.append(table[field.name])
        else:
            arrays.append(array_of(table[field.name].to_pylist(), field.kind))
    return pa.table(arrays, schema=schema)
