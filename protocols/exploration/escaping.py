"""The way out of a local minimum: where to a robot that is caught goes, and by which cells (paper 001, section 3.6).

Ways lead over cells that are known to be empty and keep away from obstacles. The goal is the nearest frontier, those in
line of sight with absolute preference. A robot is wider than a cell, which the paper leaves out: to a frontier beside a
wall it does not come. So it goes to a lookout, a place from which the frontier is in sight within the sensors' range;
at last also to places where it is if the cells at the ends of walls are not wholly occupied: narrow gaps show more to a
robot than to its map.
"""

from typing import Final, NamedTuple

import numpy as np

from cosim.geometry.astar import astar, clearance_cost, in_sight, lookouts, nearest, nearest_frontier, passable_cells
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Bools, Ints, Point, Singles
from protocols.exploration.belief import Belief, Bytes
from protocols.exploration.information import most_useful
from protocols.exploration.parameters import EscapeParameters

_SLACK_CELLS: Final = 0.5
"""So much wider than its body a robot plans."""
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

    def __init__(self, parameters: EscapeParameters, belief: Belief, radius_m: float, range_m: float) -> None:
        self._own = parameters
        self._belief = belief
        size = belief.frame.cell_m
        self._body = radius_m / size
        self._clear = max(parameters.clearance_m / size, 1.0)
        self._reach = range_m / size
        self._ground: tuple[int, Ground] | None = None

    def ground(self) -> Ground:
        """Return where the robot can go by the map of now."""
        belief = self._belief
        if self._ground is None or self._ground[0] != belief.version:
            evidence = belief.evidence
            passable = passable_cells(evidence, self._body + _SLACK_CELLS)
            extra = clearance_cost(evidence > 0, self._clear, self._own.clearance_cost)
            self._ground = belief.version, Ground(evidence < 0, passable, extra)
        return self._ground[1]

    def entry(self, here_m: Point) -> list[Cell]:
        """Return the cells from a place to the nearest one where the body fits, by the map; none if there is no way.

        A robot may stand, and stand well, where its body and the slack of its plans do not fit into the cells that are
        known to be empty: beside a wall that both of its cells seem to hold, or where it has not seen the floor under
        its body. Ways to there lead over empty cells, if there are any about it.
        """
        belief, ground = self._belief, self.ground()
        start = belief.frame.cell_at(here_m)
        if ground.passable.flat[start]:
            return [start]
        under = self._under(here_m) & (belief.evidence <= 0)
        way = nearest(ground.clear | under, np.zeros_like(ground.extra), start, ground.passable)
        return [] if way is None else [int(cell) for cell in way]

    def _under(self, here_m: Point) -> Bools:
        """Return the cells that have their centres under the body."""
        frame = self._belief.frame
        rows, columns = np.ogrid[: frame.ny, : frame.nx]
        (left, low), size = frame.origin_m, frame.cell_m
        across = np.hypot(columns + 0.5 - (here_m[0] - left) / size, rows + 0.5 - (here_m[1] - low) / size)
        result: Bools = across <= self._body
        return result

    def way(self, here_m: Point, frontiers: Bytes, tried: Bytes, looked: Bools) -> Way | None:
        """Return the way to the nearest of *frontiers*, or to a lookout for one; None if none leads there.

        Those that were *tried* are only looked at; from places that have been *looked* from nobody looks again.
        """
        nx = self._belief.frame.nx
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

    def _direct(self, ground: Ground, start: Cell, goals: Bools) -> Ints | None:
        """Return the way to the nearest of *goals*, or the most useful one; they are entered and not passed."""
        if not goals.any():
            return None
        own = self._own
        if own.choice == "nearest":
            return nearest_frontier(ground.passable, ground.clear, ground.extra, start, goals, own.cost)
        evidence, weight = self._belief.evidence, own.information
        cell = most_useful(evidence, ground.passable, ground.extra, start, goals, self._reach, weight, own.cost)
        return None if cell is None else astar(ground.passable, ground.extra, start, cell, own.cost)

    def _watch(self, ground: Ground, start: Cell, goals: Bools, looked: Bools) -> Ints | None:
        """Return the way to the nearest place from which one of *goals* is in sight; nearest by the way's length."""
        watch = lookouts(ground.passable, ground.clear, goals, self._reach - _NEARER_CELLS) & ~looked
        return nearest(ground.passable, ground.extra, start, watch, self._own.cost) if watch.any() else None
