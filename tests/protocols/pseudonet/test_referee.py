"""The judge of coverage: what is entered counts, and of what lies behind dead bodies only what can be reached."""

import numpy as np
import pytest
from shapely.geometry import Point, box

from cosim.protocol import Death
from protocols.pseudonet.coverage import CoverageReferee, cells_touched
from protocols.pseudonet.setup import Setup
from tests.protocols.pseudonet.floors import TIMES, floor, grid_of


def judge(text: str) -> tuple[CoverageReferee, dict[str, int]]:
    setup, cells = floor(text)
    return CoverageReferee(setup), cells


def look(referee: CoverageReferee, *places: tuple[float, float], now: int = 0) -> None:
    referee.look(np.array([x for x, _ in places]), np.array([y for _, y in places]), now)


def test_what_lies_behind_a_dead_body_does_not_count() -> None:
    referee, _ = judge("......")
    look(referee, (0.5, 0.5), (3.5, 0.5))
    referee.died(Death(1, 7, 3.5, 0.5, 0.2))
    assert referee.verdict(8)["coverage"] == 1 / 3  # of the three cells on the living robot's side
    assert np.isnan(referee.verdict(8)["time_to_cover_s"])
    look(referee, (1.5, 0.5), (3.5, 0.5), now=10)
    look(referee, (2.5, 0.5), (3.5, 0.5), now=20)
    assert referee.verdict(20)["coverage"] == 1.0
    assert referee.verdict(20)["time_to_cover_s"] == 20e-9


def test_a_death_can_complete_the_coverage() -> None:
    referee, _ = judge("......")
    look(referee, (0.5, 0.5), (3.5, 0.5))
    look(referee, (1.5, 0.5), (2.5, 0.5), now=5)
    referee.died(Death(1, 7, 2.5, 0.5, 0.2))
    assert referee.verdict(8) == {"coverage": 1.0, "time_to_cover_s": 7e-9, "overlap_ratio": 0.0}


def test_a_run_that_ends_before_its_first_look_has_no_overlap_of_its_walks() -> None:
    referee, _ = judge("......")
    assert np.isnan(referee.verdict(0)["overlap_ratio"])
    look(referee, (0.5, 0.5), (3.5, 0.5))
    assert referee.verdict(1)["overlap_ratio"] == 0.0


def test_a_body_between_two_cells_occupies_both() -> None:
    referee, _ = judge("......")
    look(referee, (0.5, 0.5), (3.5, 0.5))
    referee.died(Death(1, 7, 3.1, 0.5, 0.2))
    assert referee.verdict(8)["coverage"] == 1 / 2


def test_a_way_around_a_body_keeps_the_rest_in_reach() -> None:
    referee, _ = judge(
        """
        ...
        ...
        """
    )
    look(referee, (0.5, 0.5), (1.5, 0.5))
    referee.died(Death(1, 7, 1.5, 0.5, 0.2))
    assert referee.verdict(8)["coverage"] == 1 / 5


def test_when_all_are_dead_the_floor_remains_the_measure() -> None:
    referee, _ = judge("....")
    look(referee, (0.5, 0.5))
    referee.died(Death(0, 1, 0.5, 0.5, 0.2))
    assert referee.verdict(2)["coverage"] == 1 / 4


def test_cells_are_touched_as_shapely_says() -> None:
    grid = Setup(grid_of(np.ones((6, 7), np.bool_)), 1, TIMES).grid
    rng = np.random.default_rng(3)
    for _ in range(300):
        x, y, radius = rng.uniform(-0.3, 7.3), rng.uniform(-0.3, 6.3), rng.uniform(0.05, 1.7)
        touched = set(cells_touched(grid, x, y, radius))
        for cell in range(42):
            row, column = divmod(cell, 7)
            gap = box(column, row, column + 1, row + 1).distance(Point(x, y))
            if abs(gap - radius) > 1e-9:
                assert (cell in touched) == (gap < radius)


@pytest.mark.parametrize("radius_m", [0.2, 0.5])
def test_a_body_in_the_middle_of_its_cell_touches_that_cell_only(radius_m: float) -> None:
    grid = Setup(grid_of(np.ones((3, 3), np.bool_)), 1, TIMES).grid
    assert cells_touched(grid, 1.5, 1.5, radius_m) == [4]
