"""The contract of coverage algorithms with the coordination layer: a choice among four steps and standing still."""

from dataclasses import dataclass
from typing import Protocol

from cosim.geometry.grids import Cell
from protocols.pseudonet.messages import Action, Kind, Verdict
from protocols.pseudonet.setup import View

Verdicts = tuple[Verdict, Verdict, Verdict, Verdict]
UNJUDGED: Verdicts = (Verdict.POSSIBLE, Verdict.POSSIBLE, Verdict.POSSIBLE, Verdict.POSSIBLE)
"""The verdicts of a robot that has not evaluated anything."""
STEPS = (Action.NORTH, Action.EAST, Action.SOUTH, Action.WEST)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The outcome of evaluate_actions (Fig. 12): the chosen action, why others failed, and what to send to the team."""

    action: Action
    verdicts: Verdicts
    kind: Kind = Kind.STATE
    trail: tuple[Action, ...] = ()

    def __str__(self) -> str:
        """Return what the trace of calls shows of an evaluation."""
        failed = [f"{a.name.lower()}: {v.name.lower()}" for a, v in zip(STEPS, self.verdicts, strict=True) if v]
        return f"{self.action.name.lower()}{', as ' if failed else ''}{', '.join(failed)}"


class Algorithm(Protocol):
    """A coverage algorithm of one robot."""

    def enlist(self, view: View) -> None:
        """Process a new team: divide what is left among it, if the algorithm divides."""

    def evaluate(self, view: View) -> Evaluation:
        """Choose the next action by *view*, without those in ``view.omitted``."""

    def directed(self, target: Cell) -> None:
        """Process the answer of a team member: the nearest uncovered cell that it knows."""

    def committed(self, action: Action, cell: Cell) -> None:
        """Process that the team has agreed, and that *action* takes this robot to *cell*."""


def judge(view: View, avoid_covered: bool, keep_distance: bool) -> Verdicts:
    """Return the verdict on each of the four steps.

    With *keep_distance*, a step that reduces the Manhattan distance to the nearest other robot is NEARER.
    """
    occupied = view.occupied()
    others = view.others() if keep_distance else []
    here = _nearest(view, view.cells[view.me], others)
    verdicts = []
    for action in STEPS:
        target = view.target(view.me, action)
        if target < 0:
            verdict = Verdict.WALL
        elif target in occupied:
            verdict = Verdict.ROBOT
        elif action in view.omitted:
            verdict = Verdict.LOST
        elif avoid_covered and view.is_covered(target):
            verdict = Verdict.COVERED
        elif others and _nearest(view, target, others) < here:
            verdict = Verdict.NEARER
        else:
            verdict = Verdict.POSSIBLE
        verdicts.append(verdict)
    north, east, south, west = verdicts
    return north, east, south, west


def separation(view: View, cell: Cell) -> int:
    """Return the Manhattan distance, in cells, from *cell* to the nearest other robot (d_ij of Fig. 10)."""
    return _nearest(view, cell, view.others())


def _nearest(view: View, cell: Cell, others: list[Cell]) -> int:
    nx = view.setup.grid.nx
    row, column = divmod(cell, nx)
    return min((abs(other // nx - row) + abs(other % nx - column) for other in others), default=1 << 30)
