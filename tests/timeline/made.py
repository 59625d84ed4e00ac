"""Traces that are made up, with all that lanes can hold, and the binary message of a window as a page would read it."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.channels.radios import with_radio
from cosim.machine import BROADCAST
from cosim.trace import FRAMES, INTERVALS, MESSAGES, RECEPTIONS, TRANSMISSIONS, WAKES, Table, Trace, events_table
from cosim.units import Time

ROBOTS = 4
KINDS = ("DM1", "DH5", "POLL", "ID")
FATES = (("received", ""), ("received", ""), ("received", ""), ("bit_errors", "payload"), ("collided", "header"))
STATES = ("inquiry", "scan", "link")
TABLES = (FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS, MESSAGES, WAKES)

Rows = dict[str, list[tuple[Any, ...]]]


def made_rows(seed: int, count: int, last: Time, radios: int = 1, older: bool = False) -> Rows:
    """Return rows of a run that lasts *last* ns, with *count* transmissions, in the order in which they would come.

    An *older* one has no tables but frames, messages, wakes and events.
    """
    stream = np.random.default_rng(seed)
    rows: Rows = {table.name: [] for table in (*TABLES, events_table(()))}
    for at in sorted(stream.integers(0, last, count).tolist()):
        source, kind = int(stream.integers(ROBOTS)), KINDS[stream.integers(len(KINDS))]
        to = int(stream.choice([robot for robot in (BROADCAST, *range(ROBOTS)) if robot != source]))
        duration, channel = int(stream.integers(1, last // 50)), int(stream.integers(-1, 3))
        more = (int(stream.integers(radios)),) if radios > 1 else ()
        whole = bool(stream.random() < 0.95)
        about = kind, to, 0, 0, False, False, whole, "c0ffee", duration, channel, 1, 3
        rows["transmissions"].append((at, source, *about, *more))
        for receiver in [to] if to != BROADCAST else [robot for robot in range(ROBOTS) if robot != source]:
            outcome, part = FATES[stream.integers(len(FATES))]
            rows["receptions"].append((at, source, receiver, -60.0, 12.5, outcome, part, *more))
            if to != BROADCAST or at % 3:  # some channels have one row of a frame for all
                rows["frames"].append((at, source, receiver, duration, kind, channel, 1, 3, outcome, part, *more))
        if to == BROADCAST and not at % 3:
            rows["frames"].append((at, source, to, duration, kind, channel, 1, 3, "received", "", *more))
        start, end = sorted(stream.integers(0, last, 2).tolist()) if at % 40 == 0 else (at, at + duration)
        robot = int(stream.integers(-1, ROBOTS))
        radio = -1 if robot < 0 else int(stream.integers(-1, radios))
        if end > start:
            rows["intervals"].append((start, robot, end, radio, STATES[at % len(STATES)], f"of={at}"))
        rows["messages"].append((at + duration, source, max(to, 0), False, "0a0b"))
        rows["wakes"].append((at, (source + 1) % ROBOTS))
        rows["events"].append((at, source, ("Met", "Found")[at % 2]))
    if older:
        for name in ("transmissions", "receptions", "intervals"):
            rows[name] = []
    rows["intervals"].sort(key=lambda row: row[2])  # a row comes when its interval is over
    return rows


def made_trace(rows: Rows, radios: int = 1, older: bool = False) -> Trace:
    """Return a trace of *rows*."""
    tables: Sequence[Table] = [*TABLES, events_table(())]
    if older:
        tables = [table for table in tables if rows[table.name]]
    trace = Trace(with_radio(tables) if radios > 1 else tables)
    for table in trace.tables.values():
        for row in rows[table.name]:
            trace.row(table, *row)
    return trace


def written(folder: Path, trace: Trace) -> Path:
    """Write *trace* to *folder*, and where robots are, and return the folder."""
    from cosim.trace import POSES

    trace.write(folder)
    poses = Trace([POSES])
    for robot in range(ROBOTS):
        poses.row(POSES, 0, robot, 0.0, 0.0, 0.0)
    poses.write(folder)
    return folder


class Box(NamedTuple):
    """A box, as a page is sent it; times in ns of the run."""

    start: int
    end: int
    kind: int
    outcome: int
    row: int
    peer: int


class Cell(NamedTuple):
    """A cell, as a page is sent it."""

    kind: int
    share: int
    lost: int
    count: int


class Read(NamedTuple):
    """A binary message."""

    number: int
    start: int
    step: int
    boxes: dict[int, list[Box]]
    cells: dict[int, list[Cell]]


def read(message: bytes) -> Read:
    """Return what a binary message says, read by the words of its documentation."""
    kind, number, lanes, _, start, step = struct.unpack_from("<IIIIqq", message)
    assert kind == 1
    at = 32
    boxes: dict[int, list[Box]] = {}
    cells: dict[int, list[Cell]] = {}

    def column(code: str, count: int) -> list[Any]:
        nonlocal at
        values = struct.unpack_from(f"<{count}{code}", message, at)
        assert at % 8 == 0
        at += -(-struct.calcsize(f"<{count}{code}") // 8) * 8
        return list(values)

    for _ in range(lanes):
        lane, form, count, _ = struct.unpack_from("<IIII", message, at)
        at += 16
        if form == 0:
            columns = [column(code, count) for code in "ddIHBh"]
            rows = zip(*columns, strict=True)
            boxes[lane] = [
                Box(start + int(begin), start + int(begin) + int(length), kind, outcome, row, peer)
                for begin, length, row, kind, outcome, peer in rows
            ]
        else:
            assert form == 1
            cells[lane] = [Cell(*row) for row in zip(*(column(code, count) for code in "HBBI"), strict=True)]
    assert at == len(message)
    return Read(number, start, step, boxes, cells)
