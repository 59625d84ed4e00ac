"""Walking: along planned ways from point to point, and past whoever stands or walks there.

A robot on its way is given one order for each straight piece; its body brakes and turns itself. Nothing else happens
until it is near the end of the piece, or another robot is ahead of it and near, or it is held: then see ``Evasion``. It
never gives up; where no way leads to its goal it stands, and looks for one again and again, after longer and longer.
"""

import math
from typing import Final

from cosim.geometry.planning import Point
from cosim.machine import Command, GoTo
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.aggregation.ground import Ground
from protocols.aggregation.walking_evasion import MOST_DOUBLINGS, STAND, Evasion
from protocols.aggregation.walking_parameters import WalkingParameters
from protocols.aggregation.walking_track import Track

_LOOK_TICKS: Final = 10
"""So many ticks at most an undisturbed robot does not ask itself where it is."""
_NEARER: Final = 0.1
"""Who has come nearer than ever by this share of what it can go while it is patient makes progress."""
_MOST_NEARER_M: Final = 0.2
_FREED_M: Final = 1.0
"""Who has come so much nearer after an attempt is stuck no longer."""
_SAME_M: Final = 2.0
"""A goal as near as this to the one before does not change what holds the robot."""
_AT_WAY_POINT_M: Final = 0.05
_KINDS: Final = 4
"""So many things are tried in turn."""
_TURN_S: Final = 2.0
"""So long a body may take to stop and turn."""


class Walker:
    """One robot's ways over a known ground."""

    def __init__(
        self, ground: Ground, radius_m: float, speed_mps: float, tick: Time, parameters: WalkingParameters
    ) -> None:
        own, seconds = parameters, to_seconds(tick)
        self._ground = ground
        self._own = own
        self._contact_m = 2.0 * radius_m
        self._step_m = speed_mps * seconds
        self._near_square = own.near_m * own.near_m
        # slow robots take longer for everything
        self._patience = math.ceil(max(own.patience_s, self._contact_m / speed_mps) / seconds)
        self._pause = math.ceil(max(own.pause_s, 2.0 * self._contact_m / speed_mps) / seconds)
        self._turn = math.ceil(_TURN_S / seconds)
        self._nearer_m = min(_NEARER * self._patience * self._step_m, _MOST_NEARER_M)
        self._evasion = Evasion(ground, radius_m, self._step_m, own)
        self.goal_m: Point | None = None
        self.arrived = True
        """The robot is within ``arrival_m`` of its goal, or as near to it as one can stand or as others let it."""
        self.plans = 0
        """How many ways have been planned."""
        self._ticks = 0
        self._order: Command | None = None
        self._is_news = True
        """The next order is to be given even if it is the last one: the body may have had others in between."""
        self._halt = False
        self._track: Track | None = None
        self._look_at = 0
        self._least_m = math.inf
        self._stuck_m = math.inf
        self._progress_at = 0
        self._attempts = 0
        self._plan_at: int | None = 0

    # ---------------------------------------------------------------- what others ask

    def head_for(self, goal_m: Point | None) -> None:
        """Take a goal, and plan the way there at the next step; None: stand still. The same goal again is no news."""
        if goal_m == self.goal_m:
            return
        if self.arrived or goal_m is None or self.goal_m is None or math.dist(goal_m, self.goal_m) > _SAME_M:
            self._attempts = 0
            self._progress_at = self._ticks
            self._evasion.restart()
        self.goal_m = goal_m
        self.arrived = goal_m is None
        self._track = None
        self._look_at = 0
        self._plan_at = self._ticks
        self._is_news = True

    @property
    def stuck(self) -> bool:
        """There is no way, or the robot has come nowhere for longer than its patience; it goes on trying."""
        return not self.arrived and self._attempts > 0

    def remaining_m(self, here: Point) -> float:
        """Return how long the way to the goal is in metres, from *here*; 0 without a goal, inf without a way."""
        if self.goal_m is None:
            return 0.0
        if self._track is not None:
            return self._track.left_m(here)
        length = self._ground.length_m(here, self.goal_m)
        return math.inf if length is None else length

    # ---------------------------------------------------------------- a tick

    def step(self, observation: Observation) -> Command | None:
        """Return an order to the body, or None where the last one goes on; to be called once a tick."""
        self._ticks += 1
        if self._ticks < self._look_at and not observation.blocked:
            if not observation.sightings:
                return None
            x, y = observation.x_m, observation.y_m
            near = self._near_square
            for _, other_x, other_y in observation.sightings:
                dx, dy = other_x - x, other_y - y
                if dx * dx + dy * dy < near:
                    break
            else:
                return None
        order = self._decide(observation)
        if order == self._order and not self._is_news:
            return None
        self._order, self._is_news = order, False
        return order

    def _decide(self, observation: Observation) -> Command | None:
        here = observation.x_m, observation.y_m
        if self.goal_m is None:
            return self._stand()
        if self._plan_at is not None and self._ticks >= self._plan_at:
            self._plan(here)
        if self._evasion.scripted and self._track is not None:
            self._look_at = 0
            order = self._evasion.follow(observation, here, self._ticks)
            if order is not None:
                return order
            self._progress_at = self._ticks
            self._resume(here)
        if self._track is None:
            return self._stand()
        self._advance(self._track, observation, here)
        if self.arrived:
            return self._rest_here(self._track, observation, here)
        if self._evasion.is_needed(observation, here, self._track.place, self._ticks):
            self._look_at = 0
            return self._evade(self._track, observation, here)
        if self._evasion.ends:
            self._resume(here)
        if self._ticks - self._progress_at > self._patience:
            self._attempt(observation, here)
        return self._cruise(here)

    def _stand(self) -> Command:
        """Return the order to stop."""
        self._look_at = self._ticks + _LOOK_TICKS
        if self._plan_at is not None:
            self._look_at = min(self._look_at, self._plan_at)
        return STAND

    def _rest_here(self, track: Track, observation: Observation, here: Point) -> Command:
        """Return the order for who has arrived: to the goal exactly, if nothing is there; look if it is carried off."""
        self._look_at = self._ticks + _LOOK_TICKS
        if math.dist(here, track.end) > self._own.arrival_m + self._contact_m + self._own.off_way_m:
            self.arrived = False
            self._plan(here)
            return self._cruise(here)
        held = observation.blocked or self._evasion.is_ahead(observation, here, track.end)
        return self._stand() if held else GoTo(*track.end)

    def _evade(self, track: Track, observation: Observation, here: Point) -> Command:
        """Return the order for who has something in the way."""
        while track.following is not None and self._ground.open(here, track.following):
            self._go_on(track, here)
        body = self._evasion.standing(observation, here, track.place, self._ticks)
        if body is not None or self._ticks - self._progress_at > self._patience:
            self._halt = True
        if self._halt:
            if observation.speed_mps > 0.0:
                return STAND
            self._halt = False
            self._attempt(observation, here)
            if self._evasion.scripted:
                return self._evasion.follow(observation, here, self._ticks) or STAND
        if self._track is None:
            return self._stand()
        return self._evasion.steer(observation, here, self._track.place, self._order, self._ticks)

    # ---------------------------------------------------------------- ways

    def route(self, here: Point, goal_m: Point) -> list[Point] | None:
        """Return the way points that lead from *here* to a goal, or None; for those who find their ways otherwise."""
        return self._ground.way(here, goal_m)

    def detour(self, here: Point, goal_m: Point, bodies_m: list[Point]) -> list[Point] | None:
        """Return a way around some bodies, or None."""
        return self._ground.way_around(here, goal_m, bodies_m, self._contact_m + _AT_WAY_POINT_M)

    def _plan(self, here: Point) -> None:
        assert self.goal_m is not None
        self.plans += 1
        self._take(here, self.route(here, self.goal_m))

    def _take(self, here: Point, way: list[Point] | None) -> None:
        """Begin to follow a *way*; without one, stand for longer and longer."""
        if not way:
            self._track = None
            self._plan_at = self._ticks + (self._pause << min(self._attempts, MOST_DOUBLINGS))
            self._attempts += 1
            return
        self._plan_at = None
        self._track = Track(here, way)
        self._least_m = self._track.left_m(here)
        self._evasion.goal_m = self._track.end

    def _resume(self, here: Point) -> None:
        """Go back to the way, or to a new one if it is out of sight."""
        if self._track is None or not self._ground.open(here, self._track.place):
            self._plan(here)
        else:
            self._track.restart(here)

    def _advance(self, track: Track, observation: Observation, here: Point) -> None:
        """Note progress, way points that have been passed, and whether the robot is at its goal."""
        distance = math.dist(here, track.place)
        while track.following is not None and distance <= self._own.pass_m:
            if distance > _AT_WAY_POINT_M and not self._ground.open(here, track.following):
                break
            self._go_on(track, here)
            distance = math.dist(here, track.place)
        left = track.left_m(here)
        if left < self._least_m - self._nearer_m:
            self._least_m = left
            self._progress_at = self._ticks
            if self._attempts and self.remaining_m(here) < self._stuck_m - _FREED_M:
                self._attempts = 0
        if not self.arrived and track.following is None and self._is_at_goal(track.end, observation, here):
            self.arrived = True
            self._attempts = 0
            self._evasion.restart()

    def _go_on(self, track: Track, here: Point) -> None:
        track.go_on(here)
        self._least_m = min(self._least_m, track.left_m(here))

    def _is_at_goal(self, place: Point, observation: Observation, here: Point) -> bool:
        """Return whether the robot is at its goal, or before a robot that stands there."""
        if math.dist(here, place) <= self._own.arrival_m:
            return True
        return is_taken(place, here, observation, self._contact_m, self._own.arrival_m)

    def _cruise(self, here: Point) -> Command:
        """Return the order for the straight piece, and think when the next look is due."""
        if self._track is not None and self._track.off_m(here) > self._own.off_way_m:
            self._plan(here)
        if self._track is None:
            return self._stand()
        left = math.dist(here, self._track.place) - self._own.pass_m
        self._look_at = self._ticks + max(1, min(_LOOK_TICKS, int(left / self._step_m)))
        return GoTo(*self._track.place)

    def _attempt(self, observation: Observation, here: Point) -> None:
        """Try something else: to go round the nearest body, to make way for it, another way around all bodies near."""
        assert self.goal_m is not None
        assert self._track is not None
        number, self._attempts = self._attempts, self._attempts + 1
        self._progress_at = self._ticks
        self._stuck_m = self.remaining_m(here)
        self._is_news = True  # whatever has become of the last order
        bodies = self._evasion.bodies(observation, here)
        kind = number % _KINDS
        if bodies and kind < _KINDS - 1:
            if kind != 2 and self._evasion.go_round(
                here, self._track.place, bodies[0], number, self._ticks, self._turn
            ):
                return
            if kind != 0:
                pause = self._pause << min(number // _KINDS, MOST_DOUBLINGS)
                self._evasion.make_way(here, bodies[0], self._ticks, pause)
            return
        self.plans += 1
        self._take(here, self.detour(here, self.goal_m, bodies) or self.route(here, self.goal_m))


def is_taken(place: Point, here: Point, observation: Observation, contact_m: float, slack_m: float) -> bool:
    """Return whether a robot stands at *place*, so that one at *here*, before it, can come no nearer but by a slack."""
    room = contact_m + slack_m
    return math.dist(here, place) <= room + slack_m and any(
        math.dist(place, (x, y)) < contact_m and math.dist(here, (x, y)) < room for _, x, y in observation.sightings
    )
