"""A team on a small floor: scenarios of whole runs, and machines that drive on wheels of their own without a run."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.arrays import Floats
from cosim.machine import OPERATOR, Address, Command, Drive, Machine, Reception
from cosim.navigation.schemas import beam_directions
from cosim.observation import NOBODY, Observation
from cosim.protocol import Surroundings
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.units import MS, Time
from protocols.deployment.parameters import Parameters
from protocols.deployment.runner import Runner
from protocols.deployment.setup import Setup, setup_of

WIDTH_M, HEIGHT_M = 12.0, 6.0
WALLS = ((0, 0, 12, 0), (12, 0, 12, 6), (12, 6, 0, 6), (0, 6, 0, 0))
STARTS_M = ((1.0, 1.0), (2.0, 1.0), (1.0, 2.0))
PLACES_M = ((5.0, 3.0), (8.0, 4.5), (10.5, 2.0))
BEAMS, RANGE_M, TICK = 60, 5.0, 100 * MS
BODY = {"radius_m": 0.25, "speed_mps": 0.5, "acceleration_mps2": 0.5, "drive": "differential"}
CHANNELS: dict[str, dict[str, Any]] = {
    "ideal": {"kind": "ideal"},
    "lossy": {"kind": "ideal", "loss": 0.2},
    "adhoc": {"kind": "adhoc"},
    "bluetooth": {"kind": "bluetooth"},
}


def call(play: str = "deploy/group", places: Any = PLACES_M, **more: Any) -> dict[str, Any]:
    return {"call": {"play": play, "places": places, **more}}


def scenario(
    channel: str = "ideal",
    faults: Any = (),
    starts: Any = STARTS_M,
    duration_s: float = 400.0,
    walls: Any = WALLS,
    **parameters: Any,
) -> Scenario:
    """Return a scenario on the small floor; without calls of its own the team deploys as a group."""
    own = {"calls": [call()]} | parameters
    if channel == "bluetooth":
        own["courier"] = {"links": {"silence_s": 6.0, "alone_s": 4.0, "stagger_s": 4.0}}
    plain = {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "walls": walls},
        "team": {
            "size": len(starts),
            "starts": starts,
            "senses": {"beams": BEAMS, "beam_range_m": RANGE_M},
            "body": BODY,
        },
        "channel": CHANNELS[channel],
        "protocol": {"use": "protocols.deployment.spec:SPEC", "parameters": own},
        "faults": list(faults),
    }
    return Scenario.model_validate(plain)


def run(channel: str = "ideal", faults: Any = (), seed: int = 1, **parameters: Any) -> Outcome:
    return Simulation(scenario(channel, faults, **parameters), seed).run()


def rows(outcome: Outcome, event: str) -> list[dict[str, Any]]:
    """Return the events of one type, in the order of their times."""
    return [row for row in outcome.trace.arrow("events").to_pylist() if row["event"] == event]


# ---------------------------------------------------------------- machines without a run


def surroundings(starts: Any = STARTS_M, **more: Any) -> Surroundings:
    size = len(starts)

    def forbidden(points: Floats) -> Any:
        x, y = points.T
        return (x < 0) | (x > WIDTH_M) | (y < 0) | (y > HEIGHT_M)

    plain = Surroundings(
        starts_m=tuple(starts),
        radius_m=0.25,
        speed_mps=0.5,
        acceleration_mps2=0.5,
        tick=TICK,
        walls_m=np.array(WALLS, np.float64),
        bounds_m=(0.0, 0.0, WIDTH_M, HEIGHT_M),
        forbidden=forbidden,
        radii_m=(0.25,) * size,
        speeds_mps=(0.5,) * size,
        accelerations_mps2=(0.5,) * size,
        places_m={"hall": ((6.0, 3.0),)},
        scan_range_m=RANGE_M,
        beams=BEAMS,
    )
    return plain._replace(**more)


def setup(starts: Any = STARTS_M, **parameters: Any) -> tuple[Parameters, Setup]:
    own = Parameters.model_validate(parameters)
    return own, setup_of(own, surroundings(starts))


class Box:
    """What a robot sees of the floor's four walls."""

    def __init__(self, x: float, y: float) -> None:
        self._here = x, y

    def sees(self, points_m: Any) -> list[bool]:
        return [True] * len(points_m)

    def ranges_m(self) -> Floats:
        (x, y), ways = self._here, beam_directions(BEAMS)
        with np.errstate(divide="ignore"):
            across = np.where(ways[:, 0] > 0, (WIDTH_M - x) / ways[:, 0], -x / ways[:, 0])
            along = np.where(ways[:, 1] > 0, (HEIGHT_M - y) / ways[:, 1], -y / ways[:, 1])
        nearest = np.minimum(np.where(ways[:, 0] == 0, np.inf, across), np.where(ways[:, 1] == 0, np.inf, along))
        return np.where(nearest < RANGE_M, nearest, np.inf)


class OnWheels:
    """A machine whose own orders move it at once; it sees walls, and nobody: there is room for all to drive through."""

    def __init__(self, runner: Runner, place_m: tuple[float, float]) -> None:
        self.runner = runner
        self._pose = (*place_m, 0.0)
        self._drive = Drive(0.0, 0.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.runner, name)

    def observe(self, observation: Observation, now: Time) -> None:
        x, y, heading = self._pose
        heading += 0.1 * self._drive.turn_radps
        x = min(max(x + 0.1 * self._drive.speed_mps * math.cos(heading), 0.3), WIDTH_M - 0.3)
        y = min(max(y + 0.1 * self._drive.speed_mps * math.sin(heading), 0.3), HEIGHT_M - 0.3)
        self._pose = x, y, heading
        seen = Observation(x, y, heading, self._drive.speed_mps, True, False, NOBODY, Box(x, y))
        self.runner.observe(seen, now)

    def commands(self) -> list[Command]:
        commands = self.runner.commands()
        self._drive = next((each for each in commands if isinstance(each, Drive)), self._drive)
        return commands


def maker(wheels: bool = True, **changes: Any) -> Callable[[Address, Time], Machine]:
    """Return what makes the machines of teams, which all have the same knowledge: nobody changes that."""
    own, known = setup(**changes)

    def make(me: Address, start: Time) -> Machine:
        runner = Runner(own, known, me, start, np.random.default_rng(me))
        return OnWheels(runner, STARTS_M[me]) if wheels else runner  # type: ignore[return-value]

    return make


BY_CABLE = Reception(OPERATOR, False)
"""How what an operator says arrives."""
