"""The application layer: area coverage in the four phases of paper 003 (section IV, Figs 4, 5).

A step of the team: every robot localizes itself, evaluates its actions and loads its message; the exchange makes all
messages known to all; conflicts take further exchanges; an exchange in which all robots accept ends the step, and the
robots drive to their next cells. The master begins the next step when it has arrived, or, having stayed where it was,
after the time that a step takes; a robot that is polled while it still drives answers "busy", and the exchange is
repeated. The number of cells is known, so each robot notices completion by itself.

A new team first makes its knowledge equal (module ``reconciliation``), then plans. A robot that loses its team drives
to the cell that it is on the way to, and stands there, back in the initialisation phase, until it is called up again.
"""

from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Final

from cosim.geometry.grids import Cell
from cosim.machine import Address, Command, GoTo, next_state
from cosim.observation import Observation
from cosim.units import Time
from protocols.pseudonet.broadcast import Broadcast
from protocols.pseudonet.coordination import Coordination, accepted, in_trouble
from protocols.pseudonet.events import (
    BadBytes,
    Events,
    Finished,
    MessageSent,
    RobotDropped,
    Stepped,
    TeamFormed,
    TeamLost,
)
from protocols.pseudonet.messages import Message
from protocols.pseudonet.messaging import Messaging, Stance
from protocols.pseudonet.parameters import TeamParameters
from protocols.pseudonet.reconciliation import Equality, Reconciliation
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.setup import Setup
from protocols.pseudonet.upcalls import Answered, Broken, Exchanged, Garbage, MessageWanted, TeamChanged, Upcall

# ---------------------------------------------------------------- counters
# What one Pseudonet machine counts: the times of set-up, of exchanges, and of standing still for the radio's sake.


class Counters:
    """Counts and sums; only the master knows when an exchange begins and fills exchange_time and radio_wait."""

    def __init__(self, start: Time) -> None:
        self.start = start
        self.setup: Time | None = None
        self.exchanges = 0
        self.led = 0
        """Number of exchanges that this robot has begun."""
        self.exchange_time: Time = 0
        self.radio_wait: Time = 0
        self.breaks = 0
        self.resumed = 0
        self.reform_time: Time = 0
        self._broken_at: Time | None = None
        self._began: Time | None = None
        self._step_began: Time | None = None

    def team(self, now: Time) -> None:
        """Count that a team was called up; the first time ends the set-up."""
        if self.setup is None:
            self.setup = now - self.start
        self._step_began = None

    def broken(self, now: Time) -> None:
        """Count the loss of the team; the time until the next team makes a step is lost as well."""
        self.breaks += 1
        self._began = None
        self._step_began = None
        if self._broken_at is None:
            self._broken_at = now

    def began(self, now: Time) -> None:
        """Count that the master begins an exchange; the first one of a step begins the wait."""
        self._began = now
        if self._step_began is None:
            self._step_began = now

    def exchanged(self, now: Time) -> None:
        """Count a complete exchange."""
        self.exchanges += 1
        if self._began is not None:
            self.led += 1
            self.exchange_time += now - self._began
            self._began = None

    def busy(self) -> None:
        """Restart the wait for the radio with the next exchange, as a robot was still driving in this one."""
        self._step_began = None

    def agreed(self, now: Time) -> None:
        """Count that the team has agreed and drives on."""
        if self._broken_at is not None:
            self.resumed += 1
            self.reform_time += now - self._broken_at
            self._broken_at = None
        if self._step_began is not None:
            self.radio_wait += now - self._step_began
            self._step_began = None


ARRIVAL_TOLERANCE_M: Final = 1e-6
PATIENCE_TICKS: Final = 30
"""World ticks for which a robot pushes against something before it drives back to the cell that it came from."""


class Phase(Enum):
    """The four phases of Figs 4 and 5; robots drive while they wait for the next exchange."""

    INITIALISATION = auto()
    STATE_EXCHANGE = auto()
    DECISION = auto()
    TERMINATION = auto()


class Input(Enum):
    """The inputs of the state diagram."""

    TEAM = auto()
    """A team, or a new one, is called up."""
    ARRIVED = auto()
    """The robot stands in the cell that it was to go to."""
    EXCHANGED = auto()
    DISAGREED = auto()
    AGREED = auto()
    DONE = auto()
    """Everything is covered, or the step limit is reached."""
    DEPARTED = auto()
    """The robot has stopped and leaves its team, or has lost it since it stopped."""
    BROKEN = auto()
    """The team is no more, or goes on without this robot."""


TABLE: Final = {
    (Phase.INITIALISATION, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.INITIALISATION, Input.ARRIVED): ("stand", Phase.INITIALISATION),
    (Phase.INITIALISATION, Input.BROKEN): ("stand", Phase.INITIALISATION),
    (Phase.STATE_EXCHANGE, Input.TEAM): ("answer_roll_call", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.ARRIVED): ("move_next_step", Phase.STATE_EXCHANGE),
    (Phase.STATE_EXCHANGE, Input.EXCHANGED): ("decide", Phase.DECISION),
    (Phase.STATE_EXCHANGE, Input.BROKEN): ("stand_by", Phase.INITIALISATION),
    (Phase.DECISION, Input.DISAGREED): ("talk_on", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.AGREED): ("drive", Phase.STATE_EXCHANGE),
    (Phase.DECISION, Input.DONE): ("finish", Phase.TERMINATION),
    (Phase.DECISION, Input.DEPARTED): ("finish", Phase.TERMINATION),
    (Phase.STATE_EXCHANGE, Input.DEPARTED): ("finish", Phase.TERMINATION),
    (Phase.INITIALISATION, Input.DEPARTED): ("finish", Phase.TERMINATION),
    (Phase.TERMINATION, Input.TEAM): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.ARRIVED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.EXCHANGED): ("stand", Phase.TERMINATION),
    (Phase.TERMINATION, Input.BROKEN): ("stand", Phase.TERMINATION),
}
"""The state diagram of Figs 4 and 5: (phase, input) -> (action, next phase)."""


class Progress(Enum):
    """What an observation shows of the drive."""

    NONE = auto()
    ARRIVED = auto()
    TURNED_BACK = auto()
    """Something that the team does not know of stands in the way: the robot drives back."""
    STUCK = auto()
    """The way back, or to the middle of its cell, is obstructed as well: the robot stays where it is."""


class Steering:
    """One robot's drive to its next cell."""

    def __init__(self, setup: Setup) -> None:
        self.motion: list[Command] = []
        self._grid = setup.grid
        self._goal: tuple[float, float] | None = None
        self._cell: Cell = -1
        self._origin: Cell = -1
        self._pushed = 0

    @property
    def under_way(self) -> bool:
        """True if the robot has not arrived yet."""
        return self._goal is not None

    @property
    def goal_m(self) -> tuple[float, float] | None:
        """The middle of the cell that it drives to; None if it stands."""
        return self._goal

    def centred(self, cell: Cell, observation: Observation) -> bool:
        """Return whether the robot stands in the middle of *cell*."""
        x_m, y_m = self._grid.centre_m(cell)
        return max(abs(observation.x_m - x_m), abs(observation.y_m - y_m)) < ARRIVAL_TOLERANCE_M

    def go(self, cell: Cell, origin: Cell) -> None:
        """Drive to *cell*, and back to *origin* if that cannot be done."""
        self._cell = cell
        self._origin = origin
        self._pushed = 0
        self._goal = self._grid.centre_m(cell)
        self.motion.append(GoTo(*self._goal))

    def observe(self, observation: Observation) -> Progress:
        """Notice that the robot has arrived, or that something keeps it from arriving."""
        if self._goal is None:
            return Progress.NONE
        if observation.arrived and self.centred(self._cell, observation):
            self._goal = None
            return Progress.ARRIVED
        if observation.blocked:
            self._pushed += 1
        if self._pushed <= PATIENCE_TICKS:
            return Progress.NONE
        if self._origin != self._cell:
            self.go(self._origin, self._origin)
            return Progress.TURNED_BACK
        self._goal = None
        self.motion.append(GoTo(observation.x_m, observation.y_m))
        return Progress.STUCK


class Application:
    """One robot's share of the team's task, on top of the coordination, messaging and broadcast layers."""

    def __init__(
        self,
        parameters: TeamParameters,
        setup: Setup,
        me: Address,
        coordination: Coordination,
        step_limit: int | None,
        start: Time,
        broadcast: Broadcast | Relay,
        alone: Callable[[tuple[Address, ...], Time], None],
    ) -> None:
        """Call *alone*, with the robots that are known to be dead, when this robot has lost its team."""
        self.me = me
        self.finished = False
        self.departed = False
        """True if the robot has stopped and left its team, which may go on."""
        self.phase = Phase.INITIALISATION
        self.steps = 0
        self.begin_at: Time | None = None
        """Instant at which the master is to begin the next exchange."""
        self.rest_until: Time | None = None
        """Instant at which a step ends in which the master stays where it is."""
        self.counters = Counters(start)
        self.events = Events(parameters.trace_calls)
        self.messaging = Messaging(me, setup)
        self.coordination = coordination
        self.steering = Steering(setup)
        self._reconciliation = Reconciliation(setup, parameters.map_bytes)
        self._form: Callable[[int], Message] = self._waiting
        """Function that forms the next message from the number of its exchange."""
        self.broadcast = broadcast
        self._alone = alone
        self._setup = setup
        self._step_limit = step_limit
        self._times = setup.timing

    @property
    def placed(self) -> bool:
        """True if the robot knows where it stands."""
        return self.me in self.coordination.view.cells

    # ------------------------------------------------------------ inputs

    def lost(self, peer: Address, now: Time) -> None:
        """Process the loss of the link to *peer*."""
        self.broadcast.lost(peer, now)

    def break_up(self, dead: tuple[Address, ...], now: Time) -> None:
        """Process the loss of the team; the robots *dead* are known to be gone."""
        if self.finished:
            return
        if self.coordination.departure and self.coordination.dormant:
            self._depart(now)
            return
        self.stand_by(now)
        self._alone(dead, now)

    def stand_by(self, now: Time) -> None:
        """Leave the team and wait to be called up again."""
        if self.finished:
            return
        if self.broadcast.find_master() is not None:
            self.events.note(TeamLost(len(self.broadcast.members)))
            self.counters.broken(now)
        self.begin_at = None
        self.rest_until = None
        self._input(Input.BROKEN, now)
        self.broadcast.leave()

    def observe(self, observation: Observation, now: Time) -> bool:
        """Localize the robot, or follow the progress of its drive; return whether anything but that has changed."""
        if not self.placed:
            self._take_place(observation, now)
            return True
        progress = self.steering.observe(observation)
        if progress is Progress.NONE:
            return False
        match progress:
            case Progress.ARRIVED:
                self._input(Input.ARRIVED, now)
            case Progress.TURNED_BACK:
                self.coordination.turned_back()
            case Progress.STUCK:
                self.coordination.stuck(self.coordination.localize(observation.x_m, observation.y_m))
                self._input(Input.ARRIVED, now)
        return True

    def wake(self, now: Time) -> None:
        """Act on the deadlines that have come."""
        if self.begin_at is not None and now >= self.begin_at:
            self._load(now)
        if self.rest_until is not None and now >= self.rest_until:
            self.rest_until = None
            self._input(Input.ARRIVED, now)
        self.broadcast.wake(now)

    # ------------------------------------------------------------ upcalls of the broadcast layer

    def take_upcall(self, upcall: Upcall, now: Time) -> None:
        """Process an upcall of *broadcast*, the layer below."""
        match upcall:
            case Exchanged(messages=messages):
                self._exchanged(messages, now)
            case MessageWanted():
                self._submit_unready(now)
            case TeamChanged(members=members):
                self._team_changed(members, now)
            case Answered(message=message):
                self.coordination.directed(message)
            case Garbage(reason=reason):
                self.events.note(BadBytes(reason))
            case Broken(dead=dead):
                self.break_up(dead, now)

    def _submit_unready(self, now: Time) -> None:
        if self.placed and not self.finished:
            message = self.messaging.busy(self.broadcast.exchange, self._cell())
            self.events.note(MessageSent(message.kind.name.lower()))
            self.broadcast.load(message, now)

    def _team_changed(self, members: tuple[Address, ...], now: Time) -> None:
        if self.finished:
            return
        for gone in sorted(set(self.coordination.view.members) - set(members) - self.coordination.departing()):
            self.events.note(RobotDropped(gone))
        self.counters.team(now)
        self.events.note(TeamFormed(len(members), self.broadcast.piconets))
        self.coordination.team_changed(members)
        self._input(Input.TEAM, now)

    def _exchanged(self, messages: Mapping[Address, Message], now: Time) -> None:
        self.counters.exchanged(now)
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
                self.begin_at = None
                self.rest_until = None
                self.events.note(Finished(event.name.lower()))

    def _take_place(self, observation: Observation, now: Time) -> None:
        cell = self.coordination.localize(observation.x_m, observation.y_m)
        self.coordination.view.cells[self.me] = cell
        if not self.steering.centred(cell, observation):
            self.steering.go(cell, cell)
        if self.phase is Phase.STATE_EXCHANGE:  # the team was called up before this robot knew its place
            self._load(now)

    def _move_next_step(self, now: Time) -> None:
        """Localize, evaluate and communicate: the action of Fig. 12."""
        if self.coordination.plan_due or self.coordination.obstructed is not None:
            self._form = self._waiting
        else:
            self._evaluate()
        if not self.broadcast.loaded():
            self._load(now)

    def _evaluate(self) -> None:
        evaluation = self.coordination.evaluate_actions()
        if self.events.calls:
            self.events.call(0, "application", "move_next_step", f"step {self.steps + 1}")
            self.events.call(1, "coordination", "localize", self._setup.place(self._cell()))
            self.events.call(1, "coordination", "evaluate_actions", evaluation)
        self._speak(Stance.PROPOSE)

    def _decide(self, messages: Mapping[Address, Message], now: Time) -> None:
        """Decide what follows from all messages; every robot computes the same (decision phase)."""
        self.coordination.take_positions(messages)
        if any(message.busy for message in messages.values()) or not self.coordination.all_placed():
            self.counters.busy()
            self._talk_on(now, self._times.retry)
        elif self.coordination.plan_due and not self._reconciled(messages):
            self._talk_on(now)
        elif self.coordination.complete() and not self.coordination.try_again():
            self._input(Input.DONE, now)
        elif self.coordination.plan_due:
            self.coordination.plan()
            self._evaluate()
            self._talk_on(now)
        elif departing := self._departing():
            self._part_with(departing, now)
        elif accepted(messages.values()):
            self._agreed(messages, now)
        else:
            self._answer_those_in_trouble(messages)
            self._speak(self.coordination.negotiate(messages))
            self._talk_on(now)

    def _departing(self) -> tuple[Address, ...]:
        """Return who leaves the team now: those who have stopped, but for those on whose radio the others depend."""
        return tuple(sorted(filter(self.broadcast.dispensable, self.coordination.departing())))

    def _part_with(self, departing: tuple[Address, ...], now: Time) -> None:
        """Leave the team, or go on without *departing* once the master has called the roll."""
        if self.me in departing:
            self._depart(now)
            return
        self._input(Input.DISAGREED, now)
        if self.broadcast.leads():
            self.broadcast.release(departing, now)

    def _depart(self, now: Time) -> None:
        self.departed = True
        self._input(Input.DEPARTED, now)
        self.broadcast.leave()

    def _answer_those_in_trouble(self, messages: Mapping[Address, Message]) -> None:
        for asker, message in messages.items():
            if asker == self.me or not in_trouble(message):
                continue
            target = self.coordination.direction_for(asker, messages)
            if target is not None:
                answer = self.messaging.direct(self.broadcast.exchange, self._cell(), asker, target)
                self.events.note(MessageSent(answer.kind.name.lower()))
                self.events.call(2, "messaging", "answer", answer)
                self.broadcast.answer(answer)

    def _talk_on(self, now: Time, pause: Time = 0) -> None:
        self._input(Input.DISAGREED, now)
        leads = self.broadcast.leads()
        if leads and pause:
            self.begin_at = now + pause
        elif leads or not self.steering.under_way:
            self._load(now)

    def _agreed(self, messages: Mapping[Address, Message], now: Time) -> None:
        self.steps += 1
        self.counters.agreed(now)
        before = self._cell()
        cell = self.coordination.commit(messages)
        action = self.coordination.evaluation.action
        self.events.note(Stepped(self.steps, action.name.lower(), *self._setup.place(cell)))
        if self._step_limit is not None and self.steps >= self._step_limit:
            self._input(Input.DONE, now)
            return
        self._input(Input.AGREED, now)
        if cell != before:
            self.steering.go(cell, before)
        elif self.broadcast.leads():
            self.rest_until = now + self._times.step
        else:
            self._input(Input.ARRIVED, now)

    # ------------------------------------------------------------ messages

    def _cell(self) -> Cell:
        """Return the cell in which the robot is, or will be when it has arrived."""
        return self.coordination.view.cells[self.me]

    def _load(self, now: Time) -> None:
        """Hand the message of the present exchange to the layer below: the service communicate of Fig. 12."""
        self.begin_at = None
        self.rest_until = None
        if not self.placed or (self.steering.under_way and not self.broadcast.polled):
            return
        message = self._next_message(self.broadcast.exchange)
        self.events.note(MessageSent(message.kind.name.lower()))
        leads = self.broadcast.leads()
        if self.events.calls:
            self.events.call(1, "coordination", "communicate")
            self.events.call(2, "messaging", message.kind.name.lower(), message)
            self.events.call(3, "broadcast", "find_master", self.broadcast.find_master())
            service = "broadcast_to_robots" if leads else "send_to_master"
            self.events.call(3, "broadcast", service, f"exchange {message.exchange}")
        if leads:
            self.counters.began(now)
        self.broadcast.load(message, now)

    def _next_message(self, exchange: int) -> Message:
        """Return the message of *exchange*; a robot that drives sends only that it is busy."""
        return (self._waiting if self.steering.under_way else self._form)(exchange)

    def _speak(self, stance: Stance) -> None:
        """Send this *stance* on the present evaluation from now on."""
        evaluation = self.coordination.evaluation
        self._form = lambda exchange: self.messaging.speak(stance, exchange, self._cell(), evaluation)

    def _reconciled(self, messages: Mapping[Address, Message]) -> bool:
        """Return whether all maps are equal and a plan is due; else prepare the message that is wanted for that."""
        match self._reconciliation.take(self.coordination.view, messages):
            case Equality.EQUAL:
                return True
            case Equality.ROLL_WANTED:
                self._form = self._waiting
            case Equality.MAP_WANTED:
                self._form = self._map
        return False

    def _waiting(self, exchange: int) -> Message:
        """Return the message of a robot that waits for a plan, or drives."""
        verdicts = self.coordination.obstruction()
        if self.steering.under_way:
            return self.messaging.busy(exchange, self._cell(), verdicts)
        digest = self._reconciliation.digest(self.coordination.view)
        return self.messaging.roll(exchange, self._cell(), verdicts, digest)

    def _map(self, exchange: int) -> Message:
        """Return the message with the next piece of this robot's map."""
        marks = self._reconciliation.marks(self.coordination.view)
        return self.messaging.map(exchange, self._cell(), self._reconciliation.chunk, marks)
