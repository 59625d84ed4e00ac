"""A stage for executives: robots are points that drive straight, orders and reports take their time, hosts die.

It runs any plan to its end. What it makes of the executive is what a member and a transport make of it: orders arrive
in the order of their serials or not at all, reports may arrive in any order and more than once, and what a robot
reported to a host that has died it tells the next one again.
"""

import heapq
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cosim.machine import Address
from cosim.units import MS, S, Time, from_seconds
from protocols.deployment.executing.executive import Executive
from protocols.deployment.executing.timetable import Breach
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.tasks.crew import Body, Crew, Ways
from protocols.deployment.tasks.orders import Order, Report, Result, Whereabouts
from protocols.deployment.tasks.plan import Go, Photo, Place, Plan

TICK = 100 * MS
NEWS = 500 * MS


class Plain:
    """An empty floor: every way is straight."""

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        return math.dist(a, b)

    def way(self, radius_m: float, a: Place, b: Place) -> list[Place] | None:
        return [a, b]

    def free(self, radius_m: float, at: Place) -> bool:
        return True


def crew_of(size: int, **changes: object) -> Crew:
    return Crew(tuple(Body(**changes) for _ in range(size)), (0.0, 0.0))  # type: ignore[arg-type]


@dataclass
class Robot:
    address: int
    at_m: Place
    speed_mps: float = 1.0
    order: Order | None = None
    alive: bool = True
    moving: bool = False
    since: Time = 0
    reported: bool = True
    reports: list[Report] = field(default_factory=list)
    obeyed: list[Order] = field(default_factory=list)


@dataclass
class Troubles:
    """What goes wrong, drawn from a generator."""

    delay_s: tuple[float, float] = (0.0, 0.0)
    twice: float = 0.0
    """Probability that a report arrives twice."""
    failing: float = 0.0
    """Probability that a drive fails."""
    deaths: Mapping[int, float] = field(default_factory=dict)
    """When robots die, in s."""
    returns: Mapping[int, float] = field(default_factory=dict)
    """When they live again."""
    hosts: tuple[float, ...] = ()
    """When the host dies, in s; it is succeeded 2 s later."""
    silence_s: float = 3.0


class Scene:
    """A crew at base, or wherever it was left, and the executive of one plan."""

    def __init__(
        self,
        plan: Plan,
        crew: Crew,
        ways: Ways | None = None,
        troubles: Troubles | None = None,
        seed: int = 0,
        parameters: ExecutiveParameters | None = None,
    ) -> None:
        self.ways: Ways = ways or Plain()
        self.crew, self.troubles = crew, troubles or Troubles()
        self.parameters = parameters or ExecutiveParameters()
        self.draw = np.random.default_rng(seed)
        self.robots = [Robot(robot, crew.base_m) for robot in crew.robots]
        self.now: Time = 0
        self.executive: Executive | None = Executive(plan, crew, self.ways, self.parameters, 0)
        self.replica = self.executive.record
        self.orders: list[Order] = []
        self.ends: list[Report] = []
        self.breaches: list[Breach] = []
        self.term = 0
        self._queue: list[tuple[Time, int, Callable[[], None]]] = []
        self._count = 0
        self._fifo: dict[tuple[int, int], Time] = {}
        self._collect()
        for robot, at_s in self.troubles.deaths.items():
            self._at(from_seconds(at_s), lambda robot=robot: self._die(robot))
        for robot, at_s in self.troubles.returns.items():
            self._at(from_seconds(at_s), lambda robot=robot: self._return(robot))
        for at_s in self.troubles.hosts:
            self._at(from_seconds(at_s), self._host_dies)

    # ------------------------------------------------------------ time

    def _at(self, at: Time, call: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (max(at, self.now), self._count, call))
        self._count += 1

    def run(self, limit_s: float = 3000.0) -> "Scene":
        """Run until the plan has ended and nothing is under way, or fail."""
        if self.executive is not None:
            self._collect()
        while not (self.executive is not None and self.executive.finished and not self._queue):
            assert self.now < from_seconds(limit_s), self.story()
            self.step()
        return self

    def step(self) -> None:
        self.now += TICK
        while self._queue and self._queue[0][0] <= self.now:
            heapq.heappop(self._queue)[2]()
        for robot in self.robots:
            if robot.alive:
                self._move(robot)
        if self.executive is not None:
            if self.now % NEWS == 0:
                for robot in self.robots:
                    if robot.alive:
                        self.executive.whereabouts(self.whereabouts(robot), self.now)
            wake = self.executive.wake_at()
            if wake is not None and wake <= self.now:
                self.executive.wake(self.now)
                again = self.executive.wake_at()
                assert again is None or again > self.now
            self._collect()
            self.replica = self.executive.record

    def story(self) -> str:
        states = dict(self.executive.states) if self.executive is not None else {}
        return f"not finished at {self.now / S} s: {states}, {[robot.order for robot in self.robots]}"

    # ------------------------------------------------------------ messages

    def _delay(self) -> Time:
        return from_seconds(float(self.draw.uniform(*self.troubles.delay_s)))

    def _collect(self) -> None:
        assert self.executive is not None
        orders = self.executive.orders()
        assert not self.executive.orders()
        self.orders += orders
        self.ends += self.executive.ended()
        self.breaches += self.executive.breaches()
        for order in orders:
            key = self.term, order.robot
            at = self._fifo[key] = max(self.now + self._delay(), self._fifo.get(key, 0))
            self._at(at, lambda order=order: self._hear(order))

    def _hear(self, order: Order) -> None:
        robot = self.robots[order.robot]
        lost = self.executive is not None and robot.address in self.executive.lost_robots
        if not robot.alive and not lost and self.now < 600 * S:
            self._at(self.now + S, lambda: self._hear(order))  # the transport sends it again
        if not robot.alive or (robot.order is not None and robot.order.serial >= order.serial):
            return
        robot.obeyed.append(order)
        robot.order, robot.reported, robot.since = order, False, self.now
        if any(each.task == order.task and each.result is Result.DONE for each in robot.reports):
            self._report(robot, Result.DONE)  # it was ordered by the last host

    def _report(self, robot: Robot, result: Result, why: str = "") -> None:
        assert robot.order is not None
        order, robot.reported, robot.moving = robot.order, True, False
        report = Report(
            plan=order.plan,
            serial=order.serial,
            task=order.task,
            robot=robot.address,
            result=result,
            why=why,
            at=self.now,
        )
        robot.reports.append(report)
        for _ in range(1 + int(self.draw.random() < self.troubles.twice)):
            self._post(report)

    def _post(self, report: Report) -> None:
        term = self.term

        def arrive() -> None:
            if self.executive is not None and term == self.term:
                self.executive.report(report, self.now)
                self._collect()

        self._at(self.now + self._delay(), arrive)

    # ------------------------------------------------------------ robots

    def whereabouts(self, robot: Robot) -> Whereabouts:
        task = "" if robot.order is None or robot.reported else robot.order.task
        return Whereabouts(
            robot=robot.address,
            x_m=robot.at_m[0],
            y_m=robot.at_m[1],
            heading_rad=0.0,
            task=task,
            moving=robot.moving,
            plan=0 if robot.order is None else robot.order.plan,
        )

    def _move(self, robot: Robot) -> None:
        order = robot.order
        if order is None or robot.reported:
            return
        errand = order.errand
        if isinstance(errand, Go):
            self._drive(robot, errand)
        elif errand.act == "retreat":
            self._approach(robot, (errand.post_m[0], errand.post_m[1] + 1.0))
        elif errand.act == "halt":
            robot.moving = False
        elif self.now - robot.since >= (1 if isinstance(errand, Photo) else 5) * S:
            self._report(robot, Result.DONE)

    def _drive(self, robot: Robot, go: Go) -> None:
        if go.behind is not None and not robot.moving:
            ahead = self.robots[go.behind]
            if ahead.alive and ahead.moving and math.dist(ahead.at_m, robot.at_m) < go.behind_m:
                return
        if self.draw.random() < self.troubles.failing:
            self._report(robot, Result.FAILED, "stuck")
        elif self._approach(robot, go.place_m):
            self._report(robot, Result.DONE)

    def _approach(self, robot: Robot, place: Place) -> bool:
        away = math.dist(robot.at_m, place)
        step = robot.speed_mps * TICK / S
        robot.moving = away > step
        if away <= step:
            robot.at_m = place
            return True
        share = step / away
        robot.at_m = tuple(a + share * (b - a) for a, b in zip(robot.at_m, place, strict=True))  # type: ignore[assignment]
        return False

    # ------------------------------------------------------------ troubles

    def _die(self, robot: int) -> None:
        self.robots[robot].alive = self.robots[robot].moving = False
        self._at(self.now + from_seconds(self.troubles.silence_s), lambda: self._silent(robot))

    def _silent(self, robot: int) -> None:
        if self.executive is not None and not self.robots[robot].alive:
            self.executive.lost(robot, self.now)
            self._collect()

    def _return(self, robot: int) -> None:
        self.robots[robot].alive = True
        self._at(self.now + S // 2, lambda: self._heard_again(robot))

    def _heard_again(self, robot: int) -> None:
        if self.executive is not None:
            self.executive.found(robot, self.now)
            self._collect()

    def _host_dies(self) -> None:
        """The host's machine stops; a successor knows what was replicated, and hears all reports again."""
        self.executive = None
        self.term += 1
        self._at(self.now + 2 * S, self._succeed)

    def _succeed(self) -> None:
        self.executive = Executive.restored(self.replica, self.crew, self.ways, self.parameters, self.now)
        self._collect()
        for robot in self.robots:
            (self._heard_again if robot.alive else self._silent)(robot.address)
            if robot.alive:
                for report in robot.reports:
                    self._post(report)


def posts_of(executive: Executive) -> dict[Address, Place]:
    """Return where the robots of deployments that have begun are to end up."""
    each = executive.progress.deployments.values()
    return {robot: deploying.post_m(robot) for deploying in each for robot in deploying.posts}
