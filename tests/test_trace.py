"""Typed columns, a digest of content, files that are whole or absent, and tables of events."""

import math
import os
import stat
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import LocalProtocolError
from cosim.trace import (
    CALLS,
    FRAMES,
    MESSAGES,
    POSES,
    TABLES,
    Field,
    Table,
    Trace,
    event_fields,
    events_table,
    write_parquet,
)


@dataclass(frozen=True)
class Stepped:
    """A step."""

    step: int = field(metadata={"unit": "1", "meaning": "number of the step"})
    action: str


@dataclass(frozen=True, slots=True)
class Measured:
    """A measurement."""

    distance_m: float = field(metadata={"unit": "m"})
    sure: bool = True
    action: str = "look"


EVENTS = events_table((Stepped, Measured))


def poses(*rows: tuple[int, int, float]) -> Trace:
    trace = Trace([POSES])
    for time, source, x in rows:
        trace.row(POSES, time, source, x, 0.0, 0.0)
    return trace


# ---------------------------------------------------------------- tables


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_every_table_begins_with_time_and_source_and_explains_itself(table: Table):
    first = ["start_ns", "robot"] if table.name == "intervals" else ["time_ns", "source"]
    assert [item.name for item in table.fields[:2]] == first
    assert table.meaning
    assert all(item.meaning for item in table.fields)
    assert len({item.name for item in table.fields}) == len(table.fields)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_suffix_of_a_column_names_its_unit(table: Table):
    for item in table.fields:
        suffix = item.name.rpartition("_")[2]
        assert item.unit == suffix or suffix not in {"m", "s", "ns", "rad", "mps"}, item


def test_the_table_of_events_is_the_union_of_their_fields():
    names = ["time_ns", "source", "event", "step", "action", "distance_m", "sure"]
    assert [item.name for item in EVENTS.fields] == names
    assert [item.optional for item in EVENTS.fields] == [False] * 3 + [True] * 4
    assert [item.kind for item in EVENTS.fields] == ["int", "int", "str", "int", "str", "float", "bool"]


def test_fields_of_events_carry_unit_and_meaning():
    assert event_fields(Stepped)[0] == Field("step", "int", "1", "number of the step", optional=True)
    assert event_fields(Measured)[0] == Field("distance_m", "float", "m", "", optional=True)


def test_types_of_events_may_be_written_as_text():
    @dataclass
    class Late:
        count: "int"

    assert [item.kind for item in event_fields(Late)] == ["int"]


def test_a_field_that_is_no_column_is_refused():
    @dataclass
    class Odd:
        place: tuple

    with pytest.raises(TypeError, match=r"Odd\.place: .*tuple.* cannot be a column"):
        events_table((Odd,))


def test_events_that_disagree_about_a_field_are_refused():
    @dataclass
    class Other:
        step: float

    with pytest.raises(TypeError, match=r"Other\.step: float, elsewhere int"):
        events_table((Stepped, Other))


@pytest.mark.parametrize("name", ["time_ns", "source", "event"])
def test_a_field_that_would_hide_a_column_of_every_event_is_refused(name: str):
    hiding = dataclass(type("Hiding", (), {"__annotations__": {name: str if name == "event" else int}}))
    with pytest.raises(TypeError, match=f"Hiding.{name}: every event has a column of this name"):
        events_table((hiding,))


# ---------------------------------------------------------------- rows


def test_only_tables_that_were_asked_for_keep_rows():
    trace = Trace([POSES])
    trace.row(FRAMES, 0, 0, 1, 366, "DM1", 3, 1, 17, "received")
    trace.event(0, 0, Stepped(1, "wait"))
    trace.row(POSES, 0, 0, 1.0, 2.0, 0.0)
    assert trace.wants(POSES)
    assert not trace.wants(FRAMES)
    assert trace.count("poses") == 1
    assert list(trace.tables) == ["poses"]


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="zip"):
        Trace([POSES]).row(POSES, 0, 0, 1.0)


@pytest.mark.parametrize("row", [(0.5, 0, 1.0), (0, "r1", 1.0), (0, 0, "east")])
def test_columns_are_typed(row: tuple[Any, Any, Any]):
    with pytest.raises(TypeError):
        poses(row)


def test_numbers_of_any_make_are_kept_as_the_columns_type():
    assert poses((1, 2, 3)).columns("poses")["x_m"] == [3.0]
    assert poses((1, 2, 3)).digest() == poses((1, 2, 3.0)).digest()


def test_an_event_fills_its_own_fields_and_leaves_the_others_empty():
    trace = Trace([EVENTS])
    trace.event(5, 1, Stepped(7, "turn"))
    trace.event(6, 2, Measured(0.5))
    assert trace.columns("events") == {
        "time_ns": [5, 6],
        "source": [1, 2],
        "event": ["Stepped", "Measured"],
        "step": [7, None],
        "action": ["turn", "look"],
        "distance_m": [None, 0.5],
        "sure": [None, True],
    }


def test_an_event_that_the_table_does_not_know_is_our_mistake():
    @dataclass
    class Unknown:
        secret: int

    trace = Trace([EVENTS])
    with pytest.raises(LocalProtocolError, match="Unknown is not among the event types"):
        trace.event(5, 1, Unknown(3))
    assert trace.count("events") == 0


# ---------------------------------------------------------------- digest

ROWS = [(5, 0, 1.0), (5, 1, 2.0), (4, 1, 3.0), (5, 0, 4.0)]


def test_the_digest_does_not_depend_on_the_order_in_which_sources_are_written():
    first = poses(*ROWS)
    assert poses(ROWS[1], ROWS[0], ROWS[2], ROWS[3]).digest() == first.digest()
    assert poses(ROWS[2], ROWS[0], ROWS[3], ROWS[1]).digest() == first.digest()


def test_the_digest_depends_on_the_sequence_of_one_source():
    assert poses(ROWS[3], ROWS[1], ROWS[2], ROWS[0]).digest() != poses(*ROWS).digest()


@pytest.mark.parametrize("change", [(6, 0, 1.0), (5, 2, 1.0), (5, 0, math.nextafter(1.0, 2.0))])
def test_the_digest_depends_on_every_value(change: tuple[int, int, float]):
    assert poses(change, *ROWS[1:]).digest() != poses(*ROWS).digest()
    assert poses(*ROWS[1:]).digest() != poses(*ROWS).digest()


@given(st.permutations(range(4)), st.data())
def test_any_interleaving_of_sources_has_one_digest(order: list[int], data: st.DataObject):
    rows = {source: data.draw(st.lists(st.tuples(st.integers(0, 2), st.floats(0, 9)), max_size=3)) for source in order}
    numbered = [(time, source, value) for source in range(4) for time, value in rows[source]]
    shuffled = [(time, source, value) for source in order for time, value in rows[source]]
    assert poses(*numbered).digest() == poses(*shuffled).digest()


def test_the_digest_covers_the_tables_that_are_named():
    def both(x: float, room: str) -> Trace:
        trace = Trace([POSES, CALLS])
        trace.row(CALLS, 1, 0, 0, room, "send", "")
        trace.row(POSES, 1, 0, x, 0.0, 0.0)
        return trace

    assert both(1.0, "a").digest(["poses"]) == both(1.0, "b").digest(["poses"]) == poses((1, 0, 1.0)).digest()
    assert both(1.0, "a").digest() != both(1.0, "b").digest()
    assert both(1.0, "a").digest() != both(2.0, "a").digest()
    assert both(1.0, "a").digest(["poses", "calls"]) == both(1.0, "a").digest(["calls", "poses"])


def test_tables_with_the_same_rows_have_other_digests():
    other = POSES._replace(name="beliefs")
    trace = Trace([other])
    trace.row(other, 1, 0, 1.0, 0.0, 0.0)
    assert trace.digest() != poses((1, 0, 1.0)).digest()


# ---------------------------------------------------------------- files


def test_a_table_survives_parquet_with_types_units_and_metadata(tmp_path: Path):
    trace = Trace([EVENTS, MESSAGES])
    trace.event(5, 1, Stepped(7, "turn"))
    trace.event(6, 2, Measured(0.5, sure=False))
    trace.row(MESSAGES, 9, 0, 1, True, b"\x00\xff".hex())
    paths = trace.write(tmp_path / "tables", {"seed": "3"})
    assert paths == [tmp_path / "tables" / "events.parquet", tmp_path / "tables" / "messages.parquet"]
    for path, name in zip(paths, ["events", "messages"], strict=True):
        table = pq.read_table(path)
        assert table.to_pydict() == trace.columns(name)
        assert table.schema.metadata[b"seed"] == b"3"
    schema = pq.read_schema(paths[0])
    assert [schema.field(name).type for name in ("time_ns", "event", "distance_m", "sure")] == [
        pa.int64(),
        pa.string(),
        pa.float64(),
        pa.bool_(),
    ]
    assert schema.field("distance_m").metadata == {b"unit": b"m", b"meaning": b""}
    assert schema.field("step").metadata[b"meaning"] == b"number of the step"
    assert [schema.field(name).nullable for name in ("time_ns", "step")] == [False, True]


def test_a_table_without_rows_is_written_with_its_columns(tmp_path: Path):
    (path,) = Trace([POSES]).write(tmp_path)
    assert pq.read_table(path).column_names == [item.name for item in POSES.fields]


def test_a_file_is_replaced_whole(tmp_path: Path):
    path = tmp_path / "poses.parquet"
    write_parquet(pa.table({"old": [1]}), path)
    with path.open("rb") as reader:
        write_parquet(pa.table({"new": [2]}), path)
        assert pq.read_table(pa.BufferReader(reader.read())).column_names == ["old"]  # what was open stays what it was
    assert pq.read_table(path).column_names == ["new"]
    assert [item.name for item in tmp_path.iterdir()] == ["poses.parquet"]


def test_others_may_read_a_file_as_far_as_the_umask_allows(tmp_path: Path):
    (tmp_path / "plain").touch()
    write_parquet(pa.table({"x": [1]}), tmp_path / "x.parquet")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "x.parquet")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_full_disk_or_an_interrupt_leaves_what_was_there(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "poses.parquet"
    write_parquet(pa.table({"old": [1]}), path)

    def full(table: Any, name: Any, **more: Any) -> None:
        Path(name).write_bytes(b"half a file")
        raise error

    monkeypatch.setattr(pq, "write_table", full)
    for target in (path, tmp_path / "frames.parquet"):
        with pytest.raises(type(error)):
            write_parquet(pa.table({"new": [2]}), target)
    assert [item.name for item in tmp_path.iterdir()] == ["poses.parquet"]
    assert pq.read_table(path).column_names == ["old"]


def test_rows_are_written_in_the_order_of_time(tmp_path: Path):
    trace = Trace([POSES])
    for time, source in ((30, 0), (10, 2), (20, 1), (10, 0), (10, 1)):
        trace.row(POSES, time, source, 0.0, 0.0, 0.0)
    before = trace.digest()
    (path,) = trace.write(tmp_path, {"seed": "1"})
    table = pq.read_table(path)
    assert list(zip(*(table[name].to_pylist() for name in ("time_ns", "source")), strict=True)) == [
        (10, 2),
        (10, 0),
        (10, 1),
        (20, 1),
        (30, 0),
    ]
    assert table.schema.metadata[b"seed"] == b"1"
    assert table.schema.field("x_m").metadata == {b"unit": b"m", b"meaning": b"position, world frame"}
    assert trace.digest() == before


def test_a_file_is_on_the_disk_before_it_takes_its_place_and_its_name_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    done: list[str] = []
    replace = Path.replace
    monkeypatch.setattr("os.fsync", lambda file: done.append("folder" if S_ISDIR(os.fstat(file).st_mode) else "file"))
    monkeypatch.setattr(Path, "replace", lambda path, target: done.append("renamed") or replace(path, target))
    write_parquet(pa.table({"x": [1]}), tmp_path / "x.parquet")
    assert done == ["file", "renamed", "folder"]
