"""What robots believe at an instant, as a floor shows it: their maps, where they mean to go, where they think they are.

Ways and estimates are in the messages ``now``, whenever they differ from what was sent. Of maps these have only which
ones there are, with a number that grows with each change; a page that shows one asks for it.
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from cosim.arrays import Int64s
from cosim.beliefs import COMMON, ODOMETRY, way_of
from cosim.errors import UserError
from cosim.ranges import numbers_of, ranges_of
from cosim.trace import ESTIMATES, MAPS, WAYS, StoredTable, Table
from cosim.units import Time
from cosim.web.messages import Plain
from cosim.web.rows import Row

States = np.ndarray[Any, np.dtype[np.int8]]

TEAM: Final = -1
"""Whose map is asked for if no robot is chosen: the common one, or all that any robot knows."""
_APART: Final = 256
"""Number of changes of a map from one copy that is kept to the next."""
_KEPT_BYTES: Final = 1 << 26
"""Size of all copies of maps of a recorded run."""
_STATES: Final = (("unknown", 0), ("empty", -1), ("occupied", 1))
_MM: Final = 3
_ROWS: Final = 1024
"""Number of ways that are kept as pages get them."""


class Beliefs(Protocol):
    """What the robots of a run believe."""

    def told(self, time: Time, known: Plain) -> Plain:
        """Return what they believe at *time*, those parts that differ from *known*.

        ``maps``: rows of source (-1: all have it in common) and number of changes; ``ways``: rows of robot, points and
        goal, m; ``estimates``: rows of robot, origin, x, y, heading and covariance xx, xy, yy, or None.
        """

    def map(self, robot: int, time: Time) -> Plain:
        """Return the message ``map``: what *robot* knows of the floor at *time*, or the team.

        ``maps`` are those of which it is made, as ``told`` has them. If there is any: ``corner_m``, ``turn_rad``,
        ``cell_m``, ``columns`` and ``rows`` as in the table of maps, and the cells that are ``empty`` and ``occupied``.
        """


class Grid(NamedTuple):
    """Where the cells of a map are."""

    corner_m: tuple[float, float]
    turn_rad: float
    cell_m: float
    columns: int
    rows: int

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> "Grid":
        """Return that of a row of the table of maps."""
        corner = row["corner_x_m"], row["corner_y_m"]
        return cls(corner, row["turn_rad"], row["cell_m"], row["columns"], row["rows"])


class KnownMap:
    """A map up to some number of changes."""

    def __init__(self) -> None:
        self.changes = 0
        self.grid: Grid | None = None
        self.states: States = np.zeros(0, dtype=np.int8)
        """Shape (cells,): 0 unknown, -1 empty, 1 occupied."""

    def change(self, row: Mapping[str, Any]) -> None:
        """Take the next change, a row of the table of maps."""
        grid = Grid.of(row)
        if grid != self.grid:
            self.grid, self.states = grid, np.zeros(grid.columns * grid.rows, dtype=np.int8)
        for column, state in _STATES:
            self.states[numbers_of(row[column])] = state
        self.changes += 1

    def copy(self) -> "KnownMap":
        """Return it as it is."""
        made = KnownMap()
        made.changes, made.grid, made.states = self.changes, self.grid, self.states.copy()
        return made


def together(robot: int, parts: Sequence[tuple[int, KnownMap]]) -> Plain:
    """Return the message ``map`` of *parts*, (source, map), those of one grid: what any knows, walls before floor."""
    message: Plain = {"say": "map", "robot": robot, "maps": [[source, known.changes] for source, known in parts]}
    grid = parts[0][1].grid if parts else None
    if grid is None or any(known.grid != grid for _, known in parts):
        return message
    empty, occupied = (np.any([known.states == state for _, known in parts], axis=0) for state in (-1, 1))
    cells = {"empty": empty & ~occupied, "occupied": occupied}
    return message | grid._asdict() | {name: ranges_of(np.flatnonzero(mask)) for name, mask in cells.items()}


def sources_of(robot: int, known: Iterable[int]) -> list[int]:
    """Return whose maps make up what *robot*, or the team, knows."""
    there = sorted(known)
    if COMMON in there:
        return [COMMON]
    return there if robot == TEAM else [robot] if robot in there else []


class StoredBeliefs:
    """What the robots of a recorded run believe."""

    def __init__(self, table: Callable[[str], StoredTable | None], ticks: Int64s) -> None:
        """Read the tables by *table*, which gives None for one that the run has not kept; *ticks* are the world's."""
        self._maps, self._ways, self._estimates = (table(each.name) for each in (MAPS, WAYS, ESTIMATES))
        self._ticks = ticks
        self._changes, self._turns = _by_source(self._maps), _by_source(self._ways)
        self._estimated = _times(self._estimates)
        self._way_of_row = lru_cache(_ROWS)(self._read_way)
        self._lock = threading.Lock()
        """Held by who looks at a map: pages ask in threads."""
        self._shown: dict[int, KnownMap] = {}
        """The maps that were asked for last, by source."""
        self._copies: dict[int, list[KnownMap]] = defaultdict(list)
        self._bytes = 0

    def headings_rad(self, tick: Time) -> list[float]:
        """Return where robots take themselves to head by odometry at a *tick*, in their order; empty if untold."""
        at = [] if self._estimates is None else self._estimates_at(tick)
        return [heading for _, origin, _, _, heading, *_ in at if origin == ODOMETRY]

    def told(self, time: Time, known: Plain) -> Plain:
        """Return what they believe at *time*, those parts that differ from *known*."""
        now: Plain = {
            "maps": [[source, _count(times, time)] for source, (times, _) in self._changes.items()],
            "ways": [self._way(source, _count(times, time)) for source, (times, _) in self._turns.items()],
            "estimates": self._estimates_at(time),
        }
        now["maps"] = [row for row in now["maps"] if row[1]]
        now["ways"] = [row for row in now["ways"] if row is not None]
        return {name: rows for name, rows in now.items() if rows != known.get(name, [])}

    def map(self, robot: int, time: Time) -> Plain:
        """Return the message ``map``."""
        counts = {source: _count(times, time) for source, (times, _) in self._changes.items()}
        sources = sources_of(robot, [source for source, count in counts.items() if count])
        with self._lock:
            return together(robot, [(source, self._map(source, counts[source])) for source in sources])

    def _map(self, source: int, changes: int) -> KnownMap:
        """Return a map after so many changes, from the last one shown or the nearest copy before."""
        known = self._shown.get(source)
        if known is None or known.changes > changes:
            before = [copy for copy in self._copies[source] if copy.changes <= changes]
            known = before[-1].copy() if before else KnownMap()
        rows = self._changes[source][1]
        assert self._maps is not None
        while known.changes < changes:
            upto = min(changes, (known.changes // _APART + 1) * _APART)
            for row in self._maps.rows_at(rows[known.changes : upto]):
                known.change(row)
            self._keep(source, known)
        self._shown[source] = known
        return known

    def _keep(self, source: int, known: KnownMap) -> None:
        copies = self._copies[source]
        new = known.changes % _APART == 0 and (not copies or copies[-1].changes < known.changes)
        if new and self._bytes + known.states.nbytes <= _KEPT_BYTES:
            copies.append(known.copy())
            self._bytes += known.states.nbytes

    def _way(self, robot: int, changes: int) -> Row | None:
        if not changes:
            return None
        return self._way_of_row(int(self._turns[robot][1][changes - 1]))

    def _read_way(self, number: int) -> Row | None:
        assert self._ways is not None
        return _way(self._ways.rows(number, number + 1)[0])

    def _estimates_at(self, time: Time) -> list[Row]:
        at = _count(self._ticks, time) - 1
        if self._estimates is None or at < 0:
            return []
        tick = self._ticks[at]
        first, end = (int(np.searchsorted(self._estimated, tick, side=side)) for side in ("left", "right"))
        return [_estimate(row) for row in self._estimates.rows(first, end)]


class PresentBeliefs:
    """What the robots of a run under way believe now."""

    def __init__(self) -> None:
        self._maps: dict[int, KnownMap] = defaultdict(KnownMap)
        self._ways: dict[int, Row] = {}
        self._estimates: list[Row] = []

    def take(self, new: Mapping[str, Sequence[tuple[Any, ...]]], tick: Time) -> None:
        """Take the *new* rows of tables, by name; *tick* is the last one of the world."""
        for row in _rows(MAPS, new):
            self._maps[row["source"]].change(row)
        for row in _rows(WAYS, new):
            self._ways[row["source"]] = _way(row) or [row["source"], [], None]
        self._estimates = [_estimate(row) for row in _rows(ESTIMATES, new) if row["time_ns"] == tick]

    def told(self, time: Time, known: Plain) -> Plain:
        """Return what they believe now, those parts that differ from *known*."""
        maps = [[source, each.changes] for source, each in sorted(self._maps.items())]
        ways = [self._ways[robot] for robot in sorted(self._ways) if self._ways[robot][1:] != [[], None]]
        now: Plain = {"maps": maps, "ways": ways, "estimates": self._estimates}
        return {name: rows for name, rows in now.items() if rows != known.get(name, [])}

    def map(self, robot: int, time: Time) -> Plain:
        """Return the message ``map``."""
        return together(robot, [(source, self._maps[source]) for source in sources_of(robot, self._maps)])


def check_robot(scene: Plain, robot: int) -> None:
    """Raise UserError for a *robot* that the team of a *scene* does not have."""
    if not 0 <= robot < len(scene["radii_m"]):
        raise UserError(f"there is no robot {robot}: the team has robots 0 to {len(scene['radii_m']) - 1}")


# ---------------------------------------------------------------- rows


def _rows(table: Table, new: Mapping[str, Sequence[tuple[Any, ...]]]) -> list[dict[str, Any]]:
    names = [field.name for field in table.fields]
    return [dict(zip(names, values, strict=True)) for values in new.get(table.name, ())]


def _way(row: Mapping[str, Any]) -> Row | None:
    """Return a row of the table of ways as a page gets it; None if the robot means to go nowhere."""
    goal = None if row["goal_x_m"] is None else [round(row["goal_x_m"], _MM), round(row["goal_y_m"], _MM)]
    points = way_of(row["points"])
    return [row["source"], points, goal] if points or goal else None


def _estimate(row: Mapping[str, Any]) -> Row:
    names = ("x_m", "y_m", "heading_rad", "xx_m2", "xy_m2", "yy_m2")
    return [row["source"], row["origin"], *(None if row[name] is None else round(row[name], 6) for name in names)]


def _times(table: StoredTable | None) -> Int64s:
    times: Int64s = np.zeros(0, dtype=np.int64) if table is None else table.column("time_ns")
    return times


def _by_source(table: StoredTable | None) -> dict[int, tuple[Int64s, Int64s]]:
    """Return of each source the times of its rows, and their numbers."""
    if table is None:
        return {}
    sources, times = table.column("source"), _times(table)
    numbers = {source: np.flatnonzero(sources == source) for source in np.unique(sources).tolist()}
    return {source: (times[rows], rows) for source, rows in numbers.items()}


def _count(times: Int64s, time: Time) -> int:
    return int(np.searchsorted(times, time, side="right"))
