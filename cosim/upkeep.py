"""What folders of results hold, and how they are looked after: status, content, damage, merging and pruning."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from time import time
from typing import Any, Final, NamedTuple

from cosim.columns import union
from cosim.errors import UserError
from cosim.parts import TABLES, Key
from cosim.results import RUN, RunStore
from cosim.statistics.digits import digits

LATELY_S: Final = 300.0
"""Span over which ``status`` averages how fast runs are finished."""


class Status(NamedTuple):
    """How far a sweep is."""

    folder: Path
    experiment: str
    there: int
    runs: int
    failed: int
    running: bool
    rate_hz: float | None
    """Runs finished a second, lately; None if no sweep is running, or none has finished."""

    def text(self) -> str:
        """Return it as a line."""
        told = f"{self.folder}: {self.there} of {self.runs} runs"
        told += f", {self.failed} failed" if self.failed else ""
        told += "; a sweep is running" if self.running else ""
        if self.rate_hz:
            left = told_time((self.runs - self.there) / self.rate_hz)
            told += f", {self.rate_hz:.3g} runs/s, about {left} left"
        return told


class Content(NamedTuple):
    """What a folder of results holds."""

    status: Status
    octets: int
    files: int
    others: dict[tuple[str, str], int]
    """Rows that do not belong to the last sweep, by the code and the libraries that made them."""

    def text(self) -> str:
        """Return it as a line, and one for each code that made other rows."""
        lines = [f"{self.status.text()}; {self.octets / 1e6:.1f} MB in {self.files} files"]
        for (code, libraries), rows in self.others.items():
            lines.append(f"    {rows} rows of other settings or code: {code[:12]} {libraries}".rstrip())
        return "\n".join(lines)

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        others = [{"code": code, "libraries": made, "rows": rows} for (code, made), rows in self.others.items()]
        return {**self.status._asdict(), "octets": self.octets, "files": self.files, "others": others}


def told_time(seconds: float) -> str:
    """Return a time as a person says it: 40 s, 12 min, 5.5 h, 3 days."""
    units = (("s", 1.0, 120.0), ("min", 60.0, 7200.0), ("h", 3600.0, 172800.0), ("days", 86400.0, math.inf))
    unit, length = next((unit, length) for unit, length, most in units if seconds < most)
    return f"{digits(seconds / length, 2)} {unit}"


def code_of(store: RunStore, start: str) -> str:
    """Return the digest of the code that made rows here and begins with *start*; raise UserError if none does."""
    codes = sorted({key[2] for key in _keys(store)})
    found = [code for code in codes if code.startswith(start)]
    if len(found) != 1:
        known = ", ".join(code[:12] for code in codes) or "none"
        raise UserError(
            f"--accept-code: {start!r} begins {len(found) or 'no'} digests of code, expected one of {known}"
        )
    return found[0]


def status(store: RunStore) -> Status:
    """Return how far the last sweep into this folder is."""
    return store.parts.steady(lambda: _status(store))


def _status(store: RunStore) -> Status:
    told = store.description()
    there = int(store.done(told).sum())
    now = time()
    parts = [(part.stat().st_mtime, part) for part in store.parts.whole()]
    lately = [(written, part) for written, part in parts if now - written < LATELY_S]
    rate, running = None, store.is_being_written()
    if running and lately:
        rows = sum(len(store.parts.keys(part)) for _, part in lately)
        begun = max((written for written, _ in parts if now - written >= LATELY_S), default=min(lately)[0] - 1)
        rate = rows / max(1.0, now - max(begun, now - LATELY_S))  # a file server's clock may be ahead
    return Status(store.folder, told.experiment, there, told.runs, len(store.failed(told)), running, rate)


def content(store: RunStore) -> Content:
    """Return what this folder holds: of the last sweep, and of others."""
    return store.parts.steady(lambda: _content(store))


def _content(store: RunStore) -> Content:
    told = store.description()
    chosen = store.chosen(told)
    rows: dict[tuple[str, str], int] = {}
    seen: set[Key] = set()  # during a merge a run is in two parts
    for part in store.parts.whole():
        names = [name for name in ("code", "libraries") if name in store.parts.schema(part).names]
        columns = store.parts.read(part, [*RUN, *names])
        for row in columns.to_pylist():
            key = row["configuration"], row["seed"], row["code"]
            if chosen.get(key[:2]) != row["code"] and key not in seen:
                seen.add(key)
                made = row["code"], row.get("libraries") or ""
                rows[made] = rows.get(made, 0) + 1
    files = [part for table in TABLES for part in store.parts.files(table)]
    return Content(status(store), sum(part.stat().st_size for part in files), len(files), rows)


def damaged(store: RunStore) -> list[str]:
    """Return a line for each file that is not what was written.

    Raise UserError if this is no folder of results, or if a sweep is writing there: its files are half there.
    """
    store.description()
    if store.is_being_written():
        raise UserError(f"{store.folder}: a sweep is writing there: verify it when that has ended")
    return store.parts.damaged()


def merge(store: RunStore, others: Sequence[RunStore]) -> int:
    """Add the rows of *others*, which are of one sweep, to those here, and return how many are new.

    Raise UserError if they are of other sweeps, or made by other code or with other libraries.
    """
    told = [other.description() for other in others]
    for other, each in zip(others, told, strict=True):
        if (each.experiment, each.configurations) != (told[0].experiment, told[0].configurations):
            raise UserError(f"{other.folder}: is another sweep than {others[0].folder}: other settings or arms")
        if each.seed != told[0].seed:
            raise UserError(f"{other.folder}: is another sweep than {others[0].folder}: it begins with another seed")
        strange = {*each.codes} - {*told[0].codes, *told[0].accepted}
        if strange:
            theirs = "; ".join(sorted(each.libraries.get(code, "") for code in strange))
            raise UserError(f"{other.folder}: was made by other code, or with other libraries ({theirs})")
    if (store.folder / "sweep.json").is_file() and store.description().configurations != told[0].configurations:
        raise UserError(f"{store.folder}: holds another sweep, expected a folder of its own")
    with store.writing():
        most = max(each.replicates for each in told)
        store.describe(told[0].model_copy(update={"replicates": most}))
        columns = {table: union((), *(other.columns_of(table) for other in others)) for table in TABLES}
        store.declare(columns["runs"], columns["observations"])
        there = _keys(store)
        before = len(there)
        for other in others:
            other.parts.steady(partial(store.parts.take, other.parts, store.columns, there))
    return len(there) - before


def _keys(store: RunStore) -> set[Key]:
    """Return the keys of all rows."""
    return store.parts.steady(lambda: {key for part in store.parts.whole() for key in store.parts.keys(part)})


def prune(store: RunStore, dry_run: bool = False) -> int:
    """Remove the rows that do not belong to the last sweep, unless *dry_run*; return how many there are."""
    told = store.description()
    with store.writing():
        chosen = store.chosen(told)
        keys: set[Key] = set()
        for part in store.parts.whole():
            keys |= {key for key in store.parts.keys(part) if chosen.get(key[:2]) != key[2]}
        if keys and not dry_run:
            store.parts.drop(keys, store.columns)
    return len(keys)
