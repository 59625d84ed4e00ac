"""What the timeline of a long run costs: a trace of ten million rows is made up, and opened as ``cosim view`` does.

    python -m benchmarks.timeline [--rows N] [--folder DIR]

Rows are frames, transmissions, intervals, messages and events of 20 robots; as many receptions as frames come on top.
Told are: seconds to open the trace first, when its index is made, and later; from the start of a process to its first
complete answer; the private memory of that process; and how long windows, boxes and searches take. Nothing here
asserts anything: a bound is what the figure was meant to keep, and a figure beyond it is marked.
"""

import argparse
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median, quantiles
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cosim.intervals import STATES
from cosim.timeline.index import FOLDER
from cosim.trace import (
    FRAMES,
    GROUP_ROWS,
    INTERVALS,
    MESSAGES,
    POSES,
    RECEPTIONS,
    TRANSMISSIONS,
    TableFile,
    arrow_field,
    events_table,
    write_parquet,
)
from cosim.trace import Table as Schema
from cosim.units import SLOT, S
from cosim.web.recorded import Recorded
from cosim.web.timeline import AskBox, AskNext, AskWindow

ROBOTS = 20
SHARES = {FRAMES.name: 0.5, TRANSMISSIONS.name: 0.33, INTERVALS.name: 0.12, MESSAGES.name: 0.04, "events": 0.01}
KINDS = ("DM1", "DM3", "DH5", "POLL", "NULL", "ID", "FHS")
SLOTS = (1, 3, 5, 1, 1, 1, 1)
WINDOWS = 200
PIXELS = 1900
MOST_SHOWN = 200
_EVENTS = events_table(())


def make(folder: Path, rows: int) -> None:
    """Write the tables of a made-up run with *rows* rows to *folder*."""
    stream = np.random.default_rng(1)
    counts = {name: int(rows * share) for name, share in SHARES.items()}
    sent = _transmissions(stream, counts[TRANSMISSIONS.name])
    last = int(sent["time_ns"][-1]) + S
    _write(folder, TRANSMISSIONS, sent)
    frames = _frames(stream, sent, counts[FRAMES.name])
    _write(folder, FRAMES, frames)
    heard = {"receiver": frames["destination"], "power_dbm": -40 - 40 * stream.random(len(frames["kind"]))}
    _write(folder, RECEPTIONS, frames | heard | {"sinr_db": heard["power_dbm"] + 90})
    _write(folder, INTERVALS, _intervals(stream, counts[INTERVALS.name], last))
    for table in (MESSAGES, _EVENTS):
        count = counts[table.name]
        columns = {"time_ns": np.sort(stream.integers(0, last, count)), "source": stream.integers(0, ROBOTS, count)}
        more = {"sender": stream.integers(0, ROBOTS, count), "event": np.array(["Met", "Found"])[np.arange(count) % 2]}
        _write(folder, table, columns | more | {"payload": np.full(count, "0a0b0c0d0e0f")})
    ticks = np.repeat(np.arange(0, last, max(S, last // 20_000)), ROBOTS)
    _write(folder, POSES, {"time_ns": ticks, "source": np.arange(len(ticks)) % ROBOTS})


def _transmissions(stream: np.random.Generator, count: int) -> dict[str, Any]:
    each = count // ROBOTS
    times, sources, kinds = [], [], []
    for robot in range(ROBOTS):
        gaps = 6 + stream.geometric(0.2, each) + 800 * (stream.random(each) < 0.001)
        times.append(np.cumsum(gaps) * SLOT + robot * 7919)
        sources.append(np.full(each, robot))
        kinds.append(stream.integers(0, len(KINDS), each))
    start = np.concatenate(times)
    order = np.argsort(start, kind="stable")
    kind = np.concatenate(kinds)[order]
    return {
        "time_ns": start[order],
        "source": np.concatenate(sources)[order],
        "kind": np.array(KINDS)[kind],
        "destination": stream.integers(0, ROBOTS, len(kind)),
        "duration_ns": np.array(SLOTS)[kind] * SLOT - 259_000,
        "channel": stream.integers(0, 79, len(kind)),
        "lt_addr": stream.integers(1, 8, len(kind)),
        "length": stream.integers(0, 340, len(kind)),
        "whole": np.ones(len(kind), dtype=bool),
        "body": np.array(["00" * 30, "ff" * 60])[kind % 2],
    }


def _frames(stream: np.random.Generator, sent: dict[str, Any], count: int) -> dict[str, Any]:
    which = np.sort(stream.integers(0, len(sent["time_ns"]), count))
    frames = {name: column[which] for name, column in sent.items()}
    frames["destination"] = stream.integers(0, ROBOTS, count)
    lost = stream.random(count) < 0.05
    part = stream.integers(0, 3, count)
    frames["outcome"] = np.where(lost, np.where(part, "bit_errors", "collided"), "received")
    frames["part"] = np.where(lost, np.array(["access_code", "header", "payload"])[part], "")
    return frames


def _intervals(stream: np.random.Generator, count: int, last: int) -> dict[str, Any]:
    start = np.sort(stream.integers(0, last, count))
    length = stream.exponential(last * ROBOTS / count, count).astype(np.int64) + 1
    states = np.array(list(STATES))
    columns = {"start_ns": start, "end_ns": start + length, "robot": stream.integers(0, ROBOTS, count)}
    return columns | {"state": states[stream.integers(0, len(states), count)]}


def _write(folder: Path, table: Schema, columns: dict[str, Any]) -> None:
    """Write *table*; what is not among *columns* is nothing of its kind."""
    import pyarrow as pa

    count = len(next(iter(columns.values())))
    nothing = {"int": 0, "float": 0.0, "str": "", "bool": False}
    arrays = [
        pa.array(columns[field.name] if field.name in columns else np.full(count, nothing[field.kind]))
        for field in table.fields
    ]
    schema = pa.schema([arrow_field(field) for field in table.fields])
    write_parquet(pa.table(arrays, names=schema.names).cast(schema), folder / f"{table.name}.parquet", GROUP_ROWS)


def private_mb() -> float:
    """Return the private memory of this process, MB: pages that no file backs."""
    text = Path("/proc/self/smaps_rollup").read_text(encoding="utf-8")
    return sum(int(line.split()[1]) for line in text.splitlines() if line.startswith("Anonymous:")) / 1024


def question(number: int, lanes: Sequence[int], start: int, length: int) -> AskWindow:
    """Return what a page asks about the window of *length* ns from *start*."""
    step = max(1, length // PIXELS)
    span = {"from_ns": str(start), "to_ns": str(start + length), "step_ns": str(step)}
    return AskWindow(say="window", number=number, lanes=list(lanes), **span)


def look(folder: Path) -> None:
    """Open the trace, and tell what that and its answers cost: the work of a process of its own."""
    begun = time.perf_counter()
    session = Recorded(folder)
    message, _ = session.timeline.told(None)
    assert message is not None
    lanes = [lane["lane"] for lane in message["lanes"] if lane["what"] != "channel"]
    last = int(message["last_ns"])
    session.timeline.answer(question(0, lanes[:MOST_SHOWN], 0, last))
    row("opening and the first complete answer", time.perf_counter() - begun, 3.0)
    print(f"{'private memory then':64s} {private_mb():9.0f} MB{told(500, private_mb())}")
    stream = np.random.default_rng(2)
    sizes: list[int] = []

    def window() -> None:
        length = int(10 ** stream.uniform(6, np.log10(last)))
        start = int(stream.integers(0, max(1, last - length)))
        first = int(stream.integers(0, len(lanes) - 19))
        answer = session.timeline.answer(question(1, lanes[first : first + 20], start, length))
        sizes.append(len(answer))

    each("window of 20 lanes, 1 ms to the whole run", window, WINDOWS)
    print(f"{'its size, median and greatest':64s} {median(sizes) / 1e3:9.0f} kB {max(sizes) / 1e3:9.0f} kB")
    channels = [lane["lane"] for lane in message["lanes"] if lane["what"] == "channel"][:79]
    each("window of 79 channels, the whole run", lambda: session.timeline.answer(question(2, channels, 0, last)), 20)

    def box() -> None:
        found = session.timeline.answer(AskNext(say="find", lost=True, from_ns=str(int(stream.integers(0, last)))))
        assert isinstance(found, dict)
        if found["lane"] is not None:
            session.timeline.answer(AskBox(say="box", lane=found["lane"], row=found["row"]))

    each("next lost frame anywhere, and all about it", box, 50)
    each("a kind that there is not, all lanes searched", lambda: session.timeline.answer(absent()), 5)
    print(f"{'private memory at the end':64s} {private_mb():9.0f} MB{told(500, private_mb())}")


def told(bound: float, value: float, unit: str = "") -> str:
    """Return what stands beside a figure of *value* that has a *bound*."""
    return f"  at most {bound:g}{unit}" + (" EXCEEDED" if value > bound else "")


def absent() -> AskNext:
    """Return a search that finds nothing."""
    return AskNext(say="find", kind=60_000, from_ns="0")


def each(name: str, work: Callable[[], None], times: int) -> None:
    """Do *work* so many times and print how long that takes."""
    taken = []
    for _ in range(times):
        begun = time.perf_counter()
        work()
        taken.append(1e3 * (time.perf_counter() - begun))
    high = quantiles(taken, n=20)[-1]
    print(f"{name:64s} {median(taken):9.1f} ms, 95 %: {high:.1f} ms, greatest: {max(taken):.1f} ms")


def row(name: str, seconds: float, bound_s: float) -> None:
    """Print a figure."""
    print(f"{name:64s} {seconds:9.2f} s {told(bound_s, seconds, ' s')}", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the trace, and measure."""
    parser = argparse.ArgumentParser("python -m benchmarks.timeline", description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--folder", type=Path, help="where the trace is, or is to be made and kept")
    parser.add_argument("--look", action="store_true", help="only open the trace in the folder")
    options = parser.parse_args(arguments)
    if options.look:
        look(options.folder)
        return
    with TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary) / "trace"
        if not (folder / "poses.parquet").is_file():
            folder.mkdir(parents=True, exist_ok=True)
            make(folder, options.rows)
        shutil.rmtree(folder / FOLDER, ignore_errors=True)
        rows = sum(len(TableFile(folder / f"{name}.parquet")) for name in SHARES)
        tables = sum(path.stat().st_size for path in folder.glob("*.parquet")) / 1e6
        line = [sys.executable, "-m", "benchmarks.timeline", "--look", "--folder", str(folder)]
        begun, before = time.perf_counter(), getrusage(RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", FIRST, str(folder)], check=True)
        row(f"first opening of {rows:,} rows, {tables:.0f} MB, the whole process", time.perf_counter() - begun, 15.0)
        after = getrusage(RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        row("its processor time", used, 15.0)
        index = sum(path.stat().st_size for path in (folder / FOLDER).iterdir()) / 1e6
        print(f"{'its index':64s} {index:9.0f} MB", flush=True)
        subprocess.run(line, check=True)


FIRST = """
import sys
from pathlib import Path
from cosim.web.recorded import Recorded
from benchmarks.timeline import private_mb
Recorded(Path(sys.argv[1]))
print(f"{'private memory after it':64s} {private_mb():9.0f} MB")
"""

if __name__ == "__main__":
    main()
