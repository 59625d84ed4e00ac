"""A model of teams of replicas: all that can happen to them, or a seeded schedule of it; bytes go from one to another.

The replicas are those that robots run. Statuses and messages cross as bytes. A status is what its author would say now.
Messages come in their order from each to each, once: in a *swift* model at once, as a message takes less time than the
wait for the next status, but for those that are lost or come late, and those that wait for the end of a partition;
otherwise at any time. Times are collapsed: a robot out of reach may be taken for silent at any moment, and whatever
waits may be over, but for the longest wait of a merge, and nothing is sent again while the same is on its way.

A play is a picture to be taken by one robot, and a place to be at in the end, for which nothing is ordered here.
Whoever leads orders the picture until it knows that it was taken.

What a robot does depends on its state and on the input alone, so it is computed once for all teams in which it recurs.
"""

import random
from collections.abc import Iterator
from functools import cache, cached_property
from typing import Any, ClassVar, Final, NamedTuple

from cosim.machine import Address
from protocols.deployment.messages import messages, status
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Ended, Record
from protocols.deployment.tasks.orders import Order, Result
from protocols.deployment.tasks.plan import Go, Photo, Plan, Task
from protocols.deployment.team.replica import Agreed, Replica, State, Taken, Waits
from protocols.deployment.team.reunion import Past, reunited

WAITS: Final = Waits(silence=0, alone=1, again=1, settle=0)
GONE: Final = -2
"""When a robot was heard that is out of reach: longer ago than any wait."""
ROUNDS: Final = 8
"""So many periods of the status after all faults are enough for a team to agree, and to have done all."""


class BrokenError(AssertionError):
    """A promise that was broken."""


class Budget(NamedTuple):
    """How often what goes wrong may still happen."""

    losses: int = 2
    """Messages that are lost, or come late."""
    crashes: int = 1
    partitions: int = 1
    calls: int = 2


# ---------------------------------------------------------------- one robot


class Response(NamedTuple):
    """What a robot does after an input."""

    robot: "Robot"
    sent: tuple[tuple[Address, bytes], ...] = ()
    merged: tuple[int, frozenset[Address]] | None = None
    """The plan that it has begun again, if it has, and whose pictures are still to be taken."""


class Robot:
    """A replica, and what its robot does about the play; never changed, but replaced."""

    known: ClassVar[dict[Any, "Robot"]] = {}
    """Robots by all that decides what they do."""

    def __init__(self, replica: Replica, size: int, order: Order | None = None) -> None:
        self.replica, self.size, self.order = replica, size, order

    @classmethod
    def booted(cls, me: Address, size: int) -> "Robot":
        """Return a robot that knows nothing."""
        return cls(Replica(me, size, 0, WAITS, 0), size).same()

    def same(self) -> "Robot":
        """Return the robot that is the same as this one, and was known before."""
        own = self.replica
        ordered = tuple(sorted((robot, order.plan, order.task) for robot, order in own._ordered.items()))
        order = None if self.order is None else (self.order.plan, self.order.task)
        log = own.me, self.size, own.state, own.term, own.expected, own.number, own._digest, own._newest, own._kept
        return self.known.setdefault((*log, tuple(sorted(own._agreeing)), ordered, order), self)

    def clone(self) -> "Robot":
        """Return a copy that can be changed."""
        replica = _copy(self.replica)
        if replica.ledger is not None:
            replica.ledger = _copy(replica.ledger)
        return Robot(replica, self.size, self.order)

    @cached_property
    def due(self) -> tuple[tuple[str, Address], ...]:
        """The pictures of its plan that it does not know to have been taken, and by whom they are to be."""
        ledger = self.replica.ledger
        return () if ledger is None else undone(ledger.plan, ledger.done_tasks())

    @cached_property
    def noted(self) -> frozenset[tuple[int, Address]]:
        """The robots that it has noted as having taken their pictures, each with what tells the plan from others."""
        ledger = self.replica.ledger
        if ledger is None:
            return frozenset()
        taken = {robot for _, robot in undone(ledger.plan, set())} - {robot for _, robot in self.due}
        return frozenset((ledger._begin, robot) for robot in taken)

    @cached_property
    def status(self) -> bytes:
        """The status that it broadcasts."""
        own = self.replica
        serial = 0 if self.order is not None and self.order.plan == own.number else None
        known = own.term.leader, own.term.number, own.number, 0, own._digest, serial, False
        return status.encode(News(*known, 0.0, 0.0, 0.0, 0.0, None, ""))

    @cached_property
    def agreement(self) -> tuple[Any, ...]:
        """What is to be the same on all robots in the end."""
        return self.replica.term, self.replica.number, self.replica._digest


def _copy(thing: Any) -> Any:
    new = object.__new__(type(thing))
    new.__dict__ = {
        name: value.copy() if type(value) in (dict, list, set) else value for name, value in vars(thing).items()
    }
    return new


def undone(plan: Plan, done: set[str]) -> tuple[tuple[str, Address], ...]:
    """Return the pictures of *plan* that are not *done*, and who is to take them."""
    tasks = (task for task in plan.root.walk() if task.name not in done)
    return tuple((task.name, task.act.robot) for task in tasks if isinstance(task.act, Photo))


@cache
def ticked(robot: Robot, reached: frozenset[Address]) -> Response:
    """Let time pass for a robot that hears those whom it has *reached*."""
    new = robot.clone()
    new.replica.tick(lambda other: 0 if other in reached else GONE, 0)
    return _settled(new)


@cache
def heard(robot: Robot, source: Address, data: bytes, busy: bool, gone: frozenset[Address]) -> Response:
    """Give a robot a status; *busy*: a message to its author is on its way, which it may lack until then.

    *gone* are those that it does not hear.
    """
    new = robot.clone()
    new.replica._lacking[source] = 0 if busy else -WAITS.again
    new.replica._gone = {*gone}
    new.replica.status(source, status.decode(data, robot.size), 0)
    return _checked(robot, _settled(new))


@cache
def received(robot: Robot, source: Address, data: bytes) -> Response:
    """Give a robot a message."""
    new, message = robot.clone(), messages.decode(data, robot.size)
    order = new.replica.message(source, message, 0)  # type: ignore[arg-type]
    response = _checked(robot, _settled(new))
    if order is None:
        return response
    term = (message.term, source)  # type: ignore[union-attr]
    if term < robot.replica.term or order.plan < robot.replica.number:
        raise BrokenError(f"robot {robot.replica.me} obeys an order of term {term} after {robot.replica.term}")
    ledger = new.replica.ledger
    if ledger is not None and ledger.done(order) is not None:
        return response
    after = response.robot.clone()
    after.order = order
    return response._replace(robot=after.same())


@cache
def acted(robot: Robot) -> Response:
    """Let a robot do what it was ordered."""
    new = robot.clone()
    order, new.order = new.order, None
    assert order is not None
    if order.plan == new.replica.number:
        new.replica.say(Ended(task=order.task, robot=new.replica.me, result=Result.DONE, at=0), 0)
    return _settled(new)


@cache
def called(robot: Robot, name: str) -> Response:
    """Have a leader call a play, in which the robot after it takes a picture, and is somewhere in the end."""
    new = robot.clone()
    other = (new.replica.me + 1) % robot.size
    picture = Task(name=f"{name}/picture", act=Photo(robot=other))
    root = Task(name=name, subtasks=(picture, Task(name=f"{name}/place", act=Go(robot=other, place_m=(1.0, 2.0)))))
    plan = Plan(number=new.replica.newest + 1, play=name, robots=tuple(range(robot.size)), root=root)
    new.replica.begin(Record(plan=plan, start=0), 0, 0)
    return _settled(new)


def _checked(before: Robot, after: Response) -> Response:
    if after.robot.replica.term < before.replica.term:
        raise BrokenError(f"the term falls from {before.replica.term} to {after.robot.replica.term}")
    return after


def _settled(robot: Robot) -> Response:
    """Do what the host does after an input: act on changes, order what is due, send."""
    replica, merged = robot.replica, None
    while changes := replica.changes():
        for change in changes:
            if isinstance(change, Taken):
                robot.order = None
            elif isinstance(change, Agreed):
                merged = _begin_again(replica)
    if replica.state is State.LEADER and replica.ledger is not None:
        for task, other in undone(replica.ledger.plan, replica.ledger.done_tasks()):
            order = Order(plan=replica.number, serial=0, task=task, robot=other, errand=Photo(robot=other))
            if other == replica.me:
                robot.order = order
            elif replica._ordered.get(other) != order:
                replica.order(order, 0)
    sent = tuple((destination, messages.encode(message)) for destination, message in replica.messages())
    return Response(robot.same(), sent, merged)


def _begin_again(replica: Replica) -> tuple[int, frozenset[Address]]:
    ledger = replica.ledger
    assert ledger is not None
    plan = reunited(ledger.plan, replica.newest + 1, Past(ledger.done_tasks()))
    if plan is None:
        replica.keep()
        return ledger._begin, frozenset()
    replica.begin(Record(plan=plan, start=0), 0, 0)
    return ledger._begin, frozenset(robot for _, robot in undone(plan, set()))


def forget() -> None:
    """Forget what robots do: the replica may be another one."""
    Robot.known.clear()
    for each in (ticked, heard, received, acted, called):
        each.cache_clear()


# ---------------------------------------------------------------- a team


class Team:
    """All robots, what is on its way between them, and what may still go wrong."""

    def __init__(self, size: int, budget: Budget, swift: bool = True) -> None:
        self.robots = [Robot.booted(me, size) for me in range(size)]
        self.queues: dict[tuple[Address, Address], tuple[bytes, ...]] = {}
        self.apart: frozenset[Address] = frozenset()
        """One part of a team that is parted; empty if it is not."""
        self.noted: frozenset[tuple[frozenset[Address], int, Address]] = frozenset()
        """What all of a part had noted as done when the parts met: the part, what tells the plan, and who did it."""
        self.dead: Address | None = None
        self.budget, self.swift = budget, swift
        self.held: int | None = None
        """Which of the messages that a step causes comes late, from 0; None if none does."""
        self.sent = 0
        """How many messages the step has caused."""

    def clone(self) -> "Team":
        """Return a copy that can be changed."""
        new = object.__new__(Team)
        new.robots, new.queues = self.robots.copy(), self.queues.copy()
        new.apart, new.noted, new.dead = self.apart, self.noted, self.dead
        new.budget, new.swift = self.budget, self.swift
        new.held, new.sent = None, 0
        return new

    def key(self) -> tuple[Any, ...]:
        """Return all that decides what can happen."""
        return (*self.robots, frozenset(self.queues.items()), self.noted, self.apart, self.dead, self.budget)

    # ------------------------------------------------------------ what can happen

    def actions(self) -> Iterator[tuple[Any, ...]]:
        """Yield all that can happen next."""
        size, budget = len(self.robots), self.budget
        living = [robot for robot in range(size) if robot != self.dead]
        for a in living:
            yield "tick", a
            if self.robots[a].order is not None:
                yield "do", a
            if budget.calls and self.robots[a].replica.state is State.LEADER and not self.robots[a].due:
                yield "call", a
            yield from (("status", a, b) for b in living if a != b and self.reaches(a, b))
        for a, b in self.queues:
            if self.reaches(a, b):
                yield "deliver", a, b
            if budget.losses or self.swift:
                yield "lose", a, b
        if self.dead is not None:
            yield ("boot",)
        elif budget.crashes:
            yield from (("crash", robot) for robot in living)
        if self.apart:
            yield ("heal",)
        elif budget.partitions:
            parts = range(1, 1 << (size - 1))  # without the last robot: each parting once
            yield from (("part", frozenset(robot for robot in range(size) if part >> robot & 1)) for part in parts)

    def reaches(self, a: Address, b: Address) -> bool:
        """Return whether both live, in one part."""
        return (a in self.apart) == (b in self.apart) and self.dead not in (a, b)

    def after(self, action: tuple[Any, ...], held: int | None = None) -> "Team":
        """Return the team after *action*; raise BrokenError for a promise that it breaks.

        The message of that number, *held*, among those that it causes, is on its way for longer.
        """
        new = self.clone()
        if held is not None:
            new.held, new.budget = held, new.budget._replace(losses=new.budget.losses - 1)
        getattr(new, f"_{action[0]}")(*action[1:])
        return new

    def steps(self) -> Iterator["Team"]:
        """Yield the team after all that can happen next."""
        for action in self.actions():
            new = self.after(action)
            yield new
            if self.swift and self.budget.losses:
                yield from (self.after(action, held) for held in range(new.sent))

    # ------------------------------------------------------------ how it happens

    def _tick(self, a: Address) -> None:
        self._respond(a, ticked(self.robots[a], frozenset(b for b in range(len(self.robots)) if self.reaches(a, b))))

    def _status(self, a: Address, b: Address) -> None:
        gone = frozenset(other for other in range(len(self.robots)) if not self.reaches(b, other)) - {b}
        self._respond(b, heard(self.robots[b], a, self.robots[a].status, (b, a) in self.queues, gone))

    def _deliver(self, a: Address, b: Address) -> None:
        data, *rest = self.queues.pop((a, b))
        if rest:
            self.queues[a, b] = tuple(rest)
        self._respond(b, received(self.robots[b], a, data))

    def _do(self, a: Address) -> None:
        self._respond(a, acted(self.robots[a]))

    def _call(self, a: Address) -> None:
        self.budget = self.budget._replace(calls=self.budget.calls - 1)
        self._respond(a, called(self.robots[a], f"call-{self.budget.calls}"))

    def _lose(self, a: Address, b: Address) -> None:
        _, *rest = self.queues.pop((a, b))
        if rest:
            self.queues[a, b] = tuple(rest)
        if not self.swift:
            self.budget = self.budget._replace(losses=self.budget.losses - 1)

    def _crash(self, a: Address) -> None:
        self.dead, self.budget = a, self.budget._replace(crashes=self.budget.crashes - 1)
        self.queues = {pair: queue for pair, queue in self.queues.items() if a not in pair}

    def _boot(self) -> None:
        assert self.dead is not None
        self.robots[self.dead] = Robot.booted(self.dead, len(self.robots))
        self.dead = None

    def _part(self, part: frozenset[Address]) -> None:
        self.apart = part
        self.budget = self.budget._replace(partitions=self.budget.partitions - 1)

    def _heal(self) -> None:
        everybody = frozenset(range(len(self.robots)))
        for part in (self.apart, everybody - self.apart):
            members = [self.robots[robot].noted for robot in part if robot != self.dead]
            if members:
                self.noted |= {(part, *each) for each in frozenset.intersection(*members)}
        self.apart = frozenset()

    def _respond(self, a: Address, response: Response) -> None:
        if response.merged is not None:
            self._check_merge(a, *response.merged)
        self.robots[a] = response.robot
        for b, data in response.sent:
            queue = self.queues.get((a, b), ())
            if data in queue or b == self.dead:
                continue
            self.queues[a, b] = (*queue, data)
            self.sent += 1
            if self.swift and not queue and self.reaches(a, b) and self.held != self.sent - 1:
                self._deliver(a, b)

    def _check_merge(self, a: Address, begin: int, left: frozenset[Address]) -> None:
        """Check that what a former part has noted as done, and one of it who lives still knows, is not *left*."""
        again = set[Address]()
        for part, plan, robot in self.noted:
            known = any((plan, robot) in self.robots[b].noted for b in part if self.reaches(a, b))
            if known and plan == begin and robot in left:
                again.add(robot)
        if again:
            raise BrokenError(f"robot {a} begins again what robots {sorted(again)} have done, as a part has noted")

    # ------------------------------------------------------------ once faults have ceased

    def calmed(self) -> "Team":
        """Return the team without faults: together, and all alive."""
        new = self.clone()
        new._heal()
        if new.dead is not None:
            new._boot()
        return new

    def round(self) -> None:
        """Have all say what they say in a period, and all of it delivered and done."""
        size = range(len(self.robots))
        for a in size:
            self._tick(a)
            for b in size:
                if a != b and self.reaches(a, b):
                    self._status(a, b)
            self._deliver_all()

    def _deliver_all(self) -> None:
        while True:
            pairs = [pair for pair in self.queues if self.reaches(*pair)]
            doing = [a for a, robot in enumerate(self.robots) if robot.order is not None and a != self.dead]
            if not pairs and not doing:
                return
            for pair in pairs:
                if pair in self.queues:
                    self._deliver(*pair)
            for a in doing:
                if self.robots[a].order is not None:
                    self._do(a)

    def agrees(self) -> bool:
        """Return whether there are one leader, one plan and one ledger, and nothing is left to be done."""
        states = [robot.replica.state for robot in self.robots]
        one = states.count(State.LEADER) == 1 and states.count(State.FOLLOWER) == len(states) - 1
        return one and len({robot.agreement for robot in self.robots}) == 1 and not any(r.due for r in self.robots)


class Found(NamedTuple):
    """What was visited."""

    states: int
    steps: int


def explored(size: int, budget: Budget, most: int = 10**9) -> Found:
    """Visit every state that can be reached; return how many there are, and how many steps lead from one to another.

    Raise BrokenError for a promise that is broken, or if there are more than *most* states.
    """
    start = Team(size, budget)
    seen, rounds = {start.key()}, dict[Any, int]()
    frontier, steps = [start], 0
    while frontier:
        team = frontier.pop()
        check_liveness(team, rounds)
        for new in team.steps():
            steps += 1
            key = new.key()
            if key not in seen:
                seen.add(key)
                frontier.append(new)
                if len(seen) > most:
                    raise BrokenError(f"more than {most} states")
    return Found(len(seen), steps)


def check_liveness(team: Team, rounds: dict[Any, int]) -> None:
    """Check that *team* agrees in ``ROUNDS`` once faults have ceased; *rounds* are those that states take."""
    calm, way = team.calmed(), list[Any]()
    for passed in range(ROUNDS + 1):
        key = calm.key()[:-4]
        left = 0 if calm.agrees() else rounds.get(key)
        if left is not None and passed + left <= ROUNDS:
            rounds.update({each: passed + left - at for at, each in enumerate([*way, key])})
            return
        way.append(key)
        calm.round()
    raise BrokenError(f"no agreement: {[(robot.replica.state, robot.agreement) for robot in calm.robots]}")


def wander(size: int, budget: Budget, seed: int, length: int) -> int:
    """Take a seeded walk of at most that *length* through what can happen, then check that the team agrees.

    Return how many steps it took. Raise BrokenError for a promise that is broken.
    """
    chance, team = random.Random(seed), Team(size, budget, swift=False)
    for _ in range(length):
        actions = list(team.actions())
        rare = [action for action in actions if action[0] in ("crash", "part", "lose", "call", "heal", "boot")]
        often = [action for action in actions if action not in rare]
        chosen = chance.choice(rare if rare and chance.random() < 0.15 else often)
        team = team.after(chosen)
    check_liveness(team, {})
    return length
