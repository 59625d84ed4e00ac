"""The lanes of a run in the trace-event format, which ui.perfetto.dev opens.

A process is a robot, or a station in the background, a thread a lane of it. Slices of one thread must nest: what
overlaps otherwise, such as two frames of different senders at one receiver, stands on a thread of its own beside it.
Times are microseconds of simulated time, exact to the nanosecond.
"""

import gzip
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final

from cosim import __version__
from cosim.export.lanes import HEARD, SENT, WHOLE, Lane, Sending, lanes, packet_names, sendings, with_names
from cosim.export.recording import Recording
from cosim.timeline.sensing import SENSED
from cosim.trace import drafted
from cosim.units import S, Time

Event = dict[str, Any]
"""One record of the file."""
_A_ROBOT: Final = 1000
"""Most threads of a process: a thread's number tells its process."""
_LEFT_OUT: Final = frozenset({"body", "payload", "time_ns", "start_ns", "end_ns", "duration_ns"})
"""Columns that are no arguments of a slice: what stands in it anyway, and bytes."""


def write_perfetto(recording: Recording, path: Path) -> int:
    """Write the lanes of *recording* to *path*, compressed if its name ends in .gz; return the number of slices."""
    slices = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    with drafted(path) as draft, draft.open("wb") as raw:
        zipped = path.suffix == ".gz"
        # without name and time in its head: the same run gives the same file
        file: IO[bytes] = gzip.GzipFile("", "wb", 6, raw, mtime=0) if zipped else raw  # type: ignore[assignment]
        told = {
            "cosim": __version__,
            "seed": recording.metadata.get("seed"),
            "digest": recording.metadata.get("digest"),
        }
        head = {"displayTimeUnit": "ns", "otherData": {"run": recording.title, **told}}
        file.write(json.dumps(head)[:-1].encode() + b', "traceEvents": [\n')
        for number, event in enumerate(events(recording)):
            slices += event["ph"] == "X"
            file.write((",\n" if number else "").encode() + json.dumps(event, separators=(",", ":")).encode())
        file.write(b"\n]}\n")
        if zipped:
            file.close()
    return slices


def events(recording: Recording) -> Iterator[Event]:
    """Yield the records: names, then slices, flows, instants and counters."""
    names = packet_names(recording, 0, recording.end + 1)
    found = [with_names(recording, lane, names) for lane in lanes(recording)]
    robots = sorted({lane.robot for lane in found} | set(recording.addresses), key=lambda robot: robot % (1 << 62))
    for rank, robot in enumerate(robots):
        yield _named("process_name", _process(robot), 0, name=recording.called(robot))
        yield _named("process_sort_index", _process(robot), 0, sort_index=rank)
    threads: Counter[int] = Counter()
    placed: dict[tuple[str, int], tuple[int, int]] = {}
    for lane in found:
        tracks = nested(lane.starts.tolist(), lane.ends.tolist())
        first = threads[lane.robot] + 1
        threads[lane.robot] += max(tracks) + 1
        process = _process(lane.robot)
        numbers = [_A_ROBOT * process + first + track for track in tracks]
        for track in range(max(tracks) + 1):
            thread = _A_ROBOT * process + first + track
            yield _named("thread_name", process, thread, name=lane.name + (f" ({track + 1})" if track else ""))
            yield _named("thread_sort_index", process, thread, sort_index=first + track)
        yield from _slices(lane, process, numbers, recording)
        if lane.what in (SENT, HEARD):
            box = zip(lane.rows.tolist(), numbers, strict=True)
            placed |= {(f"{lane.what} {lane.table}", row): (process, thread) for row, thread in box}
    yield from _flows(recording, placed)
    yield from _instants(recording)
    yield from _counters(recording)


def nested(starts: Sequence[Time], ends: Sequence[Time]) -> list[int]:
    """Return for each span, in the order of their starts, a track on which it overlaps with none that it is not in.

    Spans are placed on the first track that has room; of those that begin at once the longest comes first.
    """
    open_ends: list[list[Time]] = []
    tracks = [0] * len(starts)
    for at in sorted(range(len(starts)), key=lambda at: (starts[at], -ends[at])):
        track = next((each for each, stack in enumerate(open_ends) if _fits(stack, starts[at], ends[at])), None)
        if track is None:
            track = len(open_ends)
            open_ends.append([])
        open_ends[track].append(ends[at])
        tracks[at] = track
    return tracks


def _fits(stack: list[Time], start: Time, end: Time) -> bool:
    """Drop from *stack* what has ended, and return whether a span is within the innermost that is left, if any."""
    while stack and stack[-1] <= start:
        stack.pop()
    return not stack or stack[-1] >= end


def _process(robot: int) -> int:
    return robot + 1 if robot >= 0 else 1_000_000 - robot  # process 0 is the idle one of a computer


def _named(what: str, process: int, thread: int, **arguments: Any) -> Event:
    return {"ph": "M", "name": what, "pid": process, "tid": thread, "args": arguments}


def _slices(lane: Lane, process: int, threads: Sequence[int], recording: Recording) -> Iterator[Event]:
    rows = _arguments(recording, lane)
    boxes = zip(lane.starts.tolist(), lane.ends.tolist(), lane.kinds, lane.outcomes, threads, rows, strict=True)
    for start, end, kind, outcome, thread, arguments in boxes:
        yield {
            "ph": "X",
            "name": kind if outcome in WHOLE else f"{kind} {outcome}",
            "cat": lane.what if lane.what in SENSED else lane.table,  # its row is that of the frame it begins with
            "ts": start / 1000,
            "dur": (end - start) / 1000,
            "pid": process,
            "tid": thread,
            "args": arguments,
        }


def _arguments(recording: Recording, lane: Lane) -> Iterator[Mapping[str, Any]]:
    names = [name for name in recording.names(lane.table) if name not in _LEFT_OUT]
    columns = [recording.column(lane.table, name)[lane.rows].tolist() for name in names]
    for row in zip(*columns, strict=True):
        yield {name: value for name, value in zip(names, row, strict=True) if value not in ("", None)}


def _flows(recording: Recording, placed: Mapping[tuple[str, int], tuple[int, int]]) -> Iterator[Event]:
    """Yield an arrow from each transmission to each frame of it that a robot received, or was to receive."""
    by_key: dict[Sending, tuple[int, int]] = {}
    for table in ("frames", "transmissions"):
        for row, key in enumerate(sendings(recording, table)):
            where = placed.get((f"{SENT} {table}", row))
            if where is not None:
                by_key[key] = where
    number = 0
    for row, key in enumerate(sendings(recording, "frames")):
        sender, receiver = by_key.get(key), placed.get((f"{HEARD} frames", row))
        if sender is None or receiver is None:
            continue
        number += 1
        for phase, (process, thread), more in (("s", sender, {}), ("f", receiver, {"bp": "e"})):
            common = {"cat": "air", "name": "air", "id": number, "ts": key[0] / 1000}
            yield {"ph": phase, **common, "pid": process, "tid": thread, **more}


def _instants(recording: Recording) -> Iterator[Event]:
    for rank, table in enumerate(("events", "links", "unsent", "wakes")):
        named = set()
        for row in recording.rows(table):
            robot = row["source"]
            process, thread = _process(robot), _A_ROBOT * _process(robot) + _A_ROBOT - 4 + rank
            if robot not in named:
                named.add(robot)
                yield _named("thread_name", process, thread, name=table)
                yield _named("thread_sort_index", process, thread, sort_index=0)
            fixed = {*_LEFT_OUT, "source", "event"}
            arguments = {name: value for name, value in row.items() if value is not None and name not in fixed}
            name = row.get("event") or (f"unsent: {row['outcome']}" if table == "unsent" else "wake")
            common = {"cat": table, "ts": row["time_ns"] / 1000, "pid": process, "tid": thread, "s": "t"}
            yield {"ph": "i", "name": name, **common, "args": arguments}


def _counters(recording: Recording) -> Iterator[Event]:
    """Yield, for each robot and second, how many payloads have reached its machine, and how many frames were lost."""
    counts: dict[tuple[str, int], Counter[int]] = {}
    for row_time, robot in _pairs(recording, "messages", "source"):
        counts.setdefault(("payloads a second", robot), Counter())[row_time // S] += 1
    lost = (
        [outcome not in WHOLE for outcome in recording.column("frames", "outcome")] if recording.count("frames") else []
    )
    for (row_time, robot), gone in zip(_pairs(recording, "frames", "destination"), lost, strict=True):
        if gone and robot >= 0:
            counts.setdefault(("frames lost a second", robot), Counter())[row_time // S] += 1
    for (name, robot), seconds in sorted(counts.items()):
        for second in range(max(seconds) + 2):
            value = {"value": seconds[second]}
            yield {"ph": "C", "name": name, "ts": second * 1e6, "pid": _process(robot), "args": value}


def _pairs(recording: Recording, table: str, who: str) -> Iterator[tuple[Time, int]]:
    if recording.count(table):
        columns = (recording.column(table, name).tolist() for name in ("time_ns", who))
        yield from zip(*columns, strict=True)
