"""A user's own protocol, for the tests of scenarios, sweeps and the command line: robots that call out and count."""

from dataclasses import dataclass

from pydantic import Field

from cosim.machine import BROADCAST, Call, Outgoing
from cosim.protocol import Metric, ProtocolSpec
from cosim.settings import Settings
from cosim.units import S, to_seconds


class Parameters(Settings):
    """Parameters of the beacons."""

    calls: int = Field(default=3, ge=1, description="calls that each robot makes")
    period_s: float = Field(default=1.0, gt=0, description="s, between two calls")
    fail_at_size: int = Field(default=0, ge=0, description="a team of this size breaks down")


@dataclass(frozen=True)
class Called:
    """A robot has called out."""

    number: int


class Beacon:
    """Calls out every period and counts what it hears."""

    def __init__(self, parameters, setup, me, stream, start):
        self.parameters, self.me, self.start = parameters, me, start
        self.called = self.heard = 0
        self.offset = int(stream.integers(1, 1000))
        self._events, self._outbox = [], []

    @property
    def finished(self):
        return self.called == self.parameters.calls

    def receive(self, data, reception, now):
        self.heard += 1

    def link(self, event, now):
        pass

    def observe(self, observation, now):
        pass

    def wake_at(self):
        return (
            None
            if self.finished
            else self.start + self.offset + round((self.called + 1) * self.parameters.period_s * S)
        )

    def wake(self, now):
        self.called += 1
        self._outbox.append(Outgoing(BROADCAST, bytes([self.me, self.called])))
        self._events += [Called(self.called), Call(0, "beacon", "call", str(self.called)), Call(1, "radio", "send")]

    def outbox(self):
        self._outbox, drained = [], self._outbox
        return drained

    def commands(self):
        return []

    def events(self):
        self._events, drained = [], self._events
        return drained


class Witness:
    """The judge: ends nothing."""

    def look(self, x_m, y_m, now):
        return False

    def verdict(self, now):
        return {"watched_s": to_seconds(now)}


def prepare(parameters, surroundings):
    if len(surroundings.starts_m) == parameters.fail_at_size:
        raise RuntimeError("the beacons have broken down")
    return len(surroundings.starts_m)


SPEC = ProtocolSpec(
    name="beacon",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [(1.0 + robot, 1.0) for robot in range(size)],
    prepare=prepare,
    make=Beacon,
    referee=lambda parameters, setup, surroundings: Witness(),
    metrics=(Metric("heard", "1", "payloads heard"), Metric("watched_s", "s", "time that the judge watched")),
    measure=lambda machines: {"heard": float(sum(machine.heard for machine in machines))},
    events=(Called,),
    team_limit=8,
)
NOT_A_SPEC = 3
