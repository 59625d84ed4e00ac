"""A host: leads its sub-team, gathers what the searchers report, and shares it with the other hosts.

It has two deadlines: its next heartbeat, and the instant at which the next of the other hosts will be suspected. Status
broadcasts among hosts are not acknowledged: they are sent with a few heartbeats after each change, and again whenever a
heartbeat shows that its sender knows less. A host that has been rebooted remembers nothing (paper 002 does not mention
that): the other hosts send it its last members, and its searchers report everything again.
"""

from functools import partial

from cosim.geometry.planning import Point
from cosim.machine import Address, Drains, LinkEvent, Reception
from cosim.observation import Observation
from cosim.protocol import Belief
from cosim.units import Time, from_seconds
from protocols.aggregation.counters import Counters
from protocols.aggregation.events import AllKnown, HostSuspected, HostTrusted, TargetKnown
from protocols.aggregation.findings import Findings
from protocols.aggregation.frames import COUNTS, bitmap, posts_in, stamp
from protocols.aggregation.itinerary import Itinerary
from protocols.aggregation.messages import (
    Finding,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Message,
    Plans,
    Report,
    Status,
    Stopped,
)
from protocols.aggregation.neighbours import Neighbours
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.radio import SHORT, Radio, links_of
from protocols.aggregation.setup import Setup
from protocols.aggregation.strategies import Strategy
from protocols.aggregation.subteam import SubTeam, Work
from protocols.aggregation.touring import Mover
from protocols.detection.detectors import Detector, make_detector
from protocols.localization.positioning import Positioning

REPEATS = 3
"""Number of heartbeats with which a status broadcast is repeated, as it is not acknowledged."""


class Host(Drains):
    """The machine of a host."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        positioning: Positioning,
        mover: Mover,
        phase: Time,
        start: Time,
        rebooted: bool,
    ) -> None:
        """Send the first heartbeat *phase* after *start*; a host that was *rebooted* knows no members."""
        super().__init__()
        self.me = me
        self.counters = Counters(setup.tick)
        self.findings = Findings()
        self.over = False
        self.parameters = parameters
        self.setup = setup
        self.positioning = positioning
        self._posts = len(setup.ground.posts_m)
        self._period = from_seconds(parameters.heartbeat_s)
        links = links_of(parameters, setup.size, me, start)
        self._radio = Radio(me, self.counters, self._outbox, self._events, links)
        others = [host for host in range(setup.hosts) if host != me]
        self.neighbours = Neighbours(others, self._period, self._watching, start)
        self._here: Point = setup.starts_m[me]
        strategy, rally_m = Strategy(parameters, setup, me), partial(_rally_m, parameters, setup)
        work = Work(setup, me, rally_m, parameters.strategy == "random")
        self._itinerary = Itinerary(parameters, me, strategy, mover, self.neighbours, self._events, self._here, start)
        self.team = SubTeam(
            parameters, work, self.findings, self._radio, self._events, self.neighbours, self._itinerary
        )
        self._beats = 0
        self._beat_at = self._deadline = start + phase
        self._status_left = REPEATS
        self._plans_left = REPEATS
        self._announced = 0
        """Version of the plans that were announced last."""
        self._unplaced = rebooted
        if not rebooted:
            tours = self.team.begin(setup.searchers_of(me), parameters.strategy == "random", start)
            self._itinerary.depart(self._here, tours, start + from_seconds(parameters.muster_s))

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """True if the task is over and all searchers of the sub-team have reported that they have stopped."""
        return self.over and self.team.stopped

    def believed(self) -> Belief:
        """Return where it means to go, for who looks on."""
        return self._itinerary.believed()._replace(estimate=self.positioning.estimate, frame="world")

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Process a message of a searcher or of another host; return whether anything has come of it."""
        heard, deadline = self._radio.receive(data, reception), self._deadline
        if heard is None:
            return self.left()
        sender, message = heard
        if sender < self.setup.hosts:
            self._receive_from_host(sender, message, now)
        elif sender < self.setup.size:
            self._receive_from_searcher(sender, message, now)
        return self.left() or self._deadline != deadline

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Take an event of a link, if the radio needs links; the search itself relies on messages only."""
        return self._radio.link(event, now)

    def observe(self, observation: Observation, now: Time) -> bool:
        """Drive on, and begin or end a meeting when it is time; return whether anything has come of it."""
        self.counters.moved((observation.x_m, observation.y_m), now)
        self._radio.keep_links(now)
        observation = self.positioning.locate(observation)
        here = self._here = observation.x_m, observation.y_m
        if self._unplaced:  # rebooted: only now it knows where it is
            self._unplaced = False
            self._itinerary.depart(here, (), now)
        if self._itinerary.due(now) and self._itinerary.reconvened(self.team.missing(), here, now):
            self._status_left = REPEATS
        command = self.positioning.order(self._itinerary.step(observation, now), observation)
        if command is not None:
            self._commands.append(command)
        return self.left()

    def wake(self, now: Time) -> None:
        """Suspect hosts that have been silent for too long; send a heartbeat if it is time."""
        silent = self.neighbours.fall_silent(now)
        for host in silent:
            self.counters.failures.append((host, self.counters.true_time(now)))
            self._events.append(HostSuspected(host))
        if silent:
            self._status_left = REPEATS
            if self.neighbours.alone():
                self._itinerary.go_back(self._here, now)
        if now >= self._beat_at:
            self._beat(now)
        self._set_deadline()

    def wake_at(self) -> Time | None:
        """Return the instant of the next heartbeat or the next suspicion."""
        return self._deadline

    def _set_deadline(self) -> None:
        silence = self.neighbours.next_silence()
        self._deadline = self._beat_at if silence is None else min(self._beat_at, silence)

    def _watching(self, now: Time, began: Time) -> Detector:
        """Return a detector that watches from *now* on a host whose count of heartbeats began at *began*."""
        return make_detector(self.parameters.detector, self._period, now, began)

    # ------------------------------------------------------------ sending

    def _beat(self, now: Time) -> None:
        """Broadcast a heartbeat by both radios, and what has changed."""
        self._beat_at += self._period * (1 + (now - self._beat_at) // self._period)
        self.team.forget(now)
        self._follow_searchers(now)
        if self.team.changed:
            self.team.changed, self._status_left = False, REPEATS
        ways = self._itinerary
        if ways.version != self._announced:
            self._announced, self._plans_left, self._status_left = ways.version, REPEATS, REPEATS
        beat = self._heartbeat(now)
        self._radio.send(beat)
        if self._plans_left:
            self._plans_left -= 1
            self._radio.send(self._plans())
        if self.setup.hosts > 1:
            if self.parameters.long_radio != SHORT:  # robots with one radio have sent it already
                self._radio.send(beat, radio=self.parameters.long_radio)
            if self._status_left:
                self._status_left -= 1
                self._radio.send(self._status(), radio=self.parameters.long_radio)

    def _follow_searchers(self, now: Time) -> None:
        """Take a way amid the new tours at the end of a mobile integrator's way, if all searchers can be informed."""
        ways, ends_at = self._itinerary, self._itinerary.course.ends_at()
        over = ends_at is not None and now >= ends_at and not ways.astray
        if over and ways.integrates and self.team.reassigned and self.team.gathered(now):
            self.team.reassigned = False
            ways.depart(self._here, self.team.tours, now)

    def _heartbeat(self, now: Time) -> Heartbeat:
        ways, known = self._itinerary, self.findings
        number, self._beats = self._beats, (self._beats + 1) % (1 << 32)
        counts = ways.round % COUNTS, ways.version, len(known.targets), len(known.visited)
        flags = self.over, ways.syncing, ways.astray
        return Heartbeat(number, stamp(now), *self._here, *counts, *flags, self.neighbours.silent)

    def _plans(self) -> Plans:
        return Plans((self._itinerary.plan, *self.neighbours.plans()))

    def _status(self) -> Status:
        members = tuple((searcher, member.epoch) for searcher, member in sorted(self.team.roster.members.items()))
        visited = bitmap(self.findings.visited, self._posts)
        return Status(self.findings.all_targets(), visited, members, self._itinerary.plan)

    # ------------------------------------------------------------ receiving

    def _receive_from_searcher(self, searcher: Address, message: Message, now: Time) -> None:
        match message:
            case Hello():
                self.team.hello(searcher, message, self.over, self._plans, now)
            case Report():
                ours = self.team.report(searcher, message, now)
                new = self._learn(searcher, message.targets, message.visited, now)  # whichever host's member it is
                self.counters.reported += new if ours else 0
            case Join():
                self.team.join(searcher, message, self.over, now)
            case Leave(epoch=epoch):
                self.team.leave(searcher, epoch, "left")
            case Stopped():
                self.team.stop(searcher)

    def _receive_from_host(self, host: Address, message: Message, now: Time) -> None:
        match message:
            case Heartbeat():
                self._take_heartbeat(host, message, now)
            case Status(targets=targets, visited=visited, members=members, plan=plan):
                if plan.host == self.me:
                    self.team.recall(members, now)
                elif plan.host == host:
                    if self.neighbours.take_status(host, message):
                        self._itinerary.renew()
                    self.team.claimed(members)
                self._learn(host, targets, visited, now)

    def _take_heartbeat(self, host: Address, beat: Heartbeat, now: Time) -> None:
        if self.neighbours.take_heartbeat(host, beat, now):
            self._events.append(HostTrusted(host))
            self._status_left = REPEATS
            self._remind(host)
        silent_at = self.neighbours.hosts[host].detector.suspects_at()
        if silent_at is not None and silent_at < self._deadline:  # a later one is found at the next deadline
            self._deadline = max(silent_at, now)
        if beat.found < len(self.findings.targets) or beat.visited < len(self.findings.visited):
            self._status_left = max(self._status_left, 1)
        if self._itinerary.astray and not self.neighbours.alone():
            self._itinerary.found_back(self._here, self.team.tours, now)

    def _remind(self, host: Address) -> None:
        """Send a host that may have been rebooted its last members, as far as they are known."""
        one = self.neighbours.hosts[host]
        if one.plan is not None and one.members:
            visited = bitmap(self.findings.visited, self._posts)
            status = Status(self.findings.all_targets(), visited, tuple(sorted(one.members.items())), one.plan)
            self._radio.send(status, host, self.parameters.long_radio)

    def _learn(self, source: Address, targets: tuple[Finding, ...], visited: bytes, now: Time) -> int:
        """Add the findings of *source*, to be sent to the other hosts; return the number of new targets."""
        wanted = len(self.setup.targets_m)
        new = self.findings.add(finding for finding in targets if finding.number < wanted)
        grown = self.findings.visit(post for post in posts_in(visited) if post < self._posts)
        if new or grown:
            self._status_left = REPEATS
        self._events += [TargetKnown(finding.number, source) for finding in new]
        if not self.over and len(self.findings.targets) == wanted:
            self.over = True
            self.counters.known_at = self.counters.true_time(now)
            self._events.append(AllKnown(wanted))
        return len(new)


def _rally_m(parameters: Parameters, setup: Setup, host: Address) -> Point:
    """Return the rally point of *host*, as all hosts know it beforehand."""
    return Strategy(parameters, setup, host).rally_m
