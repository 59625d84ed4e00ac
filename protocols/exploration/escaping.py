"""The way out of a local minimum: where to a robot that is caught goes, and by which cells (paper 001, section 3.6).

Ways lead over cells that are known to be empty and keep away from obstacles. The goal is the nearest frontier, those in
line of sight with absolute preference. A robot is wider than a cell, which the paper leaves out: to a frontier beside a
wall it does not come. So it goes to a lookout, a place from which the frontier is in sight within the sensors' range;
at last also to places where it is if the cells at the ends of walls are not wholly occupied: narrow gaps show more to a
robot than to its map.
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
"""So much nearer than the sensors' range is a lookout to what it looks at: robots do not stand on centres of cells."""


def jambs(clear: Bools) -> Bools:
    """Return the cells that are not *clear*, shape (ny, nx), beside which two clear ones meet at a corner.

    There a wall ends or turns, and part of the cell may be empty: a line of sight may pass it, a robot may not.
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
    """Whether its end is in line of sight."""
    lookout: bool
    """Whether it ends where a frontier can be seen, not at one."""


class Ground(NamedTuple):
    """Where a robot can go, by its map."""

    clear: Bools
    """Known to be empty."""
    passable: Bools
    """The body fits in."""
    extra: Singles
    """What it costs to be there."""


class Escape:
    """Plans ways for one robot."""

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
        """Return where the robot can go by the map of now."""
        terrain = self._terrain
        return Ground(terrain.clear(), terrain.passable(self._radius_m), terrain.extra())

    def entry(self, here_m: Point) -> list[Cell]:
        """Return the cells from a place to the nearest one where the body has room; none if there is no way."""
        return self._terrain.entry(here_m, self._radius_m)

    def way(self, here_m: Point, frontiers: Bytes, tried: Bytes, looked: Bools) -> Way | None:
        """Return the way to the nearest of *frontiers*, or to a lookout for one; None if none leads there.

        Those that were *tried* are only looked at; from places that have been *looked* from nobody looks again.
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
        """Return the way to the nearest of *goals*, or the most useful one; they are entered and not passed."""
        if not goals.any():
            return None
        own = self._own
        if own.choice == "nearest":
            return nearest_frontier(ground.passable, ground.clear, ground.extra, start, goals, self.cost)
        evidence, weight = self.belief.evidence, own.information
        cell = most_useful(evidence, ground.passable, ground.extra, start, goals, self._reach, weight, self.cost)
        return None if cell is None else astar(ground.passable, ground.extra, start, cell, self.cost)

    def _watch(self, ground: Ground, start: Cell, goals: Bools, looked: Bools) -> Int32s | None:
        """Return the way to the nearest place from which one of *goals* is in sight; nearest by the way's length."""
        watch = lookouts(ground.passable, ground.clear, goals, self._reach - _NEARER_CELLS) & ~looked
        return nearest(ground.passable, ground.extra, start, watch, self.cost) if watch.any() else None
