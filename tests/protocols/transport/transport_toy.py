"""Robots that do nothing but write to each other, as their parameters have it: transports in a whole run of cosim."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from cosim.machine import Address, Command, Event, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Death, ProtocolSpec, Surroundings
from cosim.scenario import build
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.units import MS, Time, from_seconds, to_seconds
from protocols.transport.parameters import TransportParameters
from protocols.transport.transport import Transport

NEWS_PERIOD: Time = 500 * MS


class Parameters(Settings):
    """Who writes to whom."""

    transport: TransportParameters = Field(default_factory=TransportParameters)
    posts: tuple[tuple[float, Address, Address, int], ...] = Field(
        default=(), description="s of the run, author, destination, bytes"
    )


def payload_of(number: int, octets: int) -> bytes:
    """Return the message that is the *number*-th of all posts."""
    return bytes((number * 31 + place * 7) % 256 for place in range(octets))


class Writer:
    """Writes its messages when it is time, and tells all every so often that it lives."""

    def __init__(self, parameters: Parameters, size: int, me: Address, start: Time) -> None:
        self.me = me
        self.transport = Transport(me, size, parameters.transport, start)
        self.posted: list[int] = []
        """Which of all posts it has sent."""
        self.numbers: dict[int, int] = {}
        """Which of all posts its messages are."""
        self.got: list[tuple[float, Address, bytes]] = []
        self.back: list[int] = []
        self.news_of: dict[Address, list[float]] = {}
        """When news of others came, in s."""
        self._agenda = [
            (from_seconds(at_s), number, to, octets)
            for number, (at_s, author, to, octets) in enumerate(parameters.posts)
            if author == me and from_seconds(at_s) >= start
        ]
        self._told = start - NEWS_PERIOD

    @property
    def finished(self) -> bool:
        return False

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.transport.receive(data, reception, now)
        self._read(now)

    def link(self, event: LinkEvent, now: Time) -> None:
        self.transport.link(event, now)
        self._read(now)

    def observe(self, observation: Observation, now: Time) -> None:
        while self._agenda and self._agenda[0][0] <= now:
            _, number, to, octets = self._agenda.pop(0)
            self.numbers[self.transport.send(to, payload_of(number, octets), now)] = number
            self.posted.append(number)
        if now - self._told >= NEWS_PERIOD:
            self._told = now
            self.transport.publish(0, bytes(60), now)
        self.transport.tick(observation.visible, now)
        self._read(now)

    def wake(self, now: Time) -> None:
        self.transport.wake(now)
        self._read(now)

    def wake_at(self) -> Time | None:
        return self.transport.wake_at()

    def _read(self, now: Time) -> None:
        self.got += [(to_seconds(now), *message) for message in self.transport.messages()]
        for news in self.transport.published():
            self.news_of.setdefault(news.source, []).append(to_seconds(news.at))
        self.back += [self.numbers[number] for _, number in self.transport.returned()]

    def outbox(self) -> list[Outgoing | LinkCommand]:
        return self.transport.drain()

    def commands(self) -> list[Command]:
        return []

    def events(self) -> list[Event]:
        events, self.transport.bad = self.transport.bad, []
        return events


class Nobody:
    """A referee who never ends a run."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        return False

    def died(self, death: Death) -> None:
        pass

    def verdict(self, now: Time) -> dict[str, float]:
        return {}


def place(
    parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> Sequence[tuple[float, float]]:
    return [(1.0 + 2.0 * robot, 1.0) for robot in range(size)]


SPEC = ProtocolSpec(
    name="transport_toy",
    parameters=Parameters,
    place=place,
    prepare=lambda parameters, surroundings: len(surroundings.starts_m),
    make=lambda parameters, size, me, stream, start: Writer(parameters, size, me, start),
    referee=lambda parameters, setup, surroundings: Nobody(),
    metrics=(),
    measure=lambda machines: {},
    events=(),
)


def run(size: int, channel: dict[str, Any], duration_s: float, posts: Any, **more: Any) -> list[Any]:
    """Run *size* robots, which stand in a row, 2 m apart, and return their machines; *more*: transport, faults."""
    transport = more.pop("transport", {})
    data = {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 2.0 * size, 2.0]},
        "team": {"size": size},
        "channel": channel,
        "protocol": {
            "use": "tests.protocols.transport.transport_toy:SPEC",
            "parameters": {"transport": transport, "posts": posts},
        },
        **more,
    }
    simulation = Simulation(build(data, "test", Path()), more.get("seed", 1))
    simulation.run()
    machines: list[Any] = simulation.machines
    return machines
