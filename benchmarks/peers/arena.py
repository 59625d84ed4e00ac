"""Robots among boxes that keep clear of what their beams meet, as ARGoS's and IR-SIM's examples do.

    python -m benchmarks.peers.arena --robots=10 --beams=100 --range=3 --seconds=60 --seed=1

Equal to ``irsim_arena.py`` as far as README.md says.
"""

import argparse
import math
from collections.abc import Sequence
from time import process_time
from typing import Any

import numpy as np

from benchmarks.peers.timing import Work, tell
from benchmarks.peers.waypoints import Nobody
from cosim.machine import Address, Command, Drive, Event, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import ProtocolSpec, Surroundings, anywhere
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.units import Time

DENSITY = 0.25
"""Robots per square metre."""
LEAST_SIDE_M = 6.3
BOX_M = 0.3
"""Side of a box; there is one for every five robots."""
RADIUS_M = 0.085
SPEED_MPS = 0.3
SLOW_MPS = 0.025
"""Speed of a robot that turns."""
TURN_RADPS = 0.5
NOTICED = 0.02
"""How close something must be to be turned from, 1 being all beams at once at no distance."""
BEHIND_RAD = 1.9
"""What lies farther from ahead than this is not in the way."""


class Beams:
    """What robots have in common: how far the beams go, and what a metre of each counts for, shape (2, n).

    A beam of range R that ends after r counts for (1 - r / R) / n along its direction. The directions of a ring add up
    to nothing, so -r / (n R) comes to the same.
    """

    def __init__(self, parameters: Settings, surroundings: Surroundings) -> None:
        self.range_m = surroundings.scan_range_m
        angles = np.arange(surroundings.beams) * 2.0 * np.pi / surroundings.beams
        self.weights = np.array([np.cos(angles), np.sin(angles)]) / -(self.range_m * surroundings.beams)


class Avoider:
    """One robot: adds up the beams by how close they end, and turns from their sum."""

    finished = False

    def __init__(self, parameters: Settings, beams: Beams, me: Address, stream: Any, start: Time) -> None:
        self._beams = beams
        self._motion: list[Command] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take nothing."""

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take note of nothing."""

    def observe(self, observation: Observation, now: Time) -> None:
        """Turn from what is close ahead, or drive on."""
        beams = self._beams
        x, y = beams.weights.dot(np.minimum(observation.ranges_m, beams.range_m)).tolist()
        bearing = math.remainder(math.atan2(y, x) - observation.heading_rad, math.tau)
        if math.hypot(x, y) < NOTICED or abs(bearing) > BEHIND_RAD:
            self._motion.append(Drive(SPEED_MPS, 0.0))
        else:
            self._motion.append(Drive(SLOW_MPS, -TURN_RADPS if bearing > 0 else TURN_RADPS))

    def wake(self, now: Time) -> None:
        """Do nothing: it has no deadline."""

    def wake_at(self) -> None:
        """Return that there is no deadline."""

    def outbox(self) -> list[Outgoing]:
        """Return nothing: it does not speak."""
        return []

    def commands(self) -> list[Command]:
        """Drain motion."""
        self._motion, drained = [], self._motion
        return drained

    def events(self) -> list[Event]:
        """Return nothing: there is nothing to report."""
        return []


SPEC = ProtocolSpec(
    name="arena",
    parameters=Settings,
    place=anywhere,
    prepare=Beams,
    make=Avoider,
    referee=lambda parameters, beams, surroundings: Nobody(),
    metrics=(),
    measure=lambda machines: {},
    events=(),
    needs_view=True,
)


def boxes(robots: int, side_m: float) -> list[list[list[float]]]:
    """Return the corners of the boxes, none of which touch."""
    places = np.random.default_rng(7).uniform(0.5, side_m - 0.5, (max(2, robots // 5), 2)).tolist()
    kept: list[Sequence[float]] = []
    for x, y in places:
        if all(max(abs(x - other_x), abs(y - other_y)) > BOX_M for other_x, other_y in kept):
            kept.append((x, y))
    half = BOX_M / 2
    return [[[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]] for x, y in kept]


def simulation(robots: int, beams: int, range_m: float, seconds: float, seed: int) -> Work:
    """Set up a run, and return it."""
    side_m = max(math.sqrt(robots / DENSITY), LEAST_SIDE_M)
    corners = [[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]]
    walls = [corners[i - 1] + corners[i] for i in range(4)]
    scenario = Scenario.model_validate(
        {
            "duration_s": seconds,
            "tick_s": 0.1,
            "floorplan": {"map": "walls", "walls": walls, "polygons": boxes(robots, side_m)},
            "team": {
                "size": robots,
                "sight_range_m": 3.0,
                "body": {"radius_m": RADIUS_M, "speed_mps": SPEED_MPS, "drive": "differential"},
                "senses": {"beams": beams, "beam_range_m": range_m},
            },
            "protocol": {"use": "benchmarks.peers.arena:SPEC"},
        }
    )
    run = Simulation(scenario, seed)

    def work() -> dict[str, float]:
        return {"metres_per_robot": run.run().metrics["distance_m"] / robots}

    return work


def set_up(seed: int) -> float:
    """Return the seconds of processor time that it takes to set up a thousand robots."""
    started = process_time()
    simulation(1000, 24, 0.1, 60.0, seed)
    return process_time() - started


def main() -> None:
    """Simulate an arena and tell what it took."""
    parser = argparse.ArgumentParser("python -m benchmarks.peers.arena")
    parser.add_argument("--robots", type=int, required=True)
    parser.add_argument("--beams", type=int, required=True)
    parser.add_argument("--range", type=float, required=True, help="m, of the beams")
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    kind = given.robots, given.beams, given.range
    tell(simulation(*kind, 1.0, 99), lambda: simulation(*kind, given.seconds, given.seed))


if __name__ == "__main__":
    main()
