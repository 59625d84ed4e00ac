"""Pedestrians: members of a team without a map or a planner, people for example, who go by what they see and feel.

VisBug-21 (:mod:`cosim.navigation.visbug`) leads them: straight towards the farthest place in sight that they can tell
to lie on the way that Bug2 would take. What they do about other bodies is what walkers do.
"""

import math
from typing import Final

from cosim.arrays import Floats
from cosim.geometry.boundary import Boundary, unpacked_boundary
from cosim.geometry.planning import Point
from cosim.machine import Command
from cosim.navigation.status import Status
from cosim.navigation.visbug import target_of, visbug_step
from cosim.observation import Observation
from cosim.units import Time
from protocols.aggregation.ground import Ground
from protocols.aggregation.walking import Walker
from protocols.aggregation.walking_parameters import WalkingParameters

_ASK_TICKS: Final = 5
"""So often a pedestrian looks where to go."""
_STRAIGHT_RAD: Final = 0.02
_REACHED_M: Final = 0.05
_STEP_M: Final = 0.01
_NEAR_M: Final = 0.01


class Pedestrian(Walker):
    """One member's ways over ground that it does not know."""

    def __init__(
        self, ground: Ground, radius_m: float, speed_mps: float, tick: Time, parameters: WalkingParameters
    ) -> None:
        super().__init__(ground, radius_m, speed_mps, tick, parameters)
        self._loops: Boundary = unpacked_boundary.py_func(*ground.loops)  # type: ignore[attr-defined]
        self._memory: Floats | None = None
        self._ask_at = 0
        self._underway = False
        self._at_last = False
        """The goal itself is what the pedestrian heads for."""

    def remaining_m(self, here: Point) -> float:
        """Return how far the goal is in metres, in a straight line: nothing else is known."""
        return 0.0 if self.goal_m is None else math.dist(here, self.goal_m)

    def route(self, here: Point, goal_m: Point) -> list[Point] | None:
        """Return the place to head for next, or None if it is proved that no way leads to the goal."""
        place_m = self._ground.stands(goal_m)
        if place_m is None:
            return None
        move = visbug_step(
            self._loops, here, place_m, self._memory, vision_m=self._own.sight_m, step_m=_STEP_M, near_m=_NEAR_M
        )
        if move.status == Status.UNREACHABLE:
            self._memory = None
            return None
        place = target_of(self._loops, move.memory)
        if move.status == Status.ARRIVED:
            place = place_m
        if self._keeps_on(here, place):
            return None if self._track is None else self._track.points_m
        self._memory = move.memory
        self._at_last = math.dist(place, place_m) <= _NEAR_M
        return [place_m if self._at_last else place]

    def _keeps_on(self, here: Point, place: Point) -> bool:
        """Return whether the next place lies elsewhere than the present one, which the pedestrian has not reached yet.

        A body that turns away under way slides on, and may lose sight of where it was to go.
        """
        if not self._underway or self._track is None or math.dist(here, self._track.place) <= _REACHED_M:
            return False
        (x, y), (to_x, to_y), (new_x, new_y) = here, self._track.place, place
        ax, ay, bx, by = to_x - x, to_y - y, new_x - x, new_y - y
        return abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by)) > _STRAIGHT_RAD

    def detour(self, here: Point, goal_m: Point, bodies_m: list[Point]) -> list[Point] | None:
        """Return None: who has no map plans no way around anything."""
        return None

    def _is_at_goal(self, place: Point, observation: Observation, here: Point) -> bool:
        return self._at_last and super()._is_at_goal(place, observation, here)

    def _decide(self, observation: Observation) -> Command | None:
        here = observation.x_m, observation.y_m
        if self._track is not None and not self.arrived and not self._evasion.scripted and self._ticks >= self._ask_at:
            self._ask_at = self._ticks + _ASK_TICKS
            self._underway = True
            self._plan(here)
            self._underway = False
        return super()._decide(observation)
