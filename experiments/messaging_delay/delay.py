"""Fig. 9b of paper 003 measured: how many slots the air interface needs until every robot knows every robot's state.

Each strategy is a pair of machines on the real Bluetooth channel: the piconet is set up by inquiry and paging, the
slaves load their state, and some time later the master begins. The count is taken from the frames: from the start of
the first frame to the end of the last slot pair. Nothing of a formula enters it.
"""

from enum import StrEnum
from typing import Final

from pydantic import Field

from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.errors import CosimError
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Command, Event, Fate, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.node import Node
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.settings import Count, Settings
from cosim.trace import FRAMES, Trace
from cosim.units import MS, SLOT, S, Time
from protocols.pseudonet.algorithms.base import UNJUDGED
from protocols.pseudonet.bluetooth import Bluetooth, LinkState
from protocols.pseudonet.broadcast import Broadcast
from protocols.pseudonet.messages import Action, Kind, Message, Sync, decode, encode
from protocols.pseudonet.parameters import TeamParameters, Timing
from protocols.pseudonet.upcalls import Exchanged, MessageWanted, TeamChanged, Upcall

SET_UP: Final = TeamParameters(inquiries=5, page_attempts=3)
TIMES: Final = Timing(
    step=S,
    retry=100 * MS,
    poll_timeout=200 * MS,
    repair=10 * S,
    inquiry=10 * S + 240 * MS,
    page=10 * S,
    settle=S,
    stagger=60 * S,
    silence=60 * S,
)
SETTLE: Final = 10 * MS
"""Time between the set-up and the exchange that is measured."""
T_POLL_SLOTS: Final = 96_000
"""Poll interval of the link controller, so long that only the strategy polls."""
SUPERVISION_S: Final = 120.0


class Strategy(StrEnum):
    """How states travel."""

    BROADCAST = "broadcast"
    """Pseudonet: poll, answer, broadcast (Fig. 9a)."""
    UNICAST = "unicast"
    """Each state to each robot in a packet of its own; polls carry nothing."""
    PIGGYBACK = "unicast_piggyback"
    """The master's state rides on the polls, the slaves' on the answers; the rest is unicast."""
    ONE_BROADCAST = "one_message_broadcast"
    """The state of one slave only, polled and broadcast."""
    ONE_UNICAST = "one_message_unicast"
    """The state of one slave only, polled and sent to each other slave in turn."""


class Parameters(Settings):
    """What the experiment varies."""

    team_size: int = Field(ge=2, le=8)
    strategy: Strategy
    n_bc: Count = Field(default=1, ge=1)


def state(source: Address, exchange: int = 0) -> bytes:
    """Return a state message as Pseudonet encodes it: one slot long."""
    return encode(_message(source, exchange))


def _message(source: Address, exchange: int) -> Message:
    return Message(source, Kind.STATE, exchange, 0, 0, Action.STAY, UNJUDGED)


class _Endpoint:
    """What the machines of all strategies share: the set-up, and nothing to observe or to drive."""

    finished = False

    def __init__(self, me: Address, size: int, start: Time) -> None:
        self.me = me
        self.size = size
        self.deadline: Time | None = start
        self.began: Time | None = None
        self.out: list[Outgoing | LinkCommand] = []
        self.setup = Bluetooth(me, size, {}, TIMES, SET_UP, self._ready, lambda now: None)

    def _ready(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        if len(slaves) != self.size - 1:
            raise CosimError(f"only {len(slaves)} of {self.size - 1} slaves were found")
        self.deadline = now + SETTLE

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Know one state more."""

    def observe(self, observation: Observation, now: Time) -> None:
        """See nothing."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Set up."""
        self.setup.link(event, now)

    def wake(self, now: Time) -> None:
        """Start the set-up, later the exchange."""
        if self.deadline is None or now < self.deadline:
            return
        self.deadline = None
        if self.setup.state is LinkState.OFF:
            self.setup.start(now)
        else:
            self.began = now
            self._begin(now)

    def _begin(self, now: Time) -> None:
        """Begin the exchange, as the master."""

    def wake_at(self) -> Time | None:
        """Return when the next thing begins."""
        return self.deadline

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain."""
        out = self.setup.out + self.out
        self.setup.out.clear()
        self.out = []
        return out

    def commands(self) -> list[Command]:
        """Drive nowhere."""
        return []

    def events(self) -> list[Event]:
        """Report nothing."""
        return []


class UnicastSlave(_Endpoint):
    """A slave that has its state loaded for whatever packet addresses it first."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Load the state once the link is up."""
        before = self.setup.state
        super().link(event, now)
        if self.setup.state is not before and self.setup.state is LinkState.JOINED:
            self.out.append(Outgoing(0, state(self.me)))


class UnicastMaster(_Endpoint):
    """A master that collects the slaves' states and sends every state on by unicast."""

    def __init__(self, me: Address, size: int, start: Time, strategy: Strategy) -> None:
        super().__init__(me, size, start)
        self.strategy = strategy
        self._states: dict[Address, bytes] = {}
        self._awaited: set[Address] = set()

    def _begin(self, now: Time) -> None:
        slaves = list(self.setup.links)[: 1 if self.strategy.startswith("one_message") else None]
        piggyback = self.strategy is Strategy.PIGGYBACK
        poll = state(self.me) if piggyback else encode(Sync(self.me, 0, tuple(range(self.size)), False))
        self.out += [Outgoing(slave, poll) for slave in slaves]
        self._awaited = set(slaves)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a slave's state; with the last one, send all on."""
        if reception.source not in self._awaited:
            return  # a state that nobody asked for: it came with the acknowledgement of a packet to that slave
        self._states[reception.source] = data
        self._awaited.remove(reception.source)
        if self._awaited:
            return
        if self.strategy is Strategy.ONE_BROADCAST:
            self.out.append(Outgoing(BROADCAST, data))
            return
        known = dict(self._states)
        if self.strategy is Strategy.UNICAST:
            known = {self.me: state(self.me), **known}
        self.out += [
            Outgoing(slave, message)
            for source, message in known.items()
            for slave in self.setup.links
            if slave != source
        ]


class BroadcastMember(_Endpoint):
    """Master or slave of Pseudonet's own broadcast room, without an application: the first exchange is a roll call."""

    def __init__(self, me: Address, size: int, start: Time) -> None:
        super().__init__(me, size, start)
        self.room = Broadcast(me, (TIMES.poll_timeout, TIMES.repair), 4, acknowledge=False, upcall=self._upcall)

    def _ready(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        super()._ready(slaves, hop, now)
        self.deadline = None
        self.room.assemble(tuple(range(self.size)), hop, now)

    def _upcall(self, upcall: Upcall, now: Time) -> None:
        master = self.me == 0
        match upcall:
            case TeamChanged():
                self._load(now)
            case Exchanged(roll_call=True) if master:
                self.deadline = now + SETTLE
            case Exchanged() | MessageWanted() if not master:
                self._load(now)

    def _load(self, now: Time) -> None:
        message = _message(self.me, self.room.exchange)
        self.room.load(message, now)

    def _begin(self, now: Time) -> None:
        self._load(now)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a packet."""
        decode(data)
        self.room.receive(data, reception, now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Set up, or learn a poll's fate."""
        if isinstance(event, Fate):
            self.room.fate(event, now)
        else:
            super().link(event, now)

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain both rooms."""
        out = super().outbox() + self.room.out
        self.room.out.clear()
        return out


@experiment_function
def measure(parameters: dict[str, object], seed: int) -> dict[str, float]:
    """Run one exchange and return its length in slots, beside what the paper and the air interface let expect."""
    given = Parameters.model_validate(parameters)
    slots = exchange_slots(given, seed)
    expected = formula(given)
    return {
        "slots": float(slots),
        "formula_slots": float(expected),
        "difference_slots": float(slots - expected),
        "paper_ideal_slots": float(2 * (given.team_size - 1) + 1),
    }


def formula(parameters: Parameters) -> int:
    """Return the closed form, in slots, that the count is compared with."""
    m, n_bc = parameters.team_size, parameters.n_bc
    match parameters.strategy:
        case Strategy.BROADCAST:
            return 2 * n_bc * m + 2 * (m - 1)
        case Strategy.UNICAST:
            return 2 * m * (m - 1)
        case Strategy.PIGGYBACK:
            return 2 * (m - 1) ** 2
        case Strategy.ONE_BROADCAST:
            return 2 + 2 * n_bc
        case Strategy.ONE_UNICAST:
            return 2 * (m - 1)


def exchange_slots(parameters: Parameters, seed: int) -> int:
    """Return the slots from the start of the first frame to the end of the last slot pair of one exchange."""
    kernel, trace, size = Kernel(), Trace((FRAMES,)), parameters.team_size
    settings = BluetoothSettings(
        n_bc=parameters.n_bc, t_poll_slots=T_POLL_SLOTS, supervision_s=SUPERVISION_S, clock_ppm=0
    )
    channel = BluetoothChannel(settings, kernel, trace, size, Streams(seed))
    machines = [_machine(parameters, robot, size) for robot in range(size)]
    for robot, machine in enumerate(machines):
        node = Node(robot, machine, kernel, channel, trace)
        channel.attach(robot, node)
        node.drain(0)
    kernel.run(60 * S)
    began = machines[0].began
    if began is None:
        raise CosimError("the set-up took more than a minute")
    frames = trace.columns("frames")
    starts: list[Time] = [
        time for time, source in zip(frames["time_ns"], frames["source"], strict=True) if source == 0 and time >= began
    ]
    return (max(starts) - min(starts)) // SLOT + 2


def _machine(parameters: Parameters, robot: Address, size: int) -> _Endpoint:
    if parameters.strategy is Strategy.BROADCAST:
        return BroadcastMember(robot, size, 0)
    return UnicastMaster(robot, size, 0, parameters.strategy) if robot == 0 else UnicastSlave(robot, size, 0)
