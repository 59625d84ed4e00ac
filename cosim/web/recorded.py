"""A recorded run: the tables that ``cosim run --trace`` has written, played at any speed from any time."""

import json
import math
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cosim.arrays import Int64s
from cosim.decoding import frame_said
from cosim.documents import is_file
from cosim.errors import CosimError, UserError
from cosim.scenario import Scenario, protocol_names
from cosim.timeline.curves import series_of
from cosim.timeline.detail import Decode
from cosim.timeline.index import Told, opened
from cosim.timeline.queues import COLUMNS, Queues
from cosim.trace import METRICS, PAYLOADS, StoredTable, TableFile
from cosim.units import S, Time, from_seconds, to_seconds
from cosim.web.activity import StoredActivity
from cosim.web.air import StoredAir
from cosim.web.beliefs import StoredBeliefs
from cosim.web.clock import Clock
from cosim.web.history import DOWN, UP, Cursor, History, Moment, places
from cosim.web.marks import marks_of
from cosim.web.messages import AskMap, AskPresent, Plain, Step, Wish
from cosim.web.rows import Counted, Row, Stored
from cosim.web.scans import Scanner
from cosim.web.scenes import read_scene
from cosim.web.timeline import Kept, Timeline

_MARGIN_M = 1.0
_Table = TypeVar("_Table")


class Recorded:
    """A session that plays the trace in a folder."""

    def __init__(
        self,
        folder: Path,
        wall: Callable[[], float] = time.monotonic,
        playing: bool = True,
        told: Told = lambda done, total: None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Read the tables; raise UserError if there are none, or if they lack the robots' places.

        *told* shows the progress of what may take long, *say* is told in a line what the user should know.
        """
        self.folder = folder
        poses = StoredTable(_existing(folder, "poses"))
        self._times, self._poses = _by_tick(poses)
        events, links = (_table(folder, name, StoredTable) for name in ("events", "links"))
        frames, intervals = (_table(folder, name, TableFile) for name in ("frames", "intervals"))
        marks, kinds = _marked(events), _by_kind(events)
        self._downs = _downs(events)
        tables = [table for table in (poses, events) if table is not None and len(table)]
        told_until = max(int(table.column("time_ns")[-1]) for table in tables)
        air, activity = StoredAir(frames), StoredActivity(intervals, links, told_until)
        self._beliefs = StoredBeliefs(lambda name: _table(folder, name, StoredTable), self._times)
        seconds = self._times[:, None] / S
        ticks = np.concatenate([seconds, self._poses.reshape(len(self._times), -1)], axis=1)
        shown = _events(events, None)
        self._history = History(
            ticks=Stored(self._times, lambda first, end, step: ticks[first:end:step].tolist()),
            air=air,
            activity=activity,
            beliefs=self._beliefs,
            events=shown,
            marks=_events(events, marks),
            kinds={name: _events(events, numbers) for name, numbers in kinds.items()},
        )
        end: Time = max(told_until, 0 if frames is None else frames.last)
        self._rows: dict[str, Counted] = {"frame": air, "event": shown}
        self._scene = _scene(folder, self._poses, end) | {"live": False}
        self._scene["kinds"] = {name: len(numbers) for name, numbers in kinds.items()}
        if events is not None and len(events):
            self._scene["marks"] = marks_of(*(events.column(name) for name in ("time_ns", "source", "event")))
        self._steps = {"tick": from_seconds(self._scene["tick_s"]), "slot": self._scene.get("slot_ns")}
        metrics = _table(folder, METRICS.name, StoredTable)
        series = {} if metrics is None else series_of(_columns(metrics))
        payloads = _table(folder, PAYLOADS.name, StoredTable)
        queues = Queues({} if payloads is None else {name: payloads.column(name) for name in COLUMNS})
        robots, decode = self._poses.shape[1], _decoding(poses.metadata)
        self._timeline = Kept(opened(folder, told, say), folder, decode, series, queues, robots)
        self._scanner = cache(lambda: Scanner(self._scene))
        self.clock = Clock(end, wall, playing)
        """Its time; a run beside it may go by the same."""

    @property
    def scene(self) -> Plain:
        """What does not change."""
        return self._scene | {"duration_s": to_seconds(self.clock.end)}

    def wish(self, wish: Wish) -> None:
        """Do what a page asks for; raise UserError, one line, if it cannot be done."""
        if isinstance(wish, Step):
            self.clock.step(self.stepped(self.clock.now, wish.by, wish.count), wish.count < 0)
        else:
            self.clock.wish(wish)

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return the messages for a page that has been sent all up to *cursor*, and the new cursor."""
        clock = self.clock
        now = clock.now
        moment = Moment(now, clock.state, clock.speed, self._robots(now), clock.jumps)
        message, new = self._history.now(moment, cursor)
        return [] if message is None else [message], new

    def answer(self, asked: AskPresent) -> Plain:
        """Return the answer to what a page asks about the present; raise UserError, one line, if there is none."""
        now = self.clock.now
        if isinstance(asked, AskMap):
            return self._beliefs.map(asked.robot, now)
        scanner = self._scanner()
        at = max(0, int(np.searchsorted(self._times, now, side="right")) - 1)
        poses, tick = self._poses[at], int(self._times[at])
        turned_rad, told = scanner.turns_rad, self._beliefs.headings_rad(tick)
        if len(told) == len(poses):
            turned_rad = poses[:, 2] - np.array(told) + scanner.turns_rad
        elif not scanner.aware:
            raise UserError("this trace does not tell how robots take themselves to head: it was recorded before that")
        return scanner.scan(asked.robot, poses, turned_rad, tick)

    @property
    def timeline(self) -> Timeline:
        """The boxes of the run."""
        return self._timeline

    def close(self) -> None:
        """Do nothing, since nothing runs."""

    def stepped(self, now: Time, by: str, count: int) -> Time:
        """Return the time *count* steps from *now*; raise UserError for steps that the run has none of."""
        step = self._steps.get(by)
        if step is not None:
            return now + count * step
        rows = self._rows.get(by)
        end = 0 if rows is None else rows.until(self.clock.end)
        if rows is None or not end:
            raise UserError(f"this run has no {by}s")
        for _ in range(abs(count)):
            number = rows.until(now) if count > 0 else rows.until(now - 1) - 1
            if not 0 <= number < end:
                return self.clock.end if count > 0 else 0
            now = rows.time(number)
        return now

    def _robots(self, now: Time) -> list[Row]:
        """Return where the robots are: between two ticks on the line from one place to the next."""
        after = int(np.searchsorted(self._times, now, side="right"))
        before, after = max(0, after - 1), min(after, len(self._times) - 1)
        one, two = self._poses[before], self._poses[after]
        gap = int(self._times[after] - self._times[before])
        part = (now - int(self._times[before])) / gap if gap else 0.0
        change = two - one
        change[:, 2] = (change[:, 2] + math.pi) % (2 * math.pi) - math.pi
        down: dict[int, bool] = {robot: is_down for at, robot, is_down in self._downs if at <= now}
        rows: list[Row] = np.round(one + part * change, 4).tolist()
        return [[*row, down.get(robot, False)] for robot, row in enumerate(rows)]


def _decoding(metadata: Mapping[str, str]) -> Decode | None:
    """Return what decodes payloads of the run that tables with this *metadata* are of; None if nothing does.

    Only an installed protocol does: who opens a trace of somebody else's is not to run what that names.
    """
    try:
        given = json.loads(metadata["scenario"])
        if given["protocol"]["use"] not in protocol_names():
            return None
        return partial(frame_said, Scenario.model_validate(given))
    except (CosimError, KeyError, TypeError, ValueError, OSError):  # of another version, or with maps that are not here
        return None


def _columns(table: StoredTable) -> dict[str, list[Any]]:
    rows = table.rows(0, len(table))
    return {name: [row[name] for row in rows] for name in table.names}


def is_trace(folder: Path) -> bool:
    """Return whether *folder* holds the tables of a run."""
    return any(is_file(folder / f"{name}.parquet") for name in ("poses", "events", "frames"))


def _existing(folder: Path, name: str) -> Path:
    path = folder / f"{name}.parquet"
    if not path.is_file():
        raise UserError(f"{folder}: holds no {path.name}: cosim run SCENARIO --trace {folder} writes it")
    return path


def _by_tick(poses: StoredTable) -> tuple[Int64s, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return the times of the ticks, and the poses, shape (ticks, robots, 3)."""
    times, robots = poses.column("time_ns"), poses.column("source")
    size = int(robots.max()) + 1 if len(poses) else 0
    if not size or len(poses) % size or not np.array_equal(robots, np.tile(np.arange(size), len(poses) // size)):
        raise UserError("poses.parquet: does not tell of each robot at each tick where it is")
    columns = [poses.column(name) for name in ("x_m", "y_m", "heading_rad")]
    return times[::size], np.stack(columns, axis=1).reshape(-1, size, 3)


def _table(folder: Path, name: str, kind: Callable[[Path], _Table]) -> _Table | None:
    path = folder / f"{name}.parquet"
    return kind(path) if path.is_file() else None


def _marked(table: StoredTable | None) -> Int64s:
    """Return the numbers of the events that have a place among their fields."""
    if table is None:
        return np.zeros(0, dtype=np.int64)
    told = [~np.isnan(table.column(name).astype(float)) for name in places(table.names)]
    return np.flatnonzero(np.logical_or.reduce(told)) if told else np.zeros(0, dtype=np.int64)


def _by_kind(table: StoredTable | None) -> dict[str, Int64s]:
    """Return the numbers of the events of each type, by its name."""
    names = np.empty(0, dtype=str) if table is None else table.column("event").astype(str)
    return {name: np.flatnonzero(names == name) for name in np.unique(names).tolist()}


def _events(table: StoredTable | None, numbers: Int64s | None) -> Stored:
    """Return the events of *table*, all or only those with these *numbers*."""
    if table is None:
        return Stored(np.zeros(0, dtype=np.int64), lambda first, end, step: [])
    times = table.column("time_ns")

    chosen = np.arange(len(table)) if numbers is None else numbers

    def read(first: int, end: int, step: int) -> list[Row]:
        asked = chosen[first:end:step]
        return [_event(number, row) for number, row in zip(asked.tolist(), table.rows_at(asked), strict=True)]

    return Stored(times[chosen], read)


def _event(number: int, row: dict[str, Any]) -> Row:
    fixed = ("time_ns", "source", "event")
    fields = {name: value for name, value in row.items() if value is not None and name not in fixed}
    return [number, to_seconds(row["time_ns"]), row["source"], row["event"], fields]


def _downs(table: StoredTable | None) -> list[tuple[Time, int, bool]]:
    """Return rows of time, robot and whether it went down then, or up again."""
    if table is None:
        return []
    names = table.column("event")
    rows = table.rows_at(np.flatnonzero(np.isin(names.astype(str), [*DOWN, *UP])))
    return [(row["time_ns"], row["source"], row["event"] in DOWN) for row in rows]


def _scene(folder: Path, poses: np.ndarray[Any, np.dtype[np.float64]], end: Time) -> Plain:
    """Return the scene beside the tables; for a trace without one, what follows from the poses."""
    scene = read_scene(folder)
    if scene is not None:
        return scene | {"duration_s": to_seconds(end)}
    low, high = poses[..., :2].min(axis=(0, 1)) - _MARGIN_M, poses[..., :2].max(axis=(0, 1)) + _MARGIN_M
    return {
        "name": folder.name,
        "protocol": "",
        "channel": "",
        "seed": None,
        "duration_s": to_seconds(end),
        "tick_s": 0.1,
        "bounds_m": [*low.tolist(), *high.tolist()],
        "walls_m": [],
        "polygons_m": [],
        "places_m": {},
        "base_m": None,
        "radii_m": [0.2] * poses.shape[1],
        "slot_ns": None,
    }
