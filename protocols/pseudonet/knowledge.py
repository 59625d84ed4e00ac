"""What every robot of a Pseudonet team knows before it starts, and what it gathers while it covers the floor.

The paper's robots know the number of cells and the grid a priori (section IV.A); where the others are, what is covered
and who is still in the team they learn from messages. ``Knowledge`` is the first, shared by all machines of a run
because it never changes; ``View`` is the second, one a robot.
"""

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from cosim.geometry.grids import Cell, CoverageGrid, distances
from cosim.machine import Address
from protocols.pseudonet.messages import Action

Distances: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
CACHED = 64


class Knowledge:
    """The grid and the team's size, with the distances to a cell computed once for all who ask."""

    def __init__(self, grid: CoverageGrid, size: int) -> None:
        self.grid = grid
        self.size = size
        self.steps: list[tuple[Cell, ...]] = [tuple(row) for row in grid.steps.tolist()]
        self.cells: frozenset[Cell] = frozenset(np.flatnonzero(grid.reachable).tolist())
        self._distances: OrderedDict[tuple[Cell, frozenset[Cell]], Distances] = OrderedDict()

    def distances(self, goal: Cell, obstacles: frozenset[Cell]) -> Distances:
        """Return the number of steps from every cell to *goal* around *obstacles*, -1 where there is no way."""
        key = (goal, obstacles)
        known = self._distances.get(key)
        if known is None:
            steps = self.grid.steps
            if obstacles:
                steps = np.where(np.isin(steps, list(obstacles)), np.int32(-1), steps)
            known = distances(steps, np.array([goal], dtype=np.int64))
            self._distances[key] = known
            if len(self._distances) > CACHED:
                self._distances.popitem(last=False)
        return known

    def place(self, cell: Cell) -> tuple[int, int]:
        """Return column and row of *cell*, as messages name it."""
        row, column = divmod(cell, self.grid.nx)
        return column, row

    def cell(self, column: int, row: int) -> Cell | None:
        """Return the cell of *column* and *row*, or None if there is no such cell."""
        if column < self.grid.nx and row < self.grid.ny:
            return row * self.grid.nx + column
        return None


@dataclass
class View:
    """What one robot knows of the team now."""

    knowledge: Knowledge
    me: Address
    members: tuple[Address, ...] = ()
    cells: dict[Address, Cell] = field(default_factory=dict)
    """Where each robot is, or will be when the step that was agreed on is done."""
    covered: set[Cell] = field(default_factory=set)
    """What robots have reported to have covered."""
    obstacles: frozenset[Cell] = frozenset()
    """Where robots that were dropped may stand."""
    omitted: set[Action] = field(default_factory=set)
    """Actions that I have given up in this step, because others had the better claim."""

    def target(self, robot: Address, action: Action) -> Cell:
        """Return where *action* takes *robot*; -1 if it cannot be taken."""
        cell = self.cells[robot]
        return cell if action == Action.STAY else self.knowledge.steps[cell][action]

    def others(self) -> list[Cell]:
        """Return the cells of all other members."""
        return [self.cells[member] for member in self.members if member != self.me]

    def occupied(self) -> set[Cell]:
        """Return the cells in which somebody else stands, dropped robots included."""
        return set(self.others()) | self.obstacles

    def is_covered(self, cell: Cell) -> bool:
        """Return whether *cell* is covered, or will be when the present step is done."""
        return cell in self.covered or cell in self.cells.values()

    def remaining(self) -> set[Cell]:
        """Return the cells that are not covered and that some member can still reach."""
        left = self.knowledge.cells - self.covered - self.obstacles
        return {cell for cell in left if self.reachable(cell)} if self.obstacles else set(left)

    def reachable(self, cell: Cell) -> bool:
        """Return whether a member can drive to *cell* around the obstacles."""
        away = self.knowledge.distances(self.cells[self.me], self.obstacles)
        return bool(away[cell] >= 0)

    def complete(self) -> bool:
        """Return whether everything that can be covered is."""
        if len(self.covered) < len(self.knowledge.cells) - len(self.obstacles) and not self.obstacles:
            return False
        return not self.remaining()

    def nearest_uncovered(self, origin: Cell, avoid: Iterable[Cell] = ()) -> Cell | None:
        """Return the uncovered cell that is the fewest steps away from *origin*; the lowest number breaks ties."""
        away = self.knowledge.distances(origin, self.obstacles)
        cells = [cell for cell in sorted(self.remaining() - set(avoid)) if away[cell] >= 0]
        return min(cells, key=lambda cell: (int(away[cell]), cell)) if cells else None
