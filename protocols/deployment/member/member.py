"""One robot of a deployment: it carries out its orders, drives, yields to others, and reports how orders ended.

It obeys only the order of the highest serial of the highest plan. Orders come from the present host: a late message of
a host that was succeeded is not passed to it, and a new host may begin its serials again from a lower number
(:meth:`Member.forget_serials`).
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import cosim.elementary as elementary
from cosim.machine import Address, Drive, Event
from cosim.observation import Observation
from cosim.units import S, Time, from_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.driving.exploring_mover import ExploringMover
from protocols.deployment.driving.mover import Mover
from protocols.deployment.member.camera import Camera
from protocols.deployment.member.others import Others
from protocols.deployment.member.yielding import Yielding, YieldRequests
from protocols.deployment.messages.messages import YieldRequest
from protocols.deployment.messages.status import FAST_MPS
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.setup import Setup
from protocols.deployment.tasks.events import Driving, SteppedAside, TaskEnded, TaskStarted
from protocols.deployment.tasks.orders import Halt, Order, Report, Result, Retreat
from protocols.deployment.tasks.plan import Explore, Face, Go, Photo, Place
from protocols.motion.floor import Floor
from protocols.motion.progress import Progress

# ---------------------------------------------------------------- crowd
# A robot that only passes a place has come to it when it is as near as the bodies that stand there already let it.
#
# In a group stage all robots drive to one place, in leap-frog each passes all places that are held (paper 004, Fig. 3).
# Only the robot that is to end up there needs the very place; without this, robots would push each other off it.


NEARER_M: Final = 0.1
"""Decrease in distance that counts as progress."""


class Crowd:
    """The crowd about a place that one robot is to pass, and whether the robot stands in it."""

    def __init__(
        self, floor: Floor, radii_m: Sequence[float], radius_m: float, mover: Mover, patience_s: float
    ) -> None:
        self._floor, self._radii_m, self._radius_m, self._mover = floor, radii_m, radius_m, mover
        self._patience = from_seconds(patience_s)
        self._progress = Progress(NEARER_M)

    def forget(self) -> None:
        """Begin again: the robot has another place to go to."""
        self._progress.least_m = math.inf

    def near(self, order: Order | None, here: Place, others: Others) -> bool:
        """Return whether only nearer bodies keep the robot from the place that it is ordered to pass."""
        go = None if order is None else order.errand
        return isinstance(go, Go) and not go.final and self._near(go.place_m, here, others)

    def _near(self, place_m: Place, here: Place, others: Others) -> bool:
        """Return whether the bodies that are nearer to a place, one behind the other, would reach to this robot."""
        off_m = math.dist(here, place_m)
        nearer = [robot for robot, place in others.places_m.items() if math.dist(place, place_m) < off_m]
        reach_m = self._radius_m + math.fsum(2.0 * self._radii_m[robot] + 2.0 * NEARER_M for robot in nearer)
        if not nearer or off_m > reach_m:
            return False
        # a place may be near through a wall, and far by the way
        way_m = self._floor.length_m(self._radius_m, here, place_m)
        return way_m is not None and way_m <= reach_m

    def come(self, go: Go, here: Place, others: Others, now: Time) -> bool:
        """Return whether the robot has come to a place that it passes: it is near, and comes no nearer."""
        if go.final:
            return False
        self._progress.look(math.dist(here, go.place_m), now)
        held = self._mover.blocked_by is not None or self._progress.held(now) >= self._patience
        return held and self._near(go.place_m, here, others)


# ---------------------------------------------------------------- approach

APPROACHED_M: Final = 0.2
"""Decrease in the length of the way that counts as progress."""
LOOK: Final = S
"""Interval between looks at the way that is left."""


class Approach:
    """One robot's drive to one place: whether it gets nearer by the bare map, whatever its mover tries."""

    def __init__(self, floor: Floor, radius_m: float) -> None:
        self._floor, self._radius_m = floor, radius_m
        self._goal_m: Place | None = None
        self._progress = Progress(APPROACHED_M)
        self._looked: Time = 0

    def begin(self, goal_m: Place, now: Time) -> None:
        """Begin a drive to a place."""
        self._goal_m, self._looked = goal_m, now
        self._progress.begin(now)

    def held(self, here: Place, now: Time) -> Time:
        """Return for how long the robot, now *here*, has made no progress."""
        if self._goal_m is not None and not 0 <= now - self._looked < LOOK:
            self._looked = now
            self._progress.look(self._floor.field(self._radius_m, self._goal_m).distance_m(here), now)
        return max(self._progress.held(now), 0)


# ---------------------------------------------------------------- member


STILL_M: Final = 1e-6
"""Movement per tick below which a robot counts as standing, m."""


class Member:
    """One robot's part in a play."""

    def __init__(
        self,
        parameters: MemberParameters,
        setup: Setup,
        me: Address,
        mover: ExploringMover,
        counters: Counters,
        note: Callable[[Event], None],
    ) -> None:
        self.me = me
        self.others = Others(me, setup.crew.bodies, setup.starts_m)
        self.here: Place = setup.starts_m[me]
        self.heading_rad = 0.0
        self.speed_mps = 0.0
        self.reports: list[Report] = []
        """Ends of orders; drained by what passes them on to the host."""
        self.camera = Camera(parameters, setup.crew.bodies[me].camera)
        self._parameters = parameters
        self._setup = setup
        self._mover = mover
        self._counters = counters
        self._note = note
        self._order: Order | None = None
        self._over = True
        """True if that order has ended."""
        self._waits_since: Time | None = None
        """Time since which it waits for the robot that it is to set off behind."""
        self._rests = True
        """True if it has not moved in the last tick."""
        self._approach = Approach(setup.floor, setup.crew.bodies[me].radius_m)
        self._yielding = Yielding(parameters, mover)
        radii_m = [body.radius_m for body in setup.crew.bodies]
        self._yield_requests = YieldRequests(parameters, setup.floors[me], me, radii_m[me], mover)
        self._crowd = Crowd(setup.floor, radii_m, radii_m[me], mover, parameters.crowd_s)
        self._requested: list[tuple[Address, YieldRequest]] = []

    # ------------------------------------------------------------ what is asked of it

    @property
    def idle(self) -> bool:
        """True if the robot has nothing to do, or only to wait or to make room."""
        # other robots do not make way for an idle one, but ask it to yield
        return self._over or self._yielding.away or self._waits_since is not None

    @property
    def order(self) -> Order | None:
        """Last order that the robot has obeyed."""
        return self._order

    @property
    def task(self) -> str:
        """Name of its present task; empty if there is none."""
        return "" if self._over or self._order is None else self._order.task

    @property
    def goal_m(self) -> Place | None:
        """Place to which the robot drives; None if it does not."""
        return None if self._mover.state in ("idle", "arrived") else self._mover.goal_m

    @property
    def resting(self) -> bool:
        """True if the robot has nothing to do, and stands where it belongs."""
        return self._over and not self._yielding.away and self._rests

    @property
    def way_m(self) -> list[Place]:
        """The corners of the way that it follows; empty if it follows none."""
        return self._mover.way_m

    def forget_serials(self) -> None:
        """Obey any serial of this plan next: there is another host."""
        if self._order is not None:
            self._order = self._order.model_copy(update={"serial": 0})

    def obey(self, order: Order, now: Time) -> None:
        """Carry out *order*, unless it is older than the present one, or the same."""
        last = self._order
        if order.robot != self.me or (last is not None and (order.plan, order.serial) < (last.plan, last.serial)):
            return
        if last is not None and order == last:
            return
        if last is not None and not self._over and (order.task, order.errand) == (last.task, last.errand):
            self._order = order  # another host has ordered again what the robot is at
            return
        self._end_silently()
        self._order, self._over = order, False
        self._counters.obeyed += 1
        goal = self._goal_m(order)
        self._note(TaskStarted(order.plan, order.serial, order.task, order.errand.act, *self.here, *goal))
        self._begin(order, now)

    def yield_to(self, request: YieldRequest, now: Time) -> None:
        """Make way for the robot that asks, unless this one has something to do."""
        if request.robot == self.me or not (self._over or self._waits_since is not None) or self._yielding.away:
            return
        self._withdraw(request.robot, self.here, [request.from_m, *request.way_m], now)

    # ------------------------------------------------------------ every tick

    def step(self, observation: Observation, now: Time) -> Drive | None:
        """Go on with the order; return how to drive from now on, if that has changed."""
        gone_m = math.dist(self.here, (observation.x_m, observation.y_m))
        self._rests = gone_m < STILL_M
        self._counters.way_m += gone_m
        self._counters.blocked += observation.blocked
        self.here = observation.x_m, observation.y_m
        self.heading_rad, self.speed_mps = observation.heading_rad, observation.speed_mps
        met = self.others.look(observation, now)
        if not self._over and self._order is not None and isinstance(self._order.errand, Go):
            self._set_off_behind(self._order.errand, now)
        turning = self._turn(observation, now)
        drive = turning or self._mover.step(observation, met, now)
        self._note_drive()
        # in a crowd the others cannot make room, and need not: this robot only passes
        if self._yielding.away or not (self._over or self._crowd.near(self._order, self.here, self.others)):
            self._requested += self._yield_requests.step(self.here, self.others, now)
        self._yielding.step(self.here, self.others, now)
        self._look_for_the_end(now)
        return drive

    @property
    def moves(self) -> bool:
        """True if the robot drives."""
        return abs(self.speed_mps) > FAST_MPS

    def requests(self) -> list[tuple[Address, YieldRequest]]:
        """Drain the yield requests to other robots."""
        requests, self._requested = self._requested, []
        return requests

    # ------------------------------------------------------------ orders

    def _goal_m(self, order: Order) -> Place:
        errand = order.errand
        if isinstance(errand, Go):
            return errand.place_m
        return errand.post_m if isinstance(errand, Retreat) else self.here

    def _begin(self, order: Order, now: Time) -> None:
        match order.errand:
            case Go(behind=None) as go:
                self._go(go, now)
            case Go():
                self._waits_since = now
            case Retreat(post_m=post_m, passing=passing, way_m=way_m):
                way = list(way_m) or [self.others.place_m(passing), post_m]
                self._withdraw(passing, post_m, way, now, ordered=True)
            case Halt():
                self._mover.halt()
                self._end(Result.TERMINATED, "halted", now)
            case Photo() if not self.camera.works:
                self._end(Result.FAILED, "it has no camera", now)
            case Photo() | Face():
                self._mover.halt()
                self.camera.begin(now)
            case Explore():
                self._mover.explore(now)

    def _go(self, go: Go, now: Time) -> None:
        self._waits_since = None
        self._approach.begin(go.place_m, now)
        self._yielding.forget()
        self._crowd.forget()
        self._mover.go(go.place_m, go.via_m)

    def _set_off_behind(self, go: Go, now: Time) -> None:
        """Set off behind another robot, once that is far enough ahead, by the way to the goal."""
        if self._waits_since is None or go.behind is None:
            return
        ahead = go.behind
        floor, radius_m = self._setup.floor, self._setup.crew.radius_m(self.me)
        mine_m = floor.length_m(radius_m, self.here, go.place_m)
        its_m = floor.length_m(radius_m, self.others.place_m(ahead), go.place_m)
        waited = now - self._waits_since
        away = mine_m is None or its_m is None or (self.others.bound(ahead) and mine_m - its_m >= go.behind_m)
        # nor wait for a robot that has nothing to do, or that does not get on
        idle = waited >= from_seconds(self._parameters.behind_s) and not self.others.busy(ahead)
        in_vain = waited >= from_seconds(self._parameters.behind_most_s) and not self.others.moves(ahead)
        if away or idle or in_vain:
            self._go(go, now)

    def _turn(self, observation: Observation, now: Time) -> Drive | None:
        """Turn as ordered, and take the picture if one is; return how to drive; None if the order asks for neither."""
        order = self._order
        if self._over or order is None or not isinstance(order.errand, Photo | Face):
            return None
        turn = self.camera.turn(_heading_rad(order.errand, observation), observation)
        if turn is not None and not self.camera.stuck(now):
            return turn
        if turn is not None:
            self._end(Result.FAILED, "stuck while it turned", now)
        else:
            if isinstance(order.errand, Photo):
                self._note(self.camera.taken(order.task, observation))
                self._counters.pictures += 1
            self._end(Result.DONE, "", now)
        return Drive(0.0, 0.0)

    def _note_drive(self) -> None:
        """Report to the referee which drive the robot is at, and how fast it is."""
        order, mover = self._order, self._mover
        if not self._over and order is not None and isinstance(order.errand, Go):
            speeds_mps = None if mover.twin is None else mover.twin.speeds_mps
            self._note(Driving(order.task, self._waits_since is not None, mover.under_way, speeds_mps))

    def _withdraw(self, passing: Address, post_m: Place, way: list[Place], now: Time, ordered: bool = False) -> None:
        self._counters.asides += 1
        self._note(SteppedAside(passing, *self.here))
        self._yielding.make_way(passing, post_m, way, now, ordered)

    # ------------------------------------------------------------ ends

    def _look_for_the_end(self, now: Time) -> None:
        order = self._order
        if self._over or order is None:
            return
        if isinstance(order.errand, Retreat):
            if not self._yielding.away:
                self._end(Result.DONE, "", now)
        elif isinstance(order.errand, Go) and self._waits_since is None:
            self._look_for_arrival(order.errand, now)
        elif isinstance(order.errand, Explore) and self._mover.explored is not None:
            self._end(*self._mover.explored, now)

    def _look_for_arrival(self, go: Go, now: Time) -> None:
        passed = self._crowd.come(go, self.here, self.others, now)
        if passed or self._mover.state == "arrived":
            self._end(Result.DONE, "", now)
            if passed:
                self._mover.halt()
        elif self._approach.held(self.here, now) > from_seconds(self._parameters.stuck_s):
            x_m, y_m = self.here
            self._end(Result.FAILED, f"stuck at ({x_m:.1f}, {y_m:.1f})", now)
            self._mover.halt()

    def _end(self, result: Result, why: str, now: Time) -> None:
        order = self._order
        assert order is not None
        self._over = True
        self._waits_since = None
        self._counters.failed += result is Result.FAILED
        self._note(TaskEnded(order.plan, order.serial, order.task, result.value, why, *self.here))
        self.reports.append(
            Report(plan=order.plan, serial=order.serial, task=order.task, robot=self.me, result=result, why=why, at=now)
        )

    def _end_silently(self) -> None:
        """Forget the present order without a report."""
        # a later order has come, and the executive awaits only the end of that one
        self._waits_since = None
        self._yielding.forget()


def _heading_rad(errand: Photo | Face, observation: Observation) -> float | None:
    """Return the direction to which the robot is to turn; None if any will do."""
    if isinstance(errand, Photo):
        return errand.heading_rad
    x_m, y_m = errand.towards_m
    return elementary.atan2(y_m - observation.y_m, x_m - observation.x_m)
