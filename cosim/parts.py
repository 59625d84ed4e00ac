"""The Parquet parts of the two tables that sweeps write: written whole, checked by their names, of one schema.

    FOLDER/runs/part-00000-RUNS-OBSERVATIONS.parquet          a row a run
    FOLDER/observations/part-00000-RUNS-OBSERVATIONS.parquet  a row for each thing that a run counts more than once

A part is one batch of finished runs and one row group. Its name tells the digests of the bytes of both files (of one,
where nothing was observed): a damaged part is noticed. (Parquet's own check sums leave out the schema and the metadata,
four fifths of a small part.) The observations of a batch are renamed into place before its runs: a run whose row is
there is there whole. Observations without runs (the process was killed in between) and runs whose observations are gone
are ignored and cleared away.

All parts of a table have one schema: any reader takes the folder as it is. When a column is added, or needs another
type, the parts that are there are written anew before anything else is. The name of such a part ends in ``-for-`` and
the digest of the name of the part that it replaces: while both are there (the process was killed in between) the old
one is ignored, and the next sweep clears it away.
"""

import hashlib
import io
import re
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from cosim.columns import conformed, schema_of
from cosim.errors import UserError
from cosim.trace import Field, drafted

TABLES: Final = ("runs", "observations")

_NAME: Final = re.compile(
    r"part-(?P<number>\d+)-(?P<runs>[0-9a-f]{16})(?:-(?P<observations>[0-9a-f]{16}))?"
    r"(?:-for-(?P<replaced>[0-9a-f]{16}))?\.parquet"
)
"""The name of a part: the digests of its runs, of its observations, and of the name of the part that it replaces.

Those of older programs tell none.
"""


class Parts:
    """The parts in one folder, whose folders ``runs`` and ``observations`` need not be there to look for them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def files(self, table: str) -> list[Path]:
        """Return the files of *table*, whole or not."""
        return sorted(part for part in (self.folder / table).glob("part-*.parquet") if part.is_file())

    def whole(self) -> list[Path]:
        """Return the parts of ``runs`` whose observations are there, if they had any, and which no other replaces."""
        there = {part.name for part in self.files("observations")}
        names = [(part, _NAME.fullmatch(part.name)) for part in self.files("runs")]
        whole = [(part, name) for part, name in names if not (name and name["observations"]) or part.name in there]
        replaced = {name["replaced"] for _, name in whole if name}
        return [part for part, _ in whole if _digest(part.name.encode()) not in replaced]

    def whole_of(self, table: str) -> list[Path]:
        """Return the files of *table* that belong to whole parts."""
        names = {part.name for part in self.whole()}
        return [part for part in self.files(table) if part.name in names]

    def tidy(self) -> None:
        """Clear away what a killed writer left."""
        whole = {part.name for part in self.whole()}
        drafts = [draft for table in (".", *TABLES) for draft in (self.folder / table).glob(".*.part")]
        halves = [part for table in TABLES for part in self.files(table) if part.name not in whole]
        for path in (*drafts, *halves):
            path.unlink()

    def read(self, part: Path, columns: Sequence[str] | None = None) -> Any:
        """Return the Arrow table in *part*; raise UserError if that is damaged."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        data = part.read_bytes()
        name = _NAME.fullmatch(part.name)
        digest = name and name[part.parent.name]
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

    def schema(self, part: Path) -> Any:
        """Return the Arrow schema of *part*; raise UserError if that cannot be read."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            return pq.read_schema(part)
        except (pa.ArrowException, OSError, UnicodeDecodeError):
            return self.read(part).schema  # or what is wrong

    def add(self, tables: Mapping[str, Any]) -> None:
        """Write a part, of the Arrow tables of one batch: runs, and observations if there are any."""
        self._write(tables, f"{len(self.files('runs')):05}")

    def conform(self, columns: Mapping[str, Sequence[Field]]) -> None:
        """Write those parts anew that have other columns than their tables are to have, and remove the old ones.

        Raise UserError for a part that is damaged, or that cannot have these columns.
        """
        schemas = {table: schema_of(fields) for table, fields in columns.items()}
        for part in self.whole():
            files = {table: self.folder / table / part.name for table in TABLES}
            files = {table: file for table, file in files.items() if file.is_file()}
            if all(self.schema(file).equals(schemas[table]) for table, file in files.items()):
                continue
            tables = {}
            for table, file in files.items():
                with fitting(file.parent):
                    tables[table] = conformed(self.read(file), columns[table])
            self._write(tables, part.name.split("-")[1], f"-for-{_digest(part.name.encode())}")
            for file in files.values():  # runs first: without them observations are nothing
                file.unlink()

    def _write(self, tables: Mapping[str, Any], number: str, ending: str = "") -> None:
        files = {table: _parquet(tables[table]) for table in TABLES if table in tables}
        name = f"part-{'-'.join((number, *map(_digest, files.values())))}{ending}.parquet"
        for table, data in reversed(files.items()):  # observations first: see above
            with drafted(self.folder / table / name) as draft:
                draft.write_bytes(data)


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


def _parquet(table: Any) -> bytes:
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(table, file)
    return file.getvalue()


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
