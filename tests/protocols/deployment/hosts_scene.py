"""Hosts of one team, without robots that drive: a scene."""

from typing import Any

from cosim.machine import Address, Event
from cosim.units import S, Time
from protocols.deployment.counters import Counters
from protocols.deployment.member.others import Others
from protocols.deployment.messages.messages import Letter
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.orders import Order, Report, Result, Whereabouts
from protocols.deployment.tasks.plan import Between, Go, Plan, Task
from protocols.deployment.team.host import Host
from tests.protocols.deployment.crew_scene import PLACES_M, STARTS_M, TICK, setup

SILENCE, AGAIN = 4 * S, 2 * S
MANY_M = (*STARTS_M, (2.0, 2.0), (3.0, 1.0))


class Robot:
    """A host, and a member that does nothing but to keep its orders."""

    def __init__(self, team: "Team", me: Address, start: Time) -> None:
        self.team, self.me, self.start = team, me, start
        known = team.setup
        self.events: list[tuple[Time, Event]] = []
        self.heard: dict[Address, Time] = {}
        self.orders: list[Order] = []
        self.others = Others(me, known.crew.bodies, known.starts_m)
        self.host = Host(team.parameters, known, me, self.others, self, self.note, Counters(), start)

    def note(self, event: Event) -> None:
        self.events.append((self.team.now, event))

    def post(self, destination: Address, letter: Letter, now: Time) -> None:
        self.team.letters.append((self.me, destination, letter))

    def forget(self, other: Address, now: Time) -> None:
        self.team.letters = [each for each in self.team.letters if each[:2] != (self.me, other)]

    def when(self, other: Address) -> Time:
        return self.heard.get(other, self.start)

    def where(self) -> Whereabouts:
        x_m, y_m = self.team.setup.starts_m[self.me]
        return Whereabouts(robot=self.me, x_m=x_m, y_m=y_m, heading_rad=0.0, plan=self.host.number)

    def news(self) -> News:
        host, at = self.host, self.where()
        serial = self.orders[-1].serial if self.orders and self.orders[-1].plan == host.number else None
        term = host.replica.term
        known = term.leader, term.number, host.number, host.calls, host.digest
        return News(*known, serial, True, at.x_m, at.y_m, 0.0, 0.0, None, "", host.over)

    def settle(self) -> None:
        self.host.advance(self.team.now)
        self.orders += self.host.mine
        self.host.mine.clear()

    def reports(self, task: str, result: Result = Result.DONE, plan: int = 1) -> None:
        self.host.report(
            Report(plan=plan, serial=0, task=task, robot=self.me, result=result, at=self.team.now), self.team.now
        )
        self.settle()

    def times(self, kind: type[Event], **fields: Any) -> list[Time]:
        """Return when events of a kind have happened, those with such fields."""
        return [
            at
            for at, event in self.events
            if isinstance(event, kind) and all(getattr(event, name) == value for name, value in fields.items())
        ]


class Team:
    """Robots that hear each other's news once a second, each at a tick of its own, and letters a tick later."""

    def __init__(self, size: int = 3, executive: str = "central") -> None:
        times = {"silence_s": SILENCE / S, "alone_s": 12.0, "again_s": AGAIN / S}
        self.parameters, self.setup = setup(MANY_M[:size], executive=executive, **times)
        self.now: Time = 0
        self.letters: list[tuple[Address, Address, Letter]] = []
        self.dead: set[Address] = set()
        self.cut: set[tuple[Address, Address]] = set()
        """Who is not heard by whom."""
        self.spoilt: set[tuple[Address, Address]] = set()
        """Whose letters do not come to whom."""
        self.robots = [Robot(self, me, 0) for me in range(size)]

    @property
    def living(self) -> list[Robot]:
        return [robot for robot in self.robots if robot.me not in self.dead]

    def reaches(self, source: Address, other: Address) -> bool:
        return not ({source, other} & self.dead or (source, other) in self.cut or source == other)

    def boot(self, me: Address) -> None:
        self.robots[me] = Robot(self, me, self.now)
        self.letters = [each for each in self.letters if me not in each[:2]]

    def tick(self) -> None:
        self.now += TICK
        letters, self.letters = self.letters, []
        for source, other, letter in letters:
            if self.reaches(source, other) and (source, other) not in self.spoilt:
                self.robots[other].heard[source] = self.now
                self.robots[other].host.letter(source, letter, self.now)
        for robot in self.living:
            if self.now % S == TICK * robot.me:
                self.tell(robot)
        for robot in self.living:
            robot.host.tick(robot.when, robot.where(), self.now)
            robot.settle()

    def tell(self, robot: Robot) -> None:
        news = robot.news()
        for other in self.living:
            if self.reaches(robot.me, other.me):
                other.heard[robot.me] = self.now
                other.others.news[robot.me] = news, self.now
                other.host.hear(robot.me, news, self.now)

    def until(self, at_s: float) -> None:
        while self.now < at_s * S:
            self.tick()

    def play(self, root: Task, number: int = 1, constraints: tuple[Between, ...] = ()) -> None:
        robots = tuple(robot.me for robot in self.robots)
        starts_m = dict(enumerate(self.setup.starts_m))
        plan = Plan(number=number, play="p", robots=robots, root=root, constraints=constraints)
        self.robots[0].host.execute(plan, starts_m, 1, self.now)
        self.robots[0].settle()


def drives(size: int, order: Any = "parallel") -> Task:
    """Return a play in which each robot drives to a place."""
    places_m = (*PLACES_M, (6.0, 1.0), (7.0, 2.0))
    subtasks = tuple(
        Task(name=f"p/{robot}", act=Go(robot=robot, place_m=places_m[robot]), on_failure="skip")
        for robot in range(size)
    )
    return Task(name="p", order=order, subtasks=subtasks)


def over(robot: Robot) -> bool:
    assert robot.host.play is not None
    return robot.host.play.over
