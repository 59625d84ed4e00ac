"""The executive: dispatches the tasks of a plan to the robots, and coordinates them (paper 004, section 5).

It keeps the facts, and the progress that follows from them; orders are the difference between what the progress wants
of a robot and what that robot was ordered last. A fact that arrives late, after one that is later than it, makes the
executive run the plan again from the beginning: the result is the same as if the fact had come in time, and only what
differs is ordered again. Replicas on several robots therefore agree as soon as they have received the same facts.

It reads no clock and sends nothing. Its owner delivers its orders, reliably and in order, and passes on what robots
report, which of them have fallen silent, and where they are. Reports and statuses may arrive in any order, and more
than once.
"""

from collections.abc import Mapping
from typing import Final, Self

from cosim.machine import Address
from cosim.units import MS, Time
from protocols.deployment.executing.making_room import MakingRoom
from protocols.deployment.executing.progress import Progress
from protocols.deployment.executing.recovery import lengths
from protocols.deployment.executing.timetable import Breach
from protocols.deployment.executing.tree import State
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.tasks.crew import Crew, Ways
from protocols.deployment.tasks.facts import Book, Fact, Heard, Record, Switched, Terminated, ended
from protocols.deployment.tasks.orders import Errand, Halt, Order, Report, Result, Whereabouts
from protocols.deployment.tasks.plan import Place, Plan, Strategy

STRIDE: Final = 1000  # its predecessor may have used more serial numbers than it knows of
"""Distance of a successor's first serial number from the last one that it knows of."""
_UNKNOWN: Final = ("", True)
"""Stands for what a robot was ordered last where that is not known."""


class Executive:
    """Executes one plan; its queues are drained by ``orders``, ``ended`` and ``breaches``."""

    def __init__(
        self,
        plan: Plan,
        crew: Crew,
        ways: Ways,
        parameters: ExecutiveParameters,
        now: Time,
        starts_m: Mapping[Address, Place] | None = None,
    ) -> None:
        self._record = Record(plan=plan, start=now, starts_m=dict(starts_m or {}))
        self._crew, self._ways, self._parameters = crew, ways, parameters
        self._length = lengths(crew, ways)
        self._book = Book()
        self._serials: dict[Address, int] = {}
        self._issued: dict[Address, tuple[str, bool]] = {}
        """Last order of each robot: the task, and whether the robot is to do it (or to halt)."""
        self._since: dict[Address, Time] = {}
        """Time of that order."""
        self._places: dict[Address, Whereabouts] = {}
        self._room = MakingRoom(crew, ways, parameters)
        self._orders: list[Order] = []
        self._results: list[Report] = []
        self._breaches: list[Breach] = []
        self._told: dict[str, State] = {}
        self._told_breaches: set[int] = set()
        self._now = now
        self._wake: Time | None = None
        self._progress = self._fresh()
        self._follow(now)

    @classmethod
    def restored(cls, record: Record, crew: Crew, ways: Ways, parameters: ExecutiveParameters, now: Time) -> Self:
        """Return an executive that goes on where another was; it orders again everything that is to be done now."""
        self = cls(record.plan, crew, ways, parameters, record.start, record.starts_m)
        self._orders.clear()
        self._issued.clear()
        # successors that know of no serial numbers must have increasing ones too: count milliseconds since the start
        least = (now - record.start) // MS
        self._serials = {robot: max(record.serials.get(robot, 0) + STRIDE, least) for robot in crew.robots}
        for fact in record.facts:
            self._book.keep(fact)
        self._now = max(now, record.start)
        self._progress = self._fresh()
        self._progress.run(self._book.facts, self._now)
        # which robots stand aside is no fact, so it died with the predecessor
        deployments = self._progress.deployments.values()
        self._room.doubt([r for each in deployments for r in each.posts if each.leaping and r in each.stands_m])
        self._follow(now)
        return self

    # ------------------------------------------------------------ what is known

    @property
    def plan(self) -> Plan:
        """Plan that is executed."""
        return self._record.plan

    @property
    def record(self) -> Record:
        """Everything that another executive needs to go on."""
        return self._record.model_copy(update={"facts": tuple(self._book.facts), "serials": dict(self._serials)})

    @property
    def finished(self) -> bool:
        """True if the plan has ended, and no robot is on its way back to its post."""
        return self._progress.tree.over and not self._room.away

    @property
    def results(self) -> Mapping[str, Result]:
        """Results of the tasks that have ended, by name."""
        return self._progress.tree.results

    @property
    def states(self) -> Mapping[str, str]:
        """States of all tasks, by name: waiting, running, done, failed, terminated."""
        return self._progress.tree.states()

    @property
    def lost_robots(self) -> frozenset[Address]:
        """Robots that are taken for lost."""
        return frozenset(self._progress.lost)

    @property
    def progress(self) -> Progress:
        """Progress of the plan; not to be kept, as a late fact replaces it."""
        return self._progress

    # ------------------------------------------------------------ what happens

    def report(self, report: Report, now: Time) -> None:
        """Take a robot's report; ignore one of another plan."""
        if report.plan != self.plan.number:
            return
        # a predecessor may have used serial numbers that this executive does not know of
        self._serials[report.robot] = max(self._serials.get(report.robot, 0), report.serial + 1)
        self.learn(ended(report), now)

    def lost(self, robot: Address, now: Time) -> None:
        """Note that a robot has fallen silent: other robots take over its part."""
        if not self._book.lost(robot):
            at = self._places.get(robot)
            place_m = None if at is None else (at.x_m, at.y_m)
            self.learn(Heard(robot=robot, again=False, place_m=place_m, at=now), now)

    def found(self, robot: Address, now: Time) -> None:
        """Note that a lost robot was heard again: it fills an empty place, or stops and is idle."""
        if self._book.lost(robot):
            self.learn(Heard(robot=robot, again=True, at=now), now)

    def switch(self, strategy: Strategy, now: Time) -> None:
        """Continue all deployments by another strategy; every robot keeps its post."""
        self.learn(Switched(strategy=strategy, at=now), now)

    def terminate(self, task: str, now: Time) -> None:
        """End a task and all below it; the plan goes on behind it. A name that the plan does not have is ignored."""
        self.learn(Terminated(task=task, at=now), now)

    def learn(self, fact: Fact, now: Time) -> None:
        """Take a fact, from whatever source."""
        late = fact.at <= self._progress.time or self._book.knows_of(fact)
        if self._book.keep(fact):
            if late:  # what follows from facts depends on their order in time: run the plan again
                self._progress = self._fresh()
            self._follow(now)

    def whereabouts(self, at: Whereabouts, now: Time) -> None:
        """Take a robot's status: others make room for a robot that passes."""
        before, self._places[at.robot] = self._places.get(at.robot, at), at
        self._now = max(now, self._now)
        deployments = self._progress.deployments.values()
        if at.plan < before.plan == self.plan.number and any(each.posted(at.robot) for each in deployments):
            # it has booted again: if it was aside, it has forgotten to come back
            self._halt(at.robot, at.task)
        self._stray(at)
        self._make_room()

    def wake(self, now: Time) -> None:
        """Act on all that is due by *now*."""
        self._follow(now)

    def wake_at(self) -> Time | None:
        """Return when something is due without an input; None if never."""
        return self._wake

    # ------------------------------------------------------------ what comes of it

    def orders(self) -> list[Order]:
        """Drain the orders, in the order in which each robot is to receive its own."""
        orders, self._orders = self._orders, []
        return orders

    def ended(self) -> list[Report]:
        """Drain the results of tasks; a result that a late fact has changed comes again."""
        results, self._results = self._results, []
        return results

    def breaches(self) -> list[Breach]:
        """Drain the windows that have broken, or are certain to break, each once."""
        breaches, self._breaches = self._breaches, []
        return breaches

    # ------------------------------------------------------------ facts

    def _fresh(self) -> Progress:
        return Progress(self._record, self._crew, self._ways, self._parameters, self._length)

    # ------------------------------------------------------------ orders

    def _follow(self, now: Time) -> None:
        """Run the plan to *now*, and order what follows."""
        self._now = max(now, self._now)
        self._progress.run(self._book.facts, self._now)
        errands = self._progress.errands()
        for robot in self._crew.robots:
            if robot in self._progress.lost:  # if it comes back, it may be at anything, and is ordered again
                self._issued[robot] = _UNKNOWN
            elif robot in errands:
                task, errand = errands[robot]
                if self._issued.get(robot) != (task, True):
                    self._order(robot, task, errand, True)
            elif robot in self._issued:
                self._stop(robot)
        self._make_room()
        self._announce()
        self._wake = self._next()

    def _next(self) -> Time | None:
        wake = self._progress.wake_at()
        # a fact is ahead of this robot's clock only where a fault has set clocks apart; it counts when its time comes
        future = next((fact.at for fact in self._book.facts if fact.at > self._now), None)
        return wake if future is None else future if wake is None else min(wake, future)

    def _order(self, robot: Address, task: str, errand: Errand, doing: bool) -> None:
        serial = self._serials.get(robot, 0)
        self._serials[robot] = serial + 1
        self._issued[robot] = task, doing
        self._since[robot] = self._now
        self._orders.append(Order(plan=self.plan.number, serial=serial, task=task, robot=robot, errand=errand))

    def _stop(self, robot: Address) -> None:
        """Halt a robot that may still be at a task that is no longer wanted."""
        task, doing = self._issued[robot]
        end = self._progress.heard.get((task, robot))
        # an end from before our order may have answered a predecessor's order of the same task
        if doing and (end is None or end.at < self._since.get(robot, 0)):
            self._halt(robot, task)

    def _halt(self, robot: Address, task: str) -> None:
        """Halt a robot; or call it back to its post if it had one."""
        deployments = self._progress.deployments.values()
        # a late fact may have undone the reason why it left its post
        if any(robot in each.posts and robot in each.stands_m for each in deployments):
            self._issued[robot] = "", False
            self._room.doubt([robot])
        else:
            self._order(robot, task, Halt(robot=robot), False)

    def _stray(self, at: Whereabouts) -> None:
        """Halt a robot that is at a task which a predecessor has ordered, and which is not wanted."""
        wanted = at.robot in self._progress.errands() or at.robot in self._issued or at.robot in self._room.away
        known = at.plan == self.plan.number and at.task and (at.task, at.robot) not in self._progress.heard
        if known and not wanted and at.robot not in self._progress.lost:
            self._halt(at.robot, at.task)

    def _make_room(self) -> None:
        """Order deployed robots to step aside, and to come back."""
        for robot in [*self._room.away]:
            # its last order about that has ended, so it is back
            if (self._issued.get(robot, _UNKNOWN)[0], robot) in self._progress.heard:
                self._room.back(robot)
        for name, errand in self._room.requests(self._progress, self._places):
            robot = errand.robot
            label = {"retreat": "aside", "go": "back", "halt": "halt"}[errand.act]
            self._order(robot, f"{name}~{label}-{self._serials.get(robot, 0)}", errand, False)

    def _announce(self) -> None:
        """Queue the results and breaches that were not reported yet."""
        for end in {end.task: end for end in self._progress.ends}.values():
            if self._told.get(end.task) != end.state:
                self._told[end.task] = end.state
                self._results.append(
                    Report(
                        plan=self.plan.number,
                        serial=0,
                        task=end.task,
                        robot=end.robot if end.robot is not None else min(self.plan.robots, default=0),
                        result=Result(end.state.value),
                        why=end.why,
                        at=end.at,
                    )
                )
        self._progress.ends.clear()
        new = [breach for breach in self._progress.breaches() if breach.constraint not in self._told_breaches]
        self._told_breaches |= {breach.constraint for breach in new}
        self._breaches += new
