"""The results of a sweep as one file, for other programs: Parquet with units and meanings, or CSV."""

from pathlib import Path
from typing import Any

from cosim.errors import UserError
from cosim.results import RunStore
from cosim.trace import drafted, write_parquet


def export_results(folder: Path, path: Path, table: str = "runs", everything: bool = False) -> int:
    """Write the rows of *table* of the last sweep into *folder* to *path*, and return their number.

    With *everything* those of older configurations and code too. Raise UserError if *folder* holds no results, or
    *path* ends in neither .parquet nor .csv.
    """
    write = {".parquet": write_parquet, ".csv": _write_csv}.get(path.suffix.lower())
    if write is None:
        raise UserError(f"{path}: expected a file that ends in .parquet or .csv")
    store = RunStore(folder)
    store.description()  # which only a folder of results has
    rows = store.rows(table) if everything else store.present_rows(table)
    path.parent.mkdir(parents=True, exist_ok=True)
    write(rows, path)
    return len(rows)


def _write_csv(table: Any, path: Path) -> None:
    from pyarrow import csv

    with drafted(path) as draft:
        csv.write_csv(table, draft)
