"""A campaign of random deployments: rooms and corridors, any strategy and channel, robots killed, frames lost."""

import math
import os
from typing import Any

import numpy as np
import pytest

from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from protocols.deployment.floor import Floor
from protocols.deployment.plan import Place

RUNS = 300
SHARE = float(os.environ.get("SOAK_SHARE", "1"))
RADIUS_M = 0.25
OUTER = [(0, 0, 16, 0), (16, 0, 16, 9), (16, 9, 0, 9), (0, 9, 0, 0)]
ROOMS = {
    "hall": [],
    "rooms": [(5, 0, 5, 3), (5, 4.6, 5, 9), (11, 0, 11, 5), (11, 6.6, 11, 9)],
    "corridor": [(0, 3, 7, 3), (8.6, 3, 16, 3), (0, 5, 3, 5), (4.6, 5, 16, 5)],
}


def places(floor: Floor, stream: np.random.Generator, wanted: int, apart_m: float, near: Place | None) -> list[Place]:
    """Draw places where a robot has room all about, so far from each other."""
    found: list[Place] = []
    for _ in range(10_000):
        low, high = ((0.0, 0.0), (16.0, 9.0)) if near is None else (np.subtract(near, 2.5), np.add(near, 2.5))
        x, y = map(float, stream.uniform(low, high))
        clear = all(math.dist((x, y), other) > apart_m for other in found)
        if clear and floor.free(2.0 * RADIUS_M, (x, y)) and (not found or floor.way(RADIUS_M, (x, y), found[0])):
            found.append((x, y))
            if len(found) == wanted:
                return found
    raise AssertionError("no room")


def drawn(seed: int) -> Scenario:
    """Return the scenario number *seed*."""
    stream = Streams(seed)("random deployment")
    walls = OUTER + ROOMS[str(stream.choice(sorted(ROOMS)))]
    floor = Floor(np.array(walls, np.float64), (0.0, 0.0, 16.0, 9.0), None)
    size = int(stream.integers(2, 6))
    base = places(floor, stream, 1, 0.0, None)[0]
    starts = places(floor, stream, size, 3.2 * RADIUS_M, base)
    ends = places(floor, stream, size, 1.6, None)
    dead = [int(robot) for robot in stream.permutation(size)[: int(stream.integers(0, min(3, size)))]]
    faults = [{"kind": "kill", "robot": robot, "at_s": float(stream.uniform(3.0, 60.0))} for robot in dead]
    play = str(stream.choice(["deploy/group", "deploy/wave", "deploy/leap-frog"]))
    plain: dict[str, Any] = {
        "duration_s": 900.0,
        "floorplan": {"map": "walls", "walls": walls},
        "team": {
            "size": size,
            "starts": starts,
            "senses": {"beams": 90, "beam_range_m": 6.0},
            "body": {"radius_m": RADIUS_M, "speed_mps": 0.6, "acceleration_mps2": 0.6, "drive": "differential"},
        },
        "channel": {"kind": "ideal", "loss": float(stream.choice([0.0, 0.1, 0.3])), "delay_s": 0.002},
        "protocol": {
            "use": "protocols.deployment.spec:SPEC",
            "parameters": {
                "calls": [{"call": {"play": play, "places": ends, "augmented": bool(stream.integers(2))}}],
                "executive": str(stream.choice(["central", "distributed"])),
                "silence_s": 6.0,
                "alone_s": 15.0,
            },
        },
        "faults": faults,
    }
    return Scenario.model_validate(plain)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(max(1, round(RUNS * SHARE))))
def test_a_random_deployment_ends_without_collision_or_deadlock(seed: int, record_property: Any) -> None:
    scenario = drawn(seed)
    metrics = Simulation(scenario, seed).run().metrics
    record_property("random deployments", 1)
    assert metrics["collisions"] == metrics["wall_contacts"] == 0.0
    assert metrics["simulated_s"] < 900.0, "somebody is still under way"
    assert metrics["plans_ended"] >= 1.0
    if not metrics["robots_killed"]:  # a dead body may stand in the only door to a place
        assert metrics["deployed"] == metrics["plans_done"] == 1.0
