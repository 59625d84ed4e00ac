"""A mover that explores, too: while a robot is ordered to, the exploration protocol says which way, and DWA drives.

DWA goes by the scan alone then: the cells of a map that is being made are no walls to be kept off by a hair. So it does
later on a floor that was learned: ways are planned by the map, and what is there is what the scanner sees.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.machine import Address, Drive
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.driving_parameters import DrivingParameters
from protocols.deployment.exploring import Exploring
from protocols.deployment.floor import Aim, Floor
from protocols.deployment.learned import LearnedFloor
from protocols.deployment.member_pace import PacedMover
from protocols.deployment.mover import State
from protocols.deployment.orders import Result
from protocols.deployment.traffic import Other
from protocols.deployment.wheel import Wheel

AHEAD_M: Final = 1.0
"""So far ahead, in the direction in which it is led, a robot aims."""


BESIDE_M: Final = 0.03
"""The margin to what is scanned is wider by so much: the end of a wall may be between two beams."""


class ExploringMover(PacedMover):
    """Drives as any mover does, or explores; whatever else it is told ends that."""

    def __init__(
        self,
        exploring: Exploring,
        floor: Floor,
        me: Address,
        radius_m: float,
        speed_mps: float,
        acceleration_mps2: float,
        parameters: DrivingParameters,
        tick: Time,
    ) -> None:
        """Take what explores, and what a mover takes."""
        self._exploring = exploring
        super().__init__(floor, me, radius_m, speed_mps, acceleration_mps2, parameters, tick)
        wary = parameters.model_copy(update={"margin_m": parameters.margin_m + BESIDE_M})
        bare = Floor(np.zeros((0, 4)), floor.bounds_m, None, wary)
        slow_mps = min(speed_mps, exploring.speed_mps)
        self._led = Wheel(bare, radius_m, slow_mps, acceleration_mps2, wary, tick)
        if isinstance(floor, LearnedFloor):
            self._wheel = Wheel(bare, radius_m, speed_mps, acceleration_mps2, wary, tick)

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
        wish_rad = self._exploring.step(observation, now)
        if self._exploring.over is not None:
            self.state = "idle"
        self._led.follow(observation, now)
        self._traffic.look(observation, others, now, self._led.carried)
        if wish_rad is None:
            return self._led.order(0.0, 0.0)
        x, y = self._led.here
        ahead = x + AHEAD_M * math.cos(wish_rad), y + AHEAD_M * math.sin(wish_rad)
        return self._led.order(*self._led.to(Aim(ahead, AHEAD_M, False), observation, self._traffic))

    def _begin(self, state: State) -> None:
        self._exploring.halt()
        super()._begin(state)
