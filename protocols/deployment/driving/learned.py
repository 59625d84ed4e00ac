"""A floor that robots have learned by exploring it: nothing is known of it at first (paper 004, section 6).

"Equipped with such an occupancy grid map" planner and movers work as with a given one: what was seen to be occupied is
wall, cell by cell, and no robot goes, or is sent, where nothing was seen.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cosim.arrays import Bools, Floats
from cosim.geometry.segments import clearance, segment_grid
from protocols.deployment.planning.planner import Refusal
from protocols.deployment.tasks.plan import Place, Plan
from protocols.mapping.belief import Evidence
from protocols.motion.floor import Floor
from protocols.motion.parameters import DrivingParameters

EXPLORE: Final = "explore first: ways are only known where somebody has been looking"
"""Advice for a play to places that the learned map does not hold."""
_OFF_CELLS: Final = 0.75
"""Distance from the outline of an occupied cell, in cells, up to which what is scanned may be in it."""
_OF_WAYS: Final = ("get to", "no way")
"""Words in conflicts about places without a way."""


@dataclass(frozen=True, slots=True)
class MapLearned:
    """A robot has explored, and plans by what it has seen and received."""

    empty: int = field(metadata={"meaning": "how many cells of its map are empty"})
    occupied: int = field(metadata={"meaning": "how many cells of its map are occupied"})


class LearnedFloor(Floor):
    """The floor as one robot has learned it."""

    def __init__(self, bounds_m: tuple[float, float, float, float], parameters: DrivingParameters) -> None:
        """Know the extent x_min, y_min, x_max, y_max, and nothing else."""
        super().__init__(np.zeros((0, 4)), bounds_m, self._unseen, parameters)
        self._empty: Bools = np.zeros((0, 0), np.bool_)
        self._origin_m: Place = (0.0, 0.0)
        self._learned_m = 1.0

    def learn(self, evidence: Evidence, origin_m: Place, cell_m: float) -> None:
        """Use a map as the floor from now on.

        *evidence*, shape (ny, nx), is below 0 where a cell is empty and above where it is occupied; cell (0, 0) has
        its lower left corner at *origin_m*.
        """
        self._empty, self._origin_m, self._learned_m = evidence < 0, origin_m, cell_m
        self.walls = segment_grid(outlines(evidence > 0, origin_m, cell_m))
        self._grids.clear()
        self._fields.clear()

    def off_walls(self, points_m: Floats) -> Floats:
        """Return those of the points, shape (n, 2), at which the map has no wall."""
        near_m = _OFF_CELLS * self._learned_m
        return points_m[clearance(self.walls, points_m, 2.0 * near_m) > near_m]

    def _unseen(self, points: Floats) -> Bools:
        """Return which points, shape (n, 2), are not known to be empty."""
        ny, nx = self._empty.shape
        columns, rows = np.floor((points - np.array(self._origin_m)) / self._learned_m).astype(np.int64).T
        inside = (columns >= 0) & (columns < nx) & (rows >= 0) & (rows < ny)
        unseen = np.ones(len(points), np.bool_)
        unseen[inside] = ~self._empty[rows[inside], columns[inside]]
        return unseen


def floor_of(given: Floor, learned: bool) -> Floor:
    """Return the *given* floor, or one of the same extent of which nothing is known yet."""
    return LearnedFloor(given.bounds_m, given.parameters) if learned else given


def outlines(occupied: Bools, origin_m: Place, cell_m: float) -> Floats:
    """Return the edges between cells that are *occupied*, shape (ny, nx), and others, as few segments, shape (n, 4)."""
    padded = np.pad(np.asarray(occupied, np.int8), 1)
    rows = [(row, first, row, last) for row, first, last in _runs(np.diff(padded, axis=0)[:, 1:-1] != 0)]
    columns = [(first, column, last, column) for column, first, last in _runs((np.diff(padded, axis=1) != 0)[1:-1].T)]
    ends = np.array(rows + columns, np.float64).reshape(-1, 4)  # y, x, y, x in cells
    return np.asarray(ends[:, [1, 0, 3, 2]] * cell_m + np.array([*origin_m, *origin_m]), np.float64)


def _runs(marked: Bools) -> list[tuple[int, int, int]]:
    """Return the row, the first column and the end of each run of marks."""
    changes = np.diff(np.pad(marked.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    starts, ends = np.argwhere(changes == 1), np.argwhere(changes == -1)
    return [(int(row), int(first), int(end)) for (row, first), (_, end) in zip(starts, ends, strict=True)]


def explained(found: Plan | Refusal, floor: Floor) -> Plan | Refusal:
    """Return what the planner has found; add advice if it found no way on a floor that is to be learned."""
    if isinstance(found, Plan) or not isinstance(floor, LearnedFloor):
        return found
    if not any(text in conflict for conflict in found.conflicts for text in _OF_WAYS):
        return found
    return found.model_copy(update={"mend": (EXPLORE, *found.mend)})
