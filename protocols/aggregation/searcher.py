"""A searcher: visits the posts that its host has given it, and reports to its host what it finds.

At each tick it looks around, finds its state by ``TABLE``, and walks. In contact with its host, that is for ``fresh_s``
after each of the host's heartbeats, it answers the heartbeats: with what the host does not know yet, and with what it
has itself, so that the host sends what it lacks. One that lacks nothing sends a Hello only now and then.

Paper 002 contradicts itself on SRP: by section III.A a searcher goes to the rally point with its first find, by VII.B
"the robots have to wait until the static integration time to inform the detection"; ``report`` chooses. That time is
when the area is done (``area``), or an instant that all know beforehand (``appointed``). In any case the searcher stops
where the radio connects, and goes on with what is left of its tour once it has a receipt.

A searcher that has nothing left waits there. So it does before the appointed time, too: it "moves to the rally point as
soon as it finishes its searching area" (III.A), and what has to wait is "to inform the detection" (VII.B). Where it has
been it tells at once, since "dynamic task allocation is required for each host" (VI.A): it may be given another area.
At the appointed time those who are out of contact go to the rally point, whatever they have found; from then on all is
as with ``area``.
"""

from enum import StrEnum
from types import MappingProxyType
from typing import Final

from cosim.geometry.planning import Point
from cosim.machine import Address, Command, Drains, LinkEvent, Reception, next_state
from cosim.observation import Observation
from cosim.protocol import Belief
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
from protocols.aggregation.radio import Radio, links_of
from protocols.aggregation.rendezvous import Rendezvous
from protocols.aggregation.roster import Membership
from protocols.aggregation.setup import Setup
from protocols.aggregation.streaming import Stream
from protocols.aggregation.touring import Motion
from protocols.detection.incarnations import Incarnation
from protocols.localization.positioning import Positioning

GREETING_BEATS = 5
"""Number of heartbeats after which a searcher that lacks nothing sends a Hello."""


class State(StrEnum):
    """What a searcher is doing."""

    SEARCH = "search"
    """Visit the posts of its tour, or walk at random."""
    MEET = "meet"
    """Get into radio contact with its host, and report."""
    WAIT = "wait"
    """Stay in contact, until there is something to do."""
    CHANGE = "change"
    """Find another host, and join its sub-team."""
    STOP = "stop"
    """The task is over."""


class Input(StrEnum):
    """What happens to a searcher and may change its state.

    Which inputs occur depends on the strategy: only a finder of the mobile integrator meets its host, the mobile rally
    point calls all searchers when its period is over, a time-out calls those that have been alone for long.
    """

    FOUND = "found"
    """It has found a target that its host does not know, and is to report it at once."""
    DONE = "done"
    """Its tour is finished."""
    DUE = "due"
    """The time to meet has come: the period's end, or the time-out."""
    TOLD = "told"
    """The host has all its reports, and there is work left."""
    IDLE = "idle"
    """The host has all its reports, and there is no work before the host assigns some."""
    WORK = "work"
    """There is work again."""
    ALONE = "alone"
    """Out of contact while it should wait."""
    FAILED = "failed"
    """It suspects its host."""
    JOINED = "joined"
    """Another host has confirmed."""
    HEARD = "heard"
    """The host that it had given up is there after all."""
    OVER = "over"
    """A host has reported that all targets are known."""


_S, _M, _W, _C = State.SEARCH, State.MEET, State.WAIT, State.CHANGE

TABLE: Final = MappingProxyType(
    {
        (_S, Input.FOUND): (None, _M),
        (_S, Input.DONE): (None, _M),
        (_S, Input.DUE): (None, _M),
        (_S, Input.JOINED): (None, _S),
        (_M, Input.TOLD): (None, _S),
        (_M, Input.IDLE): (None, _W),
        (_M, Input.FAILED): (None, _C),
        (_M, Input.JOINED): (None, _M),
        (_W, Input.WORK): (None, _S),
        (_W, Input.ALONE): (None, _M),
        (_W, Input.JOINED): (None, _W),
        (_C, Input.JOINED): (None, _M),
        (_C, Input.HEARD): (None, _M),
        (_C, Input.FAILED): (None, _C),
        **{(state, Input.OVER): (None, State.STOP) for state in State},
    }
)
"""(state, input) -> (None, next state), for all strategies."""


class Searcher(Drains):
    """The machine of a searcher. It acts on observations and on messages, and has no deadlines."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        positioning: Positioning,
        motion: Motion,
        start: Time,
        rebooted: bool,
    ) -> None:
        """Begin in the sub-team that all robots know; a searcher that was *rebooted* begins in none."""
        super().__init__()
        self.me = me
        self.counters = Counters(setup.tick)
        self.findings = Findings()
        self.parameters = parameters
        self.setup = setup
        self.positioning = positioning
        self.state = State.WAIT
        self.membership = Membership(None if rebooted else setup.host_of(me), 0)
        links = links_of(parameters, setup.size, me, start)
        self._radio = Radio(me, self.counters, self._outbox, self._events, links)
        self._stream: Stream | None = None
        if parameters.stream_bytes_per_s:
            self._stream = Stream(parameters.stream_bytes_per_s, setup.tick, self._radio)
        self._reports = Reports(self.findings, len(setup.ground.posts_m))
        self._camera = Camera(setup.targets_m, parameters.camera_m)
        self._motion = motion
        self._posts = len(setup.ground.posts_m)
        self._hosts = setup.hosts
        self._rendezvous = Rendezvous(parameters, self.membership, motion, setup.speeds_mps[me])
        self._fresh = from_seconds(parameters.fresh_s)
        self._lost = from_seconds(parameters.lost_s)
        self._muster = start + from_seconds(parameters.muster_s)
        strategy = parameters.strategy
        self._times_out, self._reconvenes = strategy == "mito", strategy == "mrp"
        self._tells = strategy in ("mi", "mito", "random") or (strategy == "srp" and parameters.report == "first")
        """True if a target that was found is reported at once."""
        self._timeout = from_seconds(parameters.timeout_s_per_m2 * setup.area_m2 / max(len(setup.targets_m), 1))
        self._reconvene = from_seconds(parameters.reconvene_s)
        self._appointed: Time | None = None
        """SRP's static integration time, until the searcher has met its host then; None if there is none."""
        if setup.integration_s is not None:
            self._appointed = from_seconds(setup.integration_s)  # by the team's clock, also for who is rebooted later
            self._reports.withholds = True
        self._assignment = 0
        self._heard = start
        """Instant of the own host's last heartbeat; at the start all are in contact."""
        self._incarnation = Incarnation(from_seconds(parameters.heartbeat_s), CLOCK_MS)
        self._greeting = from_seconds(GREETING_BEATS * parameters.heartbeat_s)
        self._greeted = start - self._greeting
        """Instant of the last Hello."""
        self._here: Point | None = None
        self._over = False

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """True if it has received that the task is over."""
        return self._over

    def believed(self) -> Belief:
        """Return where it means to go, for who looks on."""
        way = self._motion.ahead_m
        return Belief(None, way, way[-1] if way else None, self.positioning.estimate, "world")

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Process a message of a host; ignore those of other searchers. Return whether anything has come of it."""
        heard = self._radio.receive(data, reception)
        if heard is None:
            return self.left()
        sender, message = heard
        if sender >= self._hosts:
            return False
        if sender == self.membership.host:
            self._receive_from_host(message, now)
        match message:
            case Heartbeat():
                self._answer(sender, message, now)
            case Plans():
                self.membership.learn(sender, message, now)
            case Confirm(epoch=epoch):
                self._confirmed(sender, epoch, now)
            case Stop():
                self._stop(sender, now)
        return self.left()

    def _receive_from_host(self, message: Message, now: Time) -> None:
        """Process what only the own host may send."""
        match message:
            case Heartbeat():
                self.counters.contacts += now - self._heard > self._fresh
                self._heard = now
                if self._incarnation.is_new(message.number, message.stamp_ms):
                    self._start_over()
                self._rendezvous.heard(now)
            case Leave(epoch=epoch) if epoch == self.membership.epoch:
                self.membership.host = None
            case Receipt(number=number):
                self._reports.received(number)
            case Assign(epoch=epoch, number=number, posts=posts) if epoch == self.membership.epoch:
                self._assignment = number
                todo = [post for post in posts if post < self._posts and post not in self.findings.visited]
                self._motion.assign(todo)

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Take an event of a link, if the radio needs links; the search itself relies on messages only."""
        return self._radio.link(event, now)

    def observe(self, observation: Observation, now: Time) -> bool:
        """Look around, decide, and walk; return whether anything has come of it."""
        self.counters.moved((observation.x_m, observation.y_m), now)
        self._radio.keep_links(now)
        observation = self.positioning.locate(observation)
        here = self._here = observation.x_m, observation.y_m
        if found := self._camera.look(observation, self.findings):
            self._events += [TargetFound(*finding) for finding in self.findings.add(found)]
        if self._motion.reached is not None:
            (seen,) = observation.sees([here])  # False if a fault has switched the camera off
            if seen:
                self.findings.visit((self._motion.reached,))
            self._motion.next(seen)
        self._integrate(now)
        if not self._over:
            self._decide(observation, now)
            host = self.membership.host
            if self._stream is not None and host is not None and self._in_contact(now):
                self._stream.flow(host)
        command = self.positioning.order(self._walk(observation, now), observation)
        if command is not None:
            self._commands.append(command)
        return self.left()

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None."""
        return None

    # ------------------------------------------------------------ sending

    def _answer(self, host: Address, beat: Heartbeat, now: Time) -> None:
        """Answer a heartbeat: the own host's with a report and a Hello, another's with a Leave or a Join."""
        if self._here is None:  # just rebooted: it does not know where it is
            return
        ours = self.membership
        if host == ours.host:
            if self._reports.pending and not self._over:
                self._radio.send(self._reports.make(ours.epoch), host)
            lacks = self._motion.done or beat.plan != ours.plans or beat.syncing or beat.over
            if lacks or now - self._greeted >= self._greeting:
                self._greeted = now
                self._radio.send(Hello(ours.epoch, *self._here, self._assignment, ours.plans), host)
            return
        if ours.leaves(host):
            self._radio.send(Leave(ours.epoch), host)
        forgotten = now - self._heard > self._lost  # its host has removed it by now
        orphaned = ours.host is None or forgotten or (ours.host in beat.silent and not self._in_contact(now))
        if not self._over and (self.state is _C or orphaned or beat.over):
            self._radio.send(Join(ours.ask(host, now), *self._here), host)

    def _confirmed(self, host: Address, epoch: int, now: Time) -> None:
        if not self.membership.confirmed(host, epoch):
            return
        self.counters.joins.append(self.counters.true_time(now))
        self._events.append(Joined(host, epoch))
        self._heard = now
        self._incarnation = Incarnation(from_seconds(self.parameters.heartbeat_s), CLOCK_MS)
        self._start_over()
        self._rendezvous.joined()
        if not self._over:
            self._follow(Input.JOINED, now)

    def _start_over(self) -> None:
        """Exchange everything with the host again: report all, and have it send all."""
        self._reports.reset()
        self._assignment = self.membership.plans = 0

    def _stop(self, host: Address, now: Time) -> None:
        """Stop, and confirm each request to do so."""
        self._radio.send(Stopped(), host)
        if not self._over:
            self._over = True
            self.counters.stopped_at = self.counters.true_time(now)
            self._follow(Input.OVER, now)

    # ------------------------------------------------------------ deciding

    def _in_contact(self, now: Time) -> bool:
        return self.membership.host is not None and now - self._heard <= self._fresh

    def _integrate(self, now: Time) -> None:
        """Keep no finds back from the appointed time on; that is over once the host has everything."""
        if self._appointed is not None and now >= self._appointed:
            self._reports.withholds = False
            if self._in_contact(now) and not self._reports.pending:
                self._appointed = None

    def _due(self, now: Time) -> bool:
        """Return whether it is time to meet the host, with or without findings."""
        if self._appointed is not None:
            return now >= self._appointed
        if self._times_out:
            armed = self.parameters.timeout_armed == "always" or bool(self.findings.targets)
            return armed and now - self._heard > self._timeout
        if self._reconvenes:
            host, courses = self.membership.host, self.membership.courses
            return host in courses and now >= courses[host].departed + self._reconvene
        return False

    def _decide(self, observation: Observation, now: Time) -> None:
        """Find the input of this tick, if there is one, and follow it."""
        state = self.state
        if state is _S:
            event = self._input_of_search(now)
        elif state is _M:
            event = self._input_of_meeting(observation, now)
        elif state is _W:
            event = self._input_of_waiting(now)
        else:
            event = self._input_of_change(observation, now)
        if event is not None:
            self._follow(event, now)

    def _input_of_search(self, now: Time) -> Input | None:
        if self._due(now):
            return Input.DUE
        if self._tells and self._reports.finds and not self._in_contact(now):
            return Input.FOUND
        return Input.DONE if self._motion.done else None

    def _input_of_meeting(self, observation: Observation, now: Time) -> Input | None:
        if self._in_contact(now):
            if self._reports.pending:
                return None
            return Input.IDLE if self._motion.done or self._due(now) else Input.TOLD
        return Input.FAILED if self._rendezvous.failed(observation, now) else None

    def _input_of_waiting(self, now: Time) -> Input | None:
        if not self._in_contact(now):
            return Input.ALONE
        return None if self._motion.done or self._due(now) or now < self._muster else Input.WORK

    def _input_of_change(self, observation: Observation, now: Time) -> Input | None:
        if self._in_contact(now):
            return Input.HEARD
        return Input.FAILED if self._rendezvous.failed(observation, now) else None

    def _follow(self, event: Input, now: Time) -> None:
        """Change the state, and begin what it demands."""
        if event is Input.FAILED and self._rendezvous.host is not None:
            self.counters.failures.append((self._rendezvous.host, self.counters.true_time(now)))
            self._events.append(HostFailed(self._rendezvous.host))
        before = self.state
        _, self.state = next_state(TABLE, before, event)
        if self.state is not before or event is Input.FAILED:
            self._events.append(ErrandChanged(self.state.value, event.value))
        if self.state is State.MEET:
            self._rendezvous.to_own_host(now)
        elif self.state is State.CHANGE:
            self._rendezvous.to_another(now)

    # ------------------------------------------------------------ walking

    def _walk(self, observation: Observation, now: Time) -> Command | None:
        state = self.state
        if state is _S:
            return self._motion.search(observation)
        if (state is _M or state is _C) and not self._in_contact(now):
            return self._rendezvous.step(observation, now)
        return self._motion.stand(observation)
