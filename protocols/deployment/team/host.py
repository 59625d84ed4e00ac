"""What a robot does for its team's play: runs it, orders what it wants, says who is lost; whoever leads.

Every robot has a replica of the team's log (:mod:`protocols.deployment.team.replica`), since every robot may come to
lead. With a central executive only the leader runs the play; with a distributed one all run it by the same facts, and
obey their own orders to themselves. What is decided about the play (which robot is lost, a change of strategy) is the
leader's, and reaches the others as facts.

The leader says how a plan has ended, and which constraints were not kept. Its successor does not say so again, as far
as it can know: its status says that the plan is over, and what was certain by then it has said itself.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from cosim.machine import Address, Event
from cosim.units import Time, from_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.executing.executive import Executive
from protocols.deployment.member.others import Others
from protocols.deployment.messages.messages import Facts, Letter, Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import Setup
from protocols.deployment.tasks import events, facts
from protocols.deployment.tasks.facts import Fact, Heard, Record
from protocols.deployment.tasks.orders import Order, Report, Whereabouts
from protocols.deployment.tasks.plan import Place, Plan, ends_m
from protocols.deployment.team.ledger import Ledger
from protocols.deployment.team.replica import Agreed, Learned, Led, Replica, Taken, Waits, WhenHeard
from protocols.deployment.team.reunion import Past, is_reunited, reunited


class Mail(Protocol):
    """What carries messages to other robots."""

    def post(self, destination: Address, letter: Letter, now: Time) -> None:
        """Send a message reliably."""

    def forget(self, other: Address, now: Time) -> None:
        """Send nothing any more of what is on its way to a robot."""


class Play:
    """One robot's copy of it."""

    def __init__(self, ledger: Ledger, parameters: Parameters, setup: Setup) -> None:
        self.ledger = ledger
        self.executive: Executive | None = None
        """Runs the play; None with one who only keeps the ledger."""
        self._parameters = parameters
        self._setup = setup

    @property
    def number(self) -> int:
        """The plan's number."""
        return self.ledger.number

    @property
    def over(self) -> bool:
        """Whether it has been played to its end, as far as is known here; never with one who does not run it.

        One replica of several does not know whether others have come back to their posts; each knows it of itself.
        """
        if self.executive is None:
            return False
        if self._parameters.executive == "distributed":
            return self.ledger.plan.root.name in self.executive.results
        return self.executive.finished

    @property
    def runs(self) -> bool:
        """Whether it is run here, and not over."""
        return self.executive is not None and not self.over

    def run(self, whereabouts: Iterable[Whereabouts], now: Time) -> None:
        """Run it from now on, by all that is known of it."""
        known, parameters, record = self._setup, self._parameters.executing, self.ledger.record()
        if record.facts or now != record.start:
            self.executive = Executive.restored(record, known.crew, known.floor, parameters, now)
        else:
            self.executive = Executive(record.plan, known.crew, known.floor, parameters, now, record.starts_m)
        for each in whereabouts:
            self.executive.whereabouts(each, now)

    def rest(self) -> None:
        """Run it no more: somebody else does."""
        self.executive = None

    def learn(self, facts: Iterable[Fact], now: Time) -> None:
        """Take facts that are new in the ledger."""
        if self.executive is not None:
            for fact in facts:
                self.executive.learn(fact, now)

    def whereabouts(self, whereabouts: Whereabouts, now: Time) -> None:
        """Take where a robot is."""
        if self.executive is not None:
            self.executive.whereabouts(whereabouts, now)

    def orders(self) -> list[Order]:
        """Drain the orders that the executive gives."""
        return [] if self.executive is None else self.executive.orders()

    def wake(self, now: Time) -> None:
        """Act on the executive's deadlines."""
        if self.executive is not None:
            self.executive.wake(now)

    def wake_at(self) -> Time | None:
        """Return the executive's next deadline."""
        return None if self.executive is None else self.executive.wake_at()

    def breaches(self, since: Time) -> list[str]:
        """Drain the constraints that were not kept, in words; without those that were certain *since* or before."""
        found = [] if self.executive is None else self.executive.breaches()
        return [breach.why for breach in found if breach.at > since]

    def past(self) -> Past:
        """Return what has happened to it, for who begins it again."""
        ledger, known = self.ledger, Past(self.ledger.done_tasks(), self.ledger.given_up())
        if self.executive is None:
            return known
        progress, roster = self.executive.progress, self.executive.progress.roster
        casts = {name: deploying.cast for name, deploying in progress.deployments.items()}
        return known._replace(casts=casts, roles={robot: roster.role(robot) for robot in ledger.plan.robots})

    def misses(self, robot: Address) -> bool:
        """Return whether a robot that is there again has lost a part that nobody else has taken."""
        return self.executive is not None and self.executive.progress.misses(robot)

    @property
    def end(self) -> str | None:
        """How the whole plan has ended; None if it has not."""
        if self.executive is None or not self.over:
            return None
        return self.executive.results[self.ledger.plan.root.name].value

    def ends(self) -> list[Report]:
        """Drain how tasks have ended."""
        return [] if self.executive is None else self.executive.ended()


class Host:
    """One robot's part in the play of its team."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        others: Others,
        mail: Mail,
        note: Callable[[Event], None],
        counters: Counters,
        start: Time,
    ) -> None:
        self.me = me
        self.play: Play | None = None
        self.mail = mail
        self.mine: list[Order] = []
        """Orders to this robot itself; drained by what gives them to the member."""
        self.breaches: list[str] = []
        """Constraints that were not kept, in words; drained by what reads them."""
        self.ends: list[tuple[int, str]] = []
        """Plans that have ended, and how; likewise."""
        self.changes = 0
        """Number of times that it has followed another leader: each counts its orders from 0."""
        self._parameters, self._setup, self._others = parameters, setup, others
        self._note, self._counters = note, counters
        self._silence = from_seconds(parameters.silence_s)
        settle = 2 * from_seconds(parameters.news_s)
        waits = Waits(self._silence, from_seconds(parameters.alone_s), from_seconds(parameters.again_s), settle)
        self.replica = Replica(me, setup.size, parameters.host, waits, start)
        self._near = from_seconds(2.0 * parameters.news_s)
        self._doubtful = False
        """True if nothing was heard of the leader lately: it may have died before it could say how the play ended."""
        self._here_m = setup.starts_m[me]
        self._central = parameters.executive == "central"
        self._early: list[Report] = []
        """Reports of orders of a plan that it has not got yet: it may have booted again."""
        self._announced = 0
        """Number of the last plan that is known to have been said to have ended, by whoever led."""
        self._since = start - 1
        """When a leader was heard last before this robot led: what was certain by then has been said."""

    # ------------------------------------------------------------ what is known

    @property
    def leads(self) -> bool:
        """True if this robot leads."""
        return self.replica.leads

    @property
    def leader(self) -> Address:
        """The robot that leads, or that is to say so."""
        return self.replica.expected

    @property
    def number(self) -> int:
        """The number of the plan that is known; 0 if none."""
        return self.replica.number

    @property
    def newest(self) -> int:
        """The greatest number of a plan of which anything is known."""
        return self.replica.newest

    @property
    def digest(self) -> int:
        """A number that differs for those who know other facts."""
        return 0 if self.replica.ledger is None else self.replica.ledger.digest

    @property
    def calls(self) -> int:
        """How many of the scenario's calls have been dealt with, as far as is known here."""
        return self.replica.calls

    @property
    def over(self) -> bool:
        """True if the play has been played to its end, as this robot says if it leads, or as the leader has said."""
        if self.play is None:
            return False
        return self.play.over if self.leads else self._announced >= self.number

    @property
    def busy(self) -> bool:
        """True if a play is being played, or a living robot knows one that has not come here yet.

        A robot that may have to lead, should its leader fall silent, is busy until the leader has said that the play
        is over. One that runs the play itself knows that beforehand, and believes that a leader that was just heard
        says so.
        """
        play, replica = self.play, self.replica
        plays = play is not None and not (replica.over or (play.over and not self._doubtful))
        return plays or replica.merging or replica.awaited

    def silent(self, other: Address, heard: WhenHeard, now: Time) -> bool:
        """Return whether nothing was heard of *other* for too long."""
        return self.replica.silent(other, heard, now)

    def wake_at(self) -> Time | None:
        """Return the executive's next deadline."""
        return None if self.play is None else self.play.wake_at()

    # ------------------------------------------------------------ what is wanted

    def execute(
        self, plan: Plan, starts_m: Mapping[Address, Place], calls: int, now: Time, facts: tuple[Fact, ...] = ()
    ) -> None:
        """Have *plan* played from now on, made for robots at *starts_m*; so many *calls* of the scenario are over.

        *facts*: what is known already to have happened by now.
        """
        self._counters.plans += 1
        self.replica.begin(Record(plan=plan, start=now, starts_m=dict(starts_m), facts=facts), calls, now)
        self._settle(now)

    def say(self, fact: Fact, now: Time) -> None:
        """Take a fact that is known here first, or an operator's will, and send it to all."""
        self.replica.say(fact, now)
        self._settle(now)

    # ------------------------------------------------------------ inputs

    def hear(self, source: Address, news: News, now: Time) -> None:
        """Take another's status."""
        self.replica.status(source, news, now)
        self._settle(now)
        if news.over:
            self._announced = max(self._announced, news.plan)
        if news.host == source and not self.leads:
            self._since = now
        if self.play is not None:
            self.play.whereabouts(news.whereabouts(source), now)

    def letter(self, source: Address, letter: Told | Facts | Ordered, now: Time) -> None:
        """Take a message about the log."""
        order = self.replica.message(source, letter, now)
        self._settle(now)
        if order is not None:
            self._obey(order, source, now)

    def report(self, report: Report, now: Time) -> None:
        """Take how an order of this robot has ended, and send it to all."""
        if report.plan == self.number:
            self.say(facts.ended(report), now)
        elif report.plan > self.number:
            self._early.append(report)

    def tick(self, heard: WhenHeard, whereabouts: Whereabouts, now: Time) -> None:
        """Judge, once a world tick, which robots are silent and which are not any more."""
        self._doubtful = not self.leads and now - heard(self.leader) > self._near
        self._here_m = whereabouts.x_m, whereabouts.y_m
        self.replica.tick(heard, now)
        self._settle(now, heard)
        play = self.play
        if play is None:
            return
        if not play.over:
            play.whereabouts(whereabouts, now)
        if self.leads:
            self._check_team(play, heard, now)

    def advance(self, now: Time) -> None:
        """Act on all deadlines, and pass on what the executive wants."""
        play = self.play
        if play is None or play.executive is None:
            return
        play.wake(now)
        if self.replica.merging:
            return
        for order in play.orders():
            if order.robot == self.me or (self._central and self.leads):
                self._order(order, now)
        if self.leads:
            self._announce(play, now)
        self._settle(now)

    # ------------------------------------------------------------ what follows from changes of the log

    def _settle(self, now: Time, heard: WhenHeard | None = None) -> None:
        """Act on what has changed in the replica, until nothing more does, and send what it has to send."""
        while changes := self.replica.changes():
            for change in changes:
                match change:
                    case Led(leader, why):
                        self._follow(leader, why, now)
                    case Taken():
                        self._take(now)
                    case Learned(new) if self.play is not None:
                        self.play.learn(new, now)
                    case Agreed() if self.play is not None and heard is not None:
                        self._begin_again(self.play, heard, now)
        for destination, message in self.replica.messages():
            self.mail.post(destination, message, now)

    def _follow(self, leader: Address, why: str, now: Time) -> None:
        """Be led by another robot than before, or lead."""
        self.mine.clear()
        self.changes += 1
        self._note(events.HostChanged(leader, why))
        if self.leads:
            self._counters.successions += 1
            if self.play is not None:
                self._run(self.play, now)
        elif self.play is not None and self._central:
            self.play.rest()

    def _take(self, now: Time) -> None:
        ledger = self.replica.ledger
        assert ledger is not None
        self.play, plan = Play(ledger, self._parameters, self._setup), ledger.plan
        self._note(events.PlanTaken(plan.number, plan.play, len(plan.robots)))
        if self.leads:
            self._note(events.PlanBegun(plan.number, plan.robots, tuple(ends_m(plan.root).values())))
        if self.leads or not self._central:
            self._run(self.play, now)
        early, self._early = self._early, []
        for report in early:
            self.report(report, now)

    def _run(self, play: Play, now: Time) -> None:
        if play.executive is None:
            play.run([news.whereabouts(robot) for robot, (news, _) in sorted(self._others.news.items())], now)

    def _begin_again(self, play: Play, heard: WhenHeard, now: Time) -> None:
        """End what two leaders have led at once, or without one who is back, and begin again together."""
        ledger = play.ledger
        plan = reunited(ledger.plan, self.newest + 1, play.past())
        if plan is None:
            self.replica.keep()
            return
        silent = [robot for robot in sorted(ledger.lost) if robot != self.me and now - heard(robot) >= self._silence]
        lost = tuple(self._missing(robot, now) for robot in silent)
        self.execute(plan, {**self._others.places_m, self.me: self._here_m}, ledger.calls, now, lost)

    # ------------------------------------------------------------ which robots are there

    def _check_team(self, play: Play, heard: WhenHeard, now: Time) -> None:
        """Say which robots are lost, and which are there again; one that has lost its part brings all together."""
        over, replica, lost = play.over, self.replica, play.ledger.lost
        alone = replica.alone(heard, now)
        for robot in range(self._setup.size):
            at = now if robot == self.me else heard(robot)  # others may have taken it for lost before it led them
            if robot in lost and now - at < self._silence:
                self._note(events.RobotFound(robot))
                self.say(Heard(robot=robot, again=True, at=now), now)
            elif robot not in lost and not (over or replica.merging) and replica.missed(robot, at, alone, now):
                self._counters.lost += 1
                self._note(events.RobotLost(robot, *self._others.place_m(robot)))
                self.say(self._missing(robot, now), now)
                self.mail.forget(robot, now)
        if (over or is_reunited(play.ledger.plan)) and any(map(play.misses, play.ledger.found)):
            replica.parted(now)

    def _missing(self, robot: Address, now: Time) -> Heard:
        return Heard(robot=robot, again=False, place_m=self._others.place_m(robot), at=now)

    # ------------------------------------------------------------ orders and ends

    def _order(self, order: Order, now: Time) -> None:
        self._counters.ordered += 1
        self._note(events.Ordered(order.robot, order.plan, order.serial, order.task, order.errand.act))
        if order.robot == self.me:
            self.mine.append(order)
        else:
            self.replica.order(order, now)

    def _obey(self, order: Order, source: Address, now: Time) -> None:
        """Take an order of the leader; what has been done is not done again, but reported: it has not heard so."""
        done = None if self.play is None else self.play.ledger.done(order)
        if done is None:
            self.mine.append(order)
        else:
            self.mail.post(source, Facts(plan=self.number, facts=(done,)), now)

    def _announce(self, play: Play, now: Time) -> None:
        """Say which constraints were not kept, and how the plan has ended, if no leader has said so."""
        breaches = play.breaches(self._since)
        for why in breaches:
            self._counters.breaches += 1
            self._note(events.Breached(play.number, why))
        self.breaches += breaches
        result = play.end
        if result is not None and self._announced < play.number:
            self._announced = play.number
            self._counters.ended.append((play.number, result, now))
            self._note(events.PlanEnded(play.number, result))
            self.ends.append((play.number, result))
