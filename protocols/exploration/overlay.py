"""One robot's additions to the frontiers of the map, its path, and those that it leaves out (paper 001, section 3.7).

It leaves out frontiers that it has looked at in vain, and those to which no way leads.
"""

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy import ndimage

import cosim.elementary as elementary
from cosim.arrays import Bools, Bytes, Int32s
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.machine import Event
from protocols.exploration.events import Counters, FrontierGivenUp
from protocols.exploration.forces import any_left, seen_frontiers, take_back
from protocols.mapping.belief import Belief

_NOTHING: Final = np.empty(0, np.int32)
_ROUNDS: Final = 3
"""Number of times that frontiers that were not reached are tried again."""
_LOOKED_CELLS: Final = 2.0
"""Distance from a place where it has looked within which a robot does not look again."""
LOOKS: Final = 3
"""Number of paths from whose ends a frontier has been in sight after which it is vain."""
_TOUCHING: Final = np.ones((3, 3), np.int8)


class Overlay:
    """One robot's own layer over the map that it may share with others."""

    def __init__(self, belief: Belief, reach: float) -> None:
        """Lie over *belief*; the sensors reach as far as *reach* cells."""
        self._belief = belief
        self._reach = reach
        self.path: Bytes = np.zeros_like(belief.frontier)
        """Cells of its path, which seem unexplored to it."""
        self.ignored: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that do not attract it: no way leads there, or its paths there failed."""
        self.noted: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that no longer end a path, since they have ended one, or were in sight when one was laid."""
        self.goal: Cell | None = None
        """Last cell of its path, also when it has been walked."""
        self._cells: Int32s = _NOTHING
        self._left = 0
        self._goal_m: float | None = None
        self._found = np.empty((2 * int(reach) + 1) ** 2, np.int32)

    @property
    def underway(self) -> bool:
        """True if any cell of a path is left."""
        return self._left > 0

    @property
    def way(self) -> list[Cell]:
        """The cells of the path that are left, from the robot on."""
        cells: list[Cell] = self._cells[: self._left].tolist()
        return cells

    def frontiers(self) -> Bytes:
        """Return the frontiers that attract it: those that are neither ignored nor vain."""
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
        """Lay a path of *cells*, so that they seem unexplored; with *goal_m*, the last is passed only within that."""
        self.clear()
        laid = list(cells)
        self._cells, self._left, self._goal_m = np.array(laid, np.int32), len(laid), goal_m
        self.goal = laid[-1] if laid else None
        rows, columns = np.divmod(self._cells, self._belief.frame.nx)
        self.path[rows, columns] = 1

    def pass_by(self, place_m: Point, reach_m: float) -> bool:
        """Remove the cells of the path that are near; return whether there were any."""
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
        """Remove the whole path."""
        rows, columns = np.divmod(self._cells[: self._left], self._belief.frame.nx)
        self.path[rows, columns] = 0
        self._left = 0

    # ------------------------------------------------------------ what is in sight

    def new_in_sight(self, place_m: Point) -> Int32s:
        """Return the frontiers (n,) in line of sight within the sensors' range that are not noted, a view."""
        return self._seen(place_m, self.noted, False)

    def in_sight(self, place_m: Point) -> Int32s:
        """Return the frontiers (n,) that attract it and are in sight, even behind other frontiers, a view."""
        return self._seen(place_m, self.ignored, True)

    def _seen(self, place_m: Point, without: Bytes, through: bool) -> Int32s:
        belief = self._belief
        cell, grids = belief.frame.cell_at(place_m), (belief.frontier, without, belief.vain, belief.evidence)
        return self._found[: seen_frontiers(*grids, through, cell, self._reach, self._found)]

    def note(self, cells: Int32s) -> None:
        """Note that *cells* no longer end a path."""
        self.noted[np.divmod(cells, self._belief.frame.nx)] = 1


class Exclusions:
    """The frontiers that one robot gives up, and why, in the map and in its own *overlay*."""

    def __init__(self, belief: Belief, overlay: Overlay, counters: Counters, events: list[Event]) -> None:
        self._belief = belief
        self._overlay = overlay
        self._counters = counters
        self._events = events
        self.tried: Bytes = np.zeros_like(belief.frontier)
        """Frontiers to which paths have led: from now on they are only looked at."""
        self.looked: Bools = np.zeros(belief.evidence.shape, np.bool_)
        """Places near those from which it has looked at the end of a path."""
        self._looks: Bytes = np.zeros_like(belief.frontier)
        """Number of ends of paths from which a frontier has been in sight."""
        self.named: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that it has given up, if only for a time."""
        self._postponed: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that are left for later."""
        self._rounds = 0

    def look(self, here_m: Point, others: bool) -> None:
        """Note that a path has ended here: a frontier that is in sight and still a frontier may be vain.

        With *others* about, bodies may have hidden it.
        """
        seen = self._overlay.in_sight(here_m)
        frame, goal = self._belief.frame, self._overlay.goal
        self._about(here_m)
        if goal is not None and self._belief.frontier[divmod(goal, frame.nx)]:
            self.tried[divmod(goal, frame.nx)] = 1
        if others:
            return
        self._looks[np.divmod(seen, frame.nx)] += 1
        vain = seen[self._looks[np.divmod(seen, frame.nx)] >= LOOKS]
        self._belief.vain[np.divmod(vain, frame.nx)] = 1
        self._name(vain, "nothing new is seen there")

    def _about(self, here_m: Point) -> None:
        frame = self._belief.frame
        (left, low), size = frame.origin_m, frame.cell_m
        row, column = divmod(frame.cell_at(here_m), frame.nx)
        most = math.ceil(_LOOKED_CELLS) + 1
        box = tuple(slice(max(at - most, 0), at + most + 1) for at in (row, column))
        rows, columns = np.ogrid[: frame.ny, : frame.nx]
        rows, columns = rows[box[0]], columns[:, box[1]]
        away = elementary.hypots(left + (columns + 0.5) * size - here_m[0], low + (rows + 0.5) * size - here_m[1])
        self.looked[box] |= away <= _LOOKED_CELLS * size

    def postpone(self) -> None:
        """Leave out the goal of the last path, with all frontiers connected with it, until no other is left."""
        overlay, nx = self._overlay, self._belief.frame.nx
        goal = overlay.goal
        if goal is None:
            return
        row, column = divmod(goal, nx)
        left = overlay.frontiers()[:, :nx]
        group, _ = ndimage.label(left, structure=_TOUCHING)
        if group[row, column]:
            own = group == group[row, column]
            overlay.ignored[:, :nx] |= own
            self._postponed[:, :nx] |= own
        else:
            self._about(self._belief.frame.centre_m(goal))

    def take_up(self) -> bool:
        """Let frontiers that were not reached attract again; return whether there are any."""
        if not self._postponed.any():
            return False
        cells = np.flatnonzero((self._belief.frontier & self._postponed)[:, : self._belief.frame.nx])
        self._postponed[:] = 0
        if self._rounds == _ROUNDS:
            self._name(cells.astype(np.int32), "not reached")
            return False
        self._rounds += 1
        self._overlay.ignored[np.divmod(cells, self._belief.frame.nx)] = 0
        return self._overlay.any_frontier()

    def ignore(self, why: str) -> None:
        """Give up all frontiers that are left."""
        cells = np.flatnonzero(self._overlay.frontiers()[:, : self._belief.frame.nx])
        self._overlay.ignored[np.divmod(cells, self._belief.frame.nx)] = 1
        self._name(cells.astype(np.int32), why)

    def reconsider(self) -> None:
        """Ignore no frontier any more, as the map has changed."""
        self._overlay.ignored[:] = 0

    def _name(self, cells: Int32s, why: str) -> None:
        """Report frontiers that are given up, group by group, but none twice."""
        frame = self._belief.frame
        rows, columns = np.divmod(cells, frame.nx)
        new = self.named[rows, columns] == 0
        rows, columns = rows[new], columns[new]
        if not len(rows):
            return
        self.named[rows, columns] = 1
        self._counters.given_up += len(rows)
        mask = np.zeros((frame.ny, frame.nx), np.bool_)
        mask[rows, columns] = True
        groups, count = ndimage.label(mask, structure=_TOUCHING)
        of_cell = groups[rows, columns]
        for group in range(1, count + 1):
            own = of_cell == group
            x, y = float(columns[own].mean()) + 0.5, float(rows[own].mean()) + 0.5
            place = frame.origin_m[0] + x * frame.cell_m, frame.origin_m[1] + y * frame.cell_m
            self._events.append(FrontierGivenUp(*place, why, int(own.sum())))
