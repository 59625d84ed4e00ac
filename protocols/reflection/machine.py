"""One robot: what it hears and sees goes into its book of goals and its ways, and what follows from them comes out.

At each tick it looks where it is and what is in sight (all goals and ghosts in one question), chooses where to go, and
tells everybody what it sees, which goals it knows and what it can promise. Frames come in between ticks; they count if
the robot sees their sender, which is also where the sender's promises and places are put (paper 000, section 3.1).
"""

import math
from typing import Final

from cosim.errors import WireError
from cosim.machine import (
    BROADCAST,
    Address,
    Command,
    Event,
    GoTo,
    LinkCommand,
    LinkEvent,
    Outgoing,
    Reception,
)
from cosim.navigation.steering import Navigator
from cosim.observation import Observation, Sighting
from cosim.units import Time, from_seconds
from protocols.reflection.bearings import Point
from protocols.reflection.counters import Counters
from protocols.reflection.events import BadBytes, Displaced
from protocols.reflection.frames import IN_TROUBLE, OBJECTS, Frame, decode
from protocols.reflection.goals import GoalBook
from protocols.reflection.hearing import Hearing
from protocols.reflection.parameters import Parameters
from protocols.reflection.patrolling import Courtesy, Patrol
from protocols.reflection.promises import Ways
from protocols.reflection.seeking import Seeker
from protocols.reflection.setup import Setup
from protocols.reflection.straight import Straight
from protocols.reflection.telling import compose
from protocols.transport.meeting import Meeting

_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster
JUMP_STEPS = 5.0
"""A robot that is farther than so many motion steps from where it was a tick ago has been moved."""


class Reflection:
    """The machine of one robot. It lives on observations, and has no deadlines."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        me: Address,
        navigator: Navigator,
        start: Time,
    ) -> None:
        """Have *navigator* be the algorithm A of a robot with goals, and the way back of a lost helper."""
        task = setup.tasks[me]
        self.me = me
        self.counters = Counters()
        self.book = GoalBook(me, setup.size)
        self.ways = Ways(me, setup.size, from_seconds(parameters.promise_life_s))
        self._start = start
        self._events: list[Event] = []
        self._outbox: list[Outgoing | LinkCommand] = []
        self._commands: list[Command] = []
        times = from_seconds(parameters.inquiry_s), from_seconds(parameters.page_s)
        self._meeting = Meeting(me, bool(task.goals_m), *times, self._outbox) if parameters.links else None
        self._going: Point | None = None
        self._objects = parameters.goals == "object"
        self._share_goals = parameters.share_goals
        self._share_states = parameters.states_shared
        self._speaks = self._share_goals or self._share_states
        self._period = 0 if parameters.period_s is None else from_seconds(parameters.period_s)
        self._jump_m = JUMP_STEPS * setup.steps_m[me]
        self._here: Point | None = None
        self._seen: tuple[Sighting, ...] = ()
        self._sightings: dict[Address, Point] = {}
        self._states: dict[Address, bool] = {}
        self._next_frame = start
        self._hearing = Hearing(parameters, setup, self.book, self.ways, self._events, self.counters, start)
        step_m = setup.steps_m[me]
        straight = Straight(setup.radius_m, step_m, from_seconds(parameters.patience_s), start)
        self.patrol = (
            Patrol(task.patrol_m, parameters.patrol == "shuttle", step_m, straight, navigator)
            if task.patrol_m
            else None
        )
        self._courtesy = Courtesy(self.book, self.ways, setup.radius_m, from_seconds(parameters.hold_s), self._events)
        self.seeker = (
            Seeker(parameters, setup, self.book, self.ways, navigator, straight, self._events, self.counters, start)
            if task.goals_m
            else None
        )

    # ------------------------------------------------------------ the contract of machines

    @property
    def finished(self) -> bool:
        """All goals are reached or given up; a helper has none, and helps as long as it is asked to."""
        return self.seeker is None or self.seeker.finished

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a frame, if its sender is in sight."""
        peer = reception.source
        if peer == self.me:
            return
        try:
            frame = decode(data)
        except WireError as error:
            self._events.append(BadBytes(str(error)))
            return
        peer_m = self._sightings.get(peer)
        if peer_m is None:
            self._unseen(frame)
            return
        self._states[peer] = frame.in_trouble
        self._hearing.goals(frame, peer_m)
        if frame.pledges and self._hearing.promises(frame, peer, peer_m, now) and self.seeker is not None:
            self.seeker.promised(now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links, if there are to be any; else frames go to whoever is in reach."""
        if self._meeting is not None:
            self._meeting.link(event, now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Look, choose where to go, and tell the others."""
        x, y = observation.x_m, observation.y_m
        here, last = (x, y), self._here
        if last is not None and abs(x - last[0]) + abs(y - last[1]) > self._jump_m:
            self._note_jump(here, now)
        self._here = here
        self._hearing.looked(here, now)
        if observation.sightings is not self._seen:
            self._seen = observation.sightings
            self._sightings = {address: (x_m, y_m) for address, x_m, y_m in self._seen}
        seeker = self.seeker
        if seeker is not None:
            seeker.arrive(x, y, now)
        if self.book.known or self.patrol is not None:
            self._look(observation, here, now)
        going = self._choose(observation, now)
        if going is not self._going and going is not None and going != self._going:
            self._commands.append(_new(GoTo, going))
            self._going = going
        if self._sightings and now >= self._next_frame and self._speaks:
            self._tell(here, now)
        if self._meeting is not None:
            self._meeting.look(self._sightings, now)

    def wake(self, now: Time) -> None:
        """Do nothing: there are no deadlines."""

    def wake_at(self) -> Time | None:
        """Return None: there are no deadlines."""
        return None

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain frames."""
        if not self._outbox:
            return []
        drained = self._outbox[:]
        self._outbox.clear()  # it is shared with the meeting
        return drained

    def commands(self) -> list[Command]:
        """Drain motion commands."""
        if not self._commands:
            return []
        drained, self._commands = self._commands, []
        return drained

    def events(self) -> list[Event]:
        """Drain rows for the trace."""
        if not self._events:
            return []
        drained = self._events[:]
        self._events.clear()  # it is shared with the seeker and the courtesy
        return drained

    # ------------------------------------------------------------ what comes in

    def _look(self, observation: Observation, here: Point, now: Time) -> None:
        """Ask once what of all that matters is in sight."""
        points = self.ways.points(self.book)
        patrol = self.patrol
        count = len(points)
        if patrol is not None and patrol.off_its_way:
            points += patrol.places()
        visible = observation.sees(points) if points else []
        self.ways.look(self.book, visible, here[0], here[1], now)
        if patrol is not None:
            patrol.look(visible[count:], here)

    def _note_jump(self, here: Point, now: Time) -> None:
        assert self._here is not None
        self._events.append(Displaced(math.dist(here, self._here)))
        self.ways.displaced()
        self._going = None
        if self.seeker is not None:
            self.seeker.displaced(now)
        if self.patrol is not None:
            self.patrol.displaced(now)

    def _unseen(self, frame: Frame) -> None:
        """Count what comes from a robot that is not in sight: nothing can be done with it."""
        for owner, _, _, _ in frame.pledges:
            if owner == self.me:
                self.counters.unseen_advice += 1

    # ------------------------------------------------------------ what comes out

    def _choose(self, observation: Observation, now: Time) -> Point | None:
        seeker = self.seeker
        if seeker is not None and not seeker.finished:
            return seeker.choose(observation, self._sightings, self._states, now)
        aside = self._courtesy.aside(observation, self._sightings, now)
        patrol = self.patrol
        if patrol is None:
            return aside
        if aside is not None:
            patrol.left((observation.x_m, observation.y_m))
            return aside
        return patrol.choose(observation, self._sightings, now)

    def _tell(self, here: Point, now: Time) -> None:
        """Send a frame with all that the others may use."""
        self._next_frame = now + self._period
        in_trouble = self._share_states and self.seeker is not None and self.seeker.trouble.active
        flags = (IN_TROUBLE if in_trouble else 0) | (OBJECTS if self._objects else 0)
        goals = (self.book, self.ways) if self._share_goals else None
        payload = compose(flags, here, self._sightings, goals, self._start, now)
        counters = self.counters
        counters.frames += 1
        counters.payload_bytes += len(payload)
        if self._meeting is None:
            self._outbox.append(_new(Outgoing, (BROADCAST, payload, None, 0)))
        else:
            self._outbox += [Outgoing(peer, payload) for peer in sorted(self._meeting.linked)]
