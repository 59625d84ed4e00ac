"""The truth about coverage: which cells the robots' bodies have really been in, and what that cost."""

from typing import Any

import numpy as np

from cosim.units import Time, to_seconds
from protocols.pseudonet.knowledge import Knowledge

Metres = np.ndarray[Any, np.dtype[np.float64]]


class CoverageReferee:
    """Counts the cells that robots' centres enter; sees poses only, never what machines believe."""

    def __init__(self, knowledge: Knowledge) -> None:
        self._grid = knowledge.grid
        self._visits = np.zeros(self._grid.nx * self._grid.ny, dtype=np.int64)
        self._target = len(knowledge.cells)
        self._covered = 0
        self._last: Any = None
        self._complete_at: Time | None = None

    def look(self, x_m: Metres, y_m: Metres, now: Time) -> bool:
        """Count the cells that were entered since the last tick; never end the run: the team itself finds its end."""
        grid = self._grid
        columns = np.floor((x_m - grid.origin_m[0]) / grid.cell_m).astype(np.int64)
        rows = np.floor((y_m - grid.origin_m[1]) / grid.cell_m).astype(np.int64)
        cells = rows * grid.nx + columns
        entered = cells if self._last is None else cells[cells != self._last]
        self._last = cells
        if entered.size:
            np.add.at(self._visits, entered, 1)
            self._covered = int(np.count_nonzero(self._visits[self._grid.reachable]))
            if self._complete_at is None and self._covered == self._target:
                self._complete_at = now
        return False

    def verdict(self, now: Time) -> dict[str, float]:
        """Return coverage, the time at which it was complete, and the share of entries that covered nothing new."""
        entries = int(self._visits.sum())
        return {
            "coverage": self._covered / self._target,
            "time_to_cover_s": float("nan") if self._complete_at is None else to_seconds(self._complete_at),
            "overlap_ratio": (entries - self._covered) / self._covered,
        }
