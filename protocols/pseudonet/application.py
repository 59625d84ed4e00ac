"""The application room, and the machine of one robot: area coverage in the four phases of paper 003 (section IV, Figs 4, 5).

A step of the team: every robot localizes itself, evaluates its actions and loads its message; the exchange makes all
messages known to all; conflicts take further exchanges; an exchange in which everybody accepts ends the step, and the
robots drive to their next cells. The master begins the next step when it has arrived, or, having stayed where it was,
after the time that a step takes; a robot that is polled while it still drives says so, and the exchange is repeated.
The number of cells is known, so each robot finds completion by itself.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import Enum, auto
from typing import Final

from cosim.geometry.grids import Cell
from cosim.machine import (
    Address,
    Command,
    Event,
    Fate,
    GoTo,
    LinkCommand,
    LinkEvent,
    Lost,
    Observation,
    Outgoing,
    Reception,
    next_state,
)
from cosim.units import Time
from protocols.pseudonet.algorithms.base import Algorithm
from protocols.pseudonet.bluetooth import Bluetooth
from protocols.pseudonet.broadcast import Answered, Broadcast, Exchanged, Garbage, MessageWanted, TeamChanged, Upcall
from protocols.pseudonet.coordination import Coordination, accepted, contest, in_trouble
from protocols.pseudonet.journal import BadBytes, Finished, Journal, MessageSent, RobotDropped, Stepped, TeamFormed
from protocols.pseudonet.knowledge import Knowledge
from protocols.pseudonet.messages import Kind, Message, Reply
from protocols.pseudonet.messaging import Messaging
from protocols.pseudonet.parameters import Parameters, Timing
from protocols.pseudonet.records import Records

ARRIVAL_TOLERANCE_M: Final = 1e-6
PATIENCE_TICKS: Final = 30
"""World ticks that a robot pushes against something before it drives back to the cell that it came from."""


class Phase(Enum):
    """The four phases of Figs 4 and 5; robots drive while they wait for the next exchange."""

    INITIALISATION = auto()
    STATE_EXCHANGE = auto()
    DECISION = auto()
    TERMINATION = auto()


class Input(Enum):
    """What moves the application from phase to phase."""

    TEAM = auto()
    """A team, or a new one, is called up."""
    ARRIVED = auto()
    """The robot stands in the cell that it was to go to."""
    EXCHANGED = auto()
    DISAGREED = auto()
    AGREED = auto()
    DONE = auto()
    """Everything is covered, or the step limit is reached."""
    CUT_OFF = auto()
    """This robot is not in the team any more."""


TABLE: Final = {
    (Phase.INITIALISATION, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.INITIALISATION, Input.ARRIVED): ("stand", Phase.INITIALISATION),
    (Phase.INITIALISATION, Input.CUT_OFF): ("finish", Phase.TERMINATION),
    (Phase.STATE_EXCHANGE, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.ARRIVED): ("move_next_step", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.EXCHANGED): ("decide", Phase.DECISION),
    (Phase.STATE_EXCHANGE, Input.CUT_OFF): ("finish", Phase.TERMINATION),
    (Phase.DECISION, Input.DISAGREED): ("talk_on", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.AGREED): ("drive", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.DONE): ("finish", Phase.TERMINATION),
    (Phase.TERMINATION, Input.TEAM): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.ARRIVED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.EXCHANGED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.CUT_OFF): ("stand", Phase.TERMINATION),
}


class Pseudonet:
    """The machine of one robot: the application on top of coordination, messaging, broadcast and Bluetooth."""

    def __init__(
        self,
        parameters: Parameters,
        knowledge: Knowledge,
        me: Address,
        algorithm: Algorithm,
        limits: tuple[int | None, int | None],
        times: Timing,
        start: Time,
    ) -> None:
        self.me = me
        self.finished = False
        self.phase = Phase.INITIALISATION
        self.steps = 0
        self.records = Records(start)
        self.journal = Journal(parameters.trace_calls)
        self.messaging = Messaging(me, knowledge)
        self.coordination = Coordination(knowledge, me, algorithm, stop_at=limits[1])
        self.broadcast = Broadcast(
            me, times.poll_timeout, parameters.poll_retries, parameters.acknowledge, self._heard_from_below
        )
        self.bluetooth = Bluetooth(
            knowledge.size, (times.inquiry, parameters.inquiries), parameters.page_attempts, self._piconet_ready
        )
        self._knowledge = knowledge
        self._step_limit = limits[0]
        self._times = times
        self._start: Time | None = start
        self._begin_at: Time | None = None
        self._rest_until: Time | None = None
        self._form: Callable[[int], Message] = self._waiting
        self._goal: tuple[float, float] | None = None
        self._from: Cell = -1
        self._pushed = 0
        self._motion: list[Command] = []

    # ------------------------------------------------------------ inputs

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload off the air."""
        self.broadcast.receive(data, reception, now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
        if isinstance(event, Fate):
            self.broadcast.fate(event, now)
            return
        self.bluetooth.link(event, now)
        if isinstance(event, Lost):
            self._lost(event.peer, now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Notice that the robot has arrived, or that something keeps it from arriving."""
        if self._goal is None:
            if self.me not in self.coordination.view.cells:
                self._take_place(observation)
            return
        x_m, y_m = self._goal
        distance = max(abs(observation.x_m - x_m), abs(observation.y_m - y_m))
        if observation.arrived and distance < ARRIVAL_TOLERANCE_M:
            self._goal = None
            self._pushed = 0
            self._input(Input.ARRIVED, now)
        elif observation.blocked:
            self._push()

    def wake(self, now: Time) -> None:
        """Act on the deadlines that have come."""
        if self._start is not None and now >= self._start:
            self._start = None
            self._set_up(now)
        if self._begin_at is not None and now >= self._begin_at:
            self._load(now)
        if self._rest_until is not None and now >= self._rest_until:
            self._rest_until = None
            self._input(Input.ARRIVED, now)
        self.broadcast.wake(now)

    def wake_at(self) -> Time | None:
        """Return the earliest deadline."""
        times = [
            time
            for time in (self._start, self._begin_at, self._rest_until, self.broadcast.deadline)
            if time is not None
        ]
        return min(times) if times else None

    # ------------------------------------------------------------ outputs

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain what the two rooms below have for the device."""
        if not self.bluetooth.out and not self.broadcast.out:
            return []
        out = self.bluetooth.out + self.broadcast.out
        self.bluetooth.out = []
        self.broadcast.out = []
        return out

    def commands(self) -> list[Command]:
        """Drain where to drive."""
        motion, self._motion = self._motion, []
        return motion

    def events(self) -> list[Event]:
        """Drain the journal."""
        return self.journal.drain()

    # ------------------------------------------------------------ initialisation

    def _set_up(self, now: Time) -> None:
        self.journal.call(0, "application", "initialise", f"robot {self.me}")
        self.journal.call(4, "bluetooth", "l2cap.connection_request")
        if self._knowledge.size == 1:
            self._piconet_ready((), (0, 0), now)
        else:
            self.bluetooth.start(initiate=self.me == 0, now=now)

    def _piconet_ready(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        self.broadcast.assemble(tuple(sorted((self.me, *slaves))), hop, now)

    def _take_place(self, observation: Observation) -> None:
        cell = self.coordination.localize(observation.x_m, observation.y_m)
        self.coordination.view.cells[self.me] = cell
        x_m, y_m = self._knowledge.grid.centre_m(cell)
        if max(abs(observation.x_m - x_m), abs(observation.y_m - y_m)) >= ARRIVAL_TOLERANCE_M:
            self._drive_to(cell, cell)

    def _lost(self, peer: Address, now: Time) -> None:
        if self.broadcast.find_master() == self.me:
            self.broadcast.lost(peer, now)
        elif peer == self.broadcast.find_master():
            self._input(Input.CUT_OFF, now)

    # ------------------------------------------------------------ upcalls of the broadcast room

    def _heard_from_below(self, upcall: Upcall, now: Time) -> None:
        match upcall:
            case Exchanged(messages=messages):
                self._exchanged(messages, now)
            case MessageWanted():
                self.broadcast.submit(self.messaging.waiting(self.broadcast.exchange, self._cell(), busy=True))
            case TeamChanged(members=members):
                self._team_changed(members, now)
            case Answered(message=message):
                self.coordination.directed(message)
            case Garbage(reason=reason):
                self.journal.note(BadBytes(reason))

    def _team_changed(self, members: tuple[Address, ...], now: Time) -> None:
        for gone in sorted(set(self.coordination.view.members) - set(members)):
            self.journal.note(RobotDropped(gone))
        if self.me not in members:
            self._input(Input.CUT_OFF, now)
            return
        self.records.team(now)
        self.journal.note(TeamFormed(len(members)))
        self.coordination.team_changed(members)
        self._input(Input.TEAM, now)

    def _exchanged(self, messages: Mapping[Address, Message], now: Time) -> None:
        self.records.exchanged(now)
        self._input(Input.EXCHANGED, now)
        if self.phase is Phase.DECISION:
            self._decide(messages, now)

    # ------------------------------------------------------------ the phases

    def _input(self, event: Input, now: Time) -> None:
        action, self.phase = next_state(TABLE, self.phase, event)
        match action:
            case "answer_roll_call":
                self._form = self._waiting
                self._load(now)
            case "move_next_step":
                self._move_next_step(now)
            case "finish":
                self.finished = True
                self._begin_at = None
                self._rest_until = None
                self.journal.note(Finished(event.name.lower()))

    def _move_next_step(self, now: Time) -> None:
        """The action of Fig. 12: localize, evaluate, communicate."""
        if self.coordination.plan_due:
            self._form = self._waiting
        else:
            self._evaluate()
        if not self.broadcast.loaded():
            self._load(now)

    def _evaluate(self) -> None:
        cell = self.coordination.view.cells[self.me]
        self.journal.call(0, "application", "move_next_step", f"step {self.steps + 1}")
        self.journal.call(1, "coordination", "localize", self._knowledge.place(cell))
        evaluation = self.coordination.evaluate_actions()
        self.journal.call(1, "coordination", "evaluate_actions", evaluation)
        self._form = lambda exchange: self.messaging.state(exchange, self._cell(), evaluation)

    def _decide(self, messages: Mapping[Address, Message], now: Time) -> None:
        """The decision phase: what follows from everybody's messages, computed alike by every robot."""
        self.coordination.take_positions(messages)
        if any(message.busy for message in messages.values()):
            self._talk_on(now, self._times.retry)
        elif self.coordination.view.complete():
            self._input(Input.DONE, now)
        elif self.coordination.plan_due:
            self.coordination.plan()
            self._evaluate()
            self._talk_on(now)
        elif accepted(messages.values()):
            self._agreed(messages, now)
        else:
            self._negotiate(messages, now)

    def _negotiate(self, messages: Mapping[Address, Message], now: Time) -> None:
        self._answer_those_in_trouble(messages)
        outcome = contest(messages, self.coordination.view.cells, self.coordination.targets(messages))
        evaluation = self.coordination.evaluation
        if self.me in outcome.losers:
            evaluation = self.coordination.give_up()
            self._form = lambda exchange: self.messaging.agree(exchange, self._cell(), evaluation, Reply.YIELD)
        elif self.me in outcome.claimants:
            self._form = lambda exchange: self.messaging.claim(exchange, self._cell(), evaluation)
        elif outcome.settled():
            self._form = lambda exchange: self.messaging.agree(exchange, self._cell(), evaluation, Reply.ACCEPT)
        else:
            plain = replace(evaluation, kind=Kind.STATE)
            self._form = lambda exchange: self.messaging.state(exchange, self._cell(), plain)
        self._talk_on(now)

    def _answer_those_in_trouble(self, messages: Mapping[Address, Message]) -> None:
        for asker, message in messages.items():
            if asker == self.me or not in_trouble(message):
                continue
            target = self.coordination.direction_for(asker, messages)
            if target is not None:
                answer = self.messaging.direct(self.broadcast.exchange, self._cell(), asker, target)
                self.journal.call(2, "messaging", "answer", answer)
                self.broadcast.answer(answer)

    def _talk_on(self, now: Time, pause: Time = 0) -> None:
        self._input(Input.DISAGREED, now)
        if self.me == self.broadcast.find_master() and pause:
            self._begin_at = now + pause
        elif self._goal is None or self.me == self.broadcast.find_master():
            self._load(now)

    def _agreed(self, messages: Mapping[Address, Message], now: Time) -> None:
        self.steps += 1
        self.records.agreed(now)
        before = self._cell()
        cell = self.coordination.commit(messages)
        action = self.coordination.evaluation.action
        self.journal.note(Stepped(self.steps, action.name.lower(), *self._knowledge.place(cell)))
        if self._step_limit is not None and self.steps >= self._step_limit:
            self._input(Input.DONE, now)
            return
        self._input(Input.AGREED, now)
        if cell != before:
            self._drive_to(cell, before)
        elif self.me == self.broadcast.find_master():
            self._rest_until = now + self._times.step
        else:
            self._input(Input.ARRIVED, now)

    # ------------------------------------------------------------ talking and driving

    def _cell(self) -> Cell:
        """Return where I am, or will be when I have arrived."""
        return self.coordination.view.cells[self.me]

    def _waiting(self, exchange: int) -> Message:
        return self.messaging.waiting(exchange, self._cell(), busy=self._goal is not None)

    def _load(self, now: Time) -> None:
        """The service communicate of Fig. 12: hand the message of the present exchange to the room below."""
        self._begin_at = None
        self._rest_until = None
        form = self._waiting if self._goal is not None else self._form
        message = form(self.broadcast.exchange)
        self.journal.note(MessageSent(message.kind.name.lower()))
        self.journal.call(1, "coordination", "communicate")
        self.journal.call(2, "messaging", message.kind.name.lower(), message)
        self.journal.call(3, "broadcast", "find_master", self.broadcast.find_master())
        if self.me == self.broadcast.find_master():
            self.journal.call(3, "broadcast", "broadcast_to_robots", f"exchange {message.exchange}")
            self.records.began(now)
            self.broadcast.begin(message, now)
        else:
            self.journal.call(3, "broadcast", "send_to_master", f"exchange {message.exchange}")
            self.broadcast.submit(message)

    def _drive_to(self, cell: Cell, origin: Cell) -> None:
        self._from = origin
        self._pushed = 0
        self._goal = self._knowledge.grid.centre_m(cell)
        self._motion.append(GoTo(*self._goal))

    def _push(self) -> None:
        """Something that the team does not know of stands in the way: after a while, go back."""
        self._pushed += 1
        if self._pushed > PATIENCE_TICKS and self._from != self._cell():
            self.coordination.view.cells[self.me] = self._from
            self._drive_to(self._from, self._from)
