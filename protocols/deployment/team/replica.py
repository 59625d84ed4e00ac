"""One robot's replica of the team's log, and its part in electing who leads: states, inputs and actions in one table.

The log is a plan, numbered, and the facts about it (:mod:`protocols.deployment.team.ledger`); a plan of a greater
number replaces one of a smaller. Facts are a set that only grows, so two replicas that have exchanged all theirs are
equal. Every robot broadcasts a status once a period: its term, which plan it has, a digest of its facts. What another
lacks by its status, for a while, it is sent (anti-entropy); all else that is sent arrives once or not at all, in any
order.

A *term* is a number and an address, that of its leader; terms are compared as pairs. A robot follows the greatest term
that its leader has confirmed, and acts on orders of no smaller one. If nothing is heard of the leader for too long, the
lowest living address begins the next term, and all others await that (they are candidates of its part). A robot that
hears no other waits longer: where radios need links, the death of one robot may take all of them.

Of two leaders that hear each other, after a partition, the one with the later plan goes first, of equals the lower
address: it takes a term greater than the other's, whose robots then follow. If both parts went on with one plan, the
leader orders nothing until all who live there follow it and have the same facts: what any of them has noted as done is
not done again. Then it begins the plan again for all (:mod:`protocols.deployment.team.reunion`). After ``alone`` it
does so in any case, since a robot that is heard may not hear.

A robot that boots again has forgotten its log and its term. Until it hears of a greater term it may lead with an old
number; as the others have confirmed a greater one, they do not follow, and their status shows it what to exceed.
"""

from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any, Final, NamedTuple, TypeAlias

from cosim.machine import Address, next_state
from cosim.units import Time
from protocols.deployment.messages.messages import Facts, Letter, Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.facts import Fact, Record
from protocols.deployment.tasks.orders import Order
from protocols.deployment.team.ledger import Ledger

WhenHeard: TypeAlias = Callable[[Address], Time]
"""When anything of another robot was heard last; when the own machine began, if nothing ever was."""


class Term(NamedTuple):
    """A time in which one robot leads; terms are compared as pairs."""

    number: int
    leader: Address


class State(Enum):
    """What a robot is to its team."""

    FOLLOWER = "follower"
    """Its leader has said that it leads."""
    CANDIDATE = "candidate"
    """It awaits that another, or at first the one that is to begin, says that it leads."""
    LEADER = "leader"
    MERGING = "merging"
    """It leads, and waits until those who were parted agree on what has been done."""


class Input(Enum):
    """What can happen to a replica's part in the election."""

    CONFIRMED = "the leader of its term, while it awaits one, says that it leads"
    GREATER = "another leads with a greater term, and goes first"
    PRESUMED = "another leads with a greater term, but its own leader lives and goes first"
    SMALLER = "another leads with a smaller term"
    OUTDATED = "another follows a term of its own, greater than it knows: it has booted again"
    SUCCEEDS = "its leader is silent, and no living address is lower"
    AWAITS = "its leader is silent, and a lower address lives"
    PARTED = "another has other facts about the plan, or lacks its part in it, after it was out of touch"
    AGREED = "all who live follow it and have its facts"
    BEGUN = "a plan begins, or a later one is received"


TABLE: Final[dict[tuple[State, Input], tuple[str, State]]] = {
    (State.FOLLOWER, Input.GREATER): ("follow", State.FOLLOWER),
    (State.FOLLOWER, Input.PRESUMED): ("ignore", State.FOLLOWER),
    (State.FOLLOWER, Input.SMALLER): ("ignore", State.FOLLOWER),
    (State.FOLLOWER, Input.OUTDATED): ("resume", State.LEADER),
    (State.FOLLOWER, Input.SUCCEEDS): ("lead", State.LEADER),
    (State.FOLLOWER, Input.AWAITS): ("wait", State.CANDIDATE),
    (State.FOLLOWER, Input.BEGUN): ("ignore", State.FOLLOWER),
    (State.CANDIDATE, Input.CONFIRMED): ("confirm", State.FOLLOWER),
    (State.CANDIDATE, Input.GREATER): ("follow", State.FOLLOWER),
    (State.CANDIDATE, Input.SMALLER): ("ignore", State.CANDIDATE),
    (State.CANDIDATE, Input.OUTDATED): ("resume", State.LEADER),
    (State.CANDIDATE, Input.SUCCEEDS): ("lead", State.LEADER),
    (State.CANDIDATE, Input.AWAITS): ("wait", State.CANDIDATE),
    (State.CANDIDATE, Input.BEGUN): ("ignore", State.CANDIDATE),
    (State.LEADER, Input.GREATER): ("follow", State.FOLLOWER),
    (State.LEADER, Input.PRESUMED): ("exceed", State.LEADER),
    (State.LEADER, Input.SMALLER): ("ignore", State.LEADER),
    (State.LEADER, Input.OUTDATED): ("exceed", State.LEADER),
    (State.LEADER, Input.PARTED): ("gather", State.MERGING),
    (State.LEADER, Input.BEGUN): ("ignore", State.LEADER),
    (State.MERGING, Input.GREATER): ("follow", State.FOLLOWER),
    (State.MERGING, Input.PRESUMED): ("exceed", State.MERGING),
    (State.MERGING, Input.SMALLER): ("ignore", State.MERGING),
    (State.MERGING, Input.OUTDATED): ("exceed", State.MERGING),
    (State.MERGING, Input.PARTED): ("ignore", State.MERGING),
    (State.MERGING, Input.AGREED): ("merge", State.LEADER),
    (State.MERGING, Input.BEGUN): ("ignore", State.LEADER),
}
"""(state, input) -> (action, next state). Only leaders exceed terms, and only they are parted from others."""


class Waits(NamedTuple):
    """How long a replica waits, ns."""

    silence: Time
    """A robot of which nothing was heard for longer is taken for dead."""
    alone: Time
    """The same for a robot that hears no other; and the longest wait for those who are to agree."""
    again: Time
    """From one message with what another lacks to the next."""
    settle: Time
    """From the first status of a part that was out of touch until a merge, at least."""


class Led(NamedTuple):
    """Another robot leads, or this one does."""

    leader: Address
    why: str


class Taken(NamedTuple):
    """There is another plan."""


class Learned(NamedTuple):
    """There are facts that are new here."""

    facts: tuple[Fact, ...]


class Agreed(NamedTuple):
    """All who were parted agree: their plan is to be begun again by :meth:`Replica.begin`, or :meth:`Replica.keep`."""


Change: TypeAlias = Led | Taken | Learned | Agreed


class Replica:
    """One robot's replica. Inputs are statuses, messages, time; outputs are drained: messages, and changes."""

    def __init__(self, me: Address, size: int, first: Address, waits: Waits, start: Time) -> None:
        """Begin at *start* with an empty log, led by *first*."""
        self.me = me
        self.state = State.LEADER if first == me else State.CANDIDATE
        self.term = Term(0, first)
        """The greatest term that its leader has confirmed; the first counts as confirmed."""
        self.expected = first
        """The robot that leads, or that is to say so."""
        self.ledger: Ledger | None = None
        self.since = start
        """When a leader began to give the others time to be heard."""
        self._others = [other for other in range(size) if other != me]
        self._waits = waits
        self._plans: dict[Address, int] = {}
        """The number of the plan that each other has, of those that live."""
        self._gone: set[Address] = set()
        """Those that are silent."""
        self._newest = 0
        """The greatest number of a plan of which it has ever heard."""
        self._counted: dict[int, int] = {}
        """The greatest count of the scenario's calls that have been dealt with, by the plan that its author had."""
        self.over = False
        """True if the leader has said that the plan is over which is known here."""
        self._leads_by: int | None = None
        """The leader's digest by its last status, if its plan has the number of that which is known here."""
        self._fallen: dict[Address, Time] = {}
        """Leaders after whose silence it has awaited another, or led, and when that was."""
        self._lacking: dict[Address, Time] = {}
        """Since when each other has lacked something, or when it was sent something last."""
        self._parted: Time = 0
        """When it began to merge."""
        self._agreeing: set[Address] = set()
        """Who has said, since it merges, that it follows this robot and has just its facts."""
        self._kept = 0
        """The number of the last plan that was not begun again, as nothing was left of it to be done."""
        self._ordered: dict[Address, Order] = {}
        """The last order to each robot, of this leader."""
        self._sent: list[tuple[Address, Letter]] = []
        self._changes: list[Change] = []

    # ------------------------------------------------------------ what is known

    @property
    def leads(self) -> bool:
        """True if this robot leads."""
        return self.state in (State.LEADER, State.MERGING)

    @property
    def merging(self) -> bool:
        """True if those who were parted are to agree first: until then no robot is ordered anything, or lost."""
        return self.state is State.MERGING

    @property
    def number(self) -> int:
        """The number of the plan that is known; 0 if none."""
        return 0 if self.ledger is None else self.ledger.number

    @property
    def newest(self) -> int:
        """The greatest number of a plan of which anything is known. An end of it may be at orders still."""
        return max(self.number, self._newest)

    @property
    def _digest(self) -> int:
        return 0 if self.ledger is None else self.ledger.digest

    @property
    def calls(self) -> int:
        """How many of the scenario's calls have been dealt with, by those who know no later plan.

        A later plan may be lost, and with it what was called; calls that were refused after that plan count.
        """
        counted = [calls for plan, calls in self._counted.items() if plan <= self.number]
        return max([0 if self.ledger is None else self.ledger.calls, *counted])

    @property
    def awaited(self) -> bool:
        """True if a living robot can send a plan that comes after the one that is known here."""
        return any(plan > self.number for plan in self._plans.values())

    # ------------------------------------------------------------ who lives

    def silent(self, other: Address, heard: WhenHeard, now: Time) -> bool:
        """Return whether nothing was heard of *other* for too long."""
        return now - heard(other) > self._waits.silence

    def _living(self, heard: WhenHeard, now: Time) -> list[Address]:
        """Return who is taken to live, in order: this robot, and those that were heard lately."""
        return sorted([self.me, *(other for other in self._others if not self.silent(other, heard, now))])

    def alone(self, heard: WhenHeard, now: Time) -> bool:
        """Return whether no other has been heard lately: so it may be this robot that is out of reach."""
        return all(2 * (now - heard(other)) > self._waits.silence for other in self._others)

    def missed(self, other: Address, heard: Time, alone: bool, now: Time) -> bool:
        """Return whether a leader is to take *other*, which was *heard* last then, for lost.

        One that is *alone* waits longer: it may be the one that is out of reach. A new leader gives all others time to
        be heard, as with a leader that dies all links of its radio may; but not the leaders whose silence has made it
        one.
        """
        fell = heard <= self._fallen.get(other, heard - 1)
        since = heard if fell else max(heard, self.since)
        return now - since > (self._waits.alone if alone else self._waits.silence)

    # ------------------------------------------------------------ inputs

    def status(self, source: Address, status: News, now: Time) -> None:
        """Take the status of another robot."""
        self._newest = max(self._newest, status.plan)
        self._plans[source] = status.plan
        self._counted[status.plan] = max(status.calls, self._counted.get(status.plan, 0))
        term, claims = Term(status.term, status.host), status.host == source
        # of two leaders only the one that goes first has to bring their robots together
        apart = self._goes_first(status.plan, source) if claims else term > self.term
        if term.leader == self.me and term > self.term:
            self._step(Input.OUTDATED, term, now)
        elif claims:
            self._claim(term, status.plan, now)
        elif source == self.expected and term > self.term:
            self._step(Input.GREATER, term, now)  # its leader follows another
        elif self.leads and term > self.term:
            # to contend with a leader that lives, but whose plan is not known, might never end
            self._step(Input.PRESUMED if term.leader in self._gone else Input.GREATER, term, now)
        if source == self.expected:
            self._leads_by = None
            if status.plan == self.number:
                self.over, self._leads_by = status.over, status.digest
        if self.leads and apart:
            if status.plan == self.number and status.digest != self._digest:
                self.parted(now)
        elif self.leads or source == self.expected:
            self._supply(source, status, now)
        if self.merging:
            agrees = (term, status.plan, status.digest) == (self.term, self.number, self._digest)
            (self._agreeing.add if agrees else self._agreeing.discard)(source)

    def message(self, source: Address, message: Told | Facts | Ordered, now: Time) -> Order | None:
        """Take a message about the log; return an order that is to be carried out, or has been."""
        match message:
            case Told():
                self._told(source, message, now)
            case Facts(plan=plan, facts=facts) if plan == self.number:
                self.note(facts, now)
            case Ordered(term=number, order=order):
                self._claim(Term(number, source), order.plan, now)
                # neither an order of a smaller term than it has confirmed counts any more, nor one of an earlier plan
                led = self.term == Term(number, source)
                if led and order.robot == self.me and order.plan >= self.number:
                    return order
        return None

    def tick(self, heard: WhenHeard, now: Time) -> None:
        """Judge who is silent, and whether those who were parted agree; to be called at each world tick."""
        self._gone = {other for other in self._others if self.silent(other, heard, now)}
        self._plans = {other: plan for other, plan in self._plans.items() if other not in self._gone}
        if not self.leads and self.silent(self.expected, heard, now):
            long = now - heard(self.expected) > self._waits.alone
            if long or not self.alone(heard, now):
                lowest = self._living(heard, now)[0]
                self._fallen[self.expected] = now
                self._step(Input.SUCCEEDS if lowest == self.me else Input.AWAITS, Term(self.term.number, lowest), now)
        if self.merging:
            waited, living = now - self._parted, {*self._living(heard, now)} - {self.me}
            if waited >= self._waits.alone or (waited >= self._waits.settle and living <= self._agreeing):
                self._step(Input.AGREED, self.term, now)

    def begin(self, record: Record, calls: int, now: Time) -> None:
        """Begin a plan, and send it to all who are not lost by its facts; so many *calls* are dealt with."""
        told = Told(host=self.me, record=record, calls=calls)
        self._take(told, now)
        self._send_all(told)

    def note(self, facts: Iterable[Fact], now: Time) -> list[Fact]:
        """Take facts about the plan that is known; return those that are new."""
        new = [] if self.ledger is None else self.ledger.add(facts)
        if new:
            self._agreeing.clear()
            self._changes.append(Learned(tuple(new)))
        return new

    def say(self, fact: Fact, now: Time) -> None:
        """Take a fact that is known here first, and send it to all who are not lost."""
        if self.note((fact,), now):
            self._send_all(Facts(plan=self.number, facts=(fact,)))

    def order(self, order: Order, now: Time) -> None:
        """Send an order of this leader to its robot, now and for as long as that has not got it."""
        self._ordered[order.robot] = order
        self._lacking[order.robot] = now
        self._sent.append((order.robot, Ordered(term=self.term.number, order=order)))

    def parted(self, now: Time) -> None:
        """Merge, as a leader, with a robot that was out of touch, unless that was in vain for this plan."""
        if self.number != self._kept:
            self._step(Input.PARTED, self.term, now)

    def keep(self) -> None:
        """Keep the plan after all have agreed: nothing of it would be begun again."""
        self._kept = self.number

    # ------------------------------------------------------------ outputs

    def messages(self) -> list[tuple[Address, Letter]]:
        """Drain messages, which are to be sent reliably, with their destinations."""
        sent, self._sent = self._sent, []
        return sent

    def changes(self) -> list[Change]:
        """Drain what has changed, in order."""
        changes, self._changes = self._changes, []
        return changes

    # ------------------------------------------------------------ the election

    def _claim(self, term: Term, plan: int, now: Time) -> None:
        """Take that the leader of *term*, which has a *plan* of that number, says that it leads."""
        if term == self.term:
            if self.state is State.CANDIDATE:  # a follower knows
                self._step(Input.CONFIRMED, term, now)
        elif term < self.term:
            self._step(Input.SMALLER, term, now)
        else:
            led = self.leads or (self.state is State.FOLLOWER and self.expected not in self._gone)
            first = led and self._goes_first(plan, term.leader)
            self._step(Input.PRESUMED if first else Input.GREATER, term, now)

    def _goes_first(self, plan: int, leader: Address) -> bool:
        """Return whether the own leader goes before another, which has a *plan* of that number."""
        return (self.number, -self.expected) > (plan, -leader)

    def _step(self, what: Input, term: Term, now: Time) -> None:
        """Do what the table says of an input, which is about *term*."""
        action, self.state = next_state(TABLE, self.state, what)
        getattr(self, f"_{action}")(term, now)

    def _ignore(self, term: Term, now: Time) -> None:
        pass

    def _confirm(self, term: Term, now: Time) -> None:
        if self.expected != term.leader:  # it had been silent, and another was awaited
            self._led(term.leader, f"robot {term.leader} says so: it was heard again", now)

    def _follow(self, term: Term, now: Time) -> None:
        self.term = term
        if self.expected != term.leader:
            self._led(term.leader, f"robot {term.leader} says so: it has a greater term", now)

    def _lead(self, term: Term, now: Time) -> None:
        fallen, self.term = self.expected, Term(self.term.number + 1, self.me)
        self._led(self.me, f"nothing heard of robot {fallen}", now)

    def _resume(self, term: Term, now: Time) -> None:
        self._exceed(term, now)
        self._led(self.me, "others follow it: it has booted again", now)

    def _wait(self, term: Term, now: Time) -> None:
        self._led(term.leader, f"nothing heard of robot {self.expected}", now)

    def _exceed(self, term: Term, now: Time) -> None:
        self.term = Term(max(term.number, self.term.number) + 1, self.me)
        self._agreeing.clear()

    def _gather(self, term: Term, now: Time) -> None:
        self._parted = now
        self._agreeing.clear()
        # what others lack they are to have at once
        self._lacking = dict.fromkeys(self._others, now - self._waits.again)

    def _merge(self, term: Term, now: Time) -> None:
        self.since = now
        self._changes.append(Agreed())

    def _led(self, leader: Address, why: str, now: Time) -> None:
        self.expected, self.since, self.over, self._leads_by = leader, now, False, None
        self._lacking.clear()
        self._ordered.clear()
        self._lacking[leader] = now - self._waits.again  # what a new leader lacks it is to have at once
        self._changes.append(Led(leader, why))

    # ------------------------------------------------------------ the log

    def _told(self, source: Address, told: Told, now: Time) -> None:
        """Take a plan: a later one, or the leader's own of the same number."""
        plan = told.record.plan.number
        if self.ledger is not None and self.ledger.of(told.record):
            self.note(told.record.facts, now)
        elif plan > self.number or (plan == self.number and self._leads_now(source, told)):
            self._take(told, now)

    def _leads_now(self, source: Address, told: Told) -> bool:
        """Return whether *source* leads, with that plan by its last status: it may have told of it before it led."""
        return source == self.expected and self._leads_by is not None and Ledger(told).began_alike(self._leads_by)

    def _take(self, told: Told, now: Time) -> None:
        self._step(Input.BEGUN, self.term, now)
        self.ledger = Ledger(told)
        self.over, self._leads_by = False, None
        self._lacking.clear()
        self._ordered.clear()
        self._changes.append(Taken())

    def _supply(self, other: Address, status: News, now: Time) -> None:
        """Send *other* what it lacks by its status, once it has lacked that for a while."""
        if self.ledger is None:
            return
        order = self._ordered.get(other) if self.leads else None
        equal = (status.plan, status.digest) == (self.number, self._digest)
        lacks = [] if equal and order is None else self.ledger.lacking(status, self.expected, self.term.number, order)
        if not lacks:
            self._lacking.pop(other, None)
            return
        since = self._lacking.setdefault(other, now)
        if not 0 <= now - since < self._waits.again:
            self._lacking[other] = now
            self._sent += [(other, message) for message in lacks]

    def _send_all(self, message: Letter) -> None:
        """Send to all who are not lost; those are sent what they lack once they are found."""
        lost = frozenset[Any]() if self.ledger is None else self.ledger.lost
        self._sent += [(other, message) for other in self._others if other not in lost]
