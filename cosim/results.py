"""What sweeps keep: two tables of Parquet parts in one folder, written whole, so that nothing finished is ever lost.

    FOLDER/sweep.json                     what the last sweep into this folder was
    FOLDER/runs/part-00000-1f0c9a2b.parquet          a row a run: axes, seed, digests, status, metrics
    FOLDER/observations/part-00000-1f0c9a2b.parquet  a row for each thing that a run counts more than once

A part is one batch of finished runs and one row group. The observations of a batch are renamed into place before its
runs: a run whose row is there is there whole, and observations without runs (the process was killed in between) are
ignored and cleared away. A sweep resumes by the difference of sets: what is to run, without the keys (configuration
digest, seed, code digest) that are there.
"""

import fcntl
import hashlib
import importlib.util
import json
import os
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, TypeAlias

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from cosim.errors import UserError
from cosim.protocol import Metric
from cosim.trace import Field, write_parquet

Row: TypeAlias = dict[str, Any]
Key: TypeAlias = tuple[str, int, str]
"""(configuration digest, seed, code digest)"""

KEY: Final = (
    Field("configuration", "str", "", "SHA-256 of the run's settings with all defaults"),
    Field("seed", "int", "", "seed of the run; all arms of a replicate share it"),
    Field("code", "str", "", "SHA-256 of the program's sources"),
)
FIXED: Final = (
    Field("experiment", "str", "", "name of the experiment"),
    Field("replicate", "int", "", "number of the repetition, from 0"),
    *KEY,
    Field("status", "str", "", "done, or failed"),
    Field("error", "str", "", "what went wrong, in one line", optional=True),
    Field("wall_s", "float", "s", "time that the run took on the computer"),
    Field(
        "digest",
        "str",
        "",
        "SHA-256 of the run's metrics and of the protocol's events, or of the function's answer",
        optional=True,
    ),
)
"""The columns of ``runs`` that every sweep has; its axes and its metrics follow."""
OBSERVATION_FIXED: Final = (*KEY, Field("replicate", "int", "", "number of the repetition, from 0"))
"""The columns of ``observations`` that every sweep has; its axes and what it observes follow."""

PACKAGES: Final = ("cosim", "protocols", "experiments")
_LIBRARIES: Final = ("cosim", "simpy", "numpy", "numba", "scipy", "shapely", "networkx", "pydantic", "pyarrow")


class RunStore:
    """The results in one folder: ``writing`` creates it, empty tables and all, and reading creates nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def writing(self) -> Any:
        """Hold the folder for one writer: create it, clear away what a killed one left, refuse a second one."""
        for table in ("runs", "observations"):
            (self.folder / table).mkdir(parents=True, exist_ok=True)
        lock = os.open(self.folder / ".lock", os.O_CREAT | os.O_RDWR, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"{self.folder}: another sweep is writing there, expected a folder of its own") from None
        else:
            self._tidy()
            yield self
        finally:
            os.close(lock)  # the kernel lets the lock go with it, also when the process is killed

    def done(self) -> set[Key]:
        """Return the keys of all rows that are there."""
        names = [field.name for field in KEY]
        tables = [self._whole(pq.read_table, part, columns=names) for part in self._parts("runs")]
        return {(row["configuration"], row["seed"], row["code"]) for table in tables for row in table.to_pylist()}

    def append(
        self, runs: Sequence[Row], observations: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]
    ) -> None:
        """Write a batch of finished *runs* and their *observations*; *fields* describe the columns beside the fixed."""
        name = f"part-{len(self._parts('runs')):05}-{_short_digest(runs)}.parquet"
        if observations:
            write_parquet(
                _table(observations, (*OBSERVATION_FIXED, *fields), metadata), self.folder / "observations" / name
            )
        write_parquet(_table(runs, (*FIXED, *fields), metadata), self.folder / "runs" / name)

    def describe(self, description: Mapping[str, Any]) -> None:
        """Write down what the present sweep is."""
        path = self.folder / "sweep.json"
        draft = path.with_name(f".{path.name}.part")
        try:
            draft.write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8")
            draft.replace(path)
        except BaseException:
            draft.unlink(missing_ok=True)
            raise

    def description(self) -> dict[str, Any]:
        """Return what the last sweep into this folder was; raise UserError if this is no such folder."""
        path = self.folder / "sweep.json"
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            raise UserError(
                f"{self.folder}: holds no results, expected a folder that cosim sweep has written"
            ) from None

    def read(self, table: str = "runs") -> pd.DataFrame:
        """Return all rows of *table* (``runs`` or ``observations``), of older configurations and code too.

        Raise UserError for a part that is damaged, as ``done`` and ``units`` do.
        """
        whole = {part.name for part in self._parts("runs")}
        parts = [self._whole(pq.read_table, part) for part in self._parts(table) if part.name in whole]
        if not parts:
            return pd.DataFrame(columns=[field.name for field in (FIXED if table == "runs" else OBSERVATION_FIXED)])
        frame: pd.DataFrame = pa.concat_tables(parts, promote_options="permissive").to_pandas()
        return frame

    def present(self, table: str = "runs") -> pd.DataFrame:
        """Return the rows of *table* that belong to the last sweep into this folder, in the order of its axes."""
        told = self.description()
        frame = self.read(table)
        wanted = frame["configuration"].isin(told["configurations"]) & (frame["code"] == told["code"])
        wanted &= frame["replicate"] < told["replicates"]
        ranks = {digest: rank for rank, digest in enumerate(told["configurations"])}
        rows = frame[wanted].assign(_rank=frame["configuration"].map(ranks))
        ordered: pd.DataFrame = (
            rows.sort_values(["_rank", "replicate"], kind="stable").drop(columns="_rank").reset_index(drop=True)
        )
        return ordered

    def units(self) -> dict[str, tuple[str, str]]:
        """Return (unit, meaning) of every column of ``runs``."""
        schemas = [self._whole(pq.read_schema, part) for part in self._parts("runs")]
        described = [(field.name, field.metadata or {}) for schema in schemas for field in schema]
        return {name: (each.get(b"unit", b"").decode(), each.get(b"meaning", b"").decode()) for name, each in described}

    def _whole(self, read: Callable[..., Any], part: Path, **how: Any) -> Any:
        """Return what *read* finds in *part*; raise UserError if that is damaged."""
        try:
            return read(part, **how)
        except (pa.ArrowException, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # the system's word, not Arrow's
                raise
        runs = self.folder / "runs" / part.name  # the next sweep clears away observations without runs
        raise UserError(
            f"{part}: is not a whole Parquet file; delete {'it' if part == runs else runs} and sweep again"
        ) from None

    def _parts(self, table: str) -> list[Path]:
        return sorted((self.folder / table).glob("part-*.parquet"))

    def _tidy(self) -> None:
        whole = {part.name for part in self._parts("runs")}
        drafts = [draft for table in (".", "runs", "observations") for draft in (self.folder / table).glob(".*.part")]
        orphans = [part for part in self._parts("observations") if part.name not in whole]
        for path in (*drafts, *orphans):
            path.unlink()


def metric_fields(metrics: Iterable[Metric]) -> list[Field]:
    """Return the columns of *metrics*: floats, empty where a run failed."""
    return [Field(metric.name, "float", metric.unit, metric.meaning, optional=True) for metric in metrics]


_TYPES: Final = {"int": pa.int64(), "float": pa.float64(), "str": pa.string(), "bool": pa.bool_(), "null": pa.null()}


def _table(rows: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]) -> Any:
    described = {field.name: field for field in fields}
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns, schema = [], []
    for name in [*(each for each in described if each in names), *(each for each in names if each not in described)]:
        values = [row.get(name) for row in rows]
        field = described.get(name) or Field(name, kind_of(values), "", "", optional=True)
        notes = {"unit": field.unit, "meaning": field.meaning}
        columns.append(pa.array(values, type=_TYPES[field.kind]))
        schema.append(pa.field(name, _TYPES[field.kind], field.optional, notes))
    return pa.table(columns, schema=pa.schema(schema, dict(metadata)))


def kind_of(values: Iterable[Any]) -> Any:
    """Return the kind of column that holds all *values*: bool, int, float, or else str; null if there are none."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return "null"
    if kinds <= {int, float}:
        return "float" if float in kinds else "int"
    return "bool" if kinds == {bool} else "str"


def _short_digest(rows: Sequence[Row]) -> str:
    return hashlib.sha256(json.dumps(rows, sort_keys=True, default=str).encode()).hexdigest()[:8]


# ---------------------------------------------------------------- where results come from


def code_digest(packages: Iterable[str] = PACKAGES) -> str:
    """Return the SHA-256 of all Python sources of *packages* (or single modules): other code gives other results."""
    result = hashlib.sha256()
    for name in sorted(set(packages)):
        for root, path in _sources(name):
            result.update(f"{name}/{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return result.hexdigest()


def _sources(name: str) -> list[tuple[Path, Path]]:
    spec = importlib.util.find_spec(name)
    if spec is None:
        return []
    roots = [Path(root) for root in spec.submodule_search_locations or ()]
    if roots:
        return [(root, path) for root in roots for path in sorted(root.rglob("*.py"))]
    return [(Path(spec.origin).parent, Path(spec.origin))] if spec.origin else []


def provenance() -> dict[str, str]:
    """Return the versions of the libraries and the commit of the sources, for the metadata of files."""
    return {f"version.{name}": version for name, version in versions().items()} | {"commit": _commit()}


def versions() -> dict[str, str]:
    """Return the versions of the libraries that decide results; empty where one is not installed."""
    return {name: _version(name) for name in _LIBRARIES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """Return the commit of the checkout that this code runs from, with ``+`` if files differ; empty without one."""
    here = Path(__file__).parent
    try:
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=True)
        state = subprocess.run(["git", "status", "--porcelain"], cwd=here, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return head.stdout.strip() + ("+" if state.stdout.strip() else "")
