"""A floor that was learned: the edges of its occupied cells are walls, and what nobody saw is no way."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from protocols.deployment.driving_parameters import DrivingParameters
from protocols.deployment.floor import Floor
from protocols.deployment.learned import EXPLORE, LearnedFloor, explained, floor_of, outlines
from protocols.deployment.planner import Refusal

BOUNDS_M = (0.0, 0.0, 4.0, 3.0)
CELL_M = 0.1
RADIUS_M = 0.25


def unit_edges(occupied: np.ndarray) -> set[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the edges, from corner to corner, between an occupied cell and one that is not, one by one."""
    ny, nx = occupied.shape
    cells = {(ix, iy) for iy in range(ny) for ix in range(nx) if occupied[iy, ix]}
    edges = set()
    for ix, iy in cells:
        sides = (
            ((ix - 1, iy), (ix, iy), (ix, iy + 1)),
            ((ix + 1, iy), (ix + 1, iy), (ix + 1, iy + 1)),
            ((ix, iy - 1), (ix, iy), (ix + 1, iy)),
            ((ix, iy + 1), (ix, iy + 1), (ix + 1, iy + 1)),
        )
        edges |= {(a, b) for other, a, b in sides if other not in cells}
    return edges


@given(arrays.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7))))
def test_outlines_are_the_edges_of_the_occupied_cells_each_once(occupied: np.ndarray) -> None:
    found = outlines(occupied, (-1.0, 2.0), 0.5)
    pieces = []
    for x1, y1, x2, y2 in (np.round((found - [-1.0, 2.0, -1.0, 2.0]) / 0.5).astype(int)).tolist():
        assert (x1 == x2) != (y1 == y2)
        steps = max(x2 - x1, y2 - y1)
        dx, dy = (x2 - x1) // steps, (y2 - y1) // steps
        pieces += [((x1 + k * dx, y1 + k * dy), (x1 + (k + 1) * dx, y1 + (k + 1) * dy)) for k in range(steps)]
    assert len(pieces) == len(set(pieces))
    assert set(pieces) == unit_edges(occupied)


def test_a_straight_wall_is_two_long_segments_and_its_ends() -> None:
    occupied = np.zeros((5, 9), np.bool_)
    occupied[2, 1:8] = True
    found = outlines(occupied, (0.0, 0.0), 1.0)
    assert sorted(map(tuple, found.tolist())) == [(1, 2, 1, 3), (1, 2, 8, 2), (1, 3, 8, 3), (8, 2, 8, 3)]


def evidence_of(unseen: bool = False) -> np.ndarray:
    """Return the map of a floor of 4 m x 3 m: a wall at x = 2 m with a door of 1 m, and nothing seen beyond."""
    evidence = np.full((32, 42), -5, np.int8)  # a cell more on all sides
    evidence[[0, -1], :] = evidence[:, [0, -1]] = 9
    evidence[1:12, 21] = evidence[21:31, 21] = 9
    if unseen:
        evidence[:, 30:] = 0
    return evidence


def floor(unseen: bool = False) -> LearnedFloor:
    learned = LearnedFloor(BOUNDS_M, DrivingParameters())
    learned.learn(evidence_of(unseen), (-CELL_M, -CELL_M), CELL_M)
    return learned


def test_nothing_is_known_of_a_floor_before_anybody_has_explored() -> None:
    blank = LearnedFloor(BOUNDS_M, DrivingParameters())
    assert not blank.free(RADIUS_M, (1.0, 1.0))
    assert blank.way(RADIUS_M, (1.0, 1.0), (3.0, 1.0)) is None
    assert blank.length_m(RADIUS_M, (1.0, 1.0), (1.0, 1.0)) is None


def test_ways_on_a_learned_floor_are_those_on_the_floor_with_walls_as_thick_as_cells() -> None:
    """The oracle is the floor as it would be given: the walls' outlines by hand."""
    walls = [(0.0, 0.0, 4.0, 0.0), (4.0, 0.0, 4.0, 3.0), (4.0, 3.0, 0.0, 3.0), (0.0, 3.0, 0.0, 0.0)]
    for low, high in ((0.0, 1.1), (2.0, 3.0)):
        walls += [(2.0, low, 2.1, low), (2.1, low, 2.1, high), (2.1, high, 2.0, high), (2.0, high, 2.0, low)]
    given_floor = Floor(walls, BOUNDS_M, lambda p: (p[:, 0] < 0) | (p[:, 0] > 4) | (p[:, 1] < 0) | (p[:, 1] > 3))
    for a, b in (((1.0, 0.5), (3.0, 0.5)), ((0.5, 2.5), (3.5, 1.0)), ((1.0, 1.0), (1.0, 2.0))):
        found, expected = floor().length_m(RADIUS_M, a, b), given_floor.length_m(RADIUS_M, a, b)
        assert found is not None
        assert found == pytest.approx(expected, abs=1e-9)


def test_nobody_is_sent_where_nothing_was_seen() -> None:
    known, part = floor(), floor(unseen=True)
    assert known.free(RADIUS_M, (3.4, 1.5))
    assert not part.free(RADIUS_M, (3.4, 1.5))
    assert part.free(RADIUS_M, (2.6, 1.5))
    assert part.way(RADIUS_M, (1.0, 1.5), (3.6, 1.5)) is None
    assert part.way(RADIUS_M, (1.0, 1.5), (2.6, 1.5)) is not None


def test_what_is_learned_later_counts_at_once() -> None:
    learned = floor(unseen=True)
    assert learned.length_m(RADIUS_M, (1.0, 1.5), (3.5, 1.5)) is None
    learned.learn(evidence_of(), (-CELL_M, -CELL_M), CELL_M)
    length_m = learned.length_m(RADIUS_M, (1.0, 1.5), (3.5, 1.5))
    assert length_m is not None
    assert 2.5 <= length_m < 2.6
    assert learned.field(RADIUS_M, (3.5, 1.5)).distance_m((1.0, 1.5)) < math.inf


def test_only_who_is_to_learn_the_map_knows_nothing_of_it() -> None:
    known = Floor([], BOUNDS_M, None, DrivingParameters(cell_m=0.2))
    assert floor_of(known, learned=False) is known
    learned = floor_of(known, learned=True)
    assert isinstance(learned, LearnedFloor)
    assert (learned.bounds_m, learned.parameters) == (known.bounds_m, known.parameters)


@pytest.mark.parametrize(
    ("why", "helps"),
    [
        ("no robot can get to (5, 3)", True),
        ("no way for it from (1, 1) to (2, 2)", True),
        ("3 robots are wanted, there are 2", False),
    ],
)
def test_exploring_is_offered_where_ways_are_missing(why: str, helps: bool) -> None:
    refusal = Refusal(play="deploy", conflicts=(why,), mend=("something else",))
    blank = LearnedFloor(BOUNDS_M, DrivingParameters())
    found = explained(refusal, blank)
    assert isinstance(found, Refusal)
    assert found.mend == ((EXPLORE, "something else") if helps else ("something else",))
    assert explained(refusal, Floor([], BOUNDS_M, None)) is refusal
