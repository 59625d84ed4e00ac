"""Where robots can go by a map: computed once for each version of it, for all robots that share the map."""

from typing import Final

import numpy as np

from cosim.arrays import Bools, Floats, Singles
from cosim.geometry.astar import clearance_cost, costs_from, nearest, passable_cells
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from protocols.exploration.parameters import EscapeParameters
from protocols.mapping.belief import Belief

SLACK_CELLS: Final = 0.5
"""Room beyond its body with which a robot plans."""


class Terrain:
    """Where robots can go by one map."""

    def __init__(self, belief: Belief, planning: EscapeParameters) -> None:
        """Plan by *belief* as it is when asked; *planning* says what it costs to be near obstacles."""
        self.belief = belief
        self.reading = planning.cost
        self._most = planning.clearance_cost
        self._clear = max(planning.clearance_m / belief.frame.cell_m, 1.0)
        self._version = -1
        self._extra: Singles | None = None
        self._passable: dict[float, Bools] = {}

    def clear(self) -> Bools:
        """Return the cells that are known to be empty, (ny, nx)."""
        clear: Bools = self.belief.evidence < 0
        return clear

    def passable(self, radius_m: float) -> Bools:
        """Return the cells known to be empty in which a body of *radius_m* has room, (ny, nx); not to be written to."""
        self._renew()
        found = self._passable.get(radius_m)
        if found is None:
            found = passable_cells(self.belief.evidence, radius_m / self.belief.frame.cell_m + SLACK_CELLS)
            self._passable[radius_m] = found
        return found

    def extra(self) -> Singles:
        """Return the cost of entering each cell, beyond its length, (ny, nx); not to be written to."""
        self._renew()
        if self._extra is None:
            self._extra = clearance_cost(self.belief.evidence > 0, self._clear, self._most)
        return self._extra

    def entry(self, here_m: Point, radius_m: float) -> list[Cell]:
        """Return the cells from a place to the nearest one where the body has room; none if there is no way.

        A robot may stand where its body and the slack of its plans do not fit into the cells that are known to be
        empty: beside a wall that seems to be in both of its cells, or where it has not seen the floor under its body.
        Ways from there lead over empty cells, if there are any around it.
        """
        frame, passable = self.belief.frame, self.passable(radius_m)
        start = frame.cell_at(here_m)
        if passable.flat[start]:
            return [start]
        rows, columns = np.ogrid[: frame.ny, : frame.nx]
        (left, low), size = frame.origin_m, frame.cell_m
        off_x, off_y = columns + 0.5 - (here_m[0] - left) / size, rows + 0.5 - (here_m[1] - low) / size
        under: Bools = off_x * off_x + off_y * off_y <= (radius_m / size) * (radius_m / size)
        through = self.clear() | (under & (self.belief.evidence <= 0))
        way = nearest(through, np.zeros_like(self.extra()), start, passable)
        return [] if way is None else [int(cell) for cell in way]

    def costs(self, here_m: Point, radius_m: float, ends: Bools) -> Floats:
        """Return what it costs to go from a place to each cell, (ny, nx); *ends* need not be passable."""
        entry, passable = self.entry(here_m, radius_m), self.passable(radius_m)
        if not entry:
            return np.full(passable.shape, np.inf)
        return costs_from(passable, self.extra(), entry[-1], ends, self.reading)

    def _renew(self) -> None:
        if self._version != self.belief.version:
            self._version, self._extra = self.belief.version, None
            self._passable.clear()
