"""The known map as a planning grid: built once a run, shared by the planner and by all robots' movers (paper 004, 6).

For each radius of a body there is one grid of the cells in which its centre may be, a margin off the walls. A cell's
price falls from that margin to the distance of comfort, so that ways lead through the middle of doors. A field is the
value function of a goal: the cost that is left to it from everywhere. A field can have standing bodies as obstacles
besides the walls; such a field is not kept.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats, Singles
from cosim.geometry.grids import Cell
from cosim.geometry.planning import PlanningGrid, Point, nearest_free, wall_planning_grid, way_points
from cosim.geometry.polylines import length_m as polyline_m
from cosim.geometry.segments import SegmentGrid, clearance, segment_grid, swept_clearance
from cosim.geometry.value_iteration import ahead, cheapest_way, values
from cosim.protocol import Surroundings
from protocols.motion.parameters import DrivingParameters

_KEPT: Final = 64
"""Number of fields that are remembered, the latest asked for."""
_SNAP_M: Final = 0.35
"""Largest distance of a place that is not in a free cell from the free cell that it is taken for."""
_SEEN_SHARE: Final = 0.75
"""Share of the margin that a straight line to an aim keeps off the walls."""


class Blocker(NamedTuple):
    """A disc as an obstacle."""

    x_m: float
    y_m: float
    radius_m: float

    @property
    def place_m(self) -> Point:
        """Centre of the disc."""
        return self.x_m, self.y_m


class Aim(NamedTuple):
    """Where to drive from some place, according to a field."""

    place_m: Point
    """Last point of the way that is in sight, or the goal."""
    left_m: float
    """Length of the way to the goal."""
    last: bool
    """True if the place is the goal."""


class Field:
    """The cost of the way to one goal from everywhere, for one radius."""

    def __init__(self, grid: PlanningGrid, price: Singles, goal_m: Point, fits: bool) -> None:
        """Take the goal, and whether a body *fits* there, though its cell's centre may be too near to a wall."""
        self._grid, self._price = grid, price
        goal = snapped(grid, goal_m)
        self.goal_m = goal_m if fits or goal < 0 or _holds(grid, goal, goal_m) else grid.centre_m(goal)
        """Goal, or the nearest place to it where the body fits."""
        self._value = values(grid.free, price, [goal] if goal >= 0 else [])

    def cost_m(self, at: Point) -> float:
        """Return the cost of the cheapest way from a place, its length times prices, in metres; inf without one."""
        cell = snapped(self._grid, at)
        return float(self._value.flat[cell]) * self._grid.cell_m if cell >= 0 else math.inf

    def distance_m(self, at: Point) -> float:
        """Return the length of that way, step by step, in metres; inf without one."""
        cell = snapped(self._grid, at)
        if cell < 0:
            return math.inf
        return float(ahead(self._grid.free, self._price, self._value, cell, 0.0)[1]) * self._grid.cell_m

    def aim(self, at: Point, reach_m: float, out: bool = False) -> Aim | None:
        """Return where to drive from a place: a point of the way in sight, at most *reach_m* off; None without a way.

        A body that does not fit where it is, too near to a wall or to another body, is taken to be at the nearest place
        where it does; if it is to get *out* of there, it drives to that place first.
        """
        grid, start = self._grid, snapped(self._grid, at)
        if start < 0:
            return None
        seen, left = ahead(grid.free, self._price, self._value, start, reach_m / grid.cell_m)
        if not left < math.inf:
            return None
        last = bool(self._value.flat[seen] == 0.0)
        if last:
            return Aim(self.goal_m, math.dist(at, self.goal_m), True)
        if seen == start or (out and not _holds(grid, start, at)):
            return Aim(grid.centre_m(start), left * grid.cell_m, False)
        return Aim(grid.centre_m(seen), left * grid.cell_m, False)

    def way(self, start: Point) -> list[Point] | None:
        """Return the corners of the way from a place, both ends included; None without one."""
        grid, cell = self._grid, snapped(self._grid, start)
        if cell < 0:
            return None
        cells = cheapest_way(grid.free, self._price, self._value, cell)
        if not len(cells):
            return None
        corners = [grid.centre_m(int(each)) for each in way_points(grid.free, cells)]
        return [start, *corners[1:-1], self.goal_m]


class Floor:
    """The known map of a run."""

    def __init__(
        self,
        walls_m: npt.ArrayLike,
        bounds_m: tuple[float, float, float, float],
        forbidden: Callable[[Floats], Bools] | None,
        parameters: DrivingParameters | None = None,
    ) -> None:
        """Take walls (n, 4), the extent x_min, y_min, x_max, y_max, and what of it is occupied, unknown or outside."""
        self.parameters = parameters if parameters is not None else DrivingParameters()
        self.walls: SegmentGrid = segment_grid(walls_m)
        self.bounds_m = bounds_m
        self._forbidden = forbidden
        self._grids: dict[float, tuple[PlanningGrid, Singles]] = {}
        self._fields: OrderedDict[tuple[float, Point], Field] = OrderedDict()

    @classmethod
    def of(cls, surroundings: Surroundings, parameters: DrivingParameters | None = None) -> Self:
        """Return the floor on which a run takes place."""
        return cls(surroundings.walls_m, surroundings.bounds_m, surroundings.forbidden, parameters)

    # ------------------------------------------------------------ what planners ask

    def length_m(self, radius_m: float, a: Point, b: Point) -> float | None:
        """Return the length of the way of a disc from *a* to *b*; None if there is none, also if they are off the map.

        It is that of the way's corners: as a robot drives it, but for its turns.
        """
        way = self.way(radius_m, a, b)
        return None if way is None else float(polyline_m(way))

    def way(self, radius_m: float, a: Point, b: Point) -> list[Point] | None:
        """Return the corners of the way of a disc, both ends included; None if there is none."""
        return self.field(radius_m, b).way(a)

    def afar_m(self, radius_m: float, starts: Sequence[Point], others: Sequence[Point]) -> Floats:
        """Return how far each cell that a disc can get to from *starts* is from the nearest of them and of *others*.

        In metres, shape (n,), one cell after the other, along the ways of a point. Empty if one of the places is
        nowhere.
        """
        # a point gets wherever light does, so no cell is seen from farther off
        disc, _ = self.grid(radius_m)
        point, _ = self.grid(0.0)
        mine = [snapped(disc, place) for place in starts]
        all_ = [snapped(point, place) for place in (*starts, *others)]
        if min(*mine, *all_, 0) < 0:
            return np.zeros(0)
        even = np.ones(point.free.shape, np.float32)
        within = np.isfinite(values(disc.free, even, mine))
        away = values(point.free, even, all_)[within] * point.cell_m
        return np.asarray(away[np.isfinite(away)], np.float64)

    def free(self, radius_m: float, at: Point) -> bool:
        """Return whether a disc can stand at *at*, with the margin to all walls."""
        x, y = at
        x_min, y_min, x_max, y_max = self.bounds_m
        if not (x_min <= x <= x_max and y_min <= y <= y_max):
            return False
        point = np.array([[x, y]])
        if self._forbidden is not None and bool(self._forbidden(point)[0]):
            return False
        return bool(clearance(self.walls, point, 2.0 * self._kept_m(radius_m))[0] >= self._kept_m(radius_m) - 1e-9)

    # ------------------------------------------------------------ what movers ask

    def field(self, radius_m: float, goal: Point) -> Field:
        """Return the field of a goal; the latest ones are remembered."""
        key = radius_m, (float(goal[0]), float(goal[1]))
        field = self._fields.pop(key, None)
        if field is None:
            field = Field(*self.grid(radius_m), key[1], self.free(radius_m, key[1]))
        self._fields[key] = field
        if len(self._fields) > _KEPT:
            self._fields.popitem(last=False)
        return field

    def aim(self, radius_m: float, field: Field, at: Point, out: bool = False) -> Aim | None:
        """Return where to drive in a *field*: as far ahead as a straight line keeps clear of the walls.

        At most the parameters' ``look_ahead_m``; *out* as in :meth:`Field.aim`. None without a way.
        """
        kept_m = radius_m + _SEEN_SHARE * self.parameters.margin_m
        reach_m, aim = self.parameters.look_ahead_m, None
        while reach_m > 0.5 * self.parameters.cell_m:
            aim = field.aim(at, reach_m, out)
            if aim is None:
                return None
            line = np.array([[*at, *at], [*at, *aim.place_m]])
            here, along = swept_clearance(self.walls, line[:, :2], line[:, 2:], kept_m).tolist()
            # a robot that is too near to a wall already may follow any line that comes no nearer
            if along >= here - 1e-6:
                return aim
            # the line comes too near to a wall: aim less far ahead
            reach_m = min(0.5 * reach_m, 0.8 * math.dist(at, aim.place_m))
        return aim

    def field_among(self, radius_m: float, goal: Point, blockers: Sequence[Blocker]) -> Field:
        """Return the field of a goal with discs as obstacles besides the walls."""
        grid, price = self.grid(radius_m)
        free = self.free_among(radius_m, blockers)
        return Field(PlanningGrid(grid.origin_m, grid.cell_m, free), price, goal, self.free(radius_m, goal))

    def free_among(self, radius_m: float, blockers: Sequence[Blocker]) -> Bools:
        """Return in which cells a body may be, with discs as obstacles besides the walls; shape (ny, nx)."""
        grid, _ = self.grid(radius_m)
        free, margin = grid.free.copy(), self.parameters.margin_m + self.parameters.stray_m
        ny, nx = free.shape
        for x, y, other_m in blockers:
            apart = radius_m + other_m + margin
            low_x, low_y = (x - apart - grid.origin_m[0]) / grid.cell_m, (y - apart - grid.origin_m[1]) / grid.cell_m
            wide = math.ceil(2.0 * apart / grid.cell_m) + 1
            columns = np.arange(max(math.floor(low_x), 0), min(math.floor(low_x) + wide + 1, nx))
            rows = np.arange(max(math.floor(low_y), 0), min(math.floor(low_y) + wide + 1, ny))
            if not (len(columns) and len(rows)):
                continue
            off_x = grid.origin_m[0] + (columns + 0.5) * grid.cell_m - x
            off_y = grid.origin_m[1] + (rows + 0.5) * grid.cell_m - y
            near = off_x[None, :] ** 2 + off_y[:, None] ** 2 < apart * apart
            free[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] &= ~near
        return free

    def grid(self, radius_m: float) -> tuple[PlanningGrid, Singles]:
        """Return where the centre of a disc may be, and what each cell costs (1: far from walls)."""
        known = self._grids.get(radius_m)
        if known is None:
            known = self._grids[radius_m] = self._new_grid(radius_m)
        return known

    def _new_grid(self, radius_m: float) -> tuple[PlanningGrid, Singles]:
        own, kept = self.parameters, self._kept_m(radius_m)
        grid = wall_planning_grid(self.bounds_m, own.cell_m, kept, self.walls.walls_m, self._forbidden)
        ny, nx = grid.free.shape
        x, y = np.meshgrid(*(grid.origin_m[axis] + (np.arange((nx, ny)[axis]) + 0.5) * own.cell_m for axis in (0, 1)))
        room = clearance(self.walls, np.stack((x.ravel(), y.ravel()), axis=1), kept + own.comfort_m)
        near = np.clip((kept + own.comfort_m - room) / own.comfort_m, 0.0, 1.0).reshape(ny, nx)
        return grid, np.asarray(1.0 + (own.comfort_price - 1.0) * near, np.float32)

    def _kept_m(self, radius_m: float) -> float:
        """Return the distance that the centre of a body keeps from walls."""
        # with less than half a cell's diagonal, 0.71 cells, a diagonal step could cross the end of a wall; the planning
        # grid refuses that, so a point, which has only the margin, keeps a little more
        return max(radius_m + self.parameters.margin_m, 0.75 * self.parameters.cell_m)


def _holds(grid: PlanningGrid, cell: Cell, at: Point) -> bool:
    x, y = grid.centre_m(cell)
    return max(abs(at[0] - x), abs(at[1] - y)) <= 0.5 * grid.cell_m + 1e-9


def snapped(grid: PlanningGrid, at: Point) -> Cell:
    """Return the cell of a place if it is free, else the nearest free one that is near enough, or -1."""
    x, y = (at[0] - grid.origin_m[0]) / grid.cell_m, (at[1] - grid.origin_m[1]) / grid.cell_m
    ny, nx = map(int, grid.free.shape)
    if 0.0 <= x < nx and 0.0 <= y < ny and grid.free[int(y), int(x)]:
        return int(y) * nx + int(x)
    if not (math.isfinite(x) and math.isfinite(y)):
        return -1
    return int(nearest_free(grid.free, x, y, _SNAP_M / grid.cell_m))
