"""A user's own protocol: the first robot links all others to itself, then everybody sends payloads of all lengths."""

from beacon import Witness
from pydantic import Field

from cosim.machine import BROADCAST, Connected, Inquire, InquiryComplete, Outgoing, Page, Role
from cosim.protocol import Metric, ProtocolSpec
from cosim.settings import Settings
from cosim.units import MS, S

LENGTHS = (1, 17, 27, 100, 121, 183, 224, 339)


class Parameters(Settings):
    """Parameters of the chatter."""

    period_ms: int = Field(default=50, ge=1, description="ms, between two payloads of one robot")


class Chatter:
    """Sends to whom it is linked, the master to one after the other and to all."""

    finished = False

    def __init__(self, parameters, setup, me, stream, start):
        self.period, self.size = parameters.period_ms * MS, setup
        self.peers, self.sent, self.heard = [], 0, 0
        self.deadline = start
        self._outbox = [Inquire(20 * S, self.size - 1)] if me == 0 else []

    def receive(self, data, reception, now):
        self.heard += 1

    def link(self, event, now):
        match event:
            case InquiryComplete(found):
                self._outbox += [Page(peer) for peer in found]
            case Connected(peer, role):
                self.peers += [peer, BROADCAST] if role is Role.MASTER else [peer]

    def observe(self, observation, now):
        pass

    def wake_at(self):
        return self.deadline

    def wake(self, now):
        self.deadline = now + self.period
        if self.peers:
            length = LENGTHS[self.sent % len(LENGTHS)]
            self._outbox.append(Outgoing(self.peers[self.sent // len(LENGTHS) % len(self.peers)], bytes(length)))
            self.sent += 1

    def outbox(self):
        self._outbox, drained = [], self._outbox
        return drained

    def commands(self):
        return []

    def events(self):
        return []


SPEC = ProtocolSpec(
    name="chatter",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [(1.0 + robot, 1.0) for robot in range(size)],
    prepare=lambda parameters, surroundings: len(surroundings.starts_m),
    make=Chatter,
    referee=lambda parameters, setup, surroundings: Witness(),
    metrics=(Metric("heard", "1", "payloads heard"), Metric("watched_s", "s", "time that the judge watched")),
    measure=lambda machines: {"heard": float(sum(machine.heard for machine in machines))},
    events=(),
    team_limit=8,
)
