"""Small floors drawn as text, random mazes, and views of a team on them."""

from collections.abc import Mapping, Sequence
from inspect import cleandoc

import numpy as np

from cosim.geometry.grids import Cell, CoverageGrid
from protocols.pseudonet.algorithms.base import Evaluation
from protocols.pseudonet.algorithms.planned import Planned
from protocols.pseudonet.messages import Action
from protocols.pseudonet.parameters import Timing
from protocols.pseudonet.setup import Setup, View

OFFSETS = ((0, 1), (1, 0), (0, -1), (-1, 0))
TIMES = Timing(
    step=10, retry=1, poll_timeout=5, repair=5, inquiry=100, page=100, settle=10, stagger=1_000, silence=10_000
)


def grid_of(free: np.ndarray) -> CoverageGrid:
    """Make a grid of cells of 1 m from *free*, shape (ny, nx), whose free cells can all be reached."""
    ny, nx = free.shape
    steps = np.full((ny * nx, 4), -1, np.int32)
    for y, x in np.argwhere(free):
        for direction, (dx, dy) in enumerate(OFFSETS):
            if 0 <= x + dx < nx and 0 <= y + dy < ny and free[y + dy, x + dx]:
                steps[y * nx + x, direction] = (y + dy) * nx + x + dx
    flat = free.ravel()
    return CoverageGrid((0.0, 0.0), 1.0, nx, ny, steps, flat, flat.copy())


def floor(text: str) -> tuple[Setup, dict[str, Cell]]:
    """Return the floor of a picture, north up: '#' is solid, every letter or digit names its cell."""
    rows = cleandoc(text).splitlines()[::-1]
    free = np.array([[mark != "#" for mark in row] for row in rows])
    width = free.shape[1]
    names = {mark: y * width + x for y, row in enumerate(rows) for x, mark in enumerate(row) if mark not in "#."}
    return Setup(grid_of(free), 1, TIMES), names


def view_of(setup: Setup, me: int, cells: Mapping[int, Cell], covered: Sequence[Cell] = ()) -> View:
    """Return what robot *me* knows of robots in *cells*, which are covered as those of *covered* are."""
    return View(setup, me, tuple(sorted(cells)), dict(cells), {*covered, *cells.values()})


def maze(rng: np.random.Generator, width: int, height: int, loops: float, rooms: int) -> np.ndarray:
    """Return a spanning-tree maze of corridors one cell wide, with some walls taken out and some rooms."""
    free = np.zeros((2 * height - 1, 2 * width - 1), bool)
    stack = [(int(rng.integers(height)), int(rng.integers(width)))]
    free[2 * stack[0][0], 2 * stack[0][1]] = True
    while stack:
        y, x = stack[-1]
        open_ways = [
            (y + dy, x + dx)
            for dx, dy in OFFSETS
            if 0 <= y + dy < height and 0 <= x + dx < width and not free[2 * (y + dy), 2 * (x + dx)]
        ]
        if not open_ways:
            stack.pop()
            continue
        ny, nx = open_ways[int(rng.integers(len(open_ways)))]
        free[2 * ny, 2 * nx] = free[y + ny, x + nx] = True
        stack.append((ny, nx))
    odd = np.add.outer(np.arange(free.shape[0]), np.arange(free.shape[1])) % 2 == 1
    free |= odd & (rng.random(free.shape) < loops)
    for _ in range(rooms):
        y, x = int(rng.integers(free.shape[0])), int(rng.integers(free.shape[1]))
        free[y : y + 3, x : x + 3] = True
    return free


def flood(grid: CoverageGrid, start: Cell) -> set[Cell]:
    """Return the cells that can be stepped to from *start*, one by one."""
    found, left = {start}, [start]
    while left:
        for cell in grid.steps[left.pop()].tolist():
            if cell >= 0 and cell not in found:
                found.add(cell)
                left.append(cell)
    return found


class PaperTeam:
    """Robots that take the steps of their algorithms at once, without radio, bodies or time."""

    def __init__(self, setup: Setup, starts: Sequence[Cell], algorithms: Sequence[Planned]) -> None:
        self.views = [view_of(setup, me, dict(enumerate(starts))) for me in range(len(starts))]
        self.cells = dict(enumerate(starts))
        self.evaluations: list[Evaluation] = []
        self._setup = setup
        self._algorithms = algorithms
        for view, algorithm in zip(self.views, algorithms, strict=True):
            algorithm.enlist(view)

    def step(self) -> None:
        """Let everybody take one step; fail if a cell is entered in which another stands or that another enters."""
        self.evaluations = [a.evaluate(view) for a, view in zip(self._algorithms, self.views, strict=True)]
        targets = {
            me: self.cells[me] if e.action == Action.STAY else self._setup.steps[self.cells[me]][e.action]
            for me, e in enumerate(self.evaluations)
        }
        moving = {me: cell for me, cell in targets.items() if cell != self.cells[me]}
        assert -1 not in moving.values(), f"{moving}: a step through a wall"
        assert not set(moving.values()) & set(self.cells.values()), f"{moving} into {self.cells}"
        assert len(set(moving.values())) == len(moving), f"{moving}: two into one cell"
        self.cells = targets
        for me, view in enumerate(self.views):
            view.cells.update(targets)
            view.covered.update(targets.values())
            self._algorithms[me].committed(self.evaluations[me].action, targets[me])

    @property
    def covered(self) -> set[Cell]:
        return self.views[0].covered
