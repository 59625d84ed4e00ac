"""The truth about the explorers: which targets they have reached, in order, and in how many motion steps."""

import math

from cosim.arrays import Floats
from cosim.machine import Address
from cosim.protocol import Death, Referee
from cosim.units import Time
from protocols.reflection.setup import Setup


class TargetReferee(Referee):
    """Watches where the explorers are; sees bodies only, never what machines believe.

    The targets of an explorer count in their order, one a tick. A target that its machine gives up stays open here, and
    so do all after it: such a run ends when the machines have finished.
    """

    def __init__(self, setup: Setup, epsilon_m: float) -> None:
        self._targets_m = setup.targets_m
        self._epsilon_m = epsilon_m
        self._next = [0] * len(self._targets_m)
        self._steps = [0] * len(self._targets_m)
        self._open = [explorer for explorer, targets in enumerate(self._targets_m) if targets]
        """Those who live and have targets left."""
        self._begun = False

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Count a motion step for every living explorer with open targets; return whether there is none."""
        for explorer in self._open.copy():
            self._steps[explorer] += self._begun
            x, y = self._targets_m[explorer][self._next[explorer]]
            if math.hypot(x_m.item(explorer) - x, y_m.item(explorer) - y) < self._epsilon_m:
                self._reached(explorer)
        self._begun = True
        return not self._open and bool(self._targets_m)

    def _reached(self, explorer: Address) -> None:
        self._next[explorer] += 1
        if self._next[explorer] == len(self._targets_m[explorer]):
            self._open.remove(explorer)

    def died(self, death: Death) -> None:
        """Expect nothing more of the dead."""
        if death.robot in self._open:
            self._open.remove(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return motion steps and targets reached, all explorers together."""
        steps, reached = sum(self._steps), sum(self._next)
        return {
            "motion_steps": float(steps),
            "targets_reached": float(reached),
            "steps_per_target": steps / reached if reached else math.nan,
        }
