"""What sweeps keep: two tables of Parquet parts in one folder, written whole, so that nothing finished is ever lost.

    FOLDER/sweep.json                     what the last sweep into this folder was
    FOLDER/runs/part-....parquet          a row a run: axes, seed, digests, status, metrics
    FOLDER/observations/part-....parquet  a row for each thing that a run counts more than once

All parts of a table have the same columns (``cosim.parts``). A sweep resumes by the difference of sets: what is to run,
without the keys (configuration digest, seed, code digest) that are there.
"""

import hashlib
import importlib.util
import itertools
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from pydantic import Field as Setting

from cosim import __version__
from cosim.columns import array_of, columns_of_rows, columns_of_schema, conformed, kind_of, table_of, union
from cosim.documents import validated
from cosim.errors import UserError
from cosim.parts import Parts, fitting
from cosim.protocol import Metric
from cosim.settings import Count, PlainData, Settings
from cosim.trace import Field, arrow_field, drafted

if sys.platform == "win32":
    import msvcrt

    def _lock(file: int) -> None:
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(file: int) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


if TYPE_CHECKING:
    import pandas as pd

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

SEVERAL: Final = "several settings"
"""The meaning of an axis that is none of one setting."""

PACKAGES: Final = ("cosim", "protocols", "experiments")
_LIBRARIES: Final = ("simpy", "numpy", "numba", "scipy", "shapely", "networkx", "pydantic", "pyarrow")

_FIXED_OF: Final = {"runs": FIXED, "observations": OBSERVATION_FIXED}
"""The fixed columns of both tables."""


class ReportSettings(Settings):
    """What the report shows first."""

    metrics: tuple[str, ...] = Setting(default=(), description="columns of the table; all, if none are named")
    figures: tuple[str, ...] = Setting(default=(), description="those of them to draw; all, if none are named")
    x: str | None = Setting(
        default=None, description="the axis along the figures; the first one with numbers, if not named"
    )
    panel: str | None = Setting(default=None, description="the axis whose values get a panel each")


class AxisDescription(Settings):
    """An axis in a sweep.json."""

    path: str | None
    """None: each value is several settings."""
    values: tuple[PlainData, ...]


class SweepDescription(Settings):
    """A sweep.json: what the last sweep into a folder was."""

    experiment: str
    about: str = ""
    source: str
    """The sweep.yaml."""
    axes: dict[str, AxisDescription]
    replicates: Count = Setting(ge=1)
    report: ReportSettings
    configurations: tuple[str, ...]
    """Of the arms, in the order of the axes."""
    code: str


class RunStore:
    """The results in one folder: ``writing`` creates it, empty tables and all, and reading creates nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._parts = Parts(folder)
        self._columns: dict[str, list[Field]] = {}
        """Of the parts of each table, while they are being written."""

    @contextmanager
    def writing(self) -> Any:
        """Hold the folder for one writer: create it, clear away what a killed one left, refuse a second one."""
        for table in _FIXED_OF:
            (self.folder / table).mkdir(parents=True, exist_ok=True)
        lock = os.open(self.folder / ".lock", os.O_CREAT | os.O_RDWR, 0o644)
        try:
            _lock(lock)
        except (BlockingIOError, PermissionError):  # by POSIX, by Windows
            raise UserError(f"{self.folder}: another sweep is writing there, expected a folder of its own") from None
        else:
            self._parts.tidy()
            self._columns = {table: self._columns_of(table) for table in _FIXED_OF}
            yield self
        finally:
            os.close(lock)  # the kernel lets the lock go with it, also when the process is killed

    def done(self) -> set[Key]:
        """Return the keys of all rows that are there."""
        names = [field.name for field in KEY]
        tables = [self._parts.read(part, names) for part in self._parts.whole()]
        return {(row["configuration"], row["seed"], row["code"]) for table in tables for row in table.to_pylist()}

    def declare(self, runs: Sequence[Field] = (), observations: Sequence[Field] = ()) -> None:
        """Have all parts hold these columns after the fixed ones, then what else older parts hold; to be called first.

        Parts that are there and lack some of them, or hold them otherwise, are written anew.
        """
        for table, fields in (("runs", runs), ("observations", observations)):
            self._columns[table] = union(_FIXED_OF[table], fields, self._columns[table])
        self._parts.conform(self._columns)

    def append(
        self, runs: Sequence[Row], observations: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]
    ) -> None:
        """Write a batch of finished *runs* and their *observations*; *fields* describe columns that they have.

        A column that was not there before is added to all parts.
        """
        rows = {table: each for table, each in (("runs", runs), ("observations", observations)) if each}
        columns = self._columns | {
            table: union(_FIXED_OF[table], self._columns[table], columns_of_rows(each, fields))
            for table, each in rows.items()
        }
        if columns != self._columns:
            self._columns = columns
            self._parts.conform(self._columns)
        self._parts.add({table: table_of(each, columns[table], metadata) for table, each in rows.items()})

    def describe(self, description: SweepDescription) -> None:
        """Write down what the present sweep is."""
        with drafted(self.folder / "sweep.json") as draft:
            draft.write_text(json.dumps(description.model_dump(mode="json"), indent=2) + "\n", encoding="utf-8")

    def description(self) -> SweepDescription:
        """Return what the last sweep into this folder was; raise UserError if this is no such folder."""
        path = self.folder / "sweep.json"
        try:
            plain = json.loads(path.read_text(encoding="utf-8"))
            json.dumps(plain, ensure_ascii=False).encode()  # halves of surrogate pairs are no text
        except (OSError, ValueError, RecursionError):
            raise UserError(
                f"{self.folder}: holds no results, expected a folder that cosim sweep has written"
            ) from None
        return validated(SweepDescription, plain, str(path))

    def read(self, table: str = "runs") -> "pd.DataFrame":
        """Return all rows of *table* (``runs`` or ``observations``), of older configurations and code too.

        Raise UserError for a part that is damaged, as ``done`` and ``units`` do.
        """
        frame: pd.DataFrame = self.rows(table).to_pandas()
        return frame

    def present(self, table: str = "runs") -> "pd.DataFrame":
        """Return the rows of *table* that belong to the last sweep into this folder, in the order of its axes.

        Columns that none of them has a value in are left out.
        """
        frame: pd.DataFrame = self.present_rows(table).to_pandas()
        return frame

    def rows(self, table: str) -> Any:
        """Return what ``read`` returns as an Arrow table, with unit and meaning of each column."""
        return self._joined(table, lambda part: part)

    def present_rows(self, table: str) -> Any:
        """Return what ``present`` returns as an Arrow table, with unit and meaning of each column."""
        import pyarrow as pa
        import pyarrow.compute as pc

        told = self.description()
        arms = pa.array(told.configurations, pa.string())

        def belonging(part: Any) -> Any:
            ours = pc.and_(pc.is_in(part["configuration"], arms), pc.equal(part["code"], told.code))
            return part.filter(pc.and_(ours, pc.less(part["replicate"], told.replicates)))

        found = self._joined(table, belonging)
        ranks = {digest: rank for rank, digest in enumerate(told.configurations)}
        rank = pa.array([ranks[each] for each in found["configuration"].to_pylist()], pa.int64())
        order = pc.sort_indices(
            pa.table({"rank": rank, "replicate": found["replicate"]}),
            [("rank", "ascending"), ("replicate", "ascending")],
        )
        found = self._labelled(found.take(order), told, rank.take(order).to_pylist())
        fixed = {field.name for field in _FIXED_OF[table]}
        empty = [name for name in found.column_names if found[name].null_count == len(found) and name not in fixed]
        return found.drop_columns(empty if len(found) else [])

    def _labelled(self, table: Any, told: SweepDescription, ranks: Sequence[int]) -> Any:
        """Return *table*, its rows of the arms numbered *ranks*, with the arms' values of the axes as *told*.

        Rows that were made before there was an axis do not have its values, and a value that was a number became a text
        if another sweep into this folder had texts on an axis of that name.
        """
        import pyarrow as pa

        axes, configurations = told.axes, told.configurations
        if not len(configurations) == len(set(configurations)) == math.prod(len(axis.values) for axis in axes.values()):
            return table  # arms that are the same run: which of them a row belongs to only its own columns know
        arms = list(itertools.product(*(axis.values for axis in axes.values())))
        for number, (name, axis) in enumerate(axes.items()):
            field = Field(name, kind_of(axis.values), "", axis.path or SEVERAL, optional=True)
            there = name in table.column_names and table[name].null_count == 0
            if there and columns_of_schema(table.select([name]).schema)[0].kind == field.kind:
                continue
            try:
                values = array_of([arms[rank][number] for rank in ranks], field.kind)
            except (pa.ArrowException, KeyError, ValueError):  # such as no sweep has
                raise UserError(f"{self.folder / 'sweep.json'}: axes.{name}.values: are no values of an axis") from None
            place = table.column_names.index(name) if name in table.column_names else table.num_columns
            kept = table.drop_columns([name]) if name in table.column_names else table
            table = kept.add_column(place, arrow_field(field), values)
        return table

    def units(self) -> dict[str, tuple[str, str]]:
        """Return (unit, meaning) of every column of ``runs``."""
        schemas = [self._parts.read(part).schema for part in self._parts.whole()]
        described = [(field.name, field.metadata or {}) for schema in schemas for field in schema]
        return {name: (each.get(b"unit", b"").decode(), each.get(b"meaning", b"").decode()) for name, each in described}

    def _columns_of(self, table: str) -> list[Field]:
        """Return all columns of the parts of *table*."""
        schemas = (self._parts.schema(part) for part in self._parts.whole_of(table))
        return union(_FIXED_OF[table], *map(columns_of_schema, schemas))

    def _joined(self, table: str, chosen: Callable[[Any], Any]) -> Any:
        """Return the rows of all parts of *table* that *chosen* leaves of each, as an Arrow table."""
        import pyarrow as pa

        with fitting(self.folder / table):
            tables = [chosen(self._parts.read(part)) for part in self._parts.whole_of(table)]
            columns = union(_FIXED_OF[table], *(columns_of_schema(each.schema) for each in tables))
            empty = table_of([], columns, {})
            return pa.concat_tables([empty, *(conformed(each, columns).replace_schema_metadata() for each in tables)])


def metric_fields(metrics: Iterable[Metric]) -> list[Field]:
    """Return the columns of *metrics*: floats, empty where a run failed."""
    return [Field(metric.name, "float", metric.unit, metric.meaning, optional=True) for metric in metrics]


# ---------------------------------------------------------------- where results come from


def code_digest(packages: Iterable[str] = PACKAGES) -> str:
    """Return the SHA-256 of all Python sources of *packages* (or single modules): other code gives other results.

    What stands below another, such as ``protocols.mine``, is taken with all that stands beside it in its folder.
    """
    sources: dict[Path, str] = {}
    for name in sorted(set(packages)):
        for root, path in _sources(name):
            sources.setdefault(path, f"{name}/{path.relative_to(root).as_posix()}")
    result = hashlib.sha256()
    for path, called in sources.items():
        result.update(f"{called}\0".encode() + path.read_bytes() + b"\0")
    return result.hexdigest()


def _sources(name: str) -> list[tuple[Path, Path]]:
    spec = importlib.util.find_spec(name)
    if spec is None:
        return []
    roots = [Path(root) for root in spec.submodule_search_locations or ()]
    if "." in name:
        roots = [place.parent for place in roots or [Path(spec.origin or "")]]
    if roots:
        return [(root, path) for root in roots for path in sorted(root.rglob("*.py"))]
    return [(Path(spec.origin).parent, Path(spec.origin))] if spec.origin else []


def provenance() -> dict[str, str]:
    """Return the versions of the libraries and the commit of the sources, for the metadata of files."""
    return {f"version.{name}": version for name, version in versions().items()} | {"commit": _commit()}


def versions() -> dict[str, str]:
    """Return the versions of the program and of the libraries that decide results; empty where one is not there."""
    return {"cosim": __version__} | {name: _version(name) for name in _LIBRARIES}


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
