"""The information utility of frontiers (paper 001, section 5.1).

The paper proposes that the utility of a frontier's information changes its gain, and that a trapped robot goes to a
frontier that is more than the nearest one (after Makarenko et al., "An experiment in integrated exploration", IROS
2002, and Burgard et al., ICRA 2000); it prints no formula. Here the information of a cell is the number of unknown
cells in a square around it, half a side of which is the scanner's range. It counts in shares of the information of a
cell on a straight front beyond which all is unknown: so such a front attracts as strongly as without this term. Cells
behind walls count too.

The square's cells are counted by sums over all cells to the left and below (Crow, "Summed-area tables for texture
mapping", SIGGRAPH 1984): four numbers a square.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from cosim.arrays import Bools, Bytes, Singles
from cosim.geometry.astar import Reading, costs_from
from cosim.geometry.grids import Cell
from cosim.geometry.planning import Point
from cosim.jit import njit
from cosim.navigation.frontier_fields import WORD, Evidence, Vector, strength_of, sum_of_frontiers, words_within
from protocols.mapping.belief import Belief

Sums = npt.NDArray[np.int32]

_RENEW_TICKS: Final = 5
"""Interval between counts of unknown cells."""
_SLACK_M: Final = 0.5
"""Distance driven after which they are counted again in any case."""


@njit(cache=True)
def count_unknown(evidence: Evidence, low_x: int, low_y: int, sums: Sums) -> None:
    """Set ``sums[i, j]`` to the number of unknown cells with low_y <= iy < low_y + i and low_x <= ix < low_x + j.

    *evidence* is as ``marking`` has it, *sums* (rows + 1, columns + 1) may reach beyond the map, where nothing is
    unknown.
    """
    ny, nx = evidence.shape
    sums[0, :] = 0
    for i in range(1, sums.shape[0]):
        iy, row = low_y + i - 1, 0
        sums[i, 0] = 0
        for j in range(1, sums.shape[1]):
            ix = low_x + j - 1
            if 0 <= iy < ny and 0 <= ix < nx and evidence[iy, ix] == 0:
                row += 1
            sums[i, j] = sums[i - 1, j] + row


@njit(cache=True)
def utility(sums: Sums, i: int, j: int, half: int) -> float:
    """Return the information of the cell *i* rows and *j* columns from the corner of *sums*: 1 on a straight front.

    The square reaches *half* cells to each side; what is beyond *sums* does not count.
    """
    top, right = min(i + half + 1, sums.shape[0] - 1), min(j + half + 1, sums.shape[1] - 1)
    low, left = max(i - half, 0), max(j - half, 0)
    unknown = sums[top, right] - sums[low, right] - sums[top, left] + sums[low, left]
    return float(unknown / ((half + 1) * (2 * half + 1)))


@njit(cache=True)
def sum_by_utility(
    frontier: Bytes,
    evidence: Evidence,
    sums: Sums,
    low_x: int,
    low_y: int,
    half: int,
    weight: float,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    x: float,
    y: float,
    reach_m: float,
) -> Vector:
    """Return ``sum_of_frontiers`` with the unknown cells' terms times ``1 - weight + weight * utility``.

    Known cells that attract are those of a path: they count in full.
    """
    words = frontier.view(np.uint64)
    u, v, reach = (x - origin_x) / cell_m - 0.5, (y - origin_y) / cell_m - 0.5, reach_m / cell_m
    sum_u, sum_v = 0.0, 0.0
    for iy in range(max(math.ceil(v - reach), 0), min(math.floor(v + reach) + 1, words.shape[0])):
        dv = iy - v
        first, last = words_within(u, dv, reach, words.shape[1])
        for word in range(first, last):
            if words[iy, word] == 0:
                continue
            for ix in range(WORD * word, WORD * word + WORD):
                strength = strength_of(ix - u, dv, reach) if frontier[iy, ix] != 0 else 0.0
                if strength > 0.0:
                    if evidence[iy, ix] == 0:
                        strength *= 1.0 + weight * (utility(sums, iy - low_y, ix - low_x, half) - 1.0)
                    sum_u += strength * (ix - u)
                    sum_v += strength * dv
    scale = 1.0 / (cell_m * cell_m)
    return scale * sum_u, scale * sum_v


class Attraction:
    """The attraction of one robot to the frontiers: equation 3, with gains by information if wanted."""

    def __init__(self, belief: Belief, reach_m: float, range_m: float, weight: float) -> None:
        """Attract as far as *reach_m*; *weight* 0 is the paper's equation, with 1 gains are proportional to utility."""
        self._belief = belief
        self._reach_m = reach_m
        self._weight = weight
        cell_m = belief.frame.cell_m
        self._half = math.ceil(range_m / cell_m)
        self._about = math.ceil((reach_m + _SLACK_M) / cell_m) + self._half
        self._sums = np.zeros((2 * self._about + 2, 2 * self._about + 2), np.int32)
        self._middle: tuple[int, int] | None = None
        """Row and column around which cells were counted."""
        self._age = 0

    def to(self, here_m: Point, attracting: Bytes) -> Vector:
        """Return the sum over cells that are not 0 in *attracting*, frontiers and a path, with gain 1 (1 / m^2)."""
        belief = self._belief
        (left, low), cell_m = belief.frame.origin_m, belief.frame.cell_m
        if not self._weight:
            return sum_of_frontiers(attracting, left, low, cell_m, *here_m, self._reach_m)
        low_y, low_x = self._counted(here_m)
        sums, half, weight = self._sums, self._half, self._weight
        return sum_by_utility(
            attracting, belief.evidence, sums, low_x, low_y, half, weight, left, low, cell_m, *here_m, self._reach_m
        )

    def _counted(self, here_m: Point) -> tuple[int, int]:
        """Count again if it is time; return the row and column at which the count begins."""
        frame, about = self._belief.frame, self._about
        iy, ix = divmod(frame.cell_at(here_m), frame.nx)
        self._age += 1
        far = (
            self._middle is None or max(abs(iy - self._middle[0]), abs(ix - self._middle[1])) > _SLACK_M / frame.cell_m
        )
        if far or self._age >= _RENEW_TICKS:
            self._middle, self._age = (iy, ix), 0
            count_unknown(self._belief.evidence, ix - about, iy - about, self._sums)
        assert self._middle is not None
        return self._middle[0] - about, self._middle[1] - about


def most_useful(
    evidence: Evidence,
    passable: Bools,
    extra: Singles,
    start: Cell,
    goals: Bools,
    range_cells: float,
    weight: float,
    reading: Reading = "octile",
) -> Cell | None:
    """Return the cell of *goals* (ny, nx) with the greatest utility less cost, None if no way leads to any.

    Information counts with *weight* and the cost of the way with 1 - weight, each in shares of the greatest among the
    goals; of equal cells the first is taken. The grids and *reading* are those of ``cosim.geometry.astar``.
    """
    costs = costs_from(passable, extra, start, goals, reading)
    cells = np.flatnonzero(goals & np.isfinite(costs))
    if not len(cells):
        return None
    ny, nx = evidence.shape
    sums = np.empty((ny + 1, nx + 1), np.int32)
    count_unknown(evidence, 0, 0, sums)
    half = math.ceil(range_cells)
    found = np.array([utility(sums, int(cell) // nx, int(cell) % nx, half) for cell in cells])
    cost = costs.reshape(-1)[cells]
    net = weight * found / max(found.max(), 1e-9) - (1.0 - weight) * cost / max(cost.max(), 1e-9)
    return int(cells[int(net.argmax())])
