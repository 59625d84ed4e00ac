"""The truth about gathering: how many robots stand together, since when, and how close."""

import math

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.grids import Cell, CoverageGrid
from cosim.machine import Address
from cosim.protocol import Death, Referee
from cosim.units import Time, to_seconds
from protocols.pseudonet.setup import Setup


def largest_group(grid: CoverageGrid, cells: list[Cell]) -> int:
    """Return the size of the largest group in *cells* whose robots each stand a step of the grid from another."""
    left, largest = set(cells), 0
    while left:
        group, edge = 0, [left.pop()]
        while edge:
            cell = edge.pop()
            group += cells.count(cell)
            beside = left.intersection(grid.steps[cell].tolist())
            left -= beside
            edge += beside
        largest = max(largest, group)
    return largest


class GatheringReferee(Referee):
    """Follows the places of living robots; sees poses and deaths only, never what machines believe."""

    def __init__(self, setup: Setup) -> None:
        self._grid = setup.grid
        self._dead: set[Address] = set()
        self._places: Floats = np.empty((0, 2))
        self._cells: list[Cell] = []
        self._together = 0
        self._gathered_at: Time | None = None

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Find the robots that stand together; never end the run: the team itself finds its end."""
        grid = self._grid
        living = [robot for robot in range(len(x_m)) if robot not in self._dead]
        self._places = np.stack((x_m, y_m), axis=1)[living]
        columns = np.floor((self._places[:, 0] - grid.origin_m[0]) / grid.cell_m).astype(np.int64)
        rows = np.floor((self._places[:, 1] - grid.origin_m[1]) / grid.cell_m).astype(np.int64)
        cells = (rows * grid.nx + columns).tolist()
        if cells != self._cells:
            self._cells = cells
            self._together = largest_group(grid, cells)
            if self._together < len(cells):
                self._gathered_at = None
            elif self._gathered_at is None:
                self._gathered_at = now
        return False

    def died(self, death: Death) -> None:
        """Leave a dead robot out: the living are to gather."""
        self._dead.add(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the share of the living that stand together, since when all do, and how far from their centre."""
        if not len(self._places):
            return {"gathered": math.nan, "time_to_gather_s": math.nan, "spread_m": math.nan}
        offsets = self._places - self._places.mean(axis=0)
        return {
            "gathered": self._together / len(self._cells),
            "time_to_gather_s": math.nan if self._gathered_at is None else to_seconds(self._gathered_at),
            "spread_m": float(np.sqrt((offsets**2).sum(axis=1).mean())),
        }
