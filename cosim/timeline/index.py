"""The lanes of a recorded run, kept in a folder beside its tables: made when the run is first opened, mapped later.

The folder holds the columns of all lanes one after the other, and of all their levels, as .npy files, and tells in
``index.json`` where each begins, and of what tables they were made: by the size and the time of each file. What does
not fit these is made anew. The folder is written whole and renamed; if that cannot be done, lanes are kept in memory.
"""

import ctypes
import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from cosim.errors import UserError
from cosim.timeline.assembly import Assembly, lost_codes
from cosim.timeline.codes import Codes, Named
from cosim.timeline.detail import Row
from cosim.timeline.lanes import DTYPES, Array, Boxes, Lane
from cosim.timeline.levels import ENTRY_DTYPES, Entries, Levels, levels_of
from cosim.timeline.radios import LOW_ENERGY, channel_of, parts_of
from cosim.timeline.rows import SOURCES, names_of
from cosim.timeline.sensing import SENSED_FROM, columns_of, radios_of, sensed
from cosim.trace import TRANSMISSIONS, TableFile
from cosim.units import Time

FOLDER: Final = "timeline"
FILE: Final = "index.json"
_HEADER_BYTES: Final = 128
"""Length of a .npy file without content, which cannot be mapped."""
FORMAT: Final = 4
"""Changes whenever what is written would be misread."""
Told = Callable[[int, int], None]
"""(what is done, all there is to do): what shows progress."""


class Index:
    """The lanes of a recorded run, and the codes of their boxes."""

    def __init__(self, lanes: list[Lane], codes: Codes) -> None:
        self.lanes = lanes
        self.codes = codes


def opened(
    folder: Path, told: Told = lambda done, total: None, say: Callable[[str], None] = lambda line: None
) -> Index:
    """Return the lanes of the trace in *folder*: those of its index, or made anew.

    *say* is told in a line why an index that is there is not used, or why none can be written.
    """
    stamp = stamp_of(folder)
    place = folder / FOLDER
    if place.is_dir():
        try:
            return read(place, stamp)
        except _UnfitError as error:
            say(f"{place}: {error}: made anew")
    index = made(folder, told)
    try:
        write(index, place, stamp)
    except OSError as error:
        say(f"{place}: cannot be written ({error.strerror or error}): the next opening takes as long")
        return index
    del index
    _give_back()
    return read(place, stamp)


def _give_back() -> None:
    """Have the C library give free memory back to the system, where it does: it keeps hundreds of megabytes."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


class _UnfitError(Exception):
    """An index is not one of the tables beside it, or is damaged."""


def stamp_of(folder: Path) -> dict[str, list[int]]:
    """Return size (B) and time of change (ns) of each table in *folder* that lanes are made of, by name."""
    paths = {table: folder / f"{table}.parquet" for table in SOURCES}
    return {
        table: [path.stat().st_size, path.stat().st_mtime_ns] for table, path in paths.items() if path.is_file()
    }  # fmt: skip


def made(folder: Path, told: Told = lambda done, total: None) -> Index:
    """Return the lanes of the tables in *folder*, in memory."""
    files = {table: TableFile(folder / f"{table}.parquet") for table in stamp_of(folder)}
    rows = sum(map(len, files.values()))
    total, done = 2 * rows, 0  # to read them, and to sum up their boxes
    metadata = next((file.metadata for file in files.values()), {})
    assembly = Assembly(parts_of(channel_of(metadata), LOW_ENERGY))
    for table in SOURCES:
        if table in files:
            first = 0
            for columns in files[table].groups(names_of(table, files[table].names)):
                assembly.add(table, columns, first)
                count = len(columns[SOURCES[table][0]])
                first, done = first + count, done + count
                told(done, total)
    lanes = assembly.lanes()
    if TRANSMISSIONS.name in files and (radios := radios_of(files[TRANSMISSIONS.name].metadata)):
        paths = {name: folder / f"{name}.parquet" for name in SENSED_FROM}
        tables = {name: columns_of(TableFile(path), name) for name, path in paths.items() if path.is_file()}
        more = sensed(tables, radios, assembly.codes, assembly.several)
        lanes = sorted([*lanes, *more], key=lambda lane: lane.named.place)
    lost = lost_codes(assembly.codes)
    boxes, summed = max(1, sum(len(lane.boxes.starts) for lane in lanes)), 0
    for lane in lanes:
        lane.levels = levels_of(lane.boxes, lost)
        summed += len(lane.boxes.starts)
        told(rows + rows * summed // boxes, total)
    return Index(lanes, assembly.codes)


def write(index: Index, place: Path, stamp: dict[str, list[int]]) -> None:
    """Write *index* to the folder *place*, whole."""
    draft = place.parent / f".{place.name}.{os.getpid()}.part"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    try:
        about = _about(index, stamp)
        _write_columns(draft, Boxes._fields, DTYPES, [lane.boxes for lane in index.lanes])
        levels = [level for lane in index.lanes if lane.levels is not None for level in lane.levels.levels]
        _write_columns(draft, [f"level_{name}" for name in Entries._fields], ENTRY_DTYPES, levels)
        about["sizes"] = {path.name: path.stat().st_size for path in sorted(draft.glob("*.npy"))}
        (draft / FILE).write_text(json.dumps(about), encoding="utf-8")
        shutil.rmtree(place, ignore_errors=True)
        draft.rename(place)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _about(index: Index, stamp: dict[str, list[int]]) -> dict[str, Any]:
    lanes = []
    for lane in index.lanes:
        levels = lane.levels
        known: dict[str, Any] = {"count": len(lane.boxes.starts), "longest": lane.longest, "disjoint": lane.disjoint}
        known |= {"named": list(lane.named), "table": lane.table}
        known |= {"lowest": levels.lowest, "levels": [len(each.cells) for each in levels.levels]} if levels else {}
        lanes.append(known)
    codes = {"kinds": index.codes.kinds, "outcomes": index.codes.outcomes}
    return {"format": FORMAT, "stamp": stamp, "lanes": lanes} | codes


def _write_columns(folder: Path, names: Any, dtypes: Any, parts: list[Any]) -> None:
    """Write a file for each column: those of all *parts*, one after the other."""
    total = sum(len(part[0]) for part in parts)
    for at, (name, dtype) in enumerate(zip(names, dtypes, strict=True)):
        with (folder / f"{name}.npy").open("wb") as file:
            header = {"descr": np.dtype(dtype).str, "fortran_order": False, "shape": (total,)}
            np.lib.format.write_array_header_1_0(file, header)
            for part in parts:
                np.ascontiguousarray(part[at], dtype=dtype).tofile(file)


def read(place: Path, stamp: dict[str, list[int]]) -> Index:
    """Return the index in the folder *place*, mapped."""
    try:
        about = json.loads((place / FILE).read_text(encoding="utf-8"))
        if about["format"] != FORMAT or about["stamp"] != stamp:
            raise _UnfitError("is not about the tables as they are")
        if any((place / name).stat().st_size != size for name, size in about["sizes"].items()):
            raise _UnfitError("is damaged")
        boxes = Boxes(
            *(_mapped(place / f"{name}.npy", dtype) for name, dtype in zip(Boxes._fields, DTYPES, strict=True))
        )
        names = zip(Entries._fields, ENTRY_DTYPES, strict=True)
        entries = Entries(*(_mapped(place / f"level_{name}.npy", dtype) for name, dtype in names))
        return _assembled(about, boxes, entries)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise _UnfitError("is damaged") from error


def _assembled(about: dict[str, Any], boxes: Boxes, entries: Entries) -> Index:
    lanes, at, level_at = [], 0, 0
    for known in about["lanes"]:
        own = boxes.taken(slice(at, at + known["count"]))
        at += known["count"]
        levels = []
        for count in known.get("levels", ()):
            levels.append(Entries(*(column[level_at : level_at + count] for column in entries)))
            level_at += count
        summed = Levels(known["lowest"], levels, known["count"]) if levels else None
        lanes.append(Lane(Named(*known["named"]), known["table"], own, known["longest"], known["disjoint"], summed))
    if at != len(boxes.starts) or level_at != len(entries.cells):
        raise _UnfitError("is damaged")
    return Index(lanes, Codes(about["kinds"], about["outcomes"]))


def _mapped(path: Path, dtype: Any) -> Array:
    array = np.load(path, mmap_mode="r" if path.stat().st_size > _HEADER_BYTES else None, allow_pickle=False)
    if array.dtype != dtype or array.ndim != 1:
        raise _UnfitError("is damaged")
    return np.asarray(array)  # a view without a memmap's costs


class Files:
    """Rows of the tables in a folder, which are read when they are asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[str, TableFile | None] = {}

    def row(self, table: str, number: int) -> Row:
        """Return the row of *table* with that *number*; raise UserError if there is none."""
        file = self._file(table)
        if file is None:
            raise UserError(f"{self._folder}: holds no {table}.parquet")
        return file.row(number)

    def at(self, table: str, time: Time) -> list[Row]:
        """Return the rows of *table* of that *time*."""
        file = self._file(table)
        return [] if file is None else [row for _, row in file.at(time)]

    def total(self, table: str, name: str, rows: Array) -> int:
        """Return the sum of the column *name* of *table*, of whole numbers, over the *rows* of these numbers."""
        file, found, begin = self._file(table), 0, 0
        if file is None or not len(rows):
            return 0
        wanted = np.zeros(len(file), dtype=bool)
        wanted[rows] = True
        for at, end in enumerate(file.ends):
            if wanted[begin:end].any():
                found += int(file.group(at, (name,))[name][wanted[begin:end]].sum())
            begin = end
        return found

    def _file(self, table: str) -> TableFile | None:
        if table not in self._files:
            path = self._folder / f"{table}.parquet"
            self._files[table] = TableFile(path) if path.is_file() else None
        return self._files[table]
