"""A model of teams of replicas: all that can happen to them, or a seeded schedule of it; bytes go from one to another.

The replicas are those that robots run. Statuses and messages cross as bytes. A status is what its author would say now.
Messages come in their order from each to each, once: in a *swift* model at once, as a message takes less time than the
wait for the next status, but for those that are lost or come late, and those that wait for the end of a partition;
otherwise at any time. Times are collapsed: a robot out of reach may be taken for silent at any moment, and whatever
waits may be over, but for the longest wait of a merge, and nothing is sent again while the same is on its way.

A play is a picture to be taken by one robot, and a place to be at in the end, for which nothing is ordered here.
Whoever leads orders the picture until it knows that it was taken.

What a robot does depends on its state and on the input alone, so it is computed once for all teams in which it recurs.
A state of the team is one integer, made of the numbers of its robots, its mail and its situation: it stands for no
other state. What is left out, as it changes nothing, is said where it is left out, and compared with a plain search.

The promises: no term falls or grows without end, and no order of a smaller term, or of an earlier plan, is obeyed. What
all of a part had noted as done when the parts met is not done again by a merge, if its leader is of that part, or has
heard one of it since; but what all who noted it have forgotten, as they crashed, may be. And from every state the team
agrees in time once faults have ceased, if it comes together, and each part of it if it does not.
"""

import random
from collections.abc import Iterator, Sequence
from functools import cache, cached_property, lru_cache
from itertools import product
from typing import Any, ClassVar, Final, NamedTuple, Self, TypeAlias

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
TERMS: Final = 40
"""No few faults raise the number of a term so far: it grows without end."""
BITS: Final = 24
"""So many bits of a state tell each part of it from others of its kind."""

Pair: TypeAlias = tuple[Address, Address]
Action: TypeAlias = tuple[Any, ...]


class BrokenError(AssertionError):
    """A promise that was broken."""


class Budget(NamedTuple):
    """How often what goes wrong may still happen."""

    losses: int = 2
    """Messages that are lost, or come late."""
    crashes: int = 1
    partitions: int = 1
    calls: int = 2


class Numbered:
    """What is never changed, but replaced; of those that are the same there is one, and a number stands for it."""

    known: ClassVar[dict[Any, Any]]
    """The ones there are, by all that tells them from others."""
    every: ClassVar[list[Any]]
    """The same by their numbers."""
    number: int

    def __init_subclass__(cls) -> None:
        cls.known, cls.every = {}, []

    def same(self, key: Any) -> Self:
        """Return the one with that *key* that was known before; this one if there was none."""
        known: Self = self.known.setdefault(key, self)
        if known is self:
            self.number = len(self.every)
            self.every.append(self)
            assert self.number >> BITS == 0
        return known


# ---------------------------------------------------------------- one robot


class Response(NamedTuple):
    """What a robot does after an input."""

    robot: "Robot"
    sent: tuple[tuple[Address, bytes], ...] = ()
    merged: tuple[int, frozenset[Address]] | None = None
    """The plan that it has begun again, if it has, and whose pictures are still to be taken."""


class Robot(Numbered):
    """A replica, and what its robot does about the play."""

    def __init__(self, replica: Replica, size: int, order: Order | None = None) -> None:
        self.replica, self.size, self.order = replica, size, order

    @classmethod
    def booted(cls, me: Address, size: int) -> "Robot":
        """Return a robot that knows nothing."""
        return cls(Replica(me, size, 0, WAITS, 0), size).one()

    def one(self) -> "Robot":
        """Return the one robot that does what this one does.

        Left out: who agrees, if it does not merge, as that is forgotten when it begins to; which plan it keeps, if that
        is not the present one, as numbers of plans never fall; its orders, if it does not lead, as they are forgotten
        when it begins to, and those that have ended, as they are not sent again; of its leader's plan all but how that
        began, and that, too, if its own began so.
        """
        own, order = self.replica, None if self.order is None else (self.order.plan, self.order.task)
        log = own.me, self.size, own.state, own.term, own.expected, own.number, own._digest, own.newest
        kept, agreeing = own._kept == own.number, frozenset(own._agreeing) if own.merging else None
        orders = [] if own.ledger is None or not own.leads else own._ordered.values()
        ordered = frozenset((each.robot, each.plan, each.task) for each in orders if not own.ledger.ended(each))
        leads_by = own._leads_by
        if leads_by is not None:
            leads_by = None if own.ledger is None or own.ledger.began_alike(leads_by) else leads_by >> 16
        return self.same((*log, leads_by, kept, agreeing, ordered, order))

    def clone(self) -> "Robot":
        """Return a copy that can be changed."""
        replica = _copy(self.replica)
        if replica.ledger is not None:
            replica.ledger = _copy(replica.ledger)
        return Robot(replica, self.size, self.order)

    @cached_property
    def can_call(self) -> bool:
        """True if it can have a play begun: it leads, and the last one has been played."""
        return self.replica.state is State.LEADER and not self.due

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

    *gone* are those that it takes for silent.
    """
    new = robot.clone()
    new.replica._lacking[source] = 0 if busy else -WAITS.again
    new.replica._gone = {*gone}
    new.replica.status(source, status.decode(data, robot.size), 0)
    return _checked(robot, _settled(new))


@cache
def received(robot: Robot, source: Address, data: bytes, gone: frozenset[Address]) -> Response:
    """Give a robot a message; *gone* are those that it takes for silent."""
    new, message = robot.clone(), messages.decode(data, robot.size)
    new.replica._gone = {*gone}
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
    return response._replace(robot=after.one())


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
    if replica.term.number > TERMS:
        raise BrokenError(f"robots {replica.me} and {replica.expected} exceed each other without end")
    sent = tuple((destination, messages.encode(message)) for destination, message in replica.messages())
    return Response(robot.one(), sent, merged)


def _begin_again(replica: Replica) -> tuple[int, frozenset[Address]]:
    ledger = replica.ledger
    assert ledger is not None
    plan = reunited(ledger.plan, replica.newest + 1, Past(ledger.done_tasks()))
    if plan is None:
        replica.keep()
        return ledger._begin, frozenset()
    replica.begin(Record(plan=plan, start=0), 0, 0)
    return ledger._begin, frozenset(robot for _, robot in undone(plan, set()))


# ---------------------------------------------------------------- between robots


class Mail(Numbered):
    """Messages that are on their way, from each to each in their order."""

    def __init__(self, queues: dict[Pair, tuple[bytes, ...]]) -> None:
        self.queues = queues
        self.pairs = frozenset(queues)

    @classmethod
    def of(cls, queues: dict[Pair, tuple[bytes, ...]]) -> "Mail":
        """Return the mail with those *queues*."""
        return cls(queues).same(frozenset(queues.items()))


@cache
def posted(mail: Mail, a: Address, b: Address, data: bytes) -> Mail:
    """Return *mail* with one message more."""
    return Mail.of({**mail.queues, (a, b): (*mail.queues.get((a, b), ()), data)})


@cache
def taken(mail: Mail, a: Address, b: Address) -> Mail:
    """Return *mail* without the first message from *a* to *b*."""
    _, *rest = mail.queues[a, b]
    others = {pair: queue for pair, queue in mail.queues.items() if pair != (a, b)}
    return Mail.of({**others, (a, b): tuple(rest)} if rest else others)


class Reach(Numbered):
    """Who reaches whom."""

    def __init__(self, size: int, apart: frozenset[Address], dead: Address | None) -> None:
        everybody, crashed = frozenset(range(size)), frozenset(() if dead is None else (dead,))
        self.living = sorted(everybody - crashed)
        self.parts = [part for part in (apart - crashed, everybody - apart - crashed) if part]
        self.reached = [next((part for part in self.parts if a in part), frozenset[Address]()) for a in range(size)]
        """Whom each robot reaches, itself included."""
        self.pairs = [(a, b) for a in range(size) for b in range(size) if a != b and b in self.reached[a]]
        """Those that reach each other."""
        self.gone = [everybody - part for part in self.reached]
        """Whom each robot does not reach."""
        self.whole = len(self.parts) == 1 and dead is None
        """True if each reaches each."""


@cache
def reach_of(size: int, apart: frozenset[Address], dead: Address | None) -> Reach:
    """Return who reaches whom in a team of that *size*, of which one part may be *apart*, and one robot *dead*."""
    return Reach(size, apart, dead).same((size, apart, dead))


class Situation(Numbered):
    """What has become of the team."""

    def __init__(
        self,
        size: int,
        apart: frozenset[Address] = frozenset(),
        dead: Address | None = None,
        noted: frozenset[tuple[frozenset[Address], int, Address]] = frozenset(),
        unheard: frozenset[Pair] = frozenset(),
    ) -> None:
        self.apart = apart
        """One part of a team that is parted; empty if it is not."""
        self.dead = dead
        self.noted = noted
        """What all of a part had noted as done when the parts met: who of them has not crashed since, what tells the
        plan, and who did it."""
        witnesses = frozenset[Address]().union(*(part for part, *_ in noted))
        self.unheard = frozenset(pair for pair in unheard if pair[0] in witnesses)
        """Of each who noted that, all of the other part who have not heard anyone of its part since the parts met."""
        self.reach = reach_of(size, apart, dead)
        self._size = size

    def but(self, **changed: Any) -> "Situation":
        """Return the situation that differs in what is *changed*."""
        old = {"apart": self.apart, "dead": self.dead, "noted": self.noted, "unheard": self.unheard}
        new = Situation(self._size, **(old | changed))
        return new.same((new._size, new.apart, new.dead, new.noted, new.unheard))


# ---------------------------------------------------------------- a team


class Team:
    """All robots, what is on its way between them, and what may still go wrong."""

    def __init__(self, size: int, budget: Budget, swift: bool = True) -> None:
        self.robots = [Robot.booted(me, size) for me in range(size)]
        self.mail, self.situation = Mail.of({}), Situation(size).but()
        self.budget, self.swift = budget, swift
        self.noticed = True
        """True if who is out of reach counts as silent in this step."""
        self.held: int | None = None
        """Which of the messages that a step causes comes late, from 0; None if none does."""
        self.sent = 0
        """How many messages the step has caused."""

    @classmethod
    def of(cls, key: int, size: int, budget: Budget) -> "Team":
        """Return the swift team whose :meth:`key` that is."""
        *robots, mail, situation = (key >> BITS * place & (1 << BITS) - 1 for place in reversed(range(size + 2)))
        new = object.__new__(cls)
        new.robots = [Robot.every[number] for number in robots]
        new.mail, new.situation = Mail.every[mail], Situation.every[situation]
        new.budget, new.swift, new.noticed, new.held, new.sent = budget, True, True, None, 0
        return new

    def clone(self) -> "Team":
        """Return a copy that can be changed."""
        new = object.__new__(Team)
        new.robots, new.mail, new.situation = self.robots.copy(), self.mail, self.situation
        new.budget, new.swift, new.noticed, new.held, new.sent = self.budget, self.swift, True, None, 0
        return new

    def log(self) -> int:
        """Return a number that tells the robots and their mail from others."""
        number = 0
        for robot in self.robots:
            number = number << BITS | robot.number
        return number << BITS | self.mail.number

    def key(self) -> int:
        """Return a number that tells all that decides what can happen from others, but for the budget."""
        return self.log() << BITS | self.situation.number

    # ------------------------------------------------------------ what can happen

    def actions(self) -> Iterator[Action]:
        """Yield all that can happen next."""
        yield from regular(self.situation.reach)
        yield from self.others()

    def others(self) -> Iterator[Action]:
        """Yield what can happen besides what is :func:`regular`."""
        reach, budget = self.situation.reach, self.budget
        for a in reach.living:
            if self.robots[a].order is not None:
                yield "do", a
            if budget.calls and self.robots[a].can_call:
                yield "call", a
        for a, b in self.mail.queues:
            if b in reach.reached[a]:
                yield "deliver", a, b, True
                if not reach.whole:
                    yield "deliver", a, b, False
            if budget.losses or self.swift:
                yield "lose", a, b
        if self.situation.dead is not None:
            yield ("boot",)
        elif budget.crashes:
            yield from (("crash", robot) for robot in reach.living)
        if self.situation.apart:
            yield ("heal",)
        elif budget.partitions:
            size = len(self.robots)
            parts = range(1, 1 << (size - 1))  # without the last robot: each parting once
            yield from (("part", frozenset(robot for robot in range(size) if part >> robot & 1)) for part in parts)

    def after(self, action: Action, held: int | None = None) -> "Team":
        """Return the team after *action*; raise BrokenError for a promise that it breaks.

        The message of that number, *held*, among those that it causes, is on its way for longer.
        """
        new = self.clone()
        if held is not None:
            new.held, new.budget = held, new.budget._replace(losses=new.budget.losses - 1)
        getattr(new, f"_{action[0]}")(*action[1:])
        return new

    def steps(self) -> Iterator[tuple[int, Budget]]:
        """Yield the keys and budgets of all teams that can be next, this one excepted."""
        key, budget = self.key(), self.budget
        quiet, loud = prospects(tuple(self.robots), self.situation.reach, self.mail.pairs)
        if self.situation.unheard:  # then who hears whom matters as such
            quiet, loud = (), regular(self.situation.reach)
        for change in quiet:
            yield key + change, budget
        for action in (*loud, *self.others()):
            new = self.after(action)
            yield new.key(), new.budget
            if budget.losses:
                for held in range(new.sent):
                    late = self.after(action, held)
                    yield late.key(), late.budget

    # ------------------------------------------------------------ how it happens

    def _tick(self, a: Address) -> None:
        self._respond(a, ticked(self.robots[a], self.situation.reach.reached[a]))

    def _status(self, a: Address, b: Address, noticed: bool) -> None:
        self.noticed = noticed
        unheard = self.situation.unheard
        if (a, b) in unheard:
            self.situation = self.situation.but(unheard=frozenset(pair for pair in unheard if pair[1] != b))
        busy = (b, a) in self.mail.pairs
        self._respond(b, heard(self.robots[b], a, self.robots[a].status, busy, self._gone(b)))

    def _deliver(self, a: Address, b: Address, noticed: bool) -> None:
        self.noticed = noticed
        data = self.mail.queues[a, b][0]
        self.mail = taken(self.mail, a, b)
        self._respond(b, received(self.robots[b], a, data, self._gone(b)))

    def _gone(self, a: Address) -> frozenset[Address]:
        return self.situation.reach.gone[a] if self.noticed else frozenset()

    def _do(self, a: Address) -> None:
        self._respond(a, acted(self.robots[a]))

    def _call(self, a: Address) -> None:
        self.budget = self.budget._replace(calls=self.budget.calls - 1)
        self._respond(a, called(self.robots[a], f"call-{self.budget.calls}"))

    def _lose(self, a: Address, b: Address) -> None:
        self.mail = taken(self.mail, a, b)
        if not self.swift:
            self.budget = self.budget._replace(losses=self.budget.losses - 1)

    def _crash(self, a: Address) -> None:
        self.budget = self.budget._replace(crashes=self.budget.crashes - 1)
        self.robots[a] = Robot.booted(a, len(self.robots))  # what it knew will be forgotten
        self.mail = Mail.of({pair: queue for pair, queue in self.mail.queues.items() if a not in pair})
        noted = frozenset((part - {a}, *rest) for part, *rest in self.situation.noted if part != {a})
        self.situation = self.situation.but(dead=a, noted=noted)

    def _boot(self) -> None:
        self.situation = self.situation.but(dead=None)

    def _part(self, part: frozenset[Address]) -> None:
        self.budget = self.budget._replace(partitions=self.budget.partitions - 1)
        self.situation = self.situation.but(apart=part)

    def _heal(self) -> None:
        noted = {
            (part, *each)
            for part in self.situation.reach.parts
            for each in frozenset.intersection(*(self.robots[robot].noted for robot in part))
        }
        apart = self.situation.apart
        size = range(len(self.robots))
        unheard = frozenset((a, b) for a in size for b in size if (a in apart) != (b in apart))
        self.situation = self.situation.but(apart=frozenset(), noted=self.situation.noted | noted, unheard=unheard)

    def _respond(self, a: Address, response: Response) -> None:
        if response.merged is not None:
            self._check_merge(a, *response.merged)
        self.robots[a] = response.robot
        for b, data in response.sent:
            queue = self.mail.queues.get((a, b), ())
            if data in queue or b == self.situation.dead:
                continue
            self.sent += 1
            at_once = self.swift and not queue and b in self.situation.reach.reached[a]
            if at_once and self.held != self.sent - 1:
                self._respond(b, received(self.robots[b], a, data, self._gone(b)))
            else:
                self.mail = posted(self.mail, a, b, data)

    def _check_merge(self, a: Address, begin: int, left: frozenset[Address]) -> None:
        """Check that what a former part has noted as done is not *left*, if one of it can still be asked.

        The leader, *a*, is of that part, or has heard one of it since the parts met.
        """
        reached, unheard = self.situation.reach.reached[a], self.situation.unheard
        again = {
            robot
            for part, plan, robot in self.situation.noted
            if plan == begin and robot in left and any((b, a) not in unheard for b in part & reached)
        }
        if again:
            raise BrokenError(f"robot {a} begins again what robots {sorted(again)} have done, as a part has noted")

    # ------------------------------------------------------------ once faults have ceased

    def calmed(self) -> "Team":
        """Return the team without faults: together, and all alive."""
        new = self.clone()
        if new.situation.apart:
            new._heal()
        if new.situation.dead is not None:
            new._boot()
        return new

    def turn(self, a: Address) -> None:
        """Have a robot say what it says in a period, and all of it, and all mail, delivered and done."""
        reached = self.situation.reach.reached
        self._tick(a)
        for b in sorted(reached[a] - {a}):
            self._status(a, b, True)
        while True:
            pairs = [(a, b) for a, b in self.mail.queues if b in reached[a]]
            doing = [robot.replica.me for robot in self.robots if robot.order is not None]
            if not pairs and not doing:
                return
            for pair in pairs:
                if pair in self.mail.queues:
                    self._deliver(*pair, True)
            for each in doing:
                if self.robots[each].order is not None:
                    self._do(each)

    def agrees(self) -> bool:
        """Return whether each part has one leader, one plan and one ledger, and nothing of it left that it can do."""
        return all(self._agree(part) for part in self.situation.reach.parts)

    def _agree(self, part: frozenset[Address]) -> bool:
        robots = [self.robots[a] for a in part]
        if len({robot.agreement for robot in robots}) > 1 or any(a in part for _, a in robots[0].due):
            return False
        states = [robot.replica.state for robot in robots]
        return states.count(State.LEADER) == 1 and states.count(State.FOLLOWER) == len(states) - 1


@cache
def regular(reach: Reach) -> list[Action]:
    """Return what happens again and again: each lets time pass, and says its status to each that it reaches.

    Who is out of reach may count as silent by then, or not yet.
    """
    noticed = (True,) if reach.whole else (True, False)
    return [("tick", a) for a in reach.living] + [("status", a, b, each) for a, b in reach.pairs for each in noticed]


@lru_cache(1 << 18)
def prospects(robots: tuple[Robot, ...], reach: Reach, busy: frozenset[Pair]) -> tuple[Sequence[int], Sequence[Action]]:
    """Return what can come of what is :func:`regular`, if messages between the pairs *busy* are on their way.

    Return the differences of keys for those actions by which one robot changes and nothing else does; and the actions
    by which anything else happens. Those by which nothing does are left out.
    """
    quiet, loud = set[int](), list[Action]()
    for action in regular(reach):
        match action:
            case "tick", a:
                response = ticked(robots[a], reach.reached[a])
            case _, source, a, noticed:
                gone = reach.gone[a] if noticed else frozenset[Address]()
                response = heard(robots[a], source, robots[source].status, (a, source) in busy, gone)
        if response.sent or response.merged:
            loud.append(action)
        elif response.robot is not robots[a]:
            quiet.add(response.robot.number - robots[a].number << BITS * (len(robots) + 1 - a))
    return tuple(quiet), tuple(loud)


# ---------------------------------------------------------------- all that can happen


class Found(NamedTuple):
    """What was visited, and how many steps led from one state to another."""

    states: int
    steps: int


class Visits:
    """The budgets, a bit each, with which states were visited.

    Many states have the same robots, and many the same mail and situation. So both are kept once, and not in each key:
    that takes a third of the memory.
    """

    def __init__(self) -> None:
        self.states = 0
        self._visits: dict[int, dict[int, int]] = {}
        """The bits, by mail and situation, then by robots."""
        self._same: dict[int, int] = {}
        """Of equal integers the one that is kept."""

    def visited(self, key: int, bits: int) -> bool:
        """Return whether the state with that *key* was visited with one of these budgets."""
        robots, rest = key >> 2 * BITS, key & (1 << 2 * BITS) - 1
        return self._visits[rest][robots] & bits != 0

    def add(self, key: int, bit: int, above: int) -> bool:
        """Note a visit with the budget *bit*, unless there was one with that or one *above*; return whether it was."""
        robots, rest = key >> 2 * BITS, key & (1 << 2 * BITS) - 1
        visits = self._visits.get(rest)
        if visits is None:
            visits = self._visits[rest] = {}
        before = visits.get(robots)
        if before is None:
            self.states += 1
            before, robots = 0, self._same.setdefault(robots, robots)
        elif before & (bit | above):
            return False
        visits[robots] = self._same.setdefault(before | bit, before | bit)
        return True


def explored(size: int, budget: Budget) -> Found:
    """Visit every state that can be reached; return how many there are, and how many steps led from one to another.

    Raise BrokenError for a promise that is broken. States are told from one another without what may still go wrong.

    Whatever can happen with some budget can happen with a greater one. So greater budgets come first, and a state is
    not visited again with a budget that is nowhere greater than one with which it was visited. That holds for calls,
    too: the names of plays tell how many are left, but names only tell one play from another.
    """
    budgets = [Budget(*each) for each in product(*(range(most, -1, -1) for most in budget))]
    bit = {each: 1 << at for at, each in enumerate(budgets)}
    above = {each: sum(bit[other] for other in budgets if _exceeds(other, each)) for each in budgets}
    start = Team(size, budget).key()
    seen, turns = Visits(), dict[int, int]()
    seen.add(start, bit[budget], 0)
    frontiers = {each: list[int]() for each in budgets}
    frontiers[budget].append(start)
    steps = 0
    for each in budgets:
        frontier = frontiers[each]
        while frontier:
            key = frontier.pop()
            if seen.visited(key, above[each]):
                continue
            team = Team.of(key, size, each)
            check_liveness(team, turns)
            for new, left in team.steps():
                steps += 1
                if seen.add(new, bit[left], above[left]):
                    frontiers[left].append(new)
    return Found(seen.states, steps)


def explored_plainly(size: int, budget: Budget) -> Found:
    """Do the same without leaving anything out that is known to change nothing: slowly."""
    start = Team(size, budget)
    seen, frontier, steps = {(start.key(), budget)}, [start], 0
    while frontier:
        team = frontier.pop()
        check_liveness(team, {})
        for action in team.actions():
            on_time = team.after(action)
            late = range(on_time.sent if team.budget.losses else 0)
            for new in (on_time, *(team.after(action, held) for held in late)):
                steps += 1
                if (new.key(), new.budget) not in seen:
                    seen.add((new.key(), new.budget))
                    frontier.append(new)
    return Found(len({key for key, _ in seen}), steps)


def _exceeds(one: Budget, other: Budget) -> bool:
    return one != other and all(more >= less for more, less in zip(one, other, strict=True))


def check_liveness(team: Team, turns: dict[int, int]) -> None:
    """Check that *team* agrees in ``ROUNDS`` once faults have ceased; *turns* are those that teams take until then.

    That holds if it comes together with all alive, and for each part if it stays as it is. A round is a turn of each
    robot, in order.
    """
    for calm in (team.calmed(), team.clone()):
        _check_agreement(calm, turns)
        if team.situation.reach.whole:
            return


def _check_agreement(calm: Team, turns: dict[int, int]) -> None:
    way, living = list[int](), calm.situation.reach.living
    most = ROUNDS * len(living)
    for passed in range(most + 1):
        at = passed % len(living)
        key = (calm.log() << BITS | calm.situation.reach.number) << BITS | at
        left = 0 if calm.agrees() else turns.get(key)
        if left is not None and passed + left <= most:
            turns.update({each: passed + left - before for before, each in enumerate(way, start=1)})
            return
        if passed:  # where it begins is not worth the memory
            way.append(key)
        calm.turn(living[at])
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


def forget() -> None:
    """Forget what robots do: the replica may be another one."""
    for kind in (Robot, Mail, Reach, Situation):
        kind.known.clear()
        kind.every.clear()
    for each in (ticked, heard, received, acted, called, posted, taken, reach_of, regular, prospects):
        each.cache_clear()
