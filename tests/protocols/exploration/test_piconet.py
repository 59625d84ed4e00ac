"""Explorers that merge their maps over the links of a piconet, alone and over Bluetooth."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.machine import BROADCAST, Connected, Outgoing, Page, Role, Scan
from cosim.observation import Observation, Seen, Sighting
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.testing import check_machine
from cosim.units import MS, S
from tests.protocols.exploration.test_laws import STARTS_M, maker
from tests.protocols.mapping.sharing_scene import UNKNOWN


def test_an_explorer_talks_over_its_links_and_remembers_whom_it_has_seen() -> None:
    machine: Any = maker(wheels=False, map="messages", sharing={"links": {}})(0, 0)
    seen = Observation(0.6, 0.6, 0.0, 0.0, True, False, Seen((1,), (Sighting(1, 1.2, 0.6),)))
    machine.observe(seen, 0)
    assert machine.outbox() == [Scan(False), Page(1)]
    machine.link(Connected(1, Role.MASTER), 0)
    machine.observe(Observation(0.6, 0.6, 0.0, 0.0, True, False), S)
    assert [item.destination for item in machine.outbox() if isinstance(item, Outgoing)] == [BROADCAST]
    assert machine._bodies(Observation(0.6, 0.6, 0.0, 0.0, True, False), S).tolist() == [[1.2, 0.6, 0.2 + 0.3]]


@pytest.mark.slow
def test_explorers_that_keep_links_keep_the_laws() -> None:
    check_machine(maker(map="messages", sharing={"links": {}}), STARTS_M, 2500 * MS)


def scenario(size: int, channel: dict[str, Any], duration_s: float) -> dict[str, Any]:
    return {
        "duration_s": duration_s,
        "floorplan": {"map": "office", "office": {"width_m": 8, "depth_m": 6, "rooms": 2}},
        "team": {
            "size": size,
            "senses": {"beams": 360, "beam_range_m": 2.5},
            "body": {"radius_m": 0.2, "speed_mps": 0.3, "drive": "differential"},
        },
        "channel": channel,
        "protocol": {
            "use": "protocols.exploration.spec:SPEC",
            "parameters": {"map": "messages", "sharing": {"links": {}}},
        },
    }


def roomy(size: int, channel: dict[str, Any], duration_s: float) -> dict[str, Any]:
    data = scenario(size, channel, duration_s)
    data["floorplan"]["office"] = {"width_m": 16, "depth_m": 10, "rooms": 2}
    return data


def test_a_team_that_is_too_large_for_a_piconet_is_refused() -> None:
    with pytest.raises(UserError, match=r"sharing\.links: 9 robots, a piconet has at most 8"):
        Simulation(build(roomy(9, {"kind": "ideal"}, 1.0), "test", Path()), 1)
    with pytest.raises(UserError, match=r"sharing\.links: 10 robots, a piconet has at most 9"):
        Simulation(build(roomy(10, {"kind": "ble"}, 1.0), "test", Path()), 1)
    Simulation(build(roomy(9, {"kind": "ble"}, 1.0), "test", Path()), 1)


@pytest.mark.slow
@pytest.mark.parametrize("range_m", [None, 4.0])
def test_robots_that_explore_over_bluetooth_end_with_the_same_map(range_m: float | None) -> None:
    """Also if they are out of robot 0's reach for a while; and every packet's fate is to be received."""
    channel = {"kind": "bluetooth", "range_m": range_m, "supervision_s": 5.0}
    run = Simulation(build(scenario(3, channel, 400.0), "test", Path()), 1)
    outcome = run.run()
    machines: list[Any] = run.machines
    maps = [np.sign(machine.belief.evidence) for machine in machines]
    assert outcome.metrics["coverage"] > 0.99
    assert outcome.metrics["frames_dm3"] > 100
    assert (maps[0] != UNKNOWN).sum() > 1000
    assert all((each == maps[0]).all() for each in maps)
    assert len(machines[0].sharing.ledger.counts) == 3


@pytest.mark.slow
def test_summaries_of_a_full_piconet_fit_its_packets() -> None:
    """Eight robots: after some seconds each knows of pieces of all others."""
    run = Simulation(build(roomy(8, {"kind": "bluetooth"}, 40.0), "test", Path()), 1)
    run.run()
    machines: list[Any] = run.machines
    counts = [machine.sharing.ledger.counts.values() for machine in machines]
    assert [sum(count > 2 for count in each) for each in counts] == [8] * 8
    assert machines[0].sharing._links.slaves == set(range(1, 8))
