"""Random walk: any step that is possible, with equal chances; the baseline that knows nothing and asks for nothing."""

import numpy as np

from cosim.geometry.grids import Cell
from protocols.pseudonet.algorithms.base import STEPS, Evaluation, judge
from protocols.pseudonet.messages import Action, Verdict
from protocols.pseudonet.setup import View


class RandomWalk:
    """A robot that takes one of the possible steps, whether the cell is covered or not."""

    def __init__(self, stream: np.random.Generator) -> None:
        self._stream = stream

    def enlist(self, view: View) -> None:
        """Divide nothing."""

    def evaluate(self, view: View) -> Evaluation:
        """Draw one of the possible steps; stay where there is none."""
        verdicts = judge(view, avoid_covered=False, keep_distance=False)
        possible = [action for action in STEPS if verdicts[action] == Verdict.POSSIBLE]
        action = possible[int(self._stream.integers(len(possible)))] if possible else Action.STAY
        return Evaluation(action, verdicts)

    def directed(self, target: Cell) -> None:
        """Go on walking at random: this robot never asks."""

    def committed(self, action: Action, cell: Cell) -> None:
        """Keep no memory."""
