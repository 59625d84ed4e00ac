"""A searcher: visits the posts that its host has given it, and sees to it that its host learns what it finds.

At each tick it looks around, decides what it is about (see ``errands``), and walks. In contact with its host, which is
for ``fresh_s`` after each of its heartbeats, it answers them: with what the host does not know yet, and with what it
has itself, so that the host sends what it lacks. One that lacks nothing says only now and then that it lives.

Paper 002 contradicts itself on SRP: by section III.A a searcher goes to the rally point with its first find, by VII.B
finds wait for "the static integration time"; ``report`` chooses. Either way it stops where the radio connects, and goes
on with what is left of its tour once it has a receipt; only who has nothing left waits there.
"""

import math

from cosim.geometry.planning import Point
from cosim.machine import Address, Command, Event, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.aggregation.counters import Counters
from protocols.aggregation.errands import Errand, Turn, next_errand
from protocols.aggregation.events import ErrandChanged, HostFailed, Joined, TargetFound
from protocols.aggregation.findings import Camera, Findings
from protocols.aggregation.lives import Life
from protocols.aggregation.membership import Membership
from protocols.aggregation.messages import (
    Assign,
    Confirm,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Message,
    Plans,
    Receipt,
    Stop,
    Stopped,
)
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.pursuit import Pursuit
from protocols.aggregation.reports import Reports
from protocols.aggregation.setup import Setup
from protocols.aggregation.speech import Speech
from protocols.aggregation.touring import Legs

GREETING_BEATS = 5
"""A searcher that lacks nothing says hello at every so many heartbeats."""


class Searcher:
    """The machine of a searcher. It lives on observations and on what it hears, and has no deadlines."""

    def __init__(
        self, parameters: Parameters, setup: Setup, me: Address, legs: Legs, start: Time, booted: bool
    ) -> None:
        """Begin in the sub-team that everybody knows, or, having *booted* again, in none."""
        self.me = me
        self.counters = Counters(setup.tick)
        self.findings = Findings()
        self.parameters = parameters
        self.setup = setup
        self.errand = Errand.WAIT
        self.membership = Membership(None if booted else setup.host_of(me), 0)
        self._events: list[Event] = []
        self._commands: list[Command] = []
        self._speech = Speech(me, self.counters, self._events)
        self._reports = Reports(self.findings, len(setup.ground.posts_m))
        self._camera = Camera(setup.targets_m, parameters.camera_m)
        self._legs = legs
        self._posts = len(setup.ground.posts_m)
        self._hosts = setup.hosts
        self._pursuit = Pursuit(parameters, self.membership, legs, setup.speeds_mps[me])
        self._fresh = from_seconds(parameters.fresh_s)
        self._lost = from_seconds(parameters.lost_s)
        self._muster = start + from_seconds(parameters.muster_s)
        self._timeout = from_seconds(parameters.timeout_s_per_m2 * setup.area_m2 / max(len(setup.targets_m), 1))
        self._reconvene = from_seconds(parameters.reconvene_s)
        self._assignment = 0
        self._heard = start
        """When the own host was heard last; at the start all are in contact."""
        self._life = Life(from_seconds(parameters.heartbeat_s))
        self._greeting = from_seconds(GREETING_BEATS * parameters.heartbeat_s)
        self._greeted = start - self._greeting
        """When it has said hello to it last."""
        self._here: Point | None = None
        self._over = False

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """Whether it has been told that the task is over."""
        return self._over

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a message of a host; others mean nothing to a searcher."""
        heard = self._speech.hear(data, reception)
        if heard is None or heard[0] >= self._hosts:
            return
        sender, message = heard
        if sender == self.membership.host:
            self._listen(message, now)
        match message:
            case Heartbeat():
                self._answer(sender, message, now)
            case Plans():
                self.membership.learn(sender, message, now)
            case Confirm(epoch=epoch):
                self._confirmed(sender, epoch, now)
            case Stop():
                self._stop(sender, now)

    def _listen(self, message: Message, now: Time) -> None:
        """Take what only the own host may say."""
        match message:
            case Heartbeat():
                self.counters.contacts += now - self._heard > self._fresh
                self._heard = now
                if self._life.anew(message):
                    self._tell_anew()
                self._pursuit.heard(now)
            case Leave(epoch=epoch) if epoch == self.membership.epoch:
                self.membership.host = None
            case Receipt(number=number):
                self._reports.received(number)
            case Assign(epoch=epoch, number=number, posts=posts) if epoch == self.membership.epoch:
                self._assignment = number
                todo = [post for post in posts if post < self._posts and post not in self.findings.visited]
                self._legs.assign(todo)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take no notice: what counts is said by hosts, not by radios."""

    def observe(self, observation: Observation, now: Time) -> None:
        """Look around, decide, and walk."""
        here = observation.x_m, observation.y_m
        self.counters.moved(0.0 if self._here is None else math.dist(here, self._here), now)
        self._here = here
        for finding in self.findings.add(self._camera.look(observation, self.findings)):
            self._events.append(TargetFound(*finding))
        if self._legs.reached is not None:
            (seen,) = observation.sees([here])  # not if a fault has switched the camera off
            if seen:
                self.findings.visit((self._legs.reached,))
            self._legs.next(seen)
        if not self._over:
            self._decide(observation, now)
        command = self._walk(observation, now)
        if command is not None:
            self._commands.append(command)

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None."""
        return None

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain messages."""
        return self._speech.drain()

    def commands(self) -> list[Command]:
        """Drain motion commands."""
        commands, self._commands = self._commands, []
        return commands

    def events(self) -> list[Event]:
        """Drain rows for the trace."""
        if not self._events:
            return []
        events = self._events.copy()
        self._events.clear()
        return events

    # ------------------------------------------------------------ talking

    def _answer(self, host: Address, beat: Heartbeat, now: Time) -> None:
        """Answer a heartbeat: the own host's with what is new, another's if it is wanted, or was left."""
        if self._here is None:  # just booted: it does not know where it is
            return
        ours = self.membership
        if host == ours.host:
            if self._reports.pending and not self._over:
                self._speech.say(self._reports.make(ours.epoch), host)
            lacks = self._legs.done or beat.plan != ours.plans or beat.syncing or beat.over
            if lacks or now - self._greeted >= self._greeting:
                self._greeted = now
                self._speech.say(Hello(ours.epoch, *self._here, self._assignment, ours.plans), host)
            return
        if ours.leaves(host):
            self._speech.say(Leave(ours.epoch), host)
        forgotten = now - self._heard > self._lost  # for so long that its host has struck it off
        orphaned = ours.host is None or forgotten or (ours.host in beat.silent and not self._in_contact(now))
        if not self._over and (self.errand is Errand.CHANGE or orphaned or beat.over):
            self._speech.say(Join(ours.ask(host, now), *self._here), host)

    def _confirmed(self, host: Address, epoch: int, now: Time) -> None:
        if not self.membership.confirmed(host, epoch):
            return
        self.counters.joins.append(self.counters.told(now))
        self._events.append(Joined(host, epoch))
        self._heard, self._life = now, Life(from_seconds(self.parameters.heartbeat_s))
        self._tell_anew()
        self._pursuit.joined()
        if not self._over:
            self._follow(Turn.JOINED, now)

    def _tell_anew(self) -> None:
        """Tell the host everything, and have it tell everything."""
        self._reports.anew()
        self._assignment = self.membership.plans = 0

    def _stop(self, host: Address, now: Time) -> None:
        """Stop, and say so, however often it is asked."""
        self._speech.say(Stopped(), host)
        if not self._over:
            self._over = True
            self.counters.stopped_at = self.counters.told(now)
            self._follow(Turn.OVER, now)

    # ------------------------------------------------------------ deciding

    def _in_contact(self, now: Time) -> bool:
        return self.membership.host is not None and now - self._heard <= self._fresh

    def _due(self, now: Time) -> bool:
        """Return whether it is time to meet the host, whatever has been found."""
        match self.parameters.strategy:
            case "mito":
                return now - self._heard > self._timeout
            case "mrp":
                host, courses = self.membership.host, self.membership.courses
                return host in courses and now >= courses[host].departed + self._reconvene
        return False

    def _decide(self, observation: Observation, now: Time) -> None:
        """Find out whether something has happened that makes the robot do something else."""
        match self.errand:
            case Errand.SEARCH:
                turn = self._turn_of_search(now)
            case Errand.MEET:
                turn = self._turn_of_meeting(observation, now)
            case Errand.WAIT:
                turn = self._turn_of_waiting(now)
            case _:
                turn = self._turn_of_change(observation, now)
        if turn is not None:
            self._follow(turn, now)

    def _turn_of_search(self, now: Time) -> Turn | None:
        if self._due(now):
            return Turn.DUE
        strategy = self.parameters.strategy
        tells = strategy in ("mi", "mito", "random") or (strategy == "srp" and self.parameters.report == "first")
        if tells and self._reports.finds and not self._in_contact(now):
            return Turn.FOUND
        return Turn.DONE if self._legs.done else None

    def _turn_of_meeting(self, observation: Observation, now: Time) -> Turn | None:
        if self._in_contact(now):
            if self._reports.pending:
                return None
            return Turn.IDLE if self._legs.done or self._due(now) else Turn.TOLD
        return Turn.FAILED if self._pursuit.failed(observation, now) else None

    def _turn_of_waiting(self, now: Time) -> Turn | None:
        if not self._in_contact(now):
            return Turn.ALONE
        return None if self._legs.done or self._due(now) or now < self._muster else Turn.WORK

    def _turn_of_change(self, observation: Observation, now: Time) -> Turn | None:
        if self._in_contact(now):
            return Turn.HEARD
        return Turn.FAILED if self._pursuit.failed(observation, now) else None

    def _follow(self, turn: Turn, now: Time) -> None:
        """Change the errand, and begin what it demands."""
        if turn is Turn.FAILED and self._pursuit.host is not None:
            self.counters.failures.append((self._pursuit.host, self.counters.told(now)))
            self._events.append(HostFailed(self._pursuit.host))
        before, self.errand = self.errand, next_errand(self.errand, turn)
        if self.errand is not before or turn is Turn.FAILED:
            self._events.append(ErrandChanged(self.errand.value, turn.value))
        if self.errand is Errand.MEET:
            self._pursuit.to_own_host(now)
        elif self.errand is Errand.CHANGE:
            self._pursuit.to_another(now)

    # ------------------------------------------------------------ walking

    def _walk(self, observation: Observation, now: Time) -> Command | None:
        if self.errand is Errand.SEARCH:
            return self._legs.search(observation)
        if self.errand in (Errand.MEET, Errand.CHANGE) and not self._in_contact(now):
            return self._pursuit.step(observation, now)
        return self._legs.stand(observation)
