"""What the air and the walls take from a signal between any two robots: the gains that all radios share.

    gain = -(loss at 1 m + 10 n log10(d / 1 m) + losses of the walls that the line crosses + shadowing)   in dB

With n = 2, the loss of free space at 1 m and walls this is the multi-wall model of COST 231 (final report, section
4.7.2, its constant term 0, one storey); an exponent of 2.5 to 3.5 without walls is the usual law for offices, in which
the walls are averaged into the exponent (ITU-R P.1238). Using both counts walls twice.

Shadowing is normal in dB and fixed: it depends on the run's seed, on the two robots, and on the square of some metres
that each of them is in, and on nothing else. A robot that returns to a place finds what it found before, and both ends
find the same. At the side of a square the value jumps to an independent one.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.segments import SegmentGrid, segment_grid
from cosim.jit import njit
from cosim.randomness import Draws, philox_words
from cosim.settings import Decibels, Gain, Metres, Settings
from cosim.world.sight import wall_losses_db, wall_losses_from_db

NEAREST_M: Final = 0.1
"""Least distance that counts, about a wavelength, as the law holds for the far field only."""


class PropagationSettings(Settings):
    """Parameters of the loss of radio signals by distance, walls and place."""

    model: Literal["free_space", "log_distance"] = Field(
        default="free_space", description="free_space: the exponent is 2; log_distance: it is the one given"
    )
    exponent: Gain = Field(default=3.0, gt=0, description="of the distance, if the model is log_distance")
    reference_loss_db: Decibels = Field(
        default=40.2, ge=0, description="dB, loss at 1 m; the default is that of free space at 2441 MHz"
    )
    walls: bool = Field(default=True, description="walls on the line between two robots cost what the floor plan says")
    shadowing_db: Decibels = Field(
        default=0.0, ge=0, description="dB, standard deviation of the shadowing, fixed per link and place; 0: none"
    )
    shadowing_cell_m: Metres = Field(
        default=2.0, gt=0, description="m, side of the squares within which it is one value"
    )


class Barrier(NamedTuple):
    """A line segment that costs dB where a signal crosses it, in addition to the walls of the floor plan."""

    x1_m: float
    y1_m: float
    x2_m: float
    y2_m: float
    loss_db: float


class Propagation:
    """The gains between all robots of a run."""

    def __init__(
        self, settings: PropagationSettings, walls: SegmentGrid, wall_loss_db: npt.ArrayLike, draws: Draws
    ) -> None:
        """Prepare for *walls* that cost *wall_loss_db*, shape (n,), in their order; *draws* decide the shadowing."""
        self._walls = walls
        self._loss_db = np.ascontiguousarray(wall_loss_db, dtype=np.float64)
        if self._loss_db.shape != (len(walls.walls_m),):
            raise ValueError(f"{len(walls.walls_m)} walls have losses of shape {self._loss_db.shape}")
        self._through_walls = settings.walls
        exponent = 2.0 if settings.model == "free_space" else settings.exponent
        self._law = (settings.reference_loss_db, exponent, settings.shadowing_db, settings.shadowing_cell_m)
        self._key = draws.key
        self._barriers: Sequence[Barrier] = ()

    def set_barriers(self, barriers: Sequence[Barrier]) -> None:
        """Put *barriers*, and no others, in the way from now on."""
        self._barriers = barriers

    def gains_db(self, positions_m: npt.ArrayLike) -> Floats:
        """Return the gains in dB, shape (n, n), between all *positions_m*, shape (n, 2).

        Symmetric to the last bit, and -inf on the diagonal. Distances below 0.1 m count as 0.1 m. The robots' numbers
        are those of the rows, and decide, with their places, the shadowing.
        """
        positions = np.ascontiguousarray(positions_m, dtype=np.float64).reshape(-1, 2)
        gains = _gains_db(positions, self._law, self._key)
        if self._through_walls:
            gains -= wall_losses_db(self._walls, self._loss_db, positions)
        if self._barriers:
            lines = segment_grid([barrier[:4] for barrier in self._barriers])
            gains -= wall_losses_db(lines, [barrier.loss_db for barrier in self._barriers], positions)
        return gains

    def gains_from_db(self, positions_m: npt.ArrayLike, source: int) -> Floats:
        """Return the row *source* of :meth:`gains_db`, shape (n,), without the others."""
        positions = np.ascontiguousarray(positions_m, dtype=np.float64).reshape(-1, 2)
        gains = _gains_from_db(positions, source, self._law, self._key)
        if self._through_walls:
            gains -= wall_losses_from_db(self._walls, self._loss_db, positions, source)
        if self._barriers:
            lines = segment_grid([barrier[:4] for barrier in self._barriers])
            gains -= wall_losses_from_db(lines, [barrier.loss_db for barrier in self._barriers], positions, source)
        return gains


# ---------------------------------------------------------------- kernels


@njit(cache=True)
def _gains_db(positions: Floats, law: tuple[float, float, float, float], key: tuple[int, int]) -> Floats:
    """Return the gains without walls."""
    robots = positions.shape[0]
    gains = np.full((robots, robots), -np.inf)
    for i in range(robots):
        for j in range(i + 1, robots):
            gains[i, j] = gains[j, i] = _gain_db(positions, i, j, law, key)
    return gains


@njit(cache=True)
def _gains_from_db(
    positions: Floats, source: int, law: tuple[float, float, float, float], key: tuple[int, int]
) -> Floats:
    """Return the gains of one row without walls."""
    gains = np.full(positions.shape[0], -np.inf)
    for other in range(positions.shape[0]):
        if other != source:
            gains[other] = _gain_db(positions, min(source, other), max(source, other), law, key)
    return gains


@njit(cache=True)
def _gain_db(positions: Floats, i: int, j: int, law: tuple[float, float, float, float], key: tuple[int, int]) -> float:
    """Return the gain between robots *i* and *j* > *i* without walls."""
    reference_db, exponent, shadowing_db, cell = law
    ax, ay = positions[i]
    bx, by = positions[j]
    square = max((bx - ax) ** 2 + (by - ay) ** 2, NEAREST_M * NEAREST_M)
    gain = -reference_db - 5.0 * exponent * elementary.log10(square)
    if shadowing_db > 0.0:
        words = philox_words(_place(ax, ay, cell), _place(bx, by, cell), i << 16 | j, 0, key[0], key[1])
        gain -= shadowing_db * _normal(words)
    return gain


@njit(cache=True)
def _place(x: float, y: float, cell: float) -> int:
    """Return the number of the square at (x, y), 32 bits; numbers repeat after 65536 squares."""
    return (math.floor(x / cell) & 0xFFFF) << 16 | math.floor(y / cell) & 0xFFFF


@njit(cache=True)
def _normal(words: tuple[int, int, int, int]) -> float:
    """Return a standard normal number from random *words* (Box and Muller's transform)."""
    radius = (words[0] + 0.5) * 2.0**-32
    angle = (words[1] + 0.5) * 2.0**-32
    return math.sqrt(-2.0 * elementary.log(radius)) * elementary.cos(2.0 * math.pi * angle)
