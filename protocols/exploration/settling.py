"""Which frontiers a robot does without: what it has looked at in vain, and where no way leads."""

import math
from typing import Final

import numpy as np
from scipy import ndimage

from cosim.arrays import Bools, Bytes, Int32s
from cosim.geometry.planning import Point
from cosim.machine import Event
from protocols.exploration.counters import Counters
from protocols.exploration.events import FrontierGivenUp
from protocols.exploration.overlay import Overlay
from protocols.mapping.belief import Belief

_ROUNDS: Final = 3
"""So often frontiers that were not reached are tried once more."""
_LOOKED_CELLS: Final = 2.0
"""So near to a place from which has been looked nobody looks again."""
LOOKS: Final = 3
"""Frontiers that have been in sight from the ends of so many paths are there in vain."""
_TOUCHING: Final = np.ones((3, 3), np.int8)


class Settling:
    """What one robot has found out of the frontiers that are left, in the map and in its own *overlay*."""

    def __init__(self, belief: Belief, overlay: Overlay, counters: Counters, events: list[Event]) -> None:
        self._belief = belief
        self._overlay = overlay
        self._counters = counters
        self._events = events
        self.tried: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that paths have led to: they are only looked at from now on."""
        self.looked: Bools = np.zeros(belief.evidence.shape, np.bool_)
        """Places near to those from which it has looked at the end of a path."""
        self._looks: Bytes = np.zeros_like(belief.frontier)
        """From how many ends of paths frontiers have been in sight."""
        self.named: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that it has given up, if only for a time."""
        self._postponed: Bytes = np.zeros_like(belief.frontier)
        """Frontiers that are left for later."""
        self._rounds = 0

    def look(self, here_m: Point, others: bool) -> None:
        """Take note that a path has ended here: what is in sight and a frontier all the same may be there in vain.

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
        away = np.hypot(left + (columns + 0.5) * size - here_m[0], low + (rows + 0.5) * size - here_m[1])
        self.looked[box] |= away <= _LOOKED_CELLS * size

    def postpone(self) -> None:
        """Leave the goal of the last path out, with all frontiers that it is connected with, until nothing is left."""
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
        """Let frontiers that were not reached draw again; return whether there are any."""
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
        """Take up again what was ignored: the map has changed."""
        self._overlay.ignored[:] = 0

    def _name(self, cells: Int32s, why: str) -> None:
        """Tell of frontiers that are given up, group by group, but of none twice."""
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
