"""Paths that bodies follow, read from files: rows of a CSV, or the movements of an ns-2 scenario.

A CSV file (its name ends in .csv) has the columns robot, time_s, x_m, y_m and, if wanted, heading_rad, in any order;
the rows of a robot are in the order of time. Every other file is read as ns-2 movements, as BonnMotion and SUMO
write them::

    $node_(0) set X_ 10.0
    $node_(0) set Y_ 5.0
    $ns_ at 2.5 "$node_(0) setdest 20.0 5.0 1.5"

From point to point a robot goes straight at constant speed. Before its first point it stands there, after its last one
too. A ``setdest`` ends the one before it, wherever the robot is. Without headings a robot faces the way that it goes.
"""

import csv
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.documents import is_file, read_bytes
from cosim.errors import UserError
from cosim.settings import FARTHEST_M, LONGEST_S
from cosim.units import Time, from_seconds

Bounds: TypeAlias = tuple[float, float, float, float]

MOST_BYTES: Final = 256 * 2**20
COLUMNS: Final = ("robot", "time_s", "x_m", "y_m")
HEADING: Final = "heading_rad"
EXPECTED: Final = '$node_(0) set X_ 1, $ns_ at 1 "$node_(0) setdest 1 2 3"'
"""Lines of ns-2 movements."""
TURN: Final = 2.0 * math.pi
_PLACE: Final = re.compile(r"\$node_\((\d+)\)\s+set\s+([XYZ])_\s+(\S+)")
_DEPARTURE: Final = re.compile(r'\$ns_?\s+at\s+(\S+)\s+"\s*\$node_\((\d+)\)\s+setdest\s+(\S+)\s+(\S+)\s+(\S+?)\s*"')
_IGNORED: Final = re.compile(r"#|\$god_|\$ns_?\s+at\s+\S+\s+\"\s*\$god_|set\s")


class Waypoint(NamedTuple):
    """Where a robot is at an instant."""

    time: Time
    x_m: float
    y_m: float
    heading_rad: float | None
    """None if it faces the way that it goes."""
    line: int
    """Of the file, for errors."""


# ---------------------------------------------------------------- reading


class _Line(NamedTuple):
    """A line of a file, for what is wrong with it."""

    source: str
    number: int

    def error(self, what: str) -> UserError:
        return UserError(f"{self.source}: line {self.number}: {what}")

    def value(self, name: str, text: str, low: float, high: float) -> float:
        """Return the number *text*, which is called *name*; raise UserError for any other and one out of range."""
        try:
            number = float(text)
        except ValueError:
            raise self.error(f"{name}: {text!r} is not a number") from None
        if not low <= number <= high:
            raise self.error(f"{name}: {text} is not >= {low:g} and <= {high:g}")
        return number

    def seconds(self, name: str, text: str) -> Time:
        return from_seconds(self.value(name, text, 0.0, LONGEST_S))

    def metres(self, name: str, text: str) -> float:
        return self.value(name, text, -FARTHEST_M, FARTHEST_M)

    def robot(self, name: str, text: str) -> int:
        if not text.isascii() or not text.isdigit():
            raise self.error(f"{name}: {text!r} is not the number of a robot")
        return int(text)


def read_csv(text: str, source: str) -> dict[int, list[Waypoint]]:
    """Return the waypoints of each robot in the CSV *text*; raise UserError, with the line, for what is none."""
    rows = csv.reader(text.splitlines(), skipinitialspace=True)
    names = [name.strip() for name in next(rows, [])]
    first = _Line(source, 1)
    for name in names:
        if name not in (*COLUMNS, HEADING) or names.count(name) > 1:
            raise first.error(f"the column {name!r} is not expected, or stands twice: {', '.join((*COLUMNS, HEADING))}")
    for name in COLUMNS:
        if name not in names:
            raise first.error(f"the column {name} is missing")
    paths: dict[int, list[Waypoint]] = {}
    for cells in rows:
        if not cells:
            continue
        line = _Line(source, rows.line_num)
        if len(cells) != len(names):
            raise line.error(f"{len(cells)} values for {len(names)} columns")
        row = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        time = line.seconds("time_s", row["time_s"])
        path = paths.setdefault(line.robot("robot", row["robot"]), [])
        if path and time <= path[-1].time:
            raise line.error(f"time_s: {row['time_s']} is not > that of the robot's row before, line {path[-1].line}")
        heading = line.value(HEADING, row[HEADING], -1e6, 1e6) if HEADING in row else None
        x_m, y_m = line.metres("x_m", row["x_m"]), line.metres("y_m", row["y_m"])
        path.append(Waypoint(time, x_m, y_m, heading, line.number))
    return paths


class _Departure(NamedTuple):
    time: Time
    x_m: float
    y_m: float
    speed_mps: float
    line: _Line


def read_ns2(text: str, source: str) -> dict[int, list[Waypoint]]:
    """Return the waypoints of each node of the ns-2 movements *text*; raise UserError, with the line, for what is none.

    Heights are ignored, and so is what such files say to ns-2's ``god``.
    """
    places: dict[int, dict[str, tuple[float, int]]] = {}
    departures: dict[int, list[_Departure]] = {}
    for number, words in enumerate(text.splitlines(), 1):
        line = _Line(source, number)
        if place := _PLACE.fullmatch(words.strip()):
            places.setdefault(int(place[1]), {})[place[2]] = line.metres(f"{place[2]}_", place[3]), number
        elif move := _DEPARTURE.fullmatch(words.strip()):
            time, (x_m, y_m) = line.seconds("at", move[1]), (line.metres("setdest", move[each]) for each in (3, 4))
            speed_mps = line.value("speed", move[5], 0.0, 1e6)
            departures.setdefault(int(move[2]), []).append(_Departure(time, x_m, y_m, speed_mps, line))
        elif words.strip() and not _IGNORED.match(words.strip()):
            raise line.error(f"{words.strip()[:60]!r} is not one of {EXPECTED}")
    paths = {}
    for node in sorted({*places, *departures}):
        for axis in "XY":
            if axis not in places.get(node, {}):
                raise UserError(f"{source}: $node_({node}) has no {axis}_: where does it start?")
        (x_m, at), (y_m, _) = places[node]["X"], places[node]["Y"]
        paths[node] = list(_gone(Waypoint(0, x_m, y_m, None, at), departures.get(node, [])))
    return paths


def _gone(here: Waypoint, departures: Sequence[_Departure]) -> Iterator[Waypoint]:
    """Yield the points of the way from *here*, each departure in its turn."""
    yield here
    ordered = sorted(departures, key=lambda each: each.time)  # those of one instant in the order of the file
    for departure, end in zip_longest(ordered, [each.time for each in ordered[1:]]):
        if departure.time > here.time:
            here = here._replace(time=departure.time, line=departure.line.number)
            yield here
        way_m = math.hypot(departure.x_m - here.x_m, departure.y_m - here.y_m)
        if way_m == 0.0 or departure.speed_mps == 0.0:
            continue
        seconds = way_m / departure.speed_mps
        if seconds > LONGEST_S:
            raise departure.line.error(f"speed: {departure.speed_mps:g} is too little: it takes {seconds:g} s")
        arrival = here.time + from_seconds(seconds)
        there = Waypoint(arrival, departure.x_m, departure.y_m, None, departure.line.number)
        if end is not None and end < arrival:
            part = (end - here.time) / (arrival - here.time)
            x_m, y_m = here.x_m + part * (there.x_m - here.x_m), here.y_m + part * (there.y_m - here.y_m)
            there = there._replace(time=end, x_m=x_m, y_m=y_m)
        if there.time > here.time:
            here = there
            yield here


# ---------------------------------------------------------------- following


class Paths:
    """The ways of some bodies of a run; asked for instants that never go back."""

    def __init__(self, paths: Mapping[int, Sequence[Waypoint]]) -> None:
        """Take the waypoints of each body, at least one, in the order of time."""
        self.bodies = np.array(sorted(paths), dtype=np.int64)
        """The numbers of the bodies."""
        points = [point for body in self.bodies.tolist() for point in paths[body]]
        ends = np.cumsum([len(paths[body]) for body in self.bodies.tolist()])
        self._last = ends - 1
        self._here = np.concatenate((np.zeros(1, dtype=np.int64), ends[:-1]))
        """Of each body the waypoint that it has passed last, or its first."""
        self._times = np.array([point.time for point in points], dtype=np.int64)
        self._points = np.array([(point.x_m, point.y_m) for point in points]).T
        headings = [_headings(paths[body]) for body in self.bodies.tolist()]
        self._headings, self._turns = np.concatenate(headings, axis=1)

        self.starts_m: dict[int, tuple[float, float]] = {body: path[0][1:3] for body, path in paths.items()}
        """Where each body is at first, by its number."""

    def at(self, time: Time) -> Floats:
        """Return where the bodies are at *time*, shape (3, bodies): rows x_m, y_m, heading_rad."""
        while True:
            there = np.minimum(self._here + 1, self._last)
            passed = (there > self._here) & (self._times[there] <= time)
            if not passed.any():
                break
            self._here = np.where(passed, there, self._here)
        here, begun = self._here, self._times[self._here]
        span = np.maximum(self._times[there] - begun, 1)
        part = np.maximum(time - begun, 0) / span * (there > here)
        x_m, y_m = self._points[:, here] + part * (self._points[:, there] - self._points[:, here])
        return np.stack((x_m, y_m, turned(self._headings[here] + part * self._turns[here])))


def turned(angles: Floats) -> Floats:
    """Return *angles* (radians) in [-pi, pi]."""
    return angles - TURN * np.rint(angles / TURN)


def _headings(path: Sequence[Waypoint]) -> Floats:
    """Return the heading at each point of *path*, and by how much it turns until the next; shape (2, points)."""
    if path[0].heading_rad is not None:
        headings = np.array([point.heading_rad for point in path], dtype=np.float64)
        return np.stack((headings, turned(np.diff(headings, append=headings[-1:]))))
    told, heading = [], 0.0
    for here, there in zip(path, [*path[1:], path[-1]], strict=True):
        dx, dy = there.x_m - here.x_m, there.y_m - here.y_m
        heading = elementary.atan2(dy, dx) if dx or dy else heading
        told.append(heading)
    return np.stack((np.array(told), np.zeros(len(told))))


# ---------------------------------------------------------------- files


def find_paths(name: str, folder: Path) -> Path | None:
    """Return the file *name*, given absolutely or relative to *folder* or the working directory; None if none is."""
    return next((path for path in (folder / name, Path(name)) if is_file(path)), None)


def load_paths(name: str, folder: Path, robots: Collection[int], bounds_m: Bounds) -> Paths:
    """Return the paths in the file *name*; a relative one is looked for in *folder*, then in the working directory.

    Raise UserError, which names file, line and value, if it is missing or broken, for a robot that is none of *robots*,
    and for a point outside of the floor's *bounds_m*.
    """
    path = find_paths(name, folder)
    if path is None:
        raise UserError(f"team.trajectories: {name!r} is no file in {folder} or in the working directory")
    try:
        text = read_bytes(path, MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: byte {error.start} is not UTF-8 text") from None
    paths = read_csv(text, str(path)) if path.suffix == ".csv" else read_ns2(text, str(path))
    x_min, y_min, x_max, y_max = bounds_m
    for robot, points in paths.items():
        for point in points:
            line, (x, y) = _Line(str(path), point.line), point[1:3]
            if robot not in robots:
                raise line.error(f"there is no robot {robot} in the team, expected 0 to {len(robots) - 1}")
            if not (x_min <= x <= x_max and y_min <= y <= y_max):
                expected = f"expected {x_min:g}..{x_max:g} by {y_min:g}..{y_max:g} m"
                raise line.error(f"({x:g}, {y:g}) is outside of the floor, {expected}")
    if not paths:
        raise UserError(f"{path}: holds no point of any path")
    return Paths(paths)
