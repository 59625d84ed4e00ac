"""The known floor as the maps of cells on which robots localise: one for each size of cells that a robot has.

"Some robots have different map representations" (paper 004, section 7). A cell is occupied if its centre is at most
half a cell off a wall; so a wall between two rows of cells is in both.
"""

import math

import numpy as np

from cosim.errors import UserError
from cosim.geometry.segments import clearance, segment_grid
from cosim.navigation.localization.likelihood import KnownMap, known_map
from cosim.protocol import Surroundings

_HAIR: float = 1e-9
"""Tolerance for rounding, m."""


class KnownMaps:
    """The maps of a run's floor; each is made when it is asked for first, and shared by all robots with its cells."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._grid = segment_grid(surroundings.walls_m)
        self._bounds_m = surroundings.bounds_m
        self._forbidden = surroundings.forbidden
        self._known: dict[tuple[float, float], KnownMap] = {}

    def known(self, cell_m: float, radius_m: float) -> KnownMap:
        """Return the map with cells of *cell_m* for robots of *radius_m*; raise UserError if they can stand nowhere."""
        key = cell_m, radius_m
        if key not in self._known:
            self._known[key] = self._made(cell_m, radius_m)
        return self._known[key]

    def _made(self, cell_m: float, radius_m: float) -> KnownMap:
        x_min, y_min, x_max, y_max = self._bounds_m
        # one more cell all round, so that walls at the bounds have two sides
        origin_m = x_min - cell_m, y_min - cell_m
        nx, ny = (math.ceil(extent / cell_m - _HAIR) + 2 for extent in (x_max - x_min, y_max - y_min))
        xs, ys = origin_m[0] + (np.arange(nx) + 0.5) * cell_m, origin_m[1] + (np.arange(ny) + 0.5) * cell_m
        centres = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
        inside = ((centres >= (x_min, y_min)) & (centres <= (x_max, y_max))).all(axis=1)
        occupied = clearance(self._grid, centres, cell_m) <= 0.5 * cell_m + _HAIR
        free = inside & ~np.asarray(self._forbidden(centres), np.bool_) & ~occupied
        try:
            return known_map(occupied.reshape(ny, nx), free.reshape(ny, nx), origin_m, cell_m, radius_m)
        except ValueError as error:
            raise UserError(f"floorplan: {error}, in cells of {cell_m} m") from None
