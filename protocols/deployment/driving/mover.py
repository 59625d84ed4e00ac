"""Driving to a goal: descent in the field of value iteration, by DWA, with a right of way (paper 004, section 6).

The field says where to aim, DWA how to get there without touching anything. This module adds the right of way: of two
robots the one with the lower address goes first, the other yields. A robot drives round robots that stand, where there
is room: at once if it yields, after a while if it goes first. Where there is no room, the robot that yields makes way:
it backs off to the nearest place off the other's way, and comes back when the other has passed. A robot that is held by
one that only stands there names it (``blocked_by``), so that it can be asked to step aside.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal, TypeAlias

from cosim.machine import Address, Drive
from cosim.observation import Observation
from cosim.units import Time, from_seconds, to_seconds
from protocols.deployment.driving.twin import Twin
from protocols.deployment.driving.yielding import Refuge, in_the_way, off_way_m, refuge
from protocols.deployment.tasks.plan import Place
from protocols.motion.driver import Driver
from protocols.motion.floor import Aim, Blocker, Field, Floor
from protocols.motion.parameters import DrivingParameters
from protocols.motion.progress import Progress
from protocols.motion.traffic import Other, Track, Traffic

State: TypeAlias = Literal["idle", "driving", "arrived", "stuck"]

_PROGRESS_M: Final = 0.1
"""Decrease in the length of the way that counts as progress."""
_SLOW_TO_ROUND: Final = 3.0
"""Factor of the time for which a robot that goes first waits before it drives round a body that stands."""
_FIRST_M: Final = 2.0
"""Extra way that a robot goes to yield to one that goes first."""
_CORNERED_M: Final = 100.0
"""Cost added to a refuge in which the robot is shut in once the other has arrived."""
_WAIT_S: Final = 20.0
"""Longest time for which a robot makes way."""
_HELD_S: Final = 0.5
"""Time without progress after which a robot first gets away from what it is too near to."""
_REPLAN_S: Final = 0.5
"""Interval between checks of which robots stand in the way."""


class Mover:
    """The driver of one robot; stepped once a tick."""

    def __init__(
        self,
        floor: Floor,
        me: Address,
        radius_m: float,
        speed_mps: float,
        acceleration_mps2: float,
        parameters: DrivingParameters,
        tick: Time,
    ) -> None:
        self.me = me
        self.state: State = "idle"
        self.goal_m: Place | None = None
        """Place where it is to end up."""
        self.remaining_m: float | None = None
        """Length of the way that is left to where it drives now; None without a way."""
        self.blocked_by: Address | None = None
        """Robot that stands in its way, where no way leads round that."""
        self.yielding_to: Address | None = None
        """Robot for which it is making way."""
        self.twin: Twin | None = None
        """Its counterfactual twin; None unless interference is measured."""
        self._floor, self._radius_m, self._own = floor, radius_m, parameters
        self._driver = Driver(floor, radius_m, speed_mps, acceleration_mps2, parameters, tick)
        seconds = to_seconds(tick)
        self._traffic = Traffic(me, radius_m, acceleration_mps2 * (seconds * seconds), seconds)
        self._via: list[Place] = []
        self._aside: Place | None = None
        self._field: Field | None = None
        self._among: tuple[Blocker, ...] = ()
        self._planned: Time | None = None
        self._progress, self._made_way, self._held = Progress(_PROGRESS_M), 0, False
        self._started: Time = 0
        """Time at which it would have made its first progress, alone: it may have to turn first."""

    @property
    def wants_m(self) -> Place | None:
        """Place where it would go now if no robot stood in its way."""
        return self.goal_m

    @property
    def under_way(self) -> bool:
        """True if it drives to a place, or would if it could."""
        return self.goal_m is not None and self.state in ("driving", "stuck")

    @property
    def way_m(self) -> list[Place]:
        """The corners of the way that it follows, from here on, past its way points; empty if it follows none."""
        way = self._field.way(self._here) if self._field is not None and self.under_way else None
        if way is None:
            return []
        after = [*self._via[1:], self.goal_m] if self._via and self._aside is None else []
        return [*way[1:], *(place for place in after if place is not None)]

    def compare(self) -> None:
        """Compute from now on, for the referee, what the robot would do without the others."""
        self.twin = Twin(self._floor, self._radius_m, self._own.arrive_m)

    # ------------------------------------------------------------ commands

    def go(self, place_m: Place, via_m: Sequence[Place] = ()) -> None:
        """Drive to a place, past way points in their order; give up what the robot did before."""
        self.goal_m, self._via = (float(place_m[0]), float(place_m[1])), [(float(x), float(y)) for x, y in via_m]
        self._begin("driving")
        if self.twin is not None:
            self.twin.restart()

    def halt(self) -> None:
        """Stop, and stay there."""
        self.goal_m, self._via = None, []
        self._begin("idle")

    def retreat(self, from_m: Place, way: Sequence[Place]) -> None:
        """Get out of the *way* of a robot that is at *from_m*, and wait there until :meth:`go` is called.

        The robot has ``arrived`` when it is out of the way. It stays where it is if it cannot get out of the way.
        """
        passing, place = Blocker(*from_m, self._radius_m), None
        for blockers in ([*self._traffic.standing(self._here), passing], [passing]):
            # a robot that is shut in by others makes for where it would go without them, and asks them to make room
            place = place or refuge(self._floor, self._radius_m, self._here, [from_m, *way], self._radius_m, blockers)
        self.goal_m, self._via = (place.place_m if place else self._here), []
        self._begin("driving")

    def _begin(self, state: State) -> None:
        self.state, self._aside, self.yielding_to, self.blocked_by = state, None, None, None
        self.remaining_m = None
        self._forget_progress()

    def _forget_progress(self) -> None:
        self._progress.begin(-1)
        self._planned, self._field = None, None

    # ------------------------------------------------------------ a tick

    def step(self, observation: Observation, others: Sequence[Other], now: Time) -> Drive | None:
        """Return the order from the next tick on; None if it equals the last one.

        The observation's pose is taken for the robot's own; *others* are the robots that it has heard of.
        """
        self._driver.follow(observation, now)
        self._traffic.look(observation, others, now, self._driver.carried)
        if self._progress.since < 0:
            self._progress.since = now
        way, turn = 0.0, 0.0
        if self.state in ("driving", "stuck"):
            aim = self._aim(now)
            if aim is not None:
                way, turn = self._driver.to(aim, observation, self._traffic)
        drive = self._driver.order(way, turn)
        if self.twin is not None:
            goal = self._next_m if self.state in ("driving", "stuck") else None
            bodies = [((other.x_m, other.y_m), other.radius_m) for other in others]
            self.twin.look(self._driver, goal, bodies, self._held, self.yielding_to is not None)
        return drive

    @property
    def _here(self) -> Place:
        return self._driver.here

    @property
    def _next_m(self) -> Place | None:
        return self._via[0] if self._via else self.goal_m

    # ------------------------------------------------------------ where to

    def _aim(self, now: Time) -> Aim | None:
        """Return where to aim; None to stay (the robot has arrived, or there is no way)."""
        here = self._here
        self._give_way(now)
        self._pass_way_points()
        target = self._aside or self._next_m
        assert target is not None
        if self._planned is None or now >= self._planned + from_seconds(_REPLAN_S):
            self._plan(target, now)
        self._held = self._progress.held(now) > from_seconds(_HELD_S)
        aim = None if self._field is None else self._floor.aim(self._radius_m, self._field, here, self._held)
        self.remaining_m = None if aim is None else aim.left_m
        if aim is None:
            self._judge(math.inf, now)
            return None
        if aim.last and aim.left_m <= self._own.arrive_m and (self._aside is not None or not self._via):
            self._arrive()
            return None
        if self._progress.least_m == math.inf:  # the first look at this goal
            self._started = now + from_seconds(self._driver.start_s(aim.place_m, _PROGRESS_M))
        self._judge(aim.left_m, now)
        return aim

    def _arrive(self) -> None:
        if self._aside is not None:
            self._progress.since = -1  # time in the refuge is no time without progress
        elif self._driver.stands:
            self.state, self.blocked_by = "arrived", None

    def _pass_way_points(self) -> None:
        while self._via and self._aside is None and math.dist(self._here, self._via[0]) <= self._own.via_m:
            self._via.pop(0)
            self._forget_progress()

    def _plan(self, target: Place, now: Time) -> None:
        """Choose the field to follow: round what no map shows and the robots in the way, if a way leads round them."""
        self._planned = now
        plain = self._floor.field(self._radius_m, target)
        way = plain.way(self._here) or []
        standing = self._in_the_way(way, now)
        bodies, points = [track.blocker for track in standing], self._unmapped()
        among = (*bodies, *points)
        self.blocked_by = None
        if not among:
            self._field, self._among = plain, ()
            return
        # a field with bodies is costly: keep it while they stand where they stood
        if self._field is None or not _alike(among, self._among) or self._field.goal_m != plain.goal_m:
            self._field, self._among = self._floor.field_among(self._radius_m, target, among), among
        if not self._leads(self._field, target, among):
            self._field, self._among = plain, ()
            self.blocked_by = standing[0].address if standing else None
            # no way leads round all of them: take the one round the nearer ones, if there is one, and round all that no
            # map shows; round no robot and nothing else is the plain one
            for nearest in range(len(bodies) - 1, -1 if points else 0, -1):
                fewer = [*bodies[:nearest], *points]
                field = self._floor.field_among(self._radius_m, target, fewer)
                if self._leads(field, target, fewer):
                    self._field, self.blocked_by = field, standing[nearest].address
                    break

    def _unmapped(self) -> Sequence[Blocker]:
        """Return what is on no map, for ways to lead round it: nothing here, a floor that was given is whole."""
        return ()

    def _leads(self, field: Field, target: Place, among: Sequence[Blocker]) -> bool:
        """Return whether a field among bodies leads to its target, and none of them covers the target."""
        taken_m = self._radius_m + self._own.margin_m
        taken = any(math.dist(body.place_m, target) < taken_m + body.radius_m for body in among)
        return not taken and field.cost_m(self._here) < math.inf

    def _in_the_way(self, way: Sequence[Place], now: Time) -> list[Track]:
        """Return all robots that stand near by, the nearest first, if one of them is in the way; else none."""
        found = [
            track
            for track in self._traffic.tracks(self._here)
            if track.still_s(now)
            >= self._own.still_s * (1.0 if track.address < self.me or track.idle else _SLOW_TO_ROUND)
        ]
        margin_m = self._own.margin_m + self._own.stray_m
        held = any(in_the_way(each.place_m, self._radius_m, way, each.radius_m, margin_m) for each in found)
        return found if held else []  # all of them: the way round one may meet the others

    # ------------------------------------------------------------ right of way

    def _judge(self, left_m: float, now: Time) -> None:
        """Note progress, or that there was none for too long; make way for a robot that goes first, if that is due."""
        if self._progress.look(left_m, now):
            self.state = "driving"
            return
        held_s = to_seconds(self._progress.held(now))
        if held_s >= self._own.patience_s:
            self.state = "stuck"
        # a robot that has to turn first makes no progress meanwhile
        if self._aside is not None or now - max(self._progress.since, self._started) < from_seconds(self._own.yield_s):
            return
        for track in self._traffic.tracks(self._here):
            near_m = self._radius_m + track.radius_m + 4.0 * self._own.clear_m
            # where both have stood for long, the rule of who yields has not helped
            anyway = min(held_s, track.still_s(now)) >= 0.5 * self._own.patience_s
            near = not track.idle and math.dist(self._here, track.place_m) <= near_m
            if near and self._make_way(track, anyway, now):
                return

    def _make_way(self, track: Track, anyway: bool, now: Time) -> bool:
        """Back off to where the other can pass, if it comes this way, and if that is easier than for the other.

        If it is about as easy for both, the robot with the lower address goes first. *anyway*: yield in any case.
        """
        way = _way_of(track, self._here, self._floor)
        margin_m = self._own.margin_m + self._own.stray_m
        if not in_the_way(self._here, self._radius_m, way, track.radius_m, margin_m):
            return False
        mine = self._refuge(self._radius_m, self._here, track.radius_m, way, track.place_m, self.goal_m)
        if not anyway and track.goal_m is not None and self.goal_m is not None:
            # both robots compute both costs, so that they decide alike without a message
            on = self._floor.way(self._radius_m, self._here, self.goal_m) or []
            theirs = self._refuge(track.radius_m, track.place_m, self._radius_m, on, self._here, track.goal_m)
            handicap = -_FIRST_M if track.address < self.me else _FIRST_M
            if (mine.cost_m if mine else math.inf) + handicap >= (theirs.cost_m if theirs else math.inf):
                return False
        elif not anyway and track.address > self.me:
            return False
        if mine is None:
            return False
        self._aside, self.yielding_to, self._made_way = mine.place_m, track.address, now
        self._forget_progress()
        return True

    def _refuge(
        self, radius_m: float, at: Place, other_m: float, way: Sequence[Place], other: Place, goal: Place | None
    ) -> Refuge | None:
        """Return where a body can go out of the way of another, and go on from when the other has arrived."""
        standing = [body for body in self._traffic.standing(self._here) if body.place_m not in (at, other)]
        found = refuge(self._floor, radius_m, at, way, other_m, [Blocker(*other, other_m), *standing])
        if found is None or goal is None or not way:
            return found
        end = way[-1]
        if math.dist(end, goal) < radius_m + other_m or math.dist(end, found.place_m) < radius_m + other_m:
            return found
        # the other will stand at the end of its way
        then = self._floor.field_among(radius_m, goal, [Blocker(*end, other_m)])
        return found if then.cost_m(found.place_m) < math.inf else found._replace(cost_m=found.cost_m + _CORNERED_M)

    def _give_way(self, now: Time) -> None:
        """End making way when the other has passed, stands, or takes too long."""
        if self._aside is None:
            return
        track = self._traffic.of(self.yielding_to)
        target = self._next_m
        waited_s = to_seconds(now - self._made_way)
        passed = track is None or waited_s >= _WAIT_S or (waited_s > 5.0 and track.still_s(now) > 3.0)
        if track is not None and not passed and target is not None:
            way = self._floor.field(self._radius_m, target).way(self._here) or []
            ahead = math.dist(self._here, track.place_m) < 3.0 and off_way_m(track.place_m, way) < 1.0
            passed = not ahead and waited_s > 1.0
        if passed:
            self._aside, self.yielding_to = None, None
            self._forget_progress()
            self._progress.since = now


def _way_of(track: Track, here: Place, floor: Floor) -> list[Place]:
    """Return the way of another robot; to *here* if its goal is not known."""
    goal = track.goal_m or here
    return floor.way(track.radius_m, track.place_m, goal) or [track.place_m, goal]


def _alike(some: Sequence[Blocker], others: Sequence[Blocker]) -> bool:
    """Return whether two lists of discs stand at nearly the same places."""
    return len(some) == len(others) and all(
        math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < 0.05 for a, b in zip(some, others, strict=True)
    )
