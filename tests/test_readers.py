"""What other programs read in a folder of results, by their defaults."""

import importlib
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import duckdb
import pandas as pd
import polars
import pyarrow.parquet as pq
import pytest
import yaml

from cosim.experiment import load_experiment
from cosim.parts import Key
from cosim.results import RunStore
from cosim.sweep import run_sweep
from cosim.trace import Field
from tests.checkout import DATA

Rows = list[dict[str, Any]]


@pytest.fixture(autouse=True)
def endless_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have parts merge as those of one minute do: on a real clock another begins now and then within a test."""
    for module in ("parts", "results"):
        monkeypatch.setattr(f"cosim.{module}.MINUTE_S", 1e12)


def by_pandas(folder: Path) -> Rows:
    frame = pd.read_parquet(folder).astype(object)
    return frame.where(frame.notna(), None).to_dict("records")


def by_pyarrow(folder: Path) -> Rows:
    return pq.read_table(folder).to_pylist()


def by_polars(folder: Path) -> Rows:
    return polars.read_parquet(folder).to_dicts()


def by_duckdb(folder: Path) -> Rows:
    found = duckdb.connect().sql(f"select * from '{folder}/*.parquet'")
    return [dict(zip(found.columns, row, strict=True)) for row in found.fetchall()]


READERS: list[Callable[[Path], Rows]] = [by_pandas, by_pyarrow, by_polars, by_duckdb]
every_reader = pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)


def run_row(seed: int, **more: Any) -> dict[str, Any]:
    row = {"experiment": "calls", "replicate": seed - 1, "configuration": "c", "seed": seed, "code": "k"}
    return row | {"libraries": "numpy 1", "status": "done", "error": None, "wall_s": 0.5, "digest": "d"} | more


def keys_in(store: RunStore) -> set[Key]:
    return {key for part in store.parts.whole() for key in store.parts.keys(part)}


def key(seed: int) -> dict[str, Any]:
    return {"configuration": "c", "seed": seed, "code": "k", "replicate": seed - 1}


def filled(rows: Rows) -> Rows:
    """Return *rows* in the order of their seeds, each with the columns of all."""
    names = {name for row in rows for name in row}
    return sorted(({name: row.get(name) for name in names} for row in rows), key=lambda row: row["seed"])


def in_order(rows: Rows) -> Rows:
    return sorted(rows, key=lambda row: row["seed"])


def schemas(folder: Path) -> list[list[tuple[str, str]]]:
    """Return the different schemas of the parts in *folder*: names and types in their order."""
    found: list[list[tuple[str, str]]] = []
    for part in sorted(folder.glob("*.parquet")):
        schema = [(field.name, str(field.type)) for field in pq.read_schema(part)]
        if schema not in found:
            found.append(schema)
    return found


NARROW = {f"m{number}": number / 4 for number in range(27)}
WIDE = {f"m{number}": number / 8 for number in range(20, 58)}


@every_reader
def test_arms_of_37_and_48_columns_are_one_table(tmp_path: Path, read: Callable[[Path], Rows]):
    rows = [run_row(1, **NARROW), run_row(2, **WIDE), run_row(3, **NARROW), run_row(4, **WIDE)]
    assert [len(row) for row in rows[:2]] == [37, 48]
    store = RunStore(tmp_path)
    with store.writing():
        for row in rows:
            store.append([row], [], [], {})
    assert in_order(read(tmp_path / "runs")) == filled(rows)
    # an axis and a metric are added
    rows += [run_row(5, radio="far", late=2.5, **WIDE), run_row(6, radio="near", late=None, **NARROW)]
    with store.writing():
        store.declare([Field("radio", "str", "", "the radio", optional=True), Field("late", "float", "s", "too late")])
        assert in_order(read(tmp_path / "runs")) == filled([*rows[:4], run_row(9, radio=None, late=None)])[:4]
        store.append(rows[4:], [], [], {})
    assert in_order(read(tmp_path / "runs")) == filled(rows)
    ((*start, _),) = [schema[:13] for schema in schemas(tmp_path / "runs")]
    assert [name for name, _ in start[-3:]] == ["digest", "radio", "late"]
    assert store.units()["late"] == ("s", "too late")


@every_reader
def test_no_batch_decides_what_kind_a_column_is_of(tmp_path: Path, read: Callable[[Path], Rows]):
    batches = [
        {"whole": 1, "void": None, "word": 3, "flag": True},
        {"whole": 1.5, "void": "text", "word": "three", "flag": None},
        {"whole": None, "void": None, "word": 2.5},
    ]
    store = RunStore(tmp_path)
    with store.writing():
        for seed, batch in enumerate(batches, start=1):
            store.append([run_row(seed)], [key(seed) | batch], [], {})
    expected = [
        {"whole": 1.0, "void": None, "word": "3", "flag": True},
        {"whole": 1.5, "void": "text", "word": "three", "flag": None},
        {"whole": None, "void": None, "word": "2.5", "flag": None},
    ]
    assert in_order(read(tmp_path / "observations")) == [key(seed) | row for seed, row in enumerate(expected, start=1)]


def test_parts_of_an_older_program_are_written_anew_once(tmp_path: Path):
    store = RunStore(tmp_path)
    for seed, more in ((1, {"size": 2, "gone": None}), (2, {"size": 2.5, "late": 1.0})):
        with RunStore(tmp_path / "old").writing() as old:
            old.append([run_row(seed, **more)], [key(seed) | {"robot": 0}], [], {"commit": "abc"})
        for table in ("runs", "observations"):
            (part,) = (tmp_path / "old" / table).glob("*.parquet")
            (tmp_path / table).mkdir(exist_ok=True)
            part.rename(tmp_path / table / f"part-{seed:05}-1f0c9a2b.parquet")
    assert len(schemas(tmp_path / "runs")) == 2
    assert store.read()["size"].tolist() == [2.0, 2.5]
    with store.writing():
        store.declare()
    assert len(schemas(tmp_path / "runs")) == 1
    parts = sorted((tmp_path / "runs").iterdir())
    assert [pq.read_schema(part).metadata[b"commit"] for part in parts] == [b"abc"]
    with store.writing():
        store.declare()
    assert sorted((tmp_path / "runs").iterdir()) == parts
    assert keys_in(store) == {("c", 1, "k"), ("c", 2, "k")}


class Killed(BaseException):
    """The process is no more."""


def killed_after(steps: int, patch: pytest.MonkeyPatch) -> None:
    """Have the process killed before one more file than *steps* is renamed or removed."""
    taken = 0

    def until_killed(step: Callable[..., Any]) -> Callable[..., Any]:
        def stepping(*given: Any, **named: Any) -> Any:
            nonlocal taken
            taken += 1
            if taken > steps:
                raise Killed
            return step(*given, **named)

        return stepping

    patch.setattr(Path, "replace", until_killed(Path.replace))
    patch.setattr(Path, "unlink", until_killed(Path.unlink))


def append_two(store: RunStore, *commits: str) -> None:
    for seed, commit in enumerate(commits, start=1):
        seen = [key(seed) | {"robot": robot} for robot in (0, 1)]
        store.append([run_row(seed, heard=0.5)], seen, [], {"commit": commit})


def assert_nothing_is_lost_or_doubled(store: RunStore, parts: int) -> None:
    for _ in range(2):
        assert keys_in(store) == {("c", 1, "k"), ("c", 2, "k")}
        assert sorted(store.read()["seed"]) == [1, 2]
        assert sorted(store.read("observations")["seed"]) == [1, 1, 2, 2]
        with store.writing():
            store.declare([RADIO], [RADIO])
    assert [row["seed"] for row in in_order(by_pandas(store.folder / "runs"))] == [1, 2]
    assert [row["seed"] for row in in_order(by_pandas(store.folder / "observations"))] == [1, 1, 2, 2]
    assert {len(list((store.folder / table).iterdir())) for table in ("runs", "observations")} == {parts}
    assert store.parts.damaged() == []


RADIO = Field("radio", "str", "", "")
ANEW = 2 * (2 + 2 + 1)
"""Files that come or go when two parts of other commits are written anew: two come and two go, and the list anew."""
MERGED = 2 + 4 + 1
"""Files that come or go when two parts are merged."""


@pytest.mark.parametrize("steps", range(ANEW + 1))
def test_a_kill_while_parts_are_written_anew_loses_nothing_and_doubles_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int
):
    store = RunStore(tmp_path)
    with store.writing():
        append_two(store, "first", "second")
    with monkeypatch.context() as patch, pytest.raises(Killed) if steps < ANEW else nullcontext():
        killed_after(steps, patch)
        with store.writing():
            store.declare([RADIO], [RADIO])
    assert_nothing_is_lost_or_doubled(store, 2)


@pytest.mark.parametrize("steps", range(MERGED + 1))
def test_a_kill_while_parts_are_merged_loses_nothing_and_doubles_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int
):
    store = RunStore(tmp_path)
    with monkeypatch.context() as patch, pytest.raises(Killed) if steps < MERGED else nullcontext(), store.writing():
        append_two(store, "the", "the")
        killed_after(steps, patch)
    assert_nothing_is_lost_or_doubled(store, 1)


# ---------------------------------------------------------------- sweeps

CALLS: dict[str, Any] = {
    "name": "calls",
    "scenario": {"duration_s": 3, "team": {"size": 2}, "protocol": {"use": "beacon:SPEC"}},
    "sweep": {"channel.kind": ["ideal", "optical"]},
    "replicates": 2,
}
COUNTED = """
from cosim.experiment import experiment_function
from cosim.trace import Field

COLUMNS = (Field("rounds", "int", "1", "rounds"), Field("silence_s", "float", "s", "if there was any"))


@experiment_function
def metrics(parameters, seed):
    return {"rounds": seed / 2} | ({"asked": 1} if seed == 2 else {})


@experiment_function
def observations(parameters, seed):
    return [{"rounds": robot} for robot in range(parameters["size"])]
"""


@pytest.fixture
def sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[str, Any]], Path]:
    """Return a function that sweeps a plain experiment, a part a run, and returns the folder of the results."""
    (tmp_path / "beacon.py").write_text((DATA / "beacon.py").read_text())
    (tmp_path / "counted.py").write_text(COUNTED)
    for name in ("beacon", "counted"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("cosim.sweep.BATCH_S", 0.0)

    def swept(plain: dict[str, Any]) -> Path:
        importlib.invalidate_caches()
        Path("sweep.yaml").write_text(yaml.safe_dump(plain, sort_keys=False))
        run_sweep(load_experiment("sweep.yaml"), tmp_path / "r", jobs=1)
        return tmp_path / "r"

    return swept


def test_every_part_of_a_sweep_has_the_metrics_of_all_of_its_arms(
    tmp_path: Path, sweep: Callable[[dict[str, Any]], Path], monkeypatch: pytest.MonkeyPatch
):
    seen: list[int] = []
    append = RunStore.append

    def appended(store: RunStore, *given: Any) -> None:
        append(store, *given)
        seen.append(len(schemas(store.folder / "runs")))

    monkeypatch.setattr(RunStore, "append", appended)
    folder = sweep(CALLS)
    assert seen == [1, 1, 1, 1]
    ((*fixed, axis, first, second, third, fourth, fifth), *others) = [
        schema[:16] for schema in schemas(folder / "runs")
    ]
    assert others == []
    assert (axis, first) == (("kind", "string"), ("simulated_s", "double"))
    assert {kind for _, kind in (first, second, third, fourth, fifth)} == {"double"}
    assert len(fixed) == 10
    assert "heard" in dict(schemas(folder / "runs")[0])


def test_an_axis_that_is_added_names_the_arms_that_were_there(sweep: Callable[[dict[str, Any]], Path]):
    sweep(CALLS)
    folder = sweep(CALLS | {"sweep": CALLS["sweep"] | {"protocol.parameters.calls": [2, 3]}})  # 3 by default
    frame = RunStore(folder).present()
    assert frame["calls"].tolist() == [2, 2, 3, 3] * 2
    assert frame["kind"].tolist() == ["ideal"] * 4 + ["optical"] * 4
    assert len(RunStore(folder).read()) == 8  # none was made again
    assert len(schemas(folder / "runs")) == 1
    assert len(list((folder / "runs").iterdir())) == 1  # merged


def test_a_metric_that_a_channel_does_not_declare_is_an_error_of_its_run(
    sweep: Callable[[dict[str, Any]], Path], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("cosim.channels.vision.OpticalChannel.summary", lambda channel: {"strange": 1.0})
    frame = RunStore(sweep(CALLS)).present()
    told = "LocalProtocolError: channel optical: summary returns 'strange', which is none of its metrics"
    assert frame["error"].fillna("").tolist() == ["", "", told, told]
    assert "strange" not in frame


@every_reader
def test_a_function_has_its_declared_columns_and_what_it_answers(
    sweep: Callable[[dict[str, Any]], Path], read: Callable[[Path], Rows]
):
    plain = {"name": "counted", "run": "counted:metrics", "parameters": {"size": 2}, "replicates": 3}
    folder = sweep(plain)
    (schema,) = schemas(folder / "runs")
    assert schema[10:] == [("rounds", "double"), ("silence_s", "double"), ("asked", "double")]
    sweep(plain | {"run": "counted:observations"})
    assert len(schemas(folder / "runs")) == 1
    (schema,) = schemas(folder / "observations")
    assert schema[4:] == [("rounds", "int64"), ("silence_s", "double")]
    rows = [row for row in in_order(read(folder / "runs")) if row["rounds"] is not None]
    assert [(row["rounds"], row["silence_s"], row["asked"]) for row in rows] == [
        (0.5, None, None),
        (1.0, None, 1.0),
        (1.5, None, None),
    ]
    assert [row["rounds"] for row in in_order(read(folder / "observations"))] == [0, 1] * 3
