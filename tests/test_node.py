"""A node drives its machine: deadlines, one drain an instant, one order of what comes out, silence after death."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from cosim.channels.base import Channel
from cosim.errors import LocalProtocolError
from cosim.kernel import DELIVER, WAKE, WORLD, Kernel
from cosim.machine import (
    BROADCAST,
    OPERATOR,
    Address,
    Call,
    Command,
    Connected,
    Disconnect,
    Discovered,
    Drains,
    Drive,
    Event,
    Fate,
    Flush,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Mode,
    ModeChanged,
    Outcome,
    Outgoing,
    Page,
    Reception,
    Role,
    RoleChanged,
    Share,
    Unrecorded,
)
from cosim.node import Node
from cosim.observation import Observation
from cosim.trace import CALLS, LINKS, MESSAGES, WAKES, Trace, events_table, link_told
from cosim.units import S, Time

OBSERVATION = Observation(1.0, 2.0, 0.0, 0.0, True, False)


@dataclass(frozen=True)
class Noted:
    """An event."""

    what: str


class Puppet:
    """A machine that does what its test tells it, and notes what is done to it."""

    def __init__(self) -> None:
        self.deadline: Time | None = None
        self.on_wake: Callable[[Time], None] = lambda now: self.ask(None)
        self.inputs: list[tuple[Time, Any]] = []
        self.drains = 0
        self.out: list[Outgoing | LinkCommand] = []
        self.moves: list[Command] = []
        self.notes: list[Event] = []
        self.finished = False

    def ask(self, deadline: Time | None) -> None:
        self.deadline = deadline

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.inputs.append((now, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.inputs.append((now, event))

    def observe(self, observation: Observation, now: Time) -> None:
        self.inputs.append((now, observation))

    def wake(self, now: Time) -> None:
        self.inputs.append((now, "wake"))
        self.on_wake(now)

    def wake_at(self) -> Time | None:
        return self.deadline

    def outbox(self) -> list[Outgoing | LinkCommand]:
        self.drains += 1
        self.out, drained = [], self.out
        return drained

    def commands(self) -> list[Command]:
        self.moves, drained = [], self.moves
        return drained

    def events(self) -> list[Event]:
        self.notes, drained = [], self.notes
        return drained

    @property
    def wakes(self) -> list[Time]:
        return [time for time, given in self.inputs if given == "wake"]


class Wire(Channel):
    """A channel that notes what it is asked."""

    def __init__(self, kernel: Kernel, trace: Trace, size: int) -> None:
        super().__init__(kernel, trace, size)
        self.asked: list[tuple[Address, Outgoing | LinkCommand]] = []

    def send(self, source: Address, outgoing: Outgoing) -> None:
        self.asked.append((source, outgoing))

    def command(self, source: Address, command: LinkCommand) -> None:
        self.asked.append((source, command))

    def power(self, address: Address, on: bool) -> None:
        pass

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        return ()


class Bench:
    """Two nodes with puppets, on a wire."""

    def __init__(self) -> None:
        self.kernel = Kernel()
        self.trace = Trace([MESSAGES, WAKES, CALLS, events_table((Noted,))])
        self.wire = Wire(self.kernel, self.trace, 2)
        self.puppets = [Puppet(), Puppet()]
        self.nodes = [Node(a, puppet, self.kernel, self.wire, self.trace) for a, puppet in enumerate(self.puppets)]
        for node in self.nodes:
            self.wire.attach(node.address, node)
        self.node, self.puppet = self.nodes[0], self.puppets[0]

    @property
    def wakes(self) -> list[Time]:
        """When the puppet was woken, as it has noted and as the table tells."""
        assert self.trace.columns(WAKES.name) == {"time_ns": self.puppet.wakes, "source": [0] * len(self.puppet.wakes)}
        return self.puppet.wakes

    def arm(self, deadline: Time | None, at: Time) -> None:
        """Let the puppet change its deadline at an instant, by an observation."""

        def fire() -> None:
            self.puppet.deadline = deadline
            self.node.observe(OBSERVATION, at)

        self.kernel.at(at, fire, WORLD)


@pytest.fixture
def bench() -> Bench:
    return Bench()


# ---------------------------------------------------------------- inputs that nothing comes of


class Taciturn(Puppet):
    """Says of each payload whether anything comes of it; of what it observes, and of fates, nothing does."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool | None:
        super().receive(data, reception, now)
        return {b"nothing": False, b"something": True}.get(data)

    def observe(self, observation: Observation, now: Time) -> bool:
        super().observe(observation, now)
        return False

    def link(self, event: LinkEvent, now: Time) -> bool | None:
        super().link(event, now)
        return False if isinstance(event, Fate) else None


@pytest.mark.parametrize("ahead", [0, S])
@pytest.mark.parametrize(
    ("payloads", "drains"),
    [
        ([b"nothing"], 0),
        ([b"nothing", b"nothing"], 0),
        ([b"something"], 1),
        ([b"who knows"], 1),
        ([b"something", b"nothing"], 1),
        ([b"nothing", b"who knows"], 1),
    ],
)
def test_a_machine_is_drained_unless_it_says_that_nothing_came_of_all_inputs(
    bench: Bench, payloads: list[bytes], drains: int, ahead: Time
) -> None:
    machine = bench.node.machine = Taciturn()
    bench.node.step_clock(ahead, 0)
    bench.wire.deliver([(0, payload, Reception(1, False)) for payload in payloads])
    bench.wire.deliver([], [(0, Fate(1, Outcome.SENT))])
    bench.node.observe(OBSERVATION, 0)
    assert len(machine.inputs) == len(payloads) + 2
    assert machine.drains == drains


def test_a_machine_that_said_nothing_is_drained_after_news_and_when_asked(bench: Bench) -> None:
    machine = bench.node.machine = Taciturn()
    bench.wire.deliver([(0, b"nothing", Reception(1, False))], [(0, Lost(1))])
    assert machine.drains == 1
    bench.wire.deliver([(0, b"nothing", Reception(1, False))])
    assert machine.drains == 1
    bench.node.drain(0)
    assert machine.drains == 2


# ---------------------------------------------------------------- what nobody could send


@pytest.mark.parametrize(
    ("item", "wrong"),
    [
        (Outgoing(BROADCAST, "x"), r"payload='x'.*: its payload is of the type str, expected bytes"),
        (Outgoing(OPERATOR, "x"), "expected bytes"),
        (Outgoing(2, b"x"), "2 is no robot of the team, expected 0 to 1"),
        (Outgoing(-3, b"x"), "-3 is no robot"),
        (Outgoing(1, b"x", radio=1), "the robot has no radio 1"),
        (Page(99), r"Page\(peer=99.*: 99 is no robot"),
        (Disconnect(2), "2 is no robot"),
        (Flush(2), "2 is no robot"),
        (Share(8, ((0, 0, 4), (5, 4, 4)), 0), "5 is no robot"),
        (Share(8, (), 7), "7 is no robot"),
        (Share(8, (), 0, radio=1), "the robot has no radio 1"),
        (Page(1, radio=-1), "the robot has no radio -1"),
        (Drive(1.0, 0.0), "it is of the type Drive, expected Outgoing or a link command"),
        (Outgoing(1, 10**6 * "x"), r"xxx\.\.\.: its payload"),
    ],
)
def test_what_nobody_could_send_stops_the_run_and_is_named_with_robot_and_time(bench: Bench, item: Any, wrong: str):
    bench.puppet.on_wake = lambda now: (bench.puppet.out.append(item), bench.puppet.ask(None))
    bench.arm(1_500_000_000, at=0)
    with pytest.raises(LocalProtocolError, match=rf"^robot 0 at 1\.500000 s: .*{wrong}") as told:
        bench.kernel.run(2_000_000_000)
    assert len(str(told.value)) < 250
    assert bench.wire.asked == []


@pytest.mark.parametrize(
    ("event", "peer", "detail"),
    [
        (Discovered(1, 5), 1, ""),
        (Lost(1, 2), 1, "radio=2"),
        (InquiryComplete((1,), 1), -1, "radio=1"),
        (Connected(1, Role.SLAVE, 8, 9), 1, "slave"),
        (RoleChanged(1, Role.MASTER, 3), 1, "master radio=3"),
        (ModeChanged(1, Mode.SNIFF, 1), 1, "sniff radio=1"),
        (Fate(7, Outcome.NO_LINK), -1, "no_link"),
        (Fate(7, Outcome.DELIVERED, 12), -1, "delivered radio=12"),
    ],
)
def test_the_table_of_links_names_any_radio_but_the_first(event: LinkEvent, peer: int, detail: str) -> None:
    trace = Trace([LINKS])
    node = Node(0, Puppet(), Kernel(), Wire(Kernel(), trace, 2), trace)
    node.link(event, 5)
    row = {"time_ns": [5], "source": [0], "event": [type(event).__name__], "peer": [peer], "detail": [detail]}
    assert trace.columns("links") == row
    assert link_told(detail) == (detail.partition("radio=")[0].strip(), event.radio)


def test_the_cable_to_the_operator_is_no_radio(bench: Bench):
    bench.puppet.out = [Outgoing(OPERATOR, b"hello", radio=3)]
    bench.node.drain(7)
    assert bench.node.cable == [(7, 0, b"hello")]


def test_what_waits_for_all_may_be_flushed(bench: Bench):
    bench.puppet.out = [Flush(BROADCAST), Flush(1)]
    bench.node.drain(0)
    assert bench.wire.asked == [(0, Flush(BROADCAST)), (0, Flush(1))]


# ---------------------------------------------------------------- deadlines


def test_a_machine_is_woken_at_its_deadline_after_deliveries(bench: Bench):
    bench.arm(100, at=0)
    bench.kernel.at(100, lambda: bench.wire.deliver([(0, b"x", Reception(1, False))]), DELIVER)
    bench.kernel.run(1000)
    assert bench.puppet.inputs[1:] == [(100, b"x"), (100, "wake")]
    assert bench.kernel.phase == (100, WAKE)


def test_a_deadline_that_moves_later_fires_looks_and_is_set_anew(bench: Bench):
    bench.arm(100, at=0)
    for at in range(1, 90):
        bench.arm(100 + at, at)
    bench.kernel.run(1000)
    assert bench.wakes == [189]
    # 90 observations, the first timer, and the one that it set anew: the others set none
    assert bench.kernel.executed == 92


def test_a_deadline_that_moves_earlier_replaces_the_later_one(bench: Bench):
    bench.arm(100, at=0)
    bench.arm(60, at=10)
    bench.kernel.run(1000)
    assert bench.wakes == [60]
    assert bench.kernel.executed == 3


def test_a_deadline_that_was_taken_back_wakes_nobody(bench: Bench):
    bench.arm(100, at=0)
    bench.arm(None, at=10)
    bench.kernel.run(1000)
    assert bench.wakes == []
    bench.arm(1200, at=1100)
    bench.kernel.run(2000)
    assert bench.wakes == [1200]


def test_a_deadline_in_the_past_is_due_at_once(bench: Bench):
    bench.arm(5, at=10)
    bench.kernel.run(1000)
    assert bench.wakes == [10]


def test_a_machine_sets_its_next_deadline_when_it_wakes(bench: Bench):
    bench.puppet.on_wake = lambda now: bench.puppet.ask(now + 100 if now < 400 else None)
    bench.arm(100, at=0)
    bench.kernel.run(1000)
    assert bench.wakes == [100, 200, 300, 400]


@pytest.mark.parametrize("late", [0, 1])
def test_a_machine_that_stays_due_after_waking_is_stopped(bench: Bench, late: Time):
    bench.puppet.on_wake = lambda now: bench.puppet.ask(now - late)
    bench.arm(100, at=0)
    with pytest.raises(LocalProtocolError, match=rf"machine 0: after wake\(100\) wake_at\(\) is {100 - late}"):
        bench.kernel.run(1000)


# ---------------------------------------------------------------- inputs and what comes out


def test_inputs_of_one_instant_are_drained_once_in_order_of_addresses(bench: Bench):
    for puppet in bench.puppets:
        puppet.out = [Outgoing(BROADCAST, b"answer")]
    arrivals = [(1, b"a", Reception(0, True)), (0, b"b", Reception(1, True)), (1, b"c", Reception(0, False))]
    bench.kernel.at(7, lambda: bench.wire.deliver(arrivals, [(1, Lost(0)), (1, Discovered(0))]))
    bench.kernel.run(10)
    assert [puppet.drains for puppet in bench.puppets] == [1, 1]
    assert bench.puppets[1].inputs == [(7, b"a"), (7, b"c"), (7, Lost(0)), (7, Discovered(0))]
    assert [source for source, _ in bench.wire.asked] == [0, 1]


def test_who_got_nothing_is_not_drained(bench: Bench):
    bench.wire.deliver([(1, b"a", Reception(0, True))])
    assert [puppet.drains for puppet in bench.puppets] == [0, 1]


def test_payloads_and_link_commands_leave_in_one_order(bench: Bench):
    order = [Page(1), Outgoing(1, b"one", token=3), Flush(1), Outgoing(BROADCAST, b"two")]
    bench.puppet.out = list(order)
    bench.node.drain(0)
    assert bench.wire.asked == [(0, item) for item in order]


def test_motion_waits_for_the_world(bench: Bench):
    bench.puppet.moves = [Drive(1.0, 0.0)]
    bench.node.drain(0)
    bench.puppet.moves = [Drive(0.0, 1.0)]
    bench.node.drain(0)
    assert bench.node.motion == [Drive(1.0, 0.0), Drive(0.0, 1.0)]


def test_events_calls_and_payloads_become_rows(bench: Bench):
    bench.puppet.notes = [Noted("one"), Call(2, "radio", "send", "3 bytes"), Noted("two")]
    bench.node.receive(b"\x01\xff", Reception(1, True), 5)
    bench.node.drain(5)
    assert bench.trace.columns("events")["what"] == ["one", "two"]
    assert bench.trace.columns("events")["time_ns"] == [5, 5]
    assert {name: column[0] for name, column in bench.trace.columns("calls").items()} == {
        "time_ns": 5,
        "source": 0,
        "depth": 2,
        "room": "radio",
        "call": "send",
        "detail": "3 bytes",
    }
    assert {name: column[0] for name, column in bench.trace.columns("messages").items()} == {
        "time_ns": 5,
        "source": 0,
        "sender": 1,
        "broadcast": True,
        "payload": "01ff",
    }


def test_what_a_machine_reports_stands_before_what_its_device_does_for_it(bench: Bench):
    bench.puppet.notes = [Call(0, "protocol", "send")]
    bench.puppet.out = [Outgoing(1, b"x")]
    send = bench.wire.send

    def traced(source: Address, outgoing: Outgoing) -> None:
        bench.trace.row(CALLS, 0, source, 1, "device", "transmit", "")
        send(source, outgoing)

    bench.wire.send = traced  # type: ignore[method-assign]
    bench.node.drain(0)
    assert bench.trace.columns("calls")["room"] == ["protocol", "device"]


# ---------------------------------------------------------------- death


def test_a_dead_host_takes_nothing_says_nothing_and_is_not_woken(bench: Bench):
    bench.arm(100, at=0)
    bench.kernel.run(50)
    before = list(bench.puppet.inputs)
    bench.puppet.out = [Outgoing(BROADCAST, b"last words")]
    bench.puppet.moves = [Drive(1.0, 0.0)]
    bench.puppet.notes = [Noted("alive")]
    bench.node.kill()
    bench.wire.deliver([(0, b"a", Reception(1, True))], [(0, Lost(1))])
    bench.node.observe(OBSERVATION, 60)
    bench.kernel.run(200)
    assert bench.puppet.inputs == before
    assert bench.wire.asked == []
    assert bench.node.motion == []
    assert bench.trace.count("events") == bench.trace.count("messages") == 0


class Ears:
    """Hears what machines report."""

    def __init__(self) -> None:
        self.heard: list[tuple[Address, Event, Time]] = []

    def note(self, robot: Address, event: Event, now: Time) -> None:
        self.heard.append((robot, event, now))


@dataclass(frozen=True)
class Confided(Unrecorded):
    """What is for a referee's ears only."""

    value: int


def test_listeners_hear_at_the_true_time_also_what_is_not_recorded(bench: Bench) -> None:
    ears = Ears()
    node = Node(0, bench.puppet, bench.kernel, bench.wire, bench.trace, listeners=[ears])
    node.step_clock(5 * S, 0)  # the machine's clock is nobody else's
    bench.puppet.notes = [Noted("1"), Confided(2), Call(0, "room", "call")]
    node.drain(7)
    assert ears.heard == [(0, Noted("1"), 7), (0, Confided(2), 7)]
    assert bench.trace.columns("events")["event"] == ["Noted"]


def test_queues_are_drained_once_and_stay_the_same_lists() -> None:
    queues = Drains()
    held = queues._events
    held.append(Noted("1"))
    queues._outbox.append(Outgoing(1, b"x"))
    queues._commands.append(Drive(1.0, 0.0))
    assert (queues.events(), queues.outbox(), queues.commands()) == (
        [Noted("1")],
        [Outgoing(1, b"x")],
        [Drive(1.0, 0.0)],
    )
    assert (queues.events(), queues.outbox(), queues.commands()) == ([], [], [])
    held.append(Noted("2"))
    assert queues.events() == [Noted("2")]
