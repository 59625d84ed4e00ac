"""A protocol for tests of the web: each robot answers what its operator says, and one of them drives as it is told."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.machine import BROADCAST, OPERATOR, Address, Command, Event, GoTo, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Metric, ProtocolSpec
from cosim.settings import Settings
from cosim.units import S, Time, to_seconds


class Parameters(Settings):
    """Parameters of the consoles."""

    calls: int = 3
    patient: bool = False
    break_at_s: float | None = None


@dataclass(frozen=True)
class Marked:
    """A robot has marked a place on the floor."""

    x_m: float = field(metadata={"unit": "m", "meaning": "where"})
    y_m: float = field(metadata={"unit": "m", "meaning": "where"})
    number: int


@dataclass(frozen=True)
class Answered:
    """A robot has answered its operator."""

    said: str


class Console:
    """Calls out every second, marks where it is, and echoes its operator; ``{"go": [x, y]}`` makes it drive there."""

    def __init__(self, parameters: Parameters, setup: Any, me: Address, stream: np.random.Generator, start: Time):
        self.parameters, self.me, self.start = parameters, me, start
        self.called = 0
        self.heard: list[tuple[Time, bytes, Reception]] = []
        self.at: Observation | None = None
        self._out: list[Outgoing] = []
        self._moves: list[Command] = []
        self._notes: list[Event] = []

    @property
    def finished(self) -> bool:
        return self.called >= self.parameters.calls and not self.parameters.patient

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, data, reception))
        if reception.source != OPERATOR:
            return
        said = json.loads(data)
        if "go" in said:
            self._moves.append(GoTo(*said["go"]))
        self._out.append(Outgoing(OPERATOR, json.dumps({"answer": said.get("request"), "robot": self.me}).encode()))
        self._notes.append(Answered(data.decode()))

    def link(self, event: LinkEvent, now: Time) -> None:
        pass

    def observe(self, observation: Observation, now: Time) -> None:
        self.at = observation
        if self.parameters.break_at_s is not None and now >= self.parameters.break_at_s * S:
            raise RuntimeError("the console has broken")

    def wake_at(self) -> Time | None:
        if self.called >= self.parameters.calls:
            return None
        return self.start + (self.called + 1) * S + self.me

    def wake(self, now: Time) -> None:
        self.called += 1
        self._out.append(Outgoing(BROADCAST, bytes([self.me, self.called])))
        assert self.at is not None
        self._notes.append(Marked(self.at.x_m, self.at.y_m, self.called))

    def outbox(self) -> list[Any]:
        self._out, drained = [], self._out
        return list(drained)

    def commands(self) -> list[Command]:
        self._moves, drained = [], self._moves
        return drained

    def events(self) -> list[Event]:
        self._notes, drained = [], self._notes
        return drained


class Witness:
    """Judges nothing."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        return False

    def died(self, death: Any) -> None:
        pass

    def verdict(self, now: Time) -> dict[str, float]:
        return {"watched_s": to_seconds(now)}


SPEC = ProtocolSpec(
    name="console",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [(2.0 + 2 * robot, 2.0) for robot in range(size)],
    prepare=lambda parameters, surroundings: None,
    make=Console,
    referee=lambda parameters, setup, surroundings: Witness(),
    metrics=(Metric("heard", "1", "payloads heard"), Metric("watched_s", "s", "simulated time")),
    measure=lambda machines: {"heard": float(sum(len(machine.heard) for machine in machines))},
    events=(Marked, Answered),
    rehearsal=lambda machines: [{"go": [3.0, 3.0]}] * len(machines),
)
PLAIN: dict[str, Any] = {
    "name": "consoles",
    "duration_s": 10,
    "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 8], "walls": [[0, 4, 8, 4]]},
    "team": {"size": 3, "body": {"radius_m": 0.2, "speed_mps": 1.0, "acceleration_mps2": 1.0}},
    "protocol": {"use": "tests.web.console:SPEC"},
}
"""A scenario of it, as it stands in YAML."""
