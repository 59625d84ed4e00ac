"""Whether a robot is caught in a local minimum: the box of its movement in a time has become too small (section 3.5).

Or, beyond the paper, it has learnt nothing for long: drawn to a frontier that it cannot see, a robot may circle.
"""

import math

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.planning import Point
from cosim.jit import njit


@njit(cache=True)
def longer_side(places: Floats, row: int, x: float, y: float) -> float:
    """Set a *row* of *places* (n, 2) to (x, y); return the longer side of the box about all of them."""
    places[row, 0], places[row, 1] = x, y
    low_x = low_y = math.inf
    high_x = high_y = -math.inf
    for k in range(places.shape[0]):
        low_x, high_x = min(low_x, places[k, 0]), max(high_x, places[k, 0])
        low_y, high_y = min(low_y, places[k, 1]), max(high_y, places[k, 1])
    return max(high_x - low_x, high_y - low_y)


class Stalling:
    """The places of the last so many ticks, and for how long there has been no gain."""

    def __init__(self, ticks: int, box_m: float, patience_ticks: float) -> None:
        self._box_m = box_m
        self._patience = patience_ticks
        self._barren = 0
        self._ticks = max(1, ticks)
        self._places = np.zeros((self._ticks, 2))
        self._side_m = 0.0
        """Of the box about what has been noted; of all places once all have been."""
        self._noted = 0

    def note(self, place_m: Point, gain: bool) -> None:
        """Note where the robot is at a tick, and whether it has come to know a cell, or on along its path."""
        self._barren = 0 if gain else self._barren + 1
        self._side_m = longer_side(self._places, self._noted % self._ticks, *place_m)
        self._noted += 1

    def begin(self) -> None:
        """Forget all places: something else is tried from now on."""
        self._noted = 0
        self._barren = 0

    @property
    def stalled(self) -> bool:
        """Whether the whole time has been noted, and the longer side of the box is shorter than it should be."""
        return self._barren > self._patience or (self._noted >= self._ticks and self._side_m < self._box_m)
