"""Gathering: all robots come together round the most central of them, and each step is agreed on as in coverage.

The paper announces other applications on the same architecture ("it can be extended to other multi-agent applications
by suitably modifying the information packet", section III). Here the packets stay as they are: what changes is what a
robot evaluates, and when the team has done its task.

The *place* is the cell of the member with the smallest sum of ways to all others; every robot computes the same place,
as all know the same positions. A robot makes a step only if that brings it nearer to the place. Its message gives the
verdict on all four steps as in coverage; a step that brings nothing takes the verdict of a cell in which nothing is
left to do (``Verdict.COVERED``). Two robots that want the same cell claim it with their reasons, and the one with fewer
other ways in keeps it (paper 003, section VI).

A robot is *settled* if it is at the place, or if settled robots stand in all the cells from which the way is a step
shorter than its own: it cannot come nearer any more, and says stop. The task is done when all are settled.

Why that comes to an end: while a robot is not settled, let U be one of those with the shortest way. Each cell that is
nearer than U's is empty or holds a settled robot, and one of U's next cells is empty: so U can make a step. Of all
robots that want a cell one gets it, so in every step of the team a robot comes nearer and none goes farther away; the
sum of all ways falls until no robot can make a step, which is when all are settled. Then the robots stand together:
from each of them a chain of occupied cells leads to the place.

A robot that cannot come, because dead bodies are in its way, counts as settled where it is.
"""

from collections.abc import Mapping

from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.pseudonet.algorithms.base import STEPS, Evaluation, Verdicts, judge
from protocols.pseudonet.coordination import Coordination
from protocols.pseudonet.messages import Action, Kind, Message, Verdict
from protocols.pseudonet.setup import Setup, View


def choose_place(view: View) -> Cell:
    """Return the cell of the member with the smallest sum of ways from all others.

    A member that more others can reach comes first; of equal ones that with the lowest number.
    """

    def cost(member: Address) -> tuple[int, int, Address]:
        away = view.setup.distances(view.cells[member], view.obstacles)
        ways = [int(away[view.cells[other]]) for other in view.members]
        return sum(way < 0 for way in ways), sum(way for way in ways if way > 0), member

    return view.cells[min(view.members, key=cost)]


def settled(view: View, place: Cell) -> set[Address]:
    """Return the members that cannot come nearer to *place* any more."""
    away = view.setup.distances(place, view.obstacles)
    found: set[Address] = set()
    cells: set[Cell] = set()
    for member in sorted(view.members, key=lambda member: int(away[view.cells[member]])):
        cell = view.cells[member]
        if cells.issuperset(nearer(view, cell, place)):  # nothing is nearer than the place, or where no way leads
            found.add(member)
            cells.add(cell)
    return found


def nearer(view: View, cell: Cell, place: Cell) -> list[Cell]:
    """Return the cells, a step from *cell*, from which the way to *place* is a step shorter."""
    away = view.setup.distances(place, view.obstacles)
    return [beyond for beyond in view.setup.steps[cell] if beyond >= 0 and 0 <= away[beyond] < away[cell]]


class Gathering:
    """One robot's choice of steps: one that brings it nearer to the place, along the side on which it is farther."""

    def __init__(self) -> None:
        self.place: Cell | None = None
        """Cell where the team gathers; None before it is chosen."""
        self._stopped = False

    def enlist(self, view: View) -> None:
        """Choose the place for a new team, or around obstacles that were not known before."""
        self.place = choose_place(view)
        self._stopped = False

    def evaluate(self, view: View) -> Evaluation:
        """Choose a step that is possible and leads nearer; stay if there is none, and say stop once when settled."""
        if self.place is None:  # the team's first plan is not made yet
            return Evaluation(Action.STAY, judge(view, False, False))
        verdicts = self._judge(view, self.place)
        possible = [action for action in STEPS if verdicts[action] == Verdict.POSSIBLE]
        if possible:
            return Evaluation(max(possible, key=lambda action: self._left(view, action)), verdicts)
        stop = not self._stopped and view.me in settled(view, self.place)
        self._stopped = self._stopped or stop
        return Evaluation(Action.STAY, verdicts, Kind.STOP if stop else Kind.STATE)

    def directed(self, target: Cell) -> None:
        """Keep to the place: this robot never asks."""

    def committed(self, action: Action, cell: Cell) -> None:
        """Keep no memory: all places are in the view."""

    def _judge(self, view: View, place: Cell) -> Verdicts:
        worth = set(nearer(view, view.cells[view.me], place))
        north, east, south, west = (
            Verdict.COVERED if verdict == Verdict.POSSIBLE and view.target(view.me, action) not in worth else verdict
            for action, verdict in zip(STEPS, judge(view, False, False), strict=True)
        )
        return north, east, south, west

    def _left(self, view: View, action: Action) -> int:
        """Return the distance to the place along the axis of *action*, in cells."""
        assert self.place is not None
        here, there = view.setup.place(view.cells[view.me]), view.setup.place(self.place)
        axis = 1 if action in (Action.NORTH, Action.SOUTH) else 0
        return abs(there[axis] - here[axis])


class GatheringCoordination(Coordination):
    """The coordination layer of a team that gathers: nothing is ever covered, and the task is done when all settle."""

    def __init__(self, setup: Setup, me: Address, rounds: int) -> None:
        self._gathering = Gathering()
        super().__init__(setup, me, self._gathering, None, rounds)

    def take_positions(self, messages: Mapping[Address, Message]) -> None:
        """Take over the places of all robots."""
        super().take_positions(messages)
        self.view.covered.clear()

    def complete(self) -> bool:
        """Return whether no robot can come nearer, with the plan that is in force."""
        place = self._gathering.place
        return not self.plan_due and place is not None and len(settled(self.view, place)) == len(self.view.members)
