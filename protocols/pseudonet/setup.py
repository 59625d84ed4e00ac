"""What every robot of a Pseudonet team knows before it starts, and what it learns while it covers the floor.

The paper's robots know the number of cells and the grid a priori (section IV.A); the places of the others, the covered
cells and the members of the team they learn from messages. ``Setup`` is the former, shared by all machines of a run
because it never changes; ``View`` is the latter, one for each robot.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from cosim.geometry.grids import Cell, CoverageGrid, distances
from cosim.machine import Address
from protocols.pseudonet.messages import Action
from protocols.pseudonet.parameters import Timing
from protocols.transport.links import MOST_ROBOTS

Distances: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
CACHED = 64

T = TypeVar("T")


class Setup:
    """The grid, the team's size and that of its piconets; distances to a cell are computed once for all machines."""

    def __init__(self, grid: CoverageGrid, size: int, timing: Timing, piconet_size: int = MOST_ROBOTS) -> None:
        self.grid = grid
        self.size = size
        self.timing = timing
        self.piconet_size = piconet_size
        """The most devices of a piconet, the master included."""
        self.steps: list[tuple[Cell, ...]] = [tuple(row) for row in grid.steps.tolist()]
        self.cells: frozenset[Cell] = frozenset(np.flatnonzero(grid.reachable).tolist())
        self._around: tuple[frozenset[Cell], CoverageGrid] = (frozenset(), grid)
        self._plans: dict[Hashable, Any] = {}
        self._last: tuple[tuple[Any, ...], Any] | None = None
        self._distances: OrderedDict[tuple[Cell, frozenset[Cell]], Distances] = OrderedDict()

    def distances(self, goal: Cell, obstacles: frozenset[Cell]) -> Distances:
        """Return the number of steps from every cell to *goal* around *obstacles*, -1 where there is no way."""
        key = (goal, obstacles)
        known = self._distances.get(key)
        if known is None:
            known = distances(self.around(obstacles).steps, np.array([goal], dtype=np.int64))
            self._distances[key] = known
            if len(self._distances) > CACHED:
                self._distances.popitem(last=False)
        return known

    def around(self, obstacles: frozenset[Cell]) -> CoverageGrid:
        """Return the grid without the steps that lead into *obstacles*."""
        if not obstacles:
            return self.grid
        if obstacles != self._around[0]:
            steps = np.where(np.isin(self.grid.steps, list(obstacles)), np.int32(-1), self.grid.steps)
            self._around = (obstacles, replace(self.grid, steps=steps))
        return self._around[1]

    def once(self, key: Hashable, compute: Callable[[], T]) -> T:
        """Return ``compute()``, computed once for all machines that ask with this *key*.

        Only for pure functions of what the whole team knows: every robot computes the same plan from the same messages.
        """
        if key not in self._plans:
            self._plans[key] = compute()
        plan: T = self._plans[key]
        return plan

    def again(self, known: tuple[Any, ...], compute: Callable[[], T]) -> T:
        """Return ``compute()``, computed for the first machine that asks with this, of as many that do in succession.

        For the same functions as :meth:`once`; *known* may grow without end: none but the last is kept.
        """
        if self._last is None or self._last[0] != known:
            self._last = tuple(map(copy, known)), compute()
        result: T = self._last[1]
        return result

    def place(self, cell: Cell) -> tuple[int, int]:
        """Return column and row of *cell*, as in messages."""
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

    setup: Setup
    me: Address
    members: tuple[Address, ...] = ()
    cells: dict[Address, Cell] = field(default_factory=dict)
    """Cell of each robot, now or when the agreed step is done."""
    covered: set[Cell] = field(default_factory=set)
    """Cells that robots have reported as covered."""
    obstacles: frozenset[Cell] = frozenset()
    """Cells that robots could not enter, though the plan has no wall there: a body stands in them."""
    omitted: set[Action] = field(default_factory=set)
    """Actions that this robot has given up in this step, because others had the better claim."""

    def target(self, robot: Address, action: Action) -> Cell:
        """Return the cell to which *action* takes *robot*; -1 if it cannot be taken."""
        cell = self.cells[robot]
        return cell if action == Action.STAY else self.setup.steps[cell][action]

    def others(self) -> list[Cell]:
        """Return the cells of all other members."""
        return [self.cells[member] for member in self.members if member != self.me]

    def occupied(self) -> set[Cell]:
        """Return the cells in which other robots stand, robots of no team included."""
        return set(self.others()) | self.obstacles

    def standing(self) -> set[Cell]:
        """Return the cells of all robots whose places are known."""
        return set(self.cells.values())

    def is_covered(self, cell: Cell) -> bool:
        """Return whether *cell* is covered, or will be when the present step is done."""
        return cell in self.covered or cell in self.cells.values()

    def remaining(self) -> set[Cell]:
        """Return the cells that are not covered and that some member can still reach."""
        return set(self._left())

    def complete(self) -> bool:
        """Return whether all cells that can be covered are covered."""
        if not self.obstacles:
            return len(self.covered) == len(self.setup.cells)  # no robot ever stands on another cell
        return next(self._left(), None) is None  # mostly the first cell that is looked at will do

    def _left(self) -> Iterator[Cell]:
        left = self.setup.cells - self.covered
        if not self.obstacles:
            return iter(left)
        ways = [self.setup.distances(self.cells[member], self.obstacles) for member in self.members]
        return (cell for cell in left - self.obstacles if any(way[cell] >= 0 for way in ways))

    def nearest_uncovered(self, origin: Cell) -> Cell | None:
        """Return the uncovered cell with the fewest steps from *origin*; the lowest number breaks ties."""
        away = self.setup.distances(origin, self.obstacles)
        cells = [cell for cell in self.remaining() if away[cell] >= 0]
        return min(cells, key=lambda cell: (int(away[cell]), cell)) if cells else None
