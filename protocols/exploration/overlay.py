"""What one robot adds to the frontiers of the map, its path, and what it leaves out (paper 001, section 3.7)."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from cosim.arrays import Bytes, Int32s
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from protocols.exploration.forces import any_left, seen_frontiers, take_back
from protocols.mapping.belief import Belief

_NOTHING: Final = np.empty(0, np.int32)


class Overlay:
    """The own map of one robot, over the map that it may have in common with others."""

    def __init__(self, belief: Belief, reach: float) -> None:
        """Lie over *belief*; the sensors reach so many cells."""
        self._belief = belief
        self._reach = reach
        self.path: Bytes = np.zeros_like(belief.frontier)
        """The cells of its path, which seem unexplored to it."""
        self.ignored: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that do not draw it: no way leads there, or its paths there came to nothing."""
        self.noted: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that end a path no more, since they have ended one, or were in sight when one was laid."""
        self.goal: Cell | None = None
        """The last cell of its path, also when it has been walked."""
        self._cells: Int32s = _NOTHING
        self._left = 0
        self._goal_m: float | None = None
        self._found = np.empty((2 * int(reach) + 1) ** 2, np.int32)

    @property
    def underway(self) -> bool:
        """Whether any cell of a path is left."""
        return self._left > 0

    def frontiers(self) -> Bytes:
        """Return the frontiers that draw it, and those that are given up by nobody."""
        result: Bytes = self._belief.frontier & ~(self.ignored | self._belief.vain)
        return result

    def any_frontier(self) -> bool:
        """Return whether there are any."""
        return any_left(self._belief.frontier, self.ignored, self._belief.vain)

    def any_ignored(self) -> bool:
        """Return whether any frontier is ignored."""
        return bool((self._belief.frontier & self.ignored).any())

    # ------------------------------------------------------------ the path

    def lay(self, cells: Iterable[Cell], goal_m: float | None = None) -> None:
        """Let a path of *cells* seem unexplored; with *goal_m*, the last of them is passed only so near to it."""
        self.clear()
        laid = list(cells)
        self._cells, self._left, self._goal_m = np.array(laid, np.int32), len(laid), goal_m
        self.goal = laid[-1] if laid else None
        rows, columns = np.divmod(self._cells, self._belief.frame.nx)
        self.path[rows, columns] = 1

    def pass_by(self, place_m: Point, reach_m: float) -> bool:
        """Take back the cells of the path that are near; return whether there were any."""
        if not self._left:
            return False
        frame = self._belief.frame
        before = self._left
        near_m = reach_m if self._goal_m is None else self._goal_m
        self._left = take_back(
            self.path, self._cells, before, frame.nx, *frame.origin_m, frame.cell_m, *place_m, reach_m, near_m
        )
        return self._left < before

    def clear(self) -> None:
        """Take back the whole path."""
        rows, columns = np.divmod(self._cells[: self._left], self._belief.frame.nx)
        self.path[rows, columns] = 0
        self._left = 0

    # ------------------------------------------------------------ what is in sight

    def new_in_sight(self, place_m: Point) -> Int32s:
        """Return the frontiers (n,) in line of sight within the sensors' range that are not noted, a view."""
        return self._seen(place_m, self.noted, False)

    def in_sight(self, place_m: Point) -> Int32s:
        """Return those (n,) that draw it and are in sight there, if need be behind others of them, a view."""
        return self._seen(place_m, self.ignored, True)

    def _seen(self, place_m: Point, without: Bytes, through: bool) -> Int32s:
        belief = self._belief
        cell, grids = belief.frame.cell_at(place_m), (belief.frontier, without, belief.vain, belief.evidence)
        return self._found[: seen_frontiers(*grids, through, cell, self._reach, self._found)]

    def note(self, cells: Int32s) -> None:
        """Let *cells* end no path any more."""
        self.noted[np.divmod(cells, self._belief.frame.nx)] = 1
