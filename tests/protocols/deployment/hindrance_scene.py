"""Movers beside their twins: what each order is short of, tick by tick, as a member would report it."""

import math
from collections.abc import Sequence
from typing import Any

from cosim.machine import Drive
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.driving.mover import Mover
from protocols.deployment.referee import Shortfall
from protocols.deployment.tasks.plan import Place
from protocols.motion.traffic import Other
from tests.protocols.deployment.driving_scene import TICK, Scene


class Watched(Mover):
    """A mover that notes after each tick what it was short of."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.compare()
        self.shortfall = Shortfall(TICK)
        self.orders: list[tuple[float, float]] = []
        """The speed that its order leads to, and that of the twin, at each tick under way."""

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        drive = super().step(observation, others, now)
        assert self.twin is not None
        if self.twin.speeds_mps is not None:
            assert self.under_way
            self.orders.append(self.twin.speeds_mps)
            self.shortfall.note(*self.twin.speeds_mps)
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
