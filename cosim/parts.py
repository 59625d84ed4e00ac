"""The Parquet parts of the two tables that sweeps write: written whole, checked by their names, of one schema.

    FOLDER/runs/part-00000-RUNS-OBSERVATIONS.parquet          a row a run
    FOLDER/observations/part-00000-RUNS-OBSERVATIONS.parquet  a row for each thing that a run counts more than once
    FOLDER/SHA256SUMS                                         the SHA-256 of each file, as sha256sum --check reads it

A part is a batch of finished runs and one row group. Its name tells the digests of the bytes of both files (of one,
where nothing was observed): a damaged part is noticed. (Parquet's own checksums, which are written too, leave out the
schema and the metadata, four fifths of a small part.) The observations of a batch are renamed into place before its
runs: a run whose row is there is there whole. Observations without runs (the process was killed in between) and runs
whose observations are gone are ignored and cleared away.

All parts of a table have one schema: any reader takes the folder as it is. When a column is added, or needs another
type, the parts that are there are written anew before anything else is. Parts of one minute are merged into one, or
into several of ``MOST_ROWS`` runs. In both cases the new part is on the disk before the old ones go: a run may be in
two parts if the process was killed in between, and the first counts.

Who reads while another process writes may find a part gone that was there: FileNotFoundError. ``Parts.steady`` looks
again; nothing is left out without a word.
"""

import hashlib
import io
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

from cosim.columns import conformed, schema_of
from cosim.errors import UserError
from cosim.trace import Field, drafted, sync_folder

TABLES: Final = ("runs", "observations")
MANIFEST: Final = "SHA256SUMS"
"""The file with the SHA-256 of all parts."""
Key: TypeAlias = tuple[str, int, str]
"""(configuration digest, seed, code digest)"""
KEY_NAMES: Final = ("configuration", "seed", "code")
"""The columns of a key."""
MINUTE_S: Final = 60.0
"""Parts that were written within the same such span are merged."""
MOST_ROWS: Final = 4000
"""Number of runs that parts are merged up to: a sweep looks at parts one by one, and so never holds more than that."""

TRIES: Final = 5
"""How often one reads parts that another process merges meanwhile; it does so once a minute."""
T = TypeVar("T")

_NAME: Final = re.compile(r"part-(?P<number>\d+)-(?P<runs>[0-9a-f]{16})(?:-(?P<observations>[0-9a-f]{16}))?\.parquet")
"""The name of a part: the digests of its runs and of its observations. Those of older programs tell none."""
_LISTED: Final = re.compile(r"(?P<digest>[0-9a-f]{64})  (?P<path>(?:runs|observations)/part-[\w-]+\.parquet)")
"""A line of the manifest."""


class Parts:
    """The parts in one folder, whose folders ``runs`` and ``observations`` need not be there to look for them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def files(self, table: str) -> list[Path]:
        """Return the files of *table*, whole or not."""
        return sorted(part for part in (self.folder / table).glob("part-*.parquet") if part.is_file())

    def whole(self) -> list[Path]:
        """Return the parts of ``runs`` whose observations are there, if they had any."""
        files = self._listing()
        there = {part.name for part in files["observations"]}
        return [part for part in files["runs"] if part.name in there or not _has_observations(part)]

    def _listing(self) -> dict[str, list[Path]]:
        """Return the files of each table as they are at one instant.

        A writer adds a merged part before it removes the old ones. Whoever lists in between may see neither, but not
        twice running.
        """
        before: dict[str, list[Path]] = {}
        while (files := {table: self.files(table) for table in TABLES}) != before:
            before = files
        return files

    def steady(self, read: Callable[[], T]) -> T:
        """Return what *read* returns of these parts, again from the start if another process removes one meanwhile.

        Raise UserError if that happens each time.
        """
        for _ in range(TRIES):
            with suppress(FileNotFoundError):
                return read()
        raise UserError(f"{self.folder}: parts went while they were read, {TRIES} times; is something removing them?")

    def whole_of(self, table: str) -> list[Path]:
        """Return the files of *table* that belong to whole parts."""
        return [self.folder / table / part.name for part in self.whole() if self._has(table, part)]

    def tidy(self) -> None:
        """Clear away what a killed writer left, and list what is there."""
        whole = {part.name for part in self.whole()}
        drafts = [draft for table in (".", *TABLES) for draft in (self.folder / table).glob(".*.part")]
        halves = [part for table in TABLES for part in self.files(table) if part.name not in whole]
        for path in (*drafts, *halves):
            path.unlink()
        self.remove(self._doubles())
        there = {f"{part.parent.name}/{part.name}": part for table in TABLES for part in self.files(table)}
        listed = self.listed()
        digests = {name: listed.get(name) or _digest(part.read_bytes()) for name, part in there.items()}
        if sorted(self._manifest().splitlines(keepends=True)) != _lines(digests):  # or its last line was cut short
            self._list(digests)

    def _doubles(self) -> list[Path]:
        """Return the parts whose runs are all in newer ones: they were to go when the writer was killed."""
        newer: set[int] = set()  # hashes: the keys of 100,000 runs would take 30 MB
        found = []
        for part in reversed(self.whole()):
            hashes = set(map(hash, self.keys(part)))
            if hashes <= newer:
                found.append(part)
            newer |= hashes
        return found

    # ------------------------------------------------------------ reading

    def read(self, part: Path, columns: Sequence[str] | None = None) -> Any:
        """Return the Arrow table in *part*; raise UserError if that is damaged."""
        import pyarrow.parquet as pq

        # a thread of Arrow's, as read_table starts one, aborts a process that ends while it is still at work
        how = {"pre_buffer": False, "page_checksum_verification": True}
        return self._checked(part, lambda file: pq.ParquetFile(file, **how).read(columns, use_threads=False))

    def schema(self, part: Path) -> Any:
        """Return the Arrow schema of *part*; raise UserError if that is damaged."""
        import pyarrow.parquet as pq

        return self._checked(part, pq.read_schema)

    def _checked(self, part: Path, read: Callable[[io.BytesIO], Any]) -> Any:
        """Return what *read* finds in the bytes of *part*, if they are those that were written."""
        import pyarrow as pa

        data = part.read_bytes()
        name = _NAME.fullmatch(part.name)
        digest = name and name[part.parent.name]
        # the bytes are in memory, so that an OSError is Arrow's
        with suppress(pa.ArrowException, OSError, UnicodeDecodeError):
            if digest in (None, _digest(data)[:16]):
                found = read(io.BytesIO(data))
                if len(getattr(found, "column_names", found)):
                    return found
        # the next sweep clears away observations without runs
        which = "it" if part.parent.name == "runs" else "the file of that name in runs"
        raise UserError(f"{part}: is not a whole Parquet file; delete {which} and sweep again") from None

    def keys(self, part: Path) -> list[Key]:
        """Return the keys of the runs in *part*, a file of ``runs``, row by row."""
        return _keys_of(self.read(part, list(KEY_NAMES)))

    def _rows(self, part: Path) -> int:
        """Return how many runs *part* holds; raise UserError if that is damaged."""
        return len(self.read(part, ["seed"]))

    def tables(self, table: str) -> Iterator[Any]:
        """Yield the rows of *table* part by part, as Arrow tables: those of each run once."""
        seen: set[Key] = set()
        for part in self.whole():
            keys = self.keys(part)
            new = set(keys) - seen
            if new and self._has(table, part):
                yield _only(self.read(self.folder / table / part.name), new, seen)
            seen |= new

    # ------------------------------------------------------------ writing

    def add(self, tables: Mapping[str, Any]) -> Path:
        """Write a part, of the Arrow tables of one batch: runs, and observations if there are any; return its runs."""
        files = {table: _parquet(tables[table]) for table in TABLES if table in tables}
        digests = {table: _digest(data) for table, data in files.items()}
        name = f"part-{self._next():05}-{'-'.join(digest[:16] for digest in digests.values())}.parquet"
        for table, data in reversed(files.items()):  # observations first: see above
            with drafted(self.folder / table / name, self.folder) as draft:
                draft.write_bytes(data)
        with (self.folder / MANIFEST).open("a", encoding="ascii") as manifest:
            manifest.writelines(f"{digest}  {table}/{name}\n" for table, digest in digests.items())
            manifest.flush()
            os.fsync(manifest.fileno())
        return self.folder / "runs" / name

    def merge(self, parts: Sequence[Path], columns: Mapping[str, Sequence[Field]], without: Iterable[Key] = ()) -> None:
        """Write *parts*, files of ``runs``, and their observations anew as one part with *columns*; remove the old.

        What has a key of *without* is left out.
        Raise UserError for a part that is damaged, or that cannot have these columns.
        """
        import pyarrow as pa

        tables: dict[str, list[Any]] = {table: [] for table in TABLES}
        seen: set[Key] = set(without)
        for part in parts:
            new = set(self.keys(part)) - seen
            for table in TABLES:
                file = self.folder / table / part.name
                if new and file.is_file():
                    with fitting(file.parent):
                        tables[table].append(conformed(_only(self.read(file), new, seen), columns[table]))
            seen |= new
        written = parts[-1].stat().st_mtime
        if not any(map(len, tables["runs"])):
            self.remove(parts)
            return
        joined = {table: pa.concat_tables(each) for table, each in tables.items() if table == "runs" or any(each)}
        merged = self.add(joined)
        os.utime(merged, (written, written))  # it is as old as what it holds
        self.remove([part for part in parts if part != merged])

    def _has(self, table: str, part: Path) -> bool:
        """Return whether *part*, a file of ``runs``, has one of *table*: as its name tells, if it is no older one."""
        return table == "runs" or _has_observations(part) or (self.folder / table / part.name).is_file()

    def take(self, others: "Parts", columns: Mapping[str, Sequence[Field]], there: set[Key]) -> None:
        """Add a part for each part of *others*, without rows whose keys are *there*; add their keys to those."""
        for part in others.whole():
            keys = others.keys(part)
            new = set(keys) - there
            tables = {}
            for table in TABLES:
                if new and others._has(table, part):
                    rows = _only(others.read(others.folder / table / part.name), new, there)
                    if table == "runs" or len(rows):
                        tables[table] = conformed(rows, columns[table])
            if tables:
                self.add(tables)
            there |= new

    def drop(self, keys: set[Key], columns: Mapping[str, Sequence[Field]]) -> None:
        """Remove all rows with one of *keys*."""
        for part in self.whole():
            if not keys.isdisjoint(self.keys(part)):
                self.merge([part], columns, keys)

    def conform(self, columns: Mapping[str, Sequence[Field]]) -> None:
        """Write those parts anew that have other columns than their tables are to have."""
        schemas = {table: schema_of(fields) for table, fields in columns.items()}

        def fits(part: Path) -> bool:
            files = {table: self.folder / table / part.name for table in TABLES}
            return all(self.schema(file).equals(schemas[table]) for table, file in files.items() if file.is_file())

        for parts in self._of_one_making(part for part in self.whole() if not fits(part)):
            self.merge(parts, columns)

    def merge_minutes(self, columns: Mapping[str, Sequence[Field]], before_s: float = float("inf")) -> None:
        """Merge the parts of each minute that ended before *before_s*, a time of the computer's clock."""
        import pyarrow as pa

        minutes: dict[float, list[Path]] = {}
        for part in self.whole():
            minutes.setdefault(part.stat().st_mtime // MINUTE_S, []).append(part)
        for minute, parts in minutes.items():
            if len(parts) > 1 and (minute + 1) * MINUTE_S <= before_s:
                for alike in self._of_one_making(parts):
                    for few in self._with_few_rows(alike):
                        if len(few) > 1:
                            self.merge(few, columns)
                            pa.default_memory_pool().release_unused()  # it would keep it for the rest of a sweep

    def _with_few_rows(self, parts: Iterable[Path]) -> Iterator[list[Path]]:
        """Yield *parts* in groups of consecutive ones that have ``MOST_ROWS`` runs together, or fewer."""
        group: list[Path] = []
        rows = 0
        for part in parts:
            more = self._rows(part)
            if group and rows + more > MOST_ROWS:
                yield group
                group, rows = [], 0
            group.append(part)
            rows += more
        if group:
            yield group

    def _of_one_making(self, parts: Iterable[Path]) -> list[list[Path]]:
        """Return *parts* in groups that tell the same of where they come from: settings, versions, commit."""
        groups: dict[frozenset[tuple[bytes, bytes]], list[Path]] = {}
        for part in parts:
            told = {name: text for name, text in (self.schema(part).metadata or {}).items() if name != b"ARROW:schema"}
            groups.setdefault(frozenset(told.items()), []).append(part)
        return list(groups.values())

    def remove(self, parts: Iterable[Path]) -> None:
        """Remove *parts*, files of ``runs``, with their observations."""
        names = {part.name for part in parts}
        if not names:
            return
        for table in TABLES:  # runs first: without them observations are nothing
            for name in names:
                (self.folder / table / name).unlink(missing_ok=True)
            sync_folder(self.folder / table)  # what was dropped comes back with no power cut
        self._list({path: digest for path, digest in self.listed().items() if Path(path).name not in names})

    def _next(self) -> int:
        """Return the number of the next part."""
        names = [_NAME.fullmatch(part.name) for part in self.files("runs")]
        return max((int(name["number"]) for name in names if name), default=-1) + 1

    # ------------------------------------------------------------ the manifest

    def listed(self) -> dict[str, str]:
        """Return what the manifest lists, the SHA-256 of each file by its path; lines without sense are nothing."""
        lines = map(_LISTED.fullmatch, self._manifest().splitlines())
        return {line["path"]: line["digest"] for line in lines if line}

    def damaged(self) -> list[str]:
        """Return a line for each file that is not what was written: changed, cut short, gone or half there."""
        listed, told = self.listed(), []
        there = {f"{part.parent.name}/{part.name}": part for table in TABLES for part in self.files(table)}
        whole = {part.name for part in self.whole()}
        for path, part in sorted(there.items()):
            if path in listed and _digest(part.read_bytes()) != listed[path]:
                told.append(f"{part}: is not what was written there")
                continue
            try:
                self.read(part)
            except UserError:
                told.append(f"{part}: is not a whole Parquet file")
                continue
            if part.name not in whole:
                told.append(f"{part}: its {'observations' if part.parent.name == 'runs' else 'runs'} are gone")
            elif path not in listed:
                told.append(f"{part}: is not listed in {MANIFEST}")
        return told + [f"{self.folder / path}: is gone" for path in sorted(listed.keys() - there.keys())]

    def _manifest(self) -> str:
        try:
            return (self.folder / MANIFEST).read_text(encoding="ascii", errors="replace")
        except FileNotFoundError:
            return ""

    def _list(self, digests: Mapping[str, str]) -> None:
        with drafted(self.folder / MANIFEST) as draft:
            draft.write_text("".join(_lines(digests)), "ascii")


def _has_observations(part: Path) -> bool:
    """Return whether the name of *part* tells of observations."""
    name = _NAME.fullmatch(part.name)
    return bool(name and name["observations"])


@contextmanager
def fitting(folder: Path) -> Any:
    """Raise UserError if the parts in *folder* do not fit together: in older ones other things had the same names."""
    import pyarrow as pa

    try:
        yield
    except UserError:  # of one part
        raise
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise UserError(f"{folder}: the parts do not fit together, expected a folder for each sweep: {error}") from None


def _keys_of(table: Any) -> list[Key]:
    """Return the key of each row of *table*; equal digests are one string: a sweep has few, and many rows of each."""
    shared: dict[str, str] = {}
    columns = [table[name].to_pylist() for name in KEY_NAMES]
    return [
        (shared.setdefault(configuration, configuration), seed, shared.setdefault(code, code))
        for configuration, seed, code in zip(*columns, strict=True)
    ]


def _only(table: Any, new: set[Key], seen: set[Key]) -> Any:
    """Return the rows of *table* whose keys are *new*: all, unless some are in *seen*."""
    keys = _keys_of(table) if seen else []
    if not seen or all(key in new for key in keys):
        return table
    return table.filter([key in new for key in keys])


def _parquet(table: Any) -> bytes:
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(table, file, write_page_checksum=True)
    return file.getvalue()


def _lines(digests: Mapping[str, str]) -> list[str]:
    """Return the lines of a manifest of *digests*, by path, sorted."""
    return sorted(f"{digest}  {path}\n" for path, digest in digests.items())


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
