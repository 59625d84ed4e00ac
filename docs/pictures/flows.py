"""A protocol for pictures: each robot that a flow begins at sends payloads to where it ends, and that is all."""

from typing import Any

from pydantic import Field

from cosim.machine import Outgoing
from cosim.protocol import Metric, ProtocolSpec
from cosim.settings import Settings
from cosim.units import Time, from_seconds


class Flow(Settings):
    """Payloads from one robot to another."""

    source: int = Field(description="who sends")
    destination: int = Field(description="whom to")
    period_s: float = Field(default=0.1, gt=0, description="s, from payload to payload")
    begin_s: float = Field(default=0.1, ge=0, description="s, when the first is sent")
    octets: int = Field(default=100, ge=1, description="of each payload")


class Parameters(Settings):
    """Who sends what to whom."""

    flows: tuple[Flow, ...] = Field(description="all of them; a robot begins one at most")


class Sender:
    """Sends the payloads of its flow, and counts what it receives."""

    finished = False

    def __init__(self, flow: Flow | None, start: Time) -> None:
        self.flow, self.heard = flow, 0
        self.next = None if flow is None else start + from_seconds(flow.begin_s)
        self._outbox: list[Outgoing] = []

    def receive(self, data: bytes, reception: Any, now: Time) -> None:
        """Count a payload."""
        self.heard += 1

    def link(self, event: Any, now: Time) -> None:
        """Do nothing."""

    def observe(self, observation: Any, now: Time) -> None:
        """Do nothing."""

    def wake_at(self) -> Time | None:
        """Return when the next payload is due."""
        return self.next

    def wake(self, now: Time) -> None:
        """Send the payload that is due."""
        if self.flow is not None and self.next is not None and now >= self.next:
            self.next += from_seconds(self.flow.period_s)
            self._outbox.append(Outgoing(self.flow.destination, bytes(self.flow.octets)))

    def outbox(self) -> list[Outgoing]:
        """Drain what is to be sent."""
        self._outbox, drained = [], self._outbox
        return drained

    def commands(self) -> list[Any]:
        """Return none: nobody moves."""
        return []

    def events(self) -> list[Any]:
        """Return none."""
        return []


class Referee:
    """Ends nothing, and judges nothing."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        """Return that the run goes on."""
        return False

    def died(self, death: Any) -> None:
        """Do nothing."""

    def verdict(self, now: Time) -> dict[str, float]:
        """Return nothing."""
        return {}


def _make(parameters: Parameters, setup: Any, robot: int, stream: Any, start: Time) -> Sender:
    return Sender(next((flow for flow in parameters.flows if flow.source == robot), None), start)


SPEC = ProtocolSpec(
    name="flows",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [(1.0 + robot, 1.0) for robot in range(size)],
    prepare=lambda parameters, surroundings: None,
    make=_make,
    referee=lambda parameters, setup, surroundings: Referee(),
    metrics=(Metric("heard", "1", "payloads received"),),
    measure=lambda machines: {"heard": float(sum(machine.heard for machine in machines))},
    events=(),
)
