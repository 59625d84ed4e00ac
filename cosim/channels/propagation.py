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
from cosim.arrays import Floats, Int64s
from cosim.geometry.segments import SegmentGrid, crossed_weight, crossed_weights, segment_grid
from cosim.jit import njit
from cosim.randomness import Draws, philox_words
from cosim.settings import Decibels, Gain, Metres, Settings
from cosim.world.sight import LOSS_UNIT_DB, loss_units, wall_losses_db

NEAREST_M: Final = 0.1
"""Least distance that counts, about a wavelength, as the law holds for the far field only."""
MOST_NORMAL: Final = 6.77
"""Bound of what is taken for a standard normal number: its radius is at most (66 ln 2)^(1/2)."""


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


class Losses(NamedTuple):
    """What signals lose on their way, as kernels need it."""

    law: tuple[float, float, float, float]
    """Loss at 1 m in dB, exponent, shadowing in dB, and side of its squares in m."""
    key: tuple[int, int]
    """Key of the draws of shadowing."""
    walls_m: Floats
    wall_units: Int64s
    """Loss of each wall in whole ``LOSS_UNIT_DB``."""
    barriers_m: Floats
    barrier_units: Int64s


class Propagation:
    """The gains between all robots of a run."""

    def __init__(
        self, settings: PropagationSettings, walls: SegmentGrid, wall_loss_db: npt.ArrayLike, draws: Draws
    ) -> None:
        """Prepare for *walls* that cost *wall_loss_db*, shape (n,), in their order; *draws* decide the shadowing."""
        crossable = walls.walls_m if settings.walls else np.empty((0, 4))
        self._crossed = crossable, loss_units(walls, wall_loss_db)[: len(crossable)]
        """The walls that cost anything, and what each does, in units."""
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
        gains = np.empty((len(positions), len(positions)))
        _write_gains(positions, self._law, self._key, *self._crossed, gains)
        if self._barriers:
            lines = segment_grid([barrier[:4] for barrier in self._barriers])
            gains -= wall_losses_db(lines, [barrier.loss_db for barrier in self._barriers], positions)
        return gains

    def distance_m(self, loss_db: float) -> float:
        """Return a distance in m from which on signals lose more than *loss_db*, whatever their walls and shadowing."""
        reference_db, exponent, shadowing_db, _ = self._law
        decades = (loss_db - reference_db + shadowing_db * MOST_NORMAL) / (10.0 * exponent)
        farthest_m: float = elementary.exp10(min(decades, 300.0))
        return max(NEAREST_M, farthest_m) * (1.0 + 1e-9)  # more than rounding

    @property
    def losses(self) -> Losses:
        """What signals lose now, for kernels."""
        lines = segment_grid([barrier[:4] for barrier in self._barriers])
        line_units = loss_units(lines, [barrier.loss_db for barrier in self._barriers])
        return Losses(self._law, self._key, *self._crossed, lines.walls_m, line_units)


# ---------------------------------------------------------------- kernels


@njit(cache=True)  # not one that only borrows: the array of crossed weights is its own to release
def _write_gains(
    positions: Floats,
    law: tuple[float, float, float, float],
    key: tuple[int, int],
    walls_m: Floats,
    losses: Int64s,
    gains: Floats,
) -> None:
    """Write the gains through walls that cost *losses*, in units, into *gains*."""
    crossed = crossed_weights(walls_m, losses, positions)
    for i in range(positions.shape[0]):
        gains[i, i] = -np.inf
        ax, ay = positions[i]
        for j in range(i + 1, positions.shape[0]):
            bx, by = positions[j]
            gain = _law_gain_db(law, (bx - ax) ** 2 + (by - ay) ** 2)
            gain = _shadowed_db(law, key, gain, i, j, ax, ay, bx, by) - crossed[i, j] * LOSS_UNIT_DB
            gains[i, j] = gains[j, i] = gain


@njit(cache=True, borrows=True)
def law_gain_db(losses: Losses, square: float) -> float:
    """Return the gain at a distance with that *square* in m2, where nothing hinders signals; a kernel for kernels."""
    return _law_gain_db(losses.law, square)


@njit(cache=True, borrows=True)
def hinders(losses: Losses) -> bool:
    """Return whether anything but the distance may weaken signals; a kernel for kernels."""
    return losses.law[2] > 0.0 or len(losses.walls_m) > 0 or len(losses.barriers_m) > 0


@njit(cache=True, borrows=True)
def hindered_gain_db(losses: Losses, gain: float, i: int, j: int, ax: float, ay: float, bx: float, by: float) -> float:
    """Return what ``Propagation.gains_db`` does of robots *i* at a and *j* > *i* at b, by the law *gain*.

    A kernel for kernels.
    """
    gain = _shadowed_db(losses.law, losses.key, gain, i, j, ax, ay, bx, by)
    gain -= crossed_weight(losses.walls_m, losses.wall_units, ax, ay, bx, by) * LOSS_UNIT_DB
    gain -= crossed_weight(losses.barriers_m, losses.barrier_units, ax, ay, bx, by) * LOSS_UNIT_DB
    return gain


@njit(cache=True, borrows=True)
def _law_gain_db(law: tuple[float, float, float, float], square: float) -> float:
    reference_db, exponent, _, _ = law
    return -reference_db - 5.0 * exponent * elementary.log10(max(square, NEAREST_M * NEAREST_M))


@njit(cache=True, borrows=True)
def _shadowed_db(
    law: tuple[float, float, float, float],
    key: tuple[int, int],
    gain: float,
    i: int,
    j: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
) -> float:
    """Return the gain between robots *i* and *j* > *i* without walls, by the law *gain*."""
    _, _, shadowing_db, cell = law
    if shadowing_db > 0.0:
        words = philox_words(_place(ax, ay, cell), _place(bx, by, cell), i << 16 | j, 0, key[0], key[1])
        gain -= shadowing_db * _normal(words)
    return gain


@njit(cache=True, borrows=True)
def _place(x: float, y: float, cell: float) -> int:
    """Return the number of the square at (x, y), 32 bits; numbers repeat after 65536 squares."""
    return (math.floor(x / cell) & 0xFFFF) << 16 | math.floor(y / cell) & 0xFFFF


@njit(cache=True, borrows=True)
def _normal(words: tuple[int, int, int, int]) -> float:
    """Return a standard normal number from random *words* (Box and Muller's transform)."""
    radius = (words[0] + 0.5) * 2.0**-32
    angle = (words[1] + 0.5) * 2.0**-32
    return math.sqrt(-2.0 * elementary.log(radius)) * elementary.cos(2.0 * math.pi * angle)
