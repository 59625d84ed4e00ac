"""A searcher: visits the posts that its host has given it, and sees to it that its host learns what it finds.

At each tick it looks around, decides what it is about (see ``errands``), and walks. In contact with its host, which is
for ``fresh_s`` after each of its heartbeats, it answers them: with what the host does not know yet, and with what it
has itself, so that the host sends what it lacks. One that lacks nothing says only now and then that it lives.

Paper 002 contradicts itself on SRP: by section III.A a searcher goes to the rally point with its first find, by VII.B
finds wait for "the static integration time"; ``report`` chooses. Either way it stops where the radio connects, and goes
on with what is left of its tour once it has a receipt; only who has nothing left waits there.
"""

import math
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from cosim.geometry.planning import Point
from cosim.machine import Address, Command, Drains, LinkEvent, Reception, next_state
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.aggregation.counters import Counters
from protocols.aggregation.events import ErrandChanged, HostFailed, Joined, TargetFound
from protocols.aggregation.findings import Camera, Findings, Reports
from protocols.aggregation.frames import CLOCK_MS
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
from protocols.aggregation.radio import Radio
from protocols.aggregation.rendezvous import Rendezvous
from protocols.aggregation.roster import Membership
from protocols.aggregation.setup import Setup
from protocols.aggregation.touring import Legs
from protocols.detection.incarnations import Incarnation

GREETING_BEATS = 5
"""A searcher that lacks nothing says hello at every so many heartbeats."""


class Errand(StrEnum):
    """What a searcher does."""

    SEARCH = "search"
    """Visit the posts of its tour, or stroll."""
    MEET = "meet"
    """Get into radio contact with its host, and report."""
    WAIT = "wait"
    """Stay in contact, until there is something to do."""
    CHANGE = "change"
    """Find another host, and join its sub-team."""
    STOP = "stop"
    """The task is over."""


class Turn(StrEnum):
    """What happens to a searcher that makes it do something else."""

    FOUND = "found"
    """It has found a target that its host does not know, and is to tell it at once."""
    DONE = "done"
    """Its tour is finished."""
    DUE = "due"
    """The time to meet has come: the period's end, or the time-out."""
    TOLD = "told"
    """The host knows all that it has to tell, and there is work left."""
    IDLE = "idle"
    """The same, but there is nothing to do before the host says so."""
    WORK = "work"
    """There is something to do again."""
    ALONE = "alone"
    """Out of contact while it should wait."""
    FAILED = "failed"
    """Its host has failed, as far as it can tell."""
    JOINED = "joined"
    """Another host has confirmed."""
    HEARD = "heard"
    """The host that it had given up is there after all."""
    OVER = "over"
    """A host says that all targets are known."""


_S, _M, _W, _C = Errand.SEARCH, Errand.MEET, Errand.WAIT, Errand.CHANGE

TABLE: Final = MappingProxyType(
    {
        (_S, Turn.FOUND): (None, _M),
        (_S, Turn.DONE): (None, _M),
        (_S, Turn.DUE): (None, _M),
        (_S, Turn.JOINED): (None, _S),
        (_M, Turn.TOLD): (None, _S),
        (_M, Turn.IDLE): (None, _W),
        (_M, Turn.FAILED): (None, _C),
        (_M, Turn.JOINED): (None, _M),
        (_W, Turn.WORK): (None, _S),
        (_W, Turn.ALONE): (None, _M),
        (_W, Turn.JOINED): (None, _W),
        (_C, Turn.JOINED): (None, _M),
        (_C, Turn.HEARD): (None, _M),
        (_C, Turn.FAILED): (None, _C),
        **{(errand, Turn.OVER): (None, Errand.STOP) for errand in Errand},
    }
)


def next_errand(errand: Errand, turn: Turn) -> Errand:
    """Return what a searcher does after a *turn*; raise LocalProtocolError for one that things cannot take then."""
    following: Errand = next_state(TABLE, errand, turn)[1]
    return following


class Searcher(Drains):
    """The machine of a searcher. It lives on observations and on what it hears, and has no deadlines."""

    def __init__(
        self, parameters: Parameters, setup: Setup, me: Address, legs: Legs, start: Time, booted: bool
    ) -> None:
        """Begin in the sub-team that everybody knows, or, having *booted* again, in none."""
        super().__init__()
        self.me = me
        self.counters = Counters(setup.tick)
        self.findings = Findings()
        self.parameters = parameters
        self.setup = setup
        self.errand = Errand.WAIT
        self.membership = Membership(None if booted else setup.host_of(me), 0)
        self._radio = Radio(me, self.counters, self._outbox, self._events)
        self._reports = Reports(self.findings, len(setup.ground.posts_m))
        self._camera = Camera(setup.targets_m, parameters.camera_m)
        self._legs = legs
        self._posts = len(setup.ground.posts_m)
        self._hosts = setup.hosts
        self._rendezvous = Rendezvous(parameters, self.membership, legs, setup.speeds_mps[me])
        self._fresh = from_seconds(parameters.fresh_s)
        self._lost = from_seconds(parameters.lost_s)
        self._muster = start + from_seconds(parameters.muster_s)
        self._timeout = from_seconds(parameters.timeout_s_per_m2 * setup.area_m2 / max(len(setup.targets_m), 1))
        self._reconvene = from_seconds(parameters.reconvene_s)
        self._assignment = 0
        self._heard = start
        """When the own host was heard last; at the start all are in contact."""
        self._incarnation = Incarnation(from_seconds(parameters.heartbeat_s), CLOCK_MS)
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
        heard = self._radio.receive(data, reception)
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
                if self._incarnation.is_new(message.number, message.stamp_ms):
                    self._tell_anew()
                self._rendezvous.heard(now)
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

    # ------------------------------------------------------------ talking

    def _answer(self, host: Address, beat: Heartbeat, now: Time) -> None:
        """Answer a heartbeat: the own host's with what is new, another's if it is wanted, or was left."""
        if self._here is None:  # just booted: it does not know where it is
            return
        ours = self.membership
        if host == ours.host:
            if self._reports.pending and not self._over:
                self._radio.send(self._reports.make(ours.epoch), host)
            lacks = self._legs.done or beat.plan != ours.plans or beat.syncing or beat.over
            if lacks or now - self._greeted >= self._greeting:
                self._greeted = now
                self._radio.send(Hello(ours.epoch, *self._here, self._assignment, ours.plans), host)
            return
        if ours.leaves(host):
            self._radio.send(Leave(ours.epoch), host)
        forgotten = now - self._heard > self._lost  # for so long that its host has struck it off
        orphaned = ours.host is None or forgotten or (ours.host in beat.silent and not self._in_contact(now))
        if not self._over and (self.errand is Errand.CHANGE or orphaned or beat.over):
            self._radio.send(Join(ours.ask(host, now), *self._here), host)

    def _confirmed(self, host: Address, epoch: int, now: Time) -> None:
        if not self.membership.confirmed(host, epoch):
            return
        self.counters.joins.append(self.counters.told(now))
        self._events.append(Joined(host, epoch))
        self._heard = now
        self._incarnation = Incarnation(from_seconds(self.parameters.heartbeat_s), CLOCK_MS)
        self._tell_anew()
        self._rendezvous.joined()
        if not self._over:
            self._follow(Turn.JOINED, now)

    def _tell_anew(self) -> None:
        """Tell the host everything, and have it tell everything."""
        self._reports.anew()
        self._assignment = self.membership.plans = 0

    def _stop(self, host: Address, now: Time) -> None:
        """Stop, and say so, however often it is asked."""
        self._radio.send(Stopped(), host)
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
        return Turn.FAILED if self._rendezvous.failed(observation, now) else None

    def _turn_of_waiting(self, now: Time) -> Turn | None:
        if not self._in_contact(now):
            return Turn.ALONE
        return None if self._legs.done or self._due(now) or now < self._muster else Turn.WORK

    def _turn_of_change(self, observation: Observation, now: Time) -> Turn | None:
        if self._in_contact(now):
            return Turn.HEARD
        return Turn.FAILED if self._rendezvous.failed(observation, now) else None

    def _follow(self, turn: Turn, now: Time) -> None:
        """Change the errand, and begin what it demands."""
        if turn is Turn.FAILED and self._rendezvous.host is not None:
            self.counters.failures.append((self._rendezvous.host, self.counters.told(now)))
            self._events.append(HostFailed(self._rendezvous.host))
        before, self.errand = self.errand, next_errand(self.errand, turn)
        if self.errand is not before or turn is Turn.FAILED:
            self._events.append(ErrandChanged(self.errand.value, turn.value))
        if self.errand is Errand.MEET:
            self._rendezvous.to_own_host(now)
        elif self.errand is Errand.CHANGE:
            self._rendezvous.to_another(now)

    # ------------------------------------------------------------ walking

    def _walk(self, observation: Observation, now: Time) -> Command | None:
        if self.errand is Errand.SEARCH:
            return self._legs.search(observation)
        if self.errand in (Errand.MEET, Errand.CHANGE) and not self._in_contact(now):
            return self._rendezvous.step(observation, now)
        return self._legs.stand(observation)
