"""What sweeps keep: two tables of Parquet parts in one folder, written whole, so that nothing finished is ever lost.

    FOLDER/sweep.json                     what the last sweep into this folder was
    FOLDER/runs/part-....parquet          a row a run: axes, seed, digests, status, metrics
    FOLDER/observations/part-....parquet  a row for each thing that a run counts more than once

All parts of a table have the same columns (``cosim.parts``). A sweep resumes by the difference of sets: what is to run,
without the keys (configuration digest, seed, code digest) that are there.
"""

import functools
import hashlib
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
from time import time
from typing import TYPE_CHECKING, Any, Concatenate, Final, ParamSpec, Self, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import Field as Setting
from pydantic import model_validator

from cosim import __version__
from cosim.columns import array_of, columns_of_rows, columns_of_schema, conformed, kind_of, table_of, union
from cosim.documents import validated
from cosim.errors import UserError
from cosim.parts import KEY_NAMES, MINUTE_S, Key, Parts, fitting
from cosim.protocol import Metric
from cosim.settings import Count, PlainData, Seed, Settings
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
P = ParamSpec("P")
T = TypeVar("T")

KEY: Final = (
    Field("configuration", "str", "", "SHA-256 of the run's settings with all defaults"),
    Field("seed", "int", "", "seed of the run; all arms of a replicate share it"),
    Field("code", "str", "", "SHA-256 of what decides the run beside its settings: sources, data files, libraries"),
)
FIXED: Final = (
    Field("experiment", "str", "", "name of the experiment"),
    Field("replicate", "int", "", "number of the repetition, from 0"),
    *KEY,
    Field("libraries", "str", "", "versions of the libraries that compute", optional=True),
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

_LIBRARIES: Final = ("simpy", "numpy", "numba", "scipy", "shapely", "networkx", "pydantic", "pyarrow")

RUN: Final = ("configuration", "seed")
"""The columns that tell which run of a sweep a row belongs to: in an older sweep its replicate had another number."""
_FIXED_OF: Final = {"runs": FIXED, "observations": OBSERVATION_FIXED}
"""The fixed columns of both tables."""


_SEAL: Final = "sha256"
"""The name in a sweep.json of the SHA-256 of all else there: a damaged one must not tell of other runs."""


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
    given: tuple[str, ...] = ()
    """What ``--quick`` and ``--set`` have changed, as ``path=value``."""
    seed: Seed = 1
    """Of the first replicate."""
    configurations: tuple[str, ...]
    """Of the arms, in their order."""
    labels: tuple[tuple[PlainData, ...], ...] = ()
    """The values of the axes in each arm; in a sweep.json of an older program none: there it is the product of all."""
    codes: tuple[str, ...]
    """Of the arms."""
    libraries: dict[str, str] = Setting(default_factory=dict)
    """The versions of the libraries that compute, by code digest."""
    accepted: tuple[str, ...] = ()
    """Digests of older code whose rows count as well."""

    @model_validator(mode="before")
    @classmethod
    def _older(cls, plain: Any) -> Any:
        """Take the description of an older program, in which all arms had one code digest."""
        if isinstance(plain, dict) and "code" in plain and "codes" not in plain:
            plain = dict(plain)
            arms = plain.get("configurations")
            plain["codes"] = [plain.pop("code")] * (len(arms) if isinstance(arms, list | tuple) else 0)
        return plain

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.codes) != len(self.configurations):
            raise ValueError(f"has {len(self.configurations)} configurations, but {len(self.codes)} codes")
        if not self.labels:
            product = tuple(itertools.product(*(axis.values for axis in self.axes.values())))
            object.__setattr__(self, "labels", product)  # frozen
        if len(self.labels) != len(self.configurations) or any(len(each) != len(self.axes) for each in self.labels):
            raise ValueError(f"has {len(self.configurations)} configurations, but labels of {len(self.labels)} arms")
        return self

    @property
    def code(self) -> str:
        """The digests of the code of the arms, each once; for most sweeps that is one."""
        return ", ".join(dict.fromkeys(self.codes))

    @property
    def runs(self) -> int:
        """Number of rows that the sweep has when it is finished: arms with the same settings have a row each."""
        return len(self.configurations) * self.replicates


def _steady(read: "Callable[Concatenate[RunStore, P], T]") -> "Callable[Concatenate[RunStore, P], T]":
    """Have *read*, a method that reads parts, begin again where a sweep merges them meanwhile."""

    @functools.wraps(read)
    def again(store: "RunStore", /, *args: P.args, **named: P.kwargs) -> T:
        return store.parts.steady(lambda: read(store, *args, **named))

    return again


class RunStore:
    """The results in one folder: ``writing`` creates it, empty tables and all, and reading creates nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.parts = Parts(folder)
        self.columns: dict[str, list[Field]] = {}
        """Of the parts of each table, while they are being written."""
        self._merged_s = time()

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
            self.parts.tidy()
            self.columns = {table: self.columns_of(table) for table in _FIXED_OF}
            yield self
            self.parts.merge_minutes(self.columns)
        finally:
            os.close(lock)  # the kernel lets the lock go with it, also when the process is killed

    @_steady
    def done(self, told: SweepDescription) -> "npt.NDArray[np.bool_]":
        """Return for each arm and replicate of *told* whether its run is there: (arms, replicates)."""
        found = np.zeros((len(told.configurations), told.replicates), dtype=bool)
        arms = _arms_of(told)
        for part in self.parts.whole():
            for configuration, seed, code in self.parts.keys(part):
                for arm in arms.get(configuration, ()):
                    if 0 <= seed - told.seed < told.replicates and code in (told.codes[arm], *told.accepted):
                        found[arm, seed - told.seed] = True
        return found

    @_steady
    def values(self, told: SweepDescription, metric: str) -> dict[int, dict[int, float]]:
        """Return the values of *metric*, a column of ``runs``, by arm of *told* and replicate, NaN for none."""
        arms, chosen = _arms_of(told), self.chosen(told)
        found: dict[int, dict[int, float]] = {arm: {} for arm in range(len(told.configurations))}
        for part in self.parts.whole():
            there = metric in self.parts.schema(part).names
            rows = self.parts.read(part, [*RUN, "code", *([metric] if there else [])]).to_pylist()
            for row in rows:
                if chosen.get((row["configuration"], row["seed"])) == row["code"]:
                    value = row.get(metric)
                    for arm in arms[row["configuration"]]:
                        found[arm][row["seed"] - told.seed] = math.nan if value is None else float(value)
        return found

    @_steady
    def failed(self, told: SweepDescription) -> list[Row]:
        """Return those rows of *told* that tell of a failure, without their metrics: each once, also during a merge."""
        names = [field.name for field in FIXED]
        codes = {*told.codes, *told.accepted}
        rows = (row for part in self.parts.whole() for row in self._failures_in(part, names))
        arms = _arms_of(told)
        seeds = range(told.seed, told.seed + told.replicates)
        found: dict[Key, Row] = {}
        for row in rows:
            if row["configuration"] in arms and row["code"] in codes and row["seed"] in seeds:
                found.setdefault((row["configuration"], row["seed"], row["code"]), row)
        return list(found.values())

    def drop_failed(self, told: SweepDescription) -> None:
        """Remove the rows of *told* that tell of a failure, so that these runs are made again."""
        keys = {(row["configuration"], row["seed"], row["code"]) for row in self.failed(told)}
        if keys:
            self.parts.drop(keys, self.columns)

    @_steady
    def seconds_of_runs(self, told: SweepDescription) -> dict[int, float]:
        """Return how long a run of each arm of *told* takes on average, as far as any was made, by whatever code."""
        arms = _arms_of(told)
        taken: dict[int, list[float]] = {}
        for part in self.parts.whole():
            rows = self.parts.read(part, ["configuration", "wall_s", "status"]).to_pylist()
            for row in rows:
                for arm in arms.get(row["configuration"], ()) if row["status"] == "done" else ():
                    taken.setdefault(arm, []).append(row["wall_s"])
        return {arm: float(np.mean(each)) for arm, each in taken.items()}

    def is_being_written(self) -> bool:
        """Return whether a sweep is writing here."""
        try:
            lock = os.open(self.folder / ".lock", os.O_RDWR)
        except OSError:
            return False
        try:
            _lock(lock)
        except (BlockingIOError, PermissionError):
            return True
        finally:
            os.close(lock)
        return False

    def _failures_in(self, part: Path, names: Sequence[str]) -> list[Row]:
        import pyarrow.compute as pc

        there = [name for name in names if name in self.parts.schema(part).names]
        table = self.parts.read(part, there)
        found: list[Row] = table.filter(pc.equal(table["status"], "failed")).to_pylist()
        return found

    def declare(self, runs: Sequence[Field] = (), observations: Sequence[Field] = ()) -> None:
        """Have all parts hold these columns after the fixed ones, then what else older parts hold; to be called first.

        Parts that are there and lack some of them, or hold them otherwise, are written anew.
        """
        for table, fields in (("runs", runs), ("observations", observations)):
            self.columns[table] = union(_FIXED_OF[table], fields, self.columns[table])
        self.parts.conform(self.columns)

    def append(
        self, runs: Sequence[Row], observations: Sequence[Row], fields: Sequence[Field], metadata: Mapping[str, str]
    ) -> None:
        """Write a batch of finished *runs* and their *observations*; *fields* describe columns that they have.

        A column that was not there before is added to all parts.
        """
        rows = {table: each for table, each in (("runs", runs), ("observations", observations)) if each}
        columns = self.columns | {
            table: union(_FIXED_OF[table], self.columns[table], columns_of_rows(each, fields))
            for table, each in rows.items()
        }
        if columns != self.columns:
            self.columns = columns
            self.parts.conform(self.columns)
        self.parts.add({table: table_of(each, columns[table], metadata) for table, each in rows.items()})
        if time() // MINUTE_S > self._merged_s // MINUTE_S:
            self._merged_s = time()
            self.parts.merge_minutes(self.columns, self._merged_s)

    def describe(self, description: SweepDescription) -> None:
        """Write down what the present sweep is."""
        plain = json.loads(json.dumps(description.model_dump(mode="json")))  # all names are texts then
        with drafted(self.folder / "sweep.json") as draft:
            draft.write_text(json.dumps(plain | {_SEAL: _sealed(plain)}, indent=2) + "\n", encoding="utf-8")

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
        if isinstance(plain, dict) and plain.pop(_SEAL, None) not in (None, _sealed(plain)):  # older ones have none
            raise UserError(f"{path}: is not what was written there: sweep again")
        if isinstance(plain, dict) and "seed" not in plain:  # of an older program
            plain["seed"] = self._first_seed()
        return validated(SweepDescription, plain, str(path))

    @_steady
    def _first_seed(self) -> int:
        """Return the seed of the first replicate, by any row that is there."""
        for part in self.parts.whole():
            for row in self.parts.read(part, ["seed", "replicate"]).slice(0, 1).to_pylist():
                return int(row["seed"] - row["replicate"])
        return 1

    def read(self, table: str = "runs") -> "pd.DataFrame":
        """Return all rows of *table* (``runs`` or ``observations``), of older configurations and code too.

        Raise UserError for a part that is damaged, as ``done`` and ``units`` do.
        """
        frame: pd.DataFrame = self.rows(table).to_pandas(use_threads=False)
        return frame

    def present(self, table: str = "runs") -> "pd.DataFrame":
        """Return the rows of *table* that belong to the last sweep into this folder, in the order of its axes.

        Columns that none of them has a value in are left out.
        """
        frame: pd.DataFrame = self.present_rows(table).to_pandas(use_threads=False)
        return frame

    @_steady
    def rows(self, table: str) -> Any:
        """Return what ``read`` returns as an Arrow table, with unit and meaning of each column."""
        return self._joined(table, lambda part: part)

    @_steady
    def present_rows(self, table: str) -> Any:
        """Return what ``present`` returns as an Arrow table, with unit and meaning of each column."""
        import pyarrow as pa

        told = self.description()
        chosen = self.chosen(told)

        def belonging(part: Any) -> Any:
            keys = zip(*(part[name].to_pylist() for name in KEY_NAMES), strict=True)
            return part.filter(pa.array([chosen.get(key[:2]) == key[2] for key in keys], pa.bool_()))

        found = self._joined(table, belonging)
        places: dict[tuple[str, int], list[int]] = {}
        for place, key in enumerate(zip(*(found[name].to_pylist() for name in RUN), strict=True)):
            places.setdefault(key, []).append(place)
        order, ranks = [], []
        for arm, configuration in enumerate(told.configurations):
            for replicate in range(told.replicates):
                rows = places.get((configuration, told.seed + replicate), [])
                order += rows
                ranks += [arm] * len(rows)
        found = self._labelled(found.take(pa.array(order, pa.int64())), told, ranks)
        fixed = {field.name for field in _FIXED_OF[table]}
        empty = [name for name in found.column_names if found[name].null_count == len(found) and name not in fixed]
        return found.drop_columns(empty if len(found) else [])

    @_steady
    def chosen(self, told: SweepDescription) -> dict[tuple[str, int], str]:
        """Return which code's row counts for each configuration and seed of *told*: its own, or one accepted."""
        arms, seeds = _arms_of(told), range(told.seed, told.seed + told.replicates)
        found: dict[tuple[str, int], str] = {}
        for part in self.parts.whole():
            for configuration, seed, code in self.parts.keys(part):
                if configuration not in arms or seed not in seeds:
                    continue
                ranked = (told.codes[arms[configuration][0]], *told.accepted)
                best = found.get((configuration, seed))
                if code in ranked and (best is None or ranked.index(code) < ranked.index(best)):
                    found[configuration, seed] = code
        return found

    def _labelled(self, table: Any, told: SweepDescription, ranks: Sequence[int]) -> Any:
        """Return *table*, its rows of the arms numbered *ranks*, with replicates and values of the axes as *told*.

        Rows that were made before there was an axis do not have its values, a value that was a number became a text
        if another sweep into this folder had texts on an axis of that name, and arms with the same settings have one
        row on the disk.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        place = table.column_names.index("replicate")
        table = table.set_column(place, table.schema.field(place), pc.subtract(table["seed"], told.seed))
        for number, (name, axis) in enumerate(told.axes.items()):
            values = [arm[number] for arm in told.labels]
            field = Field(name, kind_of(values), "", axis.path or SEVERAL, optional=True)
            try:
                column = array_of([values[rank] for rank in ranks], field.kind)
            except (pa.ArrowException, KeyError, ValueError):  # such as no sweep has
                raise UserError(f"{self.folder / 'sweep.json'}: axes.{name}.values: are no values of an axis") from None
            place = table.column_names.index(name) if name in table.column_names else table.num_columns
            kept = table.drop_columns([name]) if name in table.column_names else table
            table = kept.add_column(place, arrow_field(field), column)
        return table

    @_steady
    def units(self) -> dict[str, tuple[str, str]]:
        """Return (unit, meaning) of every column of ``runs``."""
        schemas = [self.parts.read(part).schema for part in self.parts.whole()]
        described = [(field.name, field.metadata or {}) for schema in schemas for field in schema]
        return {name: (each.get(b"unit", b"").decode(), each.get(b"meaning", b"").decode()) for name, each in described}

    @_steady
    def columns_of(self, table: str) -> list[Field]:
        """Return all columns of the parts of *table*."""
        schemas = (self.parts.schema(part) for part in self.parts.whole_of(table))
        return union(_FIXED_OF[table], *map(columns_of_schema, schemas))

    def _joined(self, table: str, chosen: Callable[[Any], Any]) -> Any:
        """Return the rows of all parts of *table* that *chosen* leaves of each, as an Arrow table."""
        import pyarrow as pa

        with fitting(self.folder / table):
            tables = [chosen(each) for each in self.parts.tables(table)]
            columns = union(_FIXED_OF[table], *(columns_of_schema(each.schema) for each in tables))
            empty = table_of([], columns, {})
            return pa.concat_tables([empty, *(conformed(each, columns).replace_schema_metadata() for each in tables)])


def _sealed(plain: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def _arms_of(told: SweepDescription) -> dict[str, list[int]]:
    """Return the numbers of the arms with each configuration."""
    found: dict[str, list[int]] = {}
    for arm, configuration in enumerate(told.configurations):
        found.setdefault(configuration, []).append(arm)
    return found


def metric_fields(metrics: Iterable[Metric]) -> list[Field]:
    """Return the columns of *metrics*: floats, empty where a run failed."""
    return [Field(metric.name, "float", metric.unit, metric.meaning, optional=True) for metric in metrics]


# ---------------------------------------------------------------- where results come from


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
