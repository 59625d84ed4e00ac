"""The way out of a local minimum: a path to a frontier, laid into the robot's own map as unexplored cells.

Paper 001, sections 3.6 and 3.7. The schemas are drawn along it as to any frontier; cells of the path are taken back
when the robot is as near to them as obstacles repel it, and all when a frontier is in sight within the sensors' range.
"""

import math
from typing import Final

import numpy as np

from cosim.geometry.astar import clearance_cost, in_sight, lookouts, nearest, nearest_frontier, passable_cells
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from protocols.exploration.belief import Belief, Bytes
from protocols.exploration.parameters import EscapeParameters

_SLACK_CELLS: Final = 0.5
"""So much wider than its body a robot plans."""


class Overlay:
    """What one robot adds to the frontiers of the map, its path, and what it leaves out, as it has given it up."""

    def __init__(self, belief: Belief) -> None:
        self._belief = belief
        self.path: Bytes = np.zeros_like(belief.frontier)
        self.given_up: Bytes = np.zeros_like(belief.frontier)
        self.underway = False
        """Whether any cell of a path is left."""
        self._any_given_up = False

    def attracting(self) -> Bytes:
        """Return what attracts the robot: a grid as ``marking`` has frontiers."""
        frontier = self._belief.frontier
        if self._any_given_up:
            frontier = self.frontiers()
        return frontier | self.path if self.underway else frontier

    def frontiers(self) -> Bytes:
        """Return the frontiers that have not been given up."""
        return self._belief.frontier & ~self.given_up

    def lay(self, cells: "list[Cell]") -> None:
        """Let a path of cells seem unexplored."""
        nx = self._belief.frame.nx
        self.path[:] = 0
        for cell in cells:
            self.path[cell // nx, cell % nx] = 1
        self.underway = bool(cells)

    def pass_by(self, place_m: Point, reach_m: float) -> bool:
        """Take back the cells of the path that are near; return whether there were any."""
        if not self.underway:
            return False
        frame = self._belief.frame
        (left, low), size = frame.origin_m, frame.cell_m
        rows, columns = np.nonzero(self.path)
        away = np.hypot(left + (columns + 0.5) * size - place_m[0], low + (rows + 0.5) * size - place_m[1])
        near = away <= reach_m
        self.path[rows[near], columns[near]] = 0
        self.underway = not near.all()
        return bool(near.any())

    def clear(self) -> None:
        """Take back the whole path."""
        self.path[:] = 0
        self.underway = False

    def give_up(self, cells: "list[Cell]") -> None:
        """Leave frontier cells out from now on."""
        nx = self._belief.frame.nx
        for cell in cells:
            self.given_up[cell // nx, cell % nx] = 1
        self._any_given_up = True


class Escape:
    """Plans ways for one robot."""

    def __init__(self, parameters: EscapeParameters, belief: Belief, radius_m: float, range_m: float) -> None:
        self._own = parameters
        self._belief = belief
        size = belief.frame.cell_m
        self._radius = radius_m / size + _SLACK_CELLS
        self._clear = max(parameters.clearance_m / size, 1.0)
        self._reach = range_m / size

    def way(self, here_m: Point, frontiers: Bytes) -> tuple[list[Cell], bool] | None:
        """Return the cells to the nearest of *frontiers*, and whether it is in sight; None if no way leads to one.

        Who is too wide to come to any goes where one can be seen within the sensors' range.
        """
        evidence = self._belief.evidence
        nx = self._belief.frame.nx
        start = self._belief.frame.cell_at(here_m)
        passable = passable_cells(evidence, self._radius)
        extra = clearance_cost(evidence > 0, self._clear, self._own.clearance_cost)
        clear = evidence < 0
        goals = frontiers[:, :nx].astype(np.bool_)
        found = nearest_frontier(passable, clear, extra, start, goals, self._own.cost)
        if found is None:
            watch = lookouts(passable, clear, goals, self._reach * 0.9)
            found = nearest(passable, extra, start, watch, self._own.cost) if watch.any() else None
        if found is None:
            return None
        cells = [int(cell) for cell in found]
        goal = np.zeros_like(goals)
        goal.flat[cells[-1]] = True
        return cells, bool(in_sight(clear, start, goal).any())

    def sees(self, here_m: Point, frontiers: Bytes) -> bool:
        """Return whether one of *frontiers* is in line of sight within the sensors' range."""
        frame = self._belief.frame
        cell = frame.cell_at(here_m)
        iy, ix = divmod(cell, frame.nx)
        reach = math.ceil(self._reach)
        rows = slice(max(iy - reach, 0), min(iy + reach + 1, frame.ny))
        columns = slice(max(ix - reach, 0), min(ix + reach + 1, frame.nx))
        goals = np.ascontiguousarray(frontiers[rows, columns], np.bool_)
        if not goals.any():
            return False
        gy, gx = np.nonzero(goals)
        far = (gy + rows.start - iy) ** 2 + (gx + columns.start - ix) ** 2 > self._reach**2
        goals[gy[far], gx[far]] = False
        clear = np.ascontiguousarray(self._belief.evidence[rows, columns] < 0)
        here = (iy - rows.start) * goals.shape[1] + ix - columns.start
        return bool(in_sight(clear, here, goals).any())
