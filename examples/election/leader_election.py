"""Leader election, an example of a protocol of one's own: over any channel, and again when the leader dies.

Each robot publishes a status once a period: when it was booted, and how many statuses it has published since. A failure
detector watches every robot that has been heard. The living robot of the lowest address leads; each robot decides that
by itself, and a referee, which knows which robots are dead, notes since when all living robots agree.

docs/guides/protocol.md walks through this file; ``election.yaml`` beside it is a scenario.
"""

import math
from dataclasses import dataclass
from struct import Struct
from typing import Final

from pydantic import Field

from cosim.arrays import Floats
from cosim.machine import Address, Drains, Event, LinkEvent, Reception, drained
from cosim.observation import Observation
from cosim.protocol import Death, Metric, ProtocolSpec, Referee, anywhere
from cosim.settings import Period, Settings
from cosim.units import Time, from_seconds, to_seconds
from protocols.detection.detectors import DetectorSettings, FixedTimeoutSettings, make_detector
from protocols.detection.incarnations import Watch
from protocols.transport.decoding import decode_all
from protocols.transport.parameters import TransportParameters
from protocols.transport.transport import Transport
from protocols.wire import BadBytes

STATUS: Final = Struct(">QQ")
"""When the author was booted, in ns of its clock, and the number of the status since then."""
TOPIC: Final = 0
"""Topic of statuses, the only one of this protocol."""


class Parameters(Settings):
    """What a scenario can set."""

    period_s: Period = Field(default=1.0, gt=0, description="s, from one status of a robot to the next")
    detector: DetectorSettings = Field(
        default=FixedTimeoutSettings(timeout_s=8.0), description="failure detector for each robot that has been heard"
    )
    transport: TransportParameters = Field(default=TransportParameters(), description="how statuses are carried")


@dataclass(frozen=True, slots=True)
class Follows:
    """A robot follows another leader from now on."""

    leader: Address


class Elector(Drains):
    """One robot's machine; it stands still and never finishes."""

    finished = False

    def __init__(self, parameters: Parameters, size: int, me: Address, start: Time) -> None:
        """Begin as a robot that has heard no other, and so follows itself."""
        super().__init__()
        self.leader = self.me = me
        self._events.append(Follows(me))
        self._transport = Transport(me, size, parameters.transport, start)
        self._detector = parameters.detector
        self._period = from_seconds(parameters.period_s)
        self._booted = start
        self._next = start + self._period * me // size  # not all at once: frames of one instant collide
        self._number = 0
        self._watches: dict[Address, Watch] = {}

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a frame."""
        self._transport.receive(data, reception, now)
        self._act(now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link, or the fate of a frame."""
        self._transport.link(event, now)
        self._act(now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Keep the links, once a world tick."""
        self._transport.tick(observation.visible, now)
        self._act(now)

    def wake(self, now: Time) -> None:
        """Act on all deadlines up to *now*."""
        self._transport.wake(now)
        self._act(now)

    def wake_at(self) -> Time:
        """Return when the next status, the next suspicion or the transport is due."""
        dues = [self._transport.wake_at(), *(watch.due() for watch in self._watches.values())]
        return min([self._next, *(due for due in dues if due is not None)])

    def _act(self, now: Time) -> None:
        """Publish a status if one is due, take those of others, elect, and leave what is to be sent in the outbox."""
        if not self._next - self._period <= now < self._next:  # one is due, or the clock was set back
            self._transport.publish(TOPIC, STATUS.pack(self._booted, self._number), now)
            self._number += 1
            self._next = now + self._period
        for source, topic, payload, _ in self._transport.published():
            if topic == TOPIC and len(payload) == STATUS.size:
                booted, number = STATUS.unpack(payload)
                self._hear(source, booted, number, now)
            else:
                self._events.append(BadBytes(source, len(payload)))
        self._elect(now)
        self._events += drained(self._transport.bad)
        self._outbox += self._transport.drain()

    def _hear(self, source: Address, booted: Time, number: int, now: Time) -> None:
        watch = self._watches.get(source)
        if watch is None or watch.begun != booted:  # a robot that boots again counts from 0 again
            watch = self._watches[source] = Watch(make_detector(self._detector, self._period, now, booted), now, booted)
        watch.heartbeat(number, now)

    def _elect(self, now: Time) -> None:
        """Follow the robot of the lowest address among this one and those that are not suspected."""
        for watch in self._watches.values():
            watch.look(now)
        leader = min([self.me, *(peer for peer, watch in self._watches.items() if not watch.suspects)])
        if leader != self.leader:
            self.leader = leader
            self._events.append(Follows(leader))


class Agreement(Referee):
    """The referee of a run: notes which leaders the living robots follow, and since when all follow one that lives."""

    def __init__(self) -> None:
        self._leaders: dict[Address, Address] = {}
        self._agreed: Time | None = None

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Let the run go on."""
        return False

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Note which leader a robot follows."""
        if isinstance(event, Follows):
            self._leaders[robot] = event.leader
            self._compare(now)

    def died(self, death: Death) -> None:
        """Forget a robot that is dead."""
        self._leaders.pop(death.robot, None)
        self._compare(death.at)

    def _compare(self, now: Time) -> None:
        followed = set(self._leaders.values())
        if len(followed) != 1 or not followed <= self._leaders.keys():
            self._agreed = None
        elif self._agreed is None:
            self._agreed = now

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the number of leaders, and since when all living robots agree on one."""
        agreed_s = math.nan if self._agreed is None else to_seconds(self._agreed)
        return {"leaders": float(len(set(self._leaders.values()))), "agreed_s": agreed_s}


SPEC = ProtocolSpec(
    name="leader_election",
    about="Robots elect the living one of the lowest address, and another when it dies.",
    parameters=Parameters,
    place=anywhere,
    prepare=lambda parameters, surroundings: len(surroundings.starts_m),
    make=lambda parameters, size, me, stream, start: Elector(parameters, size, me, start),
    referee=lambda parameters, size, surroundings: Agreement(),
    metrics=(
        Metric("leaders", "1", "different leaders that the living robots follow at the end"),
        Metric("agreed_s", "s", "since when all living robots follow one that lives; NaN if they do not"),
    ),
    measure=lambda machines: {},  # what machines count themselves: nothing here
    events=(Follows, BadBytes),
    decode=lambda parameters, size, data: decode_all(data, lambda body: {"status": STATUS.unpack(body.payload)}),
)
