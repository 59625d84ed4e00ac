"""Whole plays by robots whose odometry drifts: they end deployed if they localise, and do not if they do not."""

from typing import Any

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.machine import Address
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.testing import check_machine
from cosim.units import MS, Time
from protocols.deployment.parameters import Parameters
from protocols.deployment.runner import Runner
from protocols.deployment.spec import prepare
from tests.protocols.deployment.crew_scene import STARTS_M, OnWheels, call, rows, setup, surroundings
from tests.protocols.deployment.driving_scene import box, line

WALLS = [
    *box(12.0, 6.0),
    *line((4.0, 0.0), (4.0, 2.0)),
    *line((4.0, 6.0), (4.0, 3.5), (5.5, 3.5)),
    *line((8.0, 2.0), (8.0, 4.0)),
]
"""A room with a door, and a hall with a screen in it."""
DRIFT = {"odometry_slip": 0.05, "odometry_turn_rad": 0.25}
"""Of odometry that is worse than that of real robots, as the ways are shorter."""
MCL: dict[str, Any] = {"positioning": {"kind": "mcl"}}


def deployed(
    senses: dict[str, Any], faults: Any = (), seed: int = 1, duration_s: float = 60.0, **parameters: Any
) -> Outcome:
    """Return what becomes of two robots that go from the room past the screen to the hall's far corners."""
    own = {"base_m": (1.5, 1.5), "calls": [call("deploy/group", [(10.5, 1.5), (10.5, 4.5)])], **parameters}
    plain = {
        "duration_s": duration_s,
        "floorplan": {"map": "walls", "walls": WALLS},
        "team": {
            "size": 2,
            "starts": [(1.5, 1.0), (1.5, 2.0)],
            "senses": {"beams": 90, "beam_range_m": 8.0, **senses},
            "body": {"radius_m": 0.25, "speed_mps": 0.6, "acceleration_mps2": 0.5, "drive": "differential"},
        },
        "channel": {"kind": "ideal"},
        "protocol": {"use": "protocols.deployment.spec:SPEC", "parameters": own},
        "faults": list(faults),
    }
    return Simulation(Scenario.model_validate(plain), seed).run()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "own"),
    [("world", {}), ("own", {}), ("world", {"sonars": [1], "cells_m": [0.05, 0.2]})],
    ids=["lasers", "frames of their own", "sonar and maps of their own"],
)
def test_robots_that_localise_deploy_though_their_odometry_drifts(frames: str, own: dict[str, Any]) -> None:
    metrics = deployed(DRIFT | {"frames": frames}, **MCL, **own).metrics
    assert metrics["deployed"] == metrics["plans_done"] == metrics["places_held"] == 1.0
    assert metrics["collisions"] == metrics["wall_contacts"] == 0.0


@pytest.mark.slow
def test_robots_that_do_not_localise_do_not_deploy() -> None:
    metrics = deployed(DRIFT).metrics
    assert metrics["deployed"] == metrics["places_held"] == 0.0


@pytest.mark.slow
def test_robots_whose_frames_are_their_own_and_known_deploy_without_a_filter() -> None:
    metrics = deployed({"frames": "own"}).metrics
    assert metrics["deployed"] == metrics["plans_done"] == 1.0


@pytest.mark.slow
def test_who_boots_again_knows_where_it_was() -> None:
    """As it does not if it begins anew where its odometry has it, which with this seed has gone astray by then."""
    crash = {"kind": "crash", "robot": 1, "at_s": 16.0, "for_s": 3.0}
    outcome = deployed(DRIFT, [crash], seed=2, silence_s=8.0, alone_s=12.0, again_s=2.0, **MCL)
    assert outcome.metrics["deployed"] == outcome.metrics["places_held"] == 1.0


@pytest.mark.slow
def test_the_same_seed_has_the_same_digest() -> None:
    one, same = (deployed(DRIFT, duration_s=15.0, **MCL) for _ in range(2))
    assert one.digest == same.digest
    assert len(rows(one, "Positioned")) >= 2 * 15


@pytest.mark.slow
def test_robots_that_localise_keep_the_laws() -> None:
    own, known = setup(calls=[call()], listen_s=0.2, news_s=0.3, sonars=[1], **MCL)

    def make(me: Address, start: Time) -> Any:
        return OnWheels(Runner(own, known, me, start, np.random.default_rng(me)), STARTS_M[me])

    check_machine(make, STARTS_M, 800 * MS)


def test_without_a_scanner_nobody_localises() -> None:
    own = Parameters.model_validate(MCL)
    with pytest.raises(UserError, match=r"positioning\.kind"):
        prepare(own, surroundings(beams=0))


def test_cells_are_given_for_all_robots_or_none() -> None:
    with pytest.raises(UserError, match="cells_m: 2 sizes are given for 3 robots"):
        setup(cells_m=[0.1, 0.2])
    _, known = setup(cells_m=[0.1, 0.2, 0.2])
    assert known.floors[0] is known.floor
    assert known.floors[1] is known.floors[2]
    assert [floor.parameters.cell_m for floor in known.floors] == [0.1, 0.2, 0.2]
    assert known.floors[1].grid(0.25)[0].cell_m == 0.2
