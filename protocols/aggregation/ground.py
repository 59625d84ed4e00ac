"""The ground that is searched: where a robot can stand, the ways there, and the posts from which all of it is seen.

All robots of a team are given the same ground: the walls are known, only the targets are not. A searcher that has stood
at every post has seen the whole floor.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Floats
from cosim.geometry.boundary import PackedBoundary, boundary, inflated, packed_boundary
from cosim.geometry.planning import PlanningGrid, Point, cost_to_go, wall_planning_grid
from cosim.geometry.polylines import length_m
from cosim.geometry.roadmap import Roadmap, line_is_free, roadmap
from cosim.geometry.segments import SegmentGrid, in_sight, room_along, segment_grid
from cosim.jit import njit
from protocols.aggregation.ground_posts import lattice, posts_of, rooms_of_cells

MOST_CORNERS: Final = 500
"""Largest number of corners for which a roadmap is made; ways on other floors come from wavefronts only."""
TOUCH_M: Final = 0.01
"""Room on a way in addition to the robot's radius."""
NOWHERE: Final = -1
_KEPT: Final = 8
"""Number of grounds that are cached for the next runs on their floors."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A floor, for robots of one radius with one camera."""

    radius_m: float
    """Radius of the bodies."""
    camera_m: float
    walls: SegmentGrid
    grid: PlanningGrid
    """Cells; free are those at whose centre a body has room for half a cell's diagonal more than its radius.

    So no way over free cells, straight from any point to any other, touches a wall.
    """
    roadmap: Roadmap | None
    """Roadmap; None if the floor has too many corners: then all ways come from wavefronts."""
    posts_m: tuple[Point, ...]
    """Posts, room by room, in an order in which neighbours lie near each other."""
    rooms: tuple[int, ...]
    """Number of the room of each post; -1 for none."""

    def open(self, a_m: Point, b_m: Point) -> bool:
        """Return whether a robot can go straight from one point to another, by the cells of the grid."""
        grid = self.grid
        (x, y), cell = grid.origin_m, grid.cell_m
        ends = (a_m[0] - x) / cell, (a_m[1] - y) / cell, (b_m[0] - x) / cell, (b_m[1] - y) / cell
        return bool(line_is_free(grid.free, *ends))

    def fits(self, a_m: Point, b_m: Point, more_m: float = 0.0) -> bool:
        """Return whether a body with *more_m* metres of room around it touches no wall on its way straight from a to b.

        It is exact where ``open``, which works by cells, is too careful.
        """
        reach = self.radius_m + more_m
        room_m: float = room_along(self.walls, *a_m, *b_m, reach + TOUCH_M)
        return room_m >= reach

    def stands(self, point_m: Point) -> Point | None:
        """Return a point itself if its cell is free, else the nearest free centre of a cell that it sees; or None.

        None if there is none within two metres or four cells.
        """
        grid = self.grid
        (ny, nx), cell_m = grid.free.shape, grid.cell_m
        x, y = (point_m[0] - grid.origin_m[0]) / cell_m, (point_m[1] - grid.origin_m[1]) / cell_m
        if 0.0 <= x < nx and 0.0 <= y < ny and grid.free[int(y), int(x)]:
            return point_m
        cell = _standing(grid.free, self.walls, *grid.origin_m, cell_m, x, y, max(2.0, 4.0 * cell_m) / cell_m)
        return grid.centre_m(cell) if cell != NOWHERE else None

    def way(self, start_m: Point, goal_m: Point) -> list[Point] | None:
        """Return the way points of a shortest way from *start_m* to *goal_m*, or None if none leads there.

        The start is left out; the last is the goal itself, or, where no robot can stand there, the nearest place in its
        sight where one can (see ``stands``). If no robot can stand at the start, the first way point is such a place.
        """
        start, goal = self.stands(start_m), self.stands(goal_m)
        if start is None or goal is None:
            return None
        points = self._between(start, goal)
        if points is None or start is start_m:
            return points
        return [start, *points]

    def length_m(self, start_m: Point, goal_m: Point) -> float | None:
        """Return the length of the way from *start_m* to *goal_m* in metres, or None if none leads there."""
        start, goal = self.stands(start_m), self.stands(goal_m)
        if start is None or goal is None:
            return None
        ends = math.dist(start_m, start)
        if self.roadmap is not None:
            length = self.roadmap.length_m(start, goal)
            if length < math.inf:
                return ends + length
        points = self._between(start, goal)
        if points is None:
            return None
        return ends + length_m([start, *points])

    @cached_property
    def lengths_m(self) -> Floats:
        """The lengths of the ways between all posts in metres, shape (P, P); inf where there is none."""
        posts = np.array(self.posts_m, np.float64).reshape(-1, 2)
        if self.roadmap is not None:
            return self.roadmap.lengths_m(posts)
        return np.array([self._wavefront_m(post) for post in self.posts_m]).reshape(len(posts), -1)

    def lengths_from_m(self, start_m: Point) -> Floats:
        """Return the lengths of the ways from *start_m* to all posts in metres, shape (P,), inf where there is none."""
        start = self.stands(start_m)
        if start is None:
            return np.full(len(self.posts_m), math.inf)
        if self.roadmap is not None:
            found = self.roadmap.lengths_from_m(start, np.array(self.posts_m), self._sights)
            return found + math.dist(start, start_m)
        return self._wavefront_m(start) + math.dist(start, start_m)

    def _wavefront_m(self, start: Point) -> Floats:
        """Return the lengths from a free cell to all posts, from cell to cell: some longer than straightened ways."""
        grid = self.grid
        cells = [grid.cell_at(*post) for post in self.posts_m]
        cost = cost_to_go(grid.free, [grid.cell_at(*start)])
        found: Floats = cost.ravel()[cells] * grid.cell_m
        return found

    @cached_property
    def _sights(self) -> Floats:
        assert self.roadmap is not None
        return self.roadmap.sights(np.array(self.posts_m))

    @cached_property
    def loops(self) -> PackedBoundary:
        """The outlines of the walls, grown by the radius, for a member that has no map and only feels and sees them."""
        obstacles, enclosures = inflated(self.walls.walls_m, self.radius_m + TOUCH_M)
        return packed_boundary(boundary(obstacles, enclosures))

    def way_around(self, start_m: Point, goal_m: Point, bodies_m: Sequence[Point], room_m: float) -> list[Point] | None:
        """Return a way like ``way`` that keeps *room_m* metres from the middles of some bodies, or None.

        It comes from a wavefront. A start or a goal within that room is kept.
        """
        grid = self.grid
        start, goal = self.stands(start_m), self.stands(goal_m)
        if start is None or goal is None:
            return None
        closed = PlanningGrid(grid.origin_m, grid.cell_m, _without(grid, bodies_m, room_m, (start, goal)))
        points = closed.plan(start, [goal])
        return points if points is None or start is start_m else [start, *points]

    def _between(self, start: Point, goal: Point) -> list[Point] | None:
        """Return the way points between two places where a robot can stand."""
        if self.roadmap is not None:
            if not self.roadmap.joined(start, goal):
                return None
            way = self.roadmap.way(start, goal)
            if way is not None:
                return way
        return self.grid.plan(start, [goal])


def ground(
    walls_m: npt.ArrayLike,
    bounds_m: tuple[float, float, float, float],
    places_m: Mapping[str, Sequence[Point]],
    radius_m: float,
    camera_m: float,
    cell_m: float,
    forbidden: Callable[[Floats], Bools] | None = None,
    most_corners: int = MOST_CORNERS,
) -> Ground:
    """Return the ground of a floor; the same object if it has been made before.

    *walls_m* has the shape (n, 4); ``places_m["rooms"]`` are points in the middle of the rooms; *radius_m* is that of
    the bodies, *camera_m* how far from a post everything in sight is looked at, *cell_m* the side of the grid's cells.
    *forbidden* returns for points (n, 2) which of them are occupied or outside. Doors need to be wider than
    2 radius + 2.42 cells, or there may be no way through. With *most_corners* 0 every way comes from a wavefront.

    Raise ValueError if a measure is not positive, no cell fits into the bounds, or no robot fits anywhere.
    """
    bounds = float(bounds_m[0]), float(bounds_m[1]), float(bounds_m[2]), float(bounds_m[3])
    walls = _with_bounds(np.ascontiguousarray(walls_m, np.float64).reshape(-1, 4), bounds)
    middles = tuple((float(px), float(py)) for px, py in places_m.get("rooms", ()))
    points = lattice(bounds, cell_m)
    solid = forbidden or _nowhere
    asked = _Solid(np.asarray(solid(points), np.bool_).tobytes(), solid)
    return _ground(walls.tobytes(), bounds, middles, radius_m, camera_m, cell_m, most_corners, asked)


@dataclass(frozen=True)
class _Solid:
    """Where the floor is occupied; equal to another with the same answers, as floors are read for every run."""

    answers: bytes
    ask: Callable[[Floats], Bools] = field(compare=False)


def _nowhere(points_m: Floats) -> Bools:
    return np.zeros(len(points_m), np.bool_)


def _with_bounds(walls_m: Floats, bounds_m: tuple[float, float, float, float]) -> Floats:
    """Return the walls together with those sides of the floor's bounds that are not among them."""
    x, y, x_max, y_max = bounds_m
    sides = ((x, y, x_max, y), (x_max, y, x_max, y_max), (x, y_max, x_max, y_max), (x, y, x, y_max))
    known = {(min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2)) for x1, y1, x2, y2 in walls_m.tolist()}
    missing = [side for side in sides if side not in known]
    return np.concatenate((walls_m, np.array(missing, np.float64).reshape(-1, 4)))


@lru_cache(maxsize=_KEPT)
def _ground(
    walls_bytes: bytes,
    bounds_m: tuple[float, float, float, float],
    middles_m: tuple[Point, ...],
    radius_m: float,
    camera_m: float,
    cell_m: float,
    most_corners: int,
    solid: _Solid,
) -> Ground:
    if not camera_m > 0:
        raise ValueError(f"camera's range {camera_m} m is not > 0")
    walls_m = np.frombuffer(walls_bytes).reshape(-1, 4)
    walls = segment_grid(walls_m)
    room_m = radius_m + 0.5 * math.sqrt(2.0) * cell_m + TOUCH_M
    grid = wall_planning_grid(bounds_m, cell_m, room_m, walls_m, solid.ask)
    if not grid.free.any():
        raise ValueError(f"a robot of {radius_m} m fits nowhere on a grid of {cell_m} m")
    rooms = rooms_of_cells(grid, walls, list(middles_m))
    posts = posts_of(grid, walls, rooms, solid.ask, camera_m)
    posts_m = tuple(grid.centre_m(post) for post in posts)
    of = tuple(int(rooms.flat[post]) for post in posts)
    return Ground(radius_m, camera_m, walls, grid, roadmap(grid, most_corners), posts_m, of)


@njit(cache=True)
def _standing(
    free: Bools, walls: SegmentGrid, origin_x: float, origin_y: float, cell: float, x: float, y: float, reach: float
) -> int:
    """Return the number of the nearest free cell in the sight of (x, y), within *reach*, in cells; NOWHERE if none."""
    ny, nx = free.shape
    best, found = reach * reach, NOWHERE
    for iy in range(max(int(y - reach), 0), min(int(y + reach) + 1, ny)):
        for ix in range(max(int(x - reach), 0), min(int(x + reach) + 1, nx)):
            square = (ix + 0.5 - x) ** 2 + (iy + 0.5 - y) ** 2
            if free[iy, ix] and square < best:
                to_x, to_y = origin_x + (ix + 0.5) * cell, origin_y + (iy + 0.5) * cell
                if in_sight(walls, origin_x + x * cell, origin_y + y * cell, to_x, to_y):
                    best, found = square, iy * nx + ix
    return found


def _without(grid: PlanningGrid, bodies_m: Sequence[Point], room_m: float, kept_m: Sequence[Point]) -> Bools:
    """Return the free cells without those whose centres lie within *room_m* of a body; those of *kept_m* are kept."""
    (x, y), (ny, nx) = grid.origin_m, grid.free.shape
    xs, ys = x + (np.arange(nx) + 0.5) * grid.cell_m, y + (np.arange(ny) + 0.5) * grid.cell_m
    free = grid.free.copy()
    for body_x, body_y in bodies_m:
        columns, rows = (np.flatnonzero(np.abs(away_m) < room_m + grid.cell_m) for away_m in (xs - body_x, ys - body_y))
        squares = (xs[columns] - body_x)[None, :] ** 2 + (ys[rows] - body_y)[:, None] ** 2
        free[np.ix_(rows, columns)] &= squares > room_m * room_m
    for point in kept_m:
        free.flat[grid.cell_at(*point)] = True
    return free
