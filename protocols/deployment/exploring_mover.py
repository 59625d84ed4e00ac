"""A mover that explores, too: while a robot is ordered to, the exploration protocol drives it."""

from collections.abc import Sequence
from typing import Any

from cosim.machine import Drive
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.exploring import Exploring
from protocols.deployment.member_pace import PacedMover
from protocols.deployment.mover import State
from protocols.deployment.orders import Result
from protocols.deployment.traffic import Other


class ExploringMover(PacedMover):
    """Drives as any mover does, or explores; whatever else it is told ends that."""

    def __init__(self, exploring: Exploring, *arguments: Any) -> None:
        """Take what explores, and what a mover takes."""
        self._exploring = exploring
        super().__init__(*arguments)

    def explore(self, now: Time) -> None:
        """Explore until nothing is left to see."""
        self.halt()
        if not self._exploring.why_not:
            self._exploring.begin(now)
            self.state = "driving"

    @property
    def explored(self) -> tuple[Result, str] | None:
        """How exploring has ended, and why; None while it goes on."""
        if self._exploring.why_not:
            return Result.FAILED, self._exploring.why_not
        return None if self._exploring.over is None else (Result.DONE, self._exploring.over)

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        """Return what to do from the next tick on; None if that is what it does already."""
        if not self._exploring.on:
            self._exploring.listen(observation, now)
            return super().step(observation, others, now)
        drive = self._exploring.step(observation, now)
        if not self._exploring.on:
            self.state = "idle"
        return drive

    def _begin(self, state: State) -> None:
        self._exploring.halt()
        super()._begin(state)
