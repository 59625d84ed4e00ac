"""Information utility: counted cells, weighted sums and choices against plain loops over all cells."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.geometry.astar import clearance_cost, costs_from, passable_cells
from cosim.geometry.marking import CERTAIN, frontier_grid
from cosim.machine import Event
from cosim.navigation.frontier_fields import sum_of_frontiers
from cosim.units import MS
from protocols.exploration.behaviour import Behaviour
from protocols.exploration.events import Counters, PathLaid
from protocols.exploration.information import Attraction, count_unknown, most_useful, sum_by_utility, utility
from protocols.exploration.parameters import Parameters
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief, Frame
from tests.protocols.exploration.hand_map import at, drawn, observed

NY, NX, CELL_M, ORIGIN_M = 23, 29, 0.5, (-1.0, 2.0)
FORK = """
    ????????????#############
    ????????????#############
    ????????????.........?###
    ????????????#############
    ????????????#############
"""
"""A corridor between an open unknown and a niche; its middle is as far from both."""


def random_map(seed: int) -> Any:
    draw = np.random.default_rng(seed)
    return draw.choice(np.array([-1, 0, 127], np.int8), (NY, NX), p=(0.6, 0.3, 0.1))


def unknown_about(evidence: Any, iy: int, ix: int, half: int) -> int:
    """Count by looking at each cell."""
    rows = range(max(iy - half, 0), min(iy + half + 1, evidence.shape[0]))
    columns = range(max(ix - half, 0), min(ix + half + 1, evidence.shape[1]))
    return sum(evidence[y, x] == 0 for y in rows for x in columns)


def frontiers_of(evidence: Any) -> Any:
    belief = Belief(Frame(ORIGIN_M, CELL_M, evidence.shape[1], evidence.shape[0]), CERTAIN, 2.5)
    belief.evidence[:] = evidence
    belief.frontier[:] = frontier_grid(belief.evidence, True)
    return belief


# ---------------------------------------------------------------- counting


@pytest.mark.parametrize(("low_x", "low_y", "rows", "columns"), [(0, 0, NY, NX), (5, 3, 9, 7), (-6, -4, 40, 50)])
def test_sums_count_unknown_cells_to_the_left_and_below(low_x: int, low_y: int, rows: int, columns: int) -> None:
    evidence = random_map(1)
    sums = np.full((rows + 1, columns + 1), -7, np.int32)
    count_unknown(evidence, low_x, low_y, sums)
    for i in range(0, rows + 1, 3):
        for j in range(0, columns + 1, 4):
            cells = [(y, x) for y in range(low_y, low_y + i) for x in range(low_x, low_x + j)]
            inside = [evidence[y, x] == 0 for y, x in cells if 0 <= y < NY and 0 <= x < NX]
            assert sums[i, j] == sum(inside)


def test_a_straight_front_counts_as_one_and_a_lone_cell_as_next_to_nothing() -> None:
    evidence = np.full((40, 40), -1, np.int8)
    evidence[:, 20:] = 0
    sums = np.zeros((41, 41), np.int32)
    count_unknown(evidence, 0, 0, sums)
    assert utility(sums, 15, 20, 5) == 1.0
    assert utility(sums, 15, 30, 5) == pytest.approx(11 / 6)
    evidence[:] = -1
    evidence[15, 20] = 0
    count_unknown(evidence, 0, 0, sums)
    assert utility(sums, 15, 20, 5) == 1 / 66


def test_utility_counts_the_square_about_a_cell_also_at_the_edge() -> None:
    evidence = random_map(2)
    sums = np.zeros((NY + 1, NX + 1), np.int32)
    count_unknown(evidence, 0, 0, sums)
    for iy in range(NY):
        for ix in range(NX):
            assert utility(sums, iy, ix, 4) == pytest.approx(unknown_about(evidence, iy, ix, 4) / 45)


# ---------------------------------------------------------------- the sum


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("weight", [0.3, 1.0])
def test_the_sum_is_equation_3_with_a_gain_for_each_cell(seed: int, weight: float) -> None:
    belief = frontiers_of(random_map(seed))
    attracting = belief.frontier.copy()
    path = np.argwhere(belief.evidence < 0)[::17]
    attracting[tuple(path.T)] = 1
    here, reach_m, half = np.array([6.13, 7.41]), 4.2, 5
    expected = np.zeros(2)
    for iy, ix in np.argwhere(attracting[:, :NX]):
        away = np.array([ORIGIN_M[0] + (ix + 0.5) * CELL_M, ORIGIN_M[1] + (iy + 0.5) * CELL_M]) - here
        d = np.hypot(*away)
        if d <= reach_m:
            told = unknown_about(belief.evidence, iy, ix, half) / ((half + 1) * (2 * half + 1))
            gain = 1 - weight + weight * told if belief.evidence[iy, ix] == 0 else 1.0
            expected += gain * away / d**3
    sums = np.zeros((NY + 1, NX + 1), np.int32)
    count_unknown(belief.evidence, 0, 0, sums)
    found = sum_by_utility(
        attracting, belief.evidence, sums, 0, 0, half, weight, *ORIGIN_M, CELL_M, here[0], here[1], reach_m
    )
    assert found == pytest.approx(tuple(expected), rel=1e-9)
    attraction = Attraction(belief, reach_m, half * CELL_M, weight)
    assert attraction.to((here[0], here[1]), attracting) == pytest.approx(tuple(expected), rel=1e-9)


def test_without_a_weight_all_frontiers_draw_alike() -> None:
    belief = frontiers_of(random_map(3))
    plain = sum_of_frontiers(belief.frontier, *ORIGIN_M, CELL_M, 6.13, 7.41, 4.2)
    assert Attraction(belief, 4.2, 2.5, 0.0).to((6.13, 7.41), belief.frontier) == plain
    assert Attraction(belief, 4.2, 2.5, 0.5).to((6.13, 7.41), belief.frontier) != pytest.approx(plain)


def test_cells_are_counted_anew_after_five_ticks_or_half_a_metre() -> None:
    for step_m, renewed in ((0.0, 5), (0.3, 3), (1.1, 1)):
        belief = frontiers_of(random_map(4))
        attraction = Attraction(belief, 4.2, 2.5, 1.0)
        frontier = belief.frontier.copy()
        attraction.to((6.13, 7.41), frontier)
        belief.evidence[:5] = -1
        for tick in range(1, 6):
            here = 6.13 + tick * step_m, 7.41
            fresh = Attraction(belief, 4.2, 2.5, 1.0).to(here, frontier)
            assert (attraction.to(here, frontier) == pytest.approx(fresh, rel=1e-12)) is (tick >= renewed), (
                step_m,
                tick,
            )


def led(information: float, choice: str = "nearest") -> tuple[Behaviour, list[Event]]:
    journal: list[Event] = []
    given = {
        "schemas": {"information": information, "obstacle_gain": 0.0},
        "escape": {"choice": choice, "information": 1.0},
    }
    parameters = Parameters.model_validate(given)
    return Behaviour(
        parameters, Terrain(drawn(FORK), parameters.escape), Counters(), journal, 0.0, 2.5, 100 * MS
    ), journal


def test_a_robot_is_drawn_to_the_frontier_that_promises_more() -> None:
    # One cell in the niche at 1.6 m against three at 3.4 m, before which all is unknown.
    for information, heading in ((0.0, 0.0), (1.0, math.pi)):
        behaviour, _ = led(information)
        found = behaviour.lead(observed(at(17.8, 2)), True)
        assert found is not None
        assert math.remainder(found - heading, math.tau) == pytest.approx(0.0, abs=1e-6)


# ---------------------------------------------------------------- the choice


def scene(seed: int) -> tuple[Any, Any, Any, int, Any]:
    evidence = random_map(seed)
    evidence[10:13, 12:17] = -1
    passable = passable_cells(evidence, 0.0)
    extra = clearance_cost(evidence > 0, 1.0, 0.0)
    goals = frontiers_of(evidence).frontier[:, :NX].astype(np.bool_)
    return evidence, passable, extra, 11 * NX + 14, goals


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("weight", [0.0, 0.4, 1.0])
def test_the_most_useful_has_the_most_information_less_cost(seed: int, weight: float) -> None:
    evidence, passable, extra, start, goals = scene(seed)
    costs = costs_from(passable, extra, start, goals)
    cells = [int(cell) for cell in np.flatnonzero(goals) if math.isfinite(costs.flat[cell])]
    told = {cell: unknown_about(evidence, *divmod(cell, NX), 5) for cell in cells}
    worth = {
        cell: weight * told[cell] / max(told.values()) - (1 - weight) * costs.flat[cell] / max(costs.flat[cells])
        for cell in cells
    }
    found = most_useful(evidence, passable, extra, start, goals, 5.0, weight)
    assert found is not None
    assert worth[found] == pytest.approx(max(worth.values()))
    if weight == 0.0:
        assert costs.flat[found] == min(costs.flat[cells])
    if weight == 1.0:
        assert told[found] == max(told.values())


def test_nothing_is_useful_that_no_way_leads_to() -> None:
    evidence, passable, extra, start, goals = scene(1)
    assert most_useful(evidence, np.zeros_like(passable), extra, 0, goals & False, 5.0, 0.5) is None
    closed = np.zeros_like(goals)
    closed[0, 0] = True
    passable[:3, :3] = False
    assert most_useful(evidence, passable, extra, start, closed, 5.0, 0.5) is None


@pytest.mark.parametrize(("choice", "ix"), [("nearest", 21), ("utility", 11)])
def test_who_is_caught_goes_to_the_nearest_frontier_or_the_most_useful_one(choice: str, ix: int) -> None:
    behaviour, journal = led(0.0, choice)
    for tick in range(200):
        behaviour.lead(observed(at(17.8, 2)), tick < 3)
        laid = [event for event in journal if isinstance(event, PathLaid)]
        if laid:
            break
    assert laid
    assert laid[0].x_m == at(ix, 2)[0]
