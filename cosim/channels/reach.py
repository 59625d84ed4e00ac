"""Powers with which devices receive each other, by where they are: a plain disc, or a law of propagation with walls."""

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np

from cosim.arrays import Bools, Floats
from cosim.channels.base import Positions
from cosim.channels.jamming import Jammer
from cosim.channels.propagation import Barrier, Propagation, PropagationSettings
from cosim.geometry.segments import SegmentGrid, segment_grid
from cosim.jit import njit
from cosim.randomness import Draws

Floor: TypeAlias = tuple[SegmentGrid, Floats]
"""The walls, and the loss of each in dB."""
NO_WALLS: Final[Floor] = (segment_grid(np.empty((0, 4))), np.empty(0))


class Disc:
    """Reception with 0 dBm within *range_m*, or everywhere if it is None, and none beyond."""

    def __init__(self, size: int, range_m: float | None) -> None:
        self._range_m = range_m
        self._near: Bools = np.ones((size, size), dtype=np.bool_)
        self._positions_m: Positions = np.zeros((size, 2))

    def moved(self, positions_m: Positions) -> bool:
        """Take new positions and return whether that changes anything."""
        self._positions_m = positions_m
        if self._range_m is None or not _differs(positions_m, self._range_m, self._near):
            return False
        offsets = positions_m[:, None, :] - positions_m[None, :, :]
        self._near = (offsets**2).sum(axis=2) <= self._range_m * self._range_m
        return True

    def power_dbm(self) -> Floats:
        """Return what each device (column) receives of each other (row), shape (n, n), and nothing of itself."""
        power_dbm = np.where(self._near, 0.0, -np.inf)
        np.fill_diagonal(power_dbm, -np.inf)
        return power_dbm

    def jam_dbm(self, jammers: Sequence[Jammer]) -> Floats:
        """Return what each device receives of each jammer, shape (jammers, n): as much as of another device."""
        places = np.array([(jammer.x_m, jammer.y_m) for jammer in jammers])
        offsets = places[:, None, :] - self._positions_m[None, :, :]
        near = (offsets**2).sum(axis=2) <= (self._range_m or np.inf) * (self._range_m or np.inf)
        return np.where(near, 0.0, -np.inf)


class Fading:
    """Reception by transmit powers, shape (n,), and the gains of *propagation*, computed when they are needed."""

    def __init__(self, transmit_dbm: Floats, propagation: Propagation) -> None:
        self._transmit_dbm = transmit_dbm
        self._propagation = propagation
        self._positions_m: Positions = np.zeros((len(transmit_dbm), 2))

    def moved(self, positions_m: Positions) -> bool:
        """Take new positions and return whether that changes anything."""
        if np.array_equal(positions_m, self._positions_m):
            return False
        self._positions_m = positions_m.copy()
        return True

    def obstruct(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way from now on."""
        self._propagation.set_barriers(tuple(barriers))

    def power_dbm(self) -> Floats:
        """Return what each device (column) receives of each other (row), shape (n, n), and nothing of itself."""
        power: Floats = self._transmit_dbm[:, None] + self._propagation.gains_db(self._positions_m)
        return power

    def jam_dbm(self, jammers: Sequence[Jammer]) -> Floats:
        """Return what each device receives of each jammer, shape (jammers, n)."""
        places = np.array([(jammer.x_m, jammer.y_m) for jammer in jammers])
        gains = self._propagation.gains_db(np.vstack((self._positions_m, places)))
        count = len(self._positions_m)
        power: Floats = np.array([jammer.power_dbm for jammer in jammers])[:, None] + gains[count:, :count]
        return power


def reach_of(
    range_m: float | None, law: PropagationSettings | None, sent_dbm: Sequence[float], floor: Floor | None, draws: Draws
) -> Disc | Fading:
    """Return how devices that send with *sent_dbm* receive each other: by *law*, on a *floor*, or else in a disc.

    *draws* decide the shadowing.
    """
    if law is None:
        return Disc(len(sent_dbm), range_m)
    return Fading(np.array(sent_dbm, dtype=np.float64), Propagation(law, *(floor or NO_WALLS), draws))


@njit(cache=True, borrows=True)
def _differs(positions_m: Positions, range_m: float, near: Bools) -> bool:
    """Return whether any pair of *positions_m* has entered or left *range_m* since *near*."""
    for a in range(len(positions_m)):
        for b in range(a):
            x, y = positions_m[a, 0] - positions_m[b, 0], positions_m[a, 1] - positions_m[b, 1]
            if (x * x + y * y <= range_m * range_m) != near[a, b]:
                return True
    return False
