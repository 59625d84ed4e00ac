"""Robots that die at any time, masters and bridges included: those who are left cover all that they can reach.

The campaigns run over three channels: the ideal one, an abstract air of links that takes time and loses broadcasts
(``link_air``), and Bluetooth. Coverage is judged here from the bodies' tracks and a flood of the floor around the dead
bodies, not by the protocol's own referee, which is compared with that.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from shapely.geometry import Point, box

import cosim.simulation
from cosim.channels.ideal import IdealSettings
from cosim.channels.kinds import ChannelSpec
from cosim.geometry.grids import coverage_grid
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.trace import POSES
from tests.protocols.pseudonet.link_air import LinkAir
from tests.tiers import each_value, soak_count, two_tiers

FLOOR: dict[str, Any] = {
    "map": "walls",
    "bounds_m": [0, 0, 8, 6],
    "walls": [[2, 0, 2, 3], [4, 1, 4, 4], [4.5, 1, 4.5, 3.5], [5, 0.5, 5, 3.5], [6, 3, 6, 6]],
}
"""Rooms, and a corridor of one cell."""
TOPOLOGIES = ("ring", "tree", "bridged")
LONGEST_S = 6_000.0
SOAK_KILLS = 200


class Case(NamedTuple):
    """What happens in a run."""

    seed: int
    size: int
    kills: tuple[tuple[int, float], ...]
    """(robot, s)"""
    parameters: dict[str, Any]


def draw(seed: int, sizes: Sequence[int], latest_s: float, most_kills: int = 5) -> Case:
    """Kill at least one robot, and leave at least one, at any time up to *latest_s*."""
    rng = np.random.default_rng(seed)
    size = int(rng.choice(sizes))
    count = int(rng.integers(1, min(size, most_kills + 1)))
    gone = rng.choice(size, count, replace=False).tolist()
    times = rng.uniform(0, latest_s, count).round(4).tolist()
    parameters = {
        "algorithm": ("boustrophedon", "spanning_tree")[seed % 2],
        "topology": TOPOLOGIES[seed % 3],
    }
    return Case(seed, size, tuple(zip(gone, times, strict=True)), parameters)


def run(case: Case, channel: str, monkeypatch: pytest.MonkeyPatch, loss: float = 0.1) -> tuple[Simulation, Outcome]:
    scenario = Scenario.model_validate(
        {
            "duration_s": LONGEST_S,
            "floorplan": FLOOR,
            "team": {"size": case.size},
            "channel": {"kind": "bluetooth" if channel == "bluetooth" else "ideal"},
            "protocol": {"use": "pseudonet", "parameters": case.parameters},
            "faults": [{"kind": "kill", "robot": robot, "at_s": at_s} for robot, at_s in case.kills],
        }
    )
    if channel == "links":
        air = ChannelSpec(
            IdealSettings, lambda settings, site: LinkAir(site.kernel, site.trace, site.size, case.seed, loss)
        )
        monkeypatch.setattr(cosim.simulation, "channel_spec", lambda kind: air)
    simulation = Simulation(scenario, case.seed, (POSES,))
    return simulation, simulation.run()


def left_uncovered(simulation: Simulation, outcome: Outcome, case: Case) -> set[int]:
    """Return the cells that the living could have reached around the dead, and that no body has been in."""
    floor, team = simulation.floorplan, simulation.scenario.team
    poses = outcome.trace.columns(POSES.name)
    at = np.stack([poses["x_m"], poses["y_m"]], axis=1).reshape(-1, case.size, 2)
    grid = coverage_grid(floor.bounds_m, 0.5, team.body.radius_m, floor.walls_m, floor.forbidden, at[0])
    visited = {grid.cell_at(x, y) for x, y in np.unique(at.reshape(-1, 2).round(6), axis=0).tolist()}
    dead = [robot for robot, at_s in case.kills if at_s < outcome.simulated_s]
    solid = set()
    for x, y in at[-1][dead]:
        body = Point(x, y)
        for cell in range(grid.nx * grid.ny):
            cx, cy = grid.centre_m(cell)
            if box(cx - 0.25, cy - 0.25, cx + 0.25, cy + 0.25).distance(body) < team.body.radius_m:
                solid.add(cell)
    living = [robot for robot in range(case.size) if robot not in dead]
    left = [grid.cell_at(x, y) for x, y in at[-1][living]]
    found: set[int] = set()
    while left:
        cell = left.pop()
        if cell not in found:
            found.add(cell)
            left += [c for c in grid.steps[cell].tolist() if c >= 0 and c not in solid]
    return found - visited


def check(case: Case, channel: str, monkeypatch: pytest.MonkeyPatch, loss: float = 0.1) -> Outcome:
    """Fail unless the survivors have covered everything, and all of them know that they have finished."""
    simulation, outcome = run(case, channel, monkeypatch, loss)
    gone = {robot for robot, at_s in case.kills if at_s < outcome.simulated_s}
    assert outcome.simulated_s < LONGEST_S, f"{case}: not over"
    waiting = [robot for robot in range(case.size) if robot not in gone and not simulation.machines[robot].finished]
    assert not waiting, f"{case}: {waiting} have not finished"
    uncovered = left_uncovered(simulation, outcome, case)
    assert not uncovered, f"{case}: {len(uncovered)} cells are left"
    assert outcome.metrics["coverage"] == 1.0, f"{case}: the referee says otherwise"
    return outcome


@pytest.mark.slow
@pytest.mark.parametrize("seed", two_tiers(range(10), 2))
def test_teams_of_a_piconet_finish_without_those_who_die(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    check(draw(seed, range(2, 9), 40), "ideal", monkeypatch)
    check(draw(100 + seed, range(2, 9), 60), "links", monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("seed", two_tiers(range(6), 1))
def test_scatternets_finish_without_those_who_die(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    check(draw(seed, (9, 12, 16), 40), "ideal", monkeypatch)
    check(draw(100 + seed, (9, 12, 16), 60), "links", monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "sizes"), two_tiers([(0, (4, 8)), (1, (9,)), (2, (12,))], 1))
def test_over_bluetooth_too(seed: int, sizes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    check(draw(seed, sizes, 60, most_kills=2), "bluetooth", monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "topology"), each_value((0, 1), TOPOLOGIES))
def test_a_master_dies_at_work(topology: str, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(5, 12, (), {"topology": topology})
    undisturbed, _ = run(case, "links", monkeypatch)
    piconet = undisturbed.machines[0].application.broadcast.registry.directory.piconets[number]  # type: ignore[attr-defined]
    robot = piconet.master
    outcome = check(case._replace(kills=((robot, 35.0),)), "links", monkeypatch)
    assert outcome.metrics["robots_dropped"] == 1  # all others are in one team again
    lost = {robot for robot, event in events(outcome) if event == "TeamLost"}
    assert lost == set(range(12)) - {robot}


def events(outcome: Outcome) -> list[tuple[int, str]]:
    columns = outcome.trace.columns("events")
    return list(zip(columns["source"], columns["event"], strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("topology", two_tiers(TOPOLOGIES, 1))
def test_nobody_loses_its_team_for_lost_broadcasts(topology: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(3, 12, (), {"topology": topology})
    simulation, outcome = run(case, "links", monkeypatch, loss=0.3)
    assert isinstance(simulation.channel, LinkAir)
    assert simulation.channel.broadcasts_lost > 1_000
    assert simulation.channel.bridges_seen >= (3 if topology == "ring" else 1)
    assert outcome.metrics["coverage"] == 1.0
    assert "TeamLost" not in {event for _, event in events(outcome)}
    formed = outcome.trace.columns("events")
    counts = {
        (size, piconets)
        for event, size, piconets in zip(formed["event"], formed["size"], formed["piconets"], strict=True)
        if event == "TeamFormed"
    }
    assert counts == {(12, 3 if topology == "ring" else 2)}
    steps = outcome.metrics["steps"]
    assert [m.application.steps for m in simulation.machines] == [steps] * 12  # type: ignore[attr-defined]


@pytest.mark.soak
@pytest.mark.parametrize("channel", ["ideal", "links"])
def test_many_teams_finish_without_those_who_die(channel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    count = soak_count(SOAK_KILLS)
    for seed in range(1_000, 1_000 + count):
        check(draw(seed, range(2, 9), 60), channel, monkeypatch)
        check(draw(seed, range(9, 33), 80), channel, monkeypatch)
    print(f"{count} teams of a piconet and {count} scatternets finished over {channel}")


@pytest.mark.soak
def test_many_teams_finish_over_bluetooth_without_those_who_die(monkeypatch: pytest.MonkeyPatch) -> None:
    count = soak_count(SOAK_KILLS)
    for seed in range(2_000, 2_000 + count):
        check(draw(seed, range(2, 9) if seed % 2 else range(9, 33), 100), "bluetooth", monkeypatch)
    print(f"{count} teams finished over Bluetooth")
