"""The host's part of a robot: the play that is being played, who orders whom, who is lost, who takes over.

Every robot has one, since every robot may become host. With a central executive only the host runs the play, and the
others keep its ledger; with a distributed one all run it by the same facts, and obey their own orders to themselves.
What is decided about the play (who is lost, a change of strategy) is the host's, and reaches the others as facts.
"""

from collections.abc import Callable, Mapping

from cosim.machine import Address, Event
from cosim.units import Time, from_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.member.others import Others
from protocols.deployment.messages.messages import Facts, Letter, Ordered, Told
from protocols.deployment.messages.status import News
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import Setup
from protocols.deployment.tasks import events, facts
from protocols.deployment.tasks.facts import Fact, Record
from protocols.deployment.tasks.orders import Report, Whereabouts
from protocols.deployment.tasks.plan import Place, Plan, ends_m
from protocols.deployment.team.dispatch import Dispatch, Mail
from protocols.deployment.team.gossip import Gossip
from protocols.deployment.team.meeting import Meeting
from protocols.deployment.team.play import Play
from protocols.deployment.team.reunion import is_reunited, reunited
from protocols.deployment.team.roll import Roll
from protocols.deployment.team.rumours import Rumours
from protocols.deployment.team.succession import Succession, WhenHeard


class Host:
    """One robot's part in leading a team."""

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
        self._parameters = parameters
        self._setup = setup
        self._others = others
        self.mail = mail
        self._note = note
        self._counters = counters
        silence, alone = from_seconds(parameters.silence_s), from_seconds(parameters.alone_s)
        self.succession = Succession(me, setup.size, parameters.host, silence, alone, start)
        self._roll = Roll(me, setup.size, silence, self.succession, others, note, counters)
        self._here_m = setup.starts_m[me]
        self._team = [robot for robot in range(setup.size) if robot != me]
        gossip = Gossip(from_seconds(parameters.again_s))
        self._central = parameters.executive == "central"
        self.dispatch = Dispatch(me, self._central, mail, gossip, note, counters, start)
        self.rumours = Rumours(from_seconds(2.0 * parameters.news_s))
        self._meeting = Meeting(2 * from_seconds(parameters.news_s))
        self._early: list[Report] = []
        """Of orders of a plan that it has not been told yet: it may have booted again."""
        self.changes = 0
        """How often it has followed another host; who counts sees that serials begin anew."""

    # ------------------------------------------------------------ what is known

    @property
    def leads(self) -> bool:
        """Whether this robot is host."""
        return self.succession.leads

    @property
    def number(self) -> int:
        """The number of the plan that is known; 0 if none."""
        return 0 if self.play is None else self.play.number

    @property
    def newest(self) -> int:
        """The greatest number of a plan that anybody is known to have known."""
        return max(self.number, self.rumours.newest)

    @property
    def digest(self) -> int:
        """What tells those who know other facts."""
        return 0 if self.play is None else self.play.ledger.digest

    @property
    def calls(self) -> int:
        """How many of the scenario's calls have been dealt with, as far as is known here."""
        return max(self.rumours.calls(self.number), 0 if self.play is None else self.play.ledger.calls)

    @property
    def over(self) -> bool:
        """Whether the play has been played to its end, as this robot says if it is host, or as the host has said."""
        if self.play is None:
            return False
        return self.play.over if self.leads else self.dispatch.announced >= self.number

    @property
    def busy(self) -> bool:
        """Whether a play is being played, or there is one that somebody can tell it, and has not yet.

        Whoever may have to lead, should its host fall silent, is busy until the host has said that the play is over;
        who runs the play itself knows that beforehand, and believes that a host that was just heard says so.
        """
        rumours, play = self.rumours, self.play
        plays = play is not None and not (rumours.over or (play.over and not rumours.doubtful))
        return plays or self._meeting.called or rumours.awaited(self.number)

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
        record = Record(plan=plan, start=now, starts_m=dict(starts_m), facts=facts)
        told = Told(host=self.me, record=record, calls=calls)
        self._counters.plans += 1
        self._take(told, now)
        self._post_all(told, now)

    def say(self, fact: Fact, now: Time) -> None:
        """Take a fact that is known here first, or an operator's will, and tell all."""
        if self.play is not None and self.play.add((fact,), now):
            self._post_all(Facts(plan=self.number, facts=(fact,)), now)

    # ------------------------------------------------------------ what is heard

    def hear(self, source: Address, news: News, now: Time) -> None:
        """Take another's news."""
        if news.host == source and self.succession.claimed(source, news.term, news.plan, self.number):
            self._followed(now)
        self.rumours.hear(source, news.plan, news.calls)
        self.dispatch.hear(source, news, self.leads, now)
        if self.play is None:
            return
        if source == self.succession.host and news.plan == self.number:
            self.rumours.over = news.over
        if self.play.executive is not None:
            self.play.whereabouts(news.whereabouts(source), now)
        if self.leads and self.succession.rivalled(source, news.host, news.term):
            if news.plan == self.number and news.digest != self.digest:
                self._meeting.call(self.number, now)
        elif self.leads or source == self.succession.host:
            self.dispatch.compare(self.play, source, news, self.succession, now)

    def letter(self, source: Address, letter: Letter, now: Time) -> None:
        """Take a letter that concerns the play."""
        match letter:
            case Told():
                self._told(source, letter, now)
            case Facts(plan=plan, facts=facts):
                if self.play is not None and plan == self.number:
                    self.play.add(facts, now)
            case Ordered(term=term, order=order):
                if source != self.succession.host and self.succession.claimed(source, term, order.plan, self.number):
                    self._followed(now)
                if source == self.succession.host and order.robot == self.me:
                    self.dispatch.take(order, self.play, source, now)

    def report(self, report: Report, now: Time) -> None:
        """Take how an order of this robot has ended, and tell all."""
        if report.plan == self.number:
            self.say(facts.ended(report), now)
        elif report.plan > self.number:
            self._early.append(report)

    # ------------------------------------------------------------ time passes

    def tick(self, heard: WhenHeard, whereabouts: Whereabouts, now: Time) -> None:
        """Look, once a world tick, who is silent and who is not any more."""
        if self.succession.judge(heard, now):
            self._followed(now)
        self.rumours.tick(self.succession, heard, now)
        self._here_m = whereabouts.x_m, whereabouts.y_m
        play = self.play
        if play is None:
            return
        if not play.over:
            play.whereabouts(whereabouts, now)
        if self.leads:
            self._call_the_roll(play, heard, now)
        if self._meeting.due(now):
            self._reunite(play, heard, now)

    def advance(self, now: Time) -> None:
        """Act on all deadlines, and pass on what the executive wants."""
        if self.play is not None and self.play.executive is not None:
            self.play.wake(now)
            if not self._meeting.called:
                self.dispatch.advance(self.play, self.leads, self.succession.term, now)

    def _reunite(self, play: Play, heard: WhenHeard, now: Time) -> None:
        """End what two hosts have led at once, or without one who is back, and begin again together."""
        ledger = play.ledger
        plan = reunited(ledger.plan, self.newest + 1, play.past())
        if plan is None:
            self._meeting.held_in_vain(self.number)
        else:
            self.succession.since, starts_m = now, {**self._others.places_m, self.me: self._here_m}
            self.execute(plan, starts_m, ledger.calls, now, self._roll.still_lost(ledger.lost, heard, now))

    # ------------------------------------------------------------ who is there

    def _call_the_roll(self, play: Play, heard: WhenHeard, now: Time) -> None:
        """Say who is lost, and who is there again; one that has no part in the play any more brings all together."""
        over = play.over
        for fact in self._roll.call(play.ledger.lost, heard, now, over or self._meeting.called):
            self.say(fact, now)
            if not fact.again:
                self.mail.forget(fact.robot, now)
        if (over or is_reunited(play.ledger.plan)) and any(map(play.misses, play.ledger.found)):
            self._meeting.call(self.number, now)

    def _followed(self, now: Time) -> None:
        """Be led by another host than before, or be it."""
        succession = self.succession
        succession.since = now
        self._meeting.off()
        self.rumours.over = False
        self.dispatch.clear()
        self.changes += 1
        self._note(events.HostChanged(succession.host, succession.why))
        if succession.leads:
            self._counters.successions += 1
            if self.play is not None:
                self._run(self.play, now)
        elif self.play is not None and self._central:
            self.play.rest()

    # ------------------------------------------------------------ what is known of the play

    def _told(self, source: Address, told: Told, now: Time) -> None:
        """Take a plan: a later one, or the host's own."""
        plan, own = told.record.plan, self.number
        claims = plan.number > own and source == told.host != self.succession.host
        if claims and self.succession.claimed(source, self.succession.term, plan.number, own):
            self._followed(now)
        if self.play is not None and self.play.ledger.of(told.record):
            self.play.add(told.record.facts, now)
        elif plan.number > own or (plan.number == own and source == self.succession.host):
            self._take(told, now)

    def _take(self, told: Told, now: Time) -> None:
        self.play = play = Play(told, self._parameters, self._setup)
        plan = play.ledger.plan
        self._meeting.off()
        self.rumours.over = False
        self._note(events.PlanTaken(plan.number, plan.play, len(plan.robots)))
        self.dispatch.gossip.clear()
        if self.leads:
            self._note(events.PlanBegun(plan.number, plan.robots, tuple(ends_m(plan.root).values())))
        if self.leads or not self._central:
            self._run(play, now)
        early, self._early = self._early, []
        for report in early:
            self.report(report, now)

    def _run(self, play: Play, now: Time) -> None:
        if play.executive is None:
            play.run([news.whereabouts(robot) for robot, (news, _) in sorted(self._others.news.items())], now)

    def _post_all(self, letter: Letter, now: Time) -> None:
        """Post to all who are not lost: those are told by the gossip once they are found."""
        lost = frozenset() if self.play is None else self.play.ledger.lost
        for robot in self._team:
            if robot not in lost:
                self.mail.post(robot, letter, now)
