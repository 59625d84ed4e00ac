"""What sweeps keep: two tables of Parquet parts in one folder, written whole, so that nothing finished is ever lost.

    FOLDER/sweep.json                     what the last sweep into this folder was
    FOLDER/runs/part-00000-RUNS-OBSERVATIONS.parquet          a row a run: axes, seed, digests, status, metrics
    FOLDER/observations/part-00000-RUNS-OBSERVATIONS.parquet  a row for each thing that a run counts more than once

A part is one batch of finished runs and one row group. Its name tells the digests of the bytes of both files (of one,
where nothing was observed): a damaged part is noticed. (Parquet's own check sums leave out the schema and the metadata,
four fifths of a small part.) The observations of a batch are renamed into place before its runs: a run whose row is
there is there whole. Observations without runs (the process was killed in between) and runs whose observations are gone
are ignored and cleared away. A sweep resumes by the difference of sets: what is to run, without the keys (configuration
digest, seed, code digest) that are there.
"""

import hashlib
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from pydantic import Field as Setting

from cosim import __version__
from cosim.documents import validated
from cosim.errors import UserError
from cosim.protocol import Metric
from cosim.settings import Count, PlainData, Settings
from cosim.trace import Field, drafted

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

PACKAGES: Final = ("cosim", "protocols", "experiments")
_LIBRARIES: Final = ("simpy", "numpy", "numba", "scipy", "shapely", "networkx", "pydantic", "pyarrow")

_PART: Final = re.compile(r"part-\d+-([0-9a-f]{16})(?:-([0-9a-f]{16}))?\.parquet")
"""The name of a part: the digests of its runs and of its observations. Older parts tell none."""


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

    @contextmanager
    def writing(self) -> Any:
        """Hold the folder for one writer: create it, clear away what a killed one left, refuse a second one."""
        for table in ("runs", "observations"):
            (self.folder / table).mkdir(parents=True, exist_ok=True)
        lock = os.open(self.folder / ".lock", os.O_CREAT | os.O_RDWR, 0o644)
        try:
            _lock(lock)
        except (BlockingIOError, PermissionError):  # by POSIX, by Windows
            raise UserError(f"{self.folder}: another sweep is writing there, expected a folder of its own") from None
        else:
            self._tidy()
            yield self
        finally:
            os.close(lock)  # the kernel lets the lock go with it, also when the process is killed

    def done(self) -> set[Key]:
        """Return the keys of all rows that are there."""
        names = [field.name for field in KEY]
        tables = [self._table(part, names) for part in self._whole()]
        return {(row["configuration"], row["seed"], row["code"]) for table in tables for row in table.to_pylist()}

    def append(
        self, runs: Sequence[Row], observations: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]
    ) -> None:
        """Write a batch of finished *runs* and their *observations*; *fields* describe the columns beside the fixed."""
        files = {"runs": _parquet(runs, (*FIXED, *fields), metadata)}
        if observations:  # first: see above
            files = {"observations": _parquet(observations, (*OBSERVATION_FIXED, *fields), metadata)} | files
        digests = "-".join(_digest(files[table]) for table in ("runs", "observations") if table in files)
        name = f"part-{len(self._parts('runs')):05}-{digests}.parquet"
        for table, data in files.items():
            with drafted(self.folder / table / name) as draft:
                draft.write_bytes(data)

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
        return self._joined(table, lambda part: part)

    def present(self, table: str = "runs") -> "pd.DataFrame":
        """Return the rows of *table* that belong to the last sweep into this folder, in the order of its axes."""
        import pyarrow as pa
        import pyarrow.compute as pc

        told = self.description()
        arms = pa.array(told.configurations, pa.string())

        def belonging(part: Any) -> Any:
            ours = pc.and_(pc.is_in(part["configuration"], arms), pc.equal(part["code"], told.code))
            return part.filter(pc.and_(ours, pc.less(part["replicate"], told.replicates)))

        frame = self._joined(table, belonging)
        ranks = {digest: rank for rank, digest in enumerate(told.configurations)}
        rows = frame.assign(_rank=frame["configuration"].map(ranks))
        ordered: pd.DataFrame = (
            rows.sort_values(["_rank", "replicate"], kind="stable").drop(columns="_rank").reset_index(drop=True)
        )
        return ordered

    def units(self) -> dict[str, tuple[str, str]]:
        """Return (unit, meaning) of every column of ``runs``."""
        schemas = [self._table(part).schema for part in self._whole()]
        described = [(field.name, field.metadata or {}) for schema in schemas for field in schema]
        return {name: (each.get(b"unit", b"").decode(), each.get(b"meaning", b"").decode()) for name, each in described}

    def _joined(self, table: str, chosen: Callable[[Any], Any]) -> "pd.DataFrame":
        """Return the rows of all parts of *table* that *chosen* leaves of each."""
        import pandas as pd
        import pyarrow as pa

        names = {part.name for part in self._whole()}
        fixed = [field.name for field in (FIXED if table == "runs" else OBSERVATION_FIXED)]
        try:
            tables = [chosen(self._table(part)) for part in self._parts(table) if part.name in names]
            tables = [each for each in tables if each.num_rows] or tables[:1]
            joined = pa.concat_tables(tables, promote_options="permissive") if tables else None
        except (pa.ArrowException, KeyError) as error:  # older parts in which other things went by the same names
            raise UserError(
                f"{self.folder / table}: the parts do not fit together, expected a folder for each sweep: {error}"
            ) from None
        return pd.DataFrame(columns=fixed) if joined is None else joined.to_pandas()

    def _table(self, part: Path, columns: Sequence[str] | None = None) -> Any:
        """Return the table in *part*; raise UserError if that is damaged."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        data = part.read_bytes()
        name = _PART.fullmatch(part.name)
        digest = name and name[1 if part.parent.name == "runs" else 2]
        try:
            if digest in (None, _digest(data)):
                table = pq.read_table(io.BytesIO(data), columns=columns)
                if table.column_names:
                    return table
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            if isinstance(error, OSError) and error.errno is not None:  # the system's word, not Arrow's
                raise
        # the next sweep clears away observations without runs
        which = "it" if part.parent.name == "runs" else "the file of that name in runs"
        raise UserError(f"{part}: is not a whole Parquet file; delete {which} and sweep again") from None

    def _parts(self, table: str) -> list[Path]:
        return sorted(part for part in (self.folder / table).glob("part-*.parquet") if part.is_file())

    def _whole(self) -> list[Path]:
        """Return the parts of ``runs`` whose observations are there, if they had any."""
        there = {part.name for part in self._parts("observations")}
        names = [(part, _PART.fullmatch(part.name)) for part in self._parts("runs")]
        return [part for part, name in names if not (name and name[2]) or part.name in there]

    def _tidy(self) -> None:
        whole = {part.name for part in self._whole()}
        drafts = [draft for table in (".", "runs", "observations") for draft in (self.folder / table).glob(".*.part")]
        halves = [part for table in ("runs", "observations") for part in self._parts(table) if part.name not in whole]
        for path in (*drafts, *halves):
            path.unlink()


def metric_fields(metrics: Iterable[Metric]) -> list[Field]:
    """Return the columns of *metrics*: floats, empty where a run failed."""
    return [Field(metric.name, "float", metric.unit, metric.meaning, optional=True) for metric in metrics]


def _parquet(rows: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]) -> bytes:
    """Return *rows* as a Parquet file; *fields* describe their columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"int": pa.int64(), "float": pa.float64(), "str": pa.string(), "bool": pa.bool_(), "null": pa.null()}
    described = {field.name: field for field in fields}
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns, schema = [], []
    for name in [*(each for each in described if each in names), *(each for each in names if each not in described)]:
        values = [row.get(name) for row in rows]
        field = described.get(name) or Field(name, kind_of(values), "", "", optional=True)
        notes = {"unit": field.unit, "meaning": field.meaning}
        columns.append(pa.array(values, type=types[field.kind]))
        schema.append(pa.field(name, types[field.kind], field.optional, notes))
    file = io.BytesIO()
    pq.write_table(pa.table(columns, schema=pa.schema(schema, dict(metadata))), file)
    return file.getvalue()


def kind_of(values: Iterable[Any]) -> Any:
    """Return the kind of column that holds all *values*: bool, int, float, or else str; null if there are none."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds:
        return "null"
    if kinds <= {int, float}:
        return "float" if float in kinds else "int"
    return "bool" if kinds == {bool} else "str"


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


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
