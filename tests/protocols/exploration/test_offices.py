"""Teams in random offices see all that can be seen, touch nothing, and find out for themselves that they have.

What can be seen is judged by a flood fill (``protocols.exploration.referee``): cells in line of sight within the range
of the scanner, from the centre of a cell that some body can get to. What was seen is what true beams passed, or what
a robot holds for empty: the referee looks at every other tick only. A cell through which a wall passes near its centre,
or that has one on its edge, was seen if that wall was hit: such a hit makes it occupied for ever (``marking``). A cell
with a wall in its very centre is not free.

In four of five offices all doors let robots through, and every cell counts, to the last one. In the others nobody gets
through any door, and rooms are seen through gaps of 0.2 to 0.4 m, from where a robot touches the wall, along lines that
graze the jambs. A robot keeps away from walls, and on a map of cells of 0.1 m a jamb takes a cell of the gap from any
line. So there must be seen what is seen from where bodies fit that are ``SPARE_M`` wider, if all walls are longer by a
cell at both ends.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest

from cosim.arrays import Floats
from cosim.geometry.grids import TOUCH_M
from cosim.geometry.segments import clearance, segment_grid
from cosim.protocol import Surroundings
from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Outcome, Simulation
from cosim.units import S
from protocols.exploration.referee import coverable_cells
from protocols.mapping.belief import Frame
from tests.tiers import soak_count, two_tiers

USE = "protocols.exploration.spec:SPEC"
BLOCKS = 10
LIMIT_S = 3600.0
RADIUS_M = 0.25
LEAST_DOOR_M = 0.9
"""Where a robot of 0.5 m finds its way on a map of cells of 0.1 m: a wall may take one from each side of a door."""
CLOSED_DOOR_M = 0.4
"""Nobody gets through; what can be seen through such a door is to be seen."""
SPARE_M = 0.15
"""A robot plans with half a cell more than its radius, from the edges of occupied cells; those hide a cell's width."""


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


def missed(simulation: Simulation) -> int:
    """Return how many cells of those that must be seen were not."""
    referee: Any = simulation.referee
    frame, given = referee._frame, referee._surroundings
    seen = referee._since >= 0
    room_m = rooms_m(frame, given)
    for node in simulation.nodes:
        machine: Any = node.machine
        evidence = machine.belief.evidence.reshape(-1)
        seen |= (evidence < 0) | ((evidence > 0) & (room_m < 0.5 * frame.cell_m + TOUCH_M))
    lost = coverable_cells(frame, given) & ~seen & (room_m > TOUCH_M)
    if lost.any() and simulation.scenario.floorplan.office.door_m <= CLOSED_DOOR_M:
        lost &= coverable_cells(frame, tightened(given, frame.cell_m))
    return int(np.count_nonzero(lost))


def rooms_m(frame: Frame, given: Surroundings) -> Floats:
    """Return how far the centre of each cell is from the nearest wall, as far as a cell."""
    rows, columns = np.divmod(np.arange(frame.nx * frame.ny), frame.nx)
    centres = np.stack((columns + 0.5, rows + 0.5), axis=1) * frame.cell_m + frame.origin_m
    return clearance(segment_grid(given.walls_m), centres, frame.cell_m)


def tightened(given: Surroundings, cell_m: float) -> Surroundings:
    """Return an office with wider bodies, and walls that are longer by a cell at both ends."""
    starts, ends = given.walls_m[:, :2], given.walls_m[:, 2:]
    along = ends - starts
    more = along / np.hypot(*along.T)[:, None] * cell_m
    walls_m = np.concatenate((starts - more, ends + more), axis=1)
    return given._replace(walls_m=walls_m, radius_m=RADIUS_M + SPARE_M, radii_m=())


def wrongs(number: int, **parameters: Any) -> list[str]:
    """Run an office; return what is wrong."""
    simulation, outcome = run(number, **parameters)
    wrong = [] if outcome.simulated_s < LIMIT_S else ["not finished"]
    if blocked := outcome.metrics["blocked_ticks"]:
        wrong.append(f"{blocked:.0f} ticks blocked")
    if cells := missed(simulation):
        wrong.append(f"{cells} cells missed")
    for robot, node in enumerate(simulation.nodes):
        if left := unnamed(node.machine):
            wrong.append(f"robot {robot} says nothing of {left} frontiers")
    return wrong


def unnamed(explorer: Any) -> int:
    """Return how many frontiers are left in a robot's map that it has not given up, nor another on the same map."""
    leader, belief = explorer.leader, explorer.belief
    return int(np.count_nonzero(belief.frontier & ~belief.vain & ~leader._exclusions.named))


@pytest.mark.slow
@pytest.mark.parametrize("number", two_tiers([9, 12, 18, 2], 2))
def test_a_team_sees_all_of_an_office_and_touches_nothing(number: int) -> None:
    assert wrongs(number) == []


@pytest.mark.slow
def test_the_judge_misses_what_was_not_seen() -> None:
    simulation = Simulation(office(12).scenario, 12)
    simulation.begin()
    simulation.kernel.run(100 * S)
    assert missed(simulation) > 1000
    assert unnamed(simulation.nodes[0].machine) > 10


@pytest.mark.slow
def test_frontiers_that_nobody_can_reach_are_given_up_by_name() -> None:
    simulation, outcome = run(9)
    table = outcome.trace.columns("events")
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    given_up = [row for row in rows if row["event"] == "FrontierGivenUp"]
    assert sum(row["cells"] for row in given_up) == outcome.metrics["given_up"] > 20
    assert {row["why"] for row in given_up} <= {"no way leads there", "nothing new is seen there"}
    frame = simulation.referee._frame  # type: ignore[attr-defined]
    frontier = simulation.nodes[0].machine.belief.frontier  # type: ignore[attr-defined]
    for row in given_up:
        iy, ix = divmod(frame.cell_at((row["x_m"], row["y_m"])), frame.nx)
        assert row["cells"] > 4 or frontier[max(iy - 2, 0) : iy + 3, max(ix - 2, 0) : ix + 3].any()


@pytest.mark.slow
def test_without_the_way_out_a_team_stalls_and_its_run_lasts_to_the_end() -> None:
    """As the paper says (section 1): robots stall in local minima."""
    scenario = office(12, escape={"enabled": False}).scenario.model_copy(update={"duration_s": 700.0})
    outcome = Simulation(scenario, 12).run()
    assert outcome.simulated_s == 700.0
    assert outcome.metrics["stalls"] >= 1
    assert outcome.metrics["coverage"] < 0.95
    assert outcome.metrics["escape_share"] == 0.0


@pytest.mark.slow
def test_with_noise_and_false_returns_a_team_sees_nearly_all() -> None:
    plain = office(17, false_returns=True).scenario
    senses = plain.team.senses.model_copy(update={"range_noise_m": 0.02, "false_return_rate": 0.001})
    scenario = plain.model_copy(update={"team": plain.team.model_copy(update={"senses": senses})})
    outcome = Simulation(scenario, 17).run()
    assert outcome.metrics["coverage"] >= 0.99
    assert outcome.simulated_s < LIMIT_S


@pytest.mark.soak
@pytest.mark.parametrize("block", range(BLOCKS))
def test_in_two_hundred_offices_teams_see_all_and_touch_nothing(block: int) -> None:
    numbers = range(block, soak_count(200), BLOCKS)
    assert {number: wrong for number in numbers if (wrong := wrongs(number))} == {}
