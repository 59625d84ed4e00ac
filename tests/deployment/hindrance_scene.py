"""Movers beside their doubles: what each order is short of, tick by tick, as a member would note it on the board."""

import math
from collections.abc import Sequence
from typing import Any

from cosim.machine import Drive
from cosim.navigation.dwa import WAY, WAY_CHANGE, towards
from cosim.observation import Observation
from cosim.units import Time
from protocols.deployment.double import Double
from protocols.deployment.interference import Shortfall
from protocols.deployment.mover import Mover
from protocols.deployment.plan import Place
from protocols.deployment.traffic import Other
from tests.deployment.driving_scene import TICK, Scene


class Watched(Mover):
    """A mover that says after each tick what it was short of."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.double = Double(self._floor, self._radius_m, self._limits, self._own, self._seconds)
        self.shortfall = Shortfall(TICK)
        self._set_off = False
        self.orders: list[tuple[float, float]] = []
        """The speed that its order leads to, and that of the double, at each tick under way."""

    def go(self, place_m: Place, via_m: Sequence[Place] = ()) -> None:
        super().go(place_m, via_m)
        self._set_off = True

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        drive = super().step(observation, others, now)
        if self.state in ("driving", "stuck") and self.goal_m is not None:
            target = self._via[0] if self._via else self.goal_m
            way = towards(self._wanted[0], float(self._motion[WAY]), float(self._limits[WAY_CHANGE]))
            speed = 0.0 if self.yielding_to is not None else way / self._seconds
            if self._set_off:
                self.double.begin(self._motion)
                self._set_off = False
            free = self.double.step(self._motion, target)
            self.orders.append((speed, free))
            self.shortfall.note(speed, free)
        return drive


class Hindered(Scene):
    """A scene of watched movers."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.movers: list[Watched] = [  # type: ignore[assignment]
            Watched(self.floor, me, each.radius_m, each.speed_mps, each.acceleration_mps2, self.parameters, TICK)
            for me, each in enumerate(self.bodies)
        ]

    def time_to(self, robot: int, goal_m: Place, limit_s: float = 300.0) -> float:
        """Send *robot* to a place, let time pass until it is there, and return how long it took, seconds."""
        began = self.now
        self.movers[robot].go(goal_m)
        self.run(limit_s, lambda: self.movers[robot].state == "arrived")
        assert math.dist(self.fleet.positions_m[robot], goal_m) < 0.2
        return (self.now - began) / 1e9
