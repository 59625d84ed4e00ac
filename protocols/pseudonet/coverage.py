"""The truth about coverage: which cells the robots' bodies have really been in, and what that cost.

A robot that dies stays where it is. Its body occupies every cell that its disc touches, and what lies behind such cells
may be out of reach for the others: only what they can still reach counts from then on.
"""

import math
from itertools import zip_longest

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.grids import Cell, CoverageGrid, distances
from cosim.machine import Address
from cosim.protocol import Death, Referee
from cosim.units import Time, to_seconds
from protocols.pseudonet.setup import Setup


def cells_touched(grid: CoverageGrid, x_m: float, y_m: float, radius_m: float) -> list[Cell]:
    """Return the cells of *grid* whose squares a disc overlaps."""
    column, row = (x_m - grid.origin_m[0]) / grid.cell_m, (y_m - grid.origin_m[1]) / grid.cell_m
    reach = radius_m / grid.cell_m
    touched = []
    for iy in range(max(0, math.floor(row - reach)), min(grid.ny - 1, math.floor(row + reach)) + 1):
        for ix in range(max(0, math.floor(column - reach)), min(grid.nx - 1, math.floor(column + reach)) + 1):
            gap_x = max(ix - column, 0.0, column - ix - 1)
            gap_y = max(iy - row, 0.0, row - iy - 1)
            if math.hypot(gap_x, gap_y) < reach:
                touched.append(iy * grid.nx + ix)
    return touched


class CoverageReferee(Referee):
    """Counts the cells that robots' centres enter; sees poses and deaths only, never what machines believe."""

    def __init__(self, setup: Setup) -> None:
        self._grid = setup.grid
        self._visits = np.zeros(self._grid.nx * self._grid.ny, dtype=np.int64)
        self._counts = self._grid.reachable.copy()
        """Cells that are to be covered."""
        self._target = len(setup.cells)
        self._covered = 0
        self._last: list[Cell] = []
        """Each robot's cell at the last tick."""
        self._complete_at: Time | None = None
        self._dead: set[Address] = set()
        self._bodies: set[Cell] = set()

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Count the cells that were entered since the last tick; never end the run: the team itself finds its end."""
        (west_m, south_m), cell_m, nx = self._grid.origin_m, self._grid.cell_m, self._grid.nx
        cells = [
            math.floor((y - south_m) / cell_m) * nx + math.floor((x - west_m) / cell_m)
            for x, y in zip(x_m.tolist(), y_m.tolist(), strict=True)
        ]
        if cells != self._last:
            entered = [cell for cell, last in zip_longest(cells, self._last) if cell != last]
            np.add.at(self._visits, entered, 1)
            self._last = cells
            self._count(now)
        return False

    def died(self, death: Death) -> None:
        """Remove the cells that the dead body touches, and all that it cuts off, from what is to be covered."""
        self._dead.add(death.robot)
        self._bodies.update(cells_touched(self._grid, death.x_m, death.y_m, death.radius_m))
        living = [cell for robot, cell in enumerate(self._last) if robot not in self._dead]
        if not living:
            return  # no robot is left to cover anything: what was to be covered stays the measure
        blocked = np.isin(self._grid.steps, list(self._bodies))
        steps = np.where(blocked, np.int32(-1), self._grid.steps)
        self._counts = distances(steps, living) >= 0
        self._target = int(np.count_nonzero(self._counts))
        self._count(death.at)

    def _count(self, now: Time) -> None:
        self._covered = int(np.count_nonzero(self._visits[self._counts]))
        if self._covered < self._target:
            self._complete_at = None
        elif self._complete_at is None:
            self._complete_at = now

    def verdict(self, now: Time) -> dict[str, float]:
        """Return coverage, the time at which it was complete, and the share of entries that covered nothing new."""
        entries = int(self._visits.sum())
        visited = int(np.count_nonzero(self._visits[self._grid.reachable]))
        return {
            "coverage": self._covered / self._target,
            "time_to_cover_s": float("nan") if self._complete_at is None else to_seconds(self._complete_at),
            # nothing has been visited if the run ends before its first tick
            "overlap_ratio": (entries - visited) / visited if visited else float("nan"),
        }
