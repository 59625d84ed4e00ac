"""Teams in random offices see all that can be seen, touch nothing, and find out for themselves that they have."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from tests.oracles.campaign import soak_count

USE = "protocols.exploration.spec:SPEC"
BLOCKS = 10
LIMIT_S = 3600.0
RADIUS_M = 0.25
LEAST_DOOR_M = 0.9
"""Where a robot of 0.5 m finds its way on a map of cells of 0.1 m: a wall may take one from each side of a door."""
CLOSED_DOOR_M = 0.4
"""Nobody gets through; what can be seen through such a door is to be seen."""


class Office(NamedTuple):
    """A random office and team."""

    number: int
    scenario: Scenario


def office(number: int, **parameters: Any) -> Office:
    """Draw office *number*: its size, rooms, doors, and the size of the team."""
    draw = Streams(1)("exploration offices", str(number))
    width, depth = (round(float(draw.uniform(low, high)), 2) for low, high in ((10.0, 20.0), (8.0, 14.0)))
    door = round(float(draw.uniform(LEAST_DOOR_M, 1.4) if draw.random() < 0.8 else draw.uniform(0.2, CLOSED_DOOR_M)), 2)
    corridor = round(float(draw.uniform(1.4, 2.5)), 2)
    most = min(8, 2 * int(width / (door + 0.4)))
    settings = {
        "width_m": width,
        "depth_m": depth,
        "rooms": int(draw.integers(2, most + 1)),
        "corridor_m": corridor,
        "door_m": door,
        "seed": number,
    }
    plain = {
        "name": f"office {number}",
        "duration_s": LIMIT_S,
        "tick_s": 0.1,
        "floorplan": {"map": "office", "office": settings},
        "team": {
            "size": int(draw.integers(1, 5)),
            "senses": {"beams": 360, "beam_range_m": 2.5},
            "body": {"radius_m": RADIUS_M, "speed_mps": 0.6, "drive": "differential"},
        },
        "channel": {"kind": "ideal"},
        "protocol": {"use": USE, "parameters": parameters},
    }
    return Office(number, Scenario.model_validate(plain))


def run(number: int, **parameters: Any) -> tuple[Simulation, Outcome]:
    simulation = Simulation(office(number, **parameters).scenario, number)
    return simulation, simulation.run()


def wrongs(number: int, **parameters: Any) -> list[str]:
    """Run an office; return what is wrong."""
    simulation, outcome = run(number, **parameters)
    metrics = outcome.metrics
    wrong = []
    if not outcome.simulated_s < LIMIT_S:
        wrong.append("not finished")
    if metrics["blocked_ticks"]:
        wrong.append(f"{metrics['blocked_ticks']:.0f} ticks blocked")
    if metrics["cells_missed"]:
        wrong.append(f"{metrics['cells_missed']:.0f} cells missed")
    return wrong


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_a_team_sees_all_of_an_office_and_touches_nothing(number: int) -> None:
    assert wrongs(number) == []


@pytest.mark.soak
@pytest.mark.parametrize("block", range(BLOCKS))
def test_in_two_hundred_offices_teams_see_all_and_touch_nothing(block: int) -> None:
    numbers = range(block, soak_count(200), BLOCKS)
    assert {number: wrong for number in numbers if (wrong := wrongs(number))} == {}
