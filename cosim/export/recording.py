"""A run as its exports read it: the tables that were kept, and what does not change during it."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cosim.arrays import Floats, Int64s
from cosim.channels.background import called
from cosim.errors import UserError
from cosim.intervals import link_of
from cosim.machine import Address, Role
from cosim.trace import (
    FRAMES,
    INTERVALS,
    LINKS,
    MESSAGES,
    POSES,
    RECEPTIONS,
    TRANSMISSIONS,
    UNSENT,
    WAKES,
    Table,
    Trace,
    link_told,
)
from cosim.units import Time

DRAWN: Final[tuple[Table, ...]] = (POSES, FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS, MESSAGES, WAKES, LINKS, UNSENT)
"""The tables that a run is to keep for its exports, besides the protocol's events."""
NAMES: Final = (*(table.name for table in DRAWN), "events")
DOWN: Final = frozenset({"Killed", "Crashed", "BatteryEmpty"})
"""Events after which a robot does nothing any more."""
UP: Final = frozenset({"Rebooted"})
"""Events after which a robot that was down acts again."""

ROBOTS: Final = (
    *("#1f599d", "#b58511", "#e25389", "#491a2d", "#4495c3", "#995b3e", "#805cde", "#83290b", "#52465a", "#18227a"),
)
"""Colours of robots 0, 1, ..., those of the pages in light; their numbers tell them apart where there are more."""
STATION: Final = "#8a8a8a"
"""Colour of stations in the background."""


class Jammer(NamedTuple):
    """A time at which a jammer of the scenario is on the air."""

    fault: int
    """The number of the fault in the scenario."""
    x_m: float
    y_m: float
    begin: Time
    end: Time
    power_dbm: float


class Recording:
    """The tables of one run, each in the order of time, with its scene and what else was written with it."""

    def __init__(self, tables: Mapping[str, Any], scene: Mapping[str, Any], metadata: Mapping[str, str]) -> None:
        """Take *tables*, those of pyarrow by name; *scene* as beside a trace; *metadata* as in its files."""
        self._tables = dict(tables)
        self.scene = dict(scene)
        self.metadata = dict(metadata)
        self.size = len(self.scene["radii_m"])
        """Number of robots."""
        places = [station["place_m"] for station in self.scene.get("stations", ())]
        self.stations: Floats = np.array(places, dtype=np.float64).reshape(-1, 2)
        """Where the stations in the background are, m (stations, 2); their addresses come after those of the robots."""
        self.scenario: dict[str, Any] = json.loads(self.metadata.get("scenario", "{}"))

    @property
    def title(self) -> str:
        """The scenario's name and the seed."""
        return f"{self.scene.get('name', 'run')}, seed {self.metadata.get('seed', self.scene.get('seed'))}"

    @property
    def addresses(self) -> range:
        """Those of all robots, and then of the stations."""
        return range(self.size + len(self.stations))

    def called(self, address: Address) -> str:
        """Return what people call who has *address*: robot 2, or station 0; jammers have none."""
        return called(address, self.size) if address >= 0 else "jammers"

    @property
    def end(self) -> Time:
        """When the last row begins or ends, ns."""
        ends = [int(self.column(name, _time(name))[-1]) for name in NAMES if self.count(name)]
        if self.count("frames"):
            ends.append(int((self.column("frames", "time_ns") + self.column("frames", "duration_ns")).max()))
        if self.count("intervals"):
            ends.append(int(self.column("intervals", "end_ns").max()))
        return max(ends, default=0)

    def count(self, name: str) -> int:
        """Return the number of rows of the table *name*; 0 if it was not kept."""
        return int(self._tables[name].num_rows) if name in self._tables else 0

    def names(self, name: str) -> list[str]:
        """Return the columns of the table *name*."""
        return list(self._tables[name].column_names)

    def has(self, name: str, column: str) -> bool:
        """Return whether the table *name* was kept, with that *column*."""
        return name in self._tables and column in self._tables[name].column_names

    def column(self, name: str, column: str) -> np.ndarray[Any, Any]:
        """Return a column of the table *name*; empty if the table was not kept."""
        if name not in self._tables:
            return np.zeros(0, dtype=np.int64)
        values: np.ndarray[Any, Any] = self._tables[name].column(column).to_numpy()
        return values

    def radio(self, name: str) -> Int64s:
        """Return the number of the radio of each row of the table *name*: 0 where robots have one only."""
        return self.column(name, "radio") if self.has(name, "radio") else np.zeros(self.count(name), dtype=np.int64)

    def rows(self, name: str) -> Iterator[dict[str, Any]]:
        """Yield the rows of the table *name* by column; None for what a row does not have."""
        if name in self._tables:
            for batch in self._tables[name].to_batches(max_chunksize=10_000):
                yield from batch.to_pylist()

    def poses(self) -> tuple[Int64s, Floats]:
        """Return the times of the ticks (n,), and x, y, heading of each robot at each (n, robots, 3)."""
        if not self.count("poses"):
            return np.zeros(0, dtype=np.int64), np.zeros((0, self.size, 3))
        columns = [self.column("poses", name) for name in ("x_m", "y_m", "heading_rad")]
        return self.column("poses", "time_ns")[:: self.size], np.stack(columns, axis=1).reshape(-1, self.size, 3)

    def places(self, now: Time) -> Floats:
        """Return x, y, heading of each robot *now*, on the line from one tick to the next, and of each station.

        Of shape (robots + stations, 3): by address. A station has no heading.
        """
        still = np.column_stack((self.stations, np.zeros(len(self.stations))))
        return np.vstack((self._robots_places(now), still))

    def _robots_places(self, now: Time) -> Floats:
        times, poses = self.poses()
        if not len(times):
            return np.zeros((self.size, 3))
        after = int(np.searchsorted(times, now, side="right"))
        before, after = max(0, after - 1), min(after, len(times) - 1)
        gap = int(times[after] - times[before])
        change = poses[after] - poses[before]
        change[:, 2] = (change[:, 2] + np.pi) % (2 * np.pi) - np.pi
        found: Floats = poses[before] + change * ((now - int(times[before])) / gap if gap else 0.0)
        return found

    def down(self, now: Time) -> set[int]:
        """Return the robots that do nothing *now*: dead, crashed, without energy."""
        down: set[int] = set()
        times = self.column("events", "time_ns")
        names, robots = (self.column("events", name) if len(times) else () for name in ("event", "source"))
        for time, robot, event in zip(times.tolist(), robots, names, strict=True):
            if time > now:
                break
            if event in DOWN:
                down.add(int(robot))
            elif event in UP:
                down.discard(int(robot))
        return down

    def links(self) -> list[tuple[Time, Time, int, int]]:
        """Return the links between robots: begin, end (the run's, if it was never lost), master, slave.

        Those between stations are among them.
        """
        opened: dict[tuple[int, int, int], Time] = {}
        found = []
        for row in self.rows("links"):
            robot, peer, (role, radio) = row["source"], row["peer"], link_told(row["detail"])
            if row["event"] == "Connected" and role in ("master", "slave"):
                pair = (robot, peer) if role == "master" else (peer, robot)
                opened.setdefault((*pair, radio), row["time_ns"])
            elif row["event"] == "Lost":
                for pair in ((robot, peer), (peer, robot)):
                    if (*pair, radio) in opened:
                        found.append((opened.pop((*pair, radio)), row["time_ns"], *pair))
        found += [(begin, self.end + 1, *link[:2]) for link, begin in opened.items()]
        return sorted(found + self._stations_links())

    def _stations_links(self) -> list[tuple[Time, Time, int, int]]:
        """Return the links between stations, whose hosts tell no news: as their radios know them."""
        found = []
        addresses, states = self.column("intervals", "robot"), self.column("intervals", "state")
        begins, ends, details = (self.column("intervals", name) for name in ("start_ns", "end_ns", "detail"))
        for row in np.flatnonzero(addresses >= self.size).tolist():
            link = link_of(states[row], details[row])
            if link is not None and link.role == Role.MASTER.value:
                end = int(ends[row]) if ends[row] < self.end else self.end + 1
                found.append((int(begins[row]), end, int(addresses[row]), link.other))
        return found

    def jammers(self) -> list[Jammer]:
        """Return the times at which the scenario's jammers are on the air, in their order."""
        states, begins, ends, details = (
            self.column("intervals", name) for name in ("state", "start_ns", "end_ns", "detail")
        )
        found = []
        for row in np.flatnonzero(states == "jammer").tolist():
            number = int(dict(word.partition("=")[::2] for word in details[row].split())["fault"])
            fault = self.scenario["faults"][number]
            place = fault["x_m"], fault["y_m"]
            found.append(Jammer(number, *place, int(begins[row]), int(ends[row]), fault["power_dbm"]))
        return found


def of_run(trace: Trace, scene: Mapping[str, Any], metadata: Mapping[str, str]) -> Recording:
    """Return the recording of a run that has just been made, whose *trace* has kept what is to be exported."""
    return Recording({name: trace.arrow(name) for name in NAMES if name in trace.tables}, scene, metadata)


def of_folder(folder: Path, scene: Mapping[str, Any] | None) -> Recording:
    """Return the recording in *folder*, as ``cosim run --trace`` has written it; raise UserError if it is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if scene is None:
        raise UserError(f"{folder}: holds no scene.json: cosim run SCENARIO --trace {folder} writes it")
    tables, metadata = {}, {}
    for name in NAMES:
        path = folder / f"{name}.parquet"
        if not path.is_file():
            continue
        try:
            table = pq.read_table(path)
            tables[name] = table.sort_by(_time(name))
        except (pa.ArrowException, OSError, KeyError) as error:
            raise UserError(f"{path}: cannot be read as a table of a trace: {error}") from None
        metadata = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if not tables:
        raise UserError(f"{folder}: holds no tables: cosim run SCENARIO --trace {folder} writes them")
    return Recording(tables, scene, {key: value for key, value in metadata.items() if key != "ARROW:schema"})


def _time(name: str) -> str:
    return "start_ns" if name == INTERVALS.name else "time_ns"
