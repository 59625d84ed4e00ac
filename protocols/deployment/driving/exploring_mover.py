"""A mover that also explores: while a robot is ordered to, the exploration protocol sets the heading, and DWA drives.

DWA uses the scan alone then: the cells of a map that is being made are too coarse to keep a close distance from. On a
floor that was learned it does the same later: ways are planned by the map, and obstacles are what the scanner sees.
Ways then lead round what has held the robot and is on no map, until its next order.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

import cosim.elementary as elementary
from cosim.machine import Address, Drive
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.deployment.driving.exploring import Exploring
from protocols.deployment.driving.learned import LearnedFloor
from protocols.deployment.driving.mover import Mover, State
from protocols.deployment.tasks.orders import Result
from protocols.deployment.tasks.plan import Place
from protocols.motion.driver import Driver
from protocols.motion.floor import Aim, Blocker, Floor
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Other, Track

AHEAD_M: Final = 1.0
"""Distance of the aim, in the direction in which a robot is led."""
BEYOND_M: Final = 3.0
"""Length of the way, in that direction, that a yield request names."""
PROGRESS_M: Final = 0.1
"""Movement that counts as progress."""
HELD_S: Final = 3.0
"""Time without progress after which a robot counts as held, s: it has not only turned round."""
BACK_S: Final = 4.0
"""Time for which it then goes back from the nearest robot, s."""
BESIDE_M: Final = 0.03
"""Extra margin to what is scanned: the end of a wall may be between two beams."""


class ExploringMover(Mover):
    """Drives as any mover does, or explores; any other order ends exploring."""

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
        """Drive as a mover with these arguments does, or as *exploring* leads."""
        self._exploring, self._tick = exploring, tick
        self._wish_rad: float | None = None
        """Heading in which it is led; None to stand."""
        self._at_m: Place = (math.inf, math.inf)
        """Where it made progress last."""
        self._held_for: Time = 0
        """Time since then in which it would have gone on, but has not."""
        self._back_until: Time = 0
        """End of the time in which it goes back from the nearest robot."""
        super().__init__(floor, me, radius_m, speed_mps, acceleration_mps2, parameters, tick)
        wary = parameters.model_copy(update={"margin_m": parameters.margin_m + BESIDE_M})
        bare = Floor(np.zeros((0, 4)), floor.bounds_m, None, wary)
        slow_mps = min(speed_mps, exploring.speed_mps)
        self._led = Driver(bare, radius_m, slow_mps, acceleration_mps2, wary, tick)
        self._learned = floor if isinstance(floor, LearnedFloor) else None
        self._noted: dict[tuple[int, int], Blocker] = {}
        """What has held it and is off the learned walls, as points, one a cell, until the next order."""
        if self._learned is not None:
            self._driver = Driver(bare, radius_m, speed_mps, acceleration_mps2, wary, tick)

    def explore(self, now: Time) -> None:
        """Explore until nothing is left to see."""
        self.halt()
        if not self._exploring.why_not:
            self._exploring.begin(now)
            self.state = "driving"

    @property
    def explored(self) -> tuple[Result, str] | None:
        """Result of exploring, and why it ended; None while it goes on."""
        if self._exploring.why_not:
            return Result.FAILED, self._exploring.why_not
        return None if self._exploring.over is None else (Result.DONE, self._exploring.over)

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        """Return what to do from the next tick on; None if that is what it does already."""
        if not self._exploring.on:
            self._exploring.listen(observation, now)
            drive = super().step(observation, others, now)
            if self._learned is not None and self._held:
                self._note_unmapped(self._learned)
            return drive
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
        """Place where it would go if no robot stood in its way; as it explores, ahead in the heading that it is led."""
        if not self._exploring.on:
            return super().wants_m
        return None if self._wish_rad is None else self._ahead(self._wish_rad, BEYOND_M)

    def _ahead(self, heading_rad: float, far_m: float) -> Place:
        x, y = self._led.here
        return x + far_m * elementary.cos(heading_rad), y + far_m * elementary.sin(heading_rad)

    def _close(self) -> list[Track]:
        """Return the robots so near that they may be in the way, the nearest first."""
        here, reach_m = self._led.here, self._radius_m + 4.0 * self._own.clear_m
        tracks = self._traffic.tracks(here)
        return [track for track in tracks if math.dist(here, track.place_m) <= reach_m + track.radius_m]

    def _look_who_is_in_the_way(self, wish_rad: float | None) -> None:
        """Note which idle robot stands so near that this one is held."""
        here, self._wish_rad, self.blocked_by = self._led.here, wish_rad, None
        if math.dist(here, self._at_m) > PROGRESS_M:
            self._at_m, self._held_for = here, 0
        elif wish_rad is not None:
            self._held_for += self._tick
        if self._held_for >= from_seconds(HELD_S):
            idle = (track.address for track in self._close() if track.idle)
            self.blocked_by = next(idle, None)

    def _note_unmapped(self, floor: LearnedFloor) -> None:
        """Note what is scanned near by and is off the learned walls, for ways to lead round it.

        Counted evidence may lose the end of a wall that has been looked along from both sides.
        """
        cell_m = self._own.cell_m
        for x, y in floor.off_walls(self._driver.points).tolist():
            self._noted.setdefault((math.floor(x / cell_m), math.floor(y / cell_m)), Blocker(x, y, 0.0))

    def _unmapped(self) -> Sequence[Blocker]:
        return tuple(self._noted.values())

    def _heading(self, wish_rad: float, now: Time) -> float:
        """Return the heading in which it is led, or away from the nearest robot for a while if it is held for too long.

        A robot that was asked to yield may be shut in by those that wait for it.
        """
        if self._held_for >= from_seconds(self._own.patience_s):
            self._held_for, self._back_until = 0, now + from_seconds(BACK_S)
        close = self._close() if now < self._back_until else []
        if not close:
            return wish_rad
        (x, y), (other_x, other_y) = self._led.here, close[0].place_m
        return elementary.atan2(y - other_y, x - other_x)

    def _begin(self, state: State) -> None:
        self._exploring.halt()
        self._wish_rad, self._at_m, self._held_for, self._back_until = None, (math.inf, math.inf), 0, 0
        self._noted.clear()
        super()._begin(state)
