"""The two complete algorithms: tours planned for the whole team, driven by robots that make room for each other.

Every robot knows the same plan, the same positions and the same covered cells, so every robot computes the whole team's
next step and takes its own part of it; no two of them want the same cell. What has to be kept alive is progress:
bodies are solid, and corridors are one cell wide.

Robots decide in the order of their distance to their goals (the first uncovered cell of one's tour), then of their
numbers; robots without a goal come last. A step may only lead into an empty cell. Where all the next cells on the
shortest ways are taken, the robots there that have not decided yet are asked to clear them, in a chain that ends in an
empty cell: so a dormant robot clears the passage that it stands in.

Why everything gets covered: let L be the robot that decides first. Its goal is uncovered, hence empty, and can be
reached; so beyond the robots in L's way there is an empty cell, and the chain exists. It opens L's next cell after at
most as many steps as the team has robots, and no other robot takes that cell from L, which decides first. Thus the
least distance of a robot to its goal falls again and again (another robot that decides first has a smaller one still),
until a goal is covered: by L, or by a robot that was pushed onto it. The tours are finite.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeAlias

from cosim.geometry.grids import Cell, CoverageGrid
from cosim.machine import Address
from protocols.pseudonet.algorithms.base import STEPS, Evaluation, judge
from protocols.pseudonet.messages import Action, Kind
from protocols.pseudonet.plans.tours import Tour, assign
from protocols.pseudonet.setup import View

Planner: TypeAlias = Callable[[CoverageGrid, Sequence[Cell], int], Sequence[Tour]]
"""(grid, cells to cover, number of robots) -> a tour for each robot."""


class Task(NamedTuple):
    """A robot's next goal, and the number of steps there."""

    robot: Address
    goal: Cell
    distance: int


class Planned:
    """One robot's copy of the team's plan."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._tours: dict[Address, Tour] = {}
        self._next: dict[Address, int] = {}
        self._stopped = False

    def enlist(self, view: View) -> None:
        """Divide what is left among the members, each connected part of the floor among those that can drive there."""
        self._tours = {}
        left = view.remaining()
        for group in _groups(view):
            away = view.setup.distances(view.cells[group[0]], view.obstacles)
            cells = tuple(sorted(cell for cell in left if away[cell] >= 0))
            starts = tuple(view.cells[robot] for robot in group)
            plan = partial(self._plan, view, cells, starts)
            tours = view.setup.once((self._planner, cells, starts, view.obstacles), plan)
            self._tours |= dict(zip(group, tours, strict=True))
        self._next = dict.fromkeys(self._tours, 0)
        self._stopped = False

    def _plan(self, view: View, cells: tuple[Cell, ...], starts: tuple[Cell, ...]) -> tuple[Tour, ...]:
        grid = view.setup.around(view.obstacles)
        parts = self._planner(grid, cells, len(starts))
        return assign(parts, starts, lambda cell: view.setup.distances(cell, view.obstacles))

    def evaluate(self, view: View) -> Evaluation:
        """Take this robot's part of the team's next step; stay if another robot has the better claim after all."""
        action = Action.STAY if view.omitted else self._team_step(view).get(view.me, Action.STAY)
        stop = action == Action.STAY and not self._stopped and self._goal(view, view.me, view.standing()) is None
        self._stopped = self._stopped or stop
        return Evaluation(action, judge(view, False, False), Kind.STOP if stop else Kind.STATE)

    def directed(self, target: Cell) -> None:
        """Keep to the plan: this robot never asks."""

    def committed(self, action: Action, cell: Cell) -> None:
        """Keep no memory: what is covered is in the view."""

    def _team_step(self, view: View) -> dict[Address, Action]:
        """Return the team's next step, which is computed once for all robots that know the same."""

        def compute() -> dict[Address, Action]:
            return joint_step(view, self._tasks(view))

        if len(view.standing()) < len(view.cells):  # of two in one cell a robot knows whom it has heard of last
            return compute()
        return view.setup.again((view.members, view.cells, view.covered, view.obstacles, self._tours), compute)

    def _goal(self, view: View, robot: Address, standing: set[Cell]) -> Cell | None:
        """Return the first cell of a robot's tour that is not covered, and will not be: robots are *standing* there."""
        tour = self._tours.get(robot, ())
        for index in range(self._next.get(robot, 0), len(tour)):
            if tour[index] not in view.covered and tour[index] not in standing:
                return tour[index]
        return None

    def _tasks(self, view: View) -> list[Task]:
        tasks = []
        standing = view.standing()
        for robot in view.members:
            tour = self._tours.get(robot, ())
            index = self._next.get(robot, 0)
            while index < len(tour) and tour[index] in view.covered:
                self._next[robot] = index = index + 1
            goal = self._goal(view, robot, standing)
            if goal is not None:
                tasks.append(Task(robot, goal, _distance(view, robot, goal)))
        return sorted(tasks, key=lambda task: (task.distance, task.robot))


def _distance(view: View, robot: Address, goal: Cell) -> int:
    cell = view.cells[robot]
    if goal in view.setup.steps[cell]:
        return 1
    return int(view.setup.distances(goal, view.obstacles)[cell])


def _groups(view: View) -> list[list[Address]]:
    """Return the members by connected part of the floor."""
    groups: list[list[Address]] = []
    for robot in view.members:
        away = view.setup.distances(view.cells[robot], view.obstacles)
        for group in groups:
            if away[view.cells[group[0]]] >= 0:
                group.append(robot)
                break
        else:
            groups.append([robot])
    return groups


def joint_step(view: View, tasks: Sequence[Task]) -> dict[Address, Action]:
    """Return the next action of every robot that moves; *tasks* in the order in which robots decide."""
    step = _JointStep(view)
    for task in tasks:
        step.decide(task)
    return step.actions


class _JointStep:
    """The team's next step while it is being decided."""

    def __init__(self, view: View) -> None:
        self.actions: dict[Address, Action] = {}
        self._view = view
        self._standing = {cell: robot for robot, cell in view.cells.items() if robot in view.members}
        self._taken = set(self._standing) | view.obstacles
        self._decided: set[Address] = set()

    def decide(self, task: Task) -> None:
        if task.robot in self._decided:
            return  # it makes room for another robot
        self._decided.add(task.robot)
        onward = self._onward(task)
        for action, cell in onward:
            if cell not in self._taken:
                self._move(task.robot, action, cell)
                return
        for _, cell in onward:
            if self._clear(cell, {self._view.cells[task.robot]}):
                return

    def _onward(self, task: Task) -> list[tuple[Action, Cell]]:
        """Return the steps that bring a robot nearer to its goal."""
        here = self._view.cells[task.robot]
        steps = self._view.setup.steps[here]
        if task.distance == 1:
            return [(STEPS[steps.index(task.goal)], task.goal)]
        away = self._view.setup.distances(task.goal, self._view.obstacles)
        nearer = task.distance - 1
        return [(action, steps[action]) for action in STEPS if steps[action] >= 0 and away[steps[action]] == nearer]

    def _move(self, robot: Address, action: Action, cell: Cell) -> None:
        self.actions[robot] = action
        self._taken.add(cell)

    def _clear(self, cell: Cell, seen: set[Cell]) -> bool:
        """Make the robot in *cell* leave it, or the next one in a chain; return whether that can be done."""
        robot = self._standing.get(cell)
        if robot is None or robot in self._decided:
            return False
        seen.add(cell)
        steps = self._view.setup.steps[cell]
        for action in STEPS:
            if steps[action] >= 0 and steps[action] not in self._taken:
                self._decided.add(robot)
                self._move(robot, action, steps[action])
                return True
        for action in STEPS:
            if steps[action] >= 0 and steps[action] not in seen and self._clear(steps[action], seen):
                self._decided.add(robot)  # it follows when its next cell is empty
                return True
        return False
