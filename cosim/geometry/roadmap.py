"""Shortest ways over a planning grid by the corners at which they bend: many questions about one floor, each at once.

A wavefront (:mod:`cosim.geometry.planning`) visits every cell for one goal. The shortest ways among obstacles bend only
at their convex corners; so the free cells at these corners are the nodes of a visibility graph, all of whose shortest
ways are computed beforehand (T. Lozano-Perez and M. A. Wesley, "An algorithm for planning collision-free paths among
polyhedral obstacles", Communications of the ACM 22(10), 1979). A question looks from both of its ends to the nodes.

Lines of sight are lines all of whose cells are free, from any point to any point; so ways have the clearance of the
grid. A bend is the centre of a cell; the shortest way by centres may bend at other cells still, and be shorter by a
cell or two among scattered obstacles; among the walls of a building ways are shorter than those of eight directions.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.ndimage
import scipy.sparse.csgraph

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats, Int32s
from cosim.geometry.planning import PlanningGrid, Point
from cosim.jit import njit

_CORNER: Final = 1e-9
"""Distance from a cell's corner, in cells, within which a line meets all four cells there."""


@dataclass(frozen=True, eq=False)
class Roadmap:
    """The bends of a *grid*, and the shortest ways between them."""

    grid: PlanningGrid
    nodes: Floats
    """Shape (n, 2): x, y of each node in cells of the grid, from its origin."""
    length: Floats
    """Shape (n, n): the shortest way between nodes in cells, inf where there is none."""
    after: Int32s
    """Shape (n, n): the node after i on the way to j."""
    part: Int32s
    """Shape (ny, nx): free cells with ways between them have the same number, not 0; others 0."""

    def open(self, a_m: Point, b_m: Point) -> bool:
        """Return whether the line between two points of the grid meets free cells only."""
        return bool(line_is_free(self.grid.free, *self._cells(a_m), *self._cells(b_m)))

    def joined(self, a_m: Point, b_m: Point) -> bool:
        """Return whether a way leads from one point of the grid, in a free cell, to another."""
        part = int(self.part.flat[self.grid.cell_at(*a_m)])
        return part > 0 and part == int(self.part.flat[self.grid.cell_at(*b_m)])

    def length_m(self, a_m: Point, b_m: Point) -> float:
        """Return the length of the way between two points of the grid in metres, inf without a way over nodes."""
        length, _, _ = shortest(self.grid.free, self.nodes, self.length, *self._cells(a_m), *self._cells(b_m))
        return float(length) * self.grid.cell_m

    def way(self, a_m: Point, b_m: Point) -> list[Point] | None:
        """Return the bends between two points of the grid and the second of them; None without a way over nodes."""
        length, first, last = shortest(self.grid.free, self.nodes, self.length, *self._cells(a_m), *self._cells(b_m))
        if length == math.inf:
            return None
        bends = []
        if first >= 0:
            at = int(first)
            while at != last:
                bends.append(at)
                at = int(self.after[at, last])
            bends.append(at)
        x_m, y_m = self.grid.origin_m
        cell_m = self.grid.cell_m
        return [*((x_m + x * cell_m, y_m + y * cell_m) for x, y in self.nodes[bends].tolist()), b_m]

    def lengths_m(self, points_m: Floats) -> Floats:
        """Return the lengths of the ways between all *points_m*, shape (n, 2), in metres, shape (n, n)."""
        points = (np.asarray(points_m, np.float64).reshape(-1, 2) - self.grid.origin_m) / self.grid.cell_m
        lengths: Floats = _all_shortest(self.grid.free, self.nodes, self.length, points) * self.grid.cell_m
        return lengths

    def sights(self, points_m: Floats) -> Floats:
        """Return how far nodes are from *points_m*, shape (k, 2), in cells, inf out of sight; shape (k, n)."""
        points = (np.asarray(points_m, np.float64).reshape(-1, 2) - self.grid.origin_m) / self.grid.cell_m
        return _all_to_nodes(self.grid.free, self.nodes, points)

    def lengths_from_m(self, a_m: Point, points_m: Floats, sights: Floats) -> Floats:
        """Return the lengths of the ways from a point to all *points_m*, shape (k, 2), in metres, shape (k,).

        *sights* are those of :meth:`sights`.
        """
        points = (np.asarray(points_m, np.float64).reshape(-1, 2) - self.grid.origin_m) / self.grid.cell_m
        lengths: Floats = _from_one(self.grid.free, self.nodes, self.length, *self._cells(a_m), points, sights)
        return lengths * self.grid.cell_m

    def _cells(self, point_m: Point) -> Point:
        grid = self.grid
        return (point_m[0] - grid.origin_m[0]) / grid.cell_m, (point_m[1] - grid.origin_m[1]) / grid.cell_m


def roadmap(grid: PlanningGrid, most_nodes: int) -> Roadmap | None:
    """Return the roadmap of *grid*, or None if it would have more than *most_nodes* (their square is computed)."""
    free = grid.free
    nodes = corners(free)
    if len(nodes) > most_nodes:
        return None
    seen = _sights(free, nodes)
    if len(nodes):
        length, before = scipy.sparse.csgraph.dijkstra(seen, directed=False, return_predecessors=True)
    else:
        length, before = np.zeros((0, 0)), np.zeros((0, 0), np.int32)
    part, _ = scipy.ndimage.label(free)
    # the node before i on the way from j is the one after i on the way to j
    return Roadmap(grid, nodes, length, np.ascontiguousarray(before.T, np.int32), np.asarray(part, np.int32))


def corners(free: Bools) -> Floats:
    """Return the centres (in cells, shape (n, 2)) of the *free* cells at which shortest ways can bend.

    One of their diagonal neighbours is not free while both cells between are.
    """
    solid = np.pad(~free, 1, constant_values=False)
    bends = np.zeros_like(free)
    ny, nx = free.shape
    for dy in (0, 2):
        for dx in (0, 2):
            aside, ahead = ~solid[1 : 1 + ny, dx : dx + nx], ~solid[dy : dy + ny, 1 : 1 + nx]
            bends |= free & solid[dy : dy + ny, dx : dx + nx] & aside & ahead
    rows, columns = np.nonzero(bends)
    return np.stack((columns + 0.5, rows + 0.5), axis=1).astype(np.float64)


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def line_is_free(free: Bools, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether all cells that the line between two points (in cells) meets are free; off the grid nothing is."""
    ny, nx = free.shape
    ix, iy = math.floor(ax), math.floor(ay)
    end_x, end_y = math.floor(bx), math.floor(by)
    if not (0 <= ix < nx and 0 <= iy < ny and 0 <= end_x < nx and 0 <= end_y < ny):
        return False
    dx, dy = bx - ax, by - ay
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    # at which fraction of the line the next border across x, and across y, is met
    each_x = abs(1.0 / dx) if dx != 0.0 else math.inf
    each_y = abs(1.0 / dy) if dy != 0.0 else math.inf
    next_x = (ix + (step_x > 0) - ax) / dx if dx != 0.0 else math.inf
    next_y = (iy + (step_y > 0) - ay) / dy if dy != 0.0 else math.inf
    near = _CORNER * min(each_x, each_y)
    for _ in range(abs(end_x - ix) + abs(end_y - iy) + 1):
        if not free[iy, ix]:
            return False
        if ix == end_x and iy == end_y:
            return True
        across_x, across_y = next_x <= next_y + near, next_y <= next_x + near
        if across_x and across_y:
            if not (0 <= ix + step_x < nx and 0 <= iy + step_y < ny):
                return False
            if not (free[iy, ix + step_x] and free[iy + step_y, ix]):
                return False
        if across_x:
            ix, next_x = ix + step_x, next_x + each_x
        if across_y:
            iy, next_y = iy + step_y, next_y + each_y
        if not (0 <= ix < nx and 0 <= iy < ny):
            return False
    return bool(free[iy, ix] and ix == end_x and iy == end_y)


@njit(cache=True)
def _sights(free: Bools, nodes: Floats) -> Floats:
    """Return the distances between nodes that see each other, 0 where they do not."""
    count = nodes.shape[0]
    seen = np.zeros((count, count))
    for i in range(count):
        for j in range(i):
            if line_is_free(free, nodes[i, 0], nodes[i, 1], nodes[j, 0], nodes[j, 1]):
                seen[i, j] = seen[j, i] = elementary.hypot(nodes[i, 0] - nodes[j, 0], nodes[i, 1] - nodes[j, 1])
    return seen


@njit(cache=True)
def _to_nodes(free: Bools, nodes: Floats, x: float, y: float) -> Floats:
    """Return how far the nodes are that a point sees, inf for the others."""
    ways = np.full(nodes.shape[0], math.inf)
    for k in range(nodes.shape[0]):
        if line_is_free(free, x, y, nodes[k, 0], nodes[k, 1]):
            ways[k] = elementary.hypot(nodes[k, 0] - x, nodes[k, 1] - y)
    return ways


@njit(cache=True)
def shortest(
    free: Bools, nodes: Floats, length: Floats, ax: float, ay: float, bx: float, by: float
) -> tuple[float, int, int]:
    """Return the length of the way from a to b, and its first and last node; -1 for both if it is straight."""
    if line_is_free(free, ax, ay, bx, by):
        return elementary.hypot(bx - ax, by - ay), -1, -1
    return _over_nodes(_to_nodes(free, nodes, ax, ay), _to_nodes(free, nodes, bx, by), length)


@njit(cache=True)
def _over_nodes(out: Floats, back: Floats, length: Floats) -> tuple[float, int, int]:
    """Return the shortest of the ways with the ends *out* and *back*, with its first and last node."""
    best, first, last = math.inf, -1, -1
    for i in range(out.shape[0]):
        if out[i] < best:
            for j in range(back.shape[0]):
                way = out[i] + length[i, j] + back[j]
                if way < best:
                    best, first, last = way, i, j
    return best, first, last


@njit(cache=True)
def _all_to_nodes(free: Bools, nodes: Floats, points: Floats) -> Floats:
    sights = np.empty((points.shape[0], nodes.shape[0]))
    for k in range(points.shape[0]):
        sights[k] = _to_nodes(free, nodes, points[k, 0], points[k, 1])
    return sights


@njit(cache=True)
def _from_one(
    free: Bools, nodes: Floats, length: Floats, ax: float, ay: float, points: Floats, sights: Floats
) -> Floats:
    """Return the lengths of the ways from a to all *points*, in cells."""
    out = _to_nodes(free, nodes, ax, ay)
    reached = np.full(nodes.shape[0], math.inf)
    for i in range(nodes.shape[0]):
        if out[i] < math.inf:
            reached = np.minimum(reached, out[i] + length[i])
    ways = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if line_is_free(free, ax, ay, x, y):
            ways[k] = elementary.hypot(x - ax, y - ay)
            continue
        ways[k] = math.inf
        for i in range(nodes.shape[0]):
            ways[k] = min(ways[k], reached[i] + sights[k, i])
    return ways


@njit(cache=True)
def _all_shortest(free: Bools, nodes: Floats, length: Floats, points: Floats) -> Floats:
    count = points.shape[0]
    ways = np.zeros((count, count))
    sights = _all_to_nodes(free, nodes, points)
    for k in range(count):
        ways[k] = _from_one(free, nodes, length, points[k, 0], points[k, 1], points, sights)
    return ways
