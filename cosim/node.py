"""A node joins one machine with its channel and its body: it drives the machine and acts on what that leaves behind."""

from collections.abc import Container, Iterable, Sequence
from typing import Any, Final, NamedTuple, Protocol

from cosim.channels.base import Channel
from cosim.errors import LocalProtocolError
from cosim.kernel import WAKE, Handle, Kernel
from cosim.machine import (
    BROADCAST,
    OPERATOR,
    Address,
    Call,
    Command,
    Connected,
    Event,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Machine,
    ModeChanged,
    Outgoing,
    Reception,
    RoleChanged,
    Scan,
    Share,
    Unrecorded,
)
from cosim.observation import Observation
from cosim.trace import CALLS, LINKS, MESSAGES, WAKES, Trace, link_detail
from cosim.units import S, Time, to_seconds

LATEST: Final[Time] = 4_000_000_000 * S
"""How far clocks can be set forward, about 127 years: what they read later, and deadlines, still fit into 63 bits."""
SHOWN: Final = 100
"""The most characters that an error shows of what is wrong."""


class Said(NamedTuple):
    """What a machine has told the operator at its robot's console."""

    at: Time
    robot: Address
    payload: bytes


class Listener(Protocol):
    """Who hears the events of machines beside the trace: a referee, for example."""

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Note what the machine of *robot* reports at the true time *now*."""


class Notices:
    """What machines report that a person is to be told: their events of some *types*, in words."""

    def __init__(self, types: Iterable[type]) -> None:
        self.types = frozenset(types)
        self.texts: list[str] = []

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Put down what *robot* reports, if it is of one of the types."""
        if type(event) in self.types:
            self.texts.append(f"robot {robot} at {to_seconds(now):.1f} s: {event}")


class Node:
    """The driver of one machine. Inputs of one instant are taken first; ``drain`` then acts on them once.

    A deadline that moves later is not re-armed: its event fires, looks, and is set anew.
    Only an earlier one replaces it.
    """

    def __init__(
        self,
        address: Address,
        machine: Machine,
        kernel: Kernel,
        channel: Channel,
        trace: Trace,
        cable: list[Said] | None = None,
        listeners: Sequence[Listener] = (),
    ) -> None:
        self.address = address
        self.machine = machine
        self.alive = True
        self.motion: list[Command] = []
        self.clock_offset: Time = 0
        """By how much the machine's clock is ahead."""
        self.cable: list[Said] = [] if cable is None else cable
        """Takes what the machine tells the operator; several nodes may share it."""
        self.payloads = 0
        """How many the machine has sent by the channel."""
        self._listeners = tuple(listeners)
        self._kernel = kernel
        self._channel = channel
        self._trace = trace
        self._timer: Handle | None = None
        self._messages_wanted, self._links_wanted = trace.wants(MESSAGES), trace.wants(LINKS)
        self._wakes_wanted = trace.wants(WAKES)
        self._radios = channel.carried(address)

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Pass a payload to the machine; return whether anything may have come of it."""
        if not self.alive:
            return False
        if self._messages_wanted:
            self._trace.row(MESSAGES, now, self.address, reception.source, reception.broadcast, data.hex())
        return self.machine.receive(data, reception, now) is not False

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Pass news about links to the machine; return whether anything may have come of it."""
        if not self.alive:
            return False
        if self._links_wanted:
            self._trace.row(LINKS, now, self.address, *_told(event))
        return self.machine.link(event, now) is not False

    def observe(self, observation: Observation, now: Time) -> None:
        """Pass what the robot senses to the machine, and act on it."""
        if self.alive and self.machine.observe(observation, now) is not False:
            self.drain(now)

    def drain(self, now: Time) -> None:
        """Act on all that the machine has left in its queues, and arm its deadline.

        Raise LocalProtocolError for what nobody could send or carry out.
        """
        if not self.alive:  # a dead host has inputs like others, but neither takes nor answers them
            return
        machine = self.machine
        for event in machine.events():  # first: what the device notes below it comes after it
            self._note(event, now)
        for item in machine.outbox():
            wrong = misuse(item, self._channel.size, self._radios)
            if wrong is not None:
                raise LocalProtocolError(f"robot {self.address} at {to_seconds(now):.6f} s: {shown(item)}: {wrong}")
            if not isinstance(item, Outgoing):
                self._channel.command(self.address, item)
            elif item.destination == OPERATOR:
                self.cable.append(Said(now, self.address, item.payload))
            else:
                self.payloads += 1
                self._channel.send(self.address, item)
        commands = machine.commands()
        if commands:
            self.motion += commands
        deadline = machine.wake_at()
        if deadline is not None and (self._timer is None or deadline < self._timer.time):
            self._arm(deadline, now)

    def kill(self) -> None:
        """Stop driving the machine: its host is dead, and what it wanted to do next is not done."""
        self.alive = False
        self.motion.clear()

    def reboot(self, machine: Machine, now: Time) -> None:
        """Drive *machine* from now on, a new one; what the host before it was asked or told to do is forgotten."""
        self.machine = machine if self.clock_offset == 0 else _OtherTime(machine, self.clock_offset)
        self.alive = True
        self.motion.clear()
        self._rearm(now)
        self.drain(now)

    def step_clock(self, by: Time, now: Time) -> Time:
        """Have the machine's clock, which is its offset ahead of *now*, jump by *by* ns, or to where it can.

        It can read 0 to ``LATEST``. Return by how much it has jumped. Deadlines are met when that clock says so, at
        once if it has passed them.
        """
        reads = now + self.clock_offset
        by = max(-reads, min(by, max(0, LATEST - reads)))
        self.clock_offset += by
        if isinstance(self.machine, _OtherTime):
            self.machine.offset = self.clock_offset
        else:
            self.machine = _OtherTime(self.machine, self.clock_offset)
        if self.alive:
            self._rearm(now)
        return by

    def _rearm(self, now: Time) -> None:
        """Arm the machine's deadline, whatever was armed before."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        deadline = self.machine.wake_at()
        if deadline is not None:
            self._arm(deadline, now)

    def _note(self, event: Any, now: Time) -> None:
        if isinstance(event, Call):
            self._trace.row(CALLS, now, self.address, event.depth, event.room, event.call, event.detail)
        else:
            if not isinstance(event, Unrecorded):
                self._trace.event(now, self.address, event)
            for listener in self._listeners:
                listener.note(self.address, event, now)

    def _arm(self, deadline: Time, now: Time) -> None:
        """Have the machine woken at *deadline*, or at once if that is over, and not when it would have been."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._kernel.at(max(deadline, now), self._wake, WAKE)

    def _wake(self) -> None:
        self._timer = None
        if not self.alive:
            return
        now = self._kernel.now
        deadline = self.machine.wake_at()
        if deadline is None:
            return
        if deadline > now:  # it has moved since
            self._arm(deadline, now)
            return
        if self._wakes_wanted:
            self._trace.row(WAKES, now, self.address)
        self.machine.wake(now)
        self.drain(now)
        self._check_awake(now)

    def _check_awake(self, now: Time) -> None:
        """Raise LocalProtocolError if the machine wants to be woken again at once: the run would stand still."""
        deadline = self.machine.wake_at()
        if deadline is not None and deadline <= now:
            raise LocalProtocolError(f"machine {self.address}: after wake({now}) wake_at() is {deadline}, not later")


def _told(event: LinkEvent) -> tuple[str, Address, str]:
    """Return what the table ``links`` holds of *event*: its type, the robot at the other end, and its detail."""
    kind, peer, said = _said(event)
    return kind, peer, link_detail(said, event.radio)


def _said(event: LinkEvent) -> tuple[str, Address, str]:
    match event:
        case InquiryComplete():
            return "InquiryComplete", -1, ""
        case Fate(outcome=outcome):
            return "Fate", -1, outcome.value
        case Connected(peer=peer, role=role) | RoleChanged(peer=peer, role=role):
            return type(event).__name__, peer, role.value
        case ModeChanged(peer=peer, mode=mode):
            return "ModeChanged", peer, mode.value
        case _:
            return type(event).__name__, event.peer, ""


def misuse(item: object, size: int, radios: Container[int]) -> str | None:
    """Return what is wrong with *item* of an outbox in a team of *size*, whose sender has *radios*; None if nothing."""
    if isinstance(item, Outgoing):
        payload: object = item.payload
        if not isinstance(payload, bytes):
            return f"its payload is of the type {type(payload).__name__}, expected bytes"
        if item.destination == OPERATOR:
            return None
        if item.radio not in radios:
            return f"the robot has no radio {item.radio}"
        if item.destination == BROADCAST:
            return None
        named: tuple[Address, ...] = (item.destination,)
    elif isinstance(item, LinkCommand):
        if item.radio not in radios:
            return f"the robot has no radio {item.radio}"
        named = _named(item)
    else:
        return f"it is of the type {type(item).__name__}, expected Outgoing or a link command"
    wrong = [address for address in named if address not in range(size)]
    return f"{wrong[0]} is no robot of the team, expected 0 to {size - 1}" if wrong else None


def shown(item: object) -> str:
    """Return *item* as an error shows it: not all of a long payload."""
    text = repr(item)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def _named(command: LinkCommand) -> tuple[Address, ...]:
    """Return the robots that *command* names."""
    match command:
        case Inquire() | Scan():
            return ()
        case Flush(destination=destination):
            return () if destination == BROADCAST else (destination,)
        case Share(parts=parts, reference=reference):
            return (*(master for master, _, _ in parts), reference)
        case _:
            return (command.peer,)


class _OtherTime:
    """A machine whose clock is ahead by an offset: so is what it is told and says of time, but for its own events."""

    def __init__(self, machine: Machine, offset: Time) -> None:
        self.offset = offset
        self._machine = machine
        self.outbox, self.commands, self.events = machine.outbox, machine.commands, machine.events

    @property
    def finished(self) -> bool:
        return self._machine.finished

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool | None:
        return self._machine.receive(data, reception, now + self.offset)

    def link(self, event: LinkEvent, now: Time) -> bool | None:
        return self._machine.link(event, now + self.offset)

    def observe(self, observation: Observation, now: Time) -> bool | None:
        return self._machine.observe(observation, now + self.offset)

    def wake(self, now: Time) -> None:
        self._machine.wake(now + self.offset)

    def wake_at(self) -> Time | None:
        deadline = self._machine.wake_at()
        return None if deadline is None else deadline - self.offset
