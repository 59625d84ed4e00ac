"""Evasion: what a robot does while another one is in its way, or something holds it.

VFH+ leads it, by its scan, until the way is clear again. Where that brings it nowhere it tries in turn to go round the
body ahead, on the right or on the left, which takes exact room instead of thresholds; to go back a little or to wait
until the other one has passed (of two it is the one farther to the west, or south, that goes back: never both, never
neither); and another way around all bodies near. It waits for longer each time.
"""

import math
from typing import Final

from cosim.geometry.planning import Point
from cosim.geometry.polylines import length_m
from cosim.machine import Command, Drive, GoTo
from cosim.navigation.vfh import Vfh, VfhParameters
from cosim.observation import Observation
from protocols.aggregation.ground import Ground
from protocols.aggregation.walking_aside import in_the_way, retreat, way_round
from protocols.aggregation.walking_parameters import WalkingParameters

_STEADY_RAD: Final = math.radians(30.0)
"""A direction that differs from the last order's by less is not worth a new one: some bodies stop in order to turn."""
_HELD_TICKS: Final = 5
"""So long at least a robot that is not held keeps to an order of VFH+, and until it has turned to it."""
_MOVED_M: Final = 0.1
_STANDING_TICKS: Final = 8
"""Who has not moved for so long, or for as long as it would take this robot to move twice as far, stands."""
_TRY_TICKS: Final = 50
"""So long it takes until the same body is gone round again."""
_MOST_TURN_TICKS: Final = 40
_ALIGNED_RAD: Final = 0.1
_AHEAD_M: Final = 1.5
"""A direction is turned into a place so far ahead."""
_SIDE_M: Final = 0.2
"""What is farther beside the way than a touch, the safety distance and this, is not in it."""
_THERE_M: Final = 0.05
"""A place of a script is reached within this."""
MOST_DOUBLINGS: Final = 4
STAND: Final = Drive(0.0, 0.0)


class Evasion:
    """One robot's ways past others."""

    def __init__(self, ground: Ground, radius_m: float, step_m: float, parameters: WalkingParameters) -> None:
        own = parameters
        self._ground = ground
        self._own = own
        self.goal_m: Point = (0.0, 0.0)
        """Where the way ends: a robot that stands there is not to be passed."""
        self._contact_m = 2.0 * radius_m
        self._room_m = self._contact_m + own.safety_m + _SIDE_M
        self._step_m = step_m
        window_m = max(own.window_m, radius_m + own.safety_m + 0.1)
        self._vfh = Vfh(
            VfhParameters(robot_radius_m=radius_m, safety_m=own.safety_m, window_m=window_m, arrival_m=1e-3)
        )
        self._standing_ticks = max(_STANDING_TICKS, math.ceil(2.0 * _MOVED_M / step_m))
        self._until = -1
        self._ordered: GoTo | None = None
        self._ordered_at = 0
        self._seen: dict[int, tuple[Point, int]] = {}
        self._tried_at = -_TRY_TICKS
        self._script: list[Point] = []
        self._held_ticks = 0
        self._waits = False
        self._script_until = 0

    def restart(self) -> None:
        """Head for another place."""
        self._until = -1
        self._script = []
        self._vfh.restart()

    def is_needed(self, observation: Observation, here: Point, place: Point, ticks: int) -> bool:
        """Return whether the robot is to evade on the way to *place*, as something is in the way, or just was."""
        if observation.blocked or self.is_ahead(observation, here, place):
            self._until = ticks + self._own.clear_ticks
        return ticks < self._until

    @property
    def ends(self) -> bool:
        """The way has just become clear; to be asked once."""
        ended, self._until = self._until >= 0, -1
        return ended

    def is_ahead(self, observation: Observation, here: Point, place: Point) -> bool:
        """Return whether another robot is near and in the way to *place*; who stands at the goal is not."""
        return any(
            math.dist(here, (x, y)) < self._own.near_m
            and in_the_way(here, place, (x, y), self._room_m)
            and math.dist(self.goal_m, (x, y)) >= self._contact_m
            for _, x, y in observation.sightings
        )

    def standing(self, observation: Observation, here: Point, place: Point, ticks: int) -> Point | None:
        """Return the place of the nearest robot in the way that has not moved for a while, if there is one.

        To be asked at every tick of an evasion. The same is not reported again and again.
        """
        found = None
        for number, x, y in observation.sightings:
            distance = math.dist(here, (x, y))
            if distance >= self._own.near_m or math.dist(self.goal_m, (x, y)) < self._contact_m:
                continue
            before, since = self._seen.get(number, ((math.inf, 0.0), 0))
            if math.dist(before, (x, y)) > _MOVED_M:
                self._seen[number] = (x, y), ticks
                continue
            nearer = found is None or distance < math.dist(here, found)
            if nearer and ticks - since >= self._standing_ticks and in_the_way(here, place, (x, y), self._room_m):
                found = x, y
        if found is None or ticks - self._tried_at < _TRY_TICKS:
            return None
        self._tried_at = ticks
        return found

    def steer(self, observation: Observation, here: Point, place: Point, order: Command | None, ticks: int) -> Command:
        """Return where VFH+ leads on the way to *place*; *order* is where the robot goes now."""
        if isinstance(order, GoTo) and order is self._ordered and self._is_kept(observation, here, order, ticks):
            return order
        chosen = self._chosen(observation, here, place, order)
        if chosen != order and isinstance(chosen, GoTo):
            self._ordered, self._ordered_at = chosen, ticks
        return chosen

    def _is_kept(self, observation: Observation, here: Point, order: GoTo, ticks: int) -> bool:
        """Return whether an *order* has only just been given: bodies brake and turn for a while before they follow.

        VFH+ would take a robot that turns on the spot for one that is held.
        """
        since = ticks - self._ordered_at
        if observation.blocked or math.dist(here, order) < _THERE_M:
            return False
        bearing = math.atan2(order.y_m - here[1], order.x_m - here[0])
        off = abs(math.remainder(bearing - observation.heading_rad, 2.0 * math.pi))
        return since < (_MOST_TURN_TICKS if off > _ALIGNED_RAD else _HELD_TICKS)

    def _chosen(self, observation: Observation, here: Point, place: Point, order: Command | None) -> Command:
        steer = self._vfh.steer(here[0], here[1], place, observation.ranges_m, (), self._step_m)
        if steer.dx == 0.0 and steer.dy == 0.0:
            return STAND
        if math.dist(here, place) < _AHEAD_M and _gap(here, place, steer.dx, steer.dy) < _STEADY_RAD:
            return GoTo(*place)
        steady = isinstance(order, GoTo) and not observation.blocked and math.dist(here, order) > 0.4 * _AHEAD_M
        if isinstance(order, GoTo) and steady and _gap(here, order, steer.dx, steer.dy) < _STEADY_RAD:
            return order
        return GoTo(here[0] + _AHEAD_M * steer.dx, here[1] + _AHEAD_M * steer.dy)

    # ---------------------------------------------------------------- when VFH+ does not get on

    def bodies(self, observation: Observation, here: Point) -> list[Point]:
        """Return the places of the bodies near, the nearest first."""
        places = [(x, y) for _, x, y in observation.sightings]
        near = self._own.near_m
        return sorted((place for place in places if math.dist(here, place) < near), key=lambda it: math.dist(here, it))

    def go_round(self, here: Point, place: Point, body: Point, number: int, ticks: int, pause: int) -> bool:
        """Begin to go round a *body* on the way to *place*, if there is room; *pause* ticks are for each turn."""
        script = way_round(self._ground, here, place, body, number % 2 == 0)
        if script is not None:
            self._begin(here, script, ticks, pause * (1 + len(script)), waits=False)
        return script is not None

    def make_way(self, here: Point, body: Point, ticks: int, pause: int) -> None:
        """Go out of the way of a *body*, or stay where the other one is to; for *pause* ticks."""
        back = retreat(self._ground, here, body) if here < body else None
        self._begin(here, [back or here], ticks, pause, waits=True)

    def _begin(self, here: Point, script: list[Point], ticks: int, more: int, waits: bool) -> None:
        self._vfh.restart()
        self._script = script
        self._waits = waits
        self._held_ticks = 0
        self._script_until = ticks + round(1.5 * length_m([here, *script]) / self._step_m) + more

    @property
    def scripted(self) -> bool:
        """An attempt is under way."""
        return bool(self._script)

    def follow(self, observation: Observation, here: Point, ticks: int) -> GoTo | None:
        """Return the next place of the attempt under way, None if it is over, or something is in its way."""
        self._held_ticks = self._held_ticks + 1 if observation.blocked else 0
        if math.dist(here, self._script[0]) <= _THERE_M and (len(self._script) > 1 or not self._waits):
            del self._script[0]
        if self._script and ticks < self._script_until and self._held_ticks < _HELD_TICKS:
            return GoTo(*self._script[0])
        self._script = []
        return None


def _gap(here: Point, place: Point, dx: float, dy: float) -> float:
    """Return the angle between the directions to a place and along (dx, dy)."""
    to_x, to_y = place[0] - here[0], place[1] - here[1]
    return abs(math.atan2(to_x * dy - to_y * dx, to_x * dx + to_y * dy))
