"""The laws of machines, as one function for everybody's tests: ``check_machine(make)``.

A team of machines is driven as a run would drive it: by nodes, over the ideal channel, with bodies that are where they
were sent one tick later. The same drive is repeated with one thing changed that must not matter (nothing, the start
time, every wake called twice, own frames fed back), and what the machines left in their queues is compared. Then bytes
and inputs of every kind are put to machines that are new and to machines in the midst of things.

That encoded frames decode to equal frames cannot be seen from outside; it is left to each protocol's own tests.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from typing import Any, Final, TypeAlias

import numpy as np

from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.radios import RadiosChannel
from cosim.errors import CosimError, LocalProtocolError
from cosim.kernel import WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Call,
    Command,
    Connected,
    Discovered,
    Event,
    Fate,
    GoTo,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Machine,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    PageFailed,
    Reception,
    Role,
    RoleChanged,
    Unrecorded,
)
from cosim.node import Node, misuse, shown
from cosim.observation import Observation, Seen, Sighting
from cosim.randomness import Streams
from cosim.trace import Trace
from cosim.units import MS, S, Time

Maker: TypeAlias = Callable[[Address, Time], Machine]
"""(own address, start time) -> a new machine; equal arguments give equal machines, with streams in equal states."""
Entry: TypeAlias = tuple[Time, str, Any]
"""(time since the start, what was called, what it returned)"""

Point: TypeAlias = tuple[float, float]

STARTS_M: Final[tuple[Point, ...]] = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))
"""Where the team starts, in metres, if the machines know no floor."""
SHIFT: Final[Time] = 86_399 * S + 123_456_789
"""By how much the start is shifted: no multiple of a slot, and more than a 28-bit Bluetooth clock counts."""
JUNK: Final = 200
"""How many random byte strings a machine is given."""
LONG: Final = 16
"""From this length on, random bytes are rarely a frame by chance."""
TRACED: Final = 0.9
"""The share of long random strings that must become an event; the rest may have been frames by chance."""


QUEUES: Final = ("outbox", "commands", "events")


class LawError(CosimError, AssertionError):
    """A machine breaks one of the laws that :func:`check_machine` knows; the text says which, and where."""


def check_machine(
    make: Maker,
    starts_m: Sequence[Point] = STARTS_M,
    duration: Time = 10 * S,
    tick: Time = 100 * MS,
    seed: int = 1,
    radios: int = 1,
    events: Sequence[type] | None = None,
) -> None:
    """Raise LawError unless machines of *make* keep the laws of :class:`cosim.machine.Machine`.

    A team of two or more, which start at *starts_m*, is driven for *duration* with a world tick every *tick*; *seed* is
    that of the random bytes; each robot has so many *radios*. The laws: equal inputs give equal outputs; ``wake_at`` is
    pure, and in the future after ``wake``; that is idempotent; a queue that was drained is empty, and so is that of a
    machine which says that nothing has come of an input; payloads are bytes,
    to robots of the team, link commands name robots of the team, and both radios that robots have; events are of the
    types *events*, if they are given; own frames that come back change nothing; a later start makes all deadlines later
    by as much; bytes of any kind never raise, and those that mean nothing become an event; every other input is taken
    or refused by LocalProtocolError, by a new machine and by one that was driven.
    """
    drill = _Drill(make, tuple(starts_m), duration, tick, radios, None if events is None else (Call, *events))
    plain = drill.run()
    _compare("equal inputs give equal outputs", plain, drill.run(), repr)
    _compare("wake is idempotent", plain, drill.run(twice=True), repr)
    _compare("own frames that come back change nothing", plain, drill.run(echo=True), repr)
    _compare("a later start makes all deadlines later by as much", plain, drill.run(start=SHIFT), _outline)
    payloads = list(dict.fromkeys(chain.from_iterable(watched.payloads for watched in plain)))
    for machines in (drill.fresh(), drill.again(plain, duration)):
        _check_bytes(machines, payloads, Streams(seed)("check_machine"))
    for kind in range(len(_inputs(1, starts_m[0], radios))):
        for machines in (drill.fresh(), drill.again(plain, duration // 10), drill.again(plain, duration)):
            _check_input(machines, kind, starts_m, radios)


class _Watched:
    """A machine that is watched while a node drives it: notes what it returns, checks what can be seen at once."""

    def __init__(
        self, drill: "_Drill", machine: Machine, address: Address, start: Time, twice: bool = False, echo: bool = False
    ) -> None:
        self.machine = machine
        self.address = address
        self.now = start
        self.log: list[Entry] = []
        self.calls: list[tuple[Time, str, tuple[Any, ...]]] = []
        """What the node has called: when, and with which arguments."""
        self.payloads: list[bytes] = []
        self._drill = drill
        self._start = start
        self._twice = twice
        self._echo = echo
        self._returning: list[Outgoing] = []
        self._full = set(QUEUES)
        self._idle = False
        """True if the machine says that nothing has come of what it was told since it was drained."""

    @property
    def finished(self) -> bool:
        return self.machine.finished

    @finished.setter
    def finished(self, value: bool) -> None:
        raise LocalProtocolError("only the machine itself knows when it has finished")

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self._begin("receive", data, reception, now)
        before = self.machine.wake_at()
        self._check(self.machine.receive(data, reception, now), before)

    def link(self, event: LinkEvent, now: Time) -> None:
        self._begin("link", event, now)
        before = self.machine.wake_at()
        self._check(self.machine.link(event, now), before)

    def observe(self, observation: Observation, now: Time) -> None:
        self._begin("observe", observation, now)
        before = self.machine.wake_at()
        self._check(self.machine.observe(observation, now), before)

    def wake(self, now: Time) -> None:
        self._begin("wake", now)
        self.machine.wake(now)
        self._idle = False
        deadline = self.machine.wake_at()
        if deadline is not None and deadline <= now:
            raise LawError(f"machine {self.address}: after wake({now}) wake_at() is {deadline}, not later")
        if self._twice:
            self.machine.wake(now)

    def wake_at(self) -> Time | None:
        deadline = self.machine.wake_at()
        again = self.machine.wake_at()
        if deadline != again:
            raise LawError(f"machine {self.address}: wake_at() is {deadline} ns, then {again} ns at the same instant")
        self._note("wake_at", None if deadline is None else deadline - self._start)
        return deadline

    def outbox(self) -> list[Outgoing | LinkCommand]:
        return self._drain("outbox", self.machine.outbox)

    def commands(self) -> list[Command]:
        return self._drain("commands", self.machine.commands)

    def events(self) -> list[Event]:
        return self._drain("events", self.machine.events)

    def drain(self) -> list[Event]:
        """Drain all queues and return the events."""
        self.outbox()
        self.commands()
        return self.events()

    def resume(self, now: Time) -> None:
        """Go on at *now*, when all that has come of the machine's inputs is drained."""
        self.now = now
        self._full.clear()

    def _begin(self, name: str, *arguments: Any) -> None:
        if not self._full:
            self._idle = True
        self.now = arguments[-1]
        self.calls.append((self.now, name, arguments))
        self._full = set(QUEUES)

    def _check(self, came: bool | None, before: Time | None) -> None:
        """Check a machine that says that nothing has come of an input; its earliest deadline *before* is given."""
        self._idle = self._idle and came is False
        after = self.machine.wake_at()
        if came is False and after is not None and (before is None or after < before):
            raise LawError(f"machine {self.address}: nothing came of an input, but wake_at() was {before}, now {after}")

    def _drain(self, name: str, queue: Callable[[], list[Any]]) -> list[Any]:
        self.calls.append((self.now, name, ()))
        items = list(queue())
        again = queue()
        if again:
            raise LawError(f"machine {self.address}: {name}() drained twice yields {again[0]!r}")
        if items and self._idle:
            raise LawError(f"machine {self.address}: nothing came of its input, but {name}() is {items[0]!r}")
        self._note(name, items)
        self._note("finished", self.finished)
        for item in items:
            wrong = self._drill.wrong(name, item)
            if wrong is not None:
                raise LawError(f"machine {self.address}: {name}(): {shown(item)}: {wrong}")
        sent = [item for item in items if isinstance(item, Outgoing)]
        self.payloads += [item.payload for item in sent]
        self._returning += sent
        self._full.discard(name)
        if self._echo and not self._full:
            self._feed_back()
        return items

    def _note(self, name: str, value: Any) -> None:
        self.log.append((self.now - self._start, name, value))

    def _feed_back(self) -> None:
        """Give the machine what it has sent since the last time; an event that notes this is all that it may leave."""
        returning, self._returning = self._returning, []
        for item in returning:
            with _nothing_raised(f"machine {self.address}: its own frame {item.payload!r} fed back"):
                reception = Reception(self.address, item.destination == BROADCAST, radio=item.radio)
                self.machine.receive(item.payload, reception, self.now)
            left = [*self.machine.outbox(), *self.machine.commands()]
            self.machine.events()
            if left:
                raise LawError(f"machine {self.address}: its own frame {item.payload!r} fed back gave {left[0]!r}")


@dataclass(frozen=True)
class _Drill:
    make: Maker
    starts_m: tuple[Point, ...]
    duration: Time
    tick: Time
    radios: int
    events: tuple[type, ...] | None
    """The types that events may have; None for any."""

    def wrong(self, queue: str, item: Any) -> str | None:
        """Return what is wrong with *item* of a machine's *queue*, if anything is."""
        if queue == "outbox":
            return misuse(item, len(self.starts_m), range(self.radios))
        if queue != "events" or self.events is None or isinstance(item, Unrecorded):
            return None
        if type(item) not in self.events:
            return "its type is not among the event types that are given"
        return None

    def fresh(self) -> list[_Watched]:
        """Return machines that nothing has happened to yet."""
        return [_Watched(self, self.make(address, 0), address, 0) for address in range(len(self.starts_m))]

    def again(self, driven: list[_Watched], until: Time) -> list[_Watched]:
        """Return new machines, each brought to where that of *driven* was at *until*, by the same calls.

        As equal inputs give equal outputs, that is what a drive would give, at the cost of the machines alone.
        """
        machines = self.fresh()
        for watched, before in zip(machines, driven, strict=True):
            for time, name, arguments in before.calls:
                if time >= until:
                    break
                getattr(watched.machine, name)(*arguments)
            watched.resume(until)
        return machines

    def run(self, start: Time = 0, twice: bool = False, echo: bool = False) -> list[_Watched]:
        """Drive a team from *start* for the whole duration and return its machines."""
        kernel = Kernel()
        kernel.run(start)
        trace = Trace()
        size = len(self.starts_m)
        parts = [IdealChannel(IdealSettings(delay_s=1e-3), kernel, trace, size) for _ in range(self.radios)]
        channel = parts[0] if self.radios == 1 else RadiosChannel(kernel, trace, parts, [range(self.radios)] * size)
        machines = [_Watched(self, self.make(a, start), a, start, twice, echo) for a in range(len(self.starts_m))]
        nodes = [Node(watched.address, watched, kernel, channel, trace) for watched in machines]
        for node in nodes:
            channel.attach(node.address, node)
        with _nothing_raised("a drive as in a run"):
            kernel.at(start, _Floor(kernel, nodes, self.starts_m, self.tick).begin, WORLD)
            kernel.run(start + self.duration)
        for watched in machines:
            watched.now = kernel.now
        return machines


class _Floor:
    """An empty floor on which robots are where they were sent at the next tick, and see each other."""

    def __init__(self, kernel: Kernel, nodes: list[Node], starts_m: tuple[Point, ...], tick: Time) -> None:
        self._kernel = kernel
        self._nodes = nodes
        self._places = list(starts_m)
        self._duration = tick

    def begin(self) -> None:
        """Act on what the machines were made with, then let them sense for the first time, as a run does."""
        for node in self._nodes:
            node.drain(self._kernel.now)
        self._tick()

    def _tick(self) -> None:
        for node in self._nodes:
            for command in node.motion:
                if isinstance(command, GoTo):
                    self._places[node.address] = command.x_m, command.y_m
            node.motion.clear()
        for node in self._nodes:
            others = tuple(other.address for other in self._nodes if other is not node)
            seen = tuple(Sighting(other, *self._places[other]) for other in others)
            observation = Observation(*self._places[node.address], 0.0, 0.0, True, False, Seen(others, seen))
            node.observe(observation, self._kernel.now)
        self._kernel.after(self._duration, self._tick, WORLD)


def _compare(law: str, one: list[_Watched], other: list[_Watched], view: Callable[[Any], Any]) -> None:
    for first, second in zip(one, other, strict=True):
        logs = [[(time, name, view(value)) for time, name, value in watched.log] for watched in (first, second)]
        for entry, changed in zip_longest(*logs):
            if entry != changed:
                raise LawError(f"{law}: machine {first.address}: {entry} became {changed}")


def _outline(value: Any) -> Any:
    """Return what may not depend on the start time: deadlines, and the number of items, which may hold times."""
    return len(value) if isinstance(value, list) else value


@contextmanager
def _nothing_raised(what: str) -> Iterator[None]:
    try:
        yield
    except LawError:
        raise
    except Exception as error:  # whatever a machine raises here breaks the law that is checked, and is reported as that
        raise LawError(f"{what} raised {error!r}") from error


def _check_bytes(machines: list[_Watched], payloads: list[bytes], stream: np.random.Generator) -> None:
    """Give every machine random bytes, and damaged frames of the team's own."""
    junk = [b"", b"\x00", b"\xff", *(stream.bytes(int(size)) for size in stream.integers(1, 65, JUNK))]
    damaged = [_damage(payload, stream) for payload in payloads[:JUNK]]
    for watched in machines:
        long = traced = 0
        source = (watched.address + 1) % len(machines)
        for index, data in enumerate([*junk, *damaged]):
            with _nothing_raised(f"bytes never raise: machine {watched.address}: receive({data!r})"):
                watched.receive(data, Reception(source, bool(index % 2)), watched.now)
                events = watched.drain()
            if len(data) >= LONG and index < len(junk):
                long += 1
                traced += bool(events)
        if traced < TRACED * long:
            share = f"{traced} of {long} random strings did"
            raise LawError(f"bytes that mean nothing become an event: machine {watched.address}: {share}")


def _damage(payload: bytes, stream: np.random.Generator) -> bytes:
    """Cut *payload* short, flip a bit in it, or add a byte."""
    place = int(stream.integers(len(payload) + 1))
    match int(stream.integers(3)):
        case 0:
            return payload[:place]
        case 1 if place < len(payload):
            return payload[:place] + bytes([payload[place] ^ 1 << int(stream.integers(8))]) + payload[place + 1 :]
        case _:
            return payload[:place] + stream.bytes(1) + payload[place:]


def _inputs(peer: Address, place: Point, radios: int = 1) -> list[LinkEvent | Observation | None]:
    """Return inputs of every kind but bytes: news about *peer*, a body at *place* (m), and None for a wake.

    There is news by each of so many *radios*.
    """
    news: list[LinkEvent] = [
        Discovered(peer),
        InquiryComplete(()),
        InquiryComplete((peer,)),
        *(Connected(peer, role) for role in Role),
        PageFailed(peer),
        Lost(peer),
        *(ModeChanged(peer, mode) for mode in Mode),
        *(RoleChanged(peer, role) for role in Role),
        *(Fate(token, outcome) for token in (0, 1_000_000) for outcome in Outcome),
    ]
    return [
        *(replace(each, radio=radio) for radio in range(radios) for each in news),
        *(Observation(*place, 0.0, 0.0, a, b, Seen((peer,))) for a in (False, True) for b in (False, True)),
        None,
    ]


def _check_input(machines: list[_Watched], kind: int, starts_m: Sequence[Point], radios: int) -> None:
    """Give every machine the input number *kind*, about the next machine of the team and its own start."""
    for watched in machines:
        given = _inputs((watched.address + 1) % len(machines), starts_m[watched.address], radios)[kind]
        with _nothing_raised(f"every input is taken or refused: machine {watched.address}: {given or 'wake'}"):
            try:
                if given is None:
                    watched.wake(watched.now)
                elif isinstance(given, Observation):
                    watched.observe(given, watched.now)
                else:
                    watched.link(given, watched.now)
                watched.drain()
            except LocalProtocolError:
                continue
