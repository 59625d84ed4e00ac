"""The machine of one robot of a deployment: a member that drives, a host that may lead, a console, a transport.

These parts are joined only here: messages that arrive go to the host and the member, the executive's orders for this
robot go to the member, and the member's reports go to the host.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np

from cosim.errors import WireError
from cosim.machine import (
    OPERATOR,
    Address,
    Drains,
    Event,
    LinkCommand,
    LinkEvent,
    Outgoing,
    Reception,
    drained,
)
from cosim.observation import Observation
from cosim.protocol import Belief
from cosim.units import Time, from_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.driving.exploring import FIRST_TOPIC, TOPICS, Exploring
from protocols.deployment.driving.exploring_mover import ExploringMover
from protocols.deployment.driving.learned import floor_of
from protocols.deployment.member.member import Member
from protocols.deployment.messages import messages, status
from protocols.deployment.messages.messages import Letter, Look, Picture, YieldRequest
from protocols.deployment.messages.status import News
from protocols.deployment.operator.calls import Calls
from protocols.deployment.operator.console import Console
from protocols.deployment.operator.planning import Planning
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import Setup
from protocols.deployment.tasks.orders import Whereabouts
from protocols.deployment.team.host import Host
from protocols.localization.positioning import positioning_of
from protocols.localization.scan import Sensor
from protocols.mapping import frames
from protocols.transport.transport import Transport
from protocols.wire import BadBytes

MAP_TOPICS: Final = range(FIRST_TOPIC, FIRST_TOPIC + TOPICS)
"""Topics of status broadcasts that carry pieces of maps."""


class Runner(Drains):
    """One robot's machine."""

    def __init__(
        self, parameters: Parameters, setup: Setup, me: Address, start: Time, stream: np.random.Generator
    ) -> None:
        """Begin at *start*; only localisation, and the noise of a sonar, draw from *stream*."""
        super().__init__()
        self.me = me
        self.counters = Counters()
        floor = floor_of(setup.floors[me], parameters.map == "learned")
        if floor is not setup.floors[me]:
            setup = replace(setup, floor=floor, floors=(floor,) * setup.size)
        self._setup = setup
        self._start = start
        self._period = from_seconds(parameters.news_s)
        # spread over the period, so that the team's statuses do not collide
        self._next_news = start + self._period * me // setup.size
        body = setup.crew.bodies[me]
        limits = body.radius_m, body.speed_mps, body.acceleration_mps2
        note = self._events.append
        self.positioning = positioning_of(
            parameters.positioning,
            setup.maps,
            me,
            setup.floors[me].parameters.cell_m,
            _sensor(parameters, setup, me),
            stream,
            note,
        )
        self.transport = Transport(me, setup.size, parameters.carried, start)
        known = setup.ground, me, self.transport.publication_octets, floor
        self.exploring = Exploring(parameters.exploring, *known, body.sensor == "laser", note)
        mover = ExploringMover(self.exploring, floor, me, *limits, floor.parameters, setup.tick)
        if parameters.interference:
            mover.compare()
        self.member = Member(parameters.member, setup, me, mover, self.counters, note)
        self.host = Host(parameters, setup, me, self.member.others, self, note, self.counters, start)
        planning = Planning(parameters, setup, self.member, self.exploring, self._silent, self._heard)
        self.console = Console(planning, setup, self.host, self.member, self._heard, self._silent, note)
        self.calls = Calls(parameters, planning, self.host, note, self.counters, start)
        self._changes = 0
        """Number of changes of the host, as far as the member knows."""

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """True if all calls have been played, and the robot rests; never once an operator has sent anything."""
        return (
            self.calls.over
            and not self.host.busy
            and self.member.resting
            and not self.console.attended
            and self.transport.settled
        )

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a frame of another robot, or a request of the operator at this robot's console."""
        if reception.source == OPERATOR:
            self.console.request(data, now)
        else:
            self.transport.receive(data, reception, now)
        self._settle(now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link or the fate of a frame."""
        self.transport.link(event, now)
        self._settle(now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Drive on, look which robots are there, and broadcast the status when it is due."""
        observation = self.positioning.locate(observation)
        drive = self.member.step(observation, now)
        if drive is not None:
            self._commands.append(drive)
        for other, request in self.member.requests():
            self.post(other, request, now)
        for topic, payload in self.exploring.frames():
            self.transport.publish(topic, payload, now)
        for picture in self.member.camera.pictures(self.me, observation):
            self._show(picture, now)
        self.transport.tick(observation.visible, now)
        self.host.tick(self._heard, self._whereabouts(), now)
        self.calls.tick(now)
        if now >= self._next_news or now < self._next_news - self._period:
            self._next_news = now + self._period
            self.transport.publish(status.TOPIC, status.encode(self._news()), now)
        self._settle(now)

    def wake(self, now: Time) -> None:
        """Act on the transport's and the executive's deadlines."""
        self.transport.wake(now)
        self._settle(now)

    def wake_at(self) -> Time | None:
        """Return the earliest of these deadlines."""
        transport, host = self.transport.wake_at(), self.host.wake_at()
        if transport is None or host is None:
            return transport if host is None else host
        return min(transport, host)

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain frames, link commands, and messages to the operator."""
        out = self.transport.drain()
        return [*out, *(Outgoing(OPERATOR, said) for said in self.console.drain())]

    def events(self) -> list[Event]:
        """Drain rows for the trace, and events for the referee alone."""
        return [*super().events(), *drained(self.transport.bad)]

    def believed(self) -> Belief:
        """Return where it takes itself to be, where it means to go, and what it has learned of the floor."""
        explored = self.exploring.believed()
        leads = self.exploring.on
        way, goal = (explored.way_m, explored.goal_m) if leads else (self.member.way_m, self.member.goal_m)
        return Belief(explored.map, way, goal, self.positioning.estimate, "world")

    def rehearsal(self) -> list[dict[str, Any]]:
        """Return requests of an operator by which the team drives all over the floor, or explores a new one."""
        places = self._setup.far_m()
        explore = {"play": "explore", "parameters": {"robots": self._setup.size}}
        call = {"play": "deploy", "places": places} if places else explore
        return [{"request": 0, "say": "call", "call": call, "execute": True}]

    # ------------------------------------------------------------ messages

    def post(self, destination: Address, letter: Letter, now: Time) -> None:
        """Send a message reliably."""
        payload = messages.encode(letter)
        self.counters.letters += 1
        self.counters.letter_bytes += len(payload)
        self.transport.send(destination, payload, now)

    def forget(self, other: Address, now: Time) -> None:
        """Drop all messages that are on their way to a robot."""
        self.transport.forget(other, now)

    def _settle(self, now: Time) -> None:
        """Take what the transport has brought, and pass on what follows from it, until nothing more does."""
        self._read(now)
        self.host.advance(now)
        if self.host.changes != self._changes:
            self._changes = self.host.changes
            self.member.forget_serials()
        mine = self.host.mine
        while mine:
            orders = mine[:]
            mine.clear()
            for order in orders:
                self.member.obey(order, now)
            self._report(now)
            self.host.advance(now)
        self._report(now)
        if self.console.attended:
            self.console.report(now)
        self.counters.returned += len(self.transport.returned())
        self.counters.frames, self.counters.frame_bytes = self.transport.counts.frames, self.transport.counts.octets

    def _report(self, now: Time) -> None:
        reports, self.member.reports = self.member.reports, []
        for report in reports:
            self.host.report(report, now)
            self.host.advance(now)

    def _read(self, now: Time) -> None:
        for source, topic, payload, _ in self.transport.published():
            try:
                self._hear(source, topic, payload, now)
            except WireError:
                self._events.append(BadBytes(source, len(payload)))
        for source, payload in self.transport.messages():
            try:
                letter = messages.decode(payload, self._setup.size)
            except WireError:
                self._events.append(BadBytes(source, len(payload)))
                continue
            self._deliver(source, letter, now)

    def _hear(self, source: Address, topic: int, payload: bytes, now: Time) -> None:
        """Take a status broadcast; raise WireError for one that no robot of the team can have sent."""
        if topic in MAP_TOPICS:
            frames.decode(payload)  # only a piece of a map makes a robot begin to share maps
            self.exploring.receive(source, payload, now)
            return
        if topic != status.TOPIC:
            raise WireError(f"news of topic {topic}")
        news = status.decode(payload, self._setup.size)
        self.member.others.news[source] = news, now
        self.host.hear(source, news, now)

    def _deliver(self, source: Address, letter: Letter, now: Time) -> None:
        match letter:
            case YieldRequest():
                self.member.yield_to(letter, now)
            case Look(request=request):
                self.member.camera.ask(source, request)
            case Picture():
                self.console.picture(letter)
            case _:
                self.host.letter(source, letter, now)

    def _show(self, picture: tuple[Address, Picture], now: Time) -> None:
        asked_by, shown = picture
        if asked_by == self.me:
            self.console.picture(shown)
        else:
            self.post(asked_by, shown, now)

    # ------------------------------------------------------------ status

    def _heard(self, other: Address) -> Time:
        """Return when *other* was heard last; the start of this machine if never."""
        at = self.transport.heard(other)
        return self._start if at is None else at

    def _silent(self, other: Address, now: Time) -> bool:
        return self.host.silent(other, self._heard, now)

    def _whereabouts(self) -> Whereabouts:
        member = self.member
        x_m, y_m = member.here
        return Whereabouts(
            robot=self.me,
            x_m=x_m,
            y_m=y_m,
            heading_rad=member.heading_rad,
            plan=self.host.number,
            task=member.task,
            moving=member.moves,
        )

    def _news(self) -> News:
        member, host = self.member, self.host
        order = member.order
        x_m, y_m = member.here
        return News(
            host=host.replica.term.leader,
            term=host.replica.term.number,
            plan=host.number,
            calls=self.calls.dealt,
            digest=host.digest,
            serial=order.serial if order is not None and order.plan == host.number else None,
            idle=member.idle,
            x_m=x_m,
            y_m=y_m,
            heading_rad=member.heading_rad,
            speed_mps=member.speed_mps,
            goal_m=member.goal_m,
            task=member.task,
            over=host.over,
        )


def _sensor(parameters: Parameters, setup: Setup, me: Address) -> Sensor:
    """Return the range sensor of robot *me*."""
    ring = parameters.sonar
    if setup.crew.bodies[me].sensor == "laser":
        return Sensor(setup.beams)
    return Sensor(setup.beams, max(1, round(setup.beams / ring.beams)), ring.range_m, ring.noise_m)
