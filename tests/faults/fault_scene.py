"""Robots to which faults happen: told to go at an instant, calling out at every tick, noting what they take."""

from dataclasses import replace
from typing import Any

import numpy as np

from cosim.machine import BROADCAST, Address, Command, GoTo, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Death, Metric, ProtocolSpec, Surroundings
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.units import MS, S, Time

TICK = 100 * MS
RADIUS_M, SPEED_MPS, ACCELERATION_MPS2 = 0.2, 0.5, 1.0


class Parameters(Settings):
    """Where the drivers go: x + far_m, or x - far_m for robots of odd number if they are to meet."""

    far_m: float = 0.0
    order_s: float = 0.0
    meet: bool = False
    own: bool = False
    """The goal is meant in the robot's own frame."""
    tokens: bool = False
    """They ask for the fates of their calls."""
    finish_s: float | None = None
    greet: bool = False
    """They call out as soon as they exist."""


class Driver:
    """Is told to go at an instant, calls out at every tick, and notes what it takes."""

    def __init__(self, parameters: Parameters, setup: Surroundings, me: Address, stream: Any, start: Time):
        self.parameters, self.me = parameters, me
        x, y = setup.starts_m[me]
        back = parameters.meet and me % 2
        x, y = (0.0, 0.0) if parameters.own else (x, y)
        self.goal = GoTo(x - parameters.far_m if back else x + parameters.far_m, y)
        self.stream, self.start = stream, start
        self.woken: list[Time] = []
        self.order: Time | None = round(parameters.order_s * S)
        self.observed: list[tuple[Time, Observation]] = []
        self.heard: list[tuple[Time, Address]] = []
        self.news: list[tuple[Time, LinkEvent]] = []
        self.motion: list[Command] = []
        self.out = [Outgoing(BROADCAST, b"greetings")] if parameters.greet else []
        self.now = start

    @property
    def finished(self) -> bool:
        end = self.parameters.finish_s
        return end is not None and self.now >= round(end * S)

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, reception.source))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.news.append((now, event))

    def observe(self, observation: Observation, now: Time) -> None:
        self.now = now
        self.observed.append((now, observation))
        self.out.append(Outgoing(BROADCAST, bytes([self.me]), 0 if self.parameters.tokens else None))

    def wake(self, now: Time) -> None:
        self.order = None
        self.woken.append(now)
        if self.parameters.far_m:
            self.motion.append(self.goal)

    def wake_at(self) -> Time | None:
        return self.order

    def outbox(self) -> list[Any]:
        self.out, drained = [], self.out
        return list(drained)

    def commands(self) -> list[Command]:
        self.motion, drained = [], self.motion
        return drained

    def events(self) -> list[Any]:
        return []


class Coroner:
    """Writes down what it sees and whose death it is told of."""

    def __init__(self, parameters: Parameters, setup: Surroundings, surroundings: Surroundings) -> None:
        self.seen: list[tuple[Time, np.ndarray[Any, Any]]] = []
        self.deaths: list[tuple[int, Death]] = []
        """(looks before it, death)"""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        self.seen.append((now, np.stack((x_m, y_m), axis=1)))
        return False

    def died(self, death: Death) -> None:
        self.deaths.append((len(self.seen), death))

    def verdict(self, now: Time) -> dict[str, float]:
        return {"deaths_told": float(len(self.deaths))}

    def path(self, robot: Address) -> np.ndarray[Any, Any]:
        return np.array([places[robot] for _, places in self.seen])


SPEC = ProtocolSpec(
    name="drivers",
    parameters=Parameters,
    place=lambda parameters, surroundings, size, stream: [(1.0 + 2.0 * robot, 5.0) for robot in range(size)],
    prepare=lambda parameters, surroundings: surroundings,
    make=Driver,
    referee=Coroner,
    metrics=(Metric("deaths_told", "1", "deaths"),),
    measure=lambda machines: {},
    events=(),
    radio=None,
)


class Uninformed:
    """A judge who has no ear for deaths, as those written before there were any."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        return False

    def verdict(self, now: Time) -> dict[str, float]:
        return {"deaths_told": 0.0}


SEEING = replace(SPEC, needs_sight=True)
VIEWING = replace(SPEC, needs_view=True)
OLD = replace(SPEC, referee=lambda parameters, setup, surroundings: Uninformed())  # type: ignore[arg-type,return-value]


def scenario(
    *faults: dict[str, Any], use: str = "tests.faults.fault_scene:SPEC", size: int = 2, **changes: Any
) -> Scenario:
    plain = {
        "duration_s": changes.pop("duration_s", 6.0),
        "floorplan": changes.pop("floorplan", {"map": "walls", "bounds_m": [0, 0, 20, 20]}),
        "team": {
            "size": size,
            "body": {"radius_m": RADIUS_M, "speed_mps": SPEED_MPS, "acceleration_mps2": ACCELERATION_MPS2},
            **changes.pop("team", {}),
        },
        "channel": changes.pop("channel", {"kind": "ideal"}),
        "protocol": {"use": use, "parameters": changes},
        "faults": list(faults),
    }
    return Scenario.model_validate(plain)


def executed(*faults: dict[str, Any], **changes: Any) -> Any:
    """Return the :class:`Simulation` after its run, with what came out of that as its ``outcome``."""
    run = Simulation(scenario(*faults, **changes), 1)
    run.outcome = run.run()  # type: ignore[attr-defined]
    return run


def kill(robot: Address, at_s: float) -> dict[str, Any]:
    return {"kind": "kill", "robot": robot, "at_s": at_s}


def radio_off(robot: Address, at_s: float, until_s: float | None = None) -> dict[str, Any]:
    return {"kind": "radio_off", "robot": robot, "at_s": at_s, "until_s": until_s}


def rows(run: Simulation) -> list[tuple[Time, Address, str]]:
    columns = run.trace.columns("events")
    return list(zip(columns["time_ns"], columns["source"], columns["event"], strict=True))
