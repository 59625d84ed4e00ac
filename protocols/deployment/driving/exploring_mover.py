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
from cosim.units import Time, from_seconds
from protocols.deployment.driving.exploring import Exploring
from protocols.deployment.driving.learned import LearnedFloor
from protocols.deployment.driving.mover import Mover, State
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Place
from protocols.motion.driver import Wheel
from protocols.motion.floor import Aim, Floor
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Other, Track

AHEAD_M: Final = 1.0
"""So far ahead, in the direction in which it is led, a robot aims."""


BEYOND_M: Final = 3.0
"""So far in that direction leads the way of which it tells who is to step aside."""
PROGRESS_M: Final = 0.1
"""Who has moved by so much gets on."""
HELD_S: Final = 3.0
"""s; who has not got on for so long has not only turned round."""
BACK_S: Final = 4.0
"""s; for so long it goes back from who is nearest."""
BESIDE_M: Final = 0.03
"""The margin to what is scanned is wider by so much: the end of a wall may be between two beams."""


class ExploringMover(Mover):
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
        self._exploring, self._tick = exploring, tick
        self._wish_rad: float | None = None
        """Which way it is led; None to stand."""
        self._at_m: Place = (math.inf, math.inf)
        """Where it has got on last."""
        self._held_for: Time = 0
        """How long it would have gone on since, but has not."""
        self._back_until: Time = 0
        """When it ends, or has ended, to go back from who is nearest."""
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
        self._look_who_is_in_the_way(wish_rad)
        if wish_rad is None:
            return self._led.order(0.0, 0.0)
        ahead = self._ahead(self._heading(wish_rad, now), AHEAD_M)
        return self._led.order(*self._led.to(Aim(ahead, AHEAD_M, False), observation, self._traffic))

    @property
    def wants_m(self) -> Place | None:
        """Where it would go now, if nobody stood in its way: as it explores, the way in which it is led."""
        if not self._exploring.on:
            return super().wants_m
        return None if self._wish_rad is None else self._ahead(self._wish_rad, BEYOND_M)

    def _ahead(self, heading_rad: float, far_m: float) -> Place:
        x, y = self._led.here
        return x + far_m * math.cos(heading_rad), y + far_m * math.sin(heading_rad)

    def _close(self) -> list[Track]:
        """Return those so near that they may be in the way, the nearest first."""
        here, reach_m = self._led.here, self._radius_m + 4.0 * self._own.clear_m
        tracks = self._traffic.tracks(here)
        return [track for track in tracks if math.dist(here, track.place_m) <= reach_m + track.radius_m]

    def _look_who_is_in_the_way(self, wish_rad: float | None) -> None:
        """Note who has nothing to do and stands so near that it does not get on, though it would."""
        here, self._wish_rad, self.blocked_by = self._led.here, wish_rad, None
        if math.dist(here, self._at_m) > PROGRESS_M:
            self._at_m, self._held_for = here, 0
        elif wish_rad is not None:
            self._held_for += self._tick
        if self._held_for >= from_seconds(HELD_S):
            idle = (track.address for track in self._close() if track.idle)
            self.blocked_by = next(idle, None)

    def _heading(self, wish_rad: float, now: Time) -> float:
        """Return the way in which it is led; if it is held for too long, for a while away from who is nearest.

        Who was asked to step aside may be shut in by those who wait for that.
        """
        if self._held_for >= from_seconds(self._own.patience_s):
            self._held_for, self._back_until = 0, now + from_seconds(BACK_S)
        close = self._close() if now < self._back_until else []
        if not close:
            return wish_rad
        (x, y), (other_x, other_y) = self._led.here, close[0].place_m
        return math.atan2(y - other_y, x - other_x)

    def _begin(self, state: State) -> None:
        self._exploring.halt()
        self._wish_rad, self._at_m, self._held_for, self._back_until = None, (math.inf, math.inf), 0, 0
        super()._begin(state)
