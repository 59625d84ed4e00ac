"""Movers beside their doubles: what each order is short of, tick by tick, as a member would note it on the board."""

import math
from collections.abc import Sequence
from typing import Any

from cosim.machine import Drive
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.driving.pace import PacedMover
from protocols.deployment.interference import Shortfall
from protocols.deployment.tasks.plan import Place
from protocols.motion.traffic import Other
from tests.protocols.deployment.driving_scene import TICK, Scene


class Watched(PacedMover):
    """A mover that notes after each tick what it was short of."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.shortfall = Shortfall(TICK)
        self.orders: list[tuple[float, float]] = []
        """The speed that its order leads to, and that of the double, at each tick under way."""

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        drive = super().step(observation, others, now)
        if self.pace_mps is not None:
            self.orders.append(self.pace_mps)
            self.shortfall.note(*self.pace_mps)
        return drive


class Hindered(Scene):
    """A scene of watched movers."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.movers: list[Watched] = [  # type: ignore[assignment]
            Watched(self.floor, me, each.radius_m, each.speed_mps, each.acceleration_mps2, self.parameters, TICK)
            for me, each in enumerate(self.bodies)
        ]

    def time_to(self, robot: int, goal_m: Place, limit_s: float = 300.0, via_m: Sequence[Place] = ()) -> float:
        """Send *robot* to a place, let time pass until it is there, and return how long it took, seconds."""
        began = self.now
        self.movers[robot].go(goal_m, via_m)
        self.run(limit_s, lambda: self.movers[robot].state == "arrived")
        assert math.dist(self.fleet.positions_m[robot], goal_m) < 0.2
        return (self.now - began) / 1e9
