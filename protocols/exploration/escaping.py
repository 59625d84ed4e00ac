"""The way out of a local minimum: where a robot goes that is caught, and over which cells (paper 001, section 3.6).

Ways lead over cells that are known to be empty and keep away from obstacles. The goal is the nearest frontier, with
absolute preference for those in line of sight. A robot is wider than a cell, which the paper leaves out: it cannot
reach a frontier beside a wall. So it goes to a lookout, a place from which the frontier is in sight within the sensors'
range. As a last resort it also takes lookouts that see the frontier only if the cells at the ends of walls are not
wholly occupied: through narrow gaps a robot sees more than its map shows.
"""

from typing import Final, NamedTuple

import numpy as np

from cosim.arrays import Bools, Bytes, Int32s, Singles
from cosim.geometry.astar import astar, in_sight, lookouts, nearest, nearest_frontier
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from protocols.exploration.information import most_useful
from protocols.exploration.parameters import EscapeParameters
from protocols.exploration.terrain import Terrain

_NEARER_CELLS: Final = 0.5
"""Margin by which a lookout is nearer than the sensors' range: robots do not stand on centres of cells."""


def jambs(clear: Bools) -> Bools:
    """Return the cells that are not *clear*, shape (ny, nx), beside which two clear ones meet at a corner.

    A wall ends or turns there, and part of the cell may be empty: a line of sight may pass it, a robot may not.
    """
    beside = np.pad(clear, 1)
    across = beside[:-2, 1:-1] | beside[2:, 1:-1]
    along = beside[1:-1, :-2] | beside[1:-1, 2:]
    result: Bools = ~clear & across & along
    return result


class Way(NamedTuple):
    """A way to a frontier, or to where one can be seen."""

    cells: list[Cell]
    in_sight: bool
    """True if its end is in line of sight."""
    lookout: bool
    """True if it ends where a frontier can be seen, not at one."""


class Ground(NamedTuple):
    """Where a robot can go, by its map."""

    clear: Bools
    """Cells known to be empty."""
    passable: Bools
    """Cells in which the body fits."""
    extra: Singles
    """Cost of each cell beyond its length."""


class Escape:
    """Plans ways out of local minima for one robot."""

    def __init__(self, parameters: EscapeParameters, terrain: Terrain, radius_m: float, range_m: float) -> None:
        self._own = parameters
        self._terrain = terrain
        self.belief = terrain.belief
        """The map that ways are planned by."""
        self.cost = parameters.cost
        """How the cost of a way is computed."""
        self._radius_m = radius_m
        self._reach = range_m / terrain.belief.frame.cell_m

    def ground(self) -> Ground:
        """Return where the robot can go by the present map."""
        terrain = self._terrain
        return Ground(terrain.clear(), terrain.passable(self._radius_m), terrain.extra())

    def entry(self, here_m: Point) -> list[Cell]:
        """Return the cells from a place to the nearest one where the body has room; none if there is no way."""
        return self._terrain.entry(here_m, self._radius_m)

    def way(self, here_m: Point, frontiers: Bytes, tried: Bytes, looked: Bools) -> Way | None:
        """Return the way to the nearest of *frontiers*, or to a lookout for one; None if none leads there.

        Frontiers that were *tried* are only looked at, and not again from places from which the robot has *looked*.
        """
        nx = self.belief.frame.nx
        entry = self.entry(here_m)
        if not entry:
            return None
        ground, start = self.ground(), entry[-1]
        goals = frontiers[:, :nx].astype(np.bool_)
        direct = goals & ~tried[:, :nx].astype(np.bool_)
        seen = in_sight(ground.clear, start, goals)
        for wanted in (seen, goals) if self._own.choice == "nearest" else (goals,):
            found, lookout = self._direct(ground, start, direct & wanted), False
            if found is None:
                found, lookout = self._watch(ground, start, wanted, looked), True
            if found is not None:
                return Way(entry[:-1] + found.tolist(), wanted is seen, lookout)
        found = self._watch(ground._replace(clear=ground.clear | jambs(ground.clear)), start, goals, looked)
        return None if found is None else Way(entry[:-1] + found.tolist(), False, True)

    def _direct(self, ground: Ground, start: Cell, goals: Bools) -> Int32s | None:
        """Return the way to the nearest of *goals*, or to the most useful one; goals are entered and not passed."""
        if not goals.any():
            return None
        own = self._own
        if own.choice == "nearest":
            return nearest_frontier(ground.passable, ground.clear, ground.extra, start, goals, self.cost)
        evidence, weight = self.belief.evidence, own.information
        cell = most_useful(evidence, ground.passable, ground.extra, start, goals, self._reach, weight, self.cost)
        return None if cell is None else astar(ground.passable, ground.extra, start, cell, self.cost)

    def _watch(self, ground: Ground, start: Cell, goals: Bools, looked: Bools) -> Int32s | None:
        """Return the shortest way to a place from which one of *goals* is in sight."""
        watch = lookouts(ground.passable, ground.clear, goals, self._reach - _NEARER_CELLS) & ~looked
        return nearest(ground.passable, ground.extra, start, watch, self.cost) if watch.any() else None
