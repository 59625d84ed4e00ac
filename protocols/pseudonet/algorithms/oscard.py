"""OSCARD, One-Step-Communicate-All-Robots-Discovery (paper 003, section VI, Fig. 10), with the triggers of III.A.

Readings of what the paper leaves open:
- "Select action that doesn't reduce d_ij": among uncovered neighbours, one that does not bring the robot nearer to
  its nearest team member; several are drawn with equal chances ("some arbitrary decision mechanism").
- "Else select an action with d_ij >= 2": if every uncovered neighbour is nearer to another robot, one that keeps two
  cells.
- Trapped (no uncovered neighbour): the boundary rule of Fig. 10 chooses the direction, over covered cells. "Boundary
  along the X axis" is a wall north or south of the robot, "along the Y axis" one east or west.
- "Extended": a robot that has been trapped for *patience* steps on end sends help; so does one that is surrounded, that
  is, one that cannot take any step at all. It stands still for that step. An answer sends it along the shortest way to
  the cell that the answer names.
- Revisiting: the cell that it stands in occurs *revisits* times among the last *history* cells. The robot sends trap
  with its trail, stands still for that step, and without an answer makes *k_forced* steps in a random direction.

When nobody answers. All robots of a team hear all messages of an exchange and know the same covered cells, so exactly
one of those that do not ask themselves answers, unless no uncovered cell can be reached from the asker. The forced
steps are therefore made in three cases and no other, as long as no answer is lost: a robot is alone; all robots of the
team ask in one exchange, which two robots do often and eight hardly ever; obstacles cut the asker off from all cells
that are left. A robot that has stopped and left its team does not answer either: the last one is alone.
"""

from collections import deque

import numpy as np

from cosim.geometry.grids import Cell
from protocols.pseudonet.algorithms.base import STEPS, Evaluation, Verdicts, judge, separation
from protocols.pseudonet.messages import TRAIL_LIMIT, Action, Kind, Verdict
from protocols.pseudonet.setup import View


class Oscard:
    """One robot's memory: its history, the steps it has been trapped for, where it was directed, and forced steps."""

    def __init__(self, stream: np.random.Generator, patience: int, history: int, revisits: int, k_forced: int) -> None:
        self._stream = stream
        self._patience = patience
        self._revisits = revisits
        self._k_forced = k_forced
        self._history: deque[Cell] = deque(maxlen=history)
        self._trail: deque[Action] = deque(maxlen=TRAIL_LIMIT)
        self._trapped = 0
        self._target: Cell | None = None
        self._forced: tuple[Action, int] | None = None
        self._awaiting = False

    def enlist(self, view: View) -> None:
        """Divide nothing: every robot may cover every cell."""

    def directed(self, target: Cell) -> None:
        """Go to the cell that the answer names."""
        self._target = target
        self._awaiting = False

    def committed(self, action: Action, cell: Cell) -> None:
        """Remember the robot's cells."""
        if action == Action.STAY:
            return
        self._history.append(cell)
        self._trail.append(action)
        if self._forced is not None:
            direction, left = self._forced
            self._forced = (direction, left - 1) if left > 1 else None

    def evaluate(self, view: View) -> Evaluation:
        """Choose the next action as Fig. 10 does."""
        verdicts = judge(view, avoid_covered=True, keep_distance=True)
        action = self._uncovered(view, verdicts)
        if action is not None:
            self._trapped = 0
            self._target = None
            self._forced = None
            return Evaluation(action, verdicts)
        if not view.omitted:
            self._trapped += 1
        return self._break_loop(view, verdicts)

    def _uncovered(self, view: View, verdicts: Verdicts) -> Action | None:
        possible = [action for action in STEPS if verdicts[action] == Verdict.POSSIBLE]
        if not possible:
            possible = [
                action
                for action in STEPS
                if verdicts[action] == Verdict.NEARER and separation(view, view.target(view.me, action)) >= 2
            ]
        return self._draw(possible)

    def _break_loop(self, view: View, verdicts: Verdicts) -> Evaluation:
        open_steps = [action for action in STEPS if verdicts[action] in (Verdict.COVERED, Verdict.NEARER)]
        if view.omitted:
            return Evaluation(self._any(open_steps), verdicts)
        guided = self._guided(view, open_steps)
        if guided is not None:
            return Evaluation(guided, verdicts)
        if self._awaiting:  # help or trap was sent, and no robot has answered
            self._awaiting = False
            direction = self._draw(open_steps)
            self._forced = None if direction is None else (direction, self._k_forced)
        if self._forced is not None:
            if self._forced[0] in open_steps:
                return Evaluation(self._forced[0], verdicts)
            self._forced = None
        if self._history.count(view.cells[view.me]) >= self._revisits:
            return self._ask(Kind.TRAP, verdicts)
        if self._trapped > self._patience or not open_steps:
            return self._ask(Kind.HELP, verdicts)
        return Evaluation(self._boundary_rule(view, verdicts, open_steps), verdicts)

    def _ask(self, kind: Kind, verdicts: Verdicts) -> Evaluation:
        self._awaiting = True
        self._trapped = 0
        self._history.clear()
        return Evaluation(Action.STAY, verdicts, kind, tuple(self._trail) if kind == Kind.TRAP else ())

    def _guided(self, view: View, open_steps: list[Action]) -> Action | None:
        """Return the next step on the shortest way to the cell that an answer named, while that is still uncovered."""
        if self._target is None:
            return None
        if view.is_covered(self._target):
            self._target = None
            return None
        away = view.setup.distances(self._target, view.obstacles)
        here = int(away[view.cells[view.me]])
        nearer = [action for action in open_steps if int(away[view.target(view.me, action)]) == here - 1]
        return nearer[0] if nearer else self._draw(open_steps)

    def _boundary_rule(self, view: View, verdicts: Verdicts, open_steps: list[Action]) -> Action:
        grid = view.setup.grid
        row, column = divmod(view.cells[view.me], grid.nx)
        wanted = []
        if Verdict.WALL in (verdicts[Action.NORTH], verdicts[Action.SOUTH]):
            wanted.append(Action.NORTH if grid.ny - 1 - row > row else Action.SOUTH)
        if Verdict.WALL in (verdicts[Action.EAST], verdicts[Action.WEST]):
            wanted.append(Action.EAST if grid.nx - 1 - column > column else Action.WEST)
        for action in wanted:
            if action in open_steps:
                return action
        apart = [action for action in open_steps if separation(view, view.target(view.me, action)) >= 2]
        return self._any(apart or open_steps)

    def _any(self, actions: list[Action]) -> Action:
        action = self._draw(actions)
        return Action.STAY if action is None else action

    def _draw(self, actions: list[Action]) -> Action | None:
        return actions[int(self._stream.integers(len(actions)))] if actions else None
