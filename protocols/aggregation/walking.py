"""Walking: along planned ways from point to point, and past other robots that stand or walk there.

A robot on its way is given one order for each straight piece; its body brakes and turns itself. Nothing else happens
until it is near the end of the piece, or another robot is ahead of it and near, or it is held: then see ``Evasion``. It
never gives up; where no way leads to its goal it stands and plans again, after longer and longer pauses.

``Pedestrian`` is a walker without a map or a planner.
"""

import math
from itertools import pairwise
from typing import Final

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.geometry.boundary import Boundary, unpacked_boundary
from cosim.geometry.planning import Point
from cosim.geometry.polylines import length_m, off_m
from cosim.machine import Command, Drive, GoTo
from cosim.navigation.status import Status
from cosim.navigation.vfh import Vfh, VfhParameters
from cosim.navigation.visbug import target_of, visbug_step
from cosim.observation import Observation, Picture, Sighting
from cosim.units import Time, to_seconds
from protocols.aggregation.ground import Ground
from protocols.aggregation.parameters import WalkingParameters
from protocols.motion.progress import Progress

STAND: Final = Drive(0.0, 0.0)

# following a way
_LOOK_TICKS: Final = 10
"""Longest interval at which an undisturbed robot compares its place with its way."""
_NEARER: Final = 0.1
"""Progress: share of what the robot can go within its patience by which it must have come nearer than ever before."""
_MOST_NEARER_M: Final = 0.2
"""Upper bound of that distance."""
_FREED_M: Final = 1.0
"""Distance gained since an attempt from which on the robot is stuck no longer."""
_SAME_M: Final = 2.0
"""Distance between two goals up to which the second does not change what holds the robot."""
_AT_WAY_POINT_M: Final = 0.05
_KINDS: Final = 4
"""Number of things that are tried in turn."""
_TURN_S: Final = 2.0
"""Time that a body may take to stop and turn."""
_MOST_DOUBLINGS: Final = 4
"""How often a pause is doubled at most."""

# steering by VFH+
_STEADY_RAD: Final = math.radians(30.0)
"""Difference from the last order's direction below which no new order is given: some bodies stop in order to turn."""
_HELD_TICKS: Final = 5
"""Shortest time for which a robot that is not held keeps to an order of VFH+, once it has turned to it."""
_MOVED_M: Final = 0.1
"""Distance up to which another robot counts as not having moved."""
_STANDING_TICKS: Final = 8
"""Shortest time without motion after which another robot counts as standing; see ``Evasion`` for slow robots."""
_TRY_TICKS: Final = 50
"""Interval between two reports of a standing body."""
_MOST_TURN_TICKS: Final = 40
"""Longest time that a body may take to turn to an order of VFH+."""
_ALIGNED_RAD: Final = 0.1
_AHEAD_M: Final = 1.5
"""Distance of the place into which a direction is turned."""
_SIDE_M: Final = 0.2
"""Room beside the way, in addition to a touch and the safety distance, within which a body is in the way."""
_THERE_M: Final = 0.05
"""Distance within which a place of a script is reached."""
_UNSEEN: Final = (math.inf, math.inf), 0
"""Place and tick of a robot that has not been near yet."""
_KEPT_M: Final = 1.0
"""How much farther off than near robots may be that are kept, see ``Near``."""
_ROAM_M: Final = 0.99 * _KEPT_M
"""How far a robot goes before it looks through all others again: less than that, so that rounding loses nobody."""

# going round a body, or out of its way
_SLACKS_M: Final = (0.3, 0.2, 0.12, 0.06, 0.02)
"""Room beyond a touch that a robot keeps from a body that it goes round; the first that fits is taken."""
_MOST_WALL_M: Final = 0.1
"""Upper bound of the room kept from walls, which otherwise is half of that."""
_SHORTER_M: Final = 0.3
"""Difference in length from which on the shorter side is taken."""
_DIRECTIONS: Final = 16
_AWAY_M: Final = (1.0, 2.0, 3.5)
"""Distances tried for getting out of another robot's way."""
_PAST: Final = 0.3
"""Weight of a metre away from the other robot against a metre away from its line."""

# pedestrians
_ASK_TICKS: Final = 5
"""Interval at which a pedestrian looks where to go."""
_STRAIGHT_RAD: Final = 0.02
_REACHED_M: Final = 0.05
_STEP_M: Final = 0.01
_NEAR_M: Final = 0.01


class Track:
    """Way points that a robot goes straight to, one after the other; there is at least one."""

    def __init__(self, here: Point, points_m: list[Point]) -> None:
        self._points = points_m
        self._legs_m = [math.dist(a, b) for a, b in pairwise(points_m)]
        self._begin = here

    @property
    def place(self) -> Point:
        """Way point that the robot goes straight to."""
        return self._points[0]

    @property
    def following(self) -> Point | None:
        """Way point after that, if there is one."""
        return self._points[1] if len(self._points) > 1 else None

    @property
    def end(self) -> Point:
        """The last way point."""
        return self._points[-1]

    @property
    def points_m(self) -> list[Point]:
        """All way points that are left; not to be changed."""
        return self._points

    def go_on(self, here: Point) -> None:
        """Head for the following way point from *here*."""
        del self._points[0], self._legs_m[0]
        self._begin = here

    def restart(self, here: Point) -> None:
        """Head for the same way point from *here*."""
        self._begin = here

    def left_m(self, here: Point) -> float:
        """Return the length of the way that is left from *here*, metres."""
        return math.fsum((math.dist(here, self._points[0]), *self._legs_m))

    def off_m(self, here: Point) -> float:
        """Return the distance of *here* from the straight piece that the robot follows, metres."""
        return off_m(here, self._begin, self._points[0])


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
        # slow robots take longer for everything
        self._patience = math.ceil(max(own.patience_s, self._contact_m / speed_mps) / seconds)
        self._pause = math.ceil(max(own.pause_s, 2.0 * self._contact_m / speed_mps) / seconds)
        self._turn = math.ceil(_TURN_S / seconds)
        self._progress = Progress(min(_NEARER * self._patience * self._step_m, _MOST_NEARER_M))
        self._evasion = Evasion(ground, radius_m, self._step_m, own)
        self.goal_m: Point | None = None
        self.arrived = True
        """True if the robot is within ``arrival_m`` of its goal, or as near to it as walls and other robots allow."""
        self.plans = 0
        """Number of ways that have been planned."""
        self._ticks = 0
        self._order: Command | None = None
        self._order_again = True
        """True if the next order is to be given even if it equals the last: the body may have had others in between."""
        self._halt = False
        self._track: Track | None = None
        self._look_at = 0
        self._stuck_m = math.inf
        self._attempts = 0
        self._plan_at: int | None = 0

    # ---------------------------------------------------------------- goals

    def head_for(self, goal_m: Point | None) -> None:
        """Set a goal and plan the way at the next step; None: stand still. The same goal again changes nothing."""
        if goal_m == self.goal_m:
            return
        if self.arrived or goal_m is None or self.goal_m is None or math.dist(goal_m, self.goal_m) > _SAME_M:
            self._attempts = 0
            self._progress.since = self._ticks
            self._evasion.restart()
        self.goal_m = goal_m
        self.arrived = goal_m is None
        self._track = None
        self._look_at = 0
        self._plan_at = self._ticks
        self._order_again = True

    @property
    def ahead_m(self) -> list[Point]:
        """The points by which the robot goes from here on; empty if it stands, or has no plan yet."""
        return [] if self.arrived or self._track is None else list(self._track.points_m)

    @property
    def stuck(self) -> bool:
        """True if there is no way, or no progress for longer than the robot's patience; it goes on trying."""
        return not self.arrived and self._attempts > 0

    def remaining_m(self, here: Point) -> float:
        """Return the length of the way to the goal from *here*, metres; 0 without a goal, inf without a way."""
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
        near = self._evasion.look(observation)
        if self._ticks < self._look_at and not observation.blocked and not near:
            return None
        order = self._decide(observation)
        if order == self._order and not self._order_again:
            return None
        self._order, self._order_again = order, False
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
            self._progress.since = self._ticks
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
        if self._progress.held(self._ticks) > self._patience:
            self._attempt(observation, here)
        return self._cruise(here)

    def _stand(self) -> Command:
        """Return the order to stop."""
        self._look_at = self._ticks + _LOOK_TICKS
        if self._plan_at is not None:
            self._look_at = min(self._look_at, self._plan_at)
        return STAND

    def _rest_here(self, track: Track, observation: Observation, here: Point) -> Command:
        """Return the order at the goal: to the exact place if no robot is there; plan again if carried off."""
        self._look_at = self._ticks + _LOOK_TICKS
        if math.dist(here, track.end) > self._own.arrival_m + self._contact_m + self._own.off_way_m:
            self.arrived = False
            self._plan(here)
            return self._cruise(here)
        held = observation.blocked or self._evasion.is_ahead(here, track.end)
        return self._stand() if held else GoTo(*track.end)

    def _evade(self, track: Track, observation: Observation, here: Point) -> Command:
        """Return the order while something is in the way."""
        while track.following is not None and self._ground.open(here, track.following):
            self._go_on(track, here)
        body = self._evasion.standing(here, track.place, self._ticks)
        if body is not None or self._progress.held(self._ticks) > self._patience:
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
        """Return the way points from *here* to a goal, or None; to be overridden by what finds its ways otherwise."""
        return self._ground.way(here, goal_m)

    def detour(self, here: Point, goal_m: Point, bodies_m: list[Point]) -> list[Point] | None:
        """Return a way around some bodies, or None."""
        return self._ground.way_around(here, goal_m, bodies_m, self._contact_m + _AT_WAY_POINT_M)

    def _plan(self, here: Point) -> None:
        assert self.goal_m is not None
        self.plans += 1
        self._take(here, self.route(here, self.goal_m))

    def _take(self, here: Point, way: list[Point] | None) -> None:
        """Begin to follow a *way*; without one, stand for a longer and longer pause."""
        if not way:
            self._track = None
            self._plan_at = self._ticks + (self._pause << min(self._attempts, _MOST_DOUBLINGS))
            self._attempts += 1
            return
        self._plan_at = None
        self._track = Track(here, way)
        self._progress.least_m = self._track.left_m(here)
        self._evasion.goal_m = self._track.end

    def _resume(self, here: Point) -> None:
        """Go back to the way, or to a new one if it is out of sight."""
        if self._track is None or not self._ground.open(here, self._track.place):
            self._plan(here)
        else:
            self._track.restart(here)

    def _advance(self, track: Track, observation: Observation, here: Point) -> None:
        """Update progress, the way points that have been passed, and whether the robot is at its goal."""
        distance = math.dist(here, track.place)
        while track.following is not None and distance <= self._own.pass_m:
            if distance > _AT_WAY_POINT_M and not self._ground.open(here, track.following):
                break
            self._go_on(track, here)
            distance = math.dist(here, track.place)
        nearer = self._progress.look(track.left_m(here), self._ticks)
        if nearer and self._attempts and self.remaining_m(here) < self._stuck_m - _FREED_M:
            self._attempts = 0
        if not self.arrived and track.following is None and self._is_at_goal(track.end, observation, here):
            self.arrived = True
            self._attempts = 0
            self._evasion.restart()

    def _go_on(self, track: Track, here: Point) -> None:
        track.go_on(here)
        self._progress.least_m = min(self._progress.least_m, track.left_m(here))

    def _is_at_goal(self, place: Point, observation: Observation, here: Point) -> bool:
        """Return whether the robot is at its goal, or before a robot that stands there."""
        if math.dist(here, place) <= self._own.arrival_m:
            return True
        return is_taken(place, here, observation, self._contact_m, self._own.arrival_m)

    def _cruise(self, here: Point) -> Command:
        """Return the order for the straight piece, and set the tick of the next look."""
        if self._track is not None and self._track.off_m(here) > self._own.off_way_m:
            self._plan(here)
        if self._track is None:
            return self._stand()
        left = math.dist(here, self._track.place) - self._own.pass_m
        self._look_at = self._ticks + max(1, min(_LOOK_TICKS, int(left / self._step_m)))
        return GoTo(*self._track.place)

    def _attempt(self, observation: Observation, here: Point) -> None:
        """Try in turn to go round the nearest body, to make way for it, and another way around all bodies near."""
        assert self.goal_m is not None
        assert self._track is not None
        number, self._attempts = self._attempts, self._attempts + 1
        self._progress.since = self._ticks
        self._stuck_m = self.remaining_m(here)
        self._order_again = True  # the last order may not have been followed
        bodies = self._evasion.bodies(here)
        kind = number % _KINDS
        if bodies and kind < _KINDS - 1:
            if kind != 2 and self._evasion.go_round(
                here, self._track.place, bodies[0], number, self._ticks, self._turn
            ):
                return
            if kind != 0:
                pause = self._pause << min(number // _KINDS, _MOST_DOUBLINGS)
                self._evasion.make_way(here, bodies[0], self._ticks, pause)
            return
        self.plans += 1
        self._take(here, self.detour(here, self.goal_m, bodies) or self.route(here, self.goal_m))


def is_taken(place: Point, here: Point, observation: Observation, contact_m: float, slack_m: float) -> bool:
    """Return whether a robot stands at *place*, so that one at *here*, before it, can come no nearer but by a slack."""
    room = contact_m + slack_m
    return math.dist(here, place) <= room + slack_m and any(
        math.dist(place, (x, y)) < contact_m and math.dist(here, (x, y)) < room
        for _, x, y in observation.picture.around(*here, room + slack_m)
    )


# ---------------------------------------------------------------- past others


class Near:
    """Who of those that a robot sees is near it: nearer than *near_m*.

    Those a little farther off are kept, too, so that all need to be looked through again only once the robot has gone
    that little farther, or sees another picture (L. Verlet, Physical Review 159(1), 1967, has such lists).
    """

    def __init__(self, near_m: float) -> None:
        self._near_m = near_m
        self._kept_m = near_m + _KEPT_M
        self._picture: Picture | None = None
        self._kept: list[tuple[Sighting, Point]] = []
        """Those on *_picture* that are near within ``_KEPT_M`` of where it was looked through, and where they are."""
        self._looked_m: Point = (math.inf, math.inf)
        self._here: Point = (math.inf, math.inf)
        self._near: list[Sighting] = []

    def look(self, observation: Observation) -> list[Sighting]:
        """Return the sightings that are near now, in their order; not to be changed."""
        picture, here = observation.picture, (observation.x_m, observation.y_m)
        if picture is not self._picture or not math.dist(here, self._looked_m) < _ROAM_M:
            self._picture, self._looked_m = picture, here
            self._kept = [(each, each[1:]) for each in picture.around(*here, self._kept_m)]
        elif here == self._here:
            return self._near
        self._here = here
        if self._kept:
            dist, near_m = math.dist, self._near_m
            self._near = [each for each, place in self._kept if dist(here, place) < near_m]
        elif self._near:
            self._near = []
        return self._near


class Evasion:
    """What a robot does while another one is in its way, or something holds it.

    VFH+ leads it, by its scan, until the way is clear again. Where that brings it nowhere it tries in turn to go round
    the body ahead, on the right or on the left, which takes exact room instead of thresholds; to go back a little or to
    wait until the other one has passed (of two it is the one farther to the west, or south, that goes back: never both,
    never neither); and another way around all bodies near. It waits for longer each time.
    """

    def __init__(self, ground: Ground, radius_m: float, step_m: float, parameters: WalkingParameters) -> None:
        own = parameters
        self._ground = ground
        self._own = own
        self.goal_m: Point = (0.0, 0.0)
        """End of the way: a robot that stands there is not to be passed."""
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
        self._others = Near(own.near_m)
        self._near: list[Sighting] = []
        """The robots that are near at this tick."""
        self._seen: dict[int, tuple[Point, int]] = {}
        self._tried_at = -_TRY_TICKS
        self._script: list[GoTo] = []
        self._held_ticks = 0
        self._waits = False
        self._script_until = 0

    def look(self, observation: Observation) -> bool:
        """Look who is near; return whether anybody is. To be called at every tick, before all that asks for them."""
        near = self._near = self._others.look(observation)
        return bool(near)

    def restart(self) -> None:
        """Head for another place."""
        self._until = -1
        self._script = []
        self._vfh.restart()

    def is_needed(self, observation: Observation, here: Point, place: Point, ticks: int) -> bool:
        """Return whether the robot is to evade on the way to *place*: something is in the way, or was until lately."""
        if observation.blocked or self.is_ahead(here, place):
            self._until = ticks + self._own.clear_ticks
        return ticks < self._until

    @property
    def ends(self) -> bool:
        """True if the way has just become clear; to be asked once."""
        ended, self._until = self._until >= 0, -1
        return ended

    def is_ahead(self, here: Point, place: Point) -> bool:
        """Return whether another robot is near and in the way to *place*; one at the goal does not count."""
        for _, x, y in self._near:  # asked at most ticks: an expression takes half as long again
            if in_the_way(here, place, (x, y), self._room_m) and math.dist(self.goal_m, (x, y)) >= self._contact_m:
                return True
        return False

    def standing(self, here: Point, place: Point, ticks: int) -> Point | None:
        """Return the place of the nearest robot in the way that has not moved for a while, if there is one.

        To be asked at every tick of an evasion. The same robot is not reported again for a while.
        """
        found, least_m = None, math.inf
        for number, x, y in self._near:
            body = x, y
            if math.dist(self.goal_m, body) < self._contact_m:
                continue
            before, since = self._seen.get(number, _UNSEEN)
            if math.dist(before, body) > _MOVED_M:
                self._seen[number] = body, ticks
            elif ticks - since >= self._standing_ticks:
                distance_m = math.dist(here, body)
                if distance_m < least_m and in_the_way(here, place, body, self._room_m):
                    found, least_m = body, distance_m
        if found is None or ticks - self._tried_at < _TRY_TICKS:
            return None
        self._tried_at = ticks
        return found

    def steer(self, observation: Observation, here: Point, place: Point, order: Command | None, ticks: int) -> Command:
        """Return the order of VFH+ on the way to *place*; *order* is the present one."""
        if isinstance(order, GoTo) and order is self._ordered and self._is_kept(observation, here, order, ticks):
            return order
        chosen = self._chosen(observation, here, place, order)
        if chosen != order and isinstance(chosen, GoTo):
            self._ordered, self._ordered_at = chosen, ticks
        return chosen

    def _is_kept(self, observation: Observation, here: Point, order: GoTo, ticks: int) -> bool:
        """Return whether an *order* is so new that it is kept: bodies brake and turn for a while before they follow.

        Without that VFH+ would treat a robot that turns on the spot as one that is held.
        """
        since = ticks - self._ordered_at
        if observation.blocked or math.dist(here, order) < _THERE_M:
            return False
        bearing = elementary.atan2(order.y_m - here[1], order.x_m - here[0])
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

    def bodies(self, here: Point) -> list[Point]:
        """Return the places of the bodies near, the nearest first."""
        return sorted(((x, y) for _, x, y in self._near), key=lambda place: math.dist(here, place))

    def go_round(self, here: Point, place: Point, body: Point, number: int, ticks: int, pause: int) -> bool:
        """Begin to go round a *body* on the way to *place* if there is room; allow *pause* ticks for each turn."""
        script = way_round(self._ground, here, place, body, number % 2 == 0)
        if script is not None:
            self._begin(here, script, ticks, pause * (1 + len(script)), waits=False)
        return script is not None

    def make_way(self, here: Point, body: Point, ticks: int, pause: int) -> None:
        """Go out of the way of a *body* for *pause* ticks, or stay if the other robot is the one to go."""
        back = retreat(self._ground, here, body) if here < body else None
        self._begin(here, [back or here], ticks, pause, waits=True)

    def _begin(self, here: Point, script: list[Point], ticks: int, more: int, waits: bool) -> None:
        self._vfh.restart()
        self._script = [GoTo(*place) for place in script]
        self._waits = waits
        self._held_ticks = 0
        self._script_until = ticks + round(1.5 * length_m([here, *script]) / self._step_m) + more

    @property
    def scripted(self) -> bool:
        """True if an attempt is under way."""
        return bool(self._script)

    def follow(self, observation: Observation, here: Point, ticks: int) -> GoTo | None:
        """Return the next place of the attempt under way; None if it is over or the robot is held."""
        self._held_ticks = self._held_ticks + 1 if observation.blocked else 0
        if math.dist(here, self._script[0]) <= _THERE_M and (len(self._script) > 1 or not self._waits):
            del self._script[0]
        if self._script and ticks < self._script_until and self._held_ticks < _HELD_TICKS:
            return self._script[0]
        self._script = []
        return None


def _gap(here: Point, place: Point, dx: float, dy: float) -> float:
    """Return the angle between the directions to a place and along (dx, dy)."""
    to_x, to_y = place[0] - here[0], place[1] - here[1]
    return abs(elementary.atan2(to_x * dy - to_y * dx, to_x * dx + to_y * dy))


def way_round(ground: Ground, here: Point, place: Point, body: Point, right: bool) -> list[Point] | None:
    """Return way points past a *body* on the way from *here* to *place*, on the side that has more room.

    Of two alike it is the *right*, or else the left, unless the other one is much nearer. None if there is too little
    room on both sides between it and the walls. The points lie beside and behind the body; the way from the last to
    *place* is not looked at.
    """
    for slack in _SLACKS_M:
        sides = (_past(ground, here, place, body, slack, 1.0), _past(ground, here, place, body, slack, -1.0))
        first, second = sides if right else sides[::-1]
        if first and second:
            return first if length_m([here, *first]) <= length_m([here, *second]) + _SHORTER_M else second
        if first or second:
            return first or second
    return None


def _past(ground: Ground, here: Point, place: Point, body: Point, slack_m: float, side: float) -> list[Point] | None:
    """Return the way points on one side, 1 for the right, as far from the body as *slack_m* more than a touch."""
    dx, dy = place[0] - here[0], place[1] - here[1]
    distance = math.hypot(dx, dy)
    if distance == 0.0:
        return None
    dx, dy = dx / distance, dy / distance
    side_x, side_y = side * dy, -side * dx
    room = 2.0 * ground.radius_m + slack_m
    wall_m = min(0.5 * slack_m, _MOST_WALL_M)
    beside = body[0] + room * side_x, body[1] + room * side_y
    before = beside[0] - room * dx, beside[1] - room * dy
    behind = beside[0] + room * dx, beside[1] + room * dy
    if not ground.fits(beside, behind, wall_m):
        return None
    if (before[0] - here[0]) * dx + (before[1] - here[1]) * dy <= 0.0:
        # already beside it, or too near for a way before it
        clear = off_m(body, here, beside) >= min(2.0 * ground.radius_m, math.dist(here, body)) - 1e-6
        return [beside, behind] if clear and ground.fits(here, beside) else None
    if ground.fits(here, before) and ground.fits(before, beside, wall_m):
        return [before, beside, behind]
    return None


def retreat(ground: Ground, here: Point, other: Point) -> Point | None:
    """Return a place in sight that is out of the way of an *other* robot that comes towards *here* and passes on.

    The place is off the line from it through *here*, or, where nothing leads off it, farther along. None if the robot
    can only stay.
    """
    dx, dy = here[0] - other[0], here[1] - other[1]
    apart = math.hypot(dx, dy)
    dx, dy = (dx / apart, dy / apart) if apart > 0.0 else (1.0, 0.0)
    room = 2.0 * ground.radius_m + _SLACKS_M[0]
    best, most = None, _PAST * apart + 0.1
    for k in range(_DIRECTIONS):
        angle = 2.0 * math.pi * k / _DIRECTIONS
        for way in _AWAY_M:
            there = here[0] + way * elementary.cos(angle), here[1] + way * elementary.sin(angle)
            off_x, off_y = there[0] - other[0], there[1] - other[1]
            along, across = off_x * dx + off_y * dy, abs(off_x * dy - off_y * dx)
            if math.hypot(off_x, off_y) < min(apart + 0.5 * way, room + apart) or not ground.fits(here, there):
                continue
            worth = min(across, room) + _PAST * min(along, 4.0 * room) - 0.01 * way
            if worth > most:
                best, most = there, worth
    return best


def in_the_way(here: Point, place: Point, body: Point, room_m: float) -> bool:
    """Return whether a *body* is nearer than *room_m* to the way from *here* to *place*, and not behind."""
    dx, dy, px, py = place[0] - here[0], place[1] - here[1], body[0] - here[0], body[1] - here[1]
    along, square = px * dx + py * dy, dx * dx + dy * dy
    if along <= 0.0:
        return False
    share = along / square if along < square else 1.0
    return math.hypot(px - share * dx, py - share * dy) < room_m  # off_m, without asking again what is known


# ---------------------------------------------------------------- without a map


class Pedestrian(Walker):
    """The ways of a member without a map or a planner, a person for example, who goes by what is seen and felt.

    VisBug-21 (:mod:`cosim.navigation.visbug`) leads it: straight towards the farthest place in sight that it can tell
    to lie on the way that Bug2 would take. What it does about other bodies is what walkers do.
    """

    def __init__(
        self, ground: Ground, radius_m: float, speed_mps: float, tick: Time, parameters: WalkingParameters
    ) -> None:
        super().__init__(ground, radius_m, speed_mps, tick, parameters)
        self._loops: Boundary = unpacked_boundary.py_func(*ground.loops)  # type: ignore[attr-defined]
        self._memory: Floats | None = None
        self._ask_at = 0
        self._underway = False
        self._at_last = False
        """True if the pedestrian heads for the goal itself."""

    def remaining_m(self, here: Point) -> float:
        """Return the straight distance to the goal, metres: nothing else is known."""
        return 0.0 if self.goal_m is None else math.dist(here, self.goal_m)

    def route(self, here: Point, goal_m: Point) -> list[Point] | None:
        """Return the place to head for next; None if VisBug has proved that no way leads to the goal."""
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
        """Return whether the pedestrian keeps to its present place, as the next one lies in another direction.

        A body that turns away under way slides on, and may lose sight of where it was to go.
        """
        if not self._underway or self._track is None or math.dist(here, self._track.place) <= _REACHED_M:
            return False
        (x, y), (to_x, to_y), (new_x, new_y) = here, self._track.place, place
        ax, ay, bx, by = to_x - x, to_y - y, new_x - x, new_y - y
        return abs(elementary.atan2(ax * by - ay * bx, ax * bx + ay * by)) > _STRAIGHT_RAD

    def detour(self, here: Point, goal_m: Point, bodies_m: list[Point]) -> list[Point] | None:
        """Return None: without a map no way around a body can be planned."""
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
